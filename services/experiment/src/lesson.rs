//! A movement that is being learnt, as the real-time loop plays it: which reference is followed
//! when, and where the slave was.
//!
//! ```text
//! fade in ─> [a sine for each harmonic, three cycles each] ─> block 1 ─> block 2 ─> ... ─> fade out
//!                       │ the slave's path                      │ the slave's path  ^
//!                       v                                       v                   │ a better reference
//!                    teacher ─────────────────────────────── teacher ───────────────┘
//! ```
//!
//! What takes time is done by the [`crate::teacher`], elsewhere. The lesson never waits for it:
//! while the teacher thinks, the old reference goes on. The new one takes its place in the first
//! settling cycle of the next block, by a minimum-jerk change of half a cycle, so that control
//! never sees a jump. A reference that comes too late for that waits for the block after, and the
//! block between is not learnt from.
//!
//! **Time.** Step 0 of the cycle is a multiple of the control period on CLOCK_MONOTONIC, as the
//! card's scans are: the slave's position at a step is that of the scan at the step's own time, and
//! the reference is meant for the same instant. Neither the lateness of a loop nor the way of a
//! setpoint to control enters the error.
//!
//! Nothing here allocates or frees: references and records come from the teacher, and go back to
//! it.

use std::f64::consts::TAU;

use learning::ReferencePoint;
use rig::protocol::{IDENTIFYING_CYCLES, Learn, LearnLaw};

use rig::protocol::trajectory::{Point, Weight};

/// A reference to follow: one cycle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reference {
    /// Where the master is to be, step by step.
    pub points: Vec<ReferencePoint>,
    /// Highest speed of it (rad/s or m/s).
    pub peak_speed: f64,
}

/// The slave's path over a block, or over the identification.
#[derive(Clone, Debug, PartialEq)]
pub struct Take {
    /// The lesson that it is of.
    pub ticket: u32,
    /// Number of the block, from 1; 0 for the identification.
    pub block: u32,
    /// First step.
    from: i64,
    /// Steps.
    len: usize,
    /// The slave's position at each step (rad or m); not a number where it was not measured.
    pub slave: Vec<f64>,
    /// Why nothing can be learnt from it.
    pub fault: Option<Fault>,
    /// Whether it is the last one.
    pub last: bool,
}

/// Why nothing can be learnt from a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The motor had no power for a part of it.
    NoPower,
    /// It was played with an older reference than the one that was learnt.
    OldReference,
}

impl Take {
    /// An empty one for the longest record of a lesson.
    pub fn new(timetable: &Timetable) -> Self {
        let steps = timetable.block_steps().max(timetable.identifying_steps());
        Self {
            ticket: 0,
            block: 0,
            from: 0,
            len: 0,
            slave: vec![f64::NAN; steps],
            fault: None,
            last: false,
        }
    }

    /// The slave's positions at the steps of the record (rad or m).
    pub fn path(&self) -> &[f64] {
        &self.slave[..self.len.min(self.slave.len())]
    }

    /// Empties it.
    pub fn clear(&mut self) {
        self.slave.fill(f64::NAN);
        (self.fault, self.last, self.len, self.ticket) = (None, false, 0, 0);
    }

    fn begin(&mut self, ticket: u32, block: u32, from: i64, len: usize) {
        (self.ticket, self.block, self.from, self.len) = (ticket, block, from, len);
    }

    fn end(&self) -> i64 {
        self.from + self.len as i64
    }

    fn record(&mut self, step: i64, on_step: bool, slave: f64, powered: bool) {
        if step < self.from || step >= self.end() {
            return;
        }
        if !powered {
            self.fault.get_or_insert(Fault::NoPower);
        }
        if on_step && let Some(value) = self.slave.get_mut((step - self.from) as usize) {
            *value = slave;
        }
    }
}

/// The times of a lesson on one machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Timetable {
    /// What is learnt.
    pub learn: Learn,
    /// Control steps in a cycle.
    pub cycle: usize,
    /// Period of control (ns).
    pub step_ns: u64,
    /// Period of the samples (ns).
    pub sample_ns: u64,
}

