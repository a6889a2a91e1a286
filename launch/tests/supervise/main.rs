//! The launcher with real processes and real signals.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod rig;

use std::process::Command;
use std::time::Duration;

use ipc_types::PROCESSES;
use launch::units::SchedulingPolicy;
use launch::{Error, ProcessIdentity, RigState, RunDir, StartError, UnitState};
use rig::{Rig, until};
use rustix::process::Signal;

/// Not a test: the entry point of the processes that the tests start.
#[test]
#[ignore = "entry point of the processes that the tests start"]
fn child_process() {
    if let Ok(arguments) = std::env::var("LAUNCH_TEST_ARGUMENTS") {
        rig::child(&arguments);
    }
}

#[test]
fn started_in_order_and_stopped_in_reverse() {
    let rig = Rig::new();
    let running = rig.start().unwrap();
    assert_eq!(
        rig.events(&["start", "ready"]),
        ["a start", "a ready", "b start", "b ready", "c start", "c ready"]
    );
    let status = rig.status();
    assert_eq!(status.state, RigState::Up);
    assert_eq!(status.launcher, running.launcher);
    for unit in &status.units {
        assert_eq!(unit.state, UnitState::Ready);
        assert_eq!(unit.status_text, Some(format!("{} at work", unit.name)));
        assert_eq!((unit.restarts, unit.adopted), (0, false));
    }

    let report = rig.stop().unwrap();
    assert_eq!(rig.events(&["stop"]), ["c stop", "b stop", "a stop"]);
    let stops: Vec<_> = report
        .units
        .iter()
        .map(|unit| (unit.name.as_str(), unit.exit.as_deref(), unit.killed))
        .collect();
    let clean = Some("exit code 0");
    assert_eq!(stops, [("c", clean, false), ("b", clean, false), ("a", clean, false)]);
    assert!(!running.launcher.is_alive());
    assert_eq!(rig.left_behind(), [""; 0]);
    assert!(matches!(rig.stop(), Err(Error::NotUp { .. })));
    assert!(matches!(launch::status(rig.run_dir()), Err(Error::NotUp { .. })));
}

#[test]
fn the_rigs_processes_start_with_the_keeper_and_stop_with_it() {
    let mut rig = Rig::new();
    rig.config.units.clear();
    rig.config = rig.config.clone().with_processes(PROCESSES);
    let running = rig.start().unwrap();
    let order: Vec<&str> = running.status.units.iter().map(|unit| unit.name.as_str()).collect();
    assert_eq!((order[0], *order.last().unwrap()), ("keeper", "watchdog"));
    assert_eq!(order.len(), PROCESSES.len());
    // Those that need the same processes are started together, and either may be ready first.
    let mut wanted: Vec<_> = order.iter().map(|name| format!("{name} ready")).collect();
    let mut ready = rig.events(&["ready"]);
    assert_eq!((&ready[0], ready.last()), (&wanted[0], wanted.last()));
    wanted.sort_unstable();
    ready.sort_unstable();
    assert_eq!(ready, wanted);
    let status = rig.status();
    for unit in &status.units {
        let scheduling = unit.scheduling.as_ref().unwrap();
        let has_asked = scheduling.granted == Some(scheduling.asked);
        let says_refused =
            scheduling.refused.iter().any(|text| text.starts_with("CPUSchedulingPolicy="));
        assert_ne!(has_asked, says_refused, "{}: {scheduling:?}", unit.name);
    }
    let report = rig.stop().unwrap();
    let stopped: Vec<&str> = report.units.iter().map(|unit| unit.name.as_str()).collect();
    assert_eq!(stopped.len(), order.len());
    // Nothing waits for an optional process: it stops beside the watchdog, whenever it is done.
    let optional = PROCESSES.iter().filter(|entry| entry.optional).map(|entry| entry.name());
    let optional: Vec<&str> = optional.collect();
    let without = |names: &[&str]| {
        let needed = names.iter().filter(|name| !optional.contains(name));
        needed.map(|name| (*name).to_owned()).collect::<Vec<_>>()
    };
    let reverse: Vec<&str> = order.iter().rev().copied().collect();
    assert_eq!(without(&stopped), without(&reverse));
}

#[test]
fn environment_of_the_processes() {
    let mut rig = Rig::new();
    rig.config.environment.insert("OWN".to_owned(), "configuration".to_owned());
    rig.start().unwrap();
    let environment = std::fs::read(format!("/proc/{}/environ", rig.process("c").pid)).unwrap();
    let has = |name: &str, value: &str| {
        let wanted = format!("{name}={value}");
        assert!(
            environment.split(|byte| *byte == 0).any(|variable| variable == wanted.as_bytes()),
            "{wanted}"
        );
    };
    let run_dir = rig.run_dir().to_str().unwrap();
    has("FARREACH_RIG_NAME", "test");
    has("FARREACH_RUN_DIR", run_dir);
    has("RUNTIME_DIRECTORY", run_dir);
    has("OWN", "configuration");
    has("WATCHDOG_USEC", "30000000");
    has("NOTIFY_SOCKET", &format!("{run_dir}/notify.sock"));
    rig.stop().unwrap();
}

