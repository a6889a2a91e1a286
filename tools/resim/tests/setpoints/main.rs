//! The experiment's player, run again on what its setpoints say they were computed from.
#![allow(clippy::unwrap_used)]
#![allow(unreachable_pub)]

mod live;

use ipc_types::{Mode, Setpoint, Value};
use live::{CYCLE_NS, EXPERIMENT, Live, Message, SECOND, again};
use resim::{CoreReport, NotCompared, Runs};

const MOVEMENT: &str = r#"
[protocol]
name = "to and fro"

[[segments]]
kind = "guided_sine"
amplitude_deg = 20.0
frequency_hz = 1.0
duration_s = 2.0
fade_in_s = 0.5

[[segments]]
kind = "steps"
positions_deg = [10.0, 0.0]
rise_s = 0.4
dwell_s = 0.2

[[segments]]
kind = "hold"
duration_s = 0.5
"#;

const SCAN: &str = r#"
[protocol]
name = "scan"

[scanner]
repetition_s = 0.4

[[segments]]
kind = "wait_for_scanner"
timeout_s = 5.0
start_up_s = 0.2

[[segments]]
kind = "steps"
positions_deg = [10.0]
rise_s = 0.4
dwell_s = 0.4

[[segments]]
kind = "hold"
duration_s = 0.8
"#;

const LEARN: &str = r#"
[protocol]
name = "learn"

[[segments]]
kind = "learn"
amplitude_deg = 20.0
frequency_hz = 2.0
blocks = 4
law = "published"

[[segments]]
kind = "hold"
duration_s = 0.5
"#;

/// Every setpoint was compared, and is the same.
fn assert_same(core: &CoreReport) {
    assert_eq!(core.first_difference, None);
    assert!(core.not_compared.is_empty() && core.messages > 300, "{core:?}");
    assert_eq!((core.compared, core.differing), (core.messages, 0));
}

/// All that could be compared is the same, and some could not.
fn assert_left_out(core: &CoreReport, why: NotCompared) -> u64 {
    assert_eq!(core.first_difference, None);
    let left_out = *core.not_compared.get(&why).unwrap_or_else(|| panic!("{core:?}"));
    assert_eq!(core.compared + left_out, core.messages, "{core:?}");
    left_out
}

fn modes(live: &Live) -> Vec<Mode> {
    let mut modes: Vec<_> =
        live.setpoints().map(|setpoint| Mode::from_code(setpoint.mode).unwrap()).collect();
    modes.dedup();
    modes
}

#[test]
fn a_protocol_from_its_start_past_its_end_is_the_same_again() {
    let mut live = Live::new();
    live.run(20);
    live.play(MOVEMENT, "line");
    live.run(6 * SECOND);
    // The same once more, from where it rests.
    live.play(MOVEMENT, "line");
    live.run(SECOND);
    assert_eq!(modes(&live)[..3], [Mode::Position, Mode::Hold, Mode::Passive]);
    let core = live.again();
    assert_same(&core);
    let [begin] = core.begins.as_slice() else { panic!("{core:?}") };
    assert_eq!((begin.incarnation, begin.from), (EXPERIMENT, "the first setpoint of the process"));
}

#[test]
fn a_trip_in_the_midst_a_stop_and_a_client_that_is_gone_are_the_same_again() {
    let mut live = Live::new();
    live.play(MOVEMENT, "line");
    live.run(SECOND);
    live.epoch = 0;
    live.run(SECOND / 2);
    // A later enable starts nothing.
    live.epoch = 71;
    live.run(SECOND / 2);
    assert_eq!(modes(&live), [Mode::Position, Mode::Passive]);
    live.play(MOVEMENT, "line");
    live.run(SECOND);
    live.stop();
    live.run(2 * SECOND);
    let stopped = [Mode::Position, Mode::Passive, Mode::Position, Mode::Hold, Mode::Passive];
    assert_eq!(modes(&live), stopped);
    live.play(&MOVEMENT.replace("duration_s = 2.0", "duration_s = 20.0"), "line");
    live.client = false;
    live.run(4 * SECOND);
    assert_eq!(modes(&live)[5..], [Mode::Position, Mode::Hold, Mode::Passive]);
    assert_same(&live.again());
}

