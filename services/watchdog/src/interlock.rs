//! The watchdog's interlock: states, faults, tokens. Pure: the loop around it passes messages,
//! commands and the time, and publishes the outputs.
//!
//! ```text
//!            reset (no fault active)      arm           enable (new epoch)
//!  Faulted ─────────────────────────> Disarmed ──> Armed ──────────────────> Enabled
//!     ^  ^           fault               │  ^        │ disarm                   │ │
//!     │  └───────────────────────────────┘  └────────┴──────────────────────────┘ │
//!   start          Tripped <──────────── fault while Armed or Enabled; estop ──────┘
//!                     └─ reset (no fault active) ─> Disarmed
//! ```
//!
//! Nothing enables by itself: Faulted and Tripped outlast their fault until a person resets.
//!
//! Use, once a cycle: every received message to [`Interlock::observe_sample`] and
//! [`Interlock::observe_command`], every received verb to [`Interlock::command`], then read the
//! clock and call [`Interlock::step`]. Publish each step's token exactly once, so that its sequence
//! is the one that the publisher stamps.

mod config;
mod faults;
mod refusal;
mod speed;
mod watch;

pub use config::Config;
pub use faults::{Effect, FaultSet, PRIORITY, effect};
use ipc_types::{
    AXES, EnableToken, GateState, MotorCommand, Sample, TripCause, Verb, WatchdogState,
};
pub use refusal::Refusal;
use watch::{CommandWatch, SampleWatch, age_ns, has_enable_line, lacks_realtime, takes_volts};

/// Tokens whose time of issue is remembered, to measure the age of an echo.
const ISSUED: usize = 256;
const CAUSES: usize = TripCause::ALL.len();

/// Processes that do not publish but must be alive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peers {
    /// The launcher or systemd, which restarts what dies, is alive.
    pub launcher_alive: bool,
    /// The keeper is alive.
    pub keeper_alive: bool,
}

/// A change of state between two steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StateChange {
    /// State after the step before.
    pub from: WatchdogState,
    /// State now.
    pub to: WatchdogState,
    /// Cause of the last fault or trip.
    pub cause: TripCause,
}

impl StateChange {
    /// Text of the event: the cause where power is latched off, otherwise the new state. An earlier
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
    reported: WatchdogState,
    cause: TripCause,
    samples: SampleWatch,
    commands: CommandWatch,
    /// Momentary faults since the last step.
    momentary: FaultSet,
    /// Until when each momentary fault counts as active.
    held_until_ns: [u64; CAUSES],
    active: FaultSet,
    epoch: u64,
    seen_epoch: u64,
    enabled_ns: u64,
    /// When the enable line was last toggled, or power was enabled.
    toggled_ns: u64,
    gate_opened: bool,
    /// When power was last taken away: the gate must write 0 V soon after.
    unpowered_ns: Option<u64>,
    sequence: u64,
    issued_ns: [u64; ISSUED],
    last_step_ns: Option<u64>,
}

