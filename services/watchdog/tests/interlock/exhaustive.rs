//! Every sequence of a few events, from each state: bounded model checking of the watchdog.
//! `FARREACH_DEPTH` asks for longer sequences than the usual ones.

use ipc_types::{Profile, Verb, WatchdogState};

use crate::checked::{Act, Checked};
use crate::walk::{Judged, depth, every_sequence};

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

impl Judged for Checked {
    type Event = Act;

    fn name(event: &Self::Event) -> String {
        format!("{event:?}")
    }

    fn perform(&mut self, event: &Self::Event) -> Result<(), String> {
        self.act(event)
    }

    fn end(&mut self) -> Result<bool, String> {
        self.act(&Act::Cycles(1))?;
        Ok(self.state() == WatchdogState::Enabled)
    }
}

#[test]
fn sr_20_every_sequence_of_events_from_each_state() {
    let depth = depth(DEPTH);
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
        let walk = every_sequence(&from, &events, depth);
        println!("from {state}: {} sequences, {} end enabled", walk.sequences, walk.powered);
        // So many verbs lead to power from there.
        let verbs_to_power = match state {
            WatchdogState::Enabled => 0,
            WatchdogState::Armed => 1,
            WatchdogState::Disarmed => 2,
            WatchdogState::Faulted | WatchdogState::Tripped => 3,
        };
        assert_eq!(walk.powered > 0, depth >= verbs_to_power, "{state}");
    }
}
