//! The declared model fitted alone, without a search for what it lacks.

use std::collections::BTreeMap;

use crate::outcome::{ChannelError, FittedParameter};

/// Declared parameters as fitted within their tolerances, and the error before and after.
#[derive(Clone, Debug)]
pub struct DeclaredFit {
    /// The parameters.
    pub parameters: Vec<FittedParameter>,
    /// Errors on the reporting rows, per channel: with declared and with fitted values.
    pub error: BTreeMap<String, ChannelError>,
    /// Notes on the data.
    pub notes: Vec<String>,
}
