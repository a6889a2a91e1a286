//! Parts of a simulated machine, and plans of its records.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::effects::Effect;
use crate::machine_parameters::MachineParameters;
use crate::random::Draw;
use crate::record::{SAMPLE_S, SAMPLES};
use crate::reference::{Kind, hand, reference};
use crate::simulator::{Simulator, TooManyStates};
use crate::smoothing::Smoothing;

/// Name of the smoothing speed of friction, beside those of the machine's parameters.
pub const SMOOTHING: &str = "smoothing";

/// The plan of a record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// File name.
    pub file: String,
    /// The reference of the master.
    pub kind: Kind,
    /// Seed of the reference: the same for repeats.
    pub reference_seed: u64,
    /// Seed of the torque of the hand, if a hand drives the slave.
    pub hand_seed: Option<u64>,
    /// Time of the first row, s.
    pub start_s: f64,
    /// Size of the movement, of the usual one.
    #[serde(default = "whole")]
    pub scale: f64,
}

fn whole() -> f64 {
    1.0
}

/// The parts of a simulated machine.
#[derive(Clone, Debug)]
pub struct Builder {
    /// Its parameters, without the effects.
    pub machine: MachineParameters,
    /// How dry friction passes through zero.
    pub smoothing: Smoothing,
    /// Its effects.
    pub effects: Vec<Effect>,
}

impl Builder {
    /// Builds the simulator, optionally with one parameter changed by a fraction of itself.
    ///
    /// # Errors
    /// [`CaseError::Unbuildable`], [`CaseError::TooManyStates`].
    pub fn model(&self, change: Option<(&str, f64)>) -> Result<Simulator, CaseError> {
        let (mut machine, mut smoothing) = (self.machine.clone(), self.smoothing);
        if let Some((name, fraction)) = change {
            let place = if name == SMOOTHING {
                Some(&mut smoothing.speed_rad_s)
            } else {
                machine.named_mut(name)
            };
            if let Some(value) = place {
                *value *= 1.0 + fraction;
            }
        }
        let deviations = self
            .effects
            .iter()
            .map(|effect| effect.build().ok_or_else(|| CaseError::Unbuildable(effect.name())))
            .collect::<Result<_, _>>()?;
        Ok(Simulator::new(machine, smoothing, deviations, SAMPLE_S)?)
    }

    /// The same without one of its effects.
    #[must_use]
    pub fn without(&self, index: usize) -> Self {
        let mut other = self.clone();
        other.effects.remove(index);
        other
    }
}

/// Why a case cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// No such effect.
    #[error(
        "no effect `{0}`: expected ID or ID@SITE of the catalogue or of those on no list (see \
         --list)"
    )]
    Unknown(String),
    /// An effect with missing parameters.
    #[error("effect `{0}` cannot be built from its numbers")]
    Unbuildable(String),
    /// Effects with too many states for one model.
    #[error(transparent)]
    TooManyStates(#[from] TooManyStates),
    /// A file could not be written.
    #[error("{path}: {source}")]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// Reference of a planned record, and torque of its hand.
pub fn signals(plan: &Plan) -> (Vec<f64>, Vec<f64>) {
    let mut wanted = reference(plan.kind, &mut Draw::new(plan.reference_seed), SAMPLES, SAMPLE_S);
    wanted.iter_mut().for_each(|position| *position *= plan.scale);
    let torque =
        plan.hand_seed.map_or_else(Vec::new, |seed| hand(&mut Draw::new(seed), SAMPLES, SAMPLE_S));
    (wanted, torque)
}
