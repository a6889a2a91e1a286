//! The watchdog's interlock: its state machine, fault detection and enable tokens. Pure: the
//! calling loop passes messages, verbs and the time, and publishes the outputs.
//!
//! ```text
//!             reset (see below)           arm           enable (new epoch)
//!  Faulted ─────────────────────────> Disarmed ──> Armed ──────────────────> Enabled
//!     ^  ^           fault               │  ^        │ disarm                   │ │
//!     │  └───────────────────────────────┘  └────────┴──────────────────────────┘ │
//!   start          Tripped <──────────── fault while Armed or Enabled ──────────────┘
//!                   ^ └─ reset (see below) ─> Disarmed
//!   any state ─ estop ┘
//! ```
//!
//! The interlock never enables by itself. Faulted and Tripped are latched: they persist after the
//! fault has cleared, until a person resets. Only faults that trip ([`FaultAction::Trips`]) lead
//! there, and only they refuse a reset while active.
//!
//! Once per cycle, pass every received message to [`Interlock::observe_sample`] or
//! [`Interlock::observe_command`] and every verb to [`Interlock::command`], then read the clock and
//! call [`Interlock::step`]. Publish each returned token exactly once: its sequence number must
//! equal the one that the publisher assigns.

mod active_faults;
mod config;
mod faults;
mod message_monitor;
mod pacing;
mod plausibility;
mod range_of_motion;
mod refusal;
mod speed;
mod torque_input;

pub use config::Config;
pub use faults::{FaultAction, FaultSet, PRIORITY, action_of};
use ipc_types::{
    AXES, EnableToken, GateState, MotorCommand, Sample, TripCause, Verb, WatchdogState,
};
use message_monitor::{CommandMonitor, SampleMonitor, has_enable_line};
use plausibility::PlausibilityMonitor;
use range_of_motion::RangeMonitor;
pub use refusal::Refusal;
use rig::WithoutLogger;
pub use torque_input::TorqueInput;

/// Number of past tokens whose issue times are kept, to compute the age of an echoed token.
const TOKEN_HISTORY: usize = 256;
const CAUSES: usize = TripCause::ALL.len();

/// Liveness of the processes that publish nothing the interlock reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peers {
    /// The launcher or systemd, which restarts what dies, is alive.
    pub launcher_alive: bool,
    /// The keeper is alive.
    pub keeper_alive: bool,
    /// The logger is alive.
    pub logger_alive: bool,
}

impl Peers {
    /// All of them are alive.
    pub const ALIVE: Self = Self { launcher_alive: true, keeper_alive: true, logger_alive: true };
}

/// A change of state between two steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StateChange {
    /// State after the previous step.
    pub from: WatchdogState,
    /// State now.
    pub to: WatchdogState,
    /// Cause of the last fault or trip.
    pub cause: TripCause,
}

impl StateChange {
    /// Text of the event: the cause if power is latched off, otherwise the new state, since an old
    /// cause does not explain a `reset`.
    pub const fn text(&self) -> &'static str {
        match self.to {
            WatchdogState::Faulted | WatchdogState::Tripped => self.cause.text(),
            state => state.text(),
        }
    }
}

/// What one step yields.
#[derive(Clone, Copy, Debug)]
pub struct Outputs {
    /// The token to publish.
    pub token: EnableToken,
    /// Whether to toggle the enable line in this cycle.
    pub toggle_line: bool,
    /// The change of state to publish as an event.
    pub event: Option<StateChange>,
}

