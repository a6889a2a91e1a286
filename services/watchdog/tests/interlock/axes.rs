//! Rigs of two axes, and of an axis that lacks an input: each axis is judged by its own values, and
//! a value that is marked absent by none.

use ipc_types::{CardKind, Profile, Sample, TripCause, Verb, WatchdogState};
use watchdog::interlock::{Config, FaultSet, Interlock, TorqueInput};

use crate::world::{World, config};

/// One bit for each of the two axes.
const BOTH: u8 = 0b11;

/// A world under power, with another configuration and first sample than the usual ones.
fn enabled(configured: Config, change: impl FnOnce(&mut Sample)) -> World {
    let mut world = World::new(Profile::Realtime);
    world.interlock = Interlock::new(configured);
    change(&mut world.sample);
    world.cycles(30);
    for verb in [Verb::Reset, Verb::Arm, Verb::Enable] {
        world.verb(verb).unwrap_or_else(|refusal| panic!("{verb}: {refusal}"));
    }
    world.cycles(30);
    assert_eq!(world.interlock.state(), WatchdogState::Enabled);
    world
}

/// Two axes alike, these of them homed.
fn two_axes(homed: u8) -> World {
    two_axes_from(homed, |_| ())
}

/// The same, from another first sample.
fn two_axes_from(homed: u8, change: impl FnOnce(&mut Sample)) -> World {
    let mut configured = config(Profile::Realtime);
    configured.axes.push(configured.axes[0].clone());
    configured.torque_inputs[1] = Some(TorqueInput { channel: 1, range_v: 10.0, stuck_ns: None });
    enabled(configured, |sample| {
        sample.axes = 2;
        (sample.master_present, sample.slave_present) = (BOTH, BOTH);
        (sample.torque_present, sample.motor_present) = (BOTH, BOTH);
        sample.analog_present = 0b11;
        sample.homed = homed;
        change(sample);
    })
}

/// The cause of the trip that comes within so many cycles, each after a change.
fn trips(
    world: &mut World,
    cycles: usize,
    mut change: impl FnMut(&mut World, usize),
) -> Option<TripCause> {
    (1..=cycles).find_map(|cycle| {
        change(world, cycle);
        world.cycle();
        let tripped = world.interlock.state() == WatchdogState::Tripped;
        tripped.then(|| world.interlock.cause())
    })
}

#[test]
fn sr_11_a_fault_of_either_axis_trips() {
    type Change = fn(&mut World, usize, usize);
    let cases: [(TripCause, Change); 14] = [
        (TripCause::PositionLimit, |w, axis, _| w.sample.master_position[axis] = 1.001),
        (TripCause::PositionLimit, |w, axis, _| w.sample.slave_position[axis] = -1.001),
        (TripCause::SpeedLimit, |w, axis, cycle| {
            w.sample.master_position[axis] = 0.045 * cycle as f64;
        }),
        (TripCause::SpeedLimit, |w, axis, cycle| {
            w.sample.slave_position[axis] = 0.045 * cycle as f64;
        }),
        (TripCause::SensorInvalid, |w, axis, _| w.sample.master_present = BOTH & !(1 << axis)),
        (TripCause::SensorInvalid, |w, axis, _| w.sample.slave_present = BOTH & !(1 << axis)),
        (TripCause::SensorInvalid, |w, axis, _| w.sample.analog_v[axis] = f64::NAN),
        (TripCause::SensorRailed, |w, axis, _| w.sample.analog_v[axis] = 9.96),
        (TripCause::EncoderJump, |w, axis, _| w.sample.master_counts[axis] = 21),
        (TripCause::EncoderJump, |w, axis, _| w.sample.slave_counts[axis] = -21),
        (TripCause::TorqueLimit, |w, axis, _| w.sample.slave_torque[axis] = 10.1),
        (TripCause::VoltageLimit, |w, axis, _| w.command.volts[axis] = 5.01),
        (TripCause::VoltageLimit, |w, axis, _| w.sample.motor_v[axis] = -5.01),
        (TripCause::ReadBack, |w, axis, _| w.sample.motor_v[axis] = 1.0),
    ];
    for axis in 0..2 {
        for (row, (cause, change)) in cases.into_iter().enumerate() {
            let mut world = two_axes(BOTH);
            let found = trips(&mut world, 40, |world, cycle| change(world, axis, cycle));
            assert_eq!(found, Some(cause), "axis {axis}, row {row}");
            // For a person and for the recording the token tells the same.
            assert_ne!(world.token.faults & 1 << cause.code(), 0, "axis {axis}, row {row}");
        }
    }
}

#[test]
fn sr_28_only_the_unhomed_one_of_two_axes_has_the_limits_of_the_search() {
    for unhomed in 0..2 {
        let other = 1 - unhomed;
        let partly = || two_axes(BOTH & !(1 << unhomed));
        // What the homed axis may, the unhomed one may not.
        let mut world = partly();
        world.command.volts[other] = 5.0;
        assert_eq!(trips(&mut world, 5, |_, _| ()), None);
        world.command.volts[unhomed] = 3.01;
        assert_eq!(trips(&mut world, 5, |_, _| ()), Some(TripCause::VoltageLimit));
        let mut world = partly();
        world.sample.motor_v[other] = 5.0;
        assert_eq!(trips(&mut world, 5, |_, _| ()), None);
        world.sample.motor_v[unhomed] = 3.01;
        assert_eq!(trips(&mut world, 5, |_, _| ()), Some(TripCause::VoltageLimit));
        let speed = |axis: usize| {
            move |world: &mut World, cycle: usize| {
                world.sample.master_position[axis] = 0.0025 * cycle as f64;
            }
        };
        assert_eq!(trips(&mut partly(), 20, speed(other)), None);
        assert_eq!(trips(&mut partly(), 20, speed(unhomed)), Some(TripCause::SpeedLimit));
        // And the other way round for positions, which count from power-up.
        let mut world = two_axes_from(BOTH & !(1 << unhomed), |sample| {
            sample.master_position[unhomed] = 1.4;
        });
        assert_eq!(trips(&mut world, 470, |_, _| ()), None);
        assert_eq!(trips(&mut world, 1, |_, _| ()), Some(TripCause::HomingTime), "after 500 ms");
        let mut world = partly();
        world.sample.master_position[other] = 1.4;
        assert_eq!(trips(&mut world, 1, |_, _| ()), Some(TripCause::PositionLimit));
    }
    assert_eq!(trips(&mut two_axes(BOTH), 600, |_, _| ()), None, "both homed");
}

