//! The result in the form of `--json`.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::correlation::ResidualTests;
use crate::estimate_correlation::EstimateCorrelation;
use crate::false_alarm::FalseAlarm;

/// The verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Effects were found that the model lacks.
    Effect,
    /// No effect is missing that these records could reveal.
    None,
    /// An effect is missing, and the records cannot distinguish two that explain it.
    Ambiguous,
    /// Something is missing that no listed effect explains. Effects that explain a part beside it
    /// are named.
    Unlisted,
    /// The model describes the records badly, and neither listed effects nor a function of one
    /// variable explain most of the error; or something explains a good part of it without being
    /// significant. No effect is named. Of a transmission: the declared model is refuted, but the
    /// time limit ended the search before every listed effect was tried; where all were, this is
    /// [`Verdict::Unlisted`].
    Inadequate,
    /// Whether an effect is missing is open: the time limit ended the search before every effect
    /// was tried, and the error is above the noise floor or that is not known; or no record of a
    /// transmission has the slave's position, and the error is no larger than what the slave's
    /// friction near zero speed may leave.
    Undecided,
}

impl Verdict {
    /// The verdict from the number of effects added, the number of rivals that the records cannot
    /// distinguish from them, and whether a residual remains that no listed effect explains.
    pub fn of(effects: usize, rivals: usize, remains: bool) -> Self {
        match (effects, rivals) {
            (0, _) if remains => Self::Unlisted,
            (0, _) => Self::None,
            (_, 0) => Self::Effect,
            _ => Self::Ambiguous,
        }
    }
}

/// What `--json` holds where there is no result.
#[derive(Clone, Debug, Serialize)]
pub struct Refusal {
    /// Always `null`: no verdict was reached.
    pub verdict: Option<Verdict>,
    /// Why; a result has no such key.
    pub refused: Reason,
}

/// Why there is no result.
#[derive(Clone, Debug, Serialize)]
pub struct Reason {
    /// What cannot be used.
    pub kind: RefusalKind,
    /// The text on stderr, without the leading `error: `.
    pub message: String,
}

/// What cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RefusalKind {
    /// The command line (exit code 2).
    Usage,
    /// A rig file or a record (exit code 1).
    Unusable,
}

impl Refusal {
    /// A refusal without a verdict.
    pub fn new(kind: RefusalKind, message: String) -> Self {
        Self { verdict: None, refused: Reason { kind, message } }
    }
}

impl RefusalKind {
    /// The exit code that goes with it.
    pub fn exit_code(self) -> i32 {
        match self {
            Self::Usage => 2,
            Self::Unusable => 1,
        }
    }
}

/// The result of an identification.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// The verdict.
    pub verdict: Verdict,
    /// Name of the axis that was identified; left out for a rig with one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<String>,
    /// Whether the time limit left anything out of which this could still change; the notes say
    /// what. Left out if not.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub early: bool,
    /// Effects in the order in which they were added.
    pub effects: Vec<FoundEffect>,
    /// Effects that the data cannot distinguish from the last effect added that had a rival.
    pub ambiguous_with: Vec<Named>,
    /// Whether a residual remains that no listed effect explains, or (except for transmissions)
    /// that a fourth one would. Not set with verdict `undecided`: whether one would is not known.
    pub remains: bool,
    /// Where that acts, and what it depends on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unlisted: Option<UnlistedTable>,
    /// What these records do not settle, where the verdict is `inadequate` for that reason alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unsettled: Option<Unsettled>,
    /// Result of the parametric bootstrap, if `--calibrate` was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
    /// Probabilities that the effects named are false alarms, in their order. Transmissions only.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub false_alarms: Vec<FalseAlarm>,
    /// Effects that are visible but not accepted, as too small or not significant, largest gain
    /// first. Always empty for transmissions.
    pub left: Vec<Left>,
    /// Errors on the reporting rows, per channel.
    pub error: BTreeMap<String, ChannelError>,
    /// Tests of the final model's residual on the same rows, per channel.
    pub residual_tests: BTreeMap<String, ResidualTests>,
    /// Declared parameters, as fitted beside the effects.
    pub parameters: Vec<FittedParameter>,
    /// Estimates, of effects too, whose errors are strongly correlated, the strongest first.
    pub correlations: Vec<EstimateCorrelation>,
    /// Those that ended at the bounds of their tolerances; left out if none did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_bounds: Option<AtBounds>,
    /// Roles of the records.
    pub records: Roles,
    /// What to measure next.
    pub next_experiment: NextExperiment,
    /// Error after each step, on the rows of each role and on all rows: to be compared with
    /// publications. Always empty for transmissions.
    pub steps: Vec<StepError>,
    /// Validation of all candidates, round by round.
    pub candidates: Vec<CandidateGain>,
    /// Notes on the data that a reader should know.
    pub notes: Vec<String>,
    /// Wall time (s).
    pub seconds: f64,
}

