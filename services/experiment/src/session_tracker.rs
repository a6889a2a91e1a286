//! Follows the sessions of a protocol: sums of effort, the subject's bar, and the target that
//! passes from each session to the next.
//!
//! What it reports depends on the samples and on the times of the segments alone, not on when it is
//! called: each sample counts in the segment in which the card took it.

use std::collections::VecDeque;

use ipc_types::{BARS, EmgMaximum, Light, Performance, SessionOutcome, SessionResult};

use crate::contraction::Contraction;
use crate::matching_bar::{BarValues, Effort, Matched, Sums, heights};
use crate::session_state::{SessionState, SessionStep};

/// Time between two reports of a segment's performance (ns).
pub const REPORT_NS: u64 = 20_000_000;
/// Samples that wait to be counted: 2 s of them.
const WAITING: usize = 4096;
/// Segments' ends that wait for the first sample after them.
const EDGES: usize = 16;
/// Reports that wait to be published, and the most that one step makes.
const REPORTS: usize = 256;
const REPORTS_A_STEP: usize = 64;
/// Most instants of one segment that are made up for after a gap in the samples: 1 s of them. A gap
/// of more than 100 ms starts the segment again, unless only what the sessions match is missing.
const MADE_UP: u64 = 50;
/// A segment's end is believed without a sample after it once it is so long ago (ns).
const GRACE_NS: u64 = 100_000_000;

/// The sessions of a protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SessionPlan {
    /// How many there are.
    pub sessions: u32,
    /// What they match; `None`: there is no bar.
    pub matched: Option<Matched>,
}

/// A segment that is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlayedSegment {
    /// Its index.
    pub segment: u32,
    /// When it began (ns, CLOCK_MONOTONIC).
    pub begun_ns: u64,
    /// Planned duration (s).
    pub planned_s: f64,
    /// Number of the session that it is, from 1.
    pub session: Option<u32>,
    /// Whether it is a rest.
    pub rest: bool,
    /// Inputs of the card whose maximum it measures, one bit each.
    pub contraction: u16,
}

/// What is to be published, or kept for a restart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SessionReport {
    /// The sums and the bar.
    Performance(Performance),
    /// The session of that number begins, in that segment.
    Started(u32, u32),
    /// A session has ended.
    Ended(SessionResult),
    /// A contraction was measured.
    Contracted(EmgMaximum),
    /// A step for [`SessionState::take`], of the run with that number.
    Step(u32, SessionStep),
}

/// The end of a segment.
#[derive(Clone, Copy, Debug)]
struct Edge {
    at_ns: u64,
    outcome: SessionOutcome,
    next: Option<PlayedSegment>,
}

/// What the subject sees between two updates.
#[derive(Clone, Copy, Debug, Default)]
struct Shown {
    update: u32,
    value: [f64; BARS],
    target: [f64; BARS],
    height: [f64; BARS],
    visible: bool,
    replay: bool,
}

/// Follows the sessions of one protocol at a time.
#[derive(Clone, Debug)]
pub struct SessionTracker {
    plan: SessionPlan,
    /// Number of the run of a protocol that is followed.
    run: u32,
    state: SessionState,
    playing: Option<PlayedSegment>,
    /// Instants reported of the segment.
    reported: u64,
    sums: Sums,
    bar: Option<BarValues>,
    contraction: Contraction,
    shown: Shown,
    /// Number of the session that runs or ran last.
    number: u32,
    /// Tick and time of the last sample (ns), and the time between two (ns).
    last: Option<(u64, u64)>,
    period_ns: u64,
    waiting: VecDeque<Effort>,
    edges: VecDeque<Edge>,
    reports: VecDeque<SessionReport>,
    dropped: u64,
}

impl SessionTracker {
    /// Of a protocol without sessions, for samples at `rate_hz`.
    pub fn new(rate_hz: f64) -> Self {
        Self {
            plan: SessionPlan::default(),
            run: 0,
            state: SessionState::with_capacity(),
            playing: None,
            reported: 0,
            sums: Sums::default(),
            bar: None,
            contraction: Contraction::new(rate_hz),
            shown: Shown::default(),
            number: 0,
            last: None,
            period_ns: 0,
            waiting: VecDeque::with_capacity(WAITING),
            edges: VecDeque::with_capacity(EDGES),
            reports: VecDeque::with_capacity(REPORTS),
            dropped: 0,
        }
    }

