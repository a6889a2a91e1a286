//! SR-14, SR-15: what a rig needs to be armed, and what follows where it is lost.

use ipc_types::{CardKind, Profile, TripCause, Verb, WatchdogState};
use watchdog::interlock::{Config, Interlock, Refusal};

use crate::world::{World, config};

/// Both verbs that arm: the interlock refuses the one as the other. What `arm --unchecked` passes
/// over is the doctor's report, which is not the interlock's.
pub(crate) const ARM: [Verb; 2] = [Verb::Arm, Verb::ArmUnchecked];

#[test]
fn sr_14_a_real_card_without_realtime_scheduling_never_arms() {
    for who in 0..3 {
        let mut world = World::new(Profile::Realtime);
        if who == 0 {
            world.interlock = Interlock::new(Config {
                profile: Profile::BestEffort,
                ..config(Profile::Realtime)
            });
        }
        world.sample.backend = CardKind::Hardware.code();
        world.sample.profile =
            if who == 1 { Profile::BestEffort } else { Profile::Realtime }.code();
        world.command.profile =
            if who == 2 { Profile::BestEffort } else { Profile::Realtime }.code();
        world.cycles(30);
        assert_eq!(world.verb(Verb::Reset), Ok(WatchdogState::Disarmed));
        for arm in ARM {
            assert_eq!(world.verb(arm), Err(Refusal::FaultActive(TripCause::NotRealtime)));
        }
        world.cycles(5);
        assert_eq!(world.interlock.state(), WatchdogState::Disarmed);
    }
}

#[test]
fn sr_14_a_card_that_cannot_take_volts_never_arms() {
    for backend in [CardKind::Replay.code(), CardKind::Null.code(), 200] {
        let mut world = World::new(Profile::Realtime);
        world.sample.backend = backend;
        world.cycles(30);
        world.verb(Verb::Reset).unwrap();
        for arm in ARM {
            assert_eq!(world.verb(arm), Err(Refusal::FaultActive(TripCause::NoOutput)));
        }
    }
}

/// What a real card needs may go while the rig is armed, as when its acquisition starts anew
/// without the right to real-time scheduling, or with another card.
#[test]
fn sr_14_a_card_that_loses_its_scheduling_or_output_trips() {
    type Lose = fn(&mut World);
    let losses: [(Lose, TripCause); 5] = [
        (|world| world.sample.profile = Profile::BestEffort.code(), TripCause::NotRealtime),
        (|world| world.command.profile = Profile::BestEffort.code(), TripCause::NotRealtime),
        (|world| world.sample.backend = CardKind::Replay.code(), TripCause::NoOutput),
        (|world| world.sample.backend = CardKind::Null.code(), TripCause::NoOutput),
        (|world| world.sample.backend = 200, TripCause::NoOutput),
    ];
    for verbs in [&[Verb::Reset, Verb::Arm][..], &[Verb::Reset, Verb::Arm, Verb::Enable][..]] {
        for (at, (lose, cause)) in losses.into_iter().enumerate() {
            let mut world = World::new(Profile::Realtime);
            world.sample.backend = CardKind::Comedi.code();
            world.cycles(30);
            for &verb in verbs {
                world.verb(verb).unwrap();
            }
            world.cycles(30);
            let before = world.interlock.state();
            let armed = [WatchdogState::Armed, WatchdogState::Enabled];
            assert!(armed.contains(&before), "{before}");
            lose(&mut world);
            let output = world.cycle();
            let what = format!("loss {at} from {before}");
            assert_eq!(
                (world.interlock.state(), world.interlock.cause()),
                (WatchdogState::Tripped, cause),
                "{what}"
            );
            assert_eq!((output.token.enabled, output.toggle_line), (0, false), "{what}");
            // A person may reset, since nothing moves; arming waits for what is missing.
            world.cycles(30);
            assert_eq!(world.verb(Verb::Reset), Ok(WatchdogState::Disarmed), "{what}");
            for arm in ARM {
                assert_eq!(world.verb(arm), Err(Refusal::FaultActive(cause)), "{what}");
            }
        }
    }
}

#[test]
fn sr_14_a_real_card_arms_with_a_line_or_a_recorded_override_only() {
    // By its capabilities a real card has no enable line.
    for (power_cut_otherwise, expected) in
        [(true, Ok(WatchdogState::Armed)), (false, Err(Refusal::NoEnableLine))]
    {
        for arm in ARM {
            let mut world = World::new(Profile::Realtime);
            world.interlock =
                Interlock::new(Config { power_cut_otherwise, ..config(Profile::Realtime) });
            world.sample.backend = CardKind::Hardware.code();
            world.cycles(30);
            world.verb(Verb::Reset).unwrap();
            assert_eq!(world.verb(arm), expected);
        }
    }
}

#[test]
fn sr_15_keeper_lost_blocks_arming_and_trips_nothing() {
    for state in [WatchdogState::Disarmed, WatchdogState::Armed, WatchdogState::Enabled] {
        let mut world = World::in_state(Profile::Realtime, state);
        world.peers.keeper_alive = false;
        world.cycles(100);
        assert_eq!(world.interlock.state(), state);
        assert!(world.interlock.active_faults().contains(TripCause::KeeperLost));
        if state != WatchdogState::Enabled {
            world.verb(Verb::Disarm).unwrap();
            for arm in ARM {
                assert_eq!(world.verb(arm), Err(Refusal::FaultActive(TripCause::KeeperLost)));
            }
        }
    }
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Armed);
    world.peers.keeper_alive = false;
    world.cycle();
    assert_eq!(world.verb(Verb::Enable), Err(Refusal::FaultActive(TripCause::KeeperLost)));
}
