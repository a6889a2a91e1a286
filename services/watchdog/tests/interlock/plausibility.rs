//! SR-31 to SR-42, but for motor power: what the two sides, the output and the read-back tell about
//! the machine, and the loops about themselves.

use ipc_types::{Mode, Profile, TripCause, Verb, WatchdogState};
use rig::WithoutLogger;
use watchdog::interlock::{Config, Interlock, Refusal, TorqueInput};

use crate::world::{COUNT, MS, World, config};

pub(crate) const PROFILES: [Profile; 2] = [Profile::Realtime, Profile::BestEffort];

/// A rig under power whose gate has opened.
pub(crate) fn powered(profile: Profile) -> World {
    World::in_state(profile, WatchdogState::Enabled)
}

/// Runs `change` before each cycle of 1 ms; returns the cause of the trip, and after how many
/// cycles it came.
pub(crate) fn trips(
    world: &mut World,
    cycles: usize,
    mut change: impl FnMut(&mut World, usize),
) -> Option<(TripCause, usize)> {
    (1..=cycles).find_map(|cycle| {
        change(world, cycle);
        world.cycle();
        let tripped = world.interlock.state() == WatchdogState::Tripped;
        tripped.then(|| (world.interlock.cause(), cycle))
    })
}

/// Moves a side to a position, with its count.
fn place(world: &mut World, master: f64, slave: f64) {
    world.sample.master_position[0] = master;
    world.sample.master_counts[0] = (master / COUNT) as i64;
    world.sample.slave_position[0] = slave;
    world.sample.slave_counts[0] = (slave / COUNT) as i64;
}

#[test]
fn sr_31_following_error_trips_where_both_sides_are_far_from_the_reference() {
    for profile in PROFILES {
        for mode in [Mode::Hold, Mode::Position, Mode::Centre, Mode::Learning] {
            let mut world = powered(profile);
            world.command.mode = mode.code();
            world.command.epoch = world.token.epoch;
            let found = trips(&mut world, 400, |world, cycle| {
                world.command.reference_position[0] = cycle as f64 * 1e-3;
            });
            // The sample after the command that shows 0.2 rad.
            let Some((TripCause::FollowingError, cycle)) = found else { panic!("{found:?}") };
            assert!((201..=203).contains(&cycle), "{profile} {mode}: {cycle}");
        }
    }
}

#[test]
fn sr_31_the_limit_grows_with_the_speed_of_the_reference() {
    let mut world = powered(Profile::Realtime);
    world.command.mode = Mode::Position.code();
    world.command.epoch = world.token.epoch;
    world.command.reference_position[0] = 0.39;
    world.command.reference_velocity[0] = -4.0;
    assert_eq!(trips(&mut world, 50, |_, _| {}), None, "0.2 + 0.05 s · 4 rad/s");
    world.command.reference_position[0] = 0.41;
    let found = trips(&mut world, 3, |_, _| {});
    assert!(matches!(found, Some((TripCause::FollowingError, _))), "{found:?}");
}

#[test]
fn sr_31_no_following_error_where_the_hand_leads_or_one_side_follows() {
    for mode in [Mode::Passive, Mode::Impedance, Mode::Rhythm, Mode::Initialise] {
        let mut world = powered(Profile::Realtime);
        world.command.mode = mode.code();
        world.command.epoch = world.token.epoch;
        world.command.reference_position[0] = 0.9;
        assert_eq!(trips(&mut world, 50, |_, _| {}), None, "{mode}");
    }
    let mut world = powered(Profile::Realtime);
    world.command.mode = Mode::Position.code();
    world.command.epoch = world.token.epoch;
    world.command.ramping = 1;
    world.command.reference_position[0] = 0.9;
    assert_eq!(trips(&mut world, 50, |_, _| {}), None, "it ramps from the measured position");
    world.command.ramping = 0;
    // The slave is where the reference is; the master has wound up the line by 0.25 rad.
    let found = trips(&mut world, 250, |world, cycle| {
        let slave = cycle as f64 * 1e-3;
        world.command.reference_position[0] = slave;
        place(world, 2.0 * slave, slave);
    });
    assert_eq!(found, None);
}

