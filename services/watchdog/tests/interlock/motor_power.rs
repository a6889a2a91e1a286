//! SR-37 and SR-43: motor power against permission.

use ipc_types::{CardKind, Profile, TripCause, Verb, WatchdogState};
use watchdog::interlock::{Config, Interlock, Refusal};

use crate::plausibility::{PROFILES, power_up, powered, trips};
use crate::world::{MS, World, config};

#[test]
fn sr_37_motor_power_that_nothing_permits_is_a_fault() {
    let mut world = powered(Profile::Realtime);
    // The relay sticks.
    world.relay_obeys = false;
    world.sample.motor_power = 1;
    world.cycles(20);
    world.verb(Verb::Disarm).unwrap();
    world.cycles(13);
    assert_eq!(world.interlock.state(), WatchdogState::Disarmed, "the relay has its time");
    // Armed in that time: a relay that is stuck still shows.
    assert_eq!(world.verb(Verb::Arm), Ok(WatchdogState::Armed));
    world.cycles(2);
    assert_eq!(
        (world.interlock.state(), world.interlock.cause()),
        (WatchdogState::Tripped, TripCause::MotorPowered)
    );
    let refused = world.verb(Verb::Reset);
    assert_eq!(refused, Err(Refusal::FaultActive(TripCause::MotorPowered)));
    world.sample.motor_power = 0;
    world.cycles(20);
    assert_eq!(world.verb(Verb::Reset), Ok(WatchdogState::Disarmed));
}

/// A rig that has just come up, with a card that is wired to see the motor's power or not; the
/// power does not follow the permission.
fn with_card(profile: Profile, backend: CardKind, comedi_reports_power: bool) -> World {
    let mut world = World::new(profile);
    world.relay_obeys = false;
    world.sample.backend = backend.code();
    let configured = Config { power_cut_otherwise: true, comedi_reports_power, ..config(profile) };
    world.interlock = Interlock::new(configured);
    world
}

#[test]
fn sr_43_motor_power_that_is_cut_from_outside_trips() {
    for (profile, backend) in [
        (Profile::Realtime, CardKind::Simulated),
        (Profile::BestEffort, CardKind::Simulated),
        // What is not known to report power, and then does.
        (Profile::Realtime, CardKind::Hardware),
    ] {
        let longest = config(profile).echo_lost_ns / MS;
        let mut world = with_card(profile, backend, false);
        power_up(&mut world);
        world.sample.motor_power = 1;
        world.cycles(20);
        // A relay may bounce.
        let cut = |world: &mut World, _: usize| world.sample.motor_power = 0;
        assert_eq!(trips(&mut world, longest as usize, cut), None);
        world.sample.motor_power = 1;
        assert_eq!(trips(&mut world, 20, |_, _| {}), None);
        let found = trips(&mut world, 300, cut);
        let Some((TripCause::PowerMissing, cycle)) = found else { panic!("{found:?}") };
        assert!((longest..=longest + 3).contains(&(cycle as u64)), "{cycle}");
        // The power that comes back finds no permission.
        world.sample.motor_power = 1;
        world.cycles(300);
        assert_eq!(world.interlock.state(), WatchdogState::Tripped);
    }
}

#[test]
fn sr_43_motor_power_that_does_not_come_within_100_ms_trips_where_the_card_reports_it() {
    // The first sample of the second cycle after `enable` shows the gate open.
    let opened = 2;
    let cases = PROFILES.map(|profile| (profile, CardKind::Simulated, false, true));
    let real = [
        (Profile::Realtime, CardKind::Comedi, true, true),
        (Profile::Realtime, CardKind::Comedi, false, false),
        (Profile::Realtime, CardKind::Hardware, true, false),
    ];
    for (profile, backend, wired, reports) in cases.into_iter().chain(real) {
        let what = format!("{profile}, {backend}, {wired}");
        let mut armed = with_card(profile, backend, wired);
        armed.cycles(30);
        for verb in [Verb::Reset, Verb::Arm] {
            armed.verb(verb).unwrap();
        }
        assert_eq!(trips(&mut armed, 300, |_, _| {}), None, "{what}: nothing is permitted");
        armed.verb(Verb::Enable).unwrap();
        // A button was pressed before.
        let mut never = armed.clone();
        match trips(&mut never, 1000, |_, _| {}) {
            Some((TripCause::PowerMissing, cycle)) if reports => {
                assert!((opened + 100..=opened + 103).contains(&cycle), "{what}: {cycle}");
                // Released, it finds no permission.
                never.sample.motor_power = 1;
                never.cycles(300);
                assert_eq!(never.interlock.state(), WatchdogState::Tripped, "{what}");
            }
            None if !reports => {}
            other => panic!("{what}: {other:?}"),
        }
        let mut slow = armed.clone();
        let found = trips(&mut slow, 1000, |world, cycle| {
            world.sample.motor_power = u8::from(cycle > opened + 90);
        });
        assert_eq!(found, None, "{what}: it comes in time");
        // The time is that of the scans, however few of them come: 90 cycles are 126 ms here.
        let mut few = armed;
        let found = trips(&mut few, 90, |world, cycle| {
            if cycle % 5 == 0 {
                world.now += 2 * MS;
            }
        });
        let expected = reports.then_some(TripCause::PowerMissing);
        assert_eq!(found.map(|(cause, _)| cause), expected, "{what}");
    }
}
