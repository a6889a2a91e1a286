//! Lifecycle of a rig's units: when to start, kill, restart and stop them. A pure state machine:
//! events with their time (monotonic, any origin) in, [`Action`]s out.
//!
//! | event | reaction | cleared by |
//! |---|---|---|
//! | no `READY=1` within `TimeoutStartSec=` | kill, restart | a successful start |
//! | exit before `READY=1` | restart | a successful start |
//! | no `WATCHDOG=1` for `WatchdogSec=` | kill, restart | itself |
//! | exit that is not clean ([`Exit::is_clean`]) | restart | itself |
//! | [`START_ATTEMPTS`] failed starts in a row during bring-up | stop all, report | a person |
//! | [`START_LIMIT`] starts within [`START_LIMIT_INTERVAL`] | give up (a) | `restart UNIT` |
//! | exit with code [`NO_RESTART`] | give up (a) | a person |
//! | a unit that it needs is not ready | hold the start (`Gated`) | itself |
//!
//! (a) During bring-up, giving up one unit stops all.
//!
//! The n-th restart in a row waits [`RESTART_DELAY`] × 2ⁿ, at most [`BACK_OFF_CAP`]. Once a process
//! has been ready for [`HEALTHY_AFTER`], n starts from 0 again.

mod exit;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::time::Duration;

pub use exit::Exit;

use crate::status::{RigState, UnitState};
use crate::units::Unit;

/// Shortest pause before a restart (`RestartSec=`), well below the span of the card's FIFO.
pub const RESTART_DELAY: Duration = Duration::from_millis(50);
/// Starts allowed within [`START_LIMIT_INTERVAL`] (`StartLimitBurst=`).
pub const START_LIMIT: usize = 10;
/// Window in which starts are counted (`StartLimitIntervalSec=`).
pub const START_LIMIT_INTERVAL: Duration = Duration::from_secs(20);
/// Exit code of a wrong command line or rig file, which a restart cannot help
/// (`RestartPreventExitStatus=`).
pub const NO_RESTART: i32 = 2;
/// Longest pause before a restart.
pub const BACK_OFF_CAP: Duration = Duration::from_secs(2);
/// Time a process must have been ready for the back-off to start anew.
pub const HEALTHY_AFTER: Duration = Duration::from_secs(2);
/// Attempts at starting a unit during bring-up.
pub const START_ATTEMPTS: u32 = 3;

/// What the caller must do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Start this unit's process; then, if that failed, call [`Lifecycle::start_refused`].
    Start(usize),
    /// Send `SIGTERM`.
    AskToStop(usize),
    /// Send `SIGKILL`.
    Kill(usize),
}

/// Why the rig could not be brought up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Index of the unit.
    pub unit: usize,
    /// The last failure.
    pub reason: String,
    /// Number of attempts.
    pub attempts: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Inactive,
    Starting { deadline: Duration },
    Ready { since: Duration, pinged: Duration },
    Killing { deadline: Duration },
    BackOff { until: Duration },
    Stopping { deadline: Duration, killed: bool, then_start: bool },
    Failed,
}

#[derive(Debug)]
struct Slot {
    unit: Unit,
    /// indices of the units that start before it
    after: Vec<usize>,
    /// indices of those without which it must not start again
    gates: Vec<usize>,
    state: State,
    restarts: u32,
    failed_starts: u32,
    back_off_steps: u32,
    starts: VecDeque<Duration>,
    reason: Option<String>,
    stop_asked: Option<Duration>,
    stop_killed: bool,
}

impl Slot {
    /// SIGKILL did not end it: it hangs in the kernel, and the others must not wait for it.
    fn outlived(&mut self) {
        self.reason = Some("it outlived SIGKILL".to_owned());
        self.state = State::Failed;
    }
}

/// State of all units of a rig.
#[derive(Debug)]
pub struct Lifecycle {
    slots: Vec<Slot>,
    phase: RigState,
    failure: Option<Failure>,
    start_limit: usize,
}

impl Lifecycle {
    /// Returns the bring-up of units that are all inactive. Names of units that are not among them
    /// do not count.
    pub fn new(units: &[Unit]) -> Self {
        let indices = |names: &[String]| {
            let index = |name: &String| units.iter().position(|unit| unit.name == *name);
            names.iter().filter_map(index).collect()
        };
        let slots = units
            .iter()
            .map(|unit| Slot {
                unit: unit.clone(),
                after: indices(&unit.after),
                gates: indices(&unit.gates),
                state: State::Inactive,
                restarts: 0,
                failed_starts: 0,
                back_off_steps: 0,
                starts: VecDeque::new(),
                reason: None,
                stop_asked: None,
                stop_killed: false,
            })
            .collect();
        Self { slots, phase: RigState::Starting, failure: None, start_limit: START_LIMIT }
    }