#[test]
fn a_successor_that_goes_on_is_the_same_again() {
    let mut live = Live::new();
    live.play(MOVEMENT, "line");
    live.run(5 * SECOND / 4);
    live.restart(MOVEMENT, "line");
    // It waits for its client.
    live.client = false;
    live.run(40);
    live.client = true;
    live.run(6 * SECOND);
    let waited = live.setpoints().find(|one| one.incarnation > EXPERIMENT).unwrap();
    assert_eq!((waited.sequence, waited.run), (0, 0));
    assert!(waited.player_ns - waited.run_ns >= 40 * CYCLE_NS, "{waited:?}");
    let core = live.again();
    assert_same(&core);
    assert_eq!(core.begins.len(), 2);
    // One that may not go on, as the power went meanwhile.
    live.play(MOVEMENT, "line");
    live.run(SECOND);
    live.restart(MOVEMENT, "line");
    live.epoch = 0;
    live.run(SECOND);
    assert_same(&live.again());
}

#[test]
fn a_time_without_samples_is_the_same_again() {
    let mut live = Live::new();
    live.play(MOVEMENT, "line");
    live.run(SECOND);
    live.samples = false;
    let before = live.setpoints().count();
    live.run(SECOND / 2);
    assert!(live.setpoints().count() < before + 60);
    live.samples = true;
    live.run(SECOND);
    // A stop needs none.
    live.samples = false;
    live.run(SECOND / 2);
    live.stop();
    live.run(SECOND);
    assert_same(&live.again());
}

#[test]
fn a_protocol_that_waits_for_the_scanner_and_keeps_in_step_is_the_same_again() {
    for pulses in ["line", "key", "0.4,jitter=0.002"] {
        let mut live = Live::new();
        // Before the protocol a pulse counts for nothing.
        live.pulse();
        live.run(20);
        live.play(SCAN, pulses);
        for _ in 0..20 {
            // Of a scanner whose clock is a little slow.
            live.run(202);
            match pulses {
                "line" => live.pulse(),
                "key" => live.key(),
                _ => {}
            }
        }
        assert_eq!(modes(&live).last(), Some(&Mode::Passive), "{pulses}");
        let core = live.again();
        assert_same(&core);
        // A pulse that is not in the recording is not taken for none.
        live.recorded.retain(|it| !matches!(it, Message::Pulse(_) | Message::Key(_)));
        if pulses == "line" || pulses == "key" {
            let left_out = assert_left_out(&live.again(), NotCompared::InputMissing);
            assert!(left_out > 500, "{pulses}: {left_out}");
        }
    }
}

#[test]
fn a_successor_that_keeps_to_the_scanner_is_not_compared() {
    let mut live = Live::new();
    live.play(SCAN, "0.4");
    live.run(SECOND);
    let before = live.setpoints().count() as u64;
    live.restart(SCAN, "0.4");
    live.run(4 * SECOND);
    let core = live.again();
    let left_out = assert_left_out(&core, NotCompared::ScannerFollowedBefore);
    assert_eq!(core.compared, before);
    assert!(left_out > 500);
    // The next protocol is known again.
    live.play(MOVEMENT, "line");
    live.run(SECOND);
    let core = live.again();
    assert!(core.compared >= before + 400 && core.differing == 0, "{core:?}");
}

#[test]
fn what_is_learnt_between_trials_is_the_same_again() {
    let mut live = Live::new();
    live.play(LEARN, "line");
    live.run(14 * SECOND);
    assert_eq!(modes(&live), [Mode::Learning, Mode::Hold, Mode::Passive]);
    let results = live.setpoints().last().unwrap().results_received;
    assert_eq!(results, 5, "one at the beginning, and one a block");
    assert_same(&live.again());
    // The position of a sample from which it was learnt.
    let mut altered = live.recorded.clone();
    let samples = altered.iter_mut().filter_map(|message| match message {
        Message::Sample(sample) => Some(sample),
        _ => None,
    });
    samples.skip(3 * 2000).take(400).for_each(|sample| sample.slave_position[0] += 0.01);
    let core = again(&altered, live.runs.clone());
    let first = core.first_difference.unwrap();
    assert!(first.field.field.starts_with("position") && first.at_s > 3.2, "{first:?}");
}