#[test]
fn a_rig_that_is_up_is_not_started_again() {
    let rig = Rig::new();
    let running = rig.start().unwrap();
    let before = rig.status();
    let error = rig.start().unwrap_err();
    let Error::AlreadyUp { rig: name, launcher, since } = &error else { panic!("{error}") };
    assert_eq!((name.as_str(), launcher), ("test", &format!("pid {}", running.launcher.pid)));
    assert!(since.starts_with("since 20"), "{since}");
    assert_eq!(rig.status().launcher, before.launcher);
    assert_eq!(rig.events(&["start"]).len(), 3);
    rig.stop().unwrap();
}

#[test]
fn a_killed_process_is_restarted_and_the_others_keep_running() {
    let rig = Rig::new();
    rig.start().unwrap();
    for name in ["a", "c"] {
        let others: Vec<_> = ["a", "b", "c"].into_iter().filter(|other| *other != name).collect();
        let before: Vec<_> = others.iter().map(|other| rig.process(other)).collect();
        let victim = rig.process(name);
        assert!(victim.signal(Signal::KILL));
        rig.until_replaced(name, victim);
        let after: Vec<_> = others.iter().map(|other| rig.process(other)).collect();
        assert_eq!(before, after);
        let status = rig.status();
        let unit = status.unit(name).unwrap();
        assert_eq!(unit.restarts, 1);
        assert_eq!(unit.last_exit.as_deref(), Some("signal 9 (SIGKILL)"));
        assert_eq!(unit.restart_reason.as_deref(), Some("it ended: signal 9 (SIGKILL)"));
    }
    rig.stop().unwrap();
}

#[test]
fn a_start_that_hangs_is_killed_and_repeated() {
    let mut rig = Rig::new();
    rig.behave("b", "hang-once");
    rig.unit("b").timeout_start = Duration::from_secs(1);
    rig.start().unwrap();
    let starts =
        rig.journal().into_iter().filter(|(name, event, _)| name == "b" && event == "start");
    let processes: Vec<ProcessIdentity> = starts.map(|(_, _, process)| process).collect();
    assert!(processes.len() >= 2, "{processes:?}");
    assert!(!processes[0].is_alive());
    assert_eq!(
        rig.status().unit("b").unwrap().restart_reason.as_deref(),
        Some("it was not ready within 1s")
    );
    rig.stop().unwrap();
}

#[test]
fn a_unit_that_fails_to_start_stops_all_others_with_a_reason() {
    let mut rig = Rig::new();
    rig.behave("b", "fail");
    let error = rig.start().unwrap_err();
    let Error::Start(StartError::Unit(failure)) = error else { panic!("{error}") };
    assert_eq!((failure.unit.as_str(), failure.attempts), ("b", 3));
    assert!(failure.reason.contains("exit code 1"), "{}", failure.reason);
    assert!(failure.log_tail.contains("the rig file has no [axis]"), "{}", failure.log_tail);
    assert_eq!(rig.events(&["start"]), ["a start", "b start", "b start", "b start"]);
    assert_eq!(rig.events(&["stop"]), ["a stop"]);
    assert_eq!(rig.living(), []);
    assert_eq!(rig.left_behind(), [""; 0]);
}

#[test]
fn exit_code_2_prevents_a_restart() {
    let mut rig = Rig::new();
    rig.behave("b", "usage");
    assert!(
        matches!(rig.start(), Err(Error::Start(StartError::Unit(failure))) if failure.attempts == 1)
    );
    assert_eq!(rig.events(&["start"]), ["a start", "b start"]);
}

#[test]
fn a_missing_executable_is_an_error() {
    let mut rig = Rig::new();
    rig.config.executable = "/nonexistent/farreach".into();
    let error = rig.start().unwrap_err().to_string();
    assert!(error.contains("cannot start /nonexistent/farreach"), "{error}");
}

#[test]
fn a_silent_watchdog_is_killed_and_restarted() {
    let mut rig = Rig::new();
    rig.behave("c", "mute-once");
    rig.unit("c").watchdog = Duration::from_millis(500);
    rig.start().unwrap();
    let first = rig.journal().into_iter().find(|(name, _, _)| name == "c").unwrap().2;
    rig.until_replaced("c", first);
    assert!(!first.is_alive());
    let status = rig.status();
    let unit = status.unit("c").unwrap();
    assert_eq!(unit.restart_reason.as_deref(), Some("its watchdog was silent for 500ms"));
    assert_eq!(unit.last_exit.as_deref(), Some("signal 9 (SIGKILL)"));
    rig.stop().unwrap();
}

