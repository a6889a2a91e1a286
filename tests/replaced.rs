//! `farreach restart` and `farreach replace`: one process anew, or a program of others in place of
//! one.
//! In a test program of its own, since a process joins one rig only.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::monitor::Monitor;
use common::third_party::{CHILD, TARGET_RAD, third_party};
use common::{TestRig, told};
use ipc_types::WatchdogState;

/// The child process: this test binary, started again by the test below.
#[test]
#[ignore = "the third-party control's own process; the other test starts it"]
fn third_party_process() {
    let name = std::env::var(CHILD).expect("the name of a rig");
    third_party(&name).unwrap();
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
