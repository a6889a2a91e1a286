//! The update between two trials: identifies the response and computes the next reference. Pure,
//! but too slow for the real-time loop: it runs in a worker thread.

use std::f64::consts::TAU;

use ipc_types::{Event, EventKind, Process, Severity};
use learning::spectral::Spectral;
use learning::store::{LearntReference, ReferenceScope, StoreError};
use learning::{
    BlockOutcome, BlockReport, Frozen, Learner, LearnerConfig, LearnerState, LearningError,
    LearningLaw, ModelBased, Published, Response, Stop,
};
use rig::RigFile;
use rig::protocol::trajectory::MIN_JERK_PEAK_SPEED;
use rig::protocol::{IDENTIFYING_CYCLES, Learn, LearnLaw};
use serde::{Deserialize, Serialize};

use crate::ilc_trial::{IlcOutcome, IlcResult, Reference};
use crate::trial_record::{Fault, TrialRecord};
use crate::trial_schedule::Schedule;

/// Least amplitude of the slave for a valid response (encoder counts).
const LEAST_COUNTS: f64 = 2.0;

/// A learning segment of a protocol, prepared for one rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Its times.
    pub schedule: Schedule,
    /// The rig and movement to which its reference applies.
    pub scope: ReferenceScope,
    /// The axis that moves.
    pub axis: usize,
    /// Position limits of the axis (rad or m).
    limits: (f64, f64),
    /// Its limit on speed (rad/s or m/s).
    speed_max: f64,
    /// Least amplitude of the slave for a valid response (rad or m).
    least: f64,
    /// Whether the axis is in rad, which texts show in degrees.
    in_radians: bool,
}

impl Plan {
    /// A learning run on an axis of a rig; `None` where [`rig::protocol::Protocol::check_against`]
    /// refuses it.
    pub fn new(learn: &Learn, axis: usize, rig: &RigFile) -> Option<Self> {
        let found = rig.axes.get(axis)?;
        let cycle = learn.steps_per_cycle(rig.rates.control_hz)?;
        Some(Self {
            scope: ReferenceScope {
                rig: rig.identity(),
                rig_name: rig.name.clone(),
                axis: axis as u32,
                rate_hz: rig.rates.control_hz,
                period_s: cycle as f64 / f64::from(rig.rates.control_hz),
                amplitude: learn.amplitude,
                centre: learn.centre,
                feedforward: learn.feedforward,
            },
            schedule: Schedule {
                learn: learn.clone(),
                cycle,
                step_ns: rig.rates.control_period_ns(),
                sample_ns: rig.rates.acquisition_period_ns(),
            },
            axis,
            limits: (found.limits.position_min, found.limits.position_max),
            speed_max: found.limits.speed_max,
            least: LEAST_COUNTS / found.slave?.counts_per_unit,
            in_radians: found.unit == rig::AxisUnit::Radian,
        })
    }

    /// What is learnt.
    pub fn learn(&self) -> &Learn {
        &self.schedule.learn
    }

    /// The slave's positions over one cycle (rad or m).
    fn desired(&self) -> Vec<f64> {
        let (count, learn) = (self.schedule.cycle, self.learn());
        (0..count)
            .map(|n| learn.centre + learn.amplitude * (TAU * n as f64 / count as f64).sin())
            .collect()
    }

    fn config(&self, law: LearningLaw) -> LearnerConfig {
        let learn = self.learn();
        LearnerConfig {
            rate_hz: f64::from(self.scope.rate_hz),
            cycles_per_block: learn.cycles_per_block as usize,
            settling_cycles: learn.settling_cycles as usize,
            law,
            stop: Stop { growth: learn.growth, patience: learn.patience as usize },
            position_limits: self.limits,
            speed_limit: self.speed_max,
        }
    }

    /// Formats a position error for an event's text.
    fn shown(&self, value: f64) -> String {
        if self.in_radians {
            format!("{:.2}°", value.to_degrees())
        } else {
            format!("{value:.5} m")
        }
    }
}

