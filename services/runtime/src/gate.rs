//! The gate: the last function before the DAC, and the first of the two independent ways to 0 V.
//!
//! Acquisition runs it once a cycle. It lets a command's volts pass only while the newest
//! [`EnableToken`] and the newest [`MotorCommand`] are fresh, in sequence, in range, finite, of
//! this session and from the senders that the token names. It *latches*: a violation closes
//! the gate and ends the enable epoch; only a strictly higher epoch (issued by the watchdog after
//! reset, arm and enable) opens the gate again.
//!
//! Pure: the time is an argument, nothing is allocated, no message is formatted.
//!
//! Use, once a cycle:
//! 1. pass every received message to [`Gate::observe_token`] and [`Gate::observe_command`], each
//!    topic's in the order received, so that a backward step or a foreign sender between two cycles
//!    is never missed; all tokens of a cycle before its commands, since two topics have no order
//!    between them;
//! 2. read the clock, *after* the last receive (a message published in between would seem to come
//!    from the future; [`GateConfig::future_ns`] tolerates a little);
//! 3. call [`Gate::step`] and write its volts; if the card refuses them, call
//!    [`Gate::write_failed`] and write its 0 V.
//!
//! Passing a message again is harmless.

use ipc_types::{
    AXES, EnableToken, GateCause, GateState, Message, MotorCommand, Profile, Timeouts,
};

/// What the gate needs to know about its rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GateConfig {
    /// Session of the rig.
    pub session: u64,
    /// Incarnation of the acquisition that runs this gate: only tokens that name it count.
    pub acquisition_incarnation: u64,
    /// Longest life that a token may claim, and have (ns).
    pub token_life_ns: u64,
    /// Longest life of a command, counted from when it was computed (ns).
    pub command_life_ns: u64,
    /// Longest time between two steps of the gate itself (ns).
    pub max_cycle_gap_ns: u64,
    /// Oldest sample that a command may answer, counted from its scan (ns).
    pub max_sample_age_ns: u64,
    /// How far ahead of the gate's clock a message's time may be (ns): covers a message that is
    /// published between reading the clock and receiving.
    pub future_ns: u64,
    /// Output limit of each axis, either sign (V). A limit that is not a positive number lets
    /// nothing pass.
    pub volts_max: [f64; AXES],
    /// Axes of the rig: those above get 0 V always.
    pub axes: usize,
}

impl GateConfig {
    /// The timeouts of a profile: 5 ms (realtime) or 40 ms (best-effort); a command may answer a
    /// sample of twice that age.
    pub fn for_profile(
        profile: Profile,
        session: u64,
        acquisition_incarnation: u64,
        axes: usize,
        volts_max: [f64; AXES],
    ) -> Self {
        let timeouts = Timeouts::of(profile);
        let life_ns = timeouts.token_ns;
        Self {
            session,
            acquisition_incarnation,
            token_life_ns: life_ns,
            command_life_ns: life_ns,
            max_cycle_gap_ns: life_ns,
            max_sample_age_ns: timeouts.answered_sample_ns(),
            future_ns: 100_000,
            volts_max,
            axes,
        }
    }
}

/// What the gate decided in one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GateOutput {
    /// Volts to write; 0 on every axis unless the state is [`GateState::Open`] (V).
    pub volts: [f64; AXES],
    /// State after this cycle.
    pub state: GateState,
    /// Why the last epoch ended.
    pub cause: GateCause,
    /// What keeps a gate that is not open from opening; [`GateCause::None`] while open, or without
    /// permission.
    pub hindrance: GateCause,
    /// Highest enable epoch that the gate saw.
    pub epoch: u64,
    /// Sequence of the newest token (challenge and response).
    pub token_sequence: u64,
    /// Sequence of the newest command.
    pub command_sequence: u64,
    /// Sender of the newest command.
    pub command_incarnation: u64,
    /// The time that the step was given (ns).
    pub now_ns: u64,
    /// Steps so far, this one included.
    pub cycles: u64,
}