#[test]
fn a_process_that_ignores_sigterm_is_killed_after_its_stop_timeout() {
    let mut rig = Rig::new();
    rig.behave("c", "ignore-sigterm");
    rig.unit("c").timeout_stop = Duration::from_millis(200);
    rig.start().unwrap();
    let report = rig.stop().unwrap();
    assert_eq!((report.units[0].name.as_str(), report.units[0].killed), ("c", true));
    assert!(!report.units[1].killed);
    assert_eq!(rig.events(&["stop"]), ["b stop", "a stop"]);
}

#[test]
fn a_frozen_process_is_continued_to_stop() {
    let rig = Rig::new();
    rig.start().unwrap();
    assert!(rig.process("c").signal(Signal::STOP));
    let report = rig.stop().unwrap();
    assert_eq!(report.units[0].exit.as_deref(), Some("exit code 0"));
}

#[test]
fn a_signal_to_the_launcher_stops_all_in_order() {
    let rig = Rig::new();
    let running = rig.start().unwrap();
    assert!(running.launcher.signal(Signal::TERM));
    until("the launcher is gone", || !running.launcher.is_alive());
    assert_eq!(rig.events(&["stop"]), ["c stop", "b stop", "a stop"]);
    assert_eq!(rig.left_behind(), [""; 0]);
}

#[test]
fn running_processes_are_adopted_by_the_next_launcher() {
    let rig = Rig::new();
    let first = rig.start().unwrap();
    let before = ["a", "b", "c"].map(|name| rig.process(name));
    rig.kill_launcher();
    let status = rig.status();
    assert_eq!(status.state, RigState::Abandoned);
    assert!(status.units.iter().all(|unit| unit.state == UnitState::Unsupervised));
    assert!(!RunDir::new(rig.run_dir()).is_held().unwrap());

    let second = rig.start().unwrap();
    assert_ne!(first.launcher, second.launcher);
    assert_eq!(before, ["a", "b", "c"].map(|name| rig.process(name)));
    assert!(rig.status().units.iter().all(|unit| unit.adopted && unit.state == UnitState::Ready));
    assert_eq!(rig.events(&["start"]).len(), 3);

    // It detects their death although they are not its children.
    assert!(before[2].signal(Signal::KILL));
    rig.until_replaced("c", before[2]);
    let status = rig.status();
    assert_eq!(status.unit("c").unwrap().restarts, 1);
    assert!(!status.unit("c").unwrap().adopted);
    rig.stop().unwrap();
    assert_eq!(rig.living(), []);
}

#[test]
fn an_adopted_process_reaches_the_new_launchers_watchdog() {
    let mut rig = Rig::new();
    rig.unit("c").watchdog = Duration::from_secs(1);
    rig.start().unwrap();
    let before = rig.process("c");
    rig.kill_launcher();
    rig.start().unwrap();
    // Longer than WatchdogSec: a process whose pings did not reach the new socket would be killed.
    std::thread::sleep(std::time::Duration::from_millis(1500));
    let pinging = rig.status().unit("c").unwrap().clone();
    if pinging.restart_reason.is_none() {
        assert_eq!(pinging.process, Some(before));
    } else {
        eprintln!(
            "SKIPPED: this machine is too busy to ping within 1 s: {:?}",
            pinging.restart_reason
        );
    }
    assert!(before.signal(Signal::STOP));
    rig.until_replaced("c", before);
    rig.stop().unwrap();
}

#[test]
fn down_ends_the_processes_of_a_dead_launcher() {
    let rig = Rig::new();
    rig.start().unwrap();
    rig.kill_launcher();
    assert_eq!(rig.living().len(), 3);
    let report = rig.stop().unwrap();
    assert_eq!(
        report.units.iter().map(|unit| unit.name.as_str()).collect::<Vec<_>>(),
        ["c", "b", "a"]
    );
    assert_eq!(rig.events(&["stop"]), ["c stop", "b stop", "a stop"]);
    assert_eq!(rig.living(), []);
    assert_eq!(rig.left_behind(), [""; 0]);
}

#[test]
fn down_ends_the_processes_of_a_launcher_that_hangs() {
    let rig = Rig::new();
    let running = rig.start().unwrap();
    assert!(running.launcher.signal(Signal::STOP));
    // The launcher may be frozen before it reads the request, or while it handles it.
    rig.stop().unwrap();
    assert_eq!(rig.events(&["stop"]), ["c stop", "b stop", "a stop"]);
    assert!(!running.launcher.is_alive());
    assert_eq!(rig.living(), []);
}

