//! The gate's safety requirements (docs/safety-case.md): one test per cause, and properties over
//! arbitrary streams.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod checked;
mod commands;
mod epochs;
mod exhaustive;
mod oracle;
mod properties;
mod walk;

use ipc_types::{AXES, EnableToken, GateCause, GateState, MotorCommand, Profile};
use runtime::gate::{Gate, GateConfig, GateOutput};

const SESSION: u64 = 11;
const ACQUISITION: u64 = 21;
const WATCHDOG: u64 = 31;
const CONTROL: u64 = 41;
const MS: u64 = 1_000_000;
const START: u64 = 1_000 * MS;
const CYCLE: u64 = MS / 2;

fn config() -> GateConfig {
    GateConfig::for_profile(Profile::Realtime, SESSION, ACQUISITION, 2, [5.0, 3.0, 9.0])
}

/// A gate with a watchdog and a control in good order in front of it.
struct Rig {
    gate: Gate,
    now: u64,
    token: EnableToken,
    command: MotorCommand,
}

impl Rig {
    fn new() -> Self {
        let token = EnableToken {
            session: SESSION,
            incarnation: WATCHDOG,
            watchdog_incarnation: WATCHDOG,
            acquisition_incarnation: ACQUISITION,
            control_incarnation: CONTROL,
            epoch: 1,
            enabled: 1,
            ..EnableToken::default()
        };
        let command = MotorCommand {
            session: SESSION,
            incarnation: CONTROL,
            volts: [1.5, -2.0, 0.0],
            ..MotorCommand::default()
        };
        Self { gate: Gate::new(config()), now: START, token, command }
    }

    /// Next messages of both, as they would be published now.
    fn renew(&mut self) {
        self.now += CYCLE;
        self.token.sequence += 1;
        self.token.time_ns = self.now;
        self.token.issued_ns = self.now;
        self.token.valid_until_ns = self.now + 5 * MS;
        self.command.sequence += 1;
        self.command.time_ns = self.now;
        self.command.computed_ns = self.now;
        self.command.sample_time_ns = self.now - CYCLE;
        self.command.sample_tick += 1;
    }

    fn step(&mut self) -> GateOutput {
        self.gate.observe_token(&self.token);
        self.gate.observe_command(&self.command);
        self.gate.step(self.now)
    }

    fn opened() -> Self {
        let mut rig = Self::new();
        rig.renew();
        let output = rig.step();
        assert_eq!((output.state, output.volts), (GateState::Open, [1.5, -2.0, 0.0]));
        rig
    }

    /// The next cycle ends the epoch with this cause, good messages do not open it again, a higher
    /// epoch does.
    fn latches_closed(mut self, cause: GateCause) {
        let epoch = self.token.epoch.min(1);
        let output = self.step();
        assert_eq!(
            (output.state, output.cause, output.volts),
            (GateState::LatchedClosed, cause, [0.0; AXES])
        );
        let mut good = Self::new();
        good.gate = self.gate;
        good.now = self.now;
        good.token.sequence = self.token.sequence + 10;
        good.command.sequence = self.command.sequence + 10;
        good.command.sample_tick = self.command.sample_tick + 10;
        good.token.epoch = epoch;
        for _ in 0..50 {
            good.renew();
            let output = good.step();
            assert_eq!((output.volts, output.cause), ([0.0; AXES], cause));
            assert_ne!(output.state, GateState::Open);
        }
        good.token.epoch = 2;
        good.renew();
        assert_eq!(good.step().state, GateState::Open);
    }
}

#[test]
fn sr_01_passes_fresh_commands_and_nothing_before_the_first_token() {
    let mut rig = Rig::new();
    rig.renew();
    rig.gate.observe_command(&rig.command);
    let output = rig.gate.step(rig.now);
    assert_eq!((output.state, output.volts), (GateState::Closed, [0.0; AXES]));
    for _ in 0..100 {
        rig.renew();
        let output = rig.step();
        assert_eq!(
            (output.state, output.volts, output.epoch),
            (GateState::Open, rig.command.volts, 1)
        );
        assert_eq!(output.token_sequence, rig.token.sequence);
        assert_eq!(output.command_sequence, rig.command.sequence);
        assert_eq!(output.command_incarnation, CONTROL);
    }
}

