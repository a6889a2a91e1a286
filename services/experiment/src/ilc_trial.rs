//! Iterative learning control of a movement (Arimoto 1984; Bristow, Tharayil and Alleyne 2006), as
//! the real-time loop plays it: the schedule of references, and the record of the slave's position.
//!
//! ```text
//! fade in ─> [a sine for each harmonic, three cycles each] ─> trial 1 ─> trial 2 ─> ... ─> out
//!                       │ slave's path                          │ slave's path      ^
//!                       v                                       v                   │ reference
//!                 ilc_update ──────────────────────────── ilc_update ───────────────┘
//! ```
//!
//! A trial is one block of a protocol: some settling cycles, then the cycles that are averaged. The
//! update of the reference takes time and runs in another thread ([`crate::ilc_update`]); the loop
//! never waits for it but continues with the old reference. The new one takes over in the first
//! settling cycle of the next trial, by a minimum-jerk transition of half a cycle, so that control
//! never sees a jump. A reference that arrives too late for that is used from the following trial
//! on, and the trial in between is not learnt from.
//!
//! **Time.** Step 0 of the cycle is a multiple of the control period on CLOCK_MONOTONIC, as the
//! card's scans are. The slave's position at a step is that of the scan at the step's own time, and
//! the reference is for the same instant, so neither a late loop nor the latency of a setpoint
//! affects the error.
//!
//! Nothing here allocates or frees: references and records come from the worker thread and return
//! to it.

use std::f64::consts::TAU;

use rig::protocol::trajectory::{Point, Weight};
use rig::protocol::{IDENTIFYING_CYCLES, Learn, LearnLaw};

use crate::trial_record::{Fault, TrialRecord};
use crate::trial_schedule::Schedule;

/// One cycle of a reference.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reference {
    /// Reference of the master, step by step.
    pub points: Vec<Point>,
}

/// A result from the worker thread, with the memory that it hands to the loop.
#[derive(Clone, Debug)]
pub struct IlcResult {
    /// Number of the learning run.
    pub run_id: u32,
    /// Cleared records.
    pub records: [Option<Box<TrialRecord>>; 2],
    /// The next reference; `None`: as before, at first the desired movement itself.
    pub reference: Option<Box<Reference>>,
    /// What was done.
    pub outcome: IlcOutcome,
}

/// What the worker thread did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IlcOutcome {
    /// The learning run is prepared and can begin.
    Ready {
        /// Blocks done before a restart.
        done: u32,
        /// Whether the response is known or not needed.
        identified: bool,
    },
    /// A record was processed.
    Updated,
    /// The learning run cannot continue and must be stopped.
    Failed,
}

impl IlcResult {
    /// A record was processed; it is cleared here.
    pub fn updated(mut record: Box<TrialRecord>, reference: Option<Box<Reference>>) -> Self {
        let run_id = record.run_id;
        record.clear();
        Self { run_id, records: [Some(record), None], reference, outcome: IlcOutcome::Updated }
    }

    /// The learning run cannot continue.
    pub fn failed(run_id: u32) -> Self {
        Self { run_id, records: [None, None], reference: None, outcome: IlcOutcome::Failed }
    }

    /// The memory alone.
    pub(crate) fn memory(self) -> impl Iterator<Item = Returned> {
        let records = self.records.into_iter().flatten().map(Returned::Record);
        records.chain(self.reference.map(Returned::Reference))
    }
}

