//! Iterative learning of a periodic movement (§ 4.3): the master's position reference is made
//! better from block to block, until the slave goes where it should. An ordinary law (that of the
//! control process) moves the master along the reference.
//!
//! A movement repeats with a fixed period of N control steps. A *block* is a few cycles with one
//! reference: the first ones let the change of reference die away, the mean of the others is what
//! is learnt from. Two learning laws:
//!
//! - [`Published`], eq. 4.3.2 and 4.3.3: the error (slave reference less slave), low-passed without
//!   shift of phase and taken earlier by the delay of the transmission, times small gains, is added
//!   to the reference;
//! - [`ModelBased`]: each harmonic of the error goes through the regularised inverse of the
//!   identified response; where the response is not known nothing is changed.
//!
//! **When learning stops.** A block whose error is more than [`Stop::growth`] times the best
//! block's is a worse one; after [`Stop::patience`] worse ones in a row, or as soon as a new
//! reference would leave the limits of position or speed, the best reference is taken back and kept
//! ([`Frozen`] says why). A block in which a step of the cycle was never measured is not learnt
//! from; what is not a number never enters the reference.
//!
//! Convergence (eq. 4.3.12, with `docs/errata.md`): on a plant of gain g and the given delay, the
//! error of a harmonic is multiplied by `1 - (γ_p + γ_d) g w` from block to block, w being the low
//! pass; it falls where that is below 1 in magnitude.
//!
//! Pure: no clock, no files but [`store`]'s. [`Learner::record`] and [`Learner::aim`], once a
//! control step, allocate nothing; [`Learner::finish_block`] is for between the blocks.

mod block;
mod memory;
mod model_based;
mod published;
pub mod spectral;
pub mod store;

pub use block::BlockError;
pub use memory::Memory;
pub use model_based::{ModelBased, Response};
pub use published::Published;
pub use realfft::num_complex::Complex;

use block::Block;
use published::PublishedRule;
use serde::{Deserialize, Serialize};
use spectral::Spectral;
use thiserror::Error;

/// Fewest steps in a cycle.
const FEWEST_STEPS: usize = 8;

/// A learning law with its settings.
#[derive(Clone, Debug, PartialEq)]
pub enum LearningLaw {
    /// That of the thesis.
    Published(Published),
    /// Through the inverse of the response.
    ModelBased(ModelBased),
}

/// When learning stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// A block is worse when its error (mean magnitude, settled cycles) is more than this times the
    /// best block's (1), above 1.
    pub growth: f64,
    /// So many worse blocks in a row end the learning, 1 or more.
    pub patience: usize,
}

/// What a learner is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnerConfig {
    /// Control steps per second (Hz).
    pub rate_hz: f64,
    /// Cycles in a block.
    pub cycles_per_block: usize,
    /// How many of them, at the beginning, are not learnt from.
    pub settling_cycles: usize,
    /// The learning law.
    pub law: LearningLaw,
    /// When it stops.
    pub stop: Stop,
    /// The reference stays within these: lowest and highest position (rad or m).
    pub position_limits: (f64, f64),
    /// Highest speed of the reference (rad/s or m/s).
    pub speed_limit: f64,
}

/// Why there is no learner.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum LearningError {
    /// The desired movement is no cycle.
    #[error(
        "desired cycle: expected {FEWEST_STEPS} or more finite positions within the limits, found \
            {found}"
    )]
    Desired {
        /// What was found.
        found: String,
    },
    /// A setting is out of range.
    #[error("{name}: expected {expected}, found {found}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// What is right.
        expected: &'static str,
        /// What was found.
        found: f64,
    },
}

/// Why learning ended.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Frozen {
    /// The error grew.
    Grew {
        /// Error of the best block (rad or m).
        best: f64,
        /// Error of the last (rad or m).
        found: f64,
    },
    /// The next reference would have left the limits of position or speed.
    Limit {
        /// Its furthest position (rad or m).
        position: f64,
        /// Its highest speed (rad/s or m/s).
        speed: f64,
    },
    /// [`Learner::freeze`] was called.
    Asked,
}

