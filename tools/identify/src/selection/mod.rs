//! Stepwise selection of the effects of models with one measured channel.

pub mod adequacy;
pub mod candidates;
pub mod forward_selection;
pub mod nonparametric;
pub mod predictor;
pub mod search;
mod tones;
pub mod validation;
