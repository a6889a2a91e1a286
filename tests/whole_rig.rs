//! A complete laboratory session: up, armed, powered, a protocol played, probed and recorded
//! meanwhile, down; in both timing profiles, and with control at its highest rate.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Duration;

use ipc_types::{
    COMMAND, Event, EventKind, GateState, Mode, MotorCommand, PROCESSES, Process, SAMPLE, Sample,
    event_topic,
};
use recording::mcap_read::Recording;
use serde_json::Value;

use common::{TestRig, told, wait_for, workers};

const RIG: &str = include_str!("../launch/rigs/hydrostatic.toml");

/// The guided movement of the session.
const AMPLITUDE_DEG: f64 = 30.0;
const PROTOCOL: &str = r#"[protocol]
name = "session"

[[segments]]
kind = "guided_sine"
label = "guided"
amplitude_deg = 30.0
frequency_hz = 0.5
duration_s = 4.0
fade_in_s = 1.0
fade_out_s = 0.5

[[segments]]
kind = "steps"
label = "steps"
positions_deg = [15.0, 0.0]
rise_s = 0.5
dwell_s = 0.5
"#;

/// A session and how its rig is started.
struct Session {
    rig: TestRig,
    rig_file: Option<PathBuf>,
    profile: Option<&'static str>,
    control_hz: f64,
}

impl Session {
    fn new(tag: &str) -> Self {
        Self { rig: TestRig::new(tag), rig_file: None, profile: None, control_hz: 500.0 }
    }

    /// Runs the binary, in the session's profile.
    fn run<'a>(&self, arguments: impl IntoIterator<Item = &'a str>) -> Output {
        let mut command = self.rig.farreach(arguments);
        if let Some(profile) = self.profile {
            command.env("FARREACH_PROFILE", profile);
        }
        command.output().unwrap()
    }

    fn ok<'a>(&self, arguments: impl IntoIterator<Item = &'a str>) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{}", told(&output));
        String::from_utf8(output.stdout).unwrap()
    }

    fn file(&self, name: &str) -> String {
        self.rig.path(name).to_str().unwrap().to_owned()
    }

    fn up(&self, record: &str) {
        let chosen = match &self.rig_file {
            Some(path) => path.to_str().unwrap().to_owned(),
            None => self.rig.absolute_rig("hydrostatic"),
        };
        self.ok(["up", "--simulate", "--record", record, "--rig", &chosen]);
    }

    fn status(&self) -> Value {
        serde_json::from_str(&self.ok(["status", "--json"])).unwrap()
    }

    /// Asserts that all processes are ready, never restarted, and at the rates of the rig file. A
    /// loaded host may take a while to get there.
    fn assert_all_run(&self) {
        let mut last = Value::Null;
        let nominal: BTreeMap<&str, f64> = BTreeMap::from([
            ("acquisition", 2000.0),
            ("control", self.control_hz),
            ("watchdog", 1000.0),
        ]);
        let held = wait_for(Duration::from_secs(30), || {
            last = self.status();
            let processes = last["processes"].as_array().unwrap();
            let rates = processes.iter().all(|process| {
                match nominal.get(process["name"].as_str().unwrap()) {
                    Some(nominal) => process["rate_hz"]
                        .as_f64()
                        .is_some_and(|rate| (rate / nominal - 1.0).abs() < 0.05),
                    None => true,
                }
            });
            rates && processes.iter().all(|process| process["state"] == "ready")
        });
        assert!(held, "{last:#}");
        let names: BTreeSet<_> = last["processes"]
            .as_array()
            .unwrap()
            .iter()
            .map(|p| p["name"].as_str().unwrap())
            .collect();
        assert_eq!(names, BTreeSet::from_iter(workers()));
        assert!(
            last["processes"].as_array().unwrap().iter().all(|process| process["restarts"] == 0),
            "{last:#}"
        );
        assert_eq!(
            (&last["up"], &last["state"], &last["backend"]),
            (&true.into(), &"up".into(), &"simulated".into())
        );
        if let Some(profile) = self.profile {
            assert_eq!(last["profile"].as_str().unwrap().replace('_', "-"), profile, "{last:#}");
        }
        assert_eq!(last["losses"], Value::Array(Vec::new()), "{last:#}");
    }

    /// Powers up and plays the protocol to its end; `meanwhile` runs during it. On a loaded host a
    /// best-effort rig may trip, rightly; the test then resets it and starts again.
    fn play(&self, mut meanwhile: impl FnMut()) {
        let protocol = self.file("session.toml");
        std::fs::write(&protocol, PROTOCOL).unwrap();
        let mut last = String::new();
        for attempt in 1..=20 {
            self.rig.power_up();
            let mut command = self.rig.farreach(["run", &protocol, "--subject", "S07"]);
            command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
            let child = command.spawn().unwrap();
            if attempt == 1 {
                meanwhile();
            }
            let output = child.wait_with_output().unwrap();
            if output.status.success() {
                println!("attempt {attempt}: {}", String::from_utf8_lossy(&output.stdout).trim());
                return;
            }
            last = told(&output);
            assert!(
                last.contains("watchdog is tripped") || last.contains("the rig is tripped"),
                "{last}"
            );
            let status = self.status();
            eprintln!("attempt {attempt}: {last}\n{:#}\n{:#}", status["gate"], status["processes"]);
        }
        panic!("never played to its end: {last}");
    }

    fn verified(&self, file: &str) -> Recording {
        let verified = self.run(["rec", "verify", file]);
        assert_eq!(verified.status.code(), Some(0), "{}", told(&verified));
        Recording::open(Path::new(file)).unwrap()
    }
}

