//! The watchdog's safety requirements (docs/safety-case.md): the fault table, the verbs, and
//! properties.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod arming;
mod axes;
mod checked;
mod exhaustive;
mod faults;
mod homing;
mod motor_power;
mod plausibility;
mod properties;
mod range_of_motion;
mod times;
#[path = "../../../runtime/tests/gate/walk.rs"]
mod walk;
mod world;

use ipc_types::{GateState, Message, Profile, TripCause, Verb, WatchdogState};
use watchdog::interlock::{Interlock, Peers, Refusal};

use arming::ARM;
use world::{COUNT, MS, SESSION, World, config};

#[test]
fn sr_12_gate_latched_trips() {
    for (state, epoch_offset) in
        [(GateState::LatchedClosed, 0), (GateState::Closed, 0), (GateState::Open, 1)]
    {
        let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
        world.gate_obeys = false;
        world.sample.gate_state = state.code();
        world.sample.epoch += epoch_offset;
        world.cycle();
        assert_eq!(
            (world.interlock.state(), world.interlock.cause()),
            (WatchdogState::Tripped, TripCause::GateLatched)
        );
    }
}

#[test]
fn sr_12_gate_latched_before_it_opened_trips_an_earlier_latched_epoch_does_not() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Armed);
    world.gate_obeys = false;
    world.sample.gate_state = GateState::LatchedClosed.code();
    world.verb(Verb::Enable).unwrap();
    world.cycles(5);
    assert_eq!(world.interlock.state(), WatchdogState::Enabled);
    world.sample.epoch = world.token.epoch;
    world.cycle();
    assert_eq!(
        (world.interlock.state(), world.interlock.cause()),
        (WatchdogState::Tripped, TripCause::GateLatched)
    );
}

#[test]
fn sr_12_a_gate_that_waits_in_this_epoch_trips_nothing() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Armed);
    world.verb(Verb::Enable).unwrap();
    world.gate_obeys = false;
    world.step();
    world.sample.epoch = world.token.epoch;
    world.sample.gate_state = GateState::Closed.code();
    world.cycles(15);
    assert_eq!(world.interlock.state(), WatchdogState::Enabled, "no command yet");
    world.sample.gate_state = GateState::Open.code();
    world.cycles(100);
    assert_eq!(world.interlock.state(), WatchdogState::Enabled);
}

#[test]
fn sr_12_gate_that_does_not_open_trips() {
    for (profile, within) in [(Profile::Realtime, 20), (Profile::BestEffort, 150)] {
        let mut world = World::in_state(profile, WatchdogState::Armed);
        world.gate_obeys = false;
        world.verb(Verb::Enable).unwrap();
        world.cycles(within);
        assert_eq!(world.interlock.state(), WatchdogState::Enabled);
        world.cycle();
        assert_eq!(
            (world.interlock.state(), world.interlock.cause()),
            (WatchdogState::Tripped, TripCause::GateNotOpen)
        );
    }
}

#[test]
fn sr_13_lost_echo_trips() {
    for (profile, within) in [(Profile::Realtime, 13), (Profile::BestEffort, 100)] {
        for from_sample in [true, false] {
            let mut world = World::in_state(profile, WatchdogState::Enabled);
            let old = world.token.sequence;
            let mut cycles = 0;
            while world.interlock.state() == WatchdogState::Enabled && cycles < 200 {
                world.now += MS;
                let token = world.token.sequence;
                if from_sample {
                    world.token.sequence = old;
                }
                world.sample_now();
                world.token.sequence = if from_sample { token } else { old };
                world.command_now();
                world.token.sequence = token;
                world.step();
                cycles += 1;
            }
            assert_eq!(
                (world.interlock.cause(), cycles),
                (TripCause::EchoLost, within + 1),
                "{profile}"
            );
        }
    }
}

#[test]
fn sr_13_an_echo_of_a_token_that_was_never_issued_trips() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
    world.token.sequence += 1;
    world.cycle();
    assert_eq!(world.interlock.cause(), TripCause::EchoLost);
}

