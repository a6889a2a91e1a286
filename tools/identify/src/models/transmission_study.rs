//! A transmission with its search result, from which verdict, page and next experiment follow.

use crate::deadline::Deadline;
use crate::false_alarm::FalseAlarm;
use crate::outcome::Calibration;
use crate::prediction_error::search_result::SearchResult;
use crate::prediction_error::transmission_model::TransmissionModel;

/// A transmission's model, records and search result.
pub(super) struct Study<'a> {
    /// Declared model and records.
    pub(super) model: TransmissionModel,
    /// What the search found.
    pub(super) found: SearchResult,
    /// Notes on the data.
    pub(super) notes: Vec<String>,
    /// Result of the parametric bootstrap, if requested.
    pub(super) calibration: Option<Calibration>,
    /// Probabilities that its names are false alarms.
    pub(super) false_alarms: Vec<FalseAlarm>,
    /// Name of the axis, where the rig has several.
    pub(super) axis: Option<String>,
    /// When nothing more is begun.
    pub(super) deadline: &'a Deadline,
}
