//! Models whose measured force is compared with the force that the measured motion needs.

use report::Page;
use rig::{ForceSource, Model as Declared};

use super::single_channel_study::{
    DeclaredTerm, axis, check_channels, check_scale, declared_parameters, fit_declared, study,
};
use super::{DeclaredFit, Model, Options};
use crate::effects::Units;
use crate::equation_error::model::{Column, Parameter, RegressionModel};
use crate::equation_error::signals::{CutOff, ForceBalance};
use crate::error::Result;
use crate::input::Series;
use crate::outcome::Outcome;
use crate::selection::predictor::Predictor;

/// What to do where a scale is off by orders of magnitude.
const CHECK_UNITS: &str =
    "check the units: m (or rad), N (or N·m) and s are expected, not mm, degrees, kN or ms";

/// Parameters that scale a motor's voltage, with the column that they make of it and their unit.
const FORCE_PER_VOLT: [(&str, &str, &str); 2] =
    [("force_per_volt_n", "force_n", "N/V"), ("torque_per_volt_nm", "torque_nm", "N·m/V")];

/// A kind of model.
pub(super) struct ForceBalanceModel {
    /// The columns of its records, time first.
    pub(super) columns: &'static [&'static str],
    /// Sites at which its effects are searched.
    pub(super) sites: &'static [&'static str],
    /// Cut-off of the low-pass.
    pub(super) cut_off: CutOff,
    /// The declared terms.
    pub(super) terms: &'static [DeclaredTerm],
    /// Column and words of the scale that reveals a wrong unit.
    pub(super) scale: (Column, &'static str),
    /// Whether a spring holds the position.
    pub(super) spring: bool,
    /// Whether an amplifier makes the force, where the rig file does not say.
    pub(super) commanded: bool,
}

impl Model for ForceBalanceModel {
    fn columns(&self) -> &'static [&'static str] {
        self.columns
    }

    fn identify(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options<'_>,
    ) -> Result<(Outcome, Page)> {
        self.with_predictor(rig_file, declared, records, |predictor, of_data| {
            study(predictor, records, options, of_data)
        })
    }

    fn fit_declared(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options<'_>,
    ) -> Result<DeclaredFit> {
        self.with_predictor(rig_file, declared, records, |predictor, of_data| {
            fit_declared(&predictor, records, options, of_data)
        })
    }
}

impl ForceBalanceModel {
    /// Checks and prepares the records, for `conclude`, which also takes the channel's name and
    /// notes on the data.
    fn with_predictor<T>(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        conclude: impl FnOnce(Predictor<'_>, (&'static str, Vec<String>)) -> Result<T>,
    ) -> Result<T> {
        let mut notes: Vec<String> = records.iter().flat_map(|r| r.notes.iter().cloned()).collect();
        let (mut balances, mut channel) = (Vec::new(), "force_n");
        for series in records {
            let (balance, name) = self.prepare(series, declared, &mut notes)?;
            balances.push(balance);
            channel = name;
        }
        let units = if channel == "torque_nm" { Units::ROTARY } else { Units::LINEAR };
        let parameters = declared_parameters(rig_file, declared, &units, self.terms)?;
        notes.extend(other_unit(&parameters, channel));
        let mut axis = axis(&balances, units, self.spring, self.is_commanded(declared));
        axis.turn = declared.motor_turn().or(axis.turn);
        let regression = RegressionModel { balances, parameters, axis, sites: self.sites };
        check_scale(&regression, channel, self.scale, CHECK_UNITS)?;
        conclude(Predictor::EquationError(&regression), (channel, notes))
    }
}

/// A note where parameters of a linear axis meet a rotary record, or the other way round.
fn other_unit(parameters: &[Parameter], channel: &str) -> Option<String> {
    let rotary = channel == "torque_nm";
    let other: Vec<String> = parameters
        .iter()
        .filter(|parameter| rig::is_rotary(&parameter.name) != rotary)
        .map(|parameter| format!("{} ({})", parameter.name, parameter.unit))
        .collect();
    let declared = if rotary { "linear" } else { "rotary" };
    (!other.is_empty()).then(|| {
        format!(
            "declared for a {declared} axis, taken in the units of {channel}: {}",
            other.join(", ")
        )
    })
}

impl ForceBalanceModel {
    /// Whether an amplifier makes the force, as the rig file says or else as usual for the kind.
    fn is_commanded(&self, declared: &Declared) -> bool {
        declared.force.map_or(self.commanded, |force| force == ForceSource::Commanded)
    }

    /// Checks one record and prepares its rows; the second value is the force's column.
    fn prepare(
        &self,
        series: &Series,
        declared: &Declared,
        notes: &mut Vec<String>,
    ) -> Result<(ForceBalance, &'static str)> {
        let time = series.time()?;
        let (position_name, position) = series.any(&["position_m", "position_rad"])?;
        let force = series.any(&["force_n", "torque_nm"]);
        let scaled: Vec<f64>;
        let motor = FORCE_PER_VOLT.iter().find_map(|(name, channel, unit)| {
            Some((declared.parameter(name)?.value, *channel, *unit))
        });
        let (force_source, channel, force) = match (force, series.column("motor_v"), motor) {
            (Err(_), Some(volts), Some((scale, channel, unit))) if self.is_commanded(declared) => {
                scaled = volts.iter().map(|v| v * scale).collect();
                let what = if channel == "torque_nm" { "torque" } else { "force" };
                notes.push(format!(
                    "{}: {what} = {scale} {unit} × motor_v, as declared",
                    series.file
                ));
                ("motor_v", channel, scaled.as_slice())
            }
            (force, ..) => {
                let (name, force) = force?;
                (name, name, force)
            }
        };
        let channels = [(position_name, "the position"), (force_source, "the force")];
        check_channels(series, &channels, notes)?;
        let balance = ForceBalance::new(&series.file, time, position, force, self.cut_off);
        Ok((balance.ok_or_else(|| series.short(time.len()))?, channel))
    }
}
