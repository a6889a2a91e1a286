//! A process written by others replaces control: one in Rust, built from `ipc-types` and `runtime`
//! alone, and one in Python, from the published files alone (docs/replacing.md). Both know the
//! topics, and nothing of farreach's own control.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use common::monitor::{LIMIT, Monitor};
use common::third_party::{CHILD, TARGET_RAD, third_party};
use common::{Signal, TestRig, kill, told, wait_for};
use ipc_types::{GateState, WatchdogState};
use launch::UnitState;

/// A Python with the package iceoryx2; without it the test of that stand-in is skipped.
const PYTHON: &str = "FARREACH_PYTHON";
/// The child process: this test binary, started again by the test below.
#[test]
#[ignore = "the third-party control's own process; the other test starts it"]
fn third_party_process() {
    let name = std::env::var(CHILD).expect("the name of a rig");
    third_party(&name).unwrap();
}

struct StandIn {
    child: Child,
    incarnation: u64,
}

impl StandIn {
    /// This test binary, started again.
    fn rust(rig: &TestRig) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "third_party_process", "--ignored", "--nocapture"]);
        Self::start(rig, command.env(CHILD, rig.name().as_str()))
    }

    /// The program in Python.
    fn python(rig: &TestRig, python: &str) -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut command = Command::new(python);
        command.arg(root.join("tests/stand_in/control.py"));
        command.arg("--schemas").arg(root.join("docs/schemas"));
        Self::start(rig, command.args(["--target-rad", "0.6", "--gain-v-per-rad", "12"]))
    }

    fn start(rig: &TestRig, command: &mut Command) -> Self {
        let mut child = command
            // So that it is found and killed with the rig if this test fails.
            .env("FARREACH_RIG_NAME", rig.name().as_str())
            .env_remove("NOTIFY_SOCKET")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let incarnation = lines
            .find_map(|line| line.unwrap().rsplit_once("incarnation ")?.1.parse().ok())
            .expect("the third-party control ended before it was ready");
        // Other output of the test harness must not block it.
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, incarnation }
    }
}

impl Drop for StandIn {
    fn drop(&mut self) {
        kill(self.child.id() as i32, Signal::TERM);
        let _ended = self.child.wait();
    }
}

#[test]
fn control_can_be_replaced_with_the_message_types_alone() {
    control_is_replaced("third-party", StandIn::rust);
}

#[test]
fn control_can_be_replaced_from_python_with_the_published_files_alone() {
    let Ok(python) = std::env::var(PYTHON) else {
        eprintln!("SKIPPED: {PYTHON} names no Python with the package iceoryx2");
        return;
    };
    control_is_replaced("third-party-py", |rig| StandIn::python(rig, &python));
}

/// Takes a rig's control out, puts another one in, gives it power, and takes it out again.
fn control_is_replaced(name: &str, start: impl Fn(&TestRig) -> StandIn) {
    let rig = TestRig::new(name);
    rig.up_homed();
    let monitor = Monitor::join(rig.name());
    monitor.power_up(&rig);
    let ours = monitor.seen().streams["command"].newest().incarnation;

    // farreach's own control ends regularly, and the launcher does not restart it.
    monitor.mark();
    let process = rig.launcher_status().unit("control").unwrap().process.unwrap();
    kill(process.pid, Signal::TERM);
    let ended = wait_for(LIMIT, || {
        rig.launcher_status().unit("control").unwrap().state == UnitState::Inactive
    });
    assert!(ended, "{:?}", rig.launcher_status().unit("control"));
    monitor.until("a trip", |seen| seen.state() == Some(WatchdogState::Tripped));
    monitor.pass_ticks(300);
    assert!(monitor.seen().newest_scan.is_some_and(|scan| !scan.volts && !scan.power));
    let refused = rig.run(["reset"]);
    assert!(!refused.status.success(), "reset without any control: {}", told(&refused));

    // A third-party control starts. That alone changes nothing for the motor.
    monitor.lead(false);
    let marked_ns = monitor.mark();
    let third_party = start(&rig);
    monitor.until("the third-party control's commands", |seen| {
        seen.command.is_some_and(|command| {
            command.incarnation == third_party.incarnation && command.time_ns > marked_ns
        })
    });
    monitor.pass_ticks(400);
    {
        let seen = monitor.seen();
        assert_eq!(seen.state(), Some(WatchdogState::Tripped));
        assert_eq!(
            (seen.last_volts(), seen.last_power()),
            (None, None),
            "power before anybody armed"
        );
        assert_eq!(seen.last_leave_ns(), None);
    }

    // Reset, arm and enable give it power, and the handle moves to its target.
    assert_ne!(third_party.incarnation, ours);
    hold_target(&rig, &monitor, third_party.incarnation);
    assert!(
        rig.launcher_status().unit("control").unwrap().state == UnitState::Inactive,
        "our control came back although it had ended in good order"
    );

    // When it ends, the power is cut, and farreach's own control can be started again.
    monitor.mark();
    drop(third_party);
    monitor.until("a trip", |seen| seen.state() == Some(WatchdogState::Tripped));
    monitor.lead(true);
    launch::restart(&rig.run_directory(), "control").unwrap();
    monitor.power_up(&rig);
    let newest = monitor.seen().streams["command"].newest().incarnation;
    assert!(newest != ours && monitor.seen().sample.unwrap().command_incarnation == newest);
    drop(monitor);
    rig.down();
}

/// Gives power until the handle is at the target by this control's commands, through an open gate.
/// A stall of the host takes the power from a control in Python now and then; an operator gives it
/// back.
fn hold_target(rig: &TestRig, monitor: &Monitor, incarnation: u64) {
    let mut senders = None;
    let holds = wait_for(LIMIT, || {
        if monitor.seen().state() != Some(WatchdogState::Enabled) {
            monitor.power_up(rig);
        }
        let seen = monitor.seen();
        let sample = seen.sample.unwrap();
        senders = Some((sample.command_incarnation, seen.streams["command"].newest().incarnation));
        (sample.master_position[0] - TARGET_RAD).abs() < 0.15
            && sample.gate_state == GateState::Open.code()
            && seen.state() == Some(WatchdogState::Enabled)
    });
    let seen = monitor.seen();
    assert!(holds, "the target was not held: {:?}\n{}", seen.sample, seen.account());
    drop(seen);
    assert_eq!(senders, Some((incarnation, incarnation)));
}
