//! One mass with friction, force in and position out: `m ẍ + c ẋ + offset = force`.
//!
//! The model is read inversely. Position and force pass the same zero-phase low-pass ([`crate::filter`]: order 4 a
//! pass, 40 Hz), velocity and acceleration are five-point differences of the filtered position, nonlinear columns pass the
//! low-pass once more, as the friction in the force did, and every fifth sample (at 1 kHz) becomes a row. The first and last 0.1 s
//! are left out. The residual is what the measured force has beyond the model, in percent of the force's root mean square. The
//! method is that of Janot, Gautier, Brunot (2019), who publish 4.08 % with Coulomb friction and 3.11 % with
//! direction-dependent friction for the EMPS record.
//!
//! A free simulation would judge badly: a mass without a spring is a double integrator.
//!
//! The offset is positive where the machine needs a positive force to stand still.

use nalgebra::DVector;
use report::Page;
use rig::{Model as Declared, ModelKind, Parameter as DeclaredParameter};

use super::{Model, Options, drive_outcome};
use crate::effects::{Speeds, Units};
use crate::error::{IdentifyError, Result};
use crate::input::Series;
use crate::inverse::model::{Column, Machine, Parameter};
use crate::inverse::search::{Found, search};
use crate::inverse::signals::Balance;
use crate::inverse::split::{self, Block, Role};
use crate::outcome::Outcome;
use crate::regression::{Gram, solve};

/// The model kind `drive`.
pub(super) struct Drive;

/// The site at which a drive's friction is looked for.
pub(super) const SITE: &str = "master";

const LINEAR: Units = Units { force: "N", position: "m", velocity: "m/s", damping: "N·s/m", mass: "kg" };
const ROTARY: Units =
    Units { force: "N·m", position: "rad", velocity: "rad/s", damping: "N·m·s/rad", mass: "kg·m²" };

/// Blocks of one record last at least this long (s).
const BLOCK_S: f64 = 0.4;
/// A record is cut into about this many blocks.
const BLOCKS: f64 = 40.0;
/// Fewest blocks: three that select and three that report.
const FEWEST_BLOCKS: usize = 12;
/// A mass that differs from the declared one by this factor is a wrong unit, not a wrong guess.
const UNIT_FACTOR: f64 = 30.0;

/// A drive's records, prepared, and what they turned out to say.
pub(super) struct Study {
    /// Declared model and prepared records.
    pub(super) machine: Machine,
    /// Rows by role.
    pub(super) blocks: Vec<Block>,
    /// What the search found.
    pub(super) found: Found,
    /// Column of the force.
    pub(super) channel: &'static str,
    /// What a reader should know of the data.
    pub(super) notes: Vec<String>,
}

impl Model for Drive {
    fn kind(&self) -> ModelKind {
        ModelKind::Drive
    }

    fn identify(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options,
    ) -> Result<(Outcome, Page)> {
        let mut notes: Vec<String> = records.iter().flat_map(|r| r.notes.iter().cloned()).collect();
        let (mut balances, mut channel) = (Vec::new(), "force_n");
        for series in records {
            let (balance, name) = prepare(series, declared, &mut notes)?;
            balances.push(balance);
            channel = name;
        }
        let units = if channel == "torque_nm" { ROTARY } else { LINEAR };
        let parameters = declared_parameters(rig_file, declared, &units)?;
        let speed = |f: &dyn Fn(f64, f64) -> f64| {
            balances.iter().flat_map(|b| &b.signals.velocity).fold(0.0, |sum, v| f(sum, *v))
        };
        let count: usize = balances.iter().map(|b| b.signals.velocity.len()).sum();
        let speeds = Speeds {
            rms: (speed(&|sum, v| sum + v * v) / count as f64).sqrt(),
            peak: speed(&|top, v| top.max(v.abs())),
        };
        let machine = Machine { balances, parameters, units, speeds };
        check_units(&machine, channel)?;
        let blocks = blocks(&machine, records, options.seed)?;
        let names = || machine.parameters.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ");
        let files = || records.iter().map(|r| r.file.as_str()).collect::<Vec<_>>().join(", ");
        let found = search(&machine, SITE, &blocks, options.jobs)
            .ok_or_else(|| IdentifyError::Singular { file: files(), columns: names() })?;
        let study = Study { machine, blocks, found, channel, notes };
        Ok(drive_outcome::conclude(&study))
    }
}

