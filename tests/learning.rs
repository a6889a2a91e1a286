//! Iterative learning on the whole rig: a learning run across a `kill -9` of the experiment
//! process, its reference saved and played again, a damaged reference refused.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;
use std::process::{Output, Stdio};
use std::time::Duration;

use ipc_types::{Event, EventKind, Mode, Process, SETPOINT, Setpoint, Severity, event_topic};
use recording::mcap_read::Recording;

use common::{Signal, TestRig, kill, told, wait_for};

/// Blocks of two cycles, and gains that reduce the error by a third from block to block.
const LEARN: &str = r#"[protocol]
name = "first"

[[segments]]
kind = "learn"
label = "learn"
amplitude_deg = 20.0
frequency_hz = 1.0
fade_in_s = 1.0
fade_out_s = 0.5
cycles_per_block = 2
blocks = 5
law = "published"
gamma_p = 0.35
gamma_d = 0.0
save = "first"
"#;

const AGAIN: &str = r#"[protocol]
name = "again"

[[segments]]
kind = "learn"
label = "again"
amplitude_deg = 20.0
frequency_hz = 1.0
fade_in_s = 1.0
fade_out_s = 0.5
cycles_per_block = 2
blocks = 2
law = "none"
load = "first"
"#;

/// Runs a protocol; `meanwhile` is called during it. An error if the host was too busy, so that the
/// watchdog rightly cut the power.
fn attempt(rig: &TestRig, protocol: &Path, meanwhile: impl FnOnce()) -> Result<Output, String> {
    rig.power_up();
    let mut command = rig.farreach(["run", protocol.to_str().unwrap()]);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    meanwhile();
    let output = child.wait_with_output().unwrap();
    let text = told(&output);
    if text.contains("watchdog is tripped") || text.contains("the rig is tripped") {
        Err(text)
    } else {
        Ok(output)
    }
}

fn until_it_plays(rig: &TestRig, protocol: &Path, meanwhile: impl Fn()) -> Output {
    let mut last = String::new();
    for _ in 0..10 {
        match attempt(rig, protocol, &meanwhile) {
            Ok(output) => return output,
            Err(text) => last = text,
        }
    }
    panic!("never played to its end: {last}");
}

fn events(recording: &Recording) -> Vec<Event> {
    let topic = event_topic(Process::Experiment).unwrap().topic.name;
    recording.messages::<Event>(topic).unwrap().map(|event| event.unwrap().message).collect()
}

fn is(event: &Event, kind: EventKind) -> bool {
    event.kind == kind.code()
}

/// Kills the experiment process once two blocks are done.
fn kill_in_the_middle(rig: &TestRig) {
    let state = rig.run_directory().join("experiment.ilc");
    let old = std::fs::metadata(&state).and_then(|found| found.modified()).ok();
    let mut changes = 0;
    let mut last = old;
    let learnt = wait_for(Duration::from_secs(30), || {
        let now = std::fs::metadata(&state).and_then(|found| found.modified()).ok();
        if now.is_some() && now != last {
            last = now;
            changes += 1;
        }
        changes >= 2
    });
    if !learnt {
        // The watchdog cut the power first; the attempt reports it.
        return;
    }
    let pid = rig
        .launcher_status()
        .unit("experiment")
        .and_then(|unit| unit.process.as_ref().map(|process| process.pid));
    kill(pid.unwrap(), Signal::KILL);
}

/// A reference with a flipped bit, or a truncated one, is not played.
fn assert_damage_is_refused(rig: &TestRig, reference: &Path, again: &Path) {
    let mut bytes = std::fs::read(reference).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(reference, &bytes).unwrap();
    rig.power_up();
    let damaged = rig.run(["run", again.to_str().unwrap()]);
    assert_eq!(damaged.status.code(), Some(1), "{}", told(&damaged));
    assert!(told(&damaged).contains("damaged"), "{}", told(&damaged));
    std::fs::write(reference, &bytes[..middle]).unwrap();
    let cut = rig.run(["run", again.to_str().unwrap()]);
    assert_eq!(cut.status.code(), Some(1), "{}", told(&cut));
}