impl Timetable {
    /// Steps in a block.
    pub fn block_steps(&self) -> usize {
        self.cycle * self.learn.cycles_per_block as usize
    }

    /// Steps of the identification.
    pub fn identifying_steps(&self) -> usize {
        self.cycle * self.learn.identifying_cycles() as usize
    }

    /// Steps in which one reference takes the place of another.
    pub fn change_steps(&self) -> usize {
        self.cycle / 2
    }

    /// The same (s).
    pub fn change_s(&self) -> f64 {
        self.change_steps() as f64 * self.step_ns as f64 * 1e-9
    }

    /// Latest step of a block at which its reference may begin to change: a quarter of a cycle is
    /// left to settle.
    fn latest_change(&self) -> i64 {
        (self.cycle * self.learn.settling_cycles as usize - self.change_steps() - self.cycle / 4)
            as i64
    }

    /// How long a record is left open after its end, for samples that come late (steps).
    fn grace(&self) -> i64 {
        (self.cycle / 16).clamp(1, 10) as i64
    }
}

/// What the teacher says.
#[derive(Clone, Debug)]
pub enum Lecture {
    /// The lesson can begin.
    Ready {
        /// The lesson.
        ticket: u32,
        /// Two empty records.
        takes: [Box<Take>; 2],
        /// What to begin with; `None`: the movement itself.
        reference: Option<Box<Reference>>,
        /// Blocks that were done before.
        done: u32,
        /// Whether the response is known, or need not be.
        identified: bool,
    },
    /// A record was looked at.
    Marked {
        /// The lesson.
        ticket: u32,
        /// The record, emptied.
        take: Box<Take>,
        /// A better reference.
        reference: Option<Box<Reference>>,
    },
    /// The lesson cannot go on: it is to be stopped.
    Failed {
        /// The lesson.
        ticket: u32,
    },
}

