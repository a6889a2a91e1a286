//! Learning on the twin: the movement of § 4.3, block by block.

use learning::spectral::Spectral;
use learning::{
    BlockReport, Learner, LearnerConfig, LearningError, LearningLaw, ModelBased, Published,
    Response, Step, Stop,
};
use rig::{HandKind, RigFile};
use thiserror::Error;

use crate::{Aim, Moment, Twin, TwinError};

/// Every control step of a block.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Time within the block (s).
    pub time_s: Vec<f64>,
    /// Where the slave should be (rad or m).
    pub desired: Vec<f64>,
    /// The master's reference (rad or m).
    pub reference: Vec<f64>,
    /// The master (rad or m).
    pub master: Vec<f64>,
    /// The slave (rad or m).
    pub slave: Vec<f64>,
    /// Speed of the master (rad/s or m/s).
    pub master_velocity: Vec<f64>,
    /// Speed of the slave (rad/s or m/s).
    pub slave_velocity: Vec<f64>,
    /// What control put out (V).
    pub volts: Vec<f64>,
    /// What of it was feed-forward (V).
    pub feedforward: Vec<f64>,
}

impl Trace {
    /// Adds a control step of a block that began at `begin_s` (s); positions in rad or m.
    pub fn push(&mut self, begin_s: f64, desired: f64, reference: f64, moment: &Moment) {
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

    /// Its last `steps` control steps, time from 0.
    #[must_use]
    pub fn last(&self, steps: usize) -> Self {
        let from = self.time_s.len().saturating_sub(steps);
        let cut = |values: &[f64]| values[from.min(values.len())..].to_vec();
        let begin_s = self.time_s.get(from).copied().unwrap_or_default();
        Self {
            time_s: cut(&self.time_s).iter().map(|time_s| time_s - begin_s).collect(),
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
}

/// What is to be learnt, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct Lesson {
    /// Amplitude of the sine (rad or m).
    pub amplitude: f64,
    /// Its frequency (Hz).
    pub hertz: f64,
    /// Cycles in a block.
    pub cycles_per_block: usize,
    /// How many of them, at the beginning, are not learnt from.
    pub settling_cycles: usize,
    /// The learning law.
    pub law: LearningLaw,
    /// When it stops.
    pub stop: Stop,
}

impl Lesson {
    /// The movement of § 4.3 and fig. 4.6: 1 Hz, blocks of 3 s, of which the first cycle settles.
    /// The amplitude is not printed: 20° is ours.
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

/// Eq. 4.3.2 and 4.3.3 with the printed delay of 30 ms, and with gains and cut-off of ours, since
/// none are printed.
pub const PUBLISHED: Published =
    Published { gamma_p: 0.1, gamma_d: 0.01, cutoff_hz: 8.0, delay_s: 0.03 };

/// Harmonics that [`model_based`] identifies and learns.
pub const HARMONICS: usize = 9;

/// The model-based law with settings of ours, its response identified on the same rig with sines of
/// twice the lesson's amplitude at its frequency: with little more than the lesson's own, § 4.1's
/// feedback alone hardly overcomes the friction.
///
/// # Errors
/// [`LessonError`].
pub fn model_based(
    rig: &RigFile,
    effects: &[String],
    lesson: &Lesson,
) -> Result<ModelBased, LessonError> {
    let response = identify(rig, effects, lesson.hertz, HARMONICS, 2.0 * lesson.amplitude)?;
    Ok(ModelBased { response, gain: 0.6, regularisation: 0.3 })
}

/// The rig as § 4.3 simulates it: the master under proportional and derivative feedback alone,
/// nobody at the handle.
#[must_use]
pub fn bench(mut rig: RigFile) -> RigFile {
    let feedforward = &mut rig.axes[0].control.feedforward;
    (feedforward.friction_peak_v, feedforward.friction_floor_v, feedforward.inertia_v) =
        (0.0, 0.0, 0.0);
    rig.simulation.hand.kind = HandKind::Absent;
    rig
}

/// Why nothing was learnt.
#[derive(Debug, Error)]
pub enum LessonError {
    /// The twin refused.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// The learner refused.
    #[error(transparent)]
    Learning(#[from] LearningError),
    /// A cycle is no whole number of control steps.
    #[error(
        "{hertz} Hz: expected a whole number of control steps in a cycle, found {steps} at {rate_hz} Hz"
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

/// A twin with a learner.
#[derive(Debug)]
pub struct Pupil {
    twin: Twin,
    learner: Learner,
}

impl Pupil {
    /// At rest, before the first block.
    ///
    /// # Errors
    /// [`LessonError`].
    pub fn new(rig: &RigFile, effects: &[String], lesson: &Lesson) -> Result<Self, LessonError> {
        let count = steps_per_cycle(rig, lesson.hertz)?;
        let limits = rig.axes[0].limits;
        let desired: Vec<f64> = (0..count)
            .map(|n| lesson.amplitude * (std::f64::consts::TAU * n as f64 / count as f64).sin())
            .collect();
        let config = LearnerConfig {
            rate_hz: f64::from(rig.rates.control_hz),
            cycles_per_block: lesson.cycles_per_block,
            settling_cycles: lesson.settling_cycles,
            law: lesson.law.clone(),
            stop: lesson.stop,
            position_limits: (limits.position_min, limits.position_max),
            speed_limit: limits.speed_max,
        };
        Ok(Self { twin: Twin::new(rig, effects)?, learner: Learner::new(&desired, config)? })
    }

    /// The learner.
    pub fn learner(&self) -> &Learner {
        &self.learner
    }

    /// One block, with every step of it.
    ///
    /// # Errors
    /// [`TwinError`].
    pub fn block(&mut self, mut trace: Option<&mut Trace>) -> Result<BlockReport, TwinError> {
        let begin_s = self.twin.time_s();
        for step in 0..self.learner.steps_per_block() {
            let point = self.learner.aim(step);
            let aim = Aim {
                position: point.position,
                velocity: point.velocity,
                acceleration: point.acceleration,
                peak_speed: self.learner.peak_speed(),
            };
            let setpoint = self.twin.setpoint(&aim);
            let moment = self.twin.cycle(&setpoint)?;
            self.learner.record(step, slave_position(&moment));
            if let Some(trace) = trace.as_deref_mut() {
                let desired = self.learner.desired(step);
                trace.push(begin_s, desired, point.position, &moment);
            }
        }
        Ok(self.learner.finish_block())
    }
}

/// What the slave's encoder says (rad or m); not a number where the scan has none.
fn slave_position(moment: &Moment) -> f64 {
    if moment.sample.slave_present & 1 != 0 { moment.sample.slave_position[0] } else { f64::NAN }
}

/// Whether a block ended the learning.
pub fn ended(report: &BlockReport) -> bool {
    matches!(report.step, Step::Frozen(_))
}

/// Control steps in a cycle.
fn steps_per_cycle(rig: &RigFile, hertz: f64) -> Result<usize, LessonError> {
    let rate_hz = rig.rates.control_hz;
    let steps = f64::from(rate_hz) / hertz;
    if (steps - steps.round()).abs() > 1e-6 || steps.is_nan() || steps < 1.0 {
        return Err(LessonError::Period { hertz, steps, rate_hz });
    }
    Ok(steps.round() as usize)
}

/// Identifies the response from the master's reference to the slave as a laboratory does, by one
/// sine after the other: at the first `harmonics` multiples of `hertz` (Hz), each for two cycles of
/// `hertz` to settle and one that is read: `3 · harmonics / hertz` seconds on the rig. The
/// amplitude is `amplitude` (rad or m) at the first and falls with the root of the frequency. A
/// slave that moves by less than two counts tells nothing.
///
/// # Errors
/// [`LessonError`].
pub fn identify(
    rig: &RigFile,
    effects: &[String],
    hertz: f64,
    harmonics: usize,
    amplitude: f64,
) -> Result<Response, LessonError> {
    let count = steps_per_cycle(rig, hertz)?;
    let mut spectral = Spectral::new(count, f64::from(rig.rates.control_hz));
    let least = 2.0 / rig.axes[0].slave.unwrap_or(rig.axes[0].master).counts_per_unit;
    let mut response = Response::default();
    let (mut input, mut output) = (vec![0.0; count], vec![0.0; count]);
    for harmonic in 1..=harmonics {
        let mut twin = Twin::new(rig, effects)?;
        let times = harmonic as f64;
        for step in 0..3 * count {
            let aim = Aim::sine(amplitude / times.sqrt(), times * hertz, twin.time_s());
            let setpoint = twin.setpoint(&aim);
            let moment = twin.cycle(&setpoint)?;
            input[step % count] = aim.position;
            output[step % count] = slave_position(&moment);
        }
        let input = spectral.spectrum(&input)[harmonic];
        let output = spectral.spectrum(&output)[harmonic];
        response.learn(harmonic, input, output, least);
    }
    Ok(response)
}