/// Source of the reference.
#[derive(Clone, Debug)]
enum Source {
    /// The desired movement of the slave.
    Desired,
    /// A sine of the identification.
    Sine { harmonic: u32 },
    /// A learnt reference.
    Learnt(Box<Reference>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// Fading in, or waiting for the worker thread.
    Waiting,
    Identifying {
        from: i64,
    },
    Block {
        from: i64,
        number: u32,
    },
    /// Fading out.
    Over {
        from: i64,
    },
}

/// Capacity for items returned to the worker thread in one step.
pub const RETURNED: usize = 8;

/// Memory that is returned to the worker thread.
#[derive(Clone, Debug)]
pub enum Returned {
    /// A record to learn from.
    Record(Box<TrialRecord>),
    /// A reference that is no longer used.
    Reference(Box<Reference>),
}

/// A learning run as the loop plays it: a sequence of trials.
#[derive(Clone, Debug)]
pub struct IlcTrials {
    run_id: u32,
    schedule: Schedule,
    start: f64,
    begun_ns: u64,
    origin_ns: u64,
    stage: Stage,
    /// Once the worker is ready: blocks done before, and whether the response is known. `starts` is
    /// the step at which the run then begins.
    ready: Option<(u32, bool)>,
    starts: i64,
    old: Source,
    new: Source,
    changes: i64,
    pending: Option<Box<Reference>>,
    current: Option<Box<TrialRecord>>,
    previous: Option<Box<TrialRecord>>,
    spare: [Option<Box<TrialRecord>>; 2],
    in_flight: u32,
    out: [Option<Returned>; RETURNED],
}

impl IlcTrials {
    /// Creates a learning run that begins at `begun_ns` (CLOCK_MONOTONIC), with the axis at rest at
    /// `start` (rad or m).
    pub fn new(run_id: u32, schedule: &Schedule, start: f64, begun_ns: u64) -> Self {
        let learn = &schedule.learn;
        let faded_ns = begun_ns + (learn.fade_in_s * 1e9).round() as u64;
        let step_ns = schedule.step_ns.max(1);
        Self {
            run_id,
            start,
            begun_ns,
            origin_ns: faded_ns / step_ns * step_ns,
            stage: Stage::Waiting,
            ready: None,
            starts: 0,
            old: Source::Desired,
            new: Source::Desired,
            changes: i64::MIN / 2,
            pending: None,
            current: None,
            previous: None,
            spare: [None, None],
            in_flight: 0,
            out: [const { None }; RETURNED],
            // File names are not copied, because this runs in the real-time loop.
            schedule: Schedule {
                learn: Learn { save: None, load: None, ..*learn },
                cycle: schedule.cycle,
                step_ns,
                sample_ns: schedule.sample_ns,
            },
        }
    }

    /// Its number.
    pub fn run_id(&self) -> u32 {
        self.run_id
    }

    /// The block being played, from 1; 0 outside the blocks.
    pub fn block(&self) -> u32 {
        if let Stage::Block { number, .. } = self.stage { number } else { 0 }
    }

    /// Time of its end (ns, CLOCK_MONOTONIC); `None` until it is known.
    pub fn ends_ns(&self) -> Option<u64> {
        let fade_ns = (self.schedule.learn.fade_out_s * 1e9).round() as u64;
        if let Stage::Over { from } = self.stage {
            Some(self.time_ns(from) + fade_ns)
        } else {
            None
        }
    }

    /// The next item for the worker thread.
    pub fn returned(&mut self) -> Option<Returned> {
        self.out.iter_mut().find_map(Option::take)
    }

    /// Receives a result; the memory of a result for another run is returned.
    pub fn receive(&mut self, result: IlcResult) {
        let again = matches!(result.outcome, IlcOutcome::Ready { .. }) && self.ready.is_some();
        if result.run_id != self.run_id || again {
            result.memory().for_each(|returned| self.give(returned));
            return;
        }
        match result.outcome {
            IlcOutcome::Ready { done, identified } => {
                self.ready = Some((done, identified));
                self.starts = i64::MIN;
            }
            IlcOutcome::Updated => self.in_flight = self.in_flight.saturating_sub(1),
            IlcOutcome::Failed => {}
        }
        for record in result.records.into_iter().flatten() {
            match self.spare.iter_mut().find(|spare| spare.is_none()) {
                Some(spare) => *spare = Some(record),
                None => self.give(Returned::Record(record)),
            }
        }
        if let Some(reference) = result.reference
            && let Some(older) = self.pending.replace(reference)
        {
            self.give(Returned::Reference(older));
        }
    }

    /// Records the slave's position at a scan (rad or m; NaN where not measured; time in ns,
    /// CLOCK_MONOTONIC), and whether the motor had power.
    pub fn record(&mut self, scan_ns: u64, slave: f64, powered: bool) {
        let step_ns = self.schedule.step_ns as i64;
        let since = scan_ns as i64 - self.origin_ns as i64;
        let step = (since + step_ns / 2).div_euclid(step_ns);
        let on_step = 2 * (since - step * step_ns).unsigned_abs() <= self.schedule.sample_ns;
        for record in [&mut self.current, &mut self.previous].into_iter().flatten() {
            record.record(step, on_step, slave, powered);
        }
    }