#[test]
fn what_was_learnt_before_is_not_compared() {
    let mut live = Live::new();
    live.play(LEARN, "line");
    live.run(4 * SECOND);
    live.restart(LEARN, "line");
    live.run(14 * SECOND);
    // Up to the step with which the segment begins, nothing is needed of it.
    let core = live.again();
    assert!(assert_left_out(&core, NotCompared::LearntBefore) > 1000);
    let mut live = Live::new();
    live.play(&LEARN.replace("law = \"published\"", "law = \"none\"\nload = \"first\""), "line");
    live.run(2 * SECOND);
    let core = live.again();
    assert_eq!(core.compared, 1);
    assert_left_out(&core, NotCompared::LearntBefore);
}

#[test]
fn a_recording_that_begins_in_the_midst_is_compared_from_the_next_protocol_on() {
    let mut live = Live::new();
    live.play(MOVEMENT, "line");
    live.run(SECOND);
    let midst = live.recorded.len();
    live.run(5 * SECOND);
    live.play(MOVEMENT, "line");
    live.run(SECOND);
    let core = again(&live.recorded[midst..], live.runs.clone());
    let left_out = assert_left_out(&core, NotCompared::BeganBefore);
    assert_eq!((left_out, core.compared), (2500, 500));
    let [begin] = core.begins.as_slice() else { panic!("{core:?}") };
    assert_eq!(begin.from, "the start of a protocol");
    // A setpoint that is missing leaves out those that follow.
    let at = |message: &Message| match message {
        Message::Setpoint(setpoint) => setpoint.sequence == 100,
        _ => false,
    };
    let kept: Vec<_> = live.recorded.iter().filter(|it| !at(it)).cloned().collect();
    let core = again(&kept, live.runs.clone());
    let left_out = assert_left_out(&core, NotCompared::MessagesMissing);
    assert_eq!((left_out, core.compared), (2899, 600));
}

#[test]
fn what_the_recording_does_not_hold_is_told() {
    let mut live = Live::new();
    live.play(MOVEMENT, "line");
    live.run(SECOND);
    let core = again(&live.recorded, Runs::default());
    assert_eq!(assert_left_out(&core, NotCompared::ProtocolMissing), 500);
    // As of a build before: fields that are not there read as 0.
    let older = live.recorded.iter().cloned().map(|message| match message {
        Message::Setpoint(setpoint) => {
            let Setpoint { at_ns, position, protocol, owner, .. } = *setpoint;
            let (incarnation, sequence) = (setpoint.incarnation, setpoint.sequence);
            let older = Setpoint { at_ns, position, protocol, owner, ..Setpoint::default() };
            Message::Setpoint(Box::new(Setpoint { incarnation, sequence, ..older }))
        }
        other => other,
    });
    let core = again(&older.collect::<Vec<_>>(), live.runs.clone());
    assert_eq!(assert_left_out(&core, NotCompared::NotNamed), 500);
}

#[test]
fn one_bit_of_one_setpoint_is_found_with_its_inputs() {
    let mut live = Live::new();
    live.play(MOVEMENT, "line");
    live.run(2 * SECOND);
    let was = live.setpoints().nth(300).unwrap().position[0];
    let recorded = f64::from_bits(was.to_bits() ^ 1);
    let mut setpoints = live.recorded.iter_mut().filter_map(|message| match message {
        Message::Setpoint(setpoint) => Some(setpoint),
        _ => None,
    });
    setpoints.nth(300).unwrap().position[0] = recorded;
    let core = live.again();
    assert_eq!((core.compared, core.differing), (1000, 1));
    let first = core.first_difference.unwrap();
    assert_eq!((first.sequence, first.field.field.as_str()), (300, "position[0]"));
    let values = (first.field.recorded, first.field.recomputed);
    assert_eq!(values, (Value::Float(recorded), Value::Float(was)));
    let topics: Vec<_> = first.inputs.iter().map(|used| used.topic).collect();
    assert_eq!(topics, ["sample", "token", "setpoint"]);
}

#[test]
fn a_setpoint_of_a_cycle_in_which_no_step_was_due_is_found() {
    let mut live = Live::new();
    live.play(MOVEMENT, "line");
    live.run(2 * SECOND);
    let tick = live.setpoints().nth(300).unwrap().sample_tick;
    for message in &mut live.recorded {
        if let Message::Sample(sample) = message
            && sample.tick == tick
        {
            // Too old to be used.
            sample.time_ns -= 200_000_000;
        }
    }
    let first = live.again().first_difference.unwrap();
    let found = (first.sequence, first.field.field.as_str(), first.field.recomputed);
    assert_eq!(found, (300, "at_ns", Value::Unsigned(0)));
}