#[test]
fn learning_survives_a_restart_and_its_reference_is_saved() {
    // A learning run is long: on a busy host the shorter timeouts of the real-time profile would
    // end it.
    let rig = TestRig::patient("learning");
    let (learnt, file) = (rig.path("learnt"), rig.path("run.mcap"));
    let up = rig
        .farreach(["up", "--simulate", "--rig", &rig.absolute_rig("hydrostatic"), "--record"])
        .arg(&file)
        .env("FARREACH_LEARNT", &learnt)
        .output()
        .unwrap();
    assert!(up.status.success(), "{}", told(&up));
    let [first, again] = [("first.toml", LEARN), ("again.toml", AGAIN)].map(|(name, text)| {
        let path = rig.path(name);
        std::fs::write(&path, text).unwrap();
        path
    });

    // Before anything is learnt there is no reference to play: the protocol is refused with a
    // reason, and nothing moves.
    rig.power_up();
    let missing = rig.run(["run", again.to_str().unwrap()]);
    assert_eq!(missing.status.code(), Some(1), "{}", told(&missing));
    assert!(told(&missing).contains("first.learnt"), "{}", told(&missing));
    rig.ok(["disarm"]);

    let played = until_it_plays(&rig, &first, || kill_in_the_middle(&rig));
    assert!(played.status.success(), "{}", told(&played));
    let reference = learnt.join("first.learnt");
    assert!(reference.exists(), "the reference was not saved");
    rig.ok(["disarm"]);

    let played = until_it_plays(&rig, &again, || {});
    assert!(played.status.success(), "{}", told(&played));
    rig.ok(["disarm"]);

    assert_damage_is_refused(&rig, &reference, &again);
    let _disarmed = rig.run(["disarm"]);
    rig.down();

    let recording = Recording::open(&file).unwrap();
    let events = events(&recording);
    // The last attempt at each protocol.
    let begun = |name: &str| {
        events
            .iter()
            .rposition(|event| is(event, EventKind::ProtocolStarted) && event.text() == name)
            .unwrap()
    };
    let (one, two) = (begun("first"), begun("again"));
    let blocks = |events: &[Event]| -> Vec<(u32, f64)> {
        let blocks = events.iter().filter(|event| is(event, EventKind::BlockLearnt));
        blocks.map(|event| (event.a as u32, event.b.to_degrees())).collect()
    };
    let of_first = blocks(&events[one..two]);
    println!("{of_first:.2?}");
    let numbers: Vec<u32> = of_first.iter().map(|block| block.0).collect();
    assert!(numbers.windows(2).all(|pair| pair[1] == pair[0] + 1), "{numbers:?}");
    assert_eq!((numbers[0], *numbers.last().unwrap()), (1, 5));
    let told: Vec<&str> = events[one..two].iter().map(Event::text).collect();
    assert!(told.iter().any(|text| text.starts_with("learning goes on after block")), "{told:?}");
    let (begins, ends) = (of_first[0].1, of_first[4].1);
    assert!(ends < 0.5 * begins, "{of_first:?}");
    let ended = events[one..two].iter().filter(|event| is(event, EventKind::LearningEnded));
    let texts: Vec<&str> = ended.map(Event::text).collect();
    assert!(texts.iter().any(|text| text.starts_with("all blocks are done")), "{texts:?}");
    assert!(texts.contains(&"reference kept as \"first\""), "{texts:?}");

    let of_again = blocks(&events[two..]);
    println!("{of_again:.2?}");
    assert_eq!(of_again.len(), 2);
    assert!(of_again[0].1 < 0.5 * begins, "{of_again:?} after {of_first:?}");
    let refused = events[two..].iter().filter(|event| {
        is(event, EventKind::ProtocolStopped) && event.severity == Severity::Error.code()
    });
    let reasons: Vec<&str> = refused.map(Event::text).collect();
    assert_eq!(reasons.len(), 2, "{reasons:?}");
    assert!(reasons.iter().all(|reason| reason.contains("cannot be used")), "{reasons:?}");

    let setpoints: Vec<Setpoint> = recording
        .messages::<Setpoint>(SETPOINT.topic.name)
        .unwrap()
        .map(|setpoint| setpoint.unwrap().message)
        .collect();
    assert!(setpoints.iter().any(|setpoint| setpoint.mode == Mode::Learning.code()));
    // After the refusals no movement is requested.
    let last = setpoints.last().unwrap();
    let rests = [Mode::Hold, Mode::Passive].map(Mode::code).contains(&last.mode);
    assert!(rests && last.velocity[0] == 0.0, "mode {}, {} rad/s", last.mode, last.velocity[0]);
}