/// What the reference is.
#[derive(Clone, Debug)]
enum Source {
    /// The movement that the slave is to make.
    Desired,
    /// A sine of the identification.
    Sine { harmonic: u32 },
    /// A learnt one.
    Learnt(Box<Reference>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// Fading in, or waiting for the teacher.
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

/// Things that are to go back to the teacher: at most so many come up in one step.
pub const SPENT: usize = 8;

/// What is to go back to the teacher.
#[derive(Clone, Debug)]
pub enum Spent {
    /// A record to learn from.
    Take(Box<Take>),
    /// A reference that is no longer followed.
    Reference(Box<Reference>),
}

/// A lesson as it is played.
#[derive(Clone, Debug)]
pub struct Lesson {
    ticket: u32,
    timetable: Timetable,
    start: f64,
    begun_ns: u64,
    origin_ns: u64,
    stage: Stage,
    /// Blocks done before and whether the response is known, once the teacher is ready; and the
    /// step at which it then begins.
    ready: Option<(u32, bool)>,
    starts: i64,
    old: Source,
    new: Source,
    changes: i64,
    pending: Option<Box<Reference>>,
    current: Option<Box<Take>>,
    previous: Option<Box<Take>>,
    spare: [Option<Box<Take>>; 2],
    in_flight: u32,
    out: [Option<Spent>; SPENT],
}

impl Lesson {
    /// A lesson that begins at `begun_ns` (CLOCK_MONOTONIC) with the axis at rest at `start` (rad
    /// or m).
    pub fn new(ticket: u32, timetable: &Timetable, start: f64, begun_ns: u64) -> Self {
        let learn = &timetable.learn;
        let faded_ns = begun_ns + (learn.fade_in_s * 1e9).round() as u64;
        let step_ns = timetable.step_ns.max(1);
        Self {
            ticket,
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
            out: [const { None }; SPENT],
            // Names are not copied: this is a real-time loop.
            timetable: Timetable {
                learn: Learn { save: None, load: None, ..*learn },
                cycle: timetable.cycle,
                step_ns,
                sample_ns: timetable.sample_ns,
            },
        }
    }

    /// Its number.
    pub fn ticket(&self) -> u32 {
        self.ticket
    }

    /// The block that is being played, from 1; 0 outside of the blocks.
    pub fn block(&self) -> u32 {
        if let Stage::Block { number, .. } = self.stage { number } else { 0 }
    }

    /// When it ends (ns, CLOCK_MONOTONIC); `None` while nobody knows.
    pub fn ends_ns(&self) -> Option<u64> {
        let fade_ns = (self.timetable.learn.fade_out_s * 1e9).round() as u64;
        if let Stage::Over { from } = self.stage {
            Some(self.time_ns(from) + fade_ns)
        } else {
            None
        }
    }

    /// Something for the teacher.
    pub fn spent(&mut self) -> Option<Spent> {
        self.out.iter_mut().find_map(Option::take)
    }

    /// Takes in what the teacher says; what it gave for another lesson goes back.
    pub fn take_in(&mut self, lecture: Lecture) {
        match lecture {
            Lecture::Ready { ticket, takes, reference, done, identified } => {
                let [first, second] = takes;
                if ticket != self.ticket || self.ready.is_some() {
                    self.give_back(reference);
                    self.give(Spent::Take(first));
                    self.give(Spent::Take(second));
                    return;
                }
                self.ready = Some((done, identified));
                self.spare = [Some(first), Some(second)];
                self.pending = reference;
                self.starts = i64::MIN;
            }
            Lecture::Marked { ticket, take, reference } => {
                if ticket != self.ticket {
                    self.give_back(reference);
                    self.give(Spent::Take(take));
                    return;
                }
                self.in_flight = self.in_flight.saturating_sub(1);
                match self.spare.iter_mut().find(|spare| spare.is_none()) {
                    Some(spare) => *spare = Some(take),
                    None => self.give(Spent::Take(take)),
                }
                if reference.is_some() {
                    let older = std::mem::replace(&mut self.pending, reference);
                    self.give_back(older);
                }
            }
            Lecture::Failed { .. } => {}
        }
    }

    /// Takes in where the slave was (rad or m; not a number where it was not measured) at a scan
    /// (ns, CLOCK_MONOTONIC), and whether the motor had power.
    pub fn record(&mut self, scan_ns: u64, slave: f64, powered: bool) {
        let step_ns = self.timetable.step_ns as i64;
        let since = scan_ns as i64 - self.origin_ns as i64;
        let step = (since + step_ns / 2).div_euclid(step_ns);
        let on_step = 2 * (since - step * step_ns).unsigned_abs() <= self.timetable.sample_ns;
        for take in [&mut self.current, &mut self.previous].into_iter().flatten() {
            take.record(step, on_step, slave, powered);
        }
    }

    /// Goes on to a time (ns, CLOCK_MONOTONIC).
    pub fn advance(&mut self, now_ns: u64) {
        let step = self.step(now_ns);
        // A stage is never shorter than a cycle: more than a few in one go means that nobody called
        // for long.
        for _ in 0..4 {
            if !self.next_stage(step) {
                break;
            }
        }
        let grace = self.timetable.grace();
        if self.previous.as_ref().is_some_and(|take| step >= take.end() + grace) {
            self.hand_in();
        }
        self.change(step);
    }

    /// The axis at a time (ns, CLOCK_MONOTONIC), that of the newest [`Lesson::advance`].
    pub fn at(&self, now_ns: u64) -> Point {
        let learn = &self.timetable.learn;
        let mut point = self.source_at(&self.new, now_ns);
        let changing_s = self.since_s(self.changes, now_ns);
        let change_s = self.timetable.change_s();
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
        // Control's feed-forward is of the acceleration and of the share of the peak speed: where
        // they are 0, it is none.
        if learn.feedforward {
            point
        } else {
            Point { acceleration: 0.0, peak_speed: 0.0, ..point }
        }
    }

    fn time_ns(&self, step: i64) -> u64 {
        (self.origin_ns as i64)
            .saturating_add(step.saturating_mul(self.timetable.step_ns as i64))
            .max(0) as u64
    }

    fn step(&self, now_ns: u64) -> i64 {
        (now_ns as i64 - self.origin_ns as i64).div_euclid(self.timetable.step_ns as i64)
    }

    fn since_s(&self, step: i64, now_ns: u64) -> f64 {
        let since_ns = now_ns as i128
            - self.origin_ns as i128
            - i128::from(step) * i128::from(self.timetable.step_ns);
        since_ns as f64 * 1e-9
    }

    /// Whether the stage has changed.
    fn next_stage(&mut self, step: i64) -> bool {
        match self.stage {
            Stage::Waiting => {
                let Some((done, identified)) = self.ready else { return false };
                let cycle = self.timetable.cycle as i64;
                if self.starts == i64::MIN {
                    // With the cycle that begins next.
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
                    self.take_down(0, from, self.timetable.identifying_steps());
                }
                true
            }
            Stage::Identifying { from } => {
                let end = from + self.timetable.identifying_steps() as i64;
                if step < end {
                    let each = (self.timetable.cycle * IDENTIFYING_CYCLES as usize) as i64;
                    let harmonic = ((step - from) / each) as u32 + 1;
                    if !matches!(self.new, Source::Sine { harmonic: playing } if playing == harmonic)
                    {
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
                let end = from + self.timetable.block_steps() as i64;
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
        // The settling cycles have passed: what is still open is handed in now.
        self.hand_in();
        self.previous = self.current.take();
        if number > self.timetable.learn.blocks {
            self.stage = Stage::Over { from };
            return;
        }
        self.stage = Stage::Block { from, number };
        if matches!(self.new, Source::Sine { .. }) {
            let source = self.pending.take().map_or(Source::Desired, Source::Learnt);
            self.follow(source, from);
        }
        self.take_down(number, from, self.timetable.block_steps());
    }

    fn take_down(&mut self, block: u32, from: i64, len: usize) {
        self.current = self.spare.iter_mut().find_map(Option::take);
        if let Some(take) = &mut self.current {
            take.begin(self.ticket, block, from, len);
            take.last = block == self.timetable.learn.blocks;
        }
    }

    /// Gives the record before the present one to the teacher.
    fn hand_in(&mut self) {
        if let Some(mut take) = self.previous.take() {
            if self.in_flight > 0 {
                // The teacher has not even said what the block before came to.
                take.fault.get_or_insert(Fault::OldReference);
            }
            self.in_flight += 1;
            self.give(Spent::Take(take));
        }
    }

    /// Begins to follow a reference that waits, if there is time to settle.
    fn change(&mut self, step: i64) {
        if self.pending.is_none() {
            return;
        }
        match self.stage {
            Stage::Block { from, .. } if step - from <= self.timetable.latest_change() => {
                // One change at a time.
                if step >= self.changes + self.timetable.change_steps() as i64
                    && let Some(reference) = self.pending.take()
                {
                    self.follow(Source::Learnt(reference), step);
                }
            }
            Stage::Block { .. } => {
                if let Some(take) = &mut self.current {
                    take.fault.get_or_insert(Fault::OldReference);
                }
            }
            Stage::Waiting | Stage::Identifying { .. } | Stage::Over { .. } => {}
        }
    }

    fn follow(&mut self, source: Source, from: i64) {
        let older = std::mem::replace(&mut self.new, source);
        if let Source::Learnt(reference) = std::mem::replace(&mut self.old, older) {
            self.give(Spent::Reference(reference));
        }
        self.changes = from;
    }

    fn give_back(&mut self, reference: Option<Box<Reference>>) {
        if let Some(reference) = reference {
            self.give(Spent::Reference(reference));
        }
    }

    fn give(&mut self, spent: Spent) {
        match self.out.iter_mut().find(|place| place.is_none()) {
            Some(place) => *place = Some(spent),
            // Nobody fetches them: to lose memory is better than to free it in the loop.
            None => std::mem::forget(spent),
        }
    }

    fn source_at(&self, source: &Source, now_ns: u64) -> Point {
        let learn = &self.timetable.learn;
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
                let index = step.rem_euclid(self.timetable.cycle as i64) as usize;
                let Some(point) = reference.points.get(index) else {
                    return Point::at_rest(learn.centre);
                };
                let ahead_s = self.since_s(step, now_ns);
                Point {
                    position: point.position
                        + ahead_s * (point.velocity + 0.5 * ahead_s * point.acceleration),
                    velocity: point.velocity + ahead_s * point.acceleration,
                    acceleration: point.acceleration,
                    peak_speed: reference.peak_speed,
                }
            }
        }
    }
}
