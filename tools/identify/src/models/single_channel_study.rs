//! Shared by models with one measured channel: declared terms, checks of the columns,
//! search.

use report::Page;
use rig::Model as Declared;

use super::role_assignment::assign_roles;
use super::single_channel_outcome::conclude;
use super::single_channel_parameters::parameters;
use super::single_channel_result::Study;
use super::{DeclaredFit, Options};
use crate::effects::{Axis, Units};
use crate::equation_error::block_roles::{Block, Role, blocks_of_role};
use crate::equation_error::model::{Column, Parameter, RegressionModel};
use crate::equation_error::signals::ForceBalance;
use crate::error::{IdentifyError, Result};
use crate::input::Series;
use crate::outcome::{ChannelError, Outcome};
use crate::prediction_error::record::rms;
use crate::regression::{Gram, solve};
use crate::selection::predictor::Predictor;
use crate::selection::search::{self, functions, search};

/// A parameter that differs from its declared value by this factor indicates a wrong unit.
const UNIT_FACTOR: f64 = 30.0;

/// A mass that is negative by less than this share of the declared one, once gravity, a spring and
/// dry friction may take their part, is not of the wrong sign.
const LEAST_EXCUSED: f64 = 0.2;

/// Splits the records, searches and concludes.
pub(super) fn study(
    predictor: Predictor<'_>,
    records: &[Series],
    options: Options<'_>,
    (channel, mut notes): (&'static str, Vec<String>),
) -> Result<(Outcome, Page)> {
    let blocks = assign_roles(&predictor, records, options.seed, &mut notes)?;
    let functions = functions(&predictor, &blocks);
    let found = search(&predictor, &blocks, &functions, options.deadline)
        .ok_or_else(|| indistinct(predictor.regression(), records))?;
    let early = options.deadline.left_work_out();
    if early {
        notes.push(
            "the time limit (--limit-s) ended the search early: not every effect was tried"
                .to_owned(),
        );
    }
    Ok(conclude(&Study { predictor, blocks, found, channel, notes, early }))
}

/// Fits the declared model alone, on all rows that do not report.
pub(super) fn fit_declared(
    predictor: &Predictor<'_>,
    records: &[Series],
    options: Options<'_>,
    (channel, mut notes): (&'static str, Vec<String>),
) -> Result<DeclaredFit> {
    let blocks = assign_roles(predictor, records, options.seed, &mut notes)?;
    let report = blocks_of_role(&blocks, Role::Report);
    let fit: Vec<Block> = blocks.into_iter().filter(|block| block.role != Role::Report).collect();
    let regression = predictor.regression();
    let base =
        search::fit_declared(predictor, &fit).ok_or_else(|| indistinct(regression, records))?;
    let mut as_declared = base.fitted.clone();
    let values = as_declared.fit.coefficients.iter_mut();
    values.zip(&regression.parameters).for_each(|(value, own)| *value = own.declared);
    let [(declared, _), (fitted, size)] =
        [&as_declared, &base.fitted].map(|own| predictor.error(own, &report));
    let error = ChannelError {
        declared: Some(declared),
        before: fitted,
        after: fitted,
        floor: None,
        unit: predictor.unit().to_owned(),
        before_percent: 100.0 * fitted / size,
        after_percent: 100.0 * fitted / size,
    };
    Ok(DeclaredFit {
        parameters: parameters(regression, &base),
        error: [(channel.to_owned(), error)].into(),
        notes,
    })
}

/// The error where the columns of the declared model depend on one another.
fn indistinct(regression: &RegressionModel, records: &[Series]) -> IdentifyError {
    let files: Vec<&str> = records.iter().map(|r| r.file.as_str()).collect();
    let columns: Vec<&str> = regression.parameters.iter().map(|p| p.name.as_str()).collect();
    IdentifyError::Unusable(format!(
        "{}: the columns {} cannot be told apart in the rows that take part in the fit; excite the \
         machine more",
        files.join(", "),
        columns.join(", ")
    ))
}

/// Whether a parameter must be declared.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Need {
    /// Declared, with a positive value.
    Positive,
    /// Declared.
    Declared,
    /// May be left out.
    Optional,
}

/// A term of the declared model: its column, the names of its parameter, and whether it must be
/// declared.
pub(super) type DeclaredTerm = (Column, &'static [&'static str], Need);