fn samples(recording: &Recording) -> Vec<Sample> {
    recording
        .messages::<Sample>(SAMPLE.topic.name)
        .unwrap()
        .map(|sample| sample.unwrap().message)
        .collect()
}

/// Asserts that no message and no tick of the card is missing between the first and the last
/// sample.
fn assert_contiguous(samples: &[Sample]) {
    assert!(!samples.is_empty());
    for pair in samples.windows(2) {
        assert_eq!(pair[1].sequence, pair[0].sequence + 1);
        assert_eq!(
            pair[1].tick,
            pair[0].tick + 1,
            "the card's FIFO bridges the periods that acquisition missed"
        );
        assert_eq!((pair[1].session, pair[1].incarnation), (pair[0].session, pair[0].incarnation));
    }
    assert_eq!(samples[samples.len() - 1].scans_missed, 0);
}

/// Asserts that the motor followed control: the range of its movement, and its error (rad) against
/// the reference while the gate was open and no transition was under way.
fn assert_followed(samples: &[Sample], recording: &Recording) {
    let at: BTreeMap<u64, &Sample> = samples.iter().map(|sample| (sample.tick, sample)).collect();
    let (mut squares, mut count, mut span) = (0.0, 0u32, [0.0f64; 2]);
    for command in recording.messages::<MotorCommand>(COMMAND.topic.name).unwrap() {
        let command = command.unwrap().message;
        let Some(sample) = at.get(&command.sample_tick) else { continue };
        let led =
            command.mode == Mode::Position.code() && command.ramping == 0 && command.lapsed == 0;
        if !led || sample.gate_state != GateState::Open.code() {
            continue;
        }
        squares += (command.reference_position[0] - sample.master_position[0]).powi(2);
        count += 1;
        span = [span[0].min(sample.master_position[0]), span[1].max(sample.master_position[0])];
    }
    let error_deg = (squares / f64::from(count.max(1))).sqrt().to_degrees();
    let [low, high] = span.map(f64::to_degrees);
    println!(
        "{count} commands led the motor from {low:.1}° to {high:.1}°, \
         {error_deg:.2}° rms off the reference"
    );
    assert!(count > 500, "{count} commands led the motor");
    assert!(high > 0.8 * AMPLITUDE_DEG && low < -0.8 * AMPLITUDE_DEG, "from {low}° to {high}°");
    assert!(high < 1.3 * AMPLITUDE_DEG && low > -1.3 * AMPLITUDE_DEG, "from {low}° to {high}°");
    assert!(error_deg < 0.25 * AMPLITUDE_DEG, "{error_deg}° rms off the reference");
    assert!(samples.iter().any(|sample| sample.output_v[0] != 0.0 && sample.motor_power == 1));
}