    /// Adopts a living process. One that was not ready gets `TimeoutStartSec=` to become so; since
    /// its `READY=1` may have been lost, a `WATCHDOG=1` counts as well.
    pub fn adopt(&mut self, unit: usize, was_ready: bool, restarts: u32, now: Duration) {
        let slot = &mut self.slots[unit];
        slot.restarts = restarts;
        slot.starts.push_back(now);
        slot.state = if was_ready {
            State::Ready { since: now, pinged: now }
        } else {
            State::Starting { deadline: now + slot.unit.timeout_start }
        };
    }

    /// Phase of the rig.
    pub fn phase(&self) -> RigState {
        self.phase
    }

    /// Why the rig could not be brought up.
    pub fn failure(&self) -> Option<&Failure> {
        self.failure.as_ref()
    }

    /// State of a unit.
    pub fn state(&self, unit: usize) -> UnitState {
        match self.slots[unit].state {
            State::Inactive => UnitState::Inactive,
            State::Starting { .. } => UnitState::Starting,
            State::Ready { .. } => UnitState::Ready,
            State::Killing { .. } => UnitState::Killing,
            State::BackOff { .. } if self.gates_open(unit) => UnitState::BackOff,
            State::BackOff { .. } => UnitState::Gated,
            State::Stopping { .. } => UnitState::Stopping,
            State::Failed => UnitState::Failed,
        }
    }

    /// Starts of a unit after its first.
    pub fn restarts(&self, unit: usize) -> u32 {
        self.slots[unit].restarts
    }

    /// Why a unit was or will be restarted, or was given up.
    pub fn reason(&self, unit: usize) -> Option<&str> {
        self.slots[unit].reason.as_deref()
    }

    /// When a unit was asked to stop, and whether it was killed.
    pub fn stop_of(&self, unit: usize) -> Option<(Duration, bool)> {
        self.slots[unit].stop_asked.map(|asked| (asked, self.slots[unit].stop_killed))
    }

    /// `READY=1` was received.
    pub fn ready(&mut self, unit: usize, now: Duration) {
        let slot = &mut self.slots[unit];
        if let State::Starting { .. } = slot.state {
            slot.failed_starts = 0;
            slot.state = State::Ready { since: now, pinged: now };
        }
    }

    /// `WATCHDOG=1` was received; `adopted` as in [`Lifecycle::adopt`].
    pub fn ping(&mut self, unit: usize, adopted: bool, now: Duration) {
        if adopted {
            self.ready(unit, now);
        }
        if let State::Ready { pinged, .. } = &mut self.slots[unit].state {
            *pinged = now;
        }
    }

    /// The process could not be spawned.
    pub fn start_refused(&mut self, unit: usize, reason: String, now: Duration) {
        self.slots[unit].failed_starts += 1;
        self.slots[unit].reason = Some(reason);
        self.start_again(unit, now);
    }

    /// The process ended.
    pub fn exited(&mut self, unit: usize, exit: Exit, now: Duration) {
        let slot = &mut self.slots[unit];
        match slot.state {
            State::Stopping { then_start: true, .. } if self.phase != RigState::Stopping => {
                slot.state = State::BackOff { until: now };
            }
            _ if self.phase == RigState::Stopping => slot.state = State::Inactive,
            State::Stopping { .. } => slot.state = State::Inactive,
            State::Killing { .. } => self.start_again(unit, now),
            State::Starting { .. } => {
                slot.failed_starts += 1;
                slot.reason = Some(format!("it ended before it was ready: {exit}"));
                if exit == Exit::Code(NO_RESTART) {
                    self.give_up(unit)
                } else {
                    self.start_again(unit, now)
                }
            }
            State::Ready { since, .. } => {
                slot.reason = Some(format!("it ended: {exit}"));
                if now.saturating_sub(since) >= HEALTHY_AFTER {
                    slot.back_off_steps = 0;
                }
                let prevented = exit == Exit::Code(NO_RESTART);
                if !exit.is_clean() && !prevented {
                    self.start_again(unit, now);
                } else if prevented || self.phase == RigState::Starting {
                    // During bring-up, the units after it would wait for ever.
                    self.give_up(unit);
                } else {
                    slot.state = State::Inactive;
                }
            }
            State::Inactive | State::BackOff { .. } | State::Failed => {}
        }
    }