    /// Follows another run of a protocol, after what is left of the one before; `run` is its number
    /// and `state` that of one that is resumed.
    pub fn begin(&mut self, run: u32, plan: SessionPlan, state: Option<&SessionState>) {
        self.advance(u64::MAX - GRACE_NS);
        self.dropped += self.edges.len() as u64;
        (self.run, self.plan) = (run, plan);
        self.state.copy_from(state.unwrap_or(&SessionState::default()));
        self.number = self.state.over;
        self.playing = None;
        self.shown = Shown::default();
        self.sums = Sums::default();
        self.last = None;
        self.edges.clear();
        self.waiting.clear();
    }

    /// Whether the protocol has sessions; otherwise nothing is counted.
    pub const fn is_used(&self) -> bool {
        self.plan.sessions > 0
    }

    /// How many sessions the protocol has.
    pub const fn sessions(&self) -> u32 {
        self.plan.sessions
    }

    /// The sessions so far.
    pub const fn state(&self) -> &SessionState {
        &self.state
    }

    /// Reports and samples that were lost, as there was no room for them.
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Takes a sample; it is counted by [`SessionTracker::advance`], but for one without what the
    /// sessions match, which counts as missing.
    pub fn see(&mut self, effort: Effort) {
        let unused = self.plan.matched.is_some_and(|matched| !matched.is_in(&effort));
        if !self.is_used() || unused || (self.playing.is_none() && self.edges.is_empty()) {
            return;
        }
        if self.waiting.len() == WAITING {
            // The newest is left out, so that those that wait stay in order; the gap counts as
            // missing samples of the session.
            self.dropped += 1;
            return;
        }
        self.waiting.push_back(effort);
    }

    /// Takes the end of a segment at `at_ns`, and the segment that follows it, if any.
    pub fn pass_edge(&mut self, at_ns: u64, outcome: SessionOutcome, next: Option<PlayedSegment>) {
        if !self.is_used() {
            return;
        }
        if self.edges.len() == EDGES {
            self.dropped += 1;
            return;
        }
        self.edges.push_back(Edge { at_ns, outcome, next });
    }

    /// Counts the samples up to `now_ns` (CLOCK_MONOTONIC). Every segment's end up to then must
    /// have been taken.
    pub fn advance(&mut self, now_ns: u64) {
        while self.reports.len() + REPORTS_A_STEP <= REPORTS {
            let effort = self.waiting.front().copied();
            let edge = self.edges.front().copied().filter(|edge| match effort {
                Some(effort) => effort.at_ns >= edge.at_ns,
                None => edge.at_ns + GRACE_NS <= now_ns,
            });
            if let Some(edge) = edge {
                self.edges.pop_front();
                self.turn(&edge);
            } else if let Some(effort) = effort.filter(|effort| effort.at_ns <= now_ns) {
                self.waiting.pop_front();
                self.count(&effort);
            } else {
                break;
            }
        }
    }

    /// Takes the oldest report.
    pub fn take_report(&mut self) -> Option<SessionReport> {
        self.reports.pop_front()
    }

    fn report(&mut self, report: SessionReport) {
        if self.reports.len() == REPORTS {
            self.dropped += 1;
            return;
        }
        self.reports.push_back(report);
    }

    fn step(&mut self, step: SessionStep) {
        self.state.take(step);
        self.report(SessionReport::Step(self.run, step));
    }

    fn count(&mut self, effort: &Effort) {
        if let Some(playing) = self.playing.filter(|playing| effort.at_ns >= playing.begun_ns) {
            self.report_until(&playing, effort.at_ns);
            if playing.session.is_some() {
                self.sums.missed += self.missing_before(effort, playing.begun_ns, effort.at_ns);
                self.sums.add(effort);
                self.contraction.take(playing.contraction, &effort.rectified);
            }
        }
        if let Some((tick, at_ns)) = self.last.filter(|(tick, _)| effort.tick > *tick) {
            self.period_ns = effort.at_ns.saturating_sub(at_ns) / (effort.tick - tick);
        }
        self.last = Some((effort.tick, effort.at_ns));
    }