impl Interlock {
    /// An interlock that has just started: faulted, no message seen.
    pub fn new(config: Config) -> Self {
        Self {
            config,
            state: WatchdogState::Faulted,
            reported: WatchdogState::Faulted,
            cause: TripCause::Started,
            samples: SampleWatch::new(),
            commands: CommandWatch { newest: None },
            momentary: FaultSet::NONE,
            held_until_ns: [0; CAUSES],
            active: FaultSet::NONE,
            epoch: 0,
            seen_epoch: 0,
            enabled_ns: 0,
            toggled_ns: 0,
            gate_opened: false,
            unpowered_ns: None,
            sequence: 0,
            issued_ns: [0; ISSUED],
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

    /// Takes a received sample in.
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
                // Before it opened, only a sample of our epoch can report it latched closed.
                let waiting = sample.epoch < self.epoch
                    || (sample.epoch == self.epoch
                        && sample.gate_state == GateState::Closed.code());
                self.momentary.insert_if(self.gate_opened || !waiting, TripCause::GateLatched);
            }
        }
    }

    /// Takes a received command in.
    pub fn observe_command(&mut self, command: &MotorCommand) {
        let faults = self.commands.observe(command, &self.config);
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
                // Only Armed and Enabled have anything to take away.
                if matches!(self.state, WatchdogState::Armed | WatchdogState::Enabled) {
                    self.change_state(WatchdogState::Disarmed, now_ns);
                }
            }
            Verb::Reset => {
                if matches!(self.state, WatchdogState::Armed | WatchdogState::Enabled) {
                    return Err(self.wrong_state(WatchdogState::Tripped));
                }
                self.refuse_active(|effect| effect == Effect::Trips)?;
                self.state = WatchdogState::Disarmed;
            }
            Verb::Arm => self.arm(now_ns)?,
            Verb::Enable => self.enable(now_ns)?,
        }
        Ok(self.state)
    }

    /// One cycle. `now_ns` is CLOCK_MONOTONIC, read after the last receive.
    pub fn step(&mut self, now_ns: u64, peers: Peers) -> Outputs {
        self.update_faults(now_ns, peers);
        let cause = match self.state {
            WatchdogState::Armed | WatchdogState::Enabled => {
                self.active.first(|effect| effect != Effect::Blocks)
            }
            WatchdogState::Disarmed => self.active.first(|effect| effect == Effect::Trips),
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
        let event = (self.state != self.reported).then_some(StateChange {
            from: self.reported,
            to: self.state,
            cause: self.cause,
        });
        self.reported = self.state;
        let token = self.token(now_ns);
        self.issued_ns[self.sequence as usize % ISSUED] = now_ns;
        self.sequence += 1;
        let toggle_line = self.state == WatchdogState::Enabled && self.samples_are_fresh(now_ns);
        if toggle_line {
            self.toggled_ns = now_ns;
        }
        Outputs { token, toggle_line, event }
    }

    /// Whether the newest sample is young enough for the line to go on toggling.
    fn samples_are_fresh(&self, now_ns: u64) -> bool {
        self.samples.newest.as_ref().is_some_and(|sample| {
            now_ns.saturating_sub(sample.scan_time_ns) <= self.config.line_pause_ns
        })
    }

    /// Updates the set of active faults.
    fn update_faults(&mut self, now_ns: u64, peers: Peers) {
        let config = &self.config;
        let mut active = FaultSet::NONE;
        let mut momentary = std::mem::take(&mut self.momentary);

        let gap_ns = self.last_step_ns.map(|last| now_ns.checked_sub(last));
        momentary.insert_if(
            gap_ns.is_some_and(|gap| gap.is_none_or(|gap| gap > config.token_life_ns)),
            TripCause::WatchdogLate,
        );
        self.last_step_ns = Some(now_ns);
        let unpowered_ns = *self.unpowered_ns.get_or_insert(now_ns);

        if let Some(sample) = &self.samples.newest {
            let age = age_ns(now_ns, sample, sample.scan_time_ns, config);
            momentary.insert_if(age.is_none(), TripCause::SampleBackwards);
            active.insert_if(
                age.is_none_or(|age| age > config.peer_lost_ns),
                TripCause::AcquisitionLost,
            );
            // Without fresh samples the line has paused almost until the card drops the motor.
            let paused_ns = now_ns.saturating_sub(self.toggled_ns);
            let paused = self.state == WatchdogState::Enabled && paused_ns > config.line_gap_ns;
            let fresh = self.samples_are_fresh(now_ns);
            active.insert_if(
                paused,
                if fresh { TripCause::WatchdogLate } else { TripCause::AcquisitionLost },
            );
            active.insert_if(self.echo_lost(sample.token_sequence, now_ns), TripCause::EchoLost);
            active.insert_if(!takes_volts(sample), TripCause::NoOutput);
            active.insert_if(
                lacks_realtime(sample, self.commands.newest.as_ref(), config),
                TripCause::NotRealtime,
            );
            // The gate must write 0 V soon after the permission ends. Checked here, independently
            // of the gate.
            let overdue = self.state != WatchdogState::Enabled
                && now_ns.saturating_sub(unpowered_ns) > config.echo_lost_ns
                && sample.output_v.iter().any(|&volts| volts != 0.0);
            active.insert_if(overdue, TripCause::VoltageLimit);
        } else {
            active.insert(TripCause::AcquisitionLost);
        }
        if let Some(command) = &self.commands.newest {
            let age = age_ns(now_ns, command, command.computed_ns, config);
            momentary.insert_if(age.is_none(), TripCause::CommandBackwards);
            active
                .insert_if(age.is_none_or(|age| age > config.peer_lost_ns), TripCause::ControlLost);
            let answer_ns = now_ns.saturating_sub(command.sample_time_ns);
            active.insert_if(answer_ns > config.echo_lost_ns, TripCause::CommandStale);
            active.insert_if(self.echo_lost(command.token_sequence, now_ns), TripCause::EchoLost);
        } else {
            active.insert(TripCause::ControlLost);
        }
        active.insert_if(!peers.launcher_alive, TripCause::LauncherLost);
        active.insert_if(!peers.keeper_alive, TripCause::KeeperLost);
        active.insert_if(
            self.state == WatchdogState::Enabled
                && !self.gate_opened
                && now_ns.saturating_sub(self.enabled_ns) > config.gate_open_ns,
            TripCause::GateNotOpen,
        );

        for &cause in PRIORITY {
            let held_until_ns = &mut self.held_until_ns[usize::from(cause.code())];
            if momentary.contains(cause) {
                *held_until_ns = now_ns.saturating_add(config.hold_ns);
            }
            active.insert_if(momentary.contains(cause) || now_ns < *held_until_ns, cause);
        }
        self.active = active;
    }

    fn arm(&mut self, now_ns: u64) -> Result<(), Refusal> {
        if self.state != WatchdogState::Disarmed {
            return Err(self.wrong_state(WatchdogState::Disarmed));
        }
        self.refuse_active(|_| true)?;
        let sample =
            self.samples.newest.as_ref().ok_or(Refusal::FaultActive(TripCause::AcquisitionLost))?;
        if !has_enable_line(sample) && !self.config.line_override {
            return Err(Refusal::NoEnableLine);
        }
        let still_ns = self.unpowered_ns.map_or(0, |since| now_ns.saturating_sub(since));
        if still_ns > self.config.echo_lost_ns {
            if sample.gate_state == GateState::Open.code() {
                return Err(Refusal::GateOpen);
            }
            if sample.motor_power == 1 {
                return Err(Refusal::MotorPowered);
            }
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

    fn enable(&mut self, now_ns: u64) -> Result<(), Refusal> {
        if self.state != WatchdogState::Armed {
            return Err(self.wrong_state(WatchdogState::Armed));
        }
        self.refuse_active(|_| true)?;
        // The clock makes epochs rise over restarts; the epoch seen in samples is a second check.
        let above =
            self.epoch.max(self.seen_epoch).checked_add(1).ok_or(Refusal::EpochExhausted)?;
        self.epoch = now_ns.max(above);
        self.enabled_ns = now_ns;
        self.toggled_ns = now_ns;
        self.gate_opened = false;
        self.state = WatchdogState::Enabled;
        Ok(())
    }

    fn refuse_active(&self, counts: impl Fn(Effect) -> bool) -> Result<(), Refusal> {
        // Before the first step no fault is known, which is no permission.
        if self.last_step_ns.is_none() {
            return Err(Refusal::FaultActive(TripCause::Started));
        }
        self.active.first(counts).map_or(Ok(()), |cause| Err(Refusal::FaultActive(cause)))
    }

    const fn wrong_state(&self, expected: WatchdogState) -> Refusal {
        Refusal::State { expected, found: self.state }
    }

    fn trip(&mut self, cause: TripCause, now_ns: u64) {
        self.cause = cause;
        self.change_state(WatchdogState::Tripped, now_ns);
    }

    fn change_state(&mut self, to: WatchdogState, now_ns: u64) {
        if self.state == WatchdogState::Enabled {
            self.unpowered_ns = Some(now_ns);
        }
        self.state = to;
    }

    /// Whether the token that a peer echoes is too old, or one that we never issued.
    fn echo_lost(&self, echoed: u64, now_ns: u64) -> bool {
        match self.sequence.checked_sub(echoed) {
            // Tokens issued so far have sequences below `sequence`.
            None | Some(0) => true,
            Some(behind) if behind > ISSUED as u64 => true,
            Some(_) => {
                now_ns.saturating_sub(self.issued_ns[echoed as usize % ISSUED])
                    > self.config.echo_lost_ns
            }
        }
    }

    fn token(&self, now_ns: u64) -> EnableToken {
        let enabled = self.state == WatchdogState::Enabled;
        EnableToken {
            session: self.config.session,
            incarnation: self.config.incarnation,
            sequence: self.sequence,
            time_ns: now_ns,
            epoch: self.epoch,
            watchdog_incarnation: self.config.incarnation,
            acquisition_incarnation: self
                .samples
                .newest
                .as_ref()
                .map_or(0, |sample| sample.incarnation),
            control_incarnation: self
                .commands
                .newest
                .as_ref()
                .map_or(0, |command| command.incarnation),
            issued_ns: now_ns,
            valid_until_ns: now_ns.saturating_add(if enabled {
                self.config.token_life_ns
            } else {
                0
            }),
            sample_tick: self.samples.newest.as_ref().map_or(0, |sample| sample.tick),
            faults: self.active.bits(),
            enabled: u8::from(enabled),
            state: self.state.code(),
            cause: self.cause.code(),
            profile: self.config.profile.code(),
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