    /// Advances to a time (ns, CLOCK_MONOTONIC).
    pub fn advance(&mut self, now_ns: u64) {
        let step = self.step(now_ns);
        // A stage lasts at least a cycle: more than a few changes in one call mean a long pause
        // between calls.
        for _ in 0..4 {
            if !self.next_stage(step) {
                break;
            }
        }
        let grace = self.schedule.grace();
        if self.previous.as_ref().is_some_and(|record| step >= record.end() + grace) {
            self.hand_in();
        }
        self.change(step);
    }

    /// The reference of the axis at a time (ns, CLOCK_MONOTONIC), that of the latest
    /// [`IlcTrials::advance`].
    pub fn at(&self, now_ns: u64) -> Point {
        let learn = &self.schedule.learn;
        let mut point = self.source_at(&self.new, now_ns);
        let changing_s = self.since_s(self.changes, now_ns);
        let change_s = self.schedule.change_s();
        if changing_s < change_s {
            let old = self.source_at(&self.old, now_ns);
            let peak_speed = old.peak_speed.max(point.peak_speed);
            point = old.blend(point, Weight::rising(changing_s, change_s), peak_speed);
        }
        let peak_speed = point.peak_speed;
        if let Stage::Over { from } = self.stage {
            let out = Weight::rising(self.since_s(from, now_ns), learn.fade_out_s);
            point = point.blend(Point::at_rest(learn.centre), out, peak_speed);
        }
        let begun_s = now_ns.saturating_sub(self.begun_ns) as f64 * 1e-9;
        let point = Point::at_rest(self.start).blend(
            point,
            Weight::rising(begun_s, learn.fade_in_s),
            peak_speed,
        );
        // Control derives its feed-forward from acceleration and peak speed: zeros turn it off.
        if learn.feedforward {
            point
        } else {
            Point { acceleration: 0.0, peak_speed: 0.0, ..point }
        }
    }

    fn time_ns(&self, step: i64) -> u64 {
        (self.origin_ns as i64)
            .saturating_add(step.saturating_mul(self.schedule.step_ns as i64))
            .max(0) as u64
    }

    fn step(&self, now_ns: u64) -> i64 {
        (now_ns as i64 - self.origin_ns as i64).div_euclid(self.schedule.step_ns as i64)
    }

    fn since_s(&self, step: i64, now_ns: u64) -> f64 {
        let since_ns = now_ns as i128
            - self.origin_ns as i128
            - i128::from(step) * i128::from(self.schedule.step_ns);
        since_ns as f64 * 1e-9
    }

    /// Enters the next stage if it is due; returns whether it did.
    fn next_stage(&mut self, step: i64) -> bool {
        match self.stage {
            Stage::Waiting => {
                let Some((done, identified)) = self.ready else { return false };
                let cycle = self.schedule.cycle as i64;
                if self.starts == i64::MIN {
                    // At the beginning of the next cycle.
                    self.starts =
                        if step <= 0 { 0 } else { (step + cycle - 1).div_euclid(cycle) * cycle };
                }
                if step < self.starts {
                    return false;
                }
                let from = self.starts;
                if identified {
                    self.begin_block(from, done + 1);
                } else {
                    self.stage = Stage::Identifying { from };
                    self.begin_record(0, from, self.schedule.identifying_steps());
                }
                true
            }
            Stage::Identifying { from } => {
                let end = from + self.schedule.identifying_steps() as i64;
                if step < end {
                    let each = (self.schedule.cycle * IDENTIFYING_CYCLES as usize) as i64;
                    let harmonic = ((step - from) / each) as u32 + 1;
                    let same =
                        matches!(self.new, Source::Sine { harmonic: now } if now == harmonic);
                    if !same {
                        self.follow(
                            Source::Sine { harmonic },
                            from + i64::from(harmonic - 1) * each,
                        );
                    }
                    return false;
                }
                let done = self.ready.map_or(0, |ready| ready.0);
                self.begin_block(end, done + 1);
                true
            }
            Stage::Block { from, number } => {
                let end = from + self.schedule.block_steps() as i64;
                if step < end {
                    return false;
                }
                self.begin_block(end, number + 1);
                true
            }
            Stage::Over { .. } => false,
        }
    }