#[test]
fn sr_32_an_encoder_that_counts_nothing_while_the_other_side_moves_trips() {
    for profile in PROFILES {
        for master_moves in [true, false] {
            let mut world = powered(profile);
            let found = trips(&mut world, 400, |world, cycle| {
                // Not to the limit of 0.15 rad itself, but past it.
                let way = cycle as f64 * 2.1e-3;
                place(
                    world,
                    if master_moves { way } else { 0.0 },
                    if master_moves { 0.0 } else { way },
                );
            });
            let Some((TripCause::EncoderStuck, cycle)) = found else { panic!("{found:?}") };
            assert!((72..=73).contains(&cycle), "{profile}: {cycle}");
        }
    }
}

#[test]
fn sr_33_master_and_slave_that_move_apart_trip() {
    let mut world = powered(Profile::Realtime);
    let mut apart = |world: &mut World, cycle: usize| {
        let way = cycle as f64 * 2e-3;
        place(world, way, 0.25 * way);
    };
    let found = trips(&mut world, 400, &mut apart);
    let Some((TripCause::Disagreement, cycle)) = found else { panic!("{found:?}") };
    assert!((200..=202).contains(&cycle), "{cycle}");
    // A search for the stops winds the line up, and holds the slave.
    let mut world = powered(Profile::Realtime);
    world.command.mode = Mode::Initialise.code();
    world.command.epoch = world.token.epoch;
    assert_eq!(trips(&mut world, 400, &mut apart), None);
    let held = world.sample.slave_position[0];
    let from = world.sample.master_position[0];
    let found = trips(&mut world, 100, |world, cycle| {
        place(world, from - cycle as f64 * 2e-3, held);
    });
    assert_eq!(found, None);
}

#[test]
fn sr_33_a_difference_from_before_the_power_and_a_new_zero_are_no_disagreement() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Disarmed);
    // While nothing has power the line may leak, and a hand may wind it up.
    for cycle in 0..400 {
        place(&mut world, 0.0, -1e-3 * f64::from(cycle));
        world.cycle();
    }
    for verb in [Verb::Arm, Verb::Enable] {
        world.verb(verb).unwrap();
        world.cycles(30);
    }
    assert_eq!(trips(&mut world, 100, |_, _| {}), None);
    // The same machine, from another zero.
    world.sample.homing_sequence += 1;
    place(&mut world, 0.0, 0.5);
    world.sample.slave_counts[0] = (-0.4 / COUNT) as i64;
    assert_eq!(trips(&mut world, 100, |_, _| {}), None);
}

#[test]
fn sr_34_an_output_at_its_limit_for_too_long_trips() {
    // Control's own limit may be below the gate's, which is 5 V here.
    let cases = [
        (8.0, 5.0, true),
        (8.0, -5.0, true),
        (8.0, 4.9, false),
        (3.0, -3.0, true),
        (3.0, 2.9, false),
    ];
    for (output_limit_v, volts, expected) in cases {
        let mut world = powered(Profile::Realtime);
        // No rating, which would act first.
        let mut without = config(Profile::Realtime);
        without.axes[0].plausibility.thermal = None;
        without.axes[0].control.output_limit_v = output_limit_v;
        world.interlock = Interlock::new(without);
        power_up(&mut world);
        let found = trips(&mut world, 300, |world, cycle| {
            // A short release begins the time anew.
            let volts = if cycle == 90 { 0.0 } else { volts };
            (world.sample.output_v[0], world.sample.motor_v[0]) = (volts, volts);
        });
        match found {
            Some((TripCause::Saturated, cycle)) if expected => {
                assert!((190..=193).contains(&cycle), "{volts} V: {cycle}");
            }
            None if !expected => {}
            other => panic!("{volts} V: {other:?}"),
        }
    }
}

