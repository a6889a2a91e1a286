//! What the interlock allows while an axis is unhomed (SR-28).

use ipc_types::{Profile, TripCause, WatchdogState};

use crate::world::World;

/// A rig that was powered up, armed and enabled, with its axis unhomed.
fn unhomed(change: fn(&mut World)) -> World {
    let mut world = World::new(Profile::Realtime);
    (world.sample.homed, world.sample.homing_sequence) = (0, 5);
    change(&mut world);
    world.cycles(30);
    for verb in [ipc_types::Verb::Reset, ipc_types::Verb::Arm, ipc_types::Verb::Enable] {
        world.verb(verb).unwrap();
    }
    world.cycles(30);
    assert_eq!(world.interlock.state(), WatchdogState::Enabled);
    world
}

fn tripped(world: &World) -> Option<TripCause> {
    (world.interlock.state() == WatchdogState::Tripped).then(|| world.interlock.cause())
}

#[test]
fn sr_28_an_unhomed_axis_has_the_limits_of_the_search() {
    // Beyond the position limits of the homed axis, within the travel of the search.
    let mut world = unhomed(|world| world.sample.master_position[0] = 1.4);
    assert_eq!(world.token.homed, 0);
    for _ in 0..200 {
        // 0.5 rad/s
        world.sample.master_position[0] += 0.0005;
        world.cycle();
    }
    assert!(world.sample.master_position[0] < 1.5 + 1e-9);
    world.sample.master_position[0] = 1.501;
    world.cycle();
    assert_eq!(tripped(&world), Some(TripCause::PositionLimit));

    let mut world = unhomed(|_| ());
    world.command.volts[0] = 3.0;
    world.cycles(5);
    assert_eq!(tripped(&world), None);
    world.command.volts[0] = -3.01;
    world.cycle();
    assert_eq!(tripped(&world), Some(TripCause::VoltageLimit));

    let mut world = unhomed(|_| ());
    for _ in 0..20 {
        // 2.5 rad/s, which a homed axis may have
        world.sample.master_position[0] += 0.00125;
        world.cycle();
    }
    assert_eq!(tripped(&world), None, "1.25 rad/s");
    for _ in 0..20 {
        world.sample.master_position[0] += 0.0025;
        world.cycle();
    }
    assert_eq!(tripped(&world), Some(TripCause::SpeedLimit));
}

#[test]
fn sr_28_power_ends_after_the_time_of_the_search() {
    let mut world = unhomed(|_| ());
    world.cycles(470);
    assert_eq!(tripped(&world), None, "500 ms after enable");
    world.cycle();
    assert_eq!(tripped(&world), Some(TripCause::HomingTime));
    // Homed in time, the rig keeps its power.
    let mut world = unhomed(|_| ());
    world.cycles(300);
    (world.sample.homed, world.sample.homing_sequence) = (1, 6);
    world.cycles(2000);
    assert_eq!(tripped(&world), None);
    assert_eq!(world.token.homed, 1);
}

#[test]
fn sr_28_a_change_of_zero_is_no_speed() {
    let mut world = unhomed(|world| world.sample.master_position[0] = 0.8);
    (world.sample.homed, world.sample.homing_sequence) = (1, 6);
    world.sample.master_position[0] = -0.9;
    world.cycles(200);
    assert_eq!(tripped(&world), None);
    // Without another zero the same distance is one.
    world.sample.master_position[0] = 0.8;
    world.cycles(20);
    assert_eq!(tripped(&world), Some(TripCause::SpeedLimit));
}

#[test]
fn sr_28_an_axis_that_loses_its_zero_trips() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
    (world.sample.homed, world.sample.homing_sequence) = (0, 7);
    world.cycle();
    assert_eq!(tripped(&world), Some(TripCause::HomingLost));
}
