//! SR-44: the handle stays within the range of motion of its subject, but for a search for the
//! stops, which nobody is at the handle for.

use ipc_types::{Mode, Profile, TripCause, Verb, WatchdogState};
use proptest::prelude::*;
use rig::RangeOfMotion;
use watchdog::interlock::{Config, Interlock, TorqueInput};

use crate::plausibility::trips;
use crate::walk::cases;
use crate::world::{COUNT, World, config};

const RANGE: RangeOfMotion = RangeOfMotion { min: -0.4, max: 0.3, tolerance: 0.05 };
const LEFT: Option<(TripCause, usize)> = Some((TripCause::RangeOfMotion, 1));

/// The usual configuration, with a range of motion.
fn with_range(profile: Profile) -> Config {
    let mut configured = config(profile);
    configured.axes[0].range_of_motion = Some(RANGE);
    configured
}

/// Puts motor and handle at their positions (rad), with their counts.
fn place(world: &mut World, master: f64, slave: f64) {
    world.sample.master_position[0] = master;
    world.sample.master_counts[0] = (master / COUNT) as i64;
    world.sample.slave_position[0] = slave;
    world.sample.slave_counts[0] = (slave / COUNT) as i64;
}

/// What a person does to give power.
fn power_up(world: &mut World) {
    for verb in [Verb::Reset, Verb::Arm, Verb::Enable] {
        world.verb(verb).unwrap_or_else(|refusal| panic!("{verb}: {refusal}"));
    }
    world.cycles(30);
    assert_eq!(world.interlock.state(), WatchdogState::Enabled);
}

/// A rig under power that gets 0 V, from another configuration and first sample than the usual
/// ones.
fn enabled(profile: Profile, configured: Config, change: impl FnOnce(&mut World)) -> World {
    let mut world = World::new(profile);
    world.interlock = Interlock::new(configured);
    change(&mut world);
    world.cycles(30);
    power_up(&mut world);
    world
}

/// The same, homed, in the realtime profile, with its handle there (rad).
fn with_handle_at(position: f64) -> World {
    let profile = Profile::Realtime;
    enabled(profile, with_range(profile), |world| place(world, position, position))
}

/// From now on these volts reach the motor, in a mode of control whose reference is still on its
/// way from the measured position.
fn drive(world: &mut World, mode: Mode, volts: f64) {
    world.command.mode = mode.code();
    world.command.epoch = world.token.epoch;
    world.command.ramping = 1;
    (world.sample.output_v[0], world.sample.motor_v[0]) = (volts, volts);
}

/// Trips that come without any change.
fn trips_within(world: &mut World, cycles: usize) -> Option<(TripCause, usize)> {
    trips(world, cycles, |_, _| {})
}

#[test]
fn sr_44_a_handle_beyond_its_range_loses_power_with_the_first_volts() {
    for profile in [Profile::Realtime, Profile::BestEffort] {
        for (position, leaves) in [
            (0.0, false),
            (0.3, false),
            (0.349, false),
            (0.351, true),
            (-0.449, false),
            (-0.451, true),
        ] {
            let mut world = enabled(profile, with_range(profile), |w| place(w, 0.0, position));
            // At 0 V there is nothing to take away, and the rig can be homed again.
            assert_eq!(trips_within(&mut world, 100), None, "{position} at 0 V");
            drive(&mut world, Mode::Position, 1.0);
            let found = trips_within(&mut world, 100);
            assert_eq!(found, LEFT.filter(|_| leaves), "{profile}: {position}");
            if leaves {
                let bit = 1 << TripCause::RangeOfMotion.code();
                assert_ne!(world.token.faults & bit, 0, "the token shows it");
                // It latches, and a person may try again, which ends in the same way.
                drive(&mut world, Mode::Passive, 0.0);
                world.cycles(200);
                assert_eq!(world.interlock.state(), WatchdogState::Tripped);
                power_up(&mut world);
                drive(&mut world, Mode::Position, -0.5);
                assert_eq!(trips_within(&mut world, 100), LEFT, "{profile}: {position} again");
            }
        }
    }
}

