//! Iterative learning control of a periodic movement (§ 4.3). Updates the master's position
//! reference after each block so that the slave follows the desired movement; the control process
//! moves the master along the reference.
//!
//! The movement has a period of N control steps. A *block* is a few cycles with the same reference:
//! during the settling cycles the transient after the update decays, the others are averaged. Two
//! learning laws:
//!
//! - [`Published`], eq. 4.3.2 and 4.3.3: adds the error (desired minus measured slave position) to
//!   the reference, after a zero-phase low pass, an advance by the transmission's delay, and small
//!   gains;
//! - [`ModelBased`]: filters each harmonic of the error by the regularised inverse of the
//!   identified frequency response; harmonics without an identified response are not changed.
//!
//! **When learning stops.** A block counts as worse when its error exceeds the best block's by the
//! factor [`Stop::growth`]. After [`Stop::patience`] consecutive worse blocks, or when the next
//! reference would exceed the limits of position or speed, the learner freezes at the best
//! reference ([`Frozen`] gives the reason). The reference is not updated after a block without a
//! measurement for every step of the cycle; values that are not finite are ignored.
//!
//! Convergence (eq. 4.3.12, with `docs/errata.md`): on a plant with gain g and the given delay, the
//! error of a harmonic is multiplied by `1 - (γ_p + γ_d) g w` in each block, where w is the low
//! pass; it decreases if that factor is below 1 in magnitude.
//!
//! Pure: no clock, and no files except in [`store`]. [`Learner::record`] and [`Learner::aim`],
//! which run in every control step, do not allocate; [`Learner::finish_block`] does.

mod cycle_block;
mod model_based;
mod published_law;
pub mod spectral;
mod state;
pub mod store;

pub use model_based::{ModelBased, Response};
pub use published_law::Published;
pub use realfft::num_complex::Complex;
pub use state::LearnerState;

use cycle_block::Block;
use rig::protocol::trajectory::Point;
use serde::{Deserialize, Serialize};
use spectral::Spectral;
use thiserror::Error;

/// Fewest steps in a cycle.
const FEWEST_STEPS: usize = 8;

/// A learning law with its settings.
#[derive(Clone, Debug, PartialEq)]
pub enum LearningLaw {
    /// The thesis's law.
    Published(Published),
    /// The inverse of the identified frequency response.
    ModelBased(ModelBased),
}

/// When learning stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// A block is worse when its mean absolute error exceeds the best block's by this factor, above
    /// 1 (1).
    pub growth: f64,
    /// Number of consecutive worse blocks that ends the learning, 1 or more.
    pub patience: usize,
}

/// Configuration of a learner.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnerConfig {
    /// Control steps per second (Hz).
    pub rate_hz: f64,
    /// Cycles in a block.
    pub cycles_per_block: usize,
    /// Cycles at the beginning of a block that are not averaged.
    pub settling_cycles: usize,
    /// The learning law.
    pub law: LearningLaw,
    /// When learning stops.
    pub stop: Stop,
    /// Lowest and highest position of the reference (rad or m).
    pub position_limits: (f64, f64),
    /// Highest speed of the reference (rad/s or m/s).
    pub speed_limit: f64,
}

/// Why a learner cannot be created.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum LearningError {
    /// The desired movement is not a valid cycle.
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
        /// The valid range.
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
    Requested,
}

/// The result of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BlockOutcome {
    /// The reference was updated.
    Learnt,
    /// The reference was not updated: this many steps of the cycle have no measurement.
    Missing(usize),
    /// Learning has ended; the reference no longer changes.
    Frozen(Frozen),
}

/// Report of a finished block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockReport {
    /// Its number, from 1.
    pub block: usize,
    /// Mean absolute error of the slave's position over the whole block (rad or m), as in
    /// fig. 4.6B; `None` without a measurement.
    pub error: Option<f64>,
    /// The same over its settled cycles.
    pub settled: Option<f64>,
    /// Measured values that were not finite.
    pub not_finite: usize,
    /// What was done with the reference.
    pub outcome: BlockOutcome,
}