/// The epoch that is open, and whose it is.
#[derive(Clone, Copy, Debug)]
struct OpenEpoch {
    epoch: u64,
    watchdog: u64,
    control: u64,
}

/// The gate. See the module's documentation.
#[derive(Clone, Debug)]
pub struct Gate {
    config: GateConfig,
    limits: [f64; AXES],
    open: Option<OpenEpoch>,
    closed_state: GateState,
    cause: GateCause,
    /// Highest ended epoch: none up to it ever opens again.
    ended_epoch: u64,
    seen_epoch: u64,
    token: Option<EnableToken>,
    command: Option<MotorCommand>,
    /// The message that came last was refused: nothing opens before a good one has come.
    token_refused: bool,
    command_refused: bool,
    /// First violation since the last step.
    violation: Option<GateCause>,
    /// The newest epoch in which a violation came after its permission, and the first such. The
    /// step alone would not end it where something else of that cycle counts first: a refused
    /// write, the end of the epoch before, a permission for another acquisition.
    spoilt: Option<(u64, GateCause)>,
    last_step_ns: Option<u64>,
    cycles: u64,
}

impl Gate {
    /// A closed gate.
    pub fn new(config: GateConfig) -> Self {
        let mut limits = [0.0; AXES];
        for (limit, &max) in limits.iter_mut().zip(&config.volts_max).take(config.axes) {
            if max.is_finite() && max > 0.0 {
                *limit = max;
            }
        }
        Self {
            config,
            limits,
            open: None,
            closed_state: GateState::Closed,
            cause: GateCause::None,
            ended_epoch: 0,
            seen_epoch: 0,
            token: None,
            command: None,
            token_refused: false,
            command_refused: false,
            violation: None,
            spoilt: None,
            last_step_ns: None,
            cycles: 0,
        }
    }

    /// Takes note of a received token. The same token again changes nothing.
    pub fn observe_token(&mut self, token: &EnableToken) {
        if self.token.as_ref() == Some(token) {
            return;
        }
        if token.session != self.config.session {
            return self.refuse_token(GateCause::TokenSession);
        }
        if token.incarnation != token.watchdog_incarnation {
            return self.refuse_token(GateCause::TokenSender);
        }
        self.seen_epoch = self.seen_epoch.max(token.epoch);
        let enabled = token.enabled == 1;
        if self.open.is_some_and(|open| token.watchdog_incarnation != open.watchdog) {
            self.note(GateCause::TokenSender);
        }
        // A withdrawal counts even where the token is out of order: it can only take power away.
        if !enabled {
            self.ended_epoch = self.ended_epoch.max(token.epoch);
        }
        // An epoch belongs to one watchdog: another one that speaks ends it, also before it opened.
        // Else the sequence of the first would be forgotten between its messages.
        if let Some(last) = self.token.filter(|last| last.incarnation != token.incarnation) {
            self.ended_epoch = self.ended_epoch.max(last.epoch);
        }
        if let Some(last) = self.token.as_mut().filter(|last| last.incarnation == token.incarnation)
        {
            let backwards = token.sequence <= last.sequence || token.issued_ns < last.issued_ns;
            if backwards || token.epoch < last.epoch {
                // What was refused still counts its number: nothing with that number passes later.
                last.sequence = last.sequence.max(token.sequence);
                return self.refuse_token(if backwards {
                    GateCause::TokenBackwards
                } else {
                    GateCause::EpochBackwards
                });
            }
        }
        if let Some(open) = self.open {
            if !enabled || token.epoch > open.epoch {
                self.note(GateCause::Withdrawn);
            } else if token.acquisition_incarnation != self.config.acquisition_incarnation {
                self.note(GateCause::TokenReceiver);
            } else if token.control_incarnation != open.control {
                self.note(GateCause::CommandSender);
            }
        }
        self.token = Some(*token);
        self.token_refused = false;
    }

