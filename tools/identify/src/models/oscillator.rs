//! Mass, damper and spring, input in and output out: `m ÿ + d ẏ + k y + offset = input`.
//!
//! Candidates are screened by the equation error of the input ([`crate::equation_error`]): output
//! and input are interpolated to four times the sampling rate with spectral derivatives
//! ([`crate::spectral`]), since both are band-limited. The best few are then simulated from the
//! input alone, fitted to the output by the output-error method ([`crate::output_error`]) and
//! validated on rows that took no part in the fit. All errors are unfiltered output errors. Of the
//! output, only position and speed at the first row enter the simulation, as its initial state.
//!
//! The offset is positive where the machine needs a positive input to rest at 0. An output that is
//! measured from another zero acts as an offset of the input, and beside a cubic spring as a
//! quadratic one.

use report::Page;
use rig::{ForceSource, Model as Declared};

use super::single_channel_study::{
    DeclaredTerm, Need, axis, check_channels, check_scale, declared_parameters, fit_declared, study,
};
use super::{DeclaredFit, Model, Options};
use crate::effects::Units;
use crate::equation_error::model::{Column, RegressionModel};
use crate::equation_error::signals::ForceBalance;
use crate::error::{IdentifyError, Result};
use crate::input::{Series, step_of};
use crate::outcome::Outcome;
use crate::output_error::fit::{OutputErrorModel, Record};
use crate::selection::predictor::Predictor;

/// The model kind `oscillator`.
pub(super) struct Oscillator;

/// Sites at which effects of an oscillator are searched: the spring, the mass, the amplifier, the
/// instruments.
const SITES: &[&str] = &["line", "slave", "drive", "sensor"];

const TERMS: &[DeclaredTerm] = &[
    (Column::Acceleration, &["mass_s2"], Need::Positive),
    (Column::Velocity, &["damping_s"], Need::Declared),
    (Column::Position, &["stiffness"], Need::Positive),
    (Column::Sign, &["coulomb_friction_v"], Need::Optional),
    (Column::One, &["input_offset_v"], Need::Optional),
];

impl Model for Oscillator {
    fn columns(&self) -> &'static [&'static str] {
        &["t_s", "input", "output"]
    }

    fn identify(
        &self,
        rig_file: &str,
        declared: &Declared,
        series: &[Series],
        options: Options<'_>,
    ) -> Result<(Outcome, Page)> {
        with_predictor(rig_file, declared, series, |predictor, of_data| {
            study(predictor, series, options, of_data)
        })
    }

    fn fit_declared(
        &self,
        rig_file: &str,
        declared: &Declared,
        series: &[Series],
        options: Options<'_>,
    ) -> Result<DeclaredFit> {
        with_predictor(rig_file, declared, series, |predictor, of_data| {
            fit_declared(&predictor, series, options, of_data)
        })
    }
}

/// Checks and prepares the records, for `conclude`, which also takes the channel's name and notes
/// on the data.
fn with_predictor<T>(
    rig_file: &str,
    declared: &Declared,
    series: &[Series],
    conclude: impl FnOnce(Predictor<'_>, (&'static str, Vec<String>)) -> Result<T>,
) -> Result<T> {
    let units = Units::VOLTS;
    let parameters = declared_parameters(rig_file, declared, &units, TERMS)?;
    // The lightest mass on the stiffest spring that the declaration allows.
    let (mass, stiffness) = (&parameters[0], &parameters[2]);
    let lightest = (mass.declared - mass.spread).max(0.25 * mass.declared);
    let natural = ((stiffness.declared + stiffness.spread) / lightest).sqrt();
    let mut notes: Vec<String> = series.iter().flat_map(|r| r.notes.iter().cloned()).collect();
    let (mut balances, mut records) = (Vec::new(), Vec::new());
    for series in series {
        let (balance, record) = prepare(series, natural, &mut notes)?;
        balances.push(balance);
        records.push(record);
    }
    let commanded = declared.force != Some(ForceSource::Measured);
    let axis = axis(&balances, units, true, commanded);
    let regression = RegressionModel { balances, parameters, axis, sites: SITES };
    let advice = "check the units: input and output in the same unit (V), t_s in s, and which \
                      of the two is which";
    for scale in [
        (Column::Acceleration, "input and acceleration give a mass"),
        (Column::Position, "input and output give a stiffness"),
    ] {
        check_scale(&regression, "output", scale, advice)?;
    }
    let simulation = OutputErrorModel { regression: &regression, records: &records };
    conclude(Predictor::OutputError(simulation), ("output", notes))
}

/// Checks one record and prepares it for the screening and for the simulation.
fn prepare(
    series: &Series,
    natural: f64,
    notes: &mut Vec<String>,
) -> Result<(ForceBalance, Record)> {
    let time = series.time()?;
    let (_, input) = series.any(&["input"])?;
    let (_, output) = series.any(&["output"])?;
    check_channels(series, &[("input", "the input"), ("output", "the output")], notes)?;
    let short = || series.short(time.len());
    let balance =
        ForceBalance::band_limited(&series.file, time, output, input).ok_or_else(short)?;
    let signals = &balance.signals;
    let sampling = 1.0 / step_of(time).ok_or_else(short)?;
    if natural > std::f64::consts::PI * sampling {
        let oscillation = 0.5 * natural / std::f64::consts::TAU;
        let found = format!(
            "{sampling:.4} samples a second cannot show an oscillation of {oscillation:.4} Hz"
        );
        let advice = "record at ten times the natural frequency, or check mass, stiffness and the \
                      unit of time";
        return Err(IdentifyError::channel(&series.file, "t_s", found, advice));
    }
    let at = signals.before_rows();
    let start = (signals.position[at], signals.velocity[at]);
    let first = Record::first_sample(at);
    let record = Record::new(time, (input, output), (first, balance.rows()), start, natural)
        .ok_or_else(short)?;
    Ok((balance, record))
}