/// What a block came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// The next block has a better reference, it is hoped.
    Learnt,
    /// Nothing was learnt: so many steps of the cycle were never measured.
    Missing(usize),
    /// The reference stays as it is.
    Frozen(Frozen),
}

/// One block, done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockReport {
    /// Its number, from 1.
    pub block: usize,
    /// Error over the whole block; `None` where nothing was measured.
    pub error: Option<BlockError>,
    /// Error over its settled cycles.
    pub settled: Option<BlockError>,
    /// Measured values that were not finite.
    pub not_finite: usize,
    /// What follows from it.
    pub step: Step,
}

/// A point of the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReferencePoint {
    /// Position (rad or m).
    pub position: f64,
    /// Velocity (rad/s or m/s).
    pub velocity: f64,
    /// Acceleration (rad/s² or m/s²).
    pub acceleration: f64,
}

#[derive(Clone, Debug)]
enum Rule {
    Published(PublishedRule),
    ModelBased(ModelBased),
}

#[derive(Clone, Debug)]
struct Best {
    error: f64,
    reference: Vec<f64>,
}

/// Learns the master's reference for one axis and one periodic movement.
#[derive(Debug)]
pub struct Learner {
    config: LearnerConfig,
    spectral: Spectral,
    rule: Rule,
    desired: Vec<f64>,
    reference: Vec<f64>,
    points: Vec<ReferencePoint>,
    peak_speed: f64,
    block: Block,
    blocks: usize,
    best: Option<Best>,
    worse: usize,
    frozen: Option<Frozen>,
}

impl Learner {
    /// A learner of `desired`, the slave's positions over one cycle (rad or m), one per control
    /// step. The first reference is the desired movement itself.
    ///
    /// # Errors
    /// [`LearningError`].
    pub fn new(desired: &[f64], config: LearnerConfig) -> Result<Self, LearningError> {
        Self::from_reference(desired, desired, config)
    }

    /// The same, going on from a reference that was learnt before (rad or m).
    ///
    /// # Errors
    /// [`LearningError`].
    pub fn from_reference(
        desired: &[f64],
        reference: &[f64],
        config: LearnerConfig,
    ) -> Result<Self, LearningError> {
        config.check()?;
        let (low, high) = config.position_limits;
        if desired.len() < FEWEST_STEPS {
            return Err(LearningError::Desired { found: format!("{} positions", desired.len()) });
        }
        if reference.len() != desired.len() {
            let found =
                format!("{} positions for a reference of {}", desired.len(), reference.len());
            return Err(LearningError::Desired { found });
        }
        let outside = |position: &&f64| !(low..=high).contains(*position);
        if let Some(outside) = desired.iter().chain(reference).find(outside) {
            return Err(LearningError::Desired {
                found: format!("{outside}, limits {low} to {high}"),
            });
        }
        let rule = match &config.law {
            LearningLaw::Published(law) => {
                Rule::Published(PublishedRule::new(*law, config.rate_hz))
            }
            LearningLaw::ModelBased(law) => Rule::ModelBased(law.clone()),
        };
        let mut learner = Self {
            spectral: Spectral::new(desired.len(), config.rate_hz),
            rule,
            desired: desired.to_vec(),
            reference: reference.to_vec(),
            points: vec![ReferencePoint::default(); desired.len()],
            peak_speed: 0.0,
            block: Block::new(desired.len()),
            blocks: 0,
            best: None,
            worse: 0,
            frozen: None,
            config,
        };
        learner.publish();
        if learner.peak_speed > learner.config.speed_limit {
            let found =
                format!("a speed of {}, limit {}", learner.peak_speed, learner.config.speed_limit);
            return Err(LearningError::Desired { found });
        }
        Ok(learner)
    }

