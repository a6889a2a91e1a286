//! Plays a protocol: a state machine that takes the time as an argument.
//!
//! ```text
//! Idle ──start──> Playing ──end of the last segment──> Holding ──0.5 s──> Idle, passive
//!                 │  ^ │                                 ^
//!                 │  │ └─stop──> Stopping ──0.5 s────────┘
//!                 │  ├─ no range found, or a segment beyond it ──> Idle, passive
//!                 │  └─ stalled longer than the lease: the segment again, from where the handle is
//!                 │     (Idle, passive, where the protocol does not go on after a restart)
//!                 └─ a rest is 0 V already: stop and end go to passive at once
//! ```
//!
//! Each [`Player::step`] returns the setpoint for its instant, with a lease: when the process that
//! publishes it dies, control ramps to hold by itself. After a restart, [`Player::resume`] starts
//! the interrupted segment again, from where the handle then is.

mod axis_homing;
mod change;
mod homing;
mod ilc;
mod ilc_job;
mod measured_segments;
mod playing;
mod program;
mod reports;
mod scanner_wait;
mod setpoint;
mod supervision;

use std::collections::VecDeque;
use std::sync::Arc;

use ipc_types::{AXES, ExperimentAnswer, Setpoint, Zeros};

use crate::ilc_trial::IlcTrials;
use crate::range_finder::RangeFinder;
use crate::scan_tracker::ScanTracker;
use crate::state::PlayerState;

use axis_homing::PendingOrder;
pub use change::Change;
use change::End;
pub use ilc_job::IlcJob;
use ilc_job::JOBS;
pub use program::Program;
pub use reports::{Notice, Reason};
pub use supervision::Permission;
use supervision::{Supervision, Verdict};

/// Lease of a setpoint (ns). A longer pause between two steps starts the segment again.
pub const LEASE_NS: u64 = 100_000_000;
/// How long a client may be silent before its protocol ends (ns).
pub const CLIENT_LEASE_NS: u64 = 2_000_000_000;
/// Time from a stop to rest (ns).
const STOP_FADE_NS: u64 = 500_000_000;
/// How long the handle is held after the end, before 0 V (ns).
const HOLD_NS: u64 = 500_000_000;

/// The result of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// The setpoint, whose identity and sequence the publisher fills in; `None` before the first
    /// protocol.
    pub setpoint: Option<Setpoint>,
    /// The change of state; the caller publishes it as an event and saves the state.
    pub change: Option<Change>,
}

/// Why a saved state cannot be resumed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ResumeError {
    /// No protocol was running when it was saved.
    #[error("no protocol was running when the state was saved; start a protocol")]
    NotRunning,
    /// It belongs to another protocol text.
    #[error(
        "the state is of the protocol {expected:016x}, the text given is {found:016x}; resume \
            with the text in the state"
    )]
    OtherProtocol {
        /// Identity in the state.
        expected: u64,
        /// Identity of the program.
        found: u64,
    },
    /// It names a segment that the protocol does not have.
    #[error("the state names segment {found}, the protocol has {segments}; start it anew")]
    NoSegment {
        /// Index in the state.
        found: u32,
        /// Number of segments.
        segments: usize,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// No protocol is running; the output is 0 V.
    Idle,
    /// The segment begins with the next step, which brings the measured position.
    Entering { segment: usize, change: Change },
    /// Playing since `begun_ns`.
    Playing { segment: usize, begun_ns: u64 },
    /// Blending from the running segment to rest at `hold`.
    Stopping { segment: usize, begun_ns: u64, stopped_ns: u64 },
    /// At rest under power.
    Holding { segment: usize, since_ns: u64 },
}