#[test]
fn sr_16_verbs_in_each_state() {
    use WatchdogState::{Armed, Disarmed, Enabled, Faulted, Tripped};
    for (state, reset, arm, enable, disarm) in [
        (Faulted, Some(Disarmed), None, None, Some(Faulted)),
        (Disarmed, Some(Disarmed), Some(Armed), None, Some(Disarmed)),
        (Armed, None, None, Some(Enabled), Some(Disarmed)),
        (Enabled, None, None, None, Some(Disarmed)),
        (Tripped, Some(Disarmed), None, None, Some(Tripped)),
    ] {
        for (verb, expected) in [
            (Verb::Reset, reset),
            (Verb::Arm, arm),
            (Verb::ArmUnchecked, arm),
            (Verb::Enable, enable),
            (Verb::Disarm, disarm),
            (Verb::Estop, Some(Tripped)),
        ] {
            let mut world = World::in_state(Profile::Realtime, state);
            let answer = world.verb(verb);
            assert_eq!(answer.ok(), expected, "{verb:?} in {state}");
            if let Err(refusal) = answer {
                assert_eq!(world.interlock.state(), state);
                assert!(!refusal.to_string().is_empty());
            }
            let output = world.cycle();
            let to = expected.unwrap_or(state);
            let event = (to != state).then_some((state, to));
            assert_eq!(
                output.event.map(|change| (change.from, change.to)),
                event,
                "{verb:?} in {state}"
            );
            assert_eq!(world.interlock.state(), to);
        }
    }
}

#[test]
fn sr_16_estop_latches() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
    world.verb(Verb::Estop).unwrap();
    let output = world.cycle();
    assert_eq!((output.token.enabled, output.token.cause), (0, TripCause::EmergencyStop.code()));
    world.cycles(500);
    assert_eq!(world.interlock.state(), WatchdogState::Tripped);
}

#[test]
fn sr_16_arms_at_rest_only() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Disarmed);
    let mut position = 0.0;
    let mut moving = |world: &mut World| {
        for tick in 0..20 {
            position += 1.0 * 5e-4;
            world.sample.master_position[0] = (position / COUNT).floor() * COUNT;
            world.now += MS / 2;
            world.sample_now();
            if tick % 2 == 1 {
                world.command_now();
            }
            world.step();
        }
    };
    moving(&mut world);
    for arm in ARM {
        assert_eq!(world.verb(arm), Err(Refusal::Moving));
    }
    world.cycles(20);
    assert_eq!(world.verb(Verb::Arm), Ok(WatchdogState::Armed));
    let mut world = World::new(Profile::Realtime);
    world.cycles(2);
    world.verb(Verb::Reset).unwrap();
    for arm in ARM {
        assert_eq!(world.verb(arm), Err(Refusal::SpeedUnknown));
    }
}

#[test]
fn sr_16_refuses_to_arm_a_gate_that_is_open_without_permission() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Disarmed);
    world.gate_obeys = false;
    world.sample.gate_state = GateState::Open.code();
    world.cycle();
    for arm in ARM {
        assert_eq!(world.verb(arm), Err(Refusal::GateOpen));
    }
}

#[test]
fn sr_16_volts_that_outlive_the_permission_are_a_fault() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
    world.sample.output_v[0] = 1.0;
    world.cycles(5);
    world.verb(Verb::Disarm).unwrap();
    world.cycles(13);
    assert_eq!(world.interlock.state(), WatchdogState::Disarmed);
    world.cycle();
    assert_eq!(
        (world.interlock.state(), world.interlock.cause()),
        (WatchdogState::Faulted, TripCause::VoltageLimit)
    );
}

#[test]
fn sr_17_nothing_is_allowed_before_the_first_step() {
    let mut interlock = Interlock::new(config(Profile::Realtime));
    for verb in [Verb::Reset, Verb::Arm, Verb::Enable] {
        assert!(interlock.command(verb, MS).is_err());
    }
    let output = interlock.step(MS, Peers::ALIVE);
    assert_eq!((output.token.enabled, output.token.state), (0, WatchdogState::Faulted.code()));
    assert_eq!(output.token.cause, TripCause::Started.code());
    assert_eq!(
        interlock.command(Verb::Reset, MS),
        Err(Refusal::FaultActive(TripCause::AcquisitionLost))
    );
}

#[test]
fn sr_17_token_names_whom_it_is_for_and_how_long_it_holds() {
    for (profile, life) in [(Profile::Realtime, 5 * MS), (Profile::BestEffort, 40 * MS)] {
        let mut world = World::in_state(profile, WatchdogState::Enabled);
        let token = world.cycle().token;
        assert_eq!(
            (token.session, token.incarnation, token.watchdog_incarnation),
            (SESSION, 31, 31)
        );
        assert_eq!((token.acquisition_incarnation, token.control_incarnation), (21, 41));
        assert_eq!((token.issued_ns, token.valid_until_ns), (world.now, world.now + life));
        assert_eq!((token.sample_tick, token.faults), (world.sample.tick, 0));
        assert!(token.command_sequence > 0);
        assert_eq!(token.command_sequence, world.command.sequence);
        assert_eq!((token.time_ns, token.profile), (world.now, profile.code()));
    }
}