/// Brings a world's new interlock to power.
pub(crate) fn power_up(world: &mut World) {
    world.cycles(300);
    for verb in [Verb::Reset, Verb::Arm, Verb::Enable] {
        world.verb(verb).unwrap();
    }
    world.cycles(30);
    assert_eq!(world.interlock.state(), WatchdogState::Enabled);
}

#[test]
fn sr_35_the_motor_may_have_more_than_its_rating_for_a_while_and_must_then_cool() {
    let mut world = powered(Profile::Realtime);
    let drive = |volts: f64| {
        move |world: &mut World, _: usize| {
            (world.sample.output_v[0], world.sample.motor_v[0]) = (volts, volts);
        }
    };
    assert_eq!(trips(&mut world, 2000, drive(2.99)), None, "the rating, without end");
    let found = trips(&mut world, 2000, drive(4.5));
    assert!(matches!(found, Some((TripCause::MotorOverload, _))), "{found:?}");
    (world.sample.output_v[0], world.sample.motor_v[0]) = (0.0, 0.0);
    world.cycle();
    let refused = world.verb(Verb::Reset);
    assert_eq!(refused, Err(Refusal::FaultActive(TripCause::MotorOverload)));
    world.cycles(100);
    assert_eq!(world.verb(Verb::Reset), Ok(WatchdogState::Disarmed));
}

#[test]
fn sr_35_a_cold_motor_bears_one_and_a_half_times_its_rating_for_0_59_time_constants() {
    for side in [1.0, -1.0] {
        for read_back in [true, false] {
            let mut world = powered(Profile::Realtime);
            world.sample.motor_present = u8::from(read_back);
            let found = trips(&mut world, 400, |world, _| {
                // Of the two the larger heats: the output where nothing is read back.
                world.sample.output_v[0] = if read_back { side * 4.3 } else { side * 4.5 };
                world.sample.motor_v[0] = side * 4.5;
            });
            // 0.2 s · ln(4.5² / (4.5² − 3²)) = 117.6 ms
            let Some((TripCause::MotorOverload, cycle)) = found else { panic!("{found:?}") };
            assert!((117..=119).contains(&cycle), "{cycle}");
        }
    }
}

#[test]
fn sr_35_a_motor_that_is_enabled_again_is_as_warm_as_before() {
    let mut world = powered(Profile::Realtime);
    (world.sample.output_v[0], world.sample.motor_v[0]) = (2.99, 2.99);
    world.cycles(1000);
    (world.sample.output_v[0], world.sample.motor_v[0]) = (0.0, 0.0);
    for verb in [Verb::Disarm, Verb::Arm, Verb::Enable] {
        world.verb(verb).unwrap();
        world.cycle();
    }
    (world.sample.output_v[0], world.sample.motor_v[0]) = (4.5, 4.5);
    let found = trips(&mut world, 20, |_, _| {});
    assert!(matches!(found, Some((TripCause::MotorOverload, _))), "cold it bears 117: {found:?}");
}

#[test]
fn sr_36_a_read_back_within_5_percent_of_the_limit_is_that_of_the_output() {
    for written in [2.0, -2.0, 0.0] {
        for (off, expected) in [(0.24, false), (-0.24, false), (0.26, true), (-0.26, true)] {
            let mut world = powered(Profile::Realtime);
            world.sample.output_v[0] = written;
            world.cycles(20);
            world.sample.motor_v[0] = written + off;
            let found = trips(&mut world, 40, |_, _| {});
            let differs = matches!(found, Some((TripCause::ReadBack, _)));
            assert_eq!(differs, expected, "{written} V and {off} V: {found:?}");
        }
    }
}

