//! The kinds of declared models, and what is reported of each: searches, outcomes, pages.

mod bootstrap;
mod candidate_movements;
mod declared_fit;
mod drive;
mod effect_descriptions;
mod element;
mod experiment_design;
mod false_alarms;
mod force_balance;
mod machine_picture;
mod next_experiment;
mod oscillator;
mod page;
mod resemblance;
mod residual_plots;
mod rival_model;
mod role_assignment;
mod segmentation;
mod sentences;
mod simulated_experiment;
mod single_channel_outcome;
mod single_channel_page;
mod single_channel_parameters;
mod single_channel_result;
mod single_channel_study;
mod transmission;
mod transmission_declared_fit;
mod transmission_outcome;
mod transmission_page;
mod transmission_residual_tests;
mod transmission_study;
mod unaccepted_effects;

pub use candidate_movements::RigCapability;
pub use declared_fit::DeclaredFit;
pub use machine_picture::machine_picture;
pub(crate) use sentences::sentences;

use crate::deadline::Deadline;
use crate::error::Result;
use crate::input::Series;
use crate::outcome::Outcome;
use crate::prediction_error::other_axes::OtherAxis;
use report::Page;
use rig::{Model as Declared, ModelKind};

/// The model of a kind.
pub fn of_kind(kind: ModelKind) -> &'static dyn Model {
    match kind {
        ModelKind::Transmission(_) => &transmission::Transmission,
        ModelKind::Drive => &drive::DRIVE,
        ModelKind::Oscillator => &oscillator::Oscillator,
        ModelKind::Element => &element::ELEMENT,
    }
}

/// Options from the command line.
#[derive(Clone, Copy, Debug)]
pub struct Options<'a> {
    /// Seed of the split, and of simulated machines.
    pub seed: u64,
    /// Turns of the model's master per turn of the measured handle.
    pub gear: f64,
    /// Largest error of the slave encoder's zero against the master's (rad of the slave), where
    /// there is such an encoder.
    pub slave_zero_rad: Option<f64>,
    /// Name of the axis, where the rig has several.
    pub axis: Option<&'a str>,
    /// The other axes at the same handle.
    pub others: &'a [OtherAxis],
    /// The movements that the rig can play, where it can be simulated.
    pub capability: Option<RigCapability>,
    /// Whether the next experiment is designed by simulation.
    pub propose: bool,
    /// Replicates of the parametric bootstrap.
    pub calibrate: usize,
    /// When the best answer so far is given.
    pub deadline: &'a Deadline,
}

/// A kind of model: pure, from the declared model and columns of data to the verdict and its page.
pub trait Model: Sync {
    /// The columns of its records, time first.
    fn columns(&self) -> &'static [&'static str];
    /// Whether its search finds where an effect acts.
    fn is_located(&self) -> bool {
        false
    }
    /// Identifies the declared model of `rig_file` (its name, for messages) from records.
    ///
    /// # Errors
    /// If the declaration or the data cannot be used.
    fn identify(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options<'_>,
    ) -> Result<(Outcome, Page)>;

    /// Fits the declared model within its tolerances, without a search for what it lacks. What
    /// would select effects takes part in the fit.
    ///
    /// # Errors
    /// As [`Self::identify`].
    fn fit_declared(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options<'_>,
    ) -> Result<DeclaredFit>;
}