/// An effect by name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Named {
    /// Id.
    pub id: String,
    /// Site.
    pub site: String,
}

/// An effect that was added.
#[derive(Clone, Debug, Serialize)]
pub struct FoundEffect {
    /// Id.
    pub id: String,
    /// Site.
    pub site: String,
    /// Its parameters.
    pub parameters: Vec<EffectParameter>,
    /// Block t of its gain on the selection rows.
    pub t: f64,
    /// Decrease of the rms residual on the selection rows (%). For transmissions 1 - exp(-g), where
    /// g is the decrease of its logarithm summed over channels: the lesser of the means over blocks
    /// and over records.
    pub gain_percent: f64,
}

/// A parameter of an effect.
#[derive(Clone, Debug, Serialize)]
pub struct EffectParameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Standard deviation; `null` for shapes, which are searched and have none.
    pub std: Option<f64>,
    /// Unit.
    pub unit: String,
}

/// An effect, or a function of a variable, that takes a good part of the error on most blocks and
/// is not significant.
#[derive(Clone, Debug, Serialize)]
pub struct Unsettled {
    /// Id of the effect, or the variable.
    pub id: String,
    /// Fall of the root-mean-square residual on the selection rows (%).
    pub gain_percent: f64,
    /// Blocks on which it falls.
    pub blocks_better: usize,
    /// Blocks on which it was compared.
    pub blocks: usize,
}

/// Parametric bootstrap: searches of simulated machines with all effects found but the last (or
/// none).
#[derive(Clone, Debug, Serialize)]
pub struct Calibration {
    /// Number of replicates searched; those that cannot be simulated along the records are omitted.
    pub machines: usize,
    /// Replicates in which something absent was found, listed or not.
    pub alarms: usize,
    /// Largest gain of a falsely found effect in each replicate, as in
    /// [`FoundEffect::gain_percent`]; 0 if there was none (%).
    pub gains_percent: Vec<f64>,
    /// The last effect found, which the replicates do not have; `null` if none was found in the
    /// records.
    pub of: Option<Named>,
    /// Number of replicates with at least its gain.
    pub as_much: Option<usize>,
    /// Bootstrap p-value: `(1 + as_much) / (1 + machines)`.
    pub probability: Option<f64>,
    /// Whether the effect was not significant and was withdrawn.
    pub withdrawn: bool,
}

/// The residual as a function of one variable.
#[derive(Clone, Debug, Default, Serialize)]
pub struct UnlistedTable {
    /// For transmissions, where it acts. For other kinds, which do not tell, the first of the sites
    /// of their effects.
    pub site: String,
    /// The variable; [`UNKNOWN`] if neither a function of one variable nor a regression on recorded
    /// signals explains enough of it (transmissions only).
    pub depends_on: String,
    /// Abscissa, value, standard deviation (`null` where there are no data); empty without a
    /// function.
    pub table: Vec<[f64; 3]>,
    /// What the function looks like, in words that complete "it is ..."; left out where it looks
    /// like nothing simple. For transmissions, how it depends on the variable where no function of
    /// one variable explains enough, but a regression on recorded signals does, or an encoder
    /// jumps as no machine moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resembles: Option<String>,
    /// Share of the squared residual on the selecting records that such a regression explains;
    /// left out without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub regression_share: Option<f64>,
    /// Share of the residual power that no torque at a place explains, place by place. Left out
    /// beside a listed effect, if no movement is repeated or the slave is not measured, and for
    /// drives, oscillators and elements.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unexplained: Vec<Unexplained>,
}