#[test]
fn sr_18_epochs_rise_over_restarts_and_above_any_that_was_seen() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
    let first = world.token.epoch;
    // Another watchdog: a new interlock in front of the same rig.
    world.interlock = Interlock::new(config(Profile::Realtime));
    world.cycles(300);
    for verb in [Verb::Reset, Verb::Arm, Verb::Enable] {
        world.verb(verb).unwrap();
    }
    let second = world.cycle().token.epoch;
    assert!(second > first);
    world.verb(Verb::Disarm).unwrap();
    world.gate_obeys = false;
    world.sample.epoch = second + 1_000_000_000_000;
    world.cycles(100);
    for verb in [Verb::Arm, Verb::Enable] {
        world.verb(verb).unwrap();
    }
    assert!(world.cycle().token.epoch > world.sample.epoch);
    world.verb(Verb::Estop).unwrap();
    world.sample.epoch = u64::MAX;
    world.cycles(100);
    world.verb(Verb::Reset).unwrap();
    world.verb(Verb::Arm).unwrap();
    assert_eq!(world.verb(Verb::Enable), Err(Refusal::EpochExhausted));
}

#[test]
fn sr_19_stopping_any_party_ends_in_a_trip() {
    // Acquisition, control, watchdog: each stopped for 70 ms and let go again.
    for party in 0..3 {
        for profile in [Profile::Realtime, Profile::BestEffort] {
            let mut world = World::in_state(profile, WatchdogState::Enabled);
            match party {
                0 => world.acquisition_runs = false,
                1 => world.control_runs = false,
                _ => world.now += 70 * MS,
            }
            if party < 2 {
                world.cycles(70);
            }
            (world.acquisition_runs, world.control_runs) = (true, true);
            world.cycles(500);
            assert_eq!(world.interlock.state(), WatchdogState::Tripped, "party {party}, {profile}");
        }
    }
}

#[test]
fn sr_19_two_controls_that_alternate_trip_and_cannot_be_reset() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
    for cycle in 0..100 {
        // Slowly enough that most cycles see but one of them.
        if cycle % 7 == 0 {
            world.command.incarnation = if world.command.incarnation == 41 { 42 } else { 41 };
        }
        world.cycle();
        assert_eq!(world.interlock.state(), WatchdogState::Tripped);
        assert_eq!(world.verb(Verb::Reset), Err(Refusal::FaultActive(TripCause::ControlChanged)));
    }
    world.cycles(20);
    assert_eq!(world.verb(Verb::Reset), Ok(WatchdogState::Disarmed));
}

#[test]
fn sr_19_best_effort_jitter_trips_nothing() {
    let mut world = World::in_state(Profile::BestEffort, WatchdogState::Enabled);
    for cycle in 0..1000u64 {
        // Up to 20 ms late, the messages too.
        world.now += (cycle * 7919) % 21 * MS;
        world.cycle();
        assert_eq!(world.interlock.state(), WatchdogState::Enabled, "{}", world.interlock.cause());
    }
    assert!(world.sample.time_ns() > 0);
}

/// The card drops the motor 5 / 40 ms after the last toggle: from the death of acquisition to then
/// it must not take longer than 10 / 60 ms, and a pause that could make the card drop the motor
/// must not end in power.
#[test]
fn sr_24_a_line_without_fresh_samples_pauses_and_a_long_pause_trips() {
    for (profile, patience_ms, bound_ms) in
        [(Profile::Realtime, 5, 10), (Profile::BestEffort, 40, 60)]
    {
        let mut world = World::in_state(profile, WatchdogState::Enabled);
        world.acquisition_runs = false;
        let died = world.sample.scan_time_ns;
        let mut last_toggle = world.now;
        let mut tripped = None;
        for _ in 0..100 {
            let output = world.cycle();
            if output.toggle_line {
                assert_eq!(tripped, None, "the line toggles after the trip");
                last_toggle = world.now;
            }
            if world.interlock.state() == WatchdogState::Tripped && tripped.is_none() {
                tripped = Some(world.now);
            }
        }
        let tripped = tripped.unwrap();
        let dropped = last_toggle + patience_ms * MS;
        assert!(dropped - died <= bound_ms * MS - MS, "{profile:?}: {} ns", dropped - died);
        assert!(
            tripped <= dropped,
            "{profile:?}: the card drops the motor before the watchdog trips"
        );
        assert_eq!(world.interlock.cause(), TripCause::AcquisitionLost);
    }
}

/// Samples that come back in time end the pause without a trip; those that come back late do not.
#[test]
fn sr_24_a_short_pause_is_borne_a_longer_one_is_not() {
    for (missing, expected) in [(4, WatchdogState::Enabled), (8, WatchdogState::Tripped)] {
        let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
        world.acquisition_runs = false;
        world.cycles(missing);
        world.acquisition_runs = true;
        world.cycles(20);
        assert_eq!(world.interlock.state(), expected, "{missing} ms without samples");
        assert_eq!(world.cycle().toggle_line, expected == WatchdogState::Enabled);
    }
}