    /// Samples that are missing between the last one and the next, and were due from `from_ns` on
    /// and before `until_ns`.
    fn missing_before(&self, next: &Effort, from_ns: u64, until_ns: u64) -> u64 {
        let Some((tick, at_ns)) = self.last else { return 0 };
        let steps = next.tick.saturating_sub(tick);
        if steps < 2 || next.at_ns <= at_ns {
            return 0;
        }
        let period_ns = (next.at_ns - at_ns) as f64 / steps as f64;
        // The steps, from the last sample, that are due before a time.
        let before = |time_ns: u64| {
            let steps_before = (time_ns as f64 - at_ns as f64) / period_ns;
            ((steps_before - 1e-6).ceil() - 1.0).clamp(0.0, (steps - 1) as f64) as u64
        };
        before(until_ns).saturating_sub(before(from_ns))
    }

    /// Samples of a session that are missing before its end: up to the next sample, or, where none
    /// has come, at the usual distance.
    fn missing_at_end(&self, playing: &PlayedSegment, ended_ns: u64) -> u64 {
        let Some((tick, at_ns)) = self.last else { return 0 };
        let next = self.waiting.front().copied().or_else(|| {
            let steps = ended_ns.saturating_sub(at_ns).checked_div(self.period_ns)? + 1;
            let (tick, at_ns) = (tick + steps, at_ns + steps * self.period_ns);
            Some(Effort { tick, at_ns, ..Effort::default() })
        });
        next.map_or(0, |next| self.missing_before(&next, playing.begun_ns, ended_ns))
    }

    /// Ends the segment, and begins the next.
    fn turn(&mut self, edge: &Edge) {
        if let Some(playing) = self.playing {
            if edge.outcome == SessionOutcome::Whole {
                self.report_until(&playing, edge.at_ns);
                self.report_planned_end(&playing, edge.at_ns);
            }
            if let Some(number) = playing.session {
                self.sums.missed += self.missing_at_end(&playing, edge.at_ns);
                self.end_session(&playing, number, edge);
            }
        }
        let before = std::mem::replace(&mut self.playing, edge.next);
        self.reported = 0;
        let Some(next) = edge.next else {
            // No further sample belongs to the protocol, and the bar vanishes.
            self.waiting.clear();
            self.shown = Shown::default();
            // Also where a protocol that is resumed ends before it goes on: its light was green.
            let over = PlayedSegment {
                segment: before.map_or(0, |playing| playing.segment),
                begun_ns: before.map_or(edge.at_ns, |playing| playing.begun_ns),
                planned_s: before.map_or(0.0, |playing| playing.planned_s),
                session: None,
                rest: false,
                contraction: 0,
            };
            self.report_performance(&over, edge.at_ns);
            return;
        };
        if let Some(number) = next.session {
            self.sums = Sums::default();
            self.bar = self.plan.matched.map(BarValues::new);
            self.number = number;
            self.contraction.begin();
            self.shown = Shown {
                target: self.state.target,
                visible: self.plan.matched.is_some() && self.state.has_target(),
                ..Shown::default()
            };
            self.report(SessionReport::Started(number, next.segment));
            self.step(SessionStep::Begun);
        } else if next.rest {
            self.shown = Shown::default();
        }
    }

    fn end_session(&mut self, playing: &PlayedSegment, number: u32, edge: &Edge) {
        let mean = self.plan.matched.map_or([0.0; BARS], |matched| matched.mean(&self.sums));
        self.report(SessionReport::Ended(SessionResult {
            begun_ns: playing.begun_ns,
            ended_ns: edge.at_ns,
            planned_s: playing.planned_s,
            torque_sum: self.sums.torque,
            emg_sum: self.sums.activity,
            samples: self.sums.samples,
            samples_missed: self.sums.missed,
            value: mean,
            target: self.state.target,
            segment: playing.segment,
            number,
            sessions: self.plan.sessions,
            outcome: edge.outcome.code(),
            bars: self.plan.matched.map_or(0, |matched| matched.bars() as u8),
            ..SessionResult::default()
        }));
        if edge.outcome == SessionOutcome::Whole {
            // Before the session's end: what follows the end is complete.
            self.end_contraction(playing, number, edge.at_ns);
            self.step(SessionStep::Over(number, mean));
        }
    }

