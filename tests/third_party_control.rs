//! A process written by others replaces control: one in Rust, built from `ipc-types` and `runtime`
//! alone, and one in Python, from the published files alone (docs/replacing.md). Both know the
//! topics, and nothing of farreach's own control.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use common::monitor::{LIMIT, Monitor};
use common::{Signal, TestRig, kill, told, wait_for};
use ipc_types::program_flow::{Checkpoint, Flow};
use ipc_types::{AXES, COMMAND, GateState, MotorCommand, Process, SAMPLE, TOKEN, WatchdogState};
use launch::UnitState;
use runtime::{Grid, Service};

/// A Python with the package iceoryx2; without it the test of that stand-in is skipped.
const PYTHON: &str = "FARREACH_PYTHON";
/// Name of the rig, for the child.
const CHILD: &str = "FARREACH_THIRD_PARTY";
/// Target position (rad), gain (V/rad) and voltage limit (V) of the third-party control.
const TARGET_RAD: f64 = 0.6;
const GAIN_V_PER_RAD: f64 = 12.0;
const VOLTS_MAX: f64 = 4.0;

/// The third-party control: a proportional law around one position.
fn third_party(rig_name: &str) -> Result<(), Box<dyn std::error::Error>> {
    let mut service = Service::start(Process::Control, rig_name)?;
    let mut samples = service.subscriber(SAMPLE)?;
    let mut tokens = service.subscriber(TOKEN)?;
    let mut commands = service.publisher(COMMAND)?;
    let own = service.identity().incarnation;
    let profile = service.enter_loop()?;
    println!("incarnation {own}");
    let mut grid = Grid::of_rate(500, 200_000);
    let (mut sample, mut token) = (None, None);
    while !service.stopping() {
        let Some(wake) = grid.wait() else { continue };
        // The watchdog checks that each cycle has passed these, in this order.
        let mut flow = Flow::default();
        sample = samples.latest()?.or(sample);
        flow.pass(Checkpoint::SampleTaken);
        // This control follows no setpoints.
        flow.pass(Checkpoint::SetpointsTaken);
        token = tokens.latest()?.or(token);
        flow.pass(Checkpoint::TokenTaken);
        if let (Some(sample), Some(token)) = (&sample, &token) {
            let powered = token.enabled == 1
                && token.control_incarnation == own
                && sample.epoch == token.epoch
                && sample.gate_state == GateState::Open.code();
            let wanted_v = GAIN_V_PER_RAD * (TARGET_RAD - sample.master_position[0]);
            let mut volts = [0.0; AXES];
            volts[0] = if powered { wanted_v.clamp(-VOLTS_MAX, VOLTS_MAX) } else { 0.0 };
            flow.pass(Checkpoint::LawStepped);
            commands.send(MotorCommand {
                flow: flow.signature(token.sequence),
                sample_tick: sample.tick,
                sample_time_ns: sample.scan_time_ns,
                computed_ns: wake.woke_ns,
                token_sequence: token.sequence,
                epoch: token.epoch,
                volts,
                axes: 1,
                profile: profile.code(),
                cycles_missed: grid.missed(),
                ..MotorCommand::default()
            })?;
        }
        service.beat();
    }
    Ok(())
}

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

#[test]
fn a_process_is_restarted_and_replaced_by_a_command() {
    let rig = TestRig::new("replaced");
    rig.up_homed();
    let monitor = Monitor::join(rig.name());
    let pid = |name: &str| rig.launcher_status().unit(name).unwrap().process.unwrap().pid;
    let before = pid("logger");
    rig.ok(["restart", "logger"]);
    assert_ne!(pid("logger"), before);

    // Nothing is changed by a program that cannot be run, or of no process.
    let before = pid("control");
    for (arguments, said) in [
        (&["replace", "control", "--", "no-such-program"][..], "no-such-program"),
        (&["replace", "keeper", "--", "true"][..], "not replaced"),
        (&["replace", "nobody", "--", "true"][..], "there are: "),
        (&["restart", "nobody"][..], "there are: "),
    ] {
        let refused = rig.run(arguments.iter().copied());
        assert!(!refused.status.success() && told(&refused).contains(said), "{}", told(&refused));
    }
    assert_eq!(pid("control"), before);

    // While the motor is enabled its loops stay, unless a person insists.
    monitor.power_up(&rig);
    let refused = rig.run(["restart", "control"]);
    assert!(!refused.status.success() && told(&refused).contains("--force"), "{}", told(&refused));
    assert_eq!(monitor.seen().state(), Some(WatchdogState::Enabled));
    monitor.mark();
    rig.ok(["restart", "control", "--force"]);
    monitor.until("a trip", |seen| seen.state() == Some(WatchdogState::Tripped));

    // The same control by another way: this test binary, as the launcher starts it.
    let own = std::env::current_exe().unwrap();
    let own = own.to_str().unwrap();
    let arguments = ["--exact", "third_party_process", "--ignored", "--nocapture"];
    let command = ["env", &format!("{CHILD}={}", rig.name()), own];
    let replaced = ["replace", "control", "--"].into_iter().chain(command).chain(arguments);
    rig.ok(replaced);
    let shown = told(&rig.run(["status"]));
    assert!(shown.contains("control: REPLACED by"), "{shown}");
    monitor.power_up(&rig);
    monitor.until("the handle at the third-party control's target", |seen| {
        (seen.sample.unwrap().master_position[0] - TARGET_RAD).abs() < 0.15
    });
    rig.ok(["replace", "control", "--undo", "--force"]);
    let shown = told(&rig.run(["status"]));
    assert!(!shown.contains("REPLACED"), "{shown}");
    monitor.power_up(&rig);
    drop(monitor);
    rig.down();
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
    monitor.power_up(&rig);
    let position = |seen: &common::monitor::Seen| seen.sample.unwrap().master_position[0];
    monitor.until("the handle at the third-party control's target", |seen| {
        (position(seen) - TARGET_RAD).abs() < 0.15
    });
    let seen = monitor.seen();
    let sample = seen.sample.unwrap();
    assert_ne!(third_party.incarnation, ours);
    assert_eq!(sample.command_incarnation, third_party.incarnation);
    assert_eq!(sample.gate_state, GateState::Open.code());
    assert_eq!(seen.state(), Some(WatchdogState::Enabled));
    assert_eq!(seen.streams["command"].newest().incarnation, third_party.incarnation);
    drop(seen);
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
