//! What is known of a transmission once it has been searched: what its verdict, page and next
//! experiment are made of.

use crate::outcome::Calibration;
use crate::prediction_error::search::SearchResult;
use crate::prediction_error::transmission_model::TransmissionModel;

/// A transmission's records, and what they turned out to say.
pub(super) struct Study {
    /// Declared model and records.
    pub(super) model: TransmissionModel,
    /// What the search found.
    pub(super) found: SearchResult,
    /// What a reader should know of the data.
    pub(super) notes: Vec<String>,
    /// What chance gives, where that was asked for.
    pub(super) calibration: Option<Calibration>,
}
