//! A protocol in a scanner: real processes, the simulated card's trigger line, and what the
//! recording shows.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::io::Write as _;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use acquisition::Trigger;
use ipc_types::{
    Event, EventKind, LineEvent, Process, SAMPLE, SCANNER, SCANNER_KEY, Sample, ScannerPulse,
    VOLUME, Volume, VolumeSource, event_topic,
};
use recording::mcap_read::Recording;
use rig::RigFile;
use scanner::{Series, reconcile};
use serde_json::Value;

use common::playing::{kill_experiment, messages, play_until, play_with_kills};
use common::{TestRig, absolute, assert_told, told, wait_for};

const RIG: &str = include_str!("../launch/rigs/hydrostatic.toml");
const REPETITION_S: f64 = 0.5;

const PROTOCOL: &str = r#"[protocol]
name = "scan"

[scanner]
repetition_s = 0.5

[[segments]]
kind = "wait_for_scanner"
label = "wait"
timeout_s = 4.0
start_up_s = 1.0

[[segments]]
kind = "steps"
label = "steps"
positions_deg = [5.0, -5.0]
rise_s = 1.0
dwell_s = 2.0

[[segments]]
kind = "rest"
label = "rest"
duration_s = 2.0
"#;

/// Its segments.
const WAIT: u32 = 0;
const STEPS: u32 = 1;
/// They are typed in 4 s, of which the steps have been played for 2.5 s or more.
const KEYS_BEFORE_THE_KILL: u32 = 8;