fn has_event(recording: &Recording, process: Process, kind: EventKind) -> bool {
    let topic = event_topic(process).unwrap().topic.name;
    let mut events = recording.messages::<Event>(topic).unwrap().flatten();
    events.any(|event| event.message.kind == kind.code())
}

fn assert_event(recording: &Recording, process: Process, kind: EventKind) {
    assert!(has_event(recording, process, kind), "no event \"{kind}\" of {process}");
}

/// Asserts that every loss counter of a loop has a place in the status; no process was killed here,
/// so no connection was lost.
fn assert_losses_are_shown(status: &Value) {
    for process in PROCESSES.iter().filter(|entry| entry.real_time.is_some()) {
        let process = process.name();
        let row = status["processes"]
            .as_array()
            .unwrap()
            .iter()
            .find(|row| row["name"] == process)
            .unwrap();
        let losses = row["losses"]
            .as_object()
            .unwrap_or_else(|| panic!("{process} reported no losses: {status:#}"));
        let count = |name: &str| losses[name].as_u64().unwrap();
        assert_eq!(
            (count("out_of_turn"), count("undelivered"), count("dropped")),
            (0, 0, 0),
            "{process}: {losses:?}"
        );
    }
}

/// Rates of topics, and their messages in order.
fn assert_probes_see_the_movement(session: &Session) {
    let rates: Value = serde_json::from_str(&session.ok([
        "probe",
        "hz",
        "sample",
        "command",
        "--seconds",
        "1",
        "--json",
    ]))
    .unwrap();
    for (topic, nominal) in [("sample", 2000.0), ("command", 500.0)] {
        let row = rates.as_array().unwrap().iter().find(|row| row["topic"] == topic).unwrap();
        let rate = row["rate_hz"].as_f64().unwrap();
        assert!((rate / nominal - 1.0).abs() < 0.2, "{rates}");
    }
    let echo = session.ok(["probe", "echo", "sample", "--count", "3", "--json"]);
    let lines: Vec<Value> = echo.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 3, "{echo}");
    let tick = |line: &Value| line["fields"]["tick"].as_u64().unwrap();
    assert!(tick(&lines[1]) > tick(&lines[0]) && tick(&lines[2]) > tick(&lines[1]), "{echo}");
    assert!(
        lines
            .iter()
            .all(|line| line["topic"] == "sample" && line["fields"]["master_position"].is_array())
    );
}