#[test]
fn sr_01_epoch_zero_never_opens() {
    let mut rig = Rig::new();
    rig.token.epoch = 0;
    rig.renew();
    assert_eq!(rig.step().state, GateState::Closed);
}

#[test]
fn sr_01_the_same_messages_again_pass_until_they_are_stale() {
    let mut rig = Rig::opened();
    let mut open = 0;
    while rig.step().state == GateState::Open && open < 100 {
        rig.now += CYCLE;
        open += 1;
    }
    // 5 ms at 0.5 ms a cycle, the instant of expiry itself included.
    assert_eq!(open, 11);
}

#[test]
fn sr_02_stale_token_latches() {
    let mut rig = Rig::opened();
    for _ in 0..10 {
        let token = rig.token;
        rig.renew();
        rig.token = token;
        assert_eq!(rig.step().state, GateState::Open);
    }
    let token = rig.token;
    rig.renew();
    rig.token = token;
    rig.latches_closed(GateCause::TokenStale);
}

#[test]
fn sr_02_a_token_may_expire_sooner_than_the_profile_allows() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.token.valid_until_ns = rig.now + MS;
    assert_eq!(rig.step().state, GateState::Open);
    let token = rig.token;
    rig.renew();
    rig.renew();
    rig.renew();
    rig.token = token;
    rig.latches_closed(GateCause::TokenStale);
}

#[test]
fn sr_02_a_token_of_too_long_a_life_latches() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.token.valid_until_ns = rig.now + 5 * MS + 1;
    rig.latches_closed(GateCause::TokenTime);
}

#[test]
fn sr_02_a_token_from_the_future_latches() {
    for field in 0..2 {
        let mut rig = Rig::opened();
        rig.renew();
        let future = rig.now + config().future_ns + 1;
        match field {
            0 => (rig.token.issued_ns, rig.token.valid_until_ns) = (future, future + MS),
            _ => rig.token.time_ns = future,
        }
        rig.latches_closed(GateCause::TokenTime);
    }
}

/// A message may be published between the reading of the clock and the receive.
#[test]
fn sr_02_a_message_from_just_ahead_of_the_clock_passes() {
    for field in 0..5 {
        let mut rig = Rig::opened();
        rig.renew();
        let ahead = rig.now + config().future_ns;
        match field {
            0 => (rig.token.issued_ns, rig.token.valid_until_ns) = (ahead, ahead + MS),
            1 => rig.token.time_ns = ahead,
            2 => rig.command.computed_ns = ahead,
            3 => rig.command.time_ns = ahead,
            _ => rig.command.sample_time_ns = ahead,
        }
        assert_eq!(rig.step().state, GateState::Open, "field {field}");
    }
}

#[test]
fn sr_02_a_token_that_ends_before_it_begins_latches() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.token.valid_until_ns = rig.token.issued_ns - 1;
    rig.latches_closed(GateCause::TokenTime);
}

#[test]
fn sr_03_token_sequence_backwards_latches() {
    for by in [0, 1, 7] {
        let mut rig = Rig::opened();
        for _ in 0..10 {
            rig.renew();
            rig.step();
        }
        let sequence = rig.token.sequence;
        rig.renew();
        rig.token.sequence = sequence - by;
        rig.latches_closed(GateCause::TokenBackwards);
    }
}

#[test]
fn sr_03_token_issued_earlier_than_its_predecessor_latches() {
    let mut rig = Rig::opened();
    let issued = rig.token.issued_ns;
    rig.renew();
    rig.token.issued_ns = issued - 1;
    rig.latches_closed(GateCause::TokenBackwards);
}

#[test]
fn sr_03_epoch_backwards_latches() {
    let mut rig = Rig::new();
    rig.token.epoch = 2;
    rig.renew();
    assert_eq!(rig.step().state, GateState::Open);
    rig.renew();
    rig.token.epoch = 1;
    let output = rig.step();
    assert_eq!((output.state, output.cause), (GateState::LatchedClosed, GateCause::EpochBackwards));
    rig.token.epoch = 2;
    for _ in 0..20 {
        rig.renew();
        assert_eq!(rig.step().state, GateState::LatchedClosed);
    }
}