    /// Takes note of a received command. The same command again changes nothing.
    pub fn observe_command(&mut self, command: &MotorCommand) {
        if self.command.as_ref().is_some_and(|last| last.as_bytes() == command.as_bytes()) {
            return;
        }
        if command.session != self.config.session {
            return self.refuse_command(GateCause::CommandSession);
        }
        if self.open.is_some_and(|open| command.incarnation != open.control) {
            self.note(GateCause::CommandSender);
        }
        let other =
            self.command.as_ref().is_some_and(|last| last.incarnation != command.incarnation);
        if other && self.pending().is_some() {
            // Two controls send commands during the permission, which is meant for one.
            self.violated(GateCause::CommandSender);
        }
        if let Some(last) =
            self.command.as_mut().filter(|last| last.incarnation == command.incarnation)
            && (command.sequence <= last.sequence
                || command.sample_tick < last.sample_tick
                || command.sample_time_ns < last.sample_time_ns
                || command.computed_ns < last.computed_ns)
        {
            last.sequence = last.sequence.max(command.sequence);
            return self.refuse_command(GateCause::CommandBackwards);
        }
        if let Err(cause) = self.check_volts(command) {
            self.violated(cause);
        }
        self.command = Some(*command);
        self.command_refused = false;
    }

    /// One cycle: what to write now. `now_ns` is CLOCK_MONOTONIC, read after the last receive.
    pub fn step(&mut self, now_ns: u64) -> GateOutput {
        // Also true when time went backwards: then nothing is known about the gap.
        let late = self.last_step_ns.is_some_and(|last| {
            now_ns.checked_sub(last).is_none_or(|gap| gap > self.config.max_cycle_gap_ns)
        });
        self.last_step_ns = Some(now_ns);
        self.cycles = self.cycles.wrapping_add(1);

        let violation = self.violation.take();
        let mut hindrance = GateCause::None;
        let mut volts = [0.0; AXES];
        if let Some(open) = self.open {
            let violation = violation.or(late.then_some(GateCause::GateLate));
            match violation.map_or_else(|| self.passing(now_ns), Err) {
                Ok(passed) => volts = passed,
                Err(cause) => self.latch_closed(open.epoch, cause),
            }
        } else if let Some(pending) = self.pending() {
            self.closed_state = GateState::Closed;
            let spoilt = self.spoilt.filter(|(epoch, _)| *epoch == pending.epoch);
            let violation = spoilt.map(|(_, cause)| cause).or(violation);
            match violation.map_or_else(|| self.passing(now_ns), Err) {
                Ok(_) if late => hindrance = GateCause::GateLate,
                Ok(passed) => {
                    self.open = Some(pending);
                    volts = passed;
                }
                Err(
                    cause @ (GateCause::TokenStale
                    | GateCause::CommandStale
                    | GateCause::CommandSampleOld
                    | GateCause::WriteFailed),
                ) => hindrance = cause,
                Err(cause) => {
                    self.latch_closed(pending.epoch, cause);
                    hindrance = cause;
                }
            }
        } else if self.token.is_some_and(|token| {
            token.enabled == 1
                && token.acquisition_incarnation != self.config.acquisition_incarnation
        }) {
            hindrance = GateCause::TokenReceiver;
        }
        GateOutput { hindrance, ..self.output(volts) }
    }

    fn output(&self, volts: [f64; AXES]) -> GateOutput {
        GateOutput {
            volts,
            state: self.state(),
            cause: self.cause,
            hindrance: GateCause::None,
            epoch: self.seen_epoch,
            token_sequence: self.token.map_or(0, |token| token.sequence),
            command_sequence: self.command.as_ref().map_or(0, |command| command.sequence),
            command_incarnation: self.command.as_ref().map_or(0, |command| command.incarnation),
            now_ns: self.last_step_ns.unwrap_or(0),
            cycles: self.cycles,
        }
    }

    /// The card refused the volts of the last step: an open epoch ends at once, a waiting one does
    /// not open in the next cycle. The result replaces that of the step: 0 V.
    pub fn write_failed(&mut self) -> GateOutput {
        match self.open {
            Some(open) => self.latch_closed(open.epoch, GateCause::WriteFailed),
            None => self.note(GateCause::WriteFailed),
        }
        self.output([0.0; AXES])
    }