    /// Reports the maxima of a contraction that was whole.
    fn end_contraction(&mut self, playing: &PlayedSegment, number: u32, ended_ns: u64) {
        if playing.contraction == 0 {
            return;
        }
        let maximum = self.contraction.maxima();
        self.step(SessionStep::Contracted(maximum));
        self.report(SessionReport::Contracted(EmgMaximum {
            begun_ns: playing.begun_ns,
            ended_ns,
            maximum,
            segment: playing.segment,
            number,
            inputs: playing.contraction,
            ..EmgMaximum::default()
        }));
    }

    /// Reports every instant of the segment's grid up to a time.
    fn report_until(&mut self, playing: &PlayedSegment, until_ns: u64) {
        // The first instant is one period after the beginning, but for a rest, which shows its bar
        // from the beginning on.
        let due = until_ns.saturating_sub(playing.begun_ns) / REPORT_NS;
        let first = if playing.rest { 0 } else { 1 };
        let from = (first + self.reported).max((due + 1).saturating_sub(MADE_UP));
        for instant in from..=due {
            self.update_bar(playing, instant);
            self.report_performance(playing, playing.begun_ns + instant * REPORT_NS);
            self.reported = instant + 1 - first;
        }
    }

    /// Reports the instant of the planned end at the end, where the scanner's clock made a session
    /// end a little earlier: the last update of its bar belongs to it.
    fn report_planned_end(&mut self, playing: &PlayedSegment, ended_ns: u64) {
        let planned = (1e9 * playing.planned_s / REPORT_NS as f64).round() as u64;
        if playing.session.is_none() || self.reported >= planned {
            return;
        }
        self.update_bar(playing, planned);
        self.report_performance(playing, ended_ns);
        self.reported = planned;
    }

    /// Updates the bar where one is due at the `instant` of the segment's grid.
    fn update_bar(&mut self, playing: &PlayedSegment, instant: u64) {
        let Some(matched) = self.plan.matched else { return };
        let instants = matched.period_ns() / REPORT_NS;
        if !instant.is_multiple_of(instants) {
            return;
        }
        let update = instant / instants;
        if playing.session.is_some() {
            let Some(value) = self.bar.as_mut().map(|bar| bar.update(&self.sums)) else { return };
            self.step(SessionStep::Update(value));
            self.shown.update = update as u32;
            self.shown.value = value;
            if self.shown.visible {
                self.shown.height = heights(value, self.shown.target);
            }
        } else if playing.rest && self.state.has_target() {
            self.shown = match self.state.repeated(update as usize) {
                Some((value, height)) => Shown {
                    update: update as u32 + 1,
                    value,
                    target: self.state.repeated_target,
                    height,
                    visible: true,
                    replay: true,
                },
                None => Shown::default(),
            };
        }
    }

    /// Reports the sums and what the subject sees, at an instant of the segment.
    fn report_performance(&mut self, playing: &PlayedSegment, at_ns: u64) {
        let light = if playing.session.is_some() { Light::Green } else { Light::Red };
        let bars = self.plan.matched.filter(|_| self.shown.visible).map_or(0, Matched::bars);
        self.report(SessionReport::Performance(Performance {
            at_ns,
            begun_ns: playing.begun_ns,
            planned_s: playing.planned_s,
            torque_sum: self.sums.torque,
            emg_sum: self.sums.activity,
            samples: self.sums.samples,
            samples_missed: self.sums.missed,
            value: self.shown.value,
            target: self.shown.target,
            height: self.shown.height,
            segment: playing.segment,
            number: self.number,
            sessions: self.plan.sessions,
            update: self.shown.update,
            bars: bars as u8,
            light: light.code(),
            replay: u8::from(self.shown.replay),
            ..Performance::default()
        }));
    }
}