/// Reads the declaration: mass, viscous friction, offset, and Coulomb friction where it is declared.
fn declared_parameters(file: &str, declared: &Declared, units: &Units) -> Result<Vec<Parameter>> {
    let of = |names: &[&'static str]| names.iter().find_map(|n| declared.parameter(n));
    let need = |names: &[&'static str]| {
        of(names).ok_or_else(|| IdentifyError::Parameter {
            file: file.to_owned(),
            kind: "drive",
            name: names[0],
            found: declared.parameters.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", "),
        })
    };
    let column = |p: &DeclaredParameter, unit, column| Parameter {
        name: p.name.clone(),
        unit,
        declared: p.value,
        spread: p.spread(),
        column,
    };
    let mass = need(&["mass_kg", "inertia_kg_m2"])?;
    if mass.value <= 0.0 {
        let (file, value) = (file.to_owned(), mass.value);
        return Err(IdentifyError::Value { file, name: "mass_kg", value, expected: "more than 0" });
    }
    let viscous = need(&["viscous_friction_n_s_per_m", "viscous_n_s_per_m", "viscous_nm_s_per_rad"])?;
    let mut parameters =
        vec![column(mass, units.mass, Column::Acceleration), column(viscous, units.damping, Column::Velocity)];
    if let Some(coulomb) = of(&["coulomb_friction_n", "coulomb_n", "coulomb_nm"]) {
        parameters.push(column(coulomb, units.force, Column::Sign));
    }
    if let Some(offset) = of(&["force_offset_n", "offset_n", "offset_nm"]) {
        parameters.push(column(offset, units.force, Column::One));
    }
    Ok(parameters)
}

/// Checks one record and prepares its rows; the second value is the force's column.
fn prepare(series: &Series, declared: &Declared, notes: &mut Vec<String>) -> Result<(Balance, &'static str)> {
    let time = series.time()?;
    let (position_name, position) = series.any(&["position_m", "position_rad"])?;
    let scaled: Vec<f64>;
    let force_per_volt = declared.parameter("force_per_volt_n").map(|p| p.value);
    let (force_source, channel, force) = match (series.column("motor_v"), force_per_volt) {
        (Some(volts), Some(scale)) if series.column("force_n").is_none() && series.column("torque_nm").is_none() => {
            scaled = volts.iter().map(|v| v * scale).collect();
            notes.push(format!("{}: force = {scale} N/V × motor_v, as declared", series.file));
            ("motor_v", "force_n", scaled.as_slice())
        }
        _ => {
            let (name, force) = series.any(&["force_n", "torque_nm"])?;
            (name, name, force)
        }
    };
    for (name, what) in [(position_name, "the position"), (force_source, "the force")] {
        series.finite(name)?;
        series.alive(name, what)?;
    }
    let railed = series.railed(force_source);
    if railed > 0.001 {
        notes.push(format!(
            "{}: {force_source} stands at its extreme for {:.1} % of the rows; where that is the sensor's rail and not \
             the amplifier's, the force is wrong there",
            series.file,
            100.0 * railed
        ));
    }
    let balance = Balance::new(&series.file, time, position, force).ok_or_else(|| series.short(time.len()))?;
    Ok((balance, channel))
}