#[test]
fn sr_36_volts_at_the_motor_that_nobody_wrote_trip() {
    for (profile, within) in [(Profile::Realtime, 13), (Profile::BestEffort, 100)] {
        let mut world = powered(profile);
        // The converter holds what it had.
        world.sample.motor_v[0] = 1.0;
        let found = trips(&mut world, within + 5, |_, _| {});
        let Some((TripCause::ReadBack, cycle)) = found else { panic!("{found:?}") };
        assert!((within..=within + 2).contains(&cycle), "{profile}: {cycle}");
        // One that follows some scans later is none.
        let mut world = powered(profile);
        let mut written = [0.0; 6];
        let found = trips(&mut world, 500, |world, cycle| {
            written.rotate_right(1);
            written[0] = (cycle as f64 * 0.05).sin();
            world.sample.output_v[0] = written[0];
            world.sample.motor_v[0] = written[5];
        });
        assert_eq!(found, None);
        // Nor is a card without read-back.
        let mut world = powered(profile);
        world.sample.motor_present = 0;
        world.sample.output_v[0] = 2.0;
        assert_eq!(trips(&mut world, 500, |_, _| {}), None);
    }
}

#[test]
fn sr_38_a_logger_that_is_missing_does_what_the_rig_file_says() {
    use WatchdogState::{Armed, Disarmed, Enabled, Tripped};
    let refused = Refusal::FaultActive(TripCause::LoggerLost);
    let tripped = Refusal::State { expected: Armed, found: Tripped };
    // What becomes of a rig that is armed or enabled, what `arm` does when disarmed, and `enable`
    // when armed.
    for (policy, trips, arm, enable) in [
        (WithoutLogger::Allow, false, Ok(Armed), Ok(Enabled)),
        (WithoutLogger::Block, false, Err(refused), Err(refused)),
        (WithoutLogger::Trip, true, Err(refused), Err(tripped)),
    ] {
        for state in [Disarmed, Armed, Enabled] {
            let mut world = World::new(Profile::Realtime);
            let configured = Config { without_logger: policy, ..config(Profile::Realtime) };
            world.interlock = Interlock::new(configured);
            power_up(&mut world);
            if state != Enabled {
                world.verb(Verb::Disarm).unwrap();
                world.cycles(20);
            }
            if state == Armed {
                world.verb(Verb::Arm).unwrap();
            }
            world.peers.logger_alive = false;
            world.cycles(5);
            let becomes = if trips && state != Disarmed { Tripped } else { state };
            assert_eq!(world.interlock.state(), becomes, "{policy:?}");
            if becomes == Tripped {
                assert_eq!(world.interlock.cause(), TripCause::LoggerLost);
            }
            match state {
                Disarmed => assert_eq!(world.verb(Verb::Arm), arm, "{policy:?}"),
                Armed => assert_eq!(world.verb(Verb::Enable), enable, "{policy:?}"),
                _ => {}
            }
        }
    }
}

#[test]
fn sr_39_a_torque_reading_that_does_not_change_by_one_bit_trips_where_the_rig_file_says_so() {
    for (stuck_ns, expected) in [(Some(50 * MS), true), (None, false)] {
        let mut world = World::new(Profile::Realtime);
        let input = TorqueInput { channel: 0, range_v: 10.0, stuck_ns };
        let configured =
            Config { torque_inputs: [Some(input), None, None], ..config(Profile::Realtime) };
        world.interlock = Interlock::new(configured);
        // Noise of one bit is enough.
        let mut noise = 0.0;
        for _ in 0..300 {
            noise = 1.0 / 3276.8 - noise;
            world.sample.analog_v[0] = noise;
            world.cycle();
        }
        for verb in [Verb::Reset, Verb::Arm, Verb::Enable] {
            world.verb(verb).unwrap();
            world.sample.analog_v[0] += 1.0 / 3276.8;
            world.cycle();
        }
        let found = trips(&mut world, 200, |_, _| {});
        match found {
            Some((TripCause::SensorStuck, cycle)) if expected => {
                assert!((49..=52).contains(&cycle), "{cycle}");
            }
            None if !expected => {}
            other => panic!("{stuck_ns:?}: {other:?}"),
        }
    }
}