/// Reads the declared terms of a model of `file` (its name, for messages); the name in the record's
/// unit counts, else the first that is declared.
pub(super) fn declared_parameters(
    file: &str,
    model: &Declared,
    units: &Units,
    terms: &[DeclaredTerm],
) -> Result<Vec<Parameter>> {
    let mut parameters = Vec::new();
    for (column, names, need) in terms {
        let of_unit = model.parameter(name_in(names, units));
        let declared = of_unit.or_else(|| names.iter().find_map(|name| model.parameter(name)));
        let Some(declared) = declared else {
            if *need == Need::Optional {
                continue;
            }
            let found: Vec<&str> = model.parameters.iter().map(|p| p.name.as_str()).collect();
            return Err(IdentifyError::Unusable(format!(
                "{file}: [model.parameters]: expected `{}` for a model of kind `{}`, found {}; add \
                 it with its value and tolerance",
                name_in(names, units),
                model.kind.name(),
                found.join(", ")
            )));
        };
        if *need == Need::Positive && declared.value <= 0.0 {
            return Err(IdentifyError::Unusable(format!(
                "{file}: [model.parameters] {} = {}: expected more than 0",
                declared.name, declared.value
            )));
        }
        parameters.push(Parameter {
            name: declared.name.clone(),
            unit: column.unit(units),
            declared: declared.value,
            spread: declared.spread(),
            column: *column,
        });
    }
    Ok(parameters)
}

/// The name of a parameter in these units, for messages.
fn name_in<'n>(names: &[&'n str], units: &Units) -> &'n str {
    let rotary = units.position == "rad";
    names.iter().find(|name| rig::is_rotary(name) == rotary).unwrap_or(&names[0])
}

/// Checks that channels are finite and vary, and notes clipped ones.
pub(super) fn check_channels(
    series: &Series,
    channels: &[(&str, &str)],
    notes: &mut Vec<String>,
) -> Result<()> {
    for (name, what) in channels {
        series.finite(name)?;
        series.alive(name, what)?;
        let railed = series.railed(name);
        if railed > 0.001 {
            notes.push(format!(
                "{}: {name} stands at its extreme for {:.1} % of the rows; where that is the \
                 sensor's rail and not the amplifier's, {what} is wrong there",
                series.file,
                100.0 * railed
            ));
        }
    }
    Ok(())
}

/// Units and ranges of the records.
pub(super) fn axis(balances: &[ForceBalance], units: Units, spring: bool, commanded: bool) -> Axis {
    let all =
        |f: fn(&ForceBalance) -> &[f64]| balances.iter().flat_map(move |b| f(b).iter().copied());
    let peak = |f| all(f).fold(0.0f64, |top, v| top.max(v.abs()));
    let velocity: fn(&ForceBalance) -> &[f64] = |b| &b.signals.velocity;
    let force: fn(&ForceBalance) -> &[f64] = |b| &b.force;
    let range = |(low, high): (f64, f64), x: f64| (low.min(x), high.max(x));
    let seconds = |b: &ForceBalance| b.rows() as f64 * b.row_step();
    Axis {
        units,
        rotary: units.position == "rad",
        turn: (units.position == "rad").then_some(std::f64::consts::TAU),
        spring,
        commanded,
        positions: all(|b| &b.signals.position).fold((f64::INFINITY, f64::NEG_INFINITY), range),
        velocity_rms: rms(all(velocity)),
        velocity_peak: peak(velocity),
        force_rms: rms(all(force)),
        force_peak: peak(force),
        seconds: balances.iter().map(seconds).fold(0.0, f64::max),
        cut_off: balances.iter().map(|b| b.cut_off).fold(0.0, f64::max),
    }
}