/// Learns the master's reference for one axis and one periodic movement.
#[derive(Debug)]
pub struct Learner {
    config: LearnerConfig,
    spectral: Spectral,
    desired: Vec<f64>,
    points: Vec<Point>,
    block: Block,
    state: LearnerState,
}

impl Learner {
    /// Creates a learner for `desired`, the slave's positions over one cycle (rad or m), one per
    /// control step. The first reference is the desired movement itself.
    ///
    /// # Errors
    /// [`LearningError`].
    pub fn new(desired: &[f64], config: LearnerConfig) -> Result<Self, LearningError> {
        Self::from_reference(desired, desired, config)
    }

    /// Creates a learner that starts from a learnt reference (rad or m).
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
        let mut learner = Self {
            spectral: Spectral::new(desired.len(), config.rate_hz),
            desired: desired.to_vec(),
            points: vec![Point::default(); desired.len()],
            block: Block::new(desired.len()),
            state: LearnerState { reference: reference.to_vec(), ..LearnerState::default() },
            config,
        };
        learner.compute_points();
        let (speed, limit) = (learner.peak_speed(), learner.config.speed_limit);
        if speed > limit {
            let found = format!("a speed of {speed}, limit {limit}");
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

    /// The desired slave position at a step of the cycle (rad or m).
    pub fn desired(&self, step: usize) -> f64 {
        self.desired[step % self.desired.len()]
    }

    /// The master's reference at a step of the cycle.
    pub fn aim(&self, step: usize) -> Point {
        self.points[step % self.points.len()]
    }

    /// Highest speed of the reference (rad/s or m/s).
    pub fn peak_speed(&self) -> f64 {
        self.points[0].peak_speed
    }

    /// The current reference, one position per step (rad or m).
    pub fn reference(&self) -> &[f64] {
        &self.state.reference
    }

    /// The reference of the block with the smallest error, one position per step (rad or m); the
    /// current one before the first measured block.
    pub fn best_reference(&self) -> &[f64] {
        self.state.best.as_ref().map_or(&self.state.reference, |(_, best)| best)
    }

    /// Error of the best block: mean absolute error over its settled cycles (rad or m); `None`
    /// before the first measured block.
    pub fn best_error(&self) -> Option<f64> {
        self.state.best.as_ref().map(|(error, _)| *error)
    }

    /// The master's reference over one cycle, one point per control step.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Why learning ended; `None` while it continues.
    pub fn frozen(&self) -> Option<Frozen> {
        self.state.frozen
    }

    /// Records the slave's position (rad or m) at a control step of this block, counted from 0.
    /// Steps may be omitted. Does not allocate.
    pub fn record(&mut self, step: usize, slave: f64) {
        let in_cycle = step % self.desired.len();
        let settled = step / self.desired.len() >= self.config.settling_cycles;
        self.block.record(in_cycle, slave, self.desired[in_cycle], settled);
    }

    /// Ends the block and updates the reference. Takes several Fourier transforms of a cycle: call
    /// it outside the real-time loop.
    pub fn finish_block(&mut self) -> BlockReport {
        self.state.blocks += 1;
        let (error, settled) = self.block.errors().unzip();
        let report = BlockReport {
            block: self.state.blocks,
            error,
            settled,
            not_finite: self.block.not_finite(),
            outcome: self.update(settled),
        };
        self.block.clear();
        report
    }

    /// Ends the learning with the best reference so far.
    pub fn freeze(&mut self) {
        if self.state.frozen.is_none() {
            self.end(Frozen::Requested);
        }
    }

    fn update(&mut self, settled: Option<f64>) -> BlockOutcome {
        if let Some(frozen) = self.state.frozen {
            return BlockOutcome::Frozen(frozen);
        }
        let missing = self.block.missing();
        let Some(settled) = settled.filter(|_| missing == 0) else {
            self.state.previous_error = None;
            return BlockOutcome::Missing(missing);
        };
        let best = self.best_error().unwrap_or(f64::INFINITY);
        if settled < best {
            self.state.best = Some((settled, self.state.reference.clone()));
        }
        let worse = settled > self.config.stop.growth * best;
        self.state.worse = if worse { self.state.worse + 1 } else { 0 };
        if self.state.worse >= self.config.stop.patience {
            return self.end(Frozen::Grew { best, found: settled });
        }
        let mut error = vec![0.0; self.desired.len()];
        self.block.path(&mut error);
        for (value, desired) in error.iter_mut().zip(&self.desired) {
            *value = desired - *value;
        }
        let mut next = self.state.reference.clone();
        match &self.config.law {
            LearningLaw::Published(law) => {
                law.low_pass_and_advance(&mut self.spectral, self.config.rate_hz, &mut error);
                law.update(&error, self.state.previous_error.as_deref(), &mut next);
                self.state.previous_error = Some(error);
            }
            LearningLaw::ModelBased(law) => law.update(&mut self.spectral, error, &mut next),
        }
        self.adopt(next)
    }

    /// Adopts the next reference if it is within the limits; freezes otherwise.
    fn adopt(&mut self, next: Vec<f64>) -> BlockOutcome {
        let before = std::mem::replace(&mut self.state.reference, next);
        self.compute_points();
        let (low, high) = self.config.position_limits;
        let furthest = self.state.reference.iter().fold(0.0f64, |far, position| {
            // NaN counts as outside all limits.
            if position.abs() <= far { far } else { position.abs() }
        });
        let within = self.state.reference.iter().all(|position| (low..=high).contains(position));
        if within && self.peak_speed() <= self.config.speed_limit {
            return BlockOutcome::Learnt;
        }
        let speed = self.peak_speed();
        self.state.reference = before;
        self.end(Frozen::Limit { position: furthest, speed })
    }

    fn end(&mut self, why: Frozen) -> BlockOutcome {
        if let Some((_, best)) = &self.state.best {
            self.state.reference.clone_from(best);
        }
        self.compute_points();
        self.state.frozen = Some(why);
        BlockOutcome::Frozen(why)
    }

    /// Computes velocity and acceleration of the reference.
    fn compute_points(&mut self) {
        let mut velocity = self.state.reference.clone();
        self.spectral.differentiate(&mut velocity);
        let mut acceleration = velocity.clone();
        self.spectral.differentiate(&mut acceleration);
        let higher =
            |peak: f64, speed: f64| if speed > peak || speed.is_nan() { speed } else { peak };
        let peak_speed = velocity.iter().map(|velocity| velocity.abs()).fold(0.0, higher);
        for (n, point) in self.points.iter_mut().enumerate() {
            let position = self.state.reference[n];
            let (velocity, acceleration) = (velocity[n], acceleration[n]);
            *point = Point { position, velocity, acceleration, peak_speed };
        }
    }
}

impl LearnerConfig {
    fn check(&self) -> Result<(), LearningError> {
        let positive =
            |name, found: f64| (name, "a positive number", found, found.is_finite() && found > 0.0);
        let not_negative =
            |name, found: f64| (name, "0 or more", found, found.is_finite() && found >= 0.0);
        let (cycles, growth) = (self.cycles_per_block, self.stop.growth);
        let mut settings = vec![
            positive("rate_hz", self.rate_hz),
            positive("speed_limit", self.speed_limit),
            (
                "cycles_per_block",
                "more than settling_cycles",
                cycles as f64,
                cycles > self.settling_cycles,
            ),
            ("stop.growth", "a number above 1", growth, growth.is_finite() && growth > 1.0),
            ("stop.patience", "1 or more", 0.0, self.stop.patience > 0),
        ];
        match &self.law {
            LearningLaw::Published(law) => settings.extend([
                positive("cutoff_hz", law.cutoff_hz),
                not_negative("gamma_p", law.gamma_p),
                not_negative("gamma_d", law.gamma_d),
                not_negative("delay_s", law.delay_s),
            ]),
            LearningLaw::ModelBased(law) => {
                let identified = "a response identified at one harmonic or more";
                settings.extend([
                    positive("gain", law.gain),
                    positive("regularisation", law.regularisation),
                    ("response", identified, 0.0, law.response.known() > 0),
                ]);
            }
        }
        match settings.into_iter().find(|(.., valid)| !valid) {
            Some((name, expected, found, _)) => {
                Err(LearningError::Setting { name, expected, found })
            }
            None => Ok(()),
        }
    }
}
