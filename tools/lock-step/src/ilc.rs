//! Iterative learning control on the lock-step rig: the movement of § 4.3, block by block.

use std::ops::Range;

use learning::spectral::Spectral;
use learning::{
    BlockOutcome, BlockReport, Learner, LearnerConfig, LearningError, LearningLaw, ModelBased,
    Published, Response, Stop,
};
use rig::{HandKind, RigFile};
use thiserror::Error;

use crate::{Aim, CycleResult, LockStepError, LockStepRig};

/// Every control step of a block.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Time within the block (s).
    pub time_s: Vec<f64>,
    /// Desired position of the slave (rad or m).
    pub desired: Vec<f64>,
    /// The master's reference (rad or m).
    pub reference: Vec<f64>,
    /// Position of the master (rad or m).
    pub master: Vec<f64>,
    /// Position of the slave (rad or m).
    pub slave: Vec<f64>,
    /// Speed of the master (rad/s or m/s).
    pub master_velocity: Vec<f64>,
    /// Speed of the slave (rad/s or m/s).
    pub slave_velocity: Vec<f64>,
    /// Output (V).
    pub volts: Vec<f64>,
    /// Feed-forward part of the output (V).
    pub feedforward: Vec<f64>,
}

impl Trace {
    /// Adds a control step of a block that began at `begin_s` (s); positions in rad or m.
    pub fn push(&mut self, begin_s: f64, desired: f64, reference: f64, moment: &CycleResult) {
        self.time_s.push(moment.time_s - begin_s);
        self.desired.push(desired);
        self.reference.push(reference);
        self.master.push(moment.motion.master_position_rad);
        self.slave.push(moment.motion.slave_position_rad);
        self.master_velocity.push(moment.motion.master_velocity_rad_s);
        self.slave_velocity.push(moment.motion.slave_velocity_rad_s);
        self.volts.push(moment.command.volts[0]);
        self.feedforward.push(moment.command.feedforward_v[0]);
    }

    /// The control steps in a range; none where it reaches beyond the end.
    #[must_use]
    pub fn part(&self, steps: Range<usize>) -> Self {
        let cut = |values: &[f64]| values.get(steps.clone()).unwrap_or_default().to_vec();
        Self {
            time_s: cut(&self.time_s),
            desired: cut(&self.desired),
            reference: cut(&self.reference),
            master: cut(&self.master),
            slave: cut(&self.slave),
            master_velocity: cut(&self.master_velocity),
            slave_velocity: cut(&self.slave_velocity),
            volts: cut(&self.volts),
            feedforward: cut(&self.feedforward),
        }
    }

    /// Its last `steps` control steps, time from 0.
    #[must_use]
    pub fn last(&self, steps: usize) -> Self {
        let end = self.time_s.len();
        let mut last = self.part(end.saturating_sub(steps)..end);
        let begin_s = last.time_s.first().copied().unwrap_or_default();
        last.time_s.iter_mut().for_each(|time_s| *time_s -= begin_s);
        last
    }
}

/// A movement to be learnt, and the learning law.
#[derive(Clone, Debug, PartialEq)]
pub struct IlcTask {
    /// Amplitude of the sine (rad or m).
    pub amplitude: f64,
    /// Its frequency (Hz).
    pub hertz: f64,
    /// Cycles in a block.
    pub cycles_per_block: usize,
    /// Cycles at the beginning of a block that are not averaged.
    pub settling_cycles: usize,
    /// The learning law.
    pub law: LearningLaw,
    /// When learning stops.
    pub stop: Stop,
}

impl IlcTask {
    /// The movement of § 4.3 and fig. 4.6: 1 Hz, blocks of 3 s, with one settling cycle. The
    /// amplitude is not printed; 20° is assumed.
    pub fn of_the_thesis(law: LearningLaw) -> Self {
        Self {
            amplitude: 20f64.to_radians(),
            hertz: 1.0,
            cycles_per_block: 3,
            settling_cycles: 1,
            law,
            stop: Stop { growth: 1.5, patience: 5 },
        }
    }
}

/// Eq. 4.3.2 and 4.3.3 with the printed delay of 30 ms, and with assumed gains and cut-off, since
/// none are printed.
pub const PUBLISHED: Published =
    Published { gamma_p: 0.1, gamma_d: 0.01, cutoff_hz: 8.0, delay_s: 0.03 };

/// Harmonics that [`model_based`] identifies and learns.
pub const HARMONICS: usize = 9;

/// The model-based law with assumed settings. Its response is identified on the same rig with sines
/// of twice the task's amplitude: with less, § 4.1's feedback alone hardly overcomes the friction.
///
/// # Errors
/// [`IlcError`].
pub fn model_based(
    rig: &RigFile,
    effects: &[String],
    task: &IlcTask,
) -> Result<ModelBased, IlcError> {
    let response = identify(rig, effects, task.hertz, HARMONICS, 2.0 * task.amplitude)?;
    Ok(ModelBased { response, gain: 0.6, regularisation: 0.3 })
}

/// The rig as § 4.3 simulates it: the master under proportional and derivative feedback alone,
/// nobody at the handle.
#[must_use]
pub fn feedback_only(mut rig: RigFile) -> RigFile {
    let feedforward = &mut rig.axes[0].control.feedforward;
    (feedforward.friction_peak_v, feedforward.friction_floor_v, feedforward.inertia_v) =
        (0.0, 0.0, 0.0);
    rig.simulation.hand.kind = HandKind::Absent;
    rig
}

