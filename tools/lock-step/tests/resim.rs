//! The cores of control, gate, watchdog and experiment, run again on what they published on the
//! time grid: all of it is the same, and what was altered afterwards is found.
#![allow(clippy::unwrap_used)]

mod cores;

use acquisition::homing::Homing;
use cores::{EXPERIMENT, MOVEMENT, PROFILE, Published, Rig, SECOND, SESSION, Timeline};
use ipc_types::{MotorCommand, PulseSource, Value};
use resim::{NotCompared, OtherAxes, Recorded, Replay, Report, Rigs, Runs};
use rig::RigFile;

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const THREE: &str = include_str!("../../../launch/rigs/three-axis.toml");
const HOME: &str = include_str!("../../../launch/protocols/home.toml");

fn rig() -> RigFile {
    RigFile::parse(RIG, "rig.toml").unwrap()
}

/// A movement, in whose midst control dies and comes back; the movement then begins again.
fn movement() -> Vec<Published> {
    let rig = rig();
    let (mut live, mut timeline) = (Rig::new(&rig, MOVEMENT), Timeline::new(&rig));
    (live.published, live.may_trip) = (Some(Vec::new()), true);
    let mut tick = timeline.first;
    for (seconds, stopped) in [(3, false), (1, true), (2, false)] {
        live.control_stopped = stopped;
        for _ in 0..seconds * SECOND {
            timeline.run(&mut live, tick);
            tick += 1;
        }
        if stopped {
            live.restart_control(&rig);
            live.play_again = true;
        }
    }
    live.published.unwrap()
}

fn replay(published: &[Published], other: Option<&RigFile>) -> Result<Report, OtherAxes> {
    let mut runs = Runs::default();
    for protocol in [MOVEMENT, HOME] {
        runs.push(0, protocol.to_owned(), PulseSource::Line);
    }
    let mut replay = Replay::new(Rigs::new(rig(), PROFILE, 0), runs, other, Vec::new())?;
    for message in published {
        replay.take(match message {
            Published::Sample(sample) => Recorded::Sample(sample),
            Published::Setpoint(setpoint) => Recorded::Setpoint(setpoint),
            Published::Command(command) => Recorded::Command(command),
            Published::Token(token) => Recorded::Token(token),
            Published::Line(line) => Recorded::Line(line),
        });
    }
    Ok(replay.report())
}

/// Every message of every core was compared, and is the same.
fn assert_same(report: &Report) {
    for core in &report.cores {
        assert_eq!(core.first_difference, None, "{}", core.core);
        assert!(core.messages > 1000 && core.not_compared.is_empty(), "{core:?}");
        assert_eq!((core.compared, core.differing), (core.messages, 0), "{}", core.core);
    }
    assert!(report.agrees());
}

#[test]
fn a_movement_a_trip_and_a_new_control_are_the_same_again() {
    let report = replay(&movement(), None).unwrap();
    assert_same(&report);
    let begins = report.cores[0].begins.iter();
    let begins: Vec<_> = begins.map(|begin| (begin.incarnation, begin.from)).collect();
    let start = "the start of the process";
    assert_eq!(begins, [(cores::CONTROL, start), (cores::CONTROL + 100, start)]);
    let [trip] = report.trips.as_slice() else { panic!("{:?}", report.trips) };
    assert_eq!(Some(&trip.recorded), trip.recomputed.as_ref());
    assert!(trip.faults.contains(&trip.recorded), "{trip:?}");
    let topics: Vec<_> = trip.inputs.iter().map(|used| used.topic).collect();
    assert_eq!(topics, ["sample", "command", "token"]);
    let [begin] = report.cores[4].begins.as_slice() else { panic!("{:?}", report.cores[4]) };
    assert_eq!((begin.incarnation, begin.from), (EXPERIMENT, "the first setpoint of the process"));
}

#[test]
fn a_search_for_the_stops_is_the_same_again() {
    let rig = rig();
    let (mut live, mut timeline) = (Rig::new(&rig, HOME), Timeline::new(&rig));
    live.homing = Homing::new(&rig, SESSION, None);
    live.published = Some(Vec::new());
    let first = timeline.first;
    for tick in first..first + 20 * SECOND {
        timeline.run(&mut live, tick);
    }
    assert!(live.newest_sample.is_some_and(|sample| sample.homed == 1), "{:?}", live.changes);
    assert_same(&replay(&live.published.unwrap(), None).unwrap());
}