    /// Control steps in a cycle.
    pub fn steps_per_cycle(&self) -> usize {
        self.desired.len()
    }

    /// Control steps in a block.
    pub fn steps_per_block(&self) -> usize {
        self.desired.len() * self.config.cycles_per_block
    }

    /// Where the slave should be at a step of the cycle (rad or m).
    pub fn desired(&self, step: usize) -> f64 {
        self.desired[step % self.desired.len()]
    }

    /// Where the master is to be at a step of the cycle.
    pub fn aim(&self, step: usize) -> ReferencePoint {
        self.points[step % self.points.len()]
    }

    /// Highest speed of the reference (rad/s or m/s).
    pub fn peak_speed(&self) -> f64 {
        self.peak_speed
    }

    /// The reference that is in use, one position per step (rad or m).
    pub fn reference(&self) -> &[f64] {
        &self.reference
    }

    /// The best reference so far, one position per step (rad or m): that of the block with the
    /// least error. The one in use, where no block was measured.
    pub fn best_reference(&self) -> &[f64] {
        self.best.as_ref().map_or(&self.reference, |best| &best.reference)
    }

    /// Error of the best block: mean magnitude over its settled cycles (rad or m); `None` where
    /// none was measured.
    pub fn best_error(&self) -> Option<f64> {
        self.best.as_ref().map(|best| best.error)
    }

    /// Blocks that are done.
    pub fn blocks(&self) -> usize {
        self.blocks
    }

    /// The settings.
    pub fn config(&self) -> &LearnerConfig {
        &self.config
    }

    /// Where the master is to be, step by step through the cycle.
    pub fn points(&self) -> &[ReferencePoint] {
        &self.points
    }

    /// Why learning ended; `None` while it goes on.
    pub fn frozen(&self) -> Option<Frozen> {
        self.frozen
    }

    /// Takes in where the slave was (rad or m) at the `step`-th control step of this block, from 0.
    /// Steps may be left out. Allocates nothing.
    pub fn record(&mut self, step: usize, slave: f64) {
        let in_cycle = step % self.desired.len();
        let settled = step / self.desired.len() >= self.config.settling_cycles;
        self.block.record(in_cycle, slave, self.desired[in_cycle], settled);
    }

    /// Ends the block: learns from it, and makes the reference of the next. To be called between
    /// two control steps that the loop can spare; it takes some transforms of a cycle.
    pub fn finish_block(&mut self) -> BlockReport {
        self.blocks += 1;
        let errors = self.block.errors();
        let report = |learner: &Self, step| BlockReport {
            block: learner.blocks,
            error: errors.map(|errors| errors.0),
            settled: errors.map(|errors| errors.1),
            not_finite: learner.block.not_finite(),
            step,
        };
        let step = self.step(errors.map(|errors| errors.1));
        let report = report(self, step);
        self.block.clear();
        report
    }

    /// Ends the learning at the best reference so far.
    pub fn freeze(&mut self) {
        if self.frozen.is_none() {
            self.end(Frozen::Asked);
        }
    }

    fn step(&mut self, settled: Option<BlockError>) -> Step {
        if let Some(frozen) = self.frozen {
            return Step::Frozen(frozen);
        }
        let missing = self.block.missing();
        let Some(settled) = settled.filter(|_| missing == 0) else {
            if let Rule::Published(rule) = &mut self.rule {
                rule.forget();
            }
            return Step::Missing(missing);
        };
        let best = self.best.as_ref().map_or(f64::INFINITY, |best| best.error);
        if settled.mean_abs < best {
            self.best = Some(Best { error: settled.mean_abs, reference: self.reference.clone() });
        }
        self.worse =
            if settled.mean_abs > self.config.stop.growth * best { self.worse + 1 } else { 0 };
        if self.worse >= self.config.stop.patience {
            return self.end(Frozen::Grew { best, found: settled.mean_abs });
        }
        let mut error = vec![0.0; self.desired.len()];
        self.block.path(&mut error);
        for (value, desired) in error.iter_mut().zip(&self.desired) {
            *value = desired - *value;
        }
        let mut next = self.reference.clone();
        match &mut self.rule {
            Rule::Published(rule) => rule.learn(&mut self.spectral, error, &mut next),
            Rule::ModelBased(law) => law.learn(&mut self.spectral, error, &mut next),
        }
        self.take(next)
    }