    /// Present state.
    pub fn state(&self) -> GateState {
        if self.open.is_some() { GateState::Open } else { self.closed_state }
    }

    /// The epoch that the newest token permits, if the gate may still open for it.
    fn pending(&self) -> Option<OpenEpoch> {
        let token = self.token.as_ref()?;
        let ours = token.acquisition_incarnation == self.config.acquisition_incarnation;
        (token.enabled == 1 && ours && token.epoch > self.ended_epoch).then_some(OpenEpoch {
            epoch: token.epoch,
            watchdog: token.watchdog_incarnation,
            control: token.control_incarnation,
        })
    }

    /// Volts of the newest command if token and command let them pass now.
    fn passing(&self, now_ns: u64) -> Result<[f64; AXES], GateCause> {
        let token =
            self.token.as_ref().filter(|_| !self.token_refused).ok_or(GateCause::TokenStale)?;
        let newest_allowed_ns = now_ns.saturating_add(self.config.future_ns);
        let life_ns =
            token.valid_until_ns.checked_sub(token.issued_ns).ok_or(GateCause::TokenTime)?;
        if token.issued_ns > newest_allowed_ns
            || token.time_ns > newest_allowed_ns
            || life_ns > self.config.token_life_ns
        {
            return Err(GateCause::TokenTime);
        }
        if now_ns > token.valid_until_ns
            || now_ns.saturating_sub(token.issued_ns) > self.config.token_life_ns
        {
            return Err(GateCause::TokenStale);
        }
        let command = self
            .command
            .as_ref()
            .filter(|_| !self.command_refused)
            .ok_or(GateCause::CommandStale)?;
        if command.computed_ns > newest_allowed_ns
            || command.time_ns > newest_allowed_ns
            || command.sample_time_ns > newest_allowed_ns
        {
            return Err(GateCause::CommandTime);
        }
        if now_ns.saturating_sub(command.computed_ns) > self.config.command_life_ns {
            return Err(GateCause::CommandStale);
        }
        if command.incarnation != token.control_incarnation {
            return Err(GateCause::CommandSender);
        }
        self.check_volts(command)?;
        if now_ns.saturating_sub(command.sample_time_ns) > self.config.max_sample_age_ns {
            return Err(GateCause::CommandSampleOld);
        }
        Ok(command.volts)
    }

    /// Finite, within the limits, and 0 V on axes that the rig lacks.
    fn check_volts(&self, command: &MotorCommand) -> Result<(), GateCause> {
        if command.volts.iter().any(|volts| !volts.is_finite()) {
            return Err(GateCause::CommandNotFinite);
        }
        if command.volts.iter().zip(&self.limits).any(|(volts, limit)| volts.abs() > *limit) {
            return Err(GateCause::CommandRange);
        }
        Ok(())
    }

    /// Remembers the first cause until the next step, and no longer. What is measured against the
    /// open epoch concerns no epoch after it, for which a token may have come in the same cycle;
    /// and an epoch that waits outlasts a refused write.
    fn note(&mut self, cause: GateCause) {
        self.violation.get_or_insert(cause);
    }

    /// Remembers the first violation until the next step, and the epoch in which it came until
    /// that ends.
    fn violated(&mut self, cause: GateCause) {
        self.note(cause);
        if let Some(pending) = self.pending()
            && self.spoilt.is_none_or(|(epoch, _)| epoch != pending.epoch)
        {
            self.spoilt = Some((pending.epoch, cause));
        }
    }

    fn refuse_token(&mut self, cause: GateCause) {
        self.token_refused = true;
        self.violated(cause);
    }

    fn refuse_command(&mut self, cause: GateCause) {
        self.command_refused = true;
        self.violated(cause);
    }

    fn latch_closed(&mut self, epoch: u64, cause: GateCause) {
        self.ended_epoch = self.ended_epoch.max(epoch);
        self.open = None;
        self.cause = cause;
        // A withdrawal in good order is no alarm; it ends its epoch all the same.
        self.closed_state = if cause == GateCause::Withdrawn {
            GateState::Closed
        } else {
            GateState::LatchedClosed
        };
    }
}
