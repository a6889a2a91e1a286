//! Every sequence of a few events, from each state: bounded model checking of the watchdog.
//! `FARREACH_DEPTH` asks for longer sequences than the usual ones.

use ipc_types::{Profile, Verb, WatchdogState};

use crate::checked::{Act, Checked};

/// Length of the sequences.
const DEPTH: usize = 3;

/// Events that may come in any order. Each fault of a peer is one that lasts; its end is another
/// event.
fn events() -> Vec<Act> {
    let verbs = [Verb::Reset, Verb::Arm, Verb::Enable, Verb::Disarm, Verb::Estop].map(Act::Verb);
    let mut events = verbs.to_vec();
    events.extend([
        Act::Cycles(1),
        // Longer than any silence, and than a momentary fault is held.
        Act::Cycles(20),
        Act::Late(6),
        Act::Backwards(3),
        Act::Acquisition(false),
        Act::Acquisition(true),
        Act::Control(false),
        Act::Control(true),
        Act::Launcher(false),
        Act::Launcher(true),
        Act::Keeper(false),
        Act::Keeper(true),
        Act::GateObeys(false),
        Act::GateObeys(true),
        Act::AcquisitionRestarts,
        Act::ControlRestarts,
        Act::WatchdogRestarts,
        Act::Volts(6.0),
        Act::Volts(0.0),
        Act::Counts(1_000),
        Act::Session(12),
    ]);
    events
}

/// What a walk through all sequences has seen.
#[derive(Default)]
struct Walk {
    sequences: u64,
    enabled: u64,
}

/// Goes through every sequence from here on; each ends with a cycle, so that what came last shows.
fn explore(from: &Checked, events: &[Act], depth: usize, path: &mut Vec<Act>, walk: &mut Walk) {
    for act in events {
        path.push(act.clone());
        let mut next = from.clone();
        if let Err(what) = next.act(act) {
            panic!("{what} after {path:?}");
        }
        if depth > 1 {
            explore(&next, events, depth - 1, path, walk);
        } else {
            if let Err(what) = next.act(&Act::Cycles(1)) {
                panic!("{what} after {path:?} and a cycle");
            }
            walk.sequences += 1;
            walk.enabled += u64::from(next.state() == WatchdogState::Enabled);
        }
        path.pop();
    }
}

#[test]
fn sr_20_every_sequence_of_events_from_each_state() {
    let depth =
        std::env::var("FARREACH_DEPTH").ok().and_then(|depth| depth.parse().ok()).unwrap_or(DEPTH);
    let events = events();
    for (state, verbs) in [
        (WatchdogState::Faulted, &[][..]),
        (WatchdogState::Disarmed, &[Verb::Reset][..]),
        (WatchdogState::Armed, &[Verb::Reset, Verb::Arm][..]),
        (WatchdogState::Enabled, &[Verb::Reset, Verb::Arm, Verb::Enable][..]),
        (WatchdogState::Tripped, &[Verb::Estop][..]),
    ] {
        let mut from = Checked::new(Profile::Realtime);
        for &verb in verbs {
            from.act(&Act::Verb(verb)).unwrap();
        }
        from.act(&Act::Cycles(30)).unwrap();
        assert_eq!(from.state(), state);
        let mut walk = Walk::default();
        explore(&from, &events, depth, &mut Vec::new(), &mut walk);
        assert_eq!(walk.sequences, (events.len() as u64).pow(depth as u32));
        println!("from {state}: {} sequences, {} end enabled", walk.sequences, walk.enabled);
        // From the states that power is three verbs away from, only the longest get there.
        let reachable = matches!(state, WatchdogState::Armed | WatchdogState::Enabled) || depth > 2;
        assert_eq!(walk.enabled > 0, reachable, "{state}");
    }
}