#[test]
fn sr_44_no_mode_but_a_search_of_this_epoch_may_leave_the_range() {
    for mode in Mode::ALL.iter().copied() {
        let mut world = with_handle_at(0.4);
        drive(&mut world, mode, 1.0);
        let expected = LEFT.filter(|_| mode != Mode::Initialise);
        assert_eq!(trips_within(&mut world, 100), expected, "{mode}");
    }
    let mut world = with_handle_at(0.4);
    drive(&mut world, Mode::Initialise, 1.0);
    world.command.epoch -= 1;
    assert_eq!(trips_within(&mut world, 100), LEFT, "a search of an earlier epoch");
    let mut world = with_handle_at(0.4);
    drive(&mut world, Mode::Initialise, 1.0);
    world.command.mode = 99;
    assert_eq!(trips_within(&mut world, 100), LEFT, "a mode that is none");
}

#[test]
fn sr_44_the_range_of_an_unhomed_axis_is_not_in_force() {
    let profile = Profile::Realtime;
    let mut world = enabled(profile, with_range(profile), |world| {
        (world.sample.homed, world.sample.homing_sequence) = (0, 5);
        place(world, 0.8, 0.8);
    });
    drive(&mut world, Mode::Impedance, 1.0);
    assert_eq!(trips_within(&mut world, 300), None);
    assert_eq!((world.token.range_given, world.token.range_supervised), (1, 0));
    (world.sample.homed, world.sample.homing_sequence) = (1, 6);
    assert_eq!(trips_within(&mut world, 100), LEFT, "homed there");
    assert_eq!((world.token.range_given, world.token.range_supervised), (1, 1));
}

#[test]
fn sr_44_a_search_leaves_the_range_and_comes_back_into_it() {
    let mut world = with_handle_at(0.8);
    assert_eq!(world.token.range_supervised, 1);
    drive(&mut world, Mode::Initialise, 2.0);
    assert_eq!(trips_within(&mut world, 1000), None);
    assert_eq!((world.token.range_given, world.token.range_supervised), (1, 0));
    // 0 V while the zeros change, then the way back.
    drive(&mut world, Mode::Passive, 0.0);
    assert_eq!(trips_within(&mut world, 1100), None);
    drive(&mut world, Mode::Position, -1.0);
    let found = trips(&mut world, 490, |world, cycle| {
        let position = 0.8 - cycle as f64 * 1e-3;
        place(world, position, position);
    });
    assert_eq!((found, world.token.range_supervised), (None, 0), "at 0.31 rad");
    let found = trips(&mut world, 50, |world, cycle| {
        let position = 0.31 - cycle as f64 * 1e-3;
        place(world, position, position);
    });
    assert_eq!((found, world.token.range_supervised), (None, 1), "within it");
    // From then on it is in force.
    let found = trips(&mut world, 100, |world, cycle| {
        let position = 0.26 + cycle as f64 * 1e-3;
        place(world, position, position);
    });
    let Some((TripCause::RangeOfMotion, cycle)) = found else { panic!("{found:?}") };
    assert!((90..=91).contains(&cycle), "{cycle}");
}

#[test]
fn sr_44_the_exemption_of_a_search_ends() {
    let searched = || {
        let mut world = with_handle_at(0.8);
        drive(&mut world, Mode::Initialise, 2.0);
        assert_eq!(trips_within(&mut world, 100), None);
        world
    };
    for mode in [Mode::Hold, Mode::Position, Mode::Centre] {
        let mut world = searched();
        drive(&mut world, mode, 1.0);
        assert_eq!(trips_within(&mut world, 500), None, "{mode}: the way back");
    }
    // A hand at the handle, or a movement that repeats.
    for mode in [Mode::Impedance, Mode::Rhythm, Mode::Learning] {
        let mut world = searched();
        drive(&mut world, mode, 1.0);
        assert_eq!(trips_within(&mut world, 100), LEFT, "{mode}");
    }
    // Power that ends.
    let mut world = searched();
    drive(&mut world, Mode::Passive, 0.0);
    world.verb(Verb::Disarm).unwrap();
    world.cycles(30);
    power_up(&mut world);
    drive(&mut world, Mode::Position, 1.0);
    assert_eq!(trips_within(&mut world, 100), LEFT, "another epoch");
    // A protocol that has ended, longer than the change of the zeros takes.
    for (passive, expected) in [(2000, None), (2001, LEFT)] {
        let mut world = searched();
        drive(&mut world, Mode::Passive, 0.0);
        assert_eq!(trips_within(&mut world, passive), None);
        drive(&mut world, Mode::Position, 1.0);
        assert_eq!(trips_within(&mut world, 100), expected, "passive for {passive} ms");
    }
    // A way back that takes for ever.
    let mut world = searched();
    drive(&mut world, Mode::Hold, 1.0);
    assert_eq!(trips_within(&mut world, 60_000), None);
    assert_eq!(trips_within(&mut world, 20), LEFT);
}