    /// Makes a reference the next one, if it is within the limits.
    fn take(&mut self, next: Vec<f64>) -> Step {
        let before = std::mem::replace(&mut self.reference, next);
        self.publish();
        let (low, high) = self.config.position_limits;
        let furthest = self.reference.iter().fold(0.0f64, |far, position| {
            // A value that is not a number is beyond all limits.
            if position.abs() <= far { far } else { position.abs() }
        });
        let within = self.reference.iter().all(|position| (low..=high).contains(position));
        if within && self.peak_speed <= self.config.speed_limit {
            return Step::Learnt;
        }
        let speed = self.peak_speed;
        self.reference = before;
        self.end(Frozen::Limit { position: furthest, speed })
    }

    fn end(&mut self, why: Frozen) -> Step {
        if let Some(best) = &self.best {
            self.reference.clone_from(&best.reference);
        }
        self.publish();
        self.frozen = Some(why);
        Step::Frozen(why)
    }

    /// Velocity and acceleration of the reference, for the control steps to come.
    fn publish(&mut self) {
        let mut velocity = self.reference.clone();
        self.spectral.differentiate(&mut velocity);
        let mut acceleration = velocity.clone();
        self.spectral.differentiate(&mut acceleration);
        self.peak_speed = 0.0;
        for (n, point) in self.points.iter_mut().enumerate() {
            *point = ReferencePoint {
                position: self.reference[n],
                velocity: velocity[n],
                acceleration: acceleration[n],
            };
            let speed = velocity[n].abs();
            if speed > self.peak_speed || speed.is_nan() {
                self.peak_speed = speed;
            }
        }
    }
}

impl LearnerConfig {
    fn check(&self) -> Result<(), LearningError> {
        let positive = |name, found: f64| {
            if found.is_finite() && found > 0.0 {
                Ok(())
            } else {
                Err(LearningError::Setting { name, expected: "a positive number", found })
            }
        };
        positive("rate_hz", self.rate_hz)?;
        positive("speed_limit", self.speed_limit)?;
        if self.cycles_per_block <= self.settling_cycles {
            let found = self.cycles_per_block as f64;
            let expected = "more than settling_cycles";
            return Err(LearningError::Setting { name: "cycles_per_block", expected, found });
        }
        if !(self.stop.growth.is_finite() && self.stop.growth > 1.0) {
            let found = self.stop.growth;
            return Err(LearningError::Setting {
                name: "stop.growth",
                expected: "a number above 1",
                found,
            });
        }
        if self.stop.patience == 0 {
            return Err(LearningError::Setting {
                name: "stop.patience",
                expected: "1 or more",
                found: 0.0,
            });
        }
        match &self.law {
            LearningLaw::Published(law) => {
                positive("cutoff_hz", law.cutoff_hz)?;
                for (name, found) in
                    [("gamma_p", law.gamma_p), ("gamma_d", law.gamma_d), ("delay_s", law.delay_s)]
                {
                    if !(found.is_finite() && found >= 0.0) {
                        return Err(LearningError::Setting { name, expected: "0 or more", found });
                    }
                }
            }
            LearningLaw::ModelBased(law) => {
                positive("gain", law.gain)?;
                positive("regularisation", law.regularisation)?;
                if law.response.known() == 0 {
                    let expected = "a response that is known somewhere";
                    return Err(LearningError::Setting { name: "response", expected, found: 0.0 });
                }
            }
        }
        Ok(())
    }
}