/// Why learning failed.
#[derive(Debug, Error)]
pub enum IlcError {
    /// The lock-step rig refused.
    #[error(transparent)]
    LockStepRig(#[from] LockStepError),
    /// The learner refused.
    #[error(transparent)]
    Learning(#[from] LearningError),
    /// A cycle is not a whole number of control steps.
    #[error(
        "{hertz} Hz: expected a whole number of control steps in a cycle, found {steps} at \
            {rate_hz} Hz"
    )]
    Period {
        /// Frequency of the movement (Hz).
        hertz: f64,
        /// Control steps in a cycle.
        steps: f64,
        /// Rate of control (Hz).
        rate_hz: u32,
    },
}

/// A lock-step rig with a learner.
#[derive(Debug)]
pub struct IlcSimulation {
    system: LockStepRig,
    learner: Learner,
}

impl IlcSimulation {
    /// Creates a simulation at rest, before the first block.
    ///
    /// # Errors
    /// [`IlcError`].
    pub fn new(rig: &RigFile, effects: &[String], task: &IlcTask) -> Result<Self, IlcError> {
        let count = steps_per_cycle(rig, task.hertz)?;
        let limits = rig.axes[0].limits;
        let desired: Vec<f64> = (0..count)
            .map(|n| task.amplitude * (std::f64::consts::TAU * n as f64 / count as f64).sin())
            .collect();
        let config = LearnerConfig {
            rate_hz: f64::from(rig.rates.control_hz),
            cycles_per_block: task.cycles_per_block,
            settling_cycles: task.settling_cycles,
            law: task.law.clone(),
            stop: task.stop,
            position_limits: (limits.position_min, limits.position_max),
            speed_limit: limits.speed_max,
        };
        Ok(Self {
            system: LockStepRig::new(rig, effects)?,
            learner: Learner::new(&desired, config)?,
        })
    }

    /// The learner.
    pub fn learner(&self) -> &Learner {
        &self.learner
    }

    /// Runs one block; appends its steps to the trace.
    ///
    /// # Errors
    /// [`LockStepError`].
    pub fn block(&mut self, mut trace: Option<&mut Trace>) -> Result<BlockReport, LockStepError> {
        let begin_s = self.system.time_s();
        for step in 0..self.learner.steps_per_block() {
            let point = self.learner.aim(step);
            let moment = self.system.follow(&point)?;
            self.learner.record(step, slave_position(&moment));
            if let Some(trace) = trace.as_deref_mut() {
                let desired = self.learner.desired(step);
                trace.push(begin_s, desired, point.position, &moment);
            }
        }
        Ok(self.learner.finish_block())
    }
}

/// Position by the slave's encoder (rad or m); NaN if the sample has none.
fn slave_position(moment: &CycleResult) -> f64 {
    if moment.sample.slave_present & 1 != 0 { moment.sample.slave_position[0] } else { f64::NAN }
}

/// Whether a block ended the learning.
pub fn ended(report: &BlockReport) -> bool {
    matches!(report.outcome, BlockOutcome::Frozen(_))
}

/// Control steps in a cycle.
fn steps_per_cycle(rig: &RigFile, hertz: f64) -> Result<usize, IlcError> {
    let rate_hz = rig.rates.control_hz;
    let steps = f64::from(rate_hz) / hertz;
    if (steps - steps.round()).abs() > 1e-6 || steps.is_nan() || steps < 1.0 {
        return Err(IlcError::Period { hertz, steps, rate_hz });
    }
    Ok(steps.round() as usize)
}

/// Identifies the frequency response from the master's reference to the slave by stepped sines at
/// the first `harmonics` multiples of `hertz` (Hz), each for two settling cycles and one evaluated
/// cycle of `hertz`: `3 · harmonics / hertz` seconds on the rig. The amplitude is `amplitude` (rad
/// or m) for the first sine and falls with the square root of the frequency. Where the slave moves
/// by less than two counts, the response is not identified.
///
/// # Errors
/// [`IlcError`].
pub fn identify(
    rig: &RigFile,
    effects: &[String],
    hertz: f64,
    harmonics: usize,
    amplitude: f64,
) -> Result<Response, IlcError> {
    let count = steps_per_cycle(rig, hertz)?;
    let mut spectral = Spectral::new(count, f64::from(rig.rates.control_hz));
    let least = 2.0 / rig.axes[0].slave.unwrap_or(rig.axes[0].master).counts_per_unit;
    let mut response = Response::default();
    let (mut input, mut output) = (vec![0.0; count], vec![0.0; count]);
    for harmonic in 1..=harmonics {
        let mut system = LockStepRig::new(rig, effects)?;
        let times = harmonic as f64;
        for step in 0..3 * count {
            let aim = Aim::sine(amplitude / times.sqrt(), times * hertz, system.time_s());
            let moment = system.follow(&aim)?;
            input[step % count] = aim.position;
            output[step % count] = slave_position(&moment);
        }
        let input = spectral.spectrum(&input)[harmonic];
        let output = spectral.spectrum(&output)[harmonic];
        response.set(harmonic, input, output, least);
    }
    Ok(response)
}