/// Plays one protocol at a time.
#[derive(Clone, Debug)]
pub struct Player {
    program: Option<Arc<Program>>,
    phase: Phase,
    /// Where each axis rests, or where the running segment found it (rad or m).
    rest: [f64; AXES],
    /// Where each axis was when the stop was requested (rad or m).
    hold: [f64; AXES],
    /// How to end the protocol in the next step.
    end: Option<End>,
    /// The enable epoch and the client lease that the protocol depends on.
    supervision: Supervision,
    /// A resumed protocol waits for its permission and its client.
    waiting: bool,
    last_ns: Option<u64>,
    completed: bool,
    permission_lost: bool,
    segment: u32,
    elapsed_s: f64,
    /// By how much the segments so far were shorter than planned (s): a range search ends early.
    early_s: f64,
    /// Positions of the slaves' encoders (rad or m); NaN for an axis without one.
    handles: [f64; AXES],
    /// The search for the ends of an axis in the segment that is played.
    finder: Option<RangeFinder>,
    /// The last beat, and when its segment began.
    beat: (u64, u32),
    notice: Option<Notice>,
    /// When the last segment ended that ran to its end.
    last_edge_ns: u64,
    /// The zeros of the newest sample, and the order for new ones.
    zeros: Option<Zeros>,
    pending_order: Option<PendingOrder>,
    scan: ScanTracker,
    ilc: Option<IlcTrials>,
    run_ids: u32,
    jobs: VecDeque<IlcJob>,
}

impl Default for Player {
    /// An idle player.
    fn default() -> Self {
        Self {
            program: None,
            phase: Phase::Idle,
            rest: [0.0; AXES],
            hold: [0.0; AXES],
            end: None,
            supervision: Supervision::new(0, false),
            waiting: false,
            last_ns: None,
            completed: false,
            permission_lost: false,
            segment: 0,
            elapsed_s: 0.0,
            early_s: 0.0,
            handles: [f64::NAN; AXES],
            finder: None,
            beat: (0, 0),
            notice: None,
            last_edge_ns: 0,
            zeros: None,
            pending_order: None,
            scan: ScanTracker::default(),
            ilc: None,
            run_ids: 0,
            jobs: VecDeque::with_capacity(JOBS),
        }
    }
}

impl Player {
    /// Whether a protocol is running; the fade after a stop and the final hold do not count.
    pub fn is_running(&self) -> bool {
        matches!(self.phase, Phase::Entering { .. } | Phase::Playing { .. })
    }

    /// Whether a step is due even without samples: to end a protocol, and to request 0 V after it.
    pub fn is_ending(&self) -> bool {
        self.end.is_some() || !self.is_running()
    }

    /// The enable epoch that the protocol belongs to.
    pub const fn epoch(&self) -> u64 {
        self.supervision.epoch()
    }

    /// The protocol that is or was played.
    pub fn program(&self) -> Option<&Arc<Program>> {
        self.program.as_ref()
    }

    /// Starts a protocol with the next step, in the watchdog's enable `epoch`, or continues one
    /// that was interrupted. Replaces a running protocol: check [`Player::is_running`] first.
    pub fn start(&mut self, program: Arc<Program>, epoch: u64) {
        self.supervision = Supervision::new(epoch, false);
        self.scan.clear();
        let first = program.first_segment();
        let change = program.continues().map_or(Change::Started, |_| Change::Continued(first));
        self.enter(program, first as usize, change);
    }

    /// Resumes a saved state at the beginning of its segment, or ends it in the next step where the
    /// protocol does not go on after a restart, once [`Player::supervise`] has seen
    /// that the motor is still enabled in the same epoch and that the client is still there.
    ///
    /// # Errors
    /// [`ResumeError`] if the state does not belong to the program; nothing is changed then.
    pub fn resume(
        &mut self,
        state: &PlayerState,
        program: Arc<Program>,
    ) -> Result<(), ResumeError> {
        if !state.running {
            return Err(ResumeError::NotRunning);
        }
        if state.protocol != program.identity {
            return Err(ResumeError::OtherProtocol {
                expected: state.protocol,
                found: program.identity,
            });
        }
        let segment = state.segment as usize;
        if segment >= program.steps.len() {
            return Err(ResumeError::NoSegment {
                found: state.segment,
                segments: program.steps.len(),
            });
        }
        self.supervision = Supervision::new(state.epoch, true);
        self.scan = ScanTracker::resume(state.scan, program.scan.pulses.clone());
        let end = (!program.resumes).then_some(End::Restarted);
        self.enter(program, segment, Change::Resumed(state.segment));
        (self.waiting, self.end) = (true, end);
        Ok(())
    }

    fn enter(&mut self, program: Arc<Program>, segment: usize, change: Change) {
        self.end_ilc();
        self.program = Some(program);
        self.phase = Phase::Entering { segment, change };
        (self.end, self.waiting, self.early_s, self.pending_order) = (None, false, 0.0, None);
        (self.completed, self.permission_lost) = (false, false);
        self.last_ns = None;
        self.segment = segment as u32;
    }