#[test]
fn sr_03_an_epoch_below_one_that_was_given_to_another_acquisition_never_opens() {
    let mut rig = Rig::new();
    (rig.token.epoch, rig.token.acquisition_incarnation) = (2, 22);
    rig.renew();
    assert_eq!(rig.step().hindrance, GateCause::TokenReceiver);
    (rig.token.epoch, rig.token.acquisition_incarnation) = (1, ACQUISITION);
    for _ in 0..20 {
        rig.renew();
        assert_eq!(rig.step().state, GateState::Closed);
    }
    rig.token.epoch = 2;
    rig.renew();
    assert_eq!(rig.step().state, GateState::Open);
}

#[test]
fn sr_03_a_backward_step_hidden_between_two_cycles_latches() {
    let mut rig = Rig::opened();
    let old = rig.command;
    rig.renew();
    rig.gate.observe_command(&rig.command);
    rig.gate.observe_command(&MotorCommand { volts: [0.1, 0.0, 0.0], ..old });
    rig.renew();
    rig.latches_closed(GateCause::CommandBackwards);
}

#[test]
fn sr_04_token_of_another_session_latches() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.token.session = 12;
    rig.latches_closed(GateCause::TokenSession);
}

#[test]
fn sr_04_command_of_another_session_latches() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.command.session = 12;
    rig.latches_closed(GateCause::CommandSession);
}

#[test]
fn sr_04_token_whose_sender_is_not_the_one_it_names_latches() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.token.incarnation = 99;
    rig.latches_closed(GateCause::TokenSender);
}

#[test]
fn sr_04_another_watchdog_within_the_epoch_latches_enabled_or_not() {
    for enabled in [0, 1] {
        let mut rig = Rig::opened();
        rig.renew();
        let other = EnableToken { incarnation: 32, watchdog_incarnation: 32, enabled, ..rig.token };
        rig.gate.observe_token(&other);
        rig.latches_closed(GateCause::TokenSender);
    }
}

#[test]
fn sr_04_token_for_another_acquisition_latches() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.token.acquisition_incarnation = 22;
    rig.latches_closed(GateCause::TokenReceiver);
}

#[test]
fn sr_04_a_new_acquisition_never_opens_for_the_token_of_the_one_before() {
    let mut rig = Rig::new();
    rig.token.acquisition_incarnation = 20;
    for _ in 0..50 {
        rig.renew();
        let output = rig.step();
        assert_eq!((output.state, output.hindrance), (GateState::Closed, GateCause::TokenReceiver));
    }
}

#[test]
fn sr_04_command_from_another_control_latches() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.command.incarnation = 42;
    rig.latches_closed(GateCause::CommandSender);
}

#[test]
fn sr_04_two_interleaved_controls_latch_even_if_the_named_one_speaks_last() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.gate.observe_command(&MotorCommand { incarnation: 42, ..rig.command });
    rig.latches_closed(GateCause::CommandSender);
}

#[test]
fn sr_04_an_epoch_that_two_watchdogs_speak_in_never_opens() {
    for enabled in [0, 1] {
        let mut rig = Rig::new();
        rig.token.epoch = 3;
        rig.renew();
        rig.gate.observe_token(&rig.token);
        let other = EnableToken {
            incarnation: 32,
            watchdog_incarnation: 32,
            epoch: 2 + enabled,
            ..rig.token
        };
        rig.gate.observe_token(&EnableToken { enabled: enabled as u8, ..other });
        for _ in 0..20 {
            rig.renew();
            assert_ne!(rig.step().state, GateState::Open);
        }
        rig.token.epoch = 4;
        rig.renew();
        assert_eq!(rig.step().state, GateState::Open);
    }
}

#[test]
fn sr_04_two_controls_that_speak_while_an_epoch_waits_end_it() {
    let mut rig = Rig::new();
    rig.renew();
    rig.gate.observe_token(&rig.token);
    rig.gate.step(rig.now);
    rig.renew();
    rig.gate.observe_command(&MotorCommand { incarnation: 42, ..rig.command });
    rig.latches_closed(GateCause::CommandSender);
}

#[test]
fn sr_04_another_control_named_within_the_epoch_latches() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.token.control_incarnation = 42;
    rig.latches_closed(GateCause::CommandSender);
}
