//! One file per kind of model, and one line in [`ALL`].

mod drive;
mod element;
mod inverse_left;
mod inverse_outcome;
mod inverse_study;
mod next_experiment;
mod oscillator;
mod oscillator_outcome;
mod oscillator_search;

use crate::error::Result;
use crate::input::Series;
use crate::outcome::Outcome;
use report::Page;
use rig::{Model as Declared, ModelKind};

/// Kinds of models that can be held against data.
pub static ALL: &[&dyn Model] = &[&drive::Drive, &oscillator::Oscillator, &element::Element];

/// What the command line asks for.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Candidates fitted at a time.
    pub jobs: usize,
    /// Seed of the split.
    pub seed: u64,
}

/// A kind of model: pure, from the declared model and columns of data to the verdict and its page.
pub trait Model: Sync {
    /// Which kind.
    fn kind(&self) -> ModelKind;
    /// Holds the declared model of `rig_file` (its name, for messages) against records.
    ///
    /// # Errors
    /// Where the declaration or the data cannot be used.
    fn identify(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options,
    ) -> Result<(Outcome, Page)>;
}