    /// Restarts a unit at a person's request; stops it first if it runs. Resets its back-off and
    /// start limit.
    ///
    /// # Errors
    /// If the rig is not up.
    pub fn restart(&mut self, unit: usize, now: Duration) -> Result<Vec<Action>, &'static str> {
        if self.phase != RigState::Up {
            return Err("the rig is not up: it is being started or stopped");
        }
        let slot = &mut self.slots[unit];
        slot.back_off_steps = 0;
        slot.failed_starts = 0;
        slot.starts.clear();
        slot.reason = Some("a restart was asked for".to_owned());
        Ok(match slot.state {
            State::Ready { .. } | State::Starting { .. } => {
                slot.state = State::Stopping {
                    deadline: now + slot.unit.timeout_stop,
                    killed: false,
                    then_start: true,
                };
                vec![Action::AskToStop(unit)]
            }
            State::Inactive | State::BackOff { .. } | State::Failed => {
                slot.state = State::BackOff { until: now };
                Vec::new()
            }
            State::Killing { .. } | State::Stopping { .. } => Vec::new(),
        })
    }

    /// Stops all units in the reverse of their start order.
    pub fn stop_all(&mut self) {
        if self.phase != RigState::Down {
            self.phase = RigState::Stopping;
        }
    }

    /// Returns the actions due at `now`. Call it after every event and at
    /// [`Lifecycle::next_deadline`].
    pub fn tick(&mut self, now: Duration) -> Vec<Action> {
        let mut actions = Vec::new();
        for unit in 0..self.slots.len() {
            self.enforce(unit, now, &mut actions);
        }
        match self.phase {
            RigState::Starting | RigState::Up => self.start_due(now, &mut actions),
            RigState::Stopping => self.stop_due(now, &mut actions),
            RigState::Down | RigState::Abandoned => {}
        }
        actions
    }

    /// Time of the next action if no event comes before.
    pub fn next_deadline(&self) -> Option<Duration> {
        (0..self.slots.len())
            .filter_map(|unit| match self.slots[unit].state {
                State::Starting { deadline } | State::Stopping { deadline, .. } => Some(deadline),
                State::Killing { deadline } if self.phase == RigState::Stopping => Some(deadline),
                State::Ready { pinged, .. } => Some(pinged + self.slots[unit].unit.watchdog),
                State::BackOff { until } if self.gates_open(unit) || self.gates_ended(unit) => {
                    Some(until)
                }
                _ => None,
            })
            .min()
    }

    /// Kills a process past its deadline.
    fn enforce(&mut self, unit: usize, now: Duration, actions: &mut Vec<Action>) {
        let stopping = self.phase == RigState::Stopping;
        let slot = &mut self.slots[unit];
        match slot.state {
            State::Starting { deadline } if now >= deadline && !stopping => {
                slot.failed_starts += 1;
                slot.reason =
                    Some(format!("it was not ready within {:?}", slot.unit.timeout_start));
                slot.state = State::Killing { deadline: now + slot.unit.timeout_stop };
                actions.push(Action::Kill(unit));
            }
            State::Ready { since, pinged } if !stopping && now >= pinged + slot.unit.watchdog => {
                let watchdog = slot.unit.watchdog;
                if now.saturating_sub(since) >= HEALTHY_AFTER.max(watchdog * 2) {
                    slot.back_off_steps = 0;
                }
                slot.reason = Some(format!("its watchdog was silent for {watchdog:?}"));
                slot.state = State::Killing { deadline: now + slot.unit.timeout_stop };
                actions.push(Action::Kill(unit));
            }
            State::Stopping { deadline, killed, then_start } if now >= deadline => {
                if killed {
                    slot.outlived();
                } else {
                    slot.stop_killed = true;
                    slot.state = State::Stopping {
                        deadline: now + slot.unit.timeout_stop,
                        killed: true,
                        then_start,
                    };
                    actions.push(Action::Kill(unit));
                }
            }
            State::Killing { deadline } if stopping && now >= deadline => slot.outlived(),
            _ => {}
        }
    }

    /// Restarts a unit that exited cleanly when a unit that wants it is due, as `Wants=` does.
    fn start_gates(&mut self, now: Duration) {
        for unit in 0..self.slots.len() {
            if !matches!(self.slots[unit].state, State::BackOff { until } if now >= until) {
                continue;
            }
            for gate in self.slots[unit].gates.clone() {
                if matches!(self.slots[gate].state, State::Inactive) {
                    self.slots[gate].state = State::BackOff { until: now };
                }
            }
        }
    }

    fn start_due(&mut self, now: Duration, actions: &mut Vec<Action>) {
        if self.phase == RigState::Up {
            self.start_gates(now);
        }
        for unit in 0..self.slots.len() {
            let due = match self.slots[unit].state {
                State::Inactive if self.phase == RigState::Starting => {
                    self.slots[unit].after.iter().all(|&before| self.is_ready(before))
                }
                State::BackOff { until } => now >= until && self.gates_open(unit),
                _ => false,
            };
            if !due {
                continue;
            }
            let slot = &mut self.slots[unit];
            slot.restarts += u32::from(!matches!(slot.state, State::Inactive));
            slot.starts.push_back(now);
            slot.state = State::Starting { deadline: now + slot.unit.timeout_start };
            actions.push(Action::Start(unit));
        }
        if self.phase == RigState::Starting && (0..self.slots.len()).all(|unit| self.is_ready(unit))
        {
            self.phase = RigState::Up;
        }
    }

    fn stop_due(&mut self, now: Duration, actions: &mut Vec<Action>) {
        for unit in 0..self.slots.len() {
            if let State::BackOff { .. } = self.slots[unit].state {
                self.slots[unit].state = State::Inactive;
            }
        }
        for unit in 0..self.slots.len() {
            let running =
                matches!(self.slots[unit].state, State::Starting { .. } | State::Ready { .. });
            let blocked = (0..self.slots.len())
                .any(|later| self.slots[later].after.contains(&unit) && self.has_process(later));
            if running && !blocked {
                let slot = &mut self.slots[unit];
                slot.stop_asked = Some(now);
                slot.state = State::Stopping {
                    deadline: now + slot.unit.timeout_stop,
                    killed: false,
                    then_start: false,
                };
                actions.push(Action::AskToStop(unit));
            }
        }
        if !(0..self.slots.len()).any(|unit| self.has_process(unit)) {
            self.phase = RigState::Down;
        }
    }

    fn is_ready(&self, unit: usize) -> bool {
        matches!(self.slots[unit].state, State::Ready { .. })
    }

    fn has_process(&self, unit: usize) -> bool {
        !matches!(self.slots[unit].state, State::Inactive | State::BackOff { .. } | State::Failed)
    }

    fn gates_open(&self, unit: usize) -> bool {
        self.slots[unit].gates.iter().all(|&gate| self.is_ready(gate))
    }

    /// Whether a gate exited cleanly and must be started again.
    fn gates_ended(&self, unit: usize) -> bool {
        let ended = |gate: &usize| matches!(self.slots[*gate].state, State::Inactive);
        self.slots[unit].gates.iter().any(ended)
    }

    /// Schedules the next start, or gives up.
    fn start_again(&mut self, unit: usize, now: Duration) {
        let bring_up = self.phase == RigState::Starting;
        let slot = &mut self.slots[unit];
        if self.phase == RigState::Stopping || self.phase == RigState::Down {
            slot.state = State::Inactive;
            return;
        }
        let pause = RESTART_DELAY.saturating_mul(1 << slot.back_off_steps.min(16));
        let until = now + pause.min(BACK_OFF_CAP);
        slot.starts.retain(|&start| start + START_LIMIT_INTERVAL > until);
        let starts = self.start_limit;
        let limited = slot.starts.len() >= starts;
        if limited {
            let last = slot.reason.take().unwrap_or_default();
            slot.reason = Some(format!(
                "started {starts} times within {START_LIMIT_INTERVAL:?}, the limit; last: {last}"
            ));
        }
        if limited || (bring_up && slot.failed_starts >= START_ATTEMPTS) {
            self.give_up(unit);
            return;
        }
        slot.back_off_steps += 1;
        slot.state = State::BackOff { until };
    }

    fn give_up(&mut self, unit: usize) {
        let slot = &mut self.slots[unit];
        slot.state = State::Failed;
        if self.phase == RigState::Starting {
            self.failure = Some(Failure {
                unit,
                reason: slot.reason.clone().unwrap_or_default(),
                attempts: slot.failed_starts.max(1),
            });
            self.phase = RigState::Stopping;
        }
    }
}