/// A rig with absolute encoders, with other lines in its file.
fn write_rig(rig: &TestRig, changes: &[(&str, String)]) -> String {
    let text = changes.iter().fold(absolute(RIG), |text, (old, new)| {
        assert_eq!(text.matches(old).count(), 1, "{old}");
        text.replace(old, new)
    });
    let path = rig.path("scanner.toml");
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

fn write_protocol(rig: &TestRig) -> String {
    let path = rig.path("scan-protocol.toml");
    std::fs::write(&path, PROTOCOL).unwrap();
    path.to_str().unwrap().to_owned()
}

fn state(rig: &TestRig) -> Value {
    let status: Value = serde_json::from_str(&rig.ok(["status", "--json"])).unwrap();
    status["watchdog"]["state"].clone()
}

#[test]
fn a_protocol_in_the_scanner_counts_every_volume_though_its_process_is_killed() {
    let rig = TestRig::patient("scanner");
    // Faults all along the scan, as nobody knows when the protocol begins.
    let missing: Vec<u64> = (7..2000).step_by(7).collect();
    let spurious: Vec<f64> = (0..150).map(|at| 2.73 + 5.0 * f64::from(at)).collect();
    let rig_file = write_rig(
        &rig,
        &[
            ("trigger_repetition_s = 0.0", format!("trigger_repetition_s = {REPETITION_S:?}")),
            ("trigger_pulse_s = 0.01 ", "trigger_pulse_s = 0.008 ".to_owned()),
            ("trigger_jitter_s = 0.0", "trigger_jitter_s = 0.001".to_owned()),
            ("# trigger_missing = [12, 40] ", format!("trigger_missing = {missing:?} ")),
            ("# trigger_spurious_s = [33.3] ", format!("trigger_spurious_s = {spurious:?} ")),
        ],
    );
    let (protocol, file) = (write_protocol(&rig), rig.path("scan.mcap"));
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    rig.ok(["up", "--simulate", "--rig", &rig_file, "--record", &text(&file)]);

    // The pulse may come while no process is there to see it.
    let waited = play_with_kills(&rig, &[&protocol], &[WAIT]);
    assert!(waited["scan"]["volumes"].as_u64().unwrap() >= 12, "{waited}");
    let outcome = play_with_kills(&rig, &[&protocol], &[STEPS]);
    let status = rig.ok(["status"]);
    assert!(status.contains("scanner   ") && status.contains("pulses, the last"), "{status}");
    let scan = &outcome["scan"];
    assert!(scan["volumes"].as_u64().unwrap() >= 12, "{outcome}");
    rig.ok(["rec", "stop"]);
    rig.down();

    let recording = Recording::open(&file).unwrap();
    let samples: Vec<Sample> = messages(&recording, SAMPLE.topic.name);
    let told: Vec<ScannerPulse> = messages(&recording, SCANNER.topic.name);
    let times: Vec<u64> = told
        .iter()
        .filter(|pulse| pulse.kind == LineEvent::Pulse.code())
        .map(|pulse| pulse.at_ns)
        .collect();
    // Every pulse that the samples show was told, with the same time.
    let mut trigger = Trigger::new(&RigFile::load(&rig_file).unwrap()).unwrap();
    let shown: Vec<u64> =
        samples.iter().filter_map(|sample| trigger.observe(sample)).map(|p| p.at_ns).collect();
    assert_eq!(times, shown);

    // The volumes of the last run: what the pulses give, counted anew.
    let all: Vec<Volume> = messages(&recording, VOLUME.topic.name);
    let begun = all.iter().rposition(|volume| volume.index == 0).unwrap();
    let first_ns = all[begun].at_ns;
    let mut volumes: Vec<Volume> = Vec::new();
    for volume in &all[begun..] {
        volumes.retain(|known| known.index != volume.index);
        volumes.push(*volume);
    }
    volumes.sort_by_key(|volume| volume.index);
    let last_ns = volumes.last().unwrap().at_ns;
    let in_scan = times.iter().copied().filter(|at| (first_ns..=last_ns).contains(at));
    let expected = reconcile(in_scan, Series::new(REPETITION_S, None));
    assert!(expected.counts.missed >= 1 && expected.counts.spurious >= 1, "{expected:?}");
    let interpolated = VolumeSource::Interpolated.code();
    let found: Vec<_> = volumes
        .iter()
        .map(|volume| (volume.index, volume.at_ns, volume.source == interpolated))
        .collect();
    let recounted: Vec<_> = (0..)
        .zip(&expected.volumes)
        .map(|(index, volume)| (index, volume.at_ns, volume.interpolated))
        .collect();
    assert_eq!(found, recounted);
    assert_eq!(scan["volumes"], expected.counts.volumes);
    assert_eq!(scan["missed"], expected.counts.missed);
    // Spurious pulses after the last volume are no part of it.
    assert!(scan["spurious"].as_u64().unwrap() >= expected.counts.spurious, "{scan}");

    let topic = event_topic(Process::Experiment).unwrap().topic.name;
    let events: Vec<Event> = messages(&recording, topic);
    let has = |kind: EventKind| events.iter().any(|event| event.kind == kind.code());
    for kind in [
        EventKind::ScannerStarted,
        EventKind::VolumesMissed,
        EventKind::PulseSpurious,
        EventKind::ProtocolResumed,
        EventKind::VolumesCounted,
    ] {
        assert!(has(kind), "{kind:?}");
    }
    let listed = rig.run(["rec", "volumes", &text(&file), "--json"]);
    assert_eq!(listed.status.code(), Some(3), "{}", common::told(&listed));
    let scans: Value = serde_json::from_slice(&listed.stdout).unwrap();
    let rows = scans.as_array().unwrap().last().unwrap()["rows"].as_array().unwrap();
    assert_eq!(rows.len(), volumes.len());
}

#[test]
fn a_wait_without_a_scanner_ends_and_an_emulated_one_takes_its_place() {
    let rig = TestRig::patient("no-scanner");
    let (rig_file, protocol) = (write_rig(&rig, &[]), write_protocol(&rig));
    let file = rig.path("emulated.mcap").to_str().unwrap().to_owned();
    rig.ok(["up", "--simulate", "--rig", &rig_file, "--record", &file]);
    let ended = play_until(&rig, &["run", &protocol], "no pulse of the scanner came in time");
    assert_eq!(ended.status.code(), Some(1), "{}", told(&ended));
    let emulated = ["run", &protocol, "--emulate-scanner", "0.5", "--json"];
    let ended = play_until(&rig, &emulated, "completed");
    assert!(ended.status.success(), "{}", told(&ended));
    // 1 s of start-up, 6 s of steps and 2 s of rest, a volume every half second; on a host that
    // stalls for long a segment is played again.
    let outcome: Value = serde_json::from_slice(&ended.stdout).unwrap();
    assert!(outcome["scan"]["volumes"].as_u64().unwrap() >= 18, "{outcome}");
    assert_eq!((&outcome["scan"]["missed"], &outcome["scan"]["spurious"]), (&0.into(), &0.into()));
    // The recording is all that it takes to play it again.
    rig.ok(["rec", "stop"]);
    std::fs::remove_file(&protocol).unwrap();
    let shorter = ["--set", "segments.1.dwell_s=0.5", "--emulate-scanner", "0.5"];
    let again = [&["run", "--from", &file][..], &shorter[..]].concat();
    let ended = play_until(&rig, &again, "completed");
    assert!(ended.status.success(), "{}", told(&ended));
    let refused = rig.run(["run", "--from", &file, "--emulate-scanner", "0.001"]);
    assert_told(&refused, &["--emulate-scanner", "expected a repetition time from 0.02 to 60 s"]);
    rig.down();
}

/// Types a 5 every half second, and other keys between, until the program has ended; in the middle
/// of the steps, the process that counts them is killed.
fn type_keys(rig: &TestRig, run: &mut std::process::Child) {
    let mut input = run.stdin.take().unwrap();
    for typed in 0.. {
        if run.try_wait().unwrap().is_some() {
            return;
        }
        // It may have ended meanwhile.
        let _typed = input.write_all(b"x5 \n");
        std::thread::sleep(Duration::from_millis(250));
        if typed == KEYS_BEFORE_THE_KILL {
            kill_experiment(rig);
        }
        std::thread::sleep(Duration::from_millis(250));
    }
}

#[test]
fn keys_typed_at_the_terminal_are_the_scanners_pulses() {
    let rig = TestRig::patient("scanner-key");
    let rig_file = write_rig(&rig, &[]);
    let protocol = write_protocol(&rig);
    let file = rig.path("keys.mcap").to_str().unwrap().to_owned();
    rig.ok(["up", "--simulate", "--rig", &rig_file, "--record", &file]);
    // A thread that types is as late as the host makes it.
    let arguments = ["run", &protocol, "--scanner-key", "--set", "scanner.tolerance_s=0.12"];
    let mut last = String::new();
    let ended = (0..20).any(|_| {
        let _disarmed = rig.run(["disarm"]);
        rig.power_up();
        let mut run = rig.farreach(arguments);
        run.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut run = run.spawn().unwrap();
        type_keys(&rig, &mut run);
        last = told(&run.wait_with_output().unwrap());
        assert!(last.contains("completed") || last.contains("tripped"), "{last}");
        last.contains("completed")
    });
    assert!(ended, "{last}");
    let elsewhere = rig.run(["run", &protocol, "--scanner-key", "--emulate-scanner", "1"]);
    assert_told(&elsewhere, &["cannot be used with"]);
    rig.ok(["rec", "stop"]);
    let recording = Recording::open(Path::new(&file)).unwrap();
    let keys: Vec<ScannerPulse> = messages(&recording, SCANNER_KEY.topic.name);
    let volumes: Vec<Volume> = messages(&recording, VOLUME.topic.name);
    let key = VolumeSource::Key.code();
    let typed: Vec<&Volume> = volumes.iter().filter(|volume| volume.source == key).collect();
    // 1 s of start-up, 6 s of steps and 2 s of rest.
    assert!(typed.len() >= 15, "{} of {} keys: {last}", typed.len(), keys.len());
    for volume in typed {
        assert!(keys.iter().any(|key| key.at_ns == volume.at_ns), "{volume:?}");
    }
    // Those of the segment before the kill are counted again, and those typed while nobody
    // answered; what types may itself have been late.
    let missed = volumes.last().map(|volume| volume.missed);
    assert!(missed.is_some_and(|missed| missed <= 2), "{missed:?} missed: {last}");
    let listed = rig.run(["rec", "volumes", &file]);
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    assert!(listed.contains("(key 5)"), "{listed}");
    let anew = |pulses| ["rec", "volumes", &file, "--repetition", "0.5", "--pulses", pulses];
    rig.run(anew("key")).status.code().filter(|code| [0, 3].contains(code)).unwrap();
    assert_told(&rig.run(anew("line")), &["no protocol counted volumes"]);
    rig.down();
}

#[test]
fn a_rig_without_a_trigger_line_refuses_before_the_motor_gets_power() {
    let rig = TestRig::patient("no-trigger");
    let changes = [
        ("kind = \"trigger\"", "kind = \"other\"".to_owned()),
        ("[scanner]\nchannel = \"scanner_trigger\"", "[scanner]\ndigital = 0".to_owned()),
        ("threshold_v = 2.0\nhysteresis_v = 0.5 ", String::new()),
    ];
    // Such a file has a line; without the section it has none.
    let file = write_rig(&rig, &changes);
    let text = std::fs::read_to_string(&file).unwrap();
    let (head, rest) = text.split_once("[scanner]").unwrap();
    let (_, tail) = rest.split_once("\n\n").unwrap();
    std::fs::write(&file, format!("{head}{tail}")).unwrap();
    let protocol = write_protocol(&rig);
    rig.ok(["up", "--simulate", "--rig", &file]);
    let armed = wait_for(Duration::from_secs(60), || {
        let _reset = rig.run(["reset"]);
        rig.run(["arm"]).status.success() && state(&rig) == "armed"
    });
    assert!(armed, "{}", rig.ok(["status"]));
    let refused = rig.run(["run", &protocol]);
    assert_eq!(refused.status.code(), Some(1), "{}", told(&refused));
    assert_told(&refused, &["no trigger line", "--emulate-scanner"]);
    assert_eq!(state(&rig), "armed");
    rig.down();
}
