//! Epochs that end or wait, and a gate that is late itself.

use super::*;

#[test]
fn sr_07_a_disabled_token_withdraws_and_the_epoch_stays_closed() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.token.enabled = 0;
    let output = rig.step();
    assert_eq!(
        (output.state, output.cause, output.volts),
        (GateState::Closed, GateCause::Withdrawn, [0.0; AXES])
    );
    rig.token.enabled = 1;
    for _ in 0..20 {
        rig.renew();
        assert_eq!(rig.step().state, GateState::Closed);
    }
    rig.token.epoch = 2;
    rig.renew();
    assert_eq!(rig.step().state, GateState::Open);
}

#[test]
fn sr_07_a_withdrawal_hidden_between_two_cycles_counts() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.gate.observe_token(&EnableToken { enabled: 0, ..rig.token });
    rig.renew();
    let output = rig.step();
    assert_eq!((output.state, output.cause), (GateState::Closed, GateCause::Withdrawn));
}

#[test]
fn sr_07_a_withdrawn_epoch_never_opens_even_if_it_was_never_open() {
    let mut rig = Rig::new();
    rig.renew();
    rig.gate.observe_token(&EnableToken { enabled: 0, epoch: 5, ..rig.token });
    rig.token.epoch = 5;
    for _ in 0..20 {
        rig.renew();
        assert_eq!(rig.step().state, GateState::Closed);
    }
}

#[test]
fn sr_07_a_higher_epoch_ends_the_present_one_with_a_cycle_at_0_v() {
    let mut rig = Rig::opened();
    rig.renew();
    rig.token.epoch = 2;
    // That the present one ends is no violation of the next, of which a second token may come in
    // the same cycle.
    rig.gate.observe_token(&rig.token);
    rig.token.sequence += 1;
    let output = rig.step();
    assert_eq!(output.volts, [0.0; AXES]);
    assert_eq!((output.state, output.cause), (GateState::Closed, GateCause::Withdrawn));
    rig.renew();
    let output = rig.step();
    assert_eq!((output.state, output.epoch), (GateState::Open, 2));
}

#[test]
fn sr_07_an_ended_epoch_waits_for_nothing() {
    let mut rig = Rig::opened();
    assert_eq!(rig.step().hindrance, GateCause::None, "open");
    rig.gate.write_failed();
    rig.renew();
    assert_eq!(rig.step().hindrance, GateCause::None, "ended, though the token still permits it");
    let mut rig = Rig::new();
    (rig.token.enabled, rig.token.acquisition_incarnation) = (0, 22);
    rig.renew();
    assert_eq!(rig.step().hindrance, GateCause::None, "not permitted, nor meant for this gate");
}

#[test]
fn sr_08_a_waiting_epoch_survives_an_absent_or_stale_command() {
    let mut rig = Rig::new();
    let old = MotorCommand { computed_ns: START - 50 * MS, sequence: 0, ..rig.command };
    rig.renew();
    rig.gate.observe_token(&rig.token);
    assert_eq!(rig.gate.step(rig.now).hindrance, GateCause::CommandStale);
    rig.renew();
    rig.gate.observe_token(&rig.token);
    rig.gate.observe_command(&old);
    let output = rig.gate.step(rig.now);
    assert_eq!((output.state, output.hindrance), (GateState::Closed, GateCause::CommandStale));
    rig.renew();
    let sample_time = rig.command.sample_time_ns;
    rig.command.sample_time_ns = START - 50 * MS;
    assert_eq!(rig.step().hindrance, GateCause::CommandSampleOld);
    rig.command.sample_time_ns = sample_time;
    rig.renew();
    assert_eq!(rig.step().state, GateState::Open);
}

#[test]
fn sr_08_a_waiting_epoch_latches_on_a_bad_command() {
    type Spoil = fn(&mut MotorCommand);
    let cases: [(Spoil, GateCause); 3] = [
        (|command| command.volts[0] = 5.5, GateCause::CommandRange),
        (|command| command.volts[0] = f64::NAN, GateCause::CommandNotFinite),
        (|command| command.incarnation = 42, GateCause::CommandSender),
    ];
    for (spoil, cause) in cases {
        let mut rig = Rig::new();
        rig.renew();
        spoil(&mut rig.command);
        rig.latches_closed(cause);
    }
}

