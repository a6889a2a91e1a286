//! `farreach restart` and `farreach replace`: one process anew, or a program of others in place of
//! one, and what a recording tells of it.
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
    record(&rig, "before.mcap");
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
    end_record(&rig);
    record(&rig, "meanwhile.mcap");
    rig.ok(["replace", "control", "--undo", "--force"]);
    let shown = told(&rig.run(["status"]));
    assert!(!shown.contains("REPLACED"), "{shown}");
    end_record(&rig);
    record(&rig, "after.mcap");
    end_record(&rig);
    monitor.power_up(&rig);
    drop(monitor);
    rig.down();
    recordings_tell_of_it(&rig);
}

fn record(rig: &TestRig, name: &str) {
    rig.ok(["rec", "start", rig.path(name).to_str().unwrap()]);
}

fn end_record(rig: &TestRig) {
    // Whether a busy host has lost anything is not asked here.
    let ended = rig.run(["rec", "stop"]);
    assert!(matches!(ended.status.code(), Some(0 | 3)), "{}", told(&ended));
}

/// A recording during which control was replaced, one during which it came back, and one after.
fn recordings_tell_of_it(rig: &TestRig) {
    let info = |name: &str| rig.ok(["rec", "info", rig.path(name).to_str().unwrap()]);
    let line = |info: &str| {
        let mut lines = info.lines().filter(|line| line.trim().starts_with("replaced: "));
        let line = lines.next().unwrap_or_else(|| panic!("{info}")).to_owned();
        assert_eq!(lines.next(), None, "{info}");
        line
    };
    let command = format!("env {CHILD}={} ", rig.name());
    let before = line(&info("before.mcap"));
    assert!(before.contains("replaced: control: /") && before.contains(&command), "{before}");
    // Since an instant within it, and to its end.
    assert!(before.ends_with(" s)") && !before.contains(" to "), "{before}");
    let meanwhile = line(&info("meanwhile.mcap"));
    assert!(meanwhile.contains(&command), "{meanwhile}");
    assert!(meanwhile.contains("--nocapture (from the start to "), "{meanwhile}");
    let after = info("after.mcap");
    assert!(!after.contains("replaced: "), "{after}");
    let entry = |name: &str| {
        rig.ok(["rec", "info", rig.path(name).to_str().unwrap(), "--text", "replaced"])
    };
    assert_eq!([entry("before.mcap"), entry("after.mcap")], ["{}\n", "{}\n"]);
    assert!(
        entry("meanwhile.mcap").starts_with("{\"control\":[\"/"),
        "{}",
        entry("meanwhile.mcap")
    );
}
