//! The rig finds the ends of its travel: the whole chain of processes, and what the recording
//! shows.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;

use ipc_types::{
    COMMAND, Event, EventKind, Mode, MotorCommand, Process, SAMPLE, Sample, Severity, event_topic,
};
use recording::mcap_read::Recording;

use common::{TestRig, told};

const RIG: &str = include_str!("../launch/rigs/hydrostatic.toml");

/// End stops close to the middle, so that the test is short.
const STOPS_DEG: (f64, f64) = (-24.0, 18.0);

const PROTOCOL: &str = r#"[protocol]
name = "find"

[[segments]]
kind = "initialise"
label = "initialise"
speed_deg_s = 40.0
volts = 4.0
duration_s = 25.0

[[segments]]
kind = "centre"
label = "centre"
position_deg = -2.0
rise_s = 2.0
duration_s = 4.0
"#;

#[test]
fn initialise_finds_the_end_stops_and_centre_returns_the_handle() {
    let rig = TestRig::patient("initialise");
    let (rig_file, protocol, record) =
        (rig.path("stops.toml"), rig.path("find.toml"), rig.path("find.mcap"));
    let kept: Vec<&str> = RIG.lines().filter(|line| !line.starts_with("end_stop_")).collect();
    let keys = format!(
        "[simulation]\nend_stop_min_deg = {:?}\nend_stop_max_deg = {:?}",
        STOPS_DEG.0, STOPS_DEG.1
    );
    std::fs::write(&rig_file, kept.join("\n").replace("[simulation]", &keys)).unwrap();
    std::fs::write(&protocol, PROTOCOL).unwrap();
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let (rig_file, protocol, record) = (text(&rig_file), text(&protocol), text(&record));
    rig.ok(["up", "--simulate", "--rig", &rig_file, "--record", &record]);
    let mut last = String::new();
    // On a loaded host a best-effort rig may trip, rightly; the test then resets it and starts
    // again.
    let played = (1..=20).any(|attempt| {
        rig.power_up();
        let output = rig.run(["run", &protocol]);
        last = told(&output);
        let stdout = String::from_utf8_lossy(&output.stdout);
        println!("attempt {attempt}: {}", stdout.trim());
        // `run` shows the range that was found.
        assert!(!output.status.success() || stdout.contains("axis 0: range -2"), "{last}");
        assert!(output.status.success() || last.contains("tripped"), "{last}");
        output.status.success()
    });
    assert!(played, "{last}");
    rig.down();

    let recording = Recording::open(Path::new(&record)).unwrap();
    let topic = event_topic(Process::Experiment).unwrap().topic.name;
    let events: Vec<Event> =
        recording.messages::<Event>(topic).unwrap().map(|event| event.unwrap().message).collect();
    let found: Vec<&Event> =
        events.iter().filter(|event| event.kind == EventKind::RangeFound.code()).collect();
    let [ends, warning] = found[found.len() - 2..] else { panic!("{found:?}") };
    println!("found {:.2}° to {:.2}°: {}", ends.a.to_degrees(), ends.b.to_degrees(), ends.text());
    println!(
        "motor {:.2}° to {:.2}°: {}",
        warning.a.to_degrees(),
        warning.b.to_degrees(),
        warning.text()
    );
    assert!(
        (ends.a.to_degrees() - STOPS_DEG.0).abs() < 1.0
            && (ends.b.to_degrees() - STOPS_DEG.1).abs() < 1.0
    );
    assert_eq!((ends.c, ends.severity), (0.0, Severity::Info.code()));
    assert_eq!(warning.severity, Severity::Warning.code(), "the stops are far within the limits");

    let commands: Vec<MotorCommand> = recording
        .messages::<MotorCommand>(COMMAND.topic.name)
        .unwrap()
        .map(|command| command.unwrap().message)
        .collect();
    let of = |mode: Mode| commands.iter().filter(move |command| command.mode == mode.code());
    assert!(of(Mode::Initialise).count() > 1000 && of(Mode::Centre).count() > 500);
    let most = of(Mode::Initialise).map(|command| command.volts[0].abs()).fold(0.0, f64::max);
    // Coming from another mode, a larger output would decrease within 50 ms; here the first mode is
    // the one with the low limit.
    assert!(most <= 4.0 + 1e-9, "{most} V");
    let samples: Vec<Sample> = recording
        .messages::<Sample>(SAMPLE.topic.name)
        .unwrap()
        .map(|sample| sample.unwrap().message)
        .collect();
    let ended = of(Mode::Centre).next_back().unwrap().sample_tick;
    let at_the_end = samples.iter().rev().find(|sample| sample.tick <= ended).unwrap();
    let position = at_the_end.master_position[0].to_degrees();
    assert!((position + 2.0).abs() < 6.0, "the handle rests at {position}°");
}