/// The state with which a restarted process continues a learning run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IlcState {
    /// Session of the rig; a state of another session is not used.
    pub session: u64,
    /// Identity of the protocol's text.
    pub protocol: u64,
    /// Its segment, repeats counted.
    pub segment: u32,
    /// Number of finished blocks.
    pub done: u32,
    /// State of the learner.
    pub learner: LearnerState,
    /// The identified response, real and imaginary part at harmonic 0, 1, 2, ...; empty where none
    /// is used.
    pub response: Vec<Option<(f64, f64)>>,
}

/// Why a learning run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum IlcError {
    /// The learner refused.
    #[error("learning cannot begin: {0}")]
    Learning(#[from] LearningError),
    /// The saved reference cannot be used.
    #[error("the learnt reference \"{name}\" cannot be used: {source}")]
    Load {
        /// Its name.
        name: String,
        /// Why.
        source: StoreError,
    },
    /// The response cannot be identified.
    #[error("the response cannot be identified: {0}")]
    Identification(&'static str),
}

/// Result of the update by one trial record.
#[derive(Debug)]
pub struct Updated {
    /// The next reference.
    pub reference: Option<Box<Reference>>,
    /// Event to publish.
    pub event: Option<Event>,
    /// Second event to publish, if learning has ended.
    pub ended: Option<Event>,
    /// Whether the learning run cannot go on.
    pub failed: bool,
}

/// Updates the reference of one learning run from trial to trial.
#[derive(Debug)]
pub struct IlcUpdater {
    plan: Plan,
    segment: u32,
    /// A reference to begin with.
    first: Vec<f64>,
    response: Response,
    learner: Option<Learner>,
    done: u32,
    ended: bool,
    /// Blocks of this run that were learnt from.
    learnt: u32,
}

impl IlcUpdater {
    /// Begins a learning run: with a loaded reference, or where another process left off.
    ///
    /// # Errors
    /// [`IlcError::Learning`].
    pub fn new(
        plan: Plan,
        segment: u32,
        loaded: Option<LearntReference>,
        saved: Option<IlcState>,
    ) -> Result<Self, IlcError> {
        let first = loaded.map_or_else(|| plan.desired(), |loaded| loaded.positions);
        let mut updater = Self {
            response: Response::default(),
            learner: None,
            done: 0,
            ended: false,
            learnt: 0,
            first,
            segment,
            plan,
        };
        if let Some(saved) = saved {
            updater.response = Response::from_parts(&saved.response);
            updater.done = saved.done;
            let law = updater.law();
            let desired = updater.plan.desired();
            updater.ended = saved.learner.frozen.is_some();
            updater.learner =
                Some(Learner::restore(&desired, saved.learner, updater.plan.config(law))?);
        } else if !updater.must_identify() {
            updater.create_learner()?;
        }
        Ok(updater)
    }

    /// The learning run.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The segment of the protocol, repeats counted.
    pub fn segment(&self) -> u32 {
        self.segment
    }

    /// Number of finished blocks.
    pub fn done(&self) -> u32 {
        self.done
    }

    /// Whether no identification is needed any more.
    pub fn identified(&self) -> bool {
        self.learner.is_some()
    }

    /// The first result of the learning run with number `run_id`.
    pub fn ready(&self, run_id: u32) -> IlcResult {
        let empty = || Some(Box::new(TrialRecord::new(&self.plan.schedule)));
        IlcResult {
            run_id,
            records: [empty(), empty()],
            reference: self.reference(),
            outcome: IlcOutcome::Ready { done: self.done(), identified: self.identified() },
        }
    }

    /// The reference to follow from the first block on; `None`: the movement itself.
    pub fn reference(&self) -> Option<Box<Reference>> {
        let positions = self.learner.as_ref().map_or(&self.first[..], Learner::reference);
        if positions == self.plan.desired() {
            return None;
        }
        match &self.learner {
            Some(learner) => Some(copy(learner)),
            // Before the identification: the points do not depend on the law.
            None => {
                let law = LearningLaw::Published(NOTHING);
                Learner::from_reference(&self.plan.desired(), &self.first, self.plan.config(law))
                    .ok()
                    .map(|learner| copy(&learner))
            }
        }
    }

    /// Processes a trial record.
    pub fn update(&mut self, record: &TrialRecord) -> Updated {
        if record.block == 0 { self.identify(record) } else { self.block(record) }
    }

    /// The state for a restart; `None` before the first block can begin.
    pub fn state(&self, session: u64, protocol: u64) -> Option<IlcState> {
        let learner = self.learner.as_ref()?;
        Some(IlcState {
            session,
            protocol,
            segment: self.segment,
            done: self.done,
            learner: learner.state(),
            response: self.response.parts(),
        })
    }

    /// The best reference, for [`Learn::save`]; `None` where nothing was learnt.
    ///
    /// # Errors
    /// [`StoreError::Positions`].
    pub fn best(&self) -> Option<Result<LearntReference, StoreError>> {
        let learner = self.learner.as_ref().filter(|_| self.learnt > 0 || self.done > 0)?;
        let error = learner.best_error()?;
        Some(LearntReference::new(&self.plan.scope, error, learner.best_reference().to_vec()))
    }

    /// Ends the learning run before its last block. Returns the event to publish, if learning had
    /// not ended before.
    pub fn stop(&mut self) -> Option<Event> {
        if self.ended || self.learner.is_none() {
            return None;
        }
        self.ended = true;
        Some(self.ending("stopped before the last block"))
    }

    fn must_identify(&self) -> bool {
        matches!(self.plan.learn().law, LearnLaw::ModelBased { .. })
    }

    fn law(&self) -> LearningLaw {
        match self.plan.learn().law {
            LearnLaw::Keep => LearningLaw::Published(NOTHING),
            LearnLaw::Published { gamma_p, gamma_d, cutoff_hz, delay_s } => {
                LearningLaw::Published(Published { gamma_p, gamma_d, cutoff_hz, delay_s })
            }
            LearnLaw::ModelBased { gain, regularisation, .. } => {
                LearningLaw::ModelBased(ModelBased {
                    response: self.response.clone(),
                    gain,
                    regularisation,
                })
            }
        }
    }

    fn create_learner(&mut self) -> Result<(), LearningError> {
        let config = self.plan.config(self.law());
        let mut learner = Learner::from_reference(&self.plan.desired(), &self.first, config)?;
        if self.plan.learn().law == LearnLaw::Keep {
            learner.freeze();
        }
        self.learner = Some(learner);
        Ok(())
    }

    /// The response at each harmonic, from the last cycle of its sine.
    fn identify(&mut self, record: &TrialRecord) -> Updated {
        let LearnLaw::ModelBased { harmonics, identify_amplitude, .. } = self.plan.learn().law
        else {
            return self.failed("the learning law needs none");
        };
        if record.fault.is_some() {
            return self
                .failed("the motor had no power; arm and enable, then run the protocol again");
        }
        let cycle = self.plan.schedule.cycle;
        let mut spectral = Spectral::new(cycle, f64::from(self.plan.scope.rate_hz));
        let each = cycle * IDENTIFYING_CYCLES as usize;
        for (index, path) in record.path().chunks_exact(each).take(harmonics as usize).enumerate() {
            let harmonic = index + 1;
            let amplitude = identify_amplitude / (harmonic as f64).sqrt();
            let sine =
                |n: usize| amplitude * (TAU * (harmonic * n % cycle) as f64 / cycle as f64).sin();
            let input: Vec<f64> = (0..cycle).map(sine).collect();
            let output = &path[each - cycle..];
            if output.iter().all(|value| value.is_finite()) {
                let input = spectral.spectrum(&input)[harmonic];
                let output = spectral.spectrum(output)[harmonic];
                self.response.set(harmonic, input, output, self.plan.least);
            }
        }
        if self.response.known() == 0 {
            return self.failed("the slave did not move, or was not measured");
        }
        if let Err(error) = self.create_learner() {
            return self.refused(&error.to_string());
        }
        let text = format!("response known at {} of {harmonics} harmonics", self.response.known());
        let mut event = self.event(EventKind::BlockLearnt, Severity::Info, &text);
        (event.b, event.c) = (f64::NAN, f64::NAN);
        Updated { reference: None, event: Some(event), ended: None, failed: false }
    }

    fn failed(&mut self, why: &'static str) -> Updated {
        self.refused(&IlcError::Identification(why).to_string())
    }

    fn refused(&mut self, why: &str) -> Updated {
        self.ended = true;
        let event = self.event(EventKind::LearningEnded, Severity::Error, why);
        Updated { reference: None, event: None, ended: Some(event), failed: true }
    }

    fn block(&mut self, record: &TrialRecord) -> Updated {
        self.done = record.block;
        let change_s = self.plan.schedule.change_s();
        let Some(learner) = &mut self.learner else {
            return Updated { reference: None, event: None, ended: None, failed: false };
        };
        if record.fault.is_none() {
            for (step, slave) in
                record.path().iter().enumerate().filter(|(_, slave)| slave.is_finite())
            {
                learner.record(step, *slave);
            }
        }
        let before = learner.reference().to_vec();
        let report = learner.finish_block();
        let mut too_fast = false;
        if report.outcome == BlockOutcome::Learnt {
            let furthest = before
                .iter()
                .zip(learner.reference())
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            too_fast = learner.peak_speed() + MIN_JERK_PEAK_SPEED * furthest / change_s
                > self.plan.speed_max;
            if too_fast {
                learner.freeze();
            }
        }
        let reference = (learner.reference() != before).then(|| copy(learner));
        self.learnt += u32::from(report.outcome == BlockOutcome::Learnt);
        let event = self.block_event(record, &report);
        let keeps = self.plan.learn().law == LearnLaw::Keep;
        let why = match report.outcome {
            _ if too_fast => {
                Some("the change to the next reference would pass the limit on speed".to_owned())
            }
            BlockOutcome::Frozen(why) if !keeps => Some(self.reason(why)),
            _ if record.last => Some("all blocks are done".to_owned()),
            _ => None,
        };
        let ended = why.filter(|_| !self.ended).map(|why| {
            self.ended = true;
            self.ending(&why)
        });
        Updated { reference, event: Some(event), ended, failed: false }
    }

    fn reason(&self, why: Frozen) -> String {
        match why {
            Frozen::Grew { best, found } => {
                format!(
                    "the error grew from {} to {}",
                    self.plan.shown(best),
                    self.plan.shown(found)
                )
            }
            Frozen::Limit { position, speed } => format!(
                "the next reference would pass the limits: {} away, {}/s",
                self.plan.shown(position),
                self.plan.shown(speed)
            ),
            Frozen::Requested => "stopped on request".to_owned(),
        }
    }

    fn block_event(&self, record: &TrialRecord, report: &BlockReport) -> Event {
        let text = match (record.fault, report.outcome) {
            (Some(Fault::NoPower), _) => "not learnt from: the motor had no power".to_owned(),
            (Some(Fault::OldReference), _) => {
                "not learnt from: the new reference came too late for it".to_owned()
            }
            (None, BlockOutcome::Missing(steps)) => {
                format!("not learnt from: {steps} steps of the cycle were not measured")
            }
            (None, BlockOutcome::Frozen(_)) => "measured, not learnt from".to_owned(),
            (None, BlockOutcome::Learnt) => String::new(),
        };
        let missing = matches!(report.outcome, BlockOutcome::Missing(_)) || record.fault.is_some();
        let severity = if missing { Severity::Warning } else { Severity::Info };
        let best = self.learner.as_ref().and_then(Learner::best_error);
        let mut event = self.event(EventKind::BlockLearnt, severity, &text);
        event.a = f64::from(record.block);
        event.b = report.settled.unwrap_or(f64::NAN);
        event.c = best.unwrap_or(f64::NAN);
        event
    }

    fn ending(&self, why: &str) -> Event {
        let best = self.learner.as_ref().and_then(Learner::best_error);
        let text = match best {
            Some(best) => format!("{why}; best error {}", self.plan.shown(best)),
            None => why.to_owned(),
        };
        let mut event = self.event(EventKind::LearningEnded, Severity::Info, &text);
        (event.a, event.b) = (f64::from(self.done), best.unwrap_or(f64::NAN));
        event
    }

    fn event(&self, kind: EventKind, severity: Severity, text: &str) -> Event {
        Event { segment: self.segment, ..Event::new(Process::Experiment, kind, severity, text) }
    }
}

/// The published law with zero gains.
const NOTHING: Published = Published { gamma_p: 0.0, gamma_d: 0.0, cutoff_hz: 8.0, delay_s: 0.0 };

fn copy(learner: &Learner) -> Box<Reference> {
    Box::new(Reference { points: learner.points().to_vec() })
}