/// The watchdog's state machine; the module's documentation shows its states.
#[derive(Clone, Debug)]
pub struct Interlock {
    config: Config,
    state: WatchdogState,
    /// State in the newest event.
    reported_state: WatchdogState,
    cause: TripCause,
    samples: SampleMonitor,
    commands: CommandMonitor,
    plausibility: PlausibilityMonitor,
    range: RangeMonitor,
    /// Faults detected in single messages since the last step.
    momentary: FaultSet,
    /// Time until which each momentary fault is held active (ns), by code of its cause.
    held_until_ns: [u64; CAUSES],
    active: FaultSet,
    /// Newest enable epoch issued.
    epoch: u64,
    /// Highest epoch that a sample reported.
    seen_epoch: u64,
    enabled_at_ns: u64,
    /// When the enable line was last toggled; at `enable`, the time of `enable`.
    toggled_at_ns: u64,
    /// Whether a sample of this epoch has shown the gate open.
    gate_opened: bool,
    /// When power was last withdrawn; from then the gate has `echo_lost_ns` to write 0 V.
    unpowered_since_ns: Option<u64>,
    /// Sequence number of the next token.
    sequence: u64,
    /// Issue times of the last tokens, by sequence number modulo `TOKEN_HISTORY` (ns).
    issued_ns: [u64; TOKEN_HISTORY],
    last_step_ns: Option<u64>,
}

impl Interlock {
    /// An interlock that has just started: faulted, no message seen.
    pub fn new(config: Config) -> Self {
        Self {
            config,
            state: WatchdogState::Faulted,
            reported_state: WatchdogState::Faulted,
            cause: TripCause::Started,
            samples: SampleMonitor::new(),
            commands: CommandMonitor::default(),
            plausibility: PlausibilityMonitor::new(),
            range: RangeMonitor::new(),
            momentary: FaultSet::NONE,
            held_until_ns: [0; CAUSES],
            active: FaultSet::NONE,
            epoch: 0,
            seen_epoch: 0,
            enabled_at_ns: 0,
            toggled_at_ns: 0,
            gate_opened: false,
            unpowered_since_ns: None,
            sequence: 0,
            issued_ns: [0; TOKEN_HISTORY],
            last_step_ns: None,
        }
    }

    /// Present state.
    pub const fn state(&self) -> WatchdogState {
        self.state
    }

    /// Cause of the last fault or trip.
    pub const fn cause(&self) -> TripCause {
        self.cause
    }

    /// Faults that were active at the last step.
    pub const fn active_faults(&self) -> FaultSet {
        self.active
    }

    /// Processes a received sample.
    pub fn observe_sample(&mut self, sample: &Sample) {
        let faults = self.samples.observe(sample, &self.config);
        self.momentary.merge(faults);
        if sample.session != self.config.session {
            return;
        }
        self.seen_epoch = self.seen_epoch.max(sample.epoch);
        if self.state == WatchdogState::Enabled {
            let open = sample.gate_state == GateState::Open.code();
            if sample.epoch == self.epoch && open {
                self.gate_opened = true;
            } else {
                // Before the gate has opened, samples of an older epoch, or of this one with the
                // gate still closed, are expected and are no fault.
                let still_opening = sample.epoch < self.epoch
                    || (sample.epoch == self.epoch
                        && sample.gate_state == GateState::Closed.code());
                self.momentary
                    .insert_if(self.gate_opened || !still_opening, TripCause::GateLatched);
            }
        }
        let powered = self.state == WatchdogState::Enabled && self.gate_opened;
        let command = self.commands.newest.as_ref();
        let implausible = self.plausibility.observe(sample, command, powered, &self.config);
        self.momentary.merge(implausible);
    }

    /// Processes a received motor command.
    pub fn observe_command(&mut self, command: &MotorCommand) {
        let faults = self.commands.observe(command, self.samples.homed(), &self.config);
        self.momentary.merge(faults);
    }