/// A violation ends the epoch that was permitted when it came, also where the step that follows
/// has something else to tell.
#[test]
fn sr_08_a_violation_ends_its_epoch_whatever_else_its_cycle_brings() {
    type Hide = fn(&mut Rig);
    let hidings: [(&str, Hide); 4] = [
        ("a refused write", |rig| {
            rig.renew();
            rig.gate.observe_token(&rig.token);
            rig.gate.step(rig.now);
            rig.gate.write_failed();
            bad_command(rig);
        }),
        ("the end of the epoch before", bad_command_in_the_next_epoch),
        ("the same, after an epoch with a violation of its own", |rig| {
            rig.renew();
            rig.gate.observe_token(&rig.token);
            bad_command(rig);
            rig.gate.step(rig.now);
            rig.token.epoch = 2;
            bad_command_in_the_next_epoch(rig);
        }),
        ("a permission for another acquisition", |rig| {
            rig.renew();
            rig.gate.observe_token(&rig.token);
            bad_command(rig);
            rig.renew();
            rig.token.acquisition_incarnation = 22;
            rig.step();
            rig.token.acquisition_incarnation = ACQUISITION;
        }),
    ];
    for (what, hide) in hidings {
        let mut rig = Rig::new();
        hide(&mut rig);
        for _ in 0..20 {
            rig.renew();
            assert_ne!(rig.step().state, GateState::Open, "{what}");
        }
        let output = rig.step();
        assert_eq!(
            (output.state, output.cause),
            (GateState::LatchedClosed, GateCause::CommandRange),
            "{what}"
        );
        rig.token.epoch += 1;
        rig.renew();
        assert_eq!(rig.step().state, GateState::Open, "{what}");
    }
}

/// Opens the gate in the present epoch; then one cycle brings the next epoch, and its violation.
fn bad_command_in_the_next_epoch(rig: &mut Rig) {
    rig.renew();
    assert_eq!(rig.step().state, GateState::Open);
    rig.token.epoch += 1;
    rig.renew();
    rig.gate.observe_token(&rig.token);
    bad_command(rig);
}

fn bad_command(rig: &mut Rig) {
    rig.renew();
    rig.gate.observe_command(&MotorCommand { volts: [5.5, 0.0, 0.0], ..rig.command });
}

#[test]
fn sr_09_a_late_gate_latches() {
    let mut rig = Rig::opened();
    for _ in 0..11 {
        rig.renew();
    }
    rig.latches_closed(GateCause::GateLate);
}

#[test]
fn sr_09_a_gap_of_just_the_profile_s_time_is_not_late() {
    let mut rig = Rig::opened();
    for _ in 0..10 {
        rig.renew();
    }
    assert_eq!(rig.step().state, GateState::Open, "5 ms after the last step");
}

#[test]
fn sr_09_time_going_backwards_latches() {
    let mut rig = Rig::opened();
    rig.now -= 1;
    let output = rig.step();
    assert_eq!(
        (output.state, output.cause, output.volts),
        (GateState::LatchedClosed, GateCause::GateLate, [0.0; AXES])
    );
}

#[test]
fn sr_09_a_late_gate_does_not_open_in_that_cycle() {
    let mut rig = Rig::new();
    rig.gate.step(rig.now);
    for _ in 0..11 {
        rig.renew();
    }
    let output = rig.step();
    assert_eq!((output.state, output.hindrance), (GateState::Closed, GateCause::GateLate));
    rig.renew();
    assert_eq!(rig.step().state, GateState::Open);
}

#[test]
fn sr_09_a_refused_write_latches() {
    let mut rig = Rig::opened();
    let output = rig.gate.write_failed();
    assert_eq!(output.volts, [0.0; AXES]);
    assert_eq!(
        (output.state, output.cause),
        (GateState::LatchedClosed, GateCause::WriteFailed),
        "what acquisition records of this cycle"
    );
    rig.renew();
    rig.latches_closed(GateCause::WriteFailed);
}
