use ipc_types::{COMMAND, Message, MotorCommand, TOPICS};
use recording::mcap_read::Recording;

use super::*;
use crate::scope::capture::{Capturer, Mode};
use crate::scope::trigger::Condition;

fn settings() -> Settings {
    Settings {
        mode: Mode::Single,
        window_ns: 10_000_000,
        pre_ns: 4_000_000,
        auto_ns: 1_000_000_000,
        channel: (0, 0),
        condition: Condition::Rising(0.5),
        hysteresis: 0.0,
    }
}

fn channels() -> Vec<Channel> {
    let channel = |name: &str, unit: &str, place| Channel {
        name: name.to_owned(),
        unit: unit.to_owned(),
        place,
    };
    vec![
        channel("torque", "N·m", (0, 0)),
        channel("mode", "", (1, 0)),
        channel("volts", "V", (0, 1)),
    ]
}

/// One topic of 1 kHz, with two samples missing after the trigger, and one of 250 Hz.
fn capture() -> Capture {
    let mut capturer = Capturer::new(settings(), &[2, 1], 100);
    let mut found = None;
    for at in (1..60u64).filter(|at| !(22..24).contains(at)) {
        let (value, gap) = (f64::from(u8::from(at >= 20)), (at == 24).then_some(2));
        capturer.take(0, at * 1_000_000, gap, &[value, if at == 18 { f64::NAN } else { -0.5 }]);
        if at % 4 == 0 {
            capturer.take(1, at * 1_000_000, None, &[at as f64]);
        }
        found = found.or(capturer.advance(at * 1_000_000));
    }
    found.unwrap()
}

fn window<'a>(capture: &'a Capture, channels: &'a [Channel], settings: &'a Settings) -> Window<'a> {
    Window { place: "rig demo", capture, channels, settings, trigger: "torque rises to 0.5 N·m" }
}

#[test]
fn a_table_has_time_channels_and_what_is_missing() {
    let (capture, channels, settings) = (capture(), channels(), settings());
    let table = window(&capture, &channels, &settings).csv().unwrap();
    let expected = "\
t_s,torque [N·m],mode,volts [V],lost_before
-0.004000000,0,16,-0.5,0
-0.003000000,0,,-0.5,0
-0.002000000,0,,NaN,0
-0.001000000,0,,-0.5,0
0.000000000,1,20,-0.5,0
0.001000000,1,,-0.5,0
0.004000000,1,24,-0.5,2
0.005000000,1,,-0.5,0
0.006000000,1,,-0.5,0
";
    assert_eq!(String::from_utf8(table).unwrap(), expected);
}

#[test]
fn a_figure_has_a_panel_for_each_unit_trigger_and_losses() {
    let (capture, channels, settings) = (capture(), channels(), settings());
    let svg = window(&capture, &channels, &settings).svg().unwrap();
    assert!(svg.contains("fill=\"#ffffff\""), "a light background");
    for text in [
        "time from the trigger / s",
        "N·m",
        "value",
        "torque",
        "mode",
        "volts",
        "trigger",
        "level of the trigger",
        "rig demo: torque rises to 0.5 N·m; 2 messages are missing",
    ] {
        assert!(svg.contains(text), "{text}");
    }
    assert_eq!(svg.matches("<svg").count(), 4, "the page and three panels");
}

#[test]
fn a_target_is_known_by_its_ending_and_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for (name, kind) in [("a.svg", Kind::Svg), ("a.csv", Kind::Csv), ("a.mcap", Kind::Mcap)] {
        assert_eq!(Target::new(&path(name)).unwrap().kind, kind);
    }
    let error = Target::new(&path("a.png")).unwrap_err().to_string();
    assert!(error.ends_with("a.png: expected a file .svg, .csv or .mcap"), "{error}");
    std::fs::write(path("b.csv"), "mine").unwrap();
    let error = Target::new(&path("b.csv")).unwrap_err().to_string();
    assert!(error.contains("never overwritten"), "{error}");
    let (late, csv) = (path("c.csv"), Kind::Csv);
    std::fs::write(&late, "came meanwhile").unwrap();
    assert!(Target { path: &late, kind: csv }.write("t_s\n").is_err());
    assert_eq!(std::fs::read_to_string(&late).unwrap(), "came meanwhile");
}

#[test]
fn messages_of_a_running_rig_are_written_as_they_came() {
    let (folder, capture) = (tempfile::tempdir().unwrap(), capture());
    let path = folder.path().join("window.mcap");
    let topic = TOPICS.iter().position(|topic| topic.name == COMMAND.topic.name).unwrap();
    let mut kept = Kept::new(settings().window_ns);
    for at in (1..3000u64).filter(|at| !(22..24).contains(at)) {
        let mut command = MotorCommand { sample_tick: at, ..MotorCommand::default() };
        command.stamp(1, 2, at, at * 1_000_000);
        kept.keep(at * 1_000_000, topic, command.as_bytes());
    }
    // 10 ms and 2 s.
    assert_eq!(kept.messages.len(), 2011);
    let mut kept = Kept::new(settings().window_ns);
    for at in [30, 29, 16, 20, 27, 26, 15] {
        let mut command = MotorCommand { sample_tick: at, ..MotorCommand::default() };
        command.stamp(1, 2, at, at * 1_000_000);
        kept.keep(at * 1_000_000, topic, command.as_bytes());
    }
    let rig: RigName = "bench".parse().unwrap();
    let file = rig::load_rig(Path::new("hydrostatic")).unwrap();
    let target = Target::new(&path).unwrap();
    target.write_messages(&capture, kept, &rig, Some(&file)).unwrap();
    let recording = Recording::open(&path).unwrap();
    assert!(recording.ended_cleanly());
    assert_eq!(recording.metadata(key::RIG_NAME), Some("bench"));
    assert_eq!(recording.metadata(key::RIG_FILE), Some(file.text()));
    let commands = recording.messages::<MotorCommand>("command").unwrap();
    let ticks: Vec<_> = commands.map(|command| command.unwrap().message.sample_tick).collect();
    assert_eq!(ticks, [16, 20, 26]);
    let again = target.write_messages(&capture, Kept::new(1), &rig, None).unwrap_err();
    assert!(again.to_string().contains("window.mcap"), "{again}");
    assert!(path.exists(), "what is there stays");
}