#[test]
fn sr_44_the_handle_is_what_its_own_encoder_says() {
    let profile = Profile::Realtime;
    for (slave_encoder, master, slave, leaves) in [
        (true, 0.4, 0.0, false),
        (true, 0.0, 0.4, true),
        (false, 0.4, 0.0, true),
        (false, 0.0, 0.4, false),
    ] {
        let mut configured = with_range(profile);
        if !slave_encoder {
            configured.axes[0].slave = None;
        }
        let mut world = enabled(profile, configured, |world| {
            place(world, master, slave);
            world.sample.slave_present = u8::from(slave_encoder);
        });
        drive(&mut world, Mode::Position, 1.0);
        let found = trips_within(&mut world, 100);
        assert_eq!(found, LEFT.filter(|_| leaves), "{slave_encoder}, {master}, {slave}");
    }
}

#[test]
fn sr_44_each_axis_has_its_own_range_and_the_token_says_which_are_in_force() {
    let two_axes = |homed: u8| {
        let mut configured = config(Profile::Realtime);
        configured.axes.push(configured.axes[0].clone());
        configured.axes[1].range_of_motion = Some(RANGE);
        configured.torque_inputs[1] =
            Some(TorqueInput { channel: 1, range_v: 10.0, stuck_ns: None });
        enabled(Profile::Realtime, configured, |world| {
            let sample = &mut world.sample;
            (sample.axes, sample.homed, sample.analog_present) = (2, homed, 0b11);
            (sample.master_present, sample.slave_present) = (0b11, 0b11);
            (sample.torque_present, sample.motor_present) = (0b11, 0b11);
            // The first has none.
            sample.slave_position[0] = 0.8;
            (sample.master_position[1], sample.slave_position[1]) = (0.2, 0.2);
            let counts = (0.2 / COUNT) as i64;
            (sample.master_counts[1], sample.slave_counts[1]) = (counts, counts);
        })
    };
    for (homed, in_force) in [(0b11, 0b10), (0b10, 0b10), (0b01, 0), (0, 0)] {
        let world = two_axes(homed);
        assert_eq!((world.token.range_given, world.token.range_supervised), (0b10, in_force));
    }
    let mut world = two_axes(0b11);
    // A search exempts all axes, each until it is over and its handle within its range.
    drive(&mut world, Mode::Initialise, 1.0);
    assert_eq!(trips_within(&mut world, 100), None);
    assert_eq!(world.token.range_supervised, 0);
    drive(&mut world, Mode::Position, 1.0);
    assert_eq!(trips_within(&mut world, 100), None);
    assert_eq!(world.token.range_supervised, 0b10);
    // Volts of one motor are enough: the subject holds both handles.
    let found = trips(&mut world, 200, |world, cycle| {
        let (position, sample) = (0.2 + cycle as f64 * 2e-3, &mut world.sample);
        let counts = (position / COUNT) as i64;
        (sample.master_position[1], sample.slave_position[1]) = (position, position);
        (sample.master_counts[1], sample.slave_counts[1]) = (counts, counts);
    });
    let Some((TripCause::RangeOfMotion, cycle)) = found else { panic!("{found:?}") };
    assert!((75..=76).contains(&cycle), "{cycle}");
    // A rig file without a range gives none.
    let world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
    assert_eq!((world.token.range_given, world.token.range_supervised), (0, 0));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(300)))]

    /// Whatever the range, the volts and the place: within it nothing trips, beyond it the first
    /// volts do.
    #[test]
    fn sr_44_within_the_range_nothing_trips_and_beyond_it_the_first_volts_do(
        min in -0.8..0.0f64,
        max in 0.0..0.8f64,
        tolerance in 0.0..0.1f64,
        position in -0.99..0.99f64,
        volts in 0.01..2.9f64,
        upward in any::<bool>(),
    ) {
        let profile = Profile::Realtime;
        let mut configured = with_range(profile);
        configured.axes[0].range_of_motion = Some(RangeOfMotion { min, max, tolerance });
        let mut world = enabled(profile, configured, |world| place(world, position, position));
        prop_assert_eq!(trips_within(&mut world, 20), None);
        drive(&mut world, Mode::Hold, if upward { volts } else { -volts });
        let leaves = position < min - tolerance || position > max + tolerance;
        prop_assert_eq!(trips_within(&mut world, 20), LEFT.filter(|_| leaves));
    }
}
