//! One mass with friction, force in and position out: `m ẍ + c ẋ + offset = force`.
//!
//! The equation error of the force balance is minimised. Position and force pass the same
//! zero-phase low-pass ([`crate::filter`]: order 4 a pass, 40 Hz), velocity and acceleration are
//! five-point differences of the filtered position, nonlinear columns pass the low-pass once more,
//! as the friction in the force did, and every fifth sample (at 1 kHz) becomes a row. The first and
//! last 0.1 s are left out. The residual is the measured force minus the model's, in percent of the
//! force's rms. The method is that of Janot, Gautier, Brunot (2019), who publish 4.08 % with
//! Coulomb friction and 3.11 % with direction-dependent friction for the EMPS record.
//!
//! An open-loop simulation would be a poor criterion: a mass without a spring is a double
//! integrator.
//!
//! The offset is positive where the machine needs a positive force to stand still.

use report::Page;
use rig::Model as Declared;

use super::equation_error_study::{
    CHECK_UNITS, Declaration, axis, check_channels, check_scale, study, units_of,
};
use super::{Model, Options};
use crate::effects::Units;
use crate::equation_error::model::{Column, Parameter, RegressionModel};
use crate::equation_error::signals::{CutOff, ForceBalance};
use crate::error::Result;
use crate::input::Series;
use crate::outcome::Outcome;

/// The model kind `drive`.
pub(super) struct Drive;

/// Sites at which effects of a drive are searched: the mass, the amplifier and motor, the
/// instruments.
const SITES: &[&str] = &["master", "drive", "sensor"];

/// As published for EMPS.
const CUT_OFF: CutOff = CutOff { highest: 40.0, share: 0.1 };

impl Model for Drive {
    fn columns(&self) -> &'static [&'static str] {
        &["t_s", "force_n", "torque_nm", "motor_v", "position_m", "position_rad"]
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
        let units = units_of(channel);
        let parameters =
            declared_parameters(&Declaration { file: rig_file, model: declared }, &units)?;
        let mut axis = axis(&balances, units, false, true);
        axis.turn = declared.parameter("motor_turn_m").map(|p| p.value).or(axis.turn);
        let regression = RegressionModel { balances, parameters, axis, sites: SITES };
        let scale = (Column::Acceleration, "force and acceleration give a mass");
        check_scale(&regression, channel, scale, CHECK_UNITS)?;
        study(regression, records, options, (channel, notes))
    }
}

/// Reads the declaration: mass, viscous friction, offset, and Coulomb friction where it is
/// declared.
fn declared_parameters(declaration: &Declaration<'_>, units: &Units) -> Result<Vec<Parameter>> {
    let viscous = ["viscous_friction_n_s_per_m", "viscous_n_s_per_m", "viscous_nm_s_per_rad"];
    let mut parameters = vec![
        declaration.need_positive(
            &["mass_kg", "inertia_kg_m2"],
            units.mass,
            Column::Acceleration,
        )?,
        declaration.need(&viscous, units.damping, Column::Velocity)?,
    ];
    let coulomb = ["coulomb_friction_n", "coulomb_n", "coulomb_nm"];
    parameters.extend(declaration.of(&coulomb, units.force, Column::Sign));
    parameters.extend(declaration.of(
        &["force_offset_n", "offset_n", "offset_nm"],
        units.force,
        Column::One,
    ));
    Ok(parameters)
}

/// Checks one record and prepares its rows; the second value is the force's column.
fn prepare(
    series: &Series,
    declared: &Declared,
    notes: &mut Vec<String>,
) -> Result<(ForceBalance, &'static str)> {
    let time = series.time()?;
    let (position_name, position) = series.any(&["position_m", "position_rad"])?;
    let scaled: Vec<f64>;
    let force_per_volt = declared.parameter("force_per_volt_n").map(|p| p.value);
    let (force_source, channel, force) = match (series.column("motor_v"), force_per_volt) {
        (Some(volts), Some(scale))
            if series.column("force_n").is_none() && series.column("torque_nm").is_none() =>
        {
            scaled = volts.iter().map(|v| v * scale).collect();
            notes.push(format!("{}: force = {scale} N/V × motor_v, as declared", series.file));
            ("motor_v", "force_n", scaled.as_slice())
        }
        _ => {
            let (name, force) = series.any(&["force_n", "torque_nm"])?;
            (name, name, force)
        }
    };
    check_channels(series, &[(position_name, "the position"), (force_source, "the force")], notes)?;
    let balance = ForceBalance::new(&series.file, time, position, force, CUT_OFF);
    Ok((balance.ok_or_else(|| series.short(time.len()))?, channel))
}