#[test]
fn one_bit_of_one_command_is_found_and_nothing_else_of_control() {
    let mut published = movement();
    let moves = |command: &MotorCommand| command.volts[0] != 0.0;
    let powered = |message: &&mut Published| match message {
        Published::Command(command) => moves(command),
        _ => false,
    };
    let Published::Command(command) = published.iter_mut().filter(powered).nth(300).unwrap() else {
        unreachable!()
    };
    let recorded = f64::from_bits(command.volts[0].to_bits() ^ 1);
    let was = std::mem::replace(&mut command.volts[0], recorded);
    let (sequence, tick) = (command.sequence, command.sample_tick);
    let report = replay(&published, None).unwrap();
    let control = &report.cores[0];
    assert_eq!((control.compared, control.differing), (control.messages, 1));
    let found = control.first_difference.as_ref().unwrap();
    assert_eq!(
        (found.sequence, found.tick, found.field.field.as_str()),
        (sequence, tick, "volts[0]")
    );
    assert_eq!(
        (found.field.recorded, found.field.recomputed),
        (Value::Float(recorded), Value::Float(was))
    );
    // The gate of the recording wrote what the command said before.
    let gate = report.cores[1].first_difference.as_ref().unwrap();
    assert_eq!(gate.field.field, "output_v[0]");
    assert!(gate.tick > tick && gate.tick <= tick + 2, "{gate:?}");
    assert!(!report.agrees());
}

#[test]
fn a_sample_that_was_altered_shows_in_the_command_that_was_computed_from_it() {
    let mut published = movement();
    let mut answered = published.iter().filter_map(|message| match message {
        Published::Command(command) if command.volts[0] != 0.0 => Some(**command),
        _ => None,
    });
    let answered = answered.nth(300).unwrap();
    for message in &mut published {
        if let Published::Sample(sample) = message
            && sample.tick == answered.sample_tick
        {
            sample.master_position[0] += 1e-6;
        }
    }
    let report = replay(&published, None).unwrap();
    let found = report.cores[0].first_difference.as_ref().unwrap();
    assert_eq!((found.sequence, found.tick), (answered.sequence, answered.sample_tick));
    assert!(found.inputs.iter().any(|used| used.topic == "sample"), "{found:?}");
}

#[test]
fn a_recording_that_begins_in_midst_of_it_is_compared_from_where_the_state_is_known() {
    let published = movement();
    let report = replay(&published[published.len() / 4..], None).unwrap();
    let [control, gate, watchdog, _, experiment] = report.cores.as_slice() else {
        panic!("{report:?}")
    };
    // The player is under way until the trip, and known from the next start on.
    assert!(experiment.compared > 200 && experiment.not_compared[&NotCompared::BeganBefore] > 500);
    let [begin] = experiment.begins.as_slice() else { panic!("{experiment:?}") };
    assert_eq!(begin.from, "the start of a protocol");
    // Control is under power until it dies, and its successor is known from its start on.
    assert_eq!(control.begins.len(), 1);
    assert!(control.compared > 900 && control.not_compared[&NotCompared::BeganBefore] > 100);
    // The gate is open.
    assert_eq!(gate.begins[0].from, "the opening of the gate");
    assert!(gate.not_compared[&NotCompared::BeganBefore] < 20, "{:?}", gate.not_compared);
    assert_eq!(watchdog.compared, 0);
    assert_eq!(watchdog.not_compared[&NotCompared::BeganBefore], watchdog.messages);
    assert!(report.agrees(), "{report:?}");
    // What was not run again is told as recorded.
    let [trip] = report.trips.as_slice() else { panic!("{:?}", report.trips) };
    assert_eq!(trip.recomputed, None);
}

#[test]
fn messages_that_are_missing_are_told_and_make_no_difference() {
    let published = movement();
    let mut samples = 0;
    let kept: Vec<_> = published
        .into_iter()
        .filter(|message| {
            samples += u64::from(matches!(message, Published::Sample(_)));
            !(matches!(message, Published::Sample(_)) && (4000..4008).contains(&samples))
        })
        .collect();
    let report = replay(&kept, None).unwrap();
    let [control, gate, watchdog, _, experiment] = report.cores.as_slice() else {
        panic!("{report:?}")
    };
    assert!(report.agrees(), "{report:?}");
    assert!(experiment.not_compared[&NotCompared::InputMissing] >= 1);
    assert_eq!(gate.compared, gate.messages, "cycles without a sample stand at even times");
    assert!(control.not_compared[&NotCompared::InputMissing] >= 1);
    assert!(watchdog.not_compared[&NotCompared::InputMissing] >= 1);
}

#[test]
fn the_same_gains_give_the_same_volts_and_others_do_not() {
    let published = movement();
    let same = replay(&published, Some(&rig())).unwrap().other_gains.unwrap();
    assert!(same.powered > 1000 && same.powered < same.commands);
    assert_eq!((same.volts[0].rms_v, same.volts[0].largest_v), (0.0, 0.0));
    let mut softer = rig();
    softer.axes[0].control.position_gain *= 0.5;
    let report = replay(&published, Some(&softer)).unwrap();
    assert!(report.agrees(), "what was recorded is what was computed");
    let volts = report.other_gains.unwrap().volts;
    assert_eq!(volts.len(), 1);
    assert!(volts[0].rms_v > 1e-3 && volts[0].largest_v.abs() > volts[0].rms_v, "{volts:?}");
    let three = RigFile::parse(THREE, "three.toml").unwrap();
    let refused = replay(&published, Some(&three)).unwrap_err();
    assert!(refused.to_string().contains("expected a rig of 1 axes"), "{refused}");
}