#[test]
fn a_recycled_pid_is_not_adopted() {
    let rig = Rig::new();
    rig.start().unwrap();
    rig.kill_launcher();
    let victim = rig.process("c");
    assert!(victim.signal(Signal::KILL));
    until("c is dead", || !victim.is_alive());
    // Another process now has the pid that the status names, with a different start time. Start
    // times have a resolution of 10 ms, and the victim may be younger than that.
    std::thread::sleep(std::time::Duration::from_millis(50));
    let mut bystander = Command::new("sleep").arg("600").spawn().unwrap();
    let path = RunDir::new(rig.run_dir()).status_json();
    let mut status: launch::Status =
        serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let unit = status.units.iter_mut().find(|unit| unit.name == "c").unwrap();
    unit.process =
        Some(ProcessIdentity { pid: bystander.id() as i32, start_time: victim.start_time });
    std::fs::write(&path, serde_json::to_vec(&status).unwrap()).unwrap();

    let started = rig.start();
    let outcome = started.map(|_| (rig.process("c"), rig.status().unit("c").unwrap().adopted));
    let stopped = rig.stop();
    let alive = bystander.try_wait().unwrap().is_none();
    bystander.kill().unwrap();
    bystander.wait().unwrap();
    let (process, adopted) = outcome.unwrap();
    stopped.unwrap();
    assert_ne!(process.pid, bystander.id() as i32);
    assert!(!adopted);
    assert!(alive, "the unrelated process was killed");
}

#[test]
fn a_process_missing_from_the_status_is_found_by_its_environment() {
    let rig = Rig::new();
    rig.start().unwrap();
    rig.kill_launcher();
    let stray = rig.process("c");
    let path = RunDir::new(rig.run_dir()).status_json();
    let mut status: launch::Status =
        serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    status.units.retain(|unit| unit.name != "c");
    std::fs::write(&path, serde_json::to_vec(&status).unwrap()).unwrap();
    let report = rig.stop().unwrap();
    assert_eq!(report.strays, [stray]);
    until("the stray is dead", || !stray.is_alive());
}

#[test]
fn running_processes_are_not_adopted_under_other_settings() {
    let mut rig = Rig::new();
    rig.start().unwrap();
    rig.kill_launcher();
    rig.config.environment.insert("FARREACH_RIG".to_owned(), "/other/rig.toml".to_owned());
    let error = rig.start().unwrap_err();
    assert!(
        matches!(&error, Error::OtherSettings { leftovers, .. } if leftovers.len() == 3),
        "{error}"
    );
    rig.stop().unwrap();
    rig.start().unwrap();
    rig.stop().unwrap();
}

#[test]
fn a_restart_on_request() {
    let rig = Rig::new();
    rig.start().unwrap();
    let before = rig.process("b");
    launch::restart(rig.run_dir(), "b").unwrap();
    rig.until_replaced("b", before);
    assert_eq!(rig.events(&["stop"]), ["b stop"]);
    let error = launch::restart(rig.run_dir(), "d").unwrap_err();
    assert!(error.to_string().contains("no unit `d`; there are: a, b, c"), "{error}");
    rig.stop().unwrap();
}

#[test]
fn the_status_shows_the_scheduling_class_granted() {
    let mut rig = Rig::new();
    let may = Command::new("chrt")
        .args(["-f", "10", "true"])
        .output()
        .is_ok_and(|output| output.status.success());
    rig.unit("c").scheduling = SchedulingPolicy::Fifo(10);
    rig.unit("c").locks_memory = true;
    rig.start().unwrap();
    let scheduling = rig.status().unit("c").unwrap().scheduling.clone().unwrap();
    assert_eq!(scheduling.asked, SchedulingPolicy::Fifo(10));
    let refused = scheduling
        .refused
        .iter()
        .any(|text| text.starts_with("CPUSchedulingPolicy=fifo 10: it has other"));
    if may {
        assert_eq!((scheduling.granted, refused), (Some(SchedulingPolicy::Fifo(10)), false));
    } else {
        assert_eq!((scheduling.granted, refused), (Some(SchedulingPolicy::Other), true));
    }
    assert_eq!(rig.status().unit("b").unwrap().scheduling.as_ref().unwrap().refused, [""; 0]);
    rig.stop().unwrap();
}

#[test]
fn invalid_configuration_fails_before_any_process_starts() {
    let mut rig = Rig::new();
    rig.config.rig_name = "../etc".to_owned();
    assert!(matches!(rig.start(), Err(Error::RigName { .. })));
    rig.config.rig_name = "test".to_owned();
    rig.config.run_dir = rig.config.run_dir.join("x".repeat(100));
    assert!(matches!(rig.start(), Err(Error::PathTooLong { .. })));
    assert_eq!(rig.journal(), []);
}