    /// Executes a verb.
    ///
    /// # Errors
    /// A [`Refusal`]; the state is then unchanged.
    pub fn command(&mut self, verb: Verb, now_ns: u64) -> Result<WatchdogState, Refusal> {
        // Faults seen since the last step count as well.
        self.active.merge(self.momentary);
        match verb {
            Verb::Estop => self.trip(TripCause::EmergencyStop, now_ns),
            Verb::Disarm => {
                // In the other states the motor has no power, and `disarm` changes nothing.
                if matches!(self.state, WatchdogState::Armed | WatchdogState::Enabled) {
                    self.change_state(WatchdogState::Disarmed, now_ns);
                }
            }
            Verb::Reset => {
                if matches!(self.state, WatchdogState::Armed | WatchdogState::Enabled) {
                    return Err(self.wrong_state(WatchdogState::Tripped));
                }
                self.refuse_if_active(|action| action == FaultAction::Trips)?;
                self.state = WatchdogState::Disarmed;
            }
            Verb::Arm | Verb::ArmUnchecked => self.arm(now_ns)?,
            Verb::Enable => self.enable(now_ns)?,
        }
        Ok(self.state)
    }

    /// One cycle. `now_ns` is CLOCK_MONOTONIC, read after the last receive.
    pub fn step(&mut self, now_ns: u64, peers: Peers) -> Outputs {
        self.observe_range();
        self.update_faults(now_ns, peers);
        let cause = match self.state {
            WatchdogState::Armed | WatchdogState::Enabled => {
                self.active.first(|cause| self.action(cause) != FaultAction::Blocks)
            }
            WatchdogState::Disarmed => {
                self.active.first(|cause| self.action(cause) == FaultAction::Trips)
            }
            WatchdogState::Faulted | WatchdogState::Tripped => None,
        };
        if let Some(cause) = cause {
            if self.state == WatchdogState::Disarmed {
                self.cause = cause;
                self.state = WatchdogState::Faulted;
            } else {
                self.trip(cause, now_ns);
            }
        }
        let event = (self.state != self.reported_state).then_some(StateChange {
            from: self.reported_state,
            to: self.state,
            cause: self.cause,
        });
        self.reported_state = self.state;
        let token = self.token(now_ns);
        self.issued_ns[self.sequence as usize % TOKEN_HISTORY] = now_ns;
        self.sequence += 1;
        let toggle_line = self.state == WatchdogState::Enabled && self.samples_are_fresh(now_ns);
        if toggle_line {
            self.toggled_at_ns = now_ns;
        }
        Outputs { token, toggle_line, event }
    }

    /// Holds the handles to their range of motion, by the newest sample and command: a command that
    /// the gate has seen is here before the sample that shows its volts is judged.
    fn observe_range(&mut self) {
        let Some(sample) = &self.samples.newest else { return };
        let powered = self.state == WatchdogState::Enabled && self.gate_opened;
        let command = self.commands.newest.as_ref();
        let left = self.range.observe(sample, command, powered, &self.config);
        self.momentary.insert_if(left, TripCause::RangeOfMotion);
    }

    /// Disarmed → Armed, if no fault is active, the card has an enable line (or the rig file an
    /// override), the gate is closed and the masters are at rest.
    fn arm(&mut self, now_ns: u64) -> Result<(), Refusal> {
        if self.state != WatchdogState::Disarmed {
            return Err(self.wrong_state(WatchdogState::Disarmed));
        }
        self.refuse_if_active(|_| true)?;
        let sample =
            self.samples.newest.as_ref().ok_or(Refusal::FaultActive(TripCause::AcquisitionLost))?;
        if !has_enable_line(sample) && !self.config.power_cut_otherwise {
            return Err(Refusal::NoEnableLine);
        }
        let unpowered_for_ns =
            self.unpowered_since_ns.map_or(0, |since| now_ns.saturating_sub(since));
        if unpowered_for_ns > self.config.echo_lost_ns
            && sample.gate_state == GateState::Open.code()
        {
            return Err(Refusal::GateOpen);
        }
        match self.samples.at_rest(&self.config) {
            None => Err(Refusal::SpeedUnknown),
            Some(false) => Err(Refusal::Moving),
            Some(true) => {
                self.state = WatchdogState::Armed;
                Ok(())
            }
        }
    }