    fn begin_block(&mut self, from: i64, number: u32) {
        // The grace period has passed: return a record that is still open.
        self.hand_in();
        self.previous = self.current.take();
        if number > self.schedule.learn.blocks {
            self.stage = Stage::Over { from };
            return;
        }
        self.stage = Stage::Block { from, number };
        if matches!(self.new, Source::Sine { .. }) {
            let source = self.pending.take().map_or(Source::Desired, Source::Learnt);
            self.follow(source, from);
        }
        self.begin_record(number, from, self.schedule.block_steps());
    }

    fn begin_record(&mut self, block: u32, from: i64, len: usize) {
        self.current = self.spare.iter_mut().find_map(Option::take);
        if let Some(record) = &mut self.current {
            record.begin(self.run_id, block, from, len);
            record.last = block == self.schedule.learn.blocks;
        }
    }

    /// Returns the previous record to the worker thread.
    fn hand_in(&mut self) {
        if let Some(mut record) = self.previous.take() {
            if self.in_flight > 0 {
                // The update from the block before has not arrived yet.
                record.fault.get_or_insert(Fault::OldReference);
            }
            self.in_flight += 1;
            self.give(Returned::Record(record));
        }
    }

    /// Starts the transition to a pending reference, if there is time left to settle.
    fn change(&mut self, step: i64) {
        if self.pending.is_none() {
            return;
        }
        match self.stage {
            Stage::Block { from, .. } if step - from <= self.schedule.latest_change() => {
                // One transition at a time.
                if step >= self.changes + self.schedule.change_steps() as i64
                    && let Some(reference) = self.pending.take()
                {
                    self.follow(Source::Learnt(reference), step);
                }
            }
            Stage::Block { .. } => {
                if let Some(record) = &mut self.current {
                    record.fault.get_or_insert(Fault::OldReference);
                }
            }
            Stage::Waiting | Stage::Identifying { .. } | Stage::Over { .. } => {}
        }
    }

    fn follow(&mut self, source: Source, from: i64) {
        let older = std::mem::replace(&mut self.new, source);
        if let Source::Learnt(reference) = std::mem::replace(&mut self.old, older) {
            self.give(Returned::Reference(reference));
        }
        self.changes = from;
    }

    fn give(&mut self, returned: Returned) {
        match self.out.iter_mut().find(|place| place.is_none()) {
            Some(place) => *place = Some(returned),
            // The queue is full: leaking memory is better than freeing it in the loop.
            None => std::mem::forget(returned),
        }
    }

    fn source_at(&self, source: &Source, now_ns: u64) -> Point {
        let learn = &self.schedule.learn;
        let since_s = self.since_s(0, now_ns);
        let sine = |amplitude: f64, times: f64| {
            let omega = TAU * learn.frequency_hz * times;
            let (sine, cosine) = (omega * since_s).sin_cos();
            Point {
                position: learn.centre + amplitude * sine,
                velocity: amplitude * omega * cosine,
                acceleration: -amplitude * omega * omega * sine,
                peak_speed: amplitude * omega,
            }
        };
        match source {
            Source::Desired => sine(learn.amplitude, 1.0),
            Source::Sine { harmonic } => match learn.law {
                LearnLaw::ModelBased { identify_amplitude, .. } => {
                    let times = f64::from(*harmonic);
                    sine(identify_amplitude / times.sqrt(), times)
                }
                _ => sine(learn.amplitude, 1.0),
            },
            Source::Learnt(reference) => {
                let step = self.step(now_ns);
                let index = step.rem_euclid(self.schedule.cycle as i64) as usize;
                let Some(point) = reference.points.get(index) else {
                    return Point::at_rest(learn.centre);
                };
                let ahead_s = self.since_s(step, now_ns);
                Point {
                    position: point.position
                        + ahead_s * (point.velocity + 0.5 * ahead_s * point.acceleration),
                    velocity: point.velocity + ahead_s * point.acceleration,
                    ..*point
                }
            }
        }
    }
}