#[test]
fn a_session_from_up_to_down() {
    let session = Session::new("whole");
    let (first, second) = (session.file("first.mcap"), session.file("second.mcap"));
    session.up(&first);
    session.assert_all_run();
    assert_eq!(session.status()["recording"]["file"], first.as_str());

    let again = session.run(["up", "--simulate"]);
    assert_eq!(again.status.code(), Some(1), "{}", told(&again));
    assert!(String::from_utf8_lossy(&again.stderr).contains("already up"), "{}", told(&again));

    session.play(|| {
        assert_probes_see_the_movement(&session);

        // The first recording ends and a second one begins during the movement.
        session.ok(["rec", "stop"]);
        assert_eq!(session.status()["recording"]["file"], Value::Null);
        let taken = session.run(["rec", "start", &first]);
        assert_eq!(taken.status.code(), Some(1), "{}", told(&taken));
        assert!(
            String::from_utf8_lossy(&taken.stderr).contains("never overwritten"),
            "{}",
            told(&taken)
        );
        session.ok(["rec", "start", &second, "--metadata", "subject=S07"]);
        assert_eq!(session.status()["recording"]["file"], second.as_str());
        let told = session.ok(["rec", "tag", "elbow moved", "--author", "anna"]);
        assert_eq!(told, format!("{second}: anna: elbow moved\n"));
    });
    // A loaded host may have tripped the rig since, which takes the power away as well.
    let _disarmed = session.run(["disarm"]);
    session.ok(["rec", "stop"]);
    let nothing = session.run(["rec", "stop"]);
    assert_eq!(nothing.status.code(), Some(1), "{}", told(&nothing));
    let status = session.status();
    assert_eq!(
        (&status["watchdog"]["enabled"], &status["gate"]["motor_power"]),
        (&false.into(), &false.into()),
        "{status:#}"
    );
    assert_losses_are_shown(&status);
    session.rig.down();

    let (before, after) = (session.verified(&first), session.verified(&second));
    let (early, late) = (samples(&before), samples(&after));
    assert_contiguous(&early);
    assert_contiguous(&late);
    // Acquisition ran throughout, so the gap between the recordings is what was published in
    // between.
    assert_eq!(early[0].incarnation, late[0].incarnation);
    assert_eq!(late[0].sequence - early[0].sequence, late[0].tick - early[0].tick);
    // The first attempt may have ended before it began, if the rig tripped between two of the
    // operator's commands.
    let started = |recording| has_event(recording, Process::Experiment, EventKind::ProtocolStarted);
    assert!(
        started(&before) || started(&after),
        "no event \"protocol started\" in either recording"
    );
    assert_event(&after, Process::Experiment, EventKind::ProtocolDone);
    assert_eq!(after.metadata("subject"), Some("S07"));
    let info: Value =
        serde_json::from_str(&session.ok(["rec", "info", &second, "--json"])).unwrap();
    assert_eq!(info["notes"][0]["text"], "anna: elbow moved", "{info:#}");
    assert!(info["notes"][0]["t_s"].as_f64().unwrap() > 0.0);
    // The recording contains what was run: the protocol's text and the subject.
    let run = before.runs().chain(after.runs()).last().unwrap();
    assert_eq!(run["subject"], "S07");
    assert_eq!(run["protocol_file"], PROTOCOL);
    assert_eq!(after.metadata("rig"), Some("hydrostatic"));
    assert!(after.metadata("rig_file").unwrap().contains("hose_length_m"));
}

#[test]
fn best_effort_timing_follows_and_loses_nothing() {
    let session = Session { profile: Some("best-effort"), ..Session::new("effort") };
    let file = session.file("run.mcap");
    session.up(&file);
    session.assert_all_run();
    session.play(|| {});
    session.rig.down();
    let recording = session.verified(&file);
    assert_eq!(recording.metadata("profile"), Some("best-effort"));
    let samples = samples(&recording);
    assert_contiguous(&samples);
    assert_followed(&samples, &recording);
}

#[test]
fn control_at_one_kilohertz_follows_and_loses_nothing() {
    let mut session = Session { control_hz: 1000.0, ..Session::new("khz") };
    let rig_file = session.rig.path("fast.toml");
    assert_eq!(RIG.matches("control_hz = 500").count(), 1);
    let fast = common::absolute(RIG).replace("control_hz = 500", "control_hz = 1000");
    std::fs::write(&rig_file, fast).unwrap();
    session.rig_file = Some(rig_file);
    let file = session.file("run.mcap");
    session.up(&file);
    session.assert_all_run();
    session.play(|| {});
    session.rig.down();
    let recording = session.verified(&file);
    let samples = samples(&recording);
    assert_contiguous(&samples);
    assert_followed(&samples, &recording);
}