/// Value of [`UnlistedTable::depends_on`] if nothing explains enough.
pub const UNKNOWN: &str = "unknown";

impl UnlistedTable {
    /// The variable, if it is known.
    pub fn variable(&self) -> Option<&str> {
        Some(self.depends_on.as_str()).filter(|variable| *variable != UNKNOWN)
    }
}

/// Unexplained share at one place.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unexplained {
    /// `master` (with the motor), `slave`, `line` or `torque cell`.
    pub place: String,
    /// Share of the residual power, 0 to 1.
    pub share: f64,
}

/// An effect that is visible on the selection rows but not accepted.
#[derive(Clone, Debug, Serialize)]
pub struct Left {
    /// Id of the effect, or the variable of a generic function.
    pub id: String,
    /// Site of the effect; `null` for a generic function.
    pub site: Option<String>,
    /// Root mean square of its contribution on the selection rows.
    pub size: f64,
    /// Unit of the size.
    pub unit: String,
    /// Fall of the root-mean-square residual on the selection rows (%).
    pub gain_percent: f64,
    /// Block t.
    pub t: f64,
    /// Parameters of the effect; none for a generic function.
    pub parameters: Vec<EffectParameter>,
}

/// Root-mean-square error of one channel on the reporting rows.
#[derive(Clone, Debug, Serialize)]
pub struct ChannelError {
    /// Of the declared model with the values of the rig file as they are, without effects that it
    /// declares; left out where that loses the record, and for drives, oscillators and elements.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub declared: Option<f64>,
    /// Of the declared model, fitted within its tolerances.
    pub before: f64,
    /// With the effects.
    pub after: f64,
    /// Noise floor; `null` without repeated records, and for drives, oscillators and elements.
    pub floor: Option<f64>,
    /// Unit of the three.
    pub unit: String,
    /// `before` in percent of the channel's root mean square.
    pub before_percent: f64,
    /// `after`, likewise.
    pub after_percent: f64,
}

/// A declared parameter.
#[derive(Clone, Debug, Serialize)]
pub struct FittedParameter {
    /// Name, as in the rig file.
    pub name: String,
    /// Declared value; `null` for parameters that are only estimated (smoothing of the sign).
    pub declared: Option<f64>,
    /// Fitted value.
    pub fitted: f64,
    /// Standard deviation; `null` if it is at the bound of its tolerance, is a shape or was not
    /// fitted.
    pub std: Option<f64>,
    /// Unit.
    pub unit: String,
    /// Whether the records identify it better than its declaration.
    pub identifiable: bool,
    /// Whether it is at the bound of its tolerance.
    pub at_tolerance: bool,
    /// Whether the records identify it.
    #[serde(rename = "sight")]
    pub identifiability: Identifiability,
    /// The single parameter with the same effect, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trades_with: Option<String>,
}

/// Declared parameters at the bounds of their tolerances: a missing effect that acts like a changed
/// parameter hides there.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AtBounds {
    /// Their names.
    pub parameters: Vec<String>,
    /// Per channel, the share of the error with declared values that the fit within all tolerances
    /// took, `100 (1 - before / declared)`; left out where the error with declared values is not
    /// known (%).
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub error_taken_percent: BTreeMap<String, f64>,
}

impl AtBounds {
    /// Collects them from an outcome's parameters and errors; `None` if there are none.
    pub fn of(
        parameters: &[FittedParameter],
        error: &BTreeMap<String, ChannelError>,
    ) -> Option<Self> {
        let names = parameters.iter().filter(|own| own.at_tolerance).map(|own| own.name.clone());
        let parameters: Vec<String> = names.collect();
        let taken = error.iter().filter_map(|(channel, error)| {
            let declared = error.declared.filter(|declared| *declared > 0.0)?;
            Some((channel.clone(), 100.0 * (1.0 - error.before / declared)))
        });
        (!parameters.is_empty()).then(|| Self { parameters, error_taken_percent: taken.collect() })
    }
}