/// Refuses data with a wrong sign or a scale that is off by orders of magnitude, as a free fit of
/// one parameter shows.
pub(super) fn check_scale(
    regression: &RegressionModel,
    channel: &str,
    which: (Column, &str),
    advice: &str,
) -> Result<()> {
    let (column, what) = which;
    let Some(at) = regression.parameters.iter().position(|p| p.column == column) else {
        return Ok(());
    };
    let parameter = &regression.parameters[at];
    for balance in &regression.balances {
        let s = &balance.signals;
        let mut columns: Vec<Vec<f64>> = regression
            .parameters
            .iter()
            .filter_map(|p| match p.column {
                Column::Acceleration => Some(s.rows(&s.acceleration)),
                Column::Velocity => Some(s.rows(&s.velocity)),
                Column::Position => Some(s.rows(&s.position)),
                Column::Sign | Column::One => None,
            })
            .collect();
        columns.push(vec![1.0; balance.rows()]);
        let free = |columns: &[Vec<f64>]| {
            let mut gram = Gram::empty(columns.len());
            gram.add(columns, &balance.force, 0..balance.rows());
            solve(&gram, &vec![(f64::NEG_INFINITY, f64::INFINITY); columns.len()])
        };
        let Some(fit) = free(&columns) else { continue };
        // Mass, damping and stiffness are in the order of the declaration, before all others.
        let found = fit.coefficients[at];
        columns.remove(at);
        let without = free(&columns).map_or(f64::INFINITY, |f| f.squares);
        // Its parameter is meaningful only if the column explains a good part of the force.
        if fit.squares > 0.7 * without {
            continue;
        }
        let ratio = found / parameter.declared;
        let fault = |found: String, advice: &str| {
            Err(IdentifyError::channel(&balance.name, channel, found, advice))
        };
        let unit = parameter.unit;
        if ratio < 0.0 && is_excused(regression, balance, parameter) {
            continue;
        }
        if ratio < 0.0 {
            let advice =
                "both channels must be positive in the same direction: change the sign of one";
            return fault(format!("{what} of {found:.4} {unit}"), advice);
        }
        if !(1.0 / UNIT_FACTOR..=UNIT_FACTOR).contains(&ratio) {
            let declared = parameter.declared;
            return fault(format!("{what} of {found:.4} {unit}, declared {declared}"), advice);
        }
    }
    Ok(())
}

/// Whether a mass of the wrong sign is that of a machine with gravity, a spring or dry friction
/// that are not declared: beside their columns it is positive, or small.
fn is_excused(regression: &RegressionModel, balance: &ForceBalance, parameter: &Parameter) -> bool {
    if parameter.column != Column::Acceleration || regression.axis.spring {
        return false;
    }
    let s = &balance.signals;
    let of_position = |function: fn(f64) -> f64| {
        let full: Vec<f64> = s.position.iter().copied().map(function).collect();
        s.low_passed_rows(&full)
    };
    let mut columns = vec![
        s.rows(&s.acceleration),
        s.rows(&s.velocity),
        vec![1.0; balance.rows()],
        s.low_passed_rows(&s.sign(0.05 * regression.axis.velocity_rms)),
        s.rows(&s.position),
    ];
    if regression.axis.rotary {
        columns.extend([of_position(f64::sin), of_position(f64::cos)]);
    }
    let mut gram = Gram::empty(columns.len());
    gram.add(&columns, &balance.force, 0..balance.rows());
    solve(&gram, &vec![(f64::NEG_INFINITY, f64::INFINITY); columns.len()])
        .is_some_and(|fit| fit.coefficients[0] > -LEAST_EXCUSED * parameter.declared)
}