    /// Stops with the next step: the movement fades to rest, the handle is held, then the output
    /// goes to 0 V. Does nothing if no protocol is running.
    pub fn stop(&mut self) {
        if self.is_running() {
            self.end.get_or_insert(End::Stop);
        }
    }

    /// Checks, before a step, whether the protocol may go on: the watchdog's `permission`, and the
    /// time at which the client last renewed its lease (ns, CLOCK_MONOTONIC; 0: not yet). Without
    /// permission the protocol ends at once; without its client it fades to rest first.
    pub fn supervise(&mut self, now_ns: u64, permission: Permission, renewed_ns: u64) {
        if self.phase == Phase::Idle {
            return;
        }
        let verdict = self.supervision.check(now_ns, permission, renewed_ns, CLIENT_LEASE_NS);
        self.waiting = verdict == Verdict::Wait;
        match verdict {
            Verdict::PermissionLost => self.end = Some(End::PermissionLost),
            Verdict::ClientGone if self.is_running() => {
                self.end.get_or_insert(End::ClientGone);
            }
            Verdict::Continue | Verdict::Wait | Verdict::ClientGone => {}
        }
    }

    /// The progress of the protocol.
    pub fn status(&self) -> ExperimentAnswer {
        ExperimentAnswer {
            running: self.is_running(),
            segment: self.segment,
            segments: self.program.as_ref().map_or(0, |program| program.steps.len() as u32),
            elapsed_s: self.elapsed_s,
            duration_s: self.program.as_ref().map_or(0.0, |program| program.duration_s),
            completed: self.completed,
            permission_lost: self.permission_lost,
            // What is overdue means nothing once the protocol has ended.
            scan: self.scan.progress(self.last_ns.filter(|_| self.is_running()).unwrap_or(0)),
            ..ExperimentAnswer::default()
        }
    }

    /// Runs one cycle at `now_ns` (CLOCK_MONOTONIC) with the measured positions of the masters (rad
    /// or m).
    ///
    /// A time before the last step's is replaced by that. After a pause longer than the lease
    /// control has ramped to hold, so the segment starts again from where the handle is; or the
    /// protocol ends, where it does not go on after a restart.
    pub fn step(&mut self, now_ns: u64, measured: &[f64; AXES]) -> Output {
        let Some(program) = self.program.clone().filter(|_| !self.waiting || self.end.is_some())
        else {
            return Output { setpoint: None, change: None };
        };
        let last_ns = self.last_ns.unwrap_or(now_ns);
        let now_ns = now_ns.max(last_ns);
        self.last_ns = Some(now_ns);
        let paused = now_ns - last_ns > LEASE_NS;
        if paused && self.is_running() && !program.resumes {
            self.end.get_or_insert(End::Restarted);
        }
        if let Some(ilc) = self.ilc.as_mut().filter(|_| !paused) {
            ilc.advance(now_ns);
        }
        if self.is_running() {
            self.scan.advance(now_ns);
        }
        let change = self.advance(&program, now_ns, measured, paused);
        let setpoint = self.setpoint(&program, now_ns, measured);
        Output { setpoint: Some(setpoint), change }
    }

    fn advance(
        &mut self,
        program: &Arc<Program>,
        now_ns: u64,
        measured: &[f64; AXES],
        paused: bool,
    ) -> Option<Change> {
        if let Some(end) = self.end.take() {
            return self.end_by(end, program, now_ns, measured, paused);
        }
        match self.phase {
            Phase::Idle => None,
            Phase::Entering { segment, change } => {
                self.find_axes(program, measured);
                self.play(segment, now_ns);
                self.begin_scan(program, segment, change, now_ns);
                self.begin_ilc(program, segment, now_ns, matches!(change, Change::Resumed(_)));
                Some(change)
            }
            Phase::Playing { segment, .. } if paused => {
                self.pending_order = None;
                self.find_axes(program, measured);
                self.play(segment, now_ns);
                self.scan.pause();
                self.begin_ilc(program, segment, now_ns, true);
                Some(Change::Resumed(segment as u32))
            }
            Phase::Playing { segment, begun_ns } => {
                self.announce_beat(program, segment, begun_ns, now_ns);
                let measured_end = self
                    .await_scanner(program, segment, begun_ns, now_ns, measured)
                    .or_else(|| self.find_range(program, segment, begun_ns, now_ns, measured));
                match measured_end {
                    Some(Ok(edge_ns)) => self.pass_edge(program, segment, edge_ns, None, measured),
                    Some(Err(change)) => change,
                    None => self.next_segment(program, segment, begun_ns, now_ns, measured),
                }
            }
            Phase::Stopping { segment, stopped_ns, .. } => {
                if now_ns - stopped_ns >= STOP_FADE_NS || paused {
                    self.rest = self.hold;
                    self.end_ilc();
                    self.phase = Phase::Holding { segment, since_ns: now_ns };
                }
                None
            }
            Phase::Holding { since_ns, .. } => {
                if now_ns - since_ns >= HOLD_NS {
                    self.phase = Phase::Idle;
                }
                None
            }
        }
    }