#[test]
fn sr_11_a_value_that_is_marked_absent_means_nothing() {
    // One encoder, no torque cell, no read-back, one analog input.
    let mut configured = config(Profile::Realtime);
    configured.axes[0].slave = None;
    let mut world = enabled(configured, |sample| {
        (sample.slave_present, sample.torque_present, sample.motor_present) = (0, 0, 0);
    });
    for value in [99.0, f64::NAN] {
        world.sample.slave_position[0] = value;
        world.sample.slave_counts[0] += 1_000_000;
        world.sample.slave_torque[0] = value;
        world.sample.motor_v[0] = value;
        world.sample.analog_v[1] = value;
        world.cycles(50);
        assert_eq!(world.interlock.active_faults(), FaultSet::NONE, "{value}");
    }
    assert_eq!(world.interlock.state(), WatchdogState::Enabled);
}

#[test]
fn sr_11_an_encoder_that_drops_out_and_comes_back_is_invalid_and_nothing_else() {
    type Change = fn(&mut Sample);
    let cases: [Change; 6] = [
        |sample| {
            sample.master_present = 0b01;
            (sample.master_position[1], sample.master_counts[1]) = (0.9, 573);
        },
        |sample| {
            sample.slave_present = 0b01;
            (sample.slave_position[1], sample.slave_counts[1]) = (0.9, 573);
        },
        |sample| sample.master_position[1] = f64::NAN,
        |sample| sample.master_position[1] = f64::INFINITY,
        |sample| sample.slave_position[1] = f64::NAN,
        |sample| sample.slave_position[1] = f64::NEG_INFINITY,
    ];
    for (case, change) in cases.into_iter().enumerate() {
        let mut world = two_axes(BOTH);
        let good = world.sample;
        change(&mut world.sample);
        world.cycle();
        let mut expected = FaultSet::NONE;
        expected.insert(TripCause::SensorInvalid);
        assert_eq!(world.interlock.active_faults(), expected, "case {case}");
        world.sample = Sample {
            master_position: good.master_position,
            master_counts: good.master_counts,
            master_present: good.master_present,
            slave_position: good.slave_position,
            slave_counts: good.slave_counts,
            slave_present: good.slave_present,
            ..world.sample
        };
        world.cycle();
        assert_eq!(world.interlock.active_faults(), expected, "case {case}, held");
        world.cycles(20);
        assert_eq!(world.interlock.active_faults(), FaultSet::NONE, "case {case}");
    }
}

#[test]
fn sr_11_a_torque_cell_that_the_rig_file_has_must_be_there() {
    for declared in [true, false] {
        let mut configured = config(Profile::Realtime);
        if declared {
            let rig = rig::load_rig("hydrostatic".as_ref()).unwrap();
            configured.axes[0].torque = rig.axes[0].torque;
            assert!(configured.axes[0].torque.is_some());
        }
        let mut world = enabled(configured, |_| ());
        world.sample.torque_present = 0;
        let expected = declared.then_some(TripCause::SensorInvalid);
        assert_eq!(trips(&mut world, 5, |_, _| ()), expected);
    }
}

#[test]
fn sr_11_an_encoder_may_move_further_where_ticks_are_missing() {
    for (counts, expected) in [(100, None), (101, Some(TripCause::EncoderJump))] {
        let mut world = enabled(config(Profile::Realtime), |_| ());
        world.sample.tick += 4;
        world.sample.master_counts[0] += counts;
        assert_eq!(trips(&mut world, 1, |_, _| ()), expected, "{counts} in five ticks");
    }
}

#[test]
fn sr_11_a_replayed_record_s_volts_reach_no_motor() {
    let mut world = World::new(Profile::Realtime);
    world.sample.backend = CardKind::Replay.code();
    world.sample.motor_v[0] = 9.0;
    // A record may lack the slave.
    world.sample.slave_present = 0;
    world.cycles(30);
    let mut expected = FaultSet::NONE;
    expected.insert(TripCause::NoOutput);
    assert_eq!(world.interlock.active_faults(), expected);
}

#[test]
fn sr_39_a_torque_input_is_railed_after_20_ms_beyond_its_share_of_the_range() {
    let railed = |volts: f64, cycles: usize| {
        let mut world = enabled(config(Profile::Realtime), |_| ());
        world.sample.analog_v[0] = volts;
        trips(&mut world, cycles, |_, _| ())
    };
    assert_eq!(railed(9.9, 100), None);
    assert_eq!(railed(-9.96, 20), None, "a spike");
    assert_eq!(railed(-9.96, 21), Some(TripCause::SensorRailed));
}