    /// Armed → Enabled, with a new epoch.
    fn enable(&mut self, now_ns: u64) -> Result<(), Refusal> {
        if self.state != WatchdogState::Armed {
            return Err(self.wrong_state(WatchdogState::Armed));
        }
        self.refuse_if_active(|_| true)?;
        // From CLOCK_MONOTONIC, so that epochs increase across restarts of the watchdog; the epoch
        // that samples report is a second safeguard.
        let next = self.epoch.max(self.seen_epoch).checked_add(1).ok_or(Refusal::EpochExhausted)?;
        self.epoch = now_ns.max(next);
        self.enabled_at_ns = now_ns;
        self.toggled_at_ns = now_ns;
        self.gate_opened = false;
        self.state = WatchdogState::Enabled;
        Ok(())
    }

    /// What a fault leads to here: for the loss of the logger the rig file says it.
    fn action(&self, cause: TripCause) -> FaultAction {
        match (cause, self.config.without_logger) {
            (TripCause::LoggerLost, WithoutLogger::Trip) => FaultAction::TripsWhenArmed,
            _ => action_of(cause),
        }
    }

    /// Refuses if a fault is active whose action is `relevant`.
    fn refuse_if_active(&self, relevant: impl Fn(FaultAction) -> bool) -> Result<(), Refusal> {
        // Before the first step faults have not been evaluated: refuse.
        if self.last_step_ns.is_none() {
            return Err(Refusal::FaultActive(TripCause::Started));
        }
        let active = self.active.first(|cause| relevant(self.action(cause)));
        active.map_or(Ok(()), |cause| Err(Refusal::FaultActive(cause)))
    }

    const fn wrong_state(&self, expected: WatchdogState) -> Refusal {
        Refusal::State { expected, found: self.state }
    }

    /// Enters Tripped with this cause.
    fn trip(&mut self, cause: TripCause, now_ns: u64) {
        self.cause = cause;
        self.change_state(WatchdogState::Tripped, now_ns);
    }

    fn change_state(&mut self, to: WatchdogState, now_ns: u64) {
        if self.state == WatchdogState::Enabled {
            self.unpowered_since_ns = Some(now_ns);
        }
        self.state = to;
    }

    fn token(&self, now_ns: u64) -> EnableToken {
        let enabled = self.state == WatchdogState::Enabled;
        let life_ns = if enabled { self.config.token_life_ns } else { 0 };
        let (sample, command) = (self.samples.newest.as_ref(), self.commands.newest.as_ref());
        EnableToken {
            session: self.config.session,
            incarnation: self.config.incarnation,
            sequence: self.sequence,
            time_ns: now_ns,
            epoch: self.epoch,
            watchdog_incarnation: self.config.incarnation,
            acquisition_incarnation: sample.map_or(0, |sample| sample.incarnation),
            control_incarnation: command.map_or(0, |command| command.incarnation),
            issued_ns: now_ns,
            valid_until_ns: now_ns.saturating_add(life_ns),
            sample_tick: sample.map_or(0, |sample| sample.tick),
            command_sequence: command.map_or(0, |command| command.sequence),
            faults: self.active.bits(),
            enabled: u8::from(enabled),
            state: self.state.code(),
            cause: self.cause.code(),
            profile: self.config.profile.code(),
            homed: self.samples.homed(),
            range_given: range_of_motion::given(&self.config),
            range_supervised: self.range.in_force(self.samples.homed(), &self.config),
            ..EnableToken::default()
        }
    }
}

const _: () = assert!(CAUSES <= 64, "a fault set has one bit for each cause");
const _: () = assert!(AXES <= 8, "presence bits are a byte");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_names_a_cause_only_where_power_is_latched_off() {
        let change = |to| StateChange {
            from: WatchdogState::Tripped,
            to,
            cause: TripCause::AcquisitionLost,
        };
        assert_eq!(change(WatchdogState::Tripped).text(), "acquisition lost");
        assert_eq!(change(WatchdogState::Faulted).text(), "acquisition lost");
        for state in [WatchdogState::Disarmed, WatchdogState::Armed, WatchdogState::Enabled] {
            assert_eq!(change(state).text(), state.text());
        }
    }
}