    /// Ends the protocol: at once if power is gone or the reference is unknown, otherwise by a fade
    /// to rest.
    fn end_by(
        &mut self,
        end: End,
        program: &Program,
        now_ns: u64,
        measured: &[f64; AXES],
        paused: bool,
    ) -> Option<Change> {
        let running = self.is_running();
        self.permission_lost |= running && end == End::PermissionLost;
        self.pending_order = None;
        match self.phase {
            Phase::Playing { segment, begun_ns }
                if end != End::PermissionLost && !paused && !is_given_away(program, segment) =>
            {
                self.hold = self
                    .points(program, segment, seconds(begun_ns, now_ns))
                    .map(|point| point.position);
                self.phase = Phase::Stopping { segment, begun_ns, stopped_ns: now_ns };
            }
            _ => {
                self.find_axes(program, measured);
                self.end_ilc();
                self.phase = Phase::Idle;
            }
        }
        running.then(|| end.change(self.segment))
    }

    /// Starts the next segment when the present one has ended. It begins at the nominal end, not at
    /// the step after it, so that the protocol keeps its time.
    fn next_segment(
        &mut self,
        program: &Arc<Program>,
        segment: usize,
        begun_ns: u64,
        now_ns: u64,
        measured: &[f64; AXES],
    ) -> Option<Change> {
        let step = program.steps.get(segment)?;
        let duration_s = step.track.duration_s();
        let (edge_ns, planned_s) = match &self.ilc {
            // It may start at a later block, or wait for its worker thread.
            Some(ilc) => (ilc.ends_ns()?, None),
            None => {
                let planned_ns = begun_ns + (duration_s * 1e9).round() as u64;
                (self.scan.edge_ns(planned_ns, duration_s), Some(duration_s))
            }
        };
        if now_ns < edge_ns {
            return None;
        }
        self.pass_edge(program, segment, edge_ns, planned_s, measured)
    }

    /// Ends a segment at `edge_ns` and begins the next one there; `planned_s` is its duration where
    /// it had all of it.
    fn pass_edge(
        &mut self,
        program: &Arc<Program>,
        segment: usize,
        edge_ns: u64,
        planned_s: Option<f64>,
        measured: &[f64; AXES],
    ) -> Option<Change> {
        let step = program.steps.get(segment)?;
        if is_given_away(program, segment) {
            self.find_axes(program, measured);
        } else {
            for (axis, track) in step.tracks() {
                self.rest[axis] = track.at(self.rest[axis], track.duration_s()).position;
            }
        }
        self.scan.pass_edge(edge_ns, planned_s);
        self.last_edge_ns = edge_ns;
        if segment + 1 < program.steps.len() {
            self.play(segment + 1, edge_ns);
            self.begin_wait(program, segment + 1, edge_ns);
            self.begin_ilc(program, segment + 1, edge_ns, false);
            return Some(Change::Segment(segment as u32 + 1));
        }
        self.end_ilc();
        self.completed = true;
        self.elapsed_s = program.duration_s - self.early_s;
        self.phase = match is_given_away(program, segment) {
            true => Phase::Idle,
            false => Phase::Holding { segment, since_ns: edge_ns },
        };
        Some(Change::Done)
    }
}

/// Whether the position at the segment's end is unknown: the hand moves freely, or the range is
/// searched.
fn is_given_away(program: &Program, segment: usize) -> bool {
    program.steps.get(segment).is_some_and(|step| step.track.movement.end_is_unknown())
}

fn seconds(from_ns: u64, to_ns: u64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 * 1e-9
}
