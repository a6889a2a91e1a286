//! The trend of all declared parameters, in the form of `--json`.

use std::collections::BTreeMap;

use serde::Serialize;

use super::folder::LeftOut;
use super::quantity::Movement;
use crate::outcome::ChannelError;

/// Probability that a machine which does not change is said to have changed, over all parameters.
pub const FALSE_ALARM: f64 = 0.01;
/// Days of a month (a twelfth of a year).
pub const DAYS_PER_MONTH: f64 = 365.25 / 12.0;
/// Whether the machine is still that of the rig file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All parameters are within their tolerances, and none has changed.
    Same,
    /// Parameters have changed, and all are within their tolerances.
    Changed,
    /// Parameters are at the bounds of their tolerances, and may be beyond: they moved there, or
    /// the values of the rig file describe the recordings worse than others.
    Outside,
    /// The recordings tell no parameter.
    Unknown,
}

/// A value with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// Standard deviation.
    pub std: f64,
}

/// How today's value of a parameter compares with the declared one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// They agree within two standard deviations of a single recording.
    Agrees,
    /// They differ by more, within the tolerance.
    WithinTolerance,
    /// Most recordings since the last change have it at the bound of its tolerance.
    AtBound,
    /// They have it there, but it did not move, and the values of the rig file have described
    /// recordings about as well as fitted ones: they hardly tell it.
    Indifferent,
    /// No recording tells it.
    Unknown,
}

/// A change from one recording to the next.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Change {
    /// The last recording before it.
    pub after: String,
    /// The first recording with it.
    pub since: String,
    /// Dates of the two (UTC); left out where recordings have none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub between: Option<[String; 2]>,
    /// Mean before.
    pub from: Estimate,
    /// Mean after.
    pub to: Estimate,
    /// Number of recordings that tell it before the change, all since the change before.
    pub recordings_before: usize,
    /// The same after it, until the next change.
    pub recordings_after: usize,
}

/// One recording's estimate of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Told {
    /// Index of the recording in [`Trend::recordings`].
    pub recording: usize,
    /// Estimate.
    pub value: f64,
    /// Its standard deviation; at the bound of the tolerance, the typical one of the others.
    pub std: f64,
    /// Whether it is at the bound of its tolerance.
    pub at_bound: bool,
}

/// The trend of one parameter.
#[derive(Clone, Debug, Serialize)]
pub struct ParameterTrend {
    /// Name, as in the rig file.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Declared value.
    pub declared: f64,
    /// Half-width of its tolerance.
    pub tolerance: f64,
    /// How it moved.
    pub movement: Movement,
    /// Weighted mean over all recordings; `null` if none tells it.
    pub mean: Option<Estimate>,
    /// How far the recordings scatter about the mean, in their standard deviations.
    pub overdispersion: Option<f64>,
    /// Weighted linear drift over all recordings, per month, or per recording where they have no
    /// dates.
    pub drift: Option<Estimate>,
    /// Steps, in their order.
    pub changes: Vec<Change>,
    /// Value at the last recording.
    pub today: Option<Estimate>,
    /// Typical standard deviation of a single recording.
    pub typical_std: Option<f64>,
    /// Today's value against the declared one.
    pub standing: Standing,
    /// What each recording tells; those that do not identify it are left out.
    pub told: Vec<Told>,
}

/// A recording that took part.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingEntry {
    /// File.
    pub file: String,
    /// When it began (UTC); left out where it does not say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub began: Option<String>,
    /// Days since the first recording, or the number of the recording from 0 where they have no
    /// dates.
    pub time: f64,
    /// Errors on the reporting rows, per channel.
    pub error: BTreeMap<String, ChannelError>,
    /// Effects that the model lacks, as `ID@SITE`; left out without `--effects`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub effects: Option<Vec<String>>,
    /// What the search for effects says; left out without `--effects`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sentence: Option<String>,
    /// Wall time (s).
    pub seconds: f64,
}

/// The trend over a folder of recordings.
#[derive(Clone, Debug, Serialize)]
pub struct Trend {
    /// The verdict.
    pub verdict: Verdict,
    /// The verdict as a sentence.
    pub sentence: String,
    /// Sentences on what changed.
    pub details: Vec<String>,
    /// Whether recordings have dates.
    pub dated: bool,
    /// Probability that a machine which does not change is said to have changed.
    pub false_alarm_probability: f64,
    /// Error with the values of the rig file over that with fitted ones: geometric mean over the
    /// channels, median over the recordings since the last change; `null` where it is not known.
    pub error_ratio: Option<f64>,
    /// Number of recordings since the last change of any parameter.
    pub since_last_change: usize,
    /// The declared parameters, in their order.
    pub parameters: Vec<ParameterTrend>,
    /// The recordings, in the order in which they were made.
    pub recordings: Vec<RecordingEntry>,
    /// Those that take no part.
    pub left_out: Vec<LeftOut>,
    /// Wall time (s).
    pub seconds: f64,
}

impl Trend {
    /// The parameters that at least one recording tells.
    pub fn told(&self) -> impl Iterator<Item = &ParameterTrend> {
        self.parameters.iter().filter(|own| !own.told.is_empty())
    }

    /// The word for the unit of a drift.
    pub fn per(&self) -> &'static str {
        if self.dated { "month" } else { "recording" }
    }
}

impl ParameterTrend {
    /// Whether it moved beyond chance.
    pub fn has_changed(&self) -> bool {
        matches!(self.movement, Movement::Steps | Movement::Drift)
    }
}