/// Refuses data whose scale is off by orders of magnitude, or whose sign is: a free fit of the mass tells.
fn check_units(machine: &Machine, channel: &'static str) -> Result<()> {
    let Some(mass) = machine.parameters.first() else { return Ok(()) };
    for balance in &machine.balances {
        let s = &balance.signals;
        let columns = [s.rows(&s.acceleration), s.rows(&s.velocity), vec![1.0; balance.rows()]];
        let mut gram = Gram::empty(3);
        gram.add(&columns, &balance.force, 0..balance.rows());
        let Some(fit) = solve(&gram, &[(f64::NEG_INFINITY, f64::INFINITY); 3]) else { continue };
        let without = {
            let mut rest = Gram::empty(2);
            rest.add(&columns[1..], &balance.force, 0..balance.rows());
            solve(&rest, &[(f64::NEG_INFINITY, f64::INFINITY); 2]).map_or(f64::INFINITY, |f| f.squares)
        };
        // Only where the acceleration explains a good part of the force does the mass say anything.
        if fit.squares > 0.7 * without {
            continue;
        }
        let found = fit.coefficients[0];
        let ratio = found / mass.declared;
        let unit = machine.units.mass;
        let fault = |found: String, advice: &str| {
            Err(IdentifyError::Channel {
                file: balance.name.clone(),
                column: channel.to_owned(),
                found,
                advice: advice.to_owned(),
            })
        };
        if ratio < 0.0 {
            let advice = "force and position must be positive in the same direction: change the sign of one";
            return fault(format!("force and acceleration give a mass of {found:.4} {unit}"), advice);
        }
        if !(1.0 / UNIT_FACTOR..=UNIT_FACTOR).contains(&ratio) {
            let advice = "check the units: m (or rad), N (or N·m) and s are expected, not mm, degrees, kN or ms";
            let declared = mass.declared;
            return fault(
                format!("force and acceleration give a mass of {found:.4} {unit}, declared {declared}"),
                advice,
            );
        }
    }
    Ok(())
}

/// Who does what: whole records where there are enough, else blocks of the record.
fn blocks(machine: &Machine, records: &[Series], seed: u64) -> Result<Vec<Block>> {
    let length = |b: &Balance| {
        let seconds = b.rows() as f64 * b.row_step();
        ((seconds / BLOCKS).max(BLOCK_S) / b.row_step()).ceil() as usize
    };
    let whole = |i: usize, role| {
        let b = &machine.balances[i];
        split::whole_record(i, b.rows(), length(b), role)
    };
    let cut = |i: usize| {
        let b = &machine.balances[i];
        let guard = (4.0 / b.cut_off / b.row_step()).ceil() as usize;
        let blocks = split::one_record(i, b.rows(), length(b), guard, seed.wrapping_add(i as u64));
        if blocks.len() < FEWEST_BLOCKS { Err(records[i].short(b.signals.time.len())) } else { Ok(blocks) }
    };
    let n = machine.balances.len();
    if records.iter().all(|r| r.role.is_some()) {
        let roles = records.iter().enumerate().filter_map(|(i, r)| r.role.map(|role| (i, role)));
        return Ok(roles.flat_map(|(i, role)| whole(i, role)).collect());
    }
    match split::roles(n) {
        Some(roles) => Ok(roles.into_iter().enumerate().flat_map(|(i, role)| whole(i, role)).collect()),
        None if n == 2 => {
            // The second reports as a whole; the first fits and selects.
            let mut blocks = cut(0)?;
            for block in &mut blocks {
                if block.role == Role::Report {
                    block.role = Role::Select;
                }
            }
            blocks.extend(whole(1, Role::Report));
            Ok(blocks)
        }
        None => cut(0),
    }
}

/// Root mean square of the residual over some blocks, and of the force over the same rows.
pub(super) fn error(study: &Study, fitted: &crate::inverse::model::Fitted, blocks: &[Block]) -> (f64, f64) {
    let (mut e, mut f, mut n) = (0.0, 0.0, 0usize);
    for block in blocks {
        e += DVector::from_vec(study.machine.residual(fitted, block)).norm_squared();
        f += study.machine.balances[block.record].force[block.rows.clone()].iter().map(|f| f * f).sum::<f64>();
        n += block.rows.len();
    }
    ((e / n.max(1) as f64).sqrt(), (f / n.max(1) as f64).sqrt())
}