#[test]
fn sr_40_a_heartbeat_that_returns_right_after_the_trip_stays_latched() {
    for profile in PROFILES {
        for control in [true, false] {
            let mut world = powered(profile);
            let found = trips(&mut world, 100, |world, _| {
                if control { world.control_runs = false } else { world.acquisition_runs = false }
            });
            assert!(found.is_some(), "{profile}");
            // In the very next cycle all is well again.
            (world.control_runs, world.acquisition_runs) = (true, true);
            for _ in 0..1000 {
                let output = world.cycle();
                assert_eq!((output.token.enabled, output.toggle_line), (0, false));
            }
            assert_eq!(world.interlock.state(), WatchdogState::Tripped);
            assert!(world.verb(Verb::Enable).is_err() && world.verb(Verb::Arm).is_err());
        }
    }
}

#[test]
fn sr_41_a_cycle_with_a_step_left_out_or_swapped_trips() {
    for profile in PROFILES {
        for process in 0..2 {
            let steps = World::new(profile).flows[process].clone();
            let without = |at: usize| {
                let mut wrong = steps.clone();
                wrong.remove(at);
                wrong
            };
            let swapped = |at: usize| {
                let mut wrong = steps.clone();
                wrong.swap(at, at + 1);
                wrong
            };
            let left_out = (0..steps.len()).map(without);
            for wrong in left_out.chain((0..steps.len() - 1).map(swapped)) {
                let mut world = powered(profile);
                world.flows[process].clone_from(&wrong);
                let found = trips(&mut world, 3, |_, _| {});
                let Some((TripCause::ProgramFlow, _)) = found else {
                    panic!("{profile}, {wrong:?}: {found:?}")
                };
            }
        }
    }
}

#[test]
fn sr_41_a_cycle_with_a_step_doubled_or_that_answers_an_old_token_trips() {
    let caught = |mut world: World, what: &str| {
        let found = trips(&mut world, 3, |_, _| {});
        let Some((TripCause::ProgramFlow, _)) = found else { panic!("{what}: {found:?}") };
    };
    for profile in PROFILES {
        for process in 0..2 {
            let steps = World::new(profile).flows[process].clone();
            for (at, &step) in steps.iter().enumerate() {
                let mut world = powered(profile);
                world.flows[process].insert(at, step);
                caught(world, &format!("{profile}, process {process}, step {at} doubled"));
            }
            for behind in [1, 2, 10] {
                let mut world = powered(profile);
                world.answers_behind[process] = behind;
                caught(world, &format!("{profile}, process {process}, {behind} tokens behind"));
            }
        }
    }
}

#[test]
fn sr_42_messages_beyond_their_rate_trip_and_those_of_a_late_loop_do_not() {
    for profile in PROFILES {
        for commands in [true, false] {
            let mut world = powered(profile);
            let found = trips(&mut world, 20, |world, _| {
                // A second one in the same period; its time is its own.
                world.now += MS / 4;
                if commands { world.command_now() } else { world.sample_now() }
            });
            let Some((TripCause::TooFast, cycle)) = found else { panic!("{profile}: {found:?}") };
            assert!(cycle <= 10, "{profile}: {cycle}");
        }
        // Held up for 2 ms each time: late once, at once again, and then in time.
        let mut world = powered(profile);
        let found = trips(&mut world, 400, |world, cycle| {
            if cycle % 20 == 0 {
                world.now += 2 * MS;
                world.sample_now();
                world.command_now();
                world.now += 10_000;
                world.sample_now();
                world.command_now();
            }
        });
        assert_eq!(found, None, "{profile}");
    }
}
