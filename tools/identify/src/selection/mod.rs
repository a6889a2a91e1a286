//! Stepwise selection of the effects of models with one measured channel.

pub mod candidates;
pub mod predictor;
pub mod search;
pub mod validation;