/// Whether the records identify a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Identifiability {
    /// They identify it better than its declaration.
    #[serde(rename = "seen")]
    Identified,
    /// It is at the bound of its tolerance.
    AtBound,
    /// Others have the same effect on the records; transmissions only.
    TradeOff,
    /// It has too little effect on the records.
    #[serde(rename = "flat")]
    Weak,
    /// It has no effect on the records; transmissions only.
    #[serde(rename = "dead")]
    Absent,
}

impl FittedParameter {
    /// Its identifiability in words; empty if it is identified.
    pub fn remark(&self) -> String {
        match (self.identifiability, &self.trades_with) {
            (Identifiability::Identified, _) => String::new(),
            (Identifiability::AtBound, _) => "at the bound of its tolerance".to_owned(),
            (Identifiability::TradeOff, Some(other)) => format!("trades off with {other}"),
            (Identifiability::TradeOff, None) => "trades off with several others".to_owned(),
            (Identifiability::Weak, _) => {
                "not identifiable: too little effect on these records".to_owned()
            }
            (Identifiability::Absent, _) => {
                "not identifiable: no effect on these records".to_owned()
            }
        }
    }
}

/// Records by role; rows of one record as `file[from..to s]`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Roles {
    /// For fitting parameters.
    pub fit: Vec<String>,
    /// For selecting effects.
    pub select: Vec<String>,
    /// For reporting errors.
    pub report: Vec<String>,
}

/// What to measure next.
#[derive(Clone, Debug, Serialize)]
pub struct NextExperiment {
    /// The open question.
    pub why: String,
    /// The experiment that would settle it.
    pub what: String,
    /// Its protocol, if it was requested and the rig can play one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub protocol: Option<String>,
}

impl NextExperiment {
    /// An experiment without a protocol.
    pub(crate) fn new(why: impl Into<String>, what: impl Into<String>) -> Self {
        Self { why: why.into(), what: what.into(), protocol: None }
    }
}

/// Error after a step, in percent of the force's root mean square on the same rows; of an
/// oscillator, of its output's.
#[derive(Clone, Debug, Serialize)]
pub struct StepError {
    /// `declared`, then the id of each effect as it is added.
    pub model: String,
    /// On the rows of each role, parameters from the fitting rows.
    pub fit_percent: f64,
    /// See `fit_percent`.
    pub select_percent: f64,
    /// See `fit_percent`.
    pub report_percent: f64,
    /// With everything fitted to and evaluated on all rows, as in publications: not a held-out
    /// error.
    pub all_rows_percent: f64,
    /// Parameters of that fit to all rows: name, value, standard deviation.
    pub all_rows_parameters: Vec<(String, f64, f64)>,
}

/// Validation of one candidate in one round.
#[derive(Clone, Debug, Serialize)]
pub struct CandidateGain {
    /// Round, from 1.
    pub round: usize,
    /// Id of the effect, or the variable of a generic function. For transmissions followed by `@`
    /// and the site; for oscillators by ` (screened)` where it was not simulated.
    pub id: String,
    /// Whether it is a nonparametric function, not a listed effect.
    pub generic: bool,
    /// As [`FoundEffect::gain_percent`]; of an oscillator's candidate that was only screened, of
    /// the residual of its input.
    pub gain_percent: f64,
    /// Block t.
    pub t: f64,
    /// Number of selecting blocks that improve by more than 1 %. For transmissions, number of
    /// records that improve by more than 0.01 and by more than a tenth of the largest gain (of the
    /// mean gain beside other effects), in logarithms, summed over channels.
    pub blocks_better: usize,
    /// Number of those that deteriorate by as much.
    pub blocks_worse: usize,
    /// Whether it passes.
    pub accepted: bool,
}

#[cfg(test)]
mod tests {
    use super::Verdict;

    #[test]
    fn the_verdict_follows_from_effects_then_from_what_remains() {
        assert_eq!(Verdict::of(0, 0, false), Verdict::None);
        assert_eq!(Verdict::of(0, 0, true), Verdict::Unlisted);
        for remains in [false, true] {
            assert_eq!(Verdict::of(2, 0, remains), Verdict::Effect);
            assert_eq!(Verdict::of(1, 2, remains), Verdict::Ambiguous);
        }
    }
}
