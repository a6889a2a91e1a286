//! Processes that are stopped (`SIGSTOP`), continued (`SIGCONT`), and continued beside their
//! replacement. Requirements: SR-04, SR-07, SR-09, SR-19, whole-system; hazards H1, H2, H3, H4, H8
//! of the safety case.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeSet;
use std::process::{Child, Command, Stdio};

use common::monitor::{LIMIT, Monitor, Sender, off_bound, tick_of};
use common::{Signal, TestRig, kill, pulse_of, wait_for};
use ipc_types::{TripCause, WatchdogState};
use launch::{ProcessIdentity, UnitState};
use runtime::clock::now_ns;

/// Ticks observed after each event.
const WATCHED: u64 = 300;
/// Attempts; a stalled or slow host spoils an attempt.
const ATTEMPTS: usize = 6;

fn process(rig: &TestRig, unit: &str) -> Option<ProcessIdentity> {
    let status = rig.launcher_status();
    let unit = status.unit(unit).unwrap();
    unit.process.filter(|_| unit.state == UnitState::Ready)
}

fn pulse(monitor: &Monitor, process: &str) -> Sender {
    monitor.seen().streams[pulse_of(process).unwrap()].newest()
}

fn sender_of(monitor: &Monitor, process: &str, incarnation: u64) -> Sender {
    let seen = monitor.seen();
    *seen.streams[pulse_of(process).unwrap()]
        .senders
        .iter()
        .find(|sender| sender.incarnation == incarnation)
        .unwrap()
}

/// Powers the rig until volts flow, then forgets all observations; returns the time.
fn ready(rig: &TestRig, monitor: &Monitor) -> u64 {
    loop {
        if monitor.volts_flow() {
            return monitor.mark();
        }
        monitor.power_up(rig);
    }
}

/// Asserts that after `struck_ns` the motor got no volts beyond the bound, and that the watchdog
/// did not enable it again.
fn assert_off(monitor: &Monitor, frozen: &str, struck_ns: u64, last_word_ns: u64) {
    let timeouts = monitor.timeouts();
    let seen = monitor.seen();
    let from = tick_of(struck_ns.max(last_word_ns));
    let off = seen.last_volts().map_or(0, |last| (last + 1).saturating_sub(from));
    let bound = off_bound(frozen, monitor.profile()).unwrap();
    assert!(off <= bound, "{frozen}: volts for {off} ticks, bound {bound}");
    let line_died = tick_of(seen.toggled.0 + timeouts.enable_line_ns) + 1;
    assert!(
        seen.last_power().is_none_or(|power| power <= line_died),
        "{frozen}: power without a toggling enable line"
    );
    let without = seen.tokens.iter().position(|token| !token.enabled).unwrap_or(seen.tokens.len());
    let again = seen.tokens[without..].iter().find(|token| token.enabled);
    assert!(again.is_none(), "{frozen}: enabled by itself: {again:?}");
    eprintln!("{frozen:12} off after {off} ticks, bound {bound}; {:?}", seen.causes());
}

/// Stops a process for some ticks, less than the launcher's watchdog timeout.
fn freeze_shortly(rig: &TestRig, monitor: &Monitor, unit: &str, ticks: u64) {
    let struck_ns = ready(rig, monitor);
    let before = process(rig, unit).unwrap();
    let known = pulse(monitor, unit);
    let stopped_ns = now_ns();
    kill(before.pid, Signal::STOP);
    monitor.pass_ticks(ticks);
    let last_word_ns = sender_of(monitor, unit, known.incarnation).last_ns;
    assert_off(monitor, unit, struck_ns.max(stopped_ns), last_word_ns);
    if unit != "watchdog" {
        assert_eq!(monitor.seen().state(), Some(WatchdogState::Tripped), "{unit}");
    }
    let silent = sender_of(monitor, unit, known.incarnation);
    kill(before.pid, Signal::CONT);
    monitor.until("the continued process publishes again", |seen| {
        seen.streams[pulse_of(unit).unwrap()].senders.iter().any(|sender| {
            sender.sequence > silent.sequence && { sender.incarnation == known.incarnation }
        })
    });
    monitor.pass_ticks(WATCHED);
    // The continued process is the same as before and does not change the motor's state.
    assert_eq!(process(rig, unit), Some(before), "{unit}");
    assert_eq!(pulse(monitor, unit).incarnation, known.incarnation);
    assert_off(monitor, unit, struck_ns.max(stopped_ns), last_word_ns);
    let state = monitor.seen().state();
    assert_eq!(state, Some(WatchdogState::Tripped), "{unit}: {:?}", monitor.seen().causes());
    if unit == "watchdog" {
        assert!(monitor.seen().causes().contains(&TripCause::WatchdogLate));
    }
    assert!(!rig.run(["enable"]).status.success(), "{unit}: `enable` without `reset` and `arm`");
    monitor.power_up(rig);
}

/// Stops a process until the launcher's watchdog timeout kills and replaces it.
fn freeze_until_replaced(rig: &TestRig, monitor: &Monitor, unit: &str) {
    let struck_ns = ready(rig, monitor);
    let before = process(rig, unit).unwrap();
    let known = pulse(monitor, unit);
    let stopped_ns = now_ns();
    kill(before.pid, Signal::STOP);
    let replaced = wait_for(LIMIT, || process(rig, unit).is_some_and(|now| now != before));
    assert!(replaced, "{unit} was not replaced: {:?}", rig.launcher_status().unit(unit));
    assert!(!before.is_alive(), "the frozen {unit} is alive beside its replacement");
    monitor.until("the replacement publishes", |seen| {
        seen.streams[pulse_of(unit).unwrap()].newest().incarnation != known.incarnation
    });
    monitor.pass_ticks(WATCHED);
    assert_off(
        monitor,
        unit,
        struck_ns.max(stopped_ns),
        sender_of(monitor, unit, known.incarnation).last_ns,
    );
    assert_ne!(monitor.seen().state(), Some(WatchdogState::Enabled));
    monitor.power_up(rig);
}

/// A process of the rig that the launcher does not know of. Ends when dropped.
struct Second(Child);

impl Second {
    /// Starts it with the command line and environment of a unit's process, without the connection
    /// to the launcher.
    fn of(rig: &TestRig, unit: &str, like: ProcessIdentity) -> Self {
        let environment = std::fs::read(format!("/proc/{}/environ", like.pid)).unwrap();
        let variables = environment.split(|byte| *byte == 0).filter_map(|entry| {
            let (name, value) = std::str::from_utf8(entry).ok()?.split_once('=')?;
            (!matches!(name, "NOTIFY_SOCKET" | "WATCHDOG_USEC" | "WATCHDOG_PID"))
                .then_some((name, value))
        });
        let mut command: Command = rig.farreach(["service", unit]);
        command.env_clear().envs(variables).current_dir("/").stdout(Stdio::null());
        Self(command.spawn().unwrap())
    }
}

impl Drop for Second {
    fn drop(&mut self) {
        kill(self.0.id() as i32, Signal::TERM);
        let _ended = self.0.wait();
    }
}

/// Stops a process, lets a second one take its place and power the motor, then continues the first
/// beside it. `false` if the host was too slow for the launcher's watchdog timeout.
fn wakes_beside_its_replacement(rig: &TestRig, monitor: &Monitor, unit: &str) -> bool {
    ready(rig, monitor);
    let first = process(rig, unit).unwrap();
    let old = pulse(monitor, unit);
    kill(first.pid, Signal::STOP);
    let second = Second::of(rig, unit, first);
    monitor.until("the second publishes", |seen| {
        seen.streams[pulse_of(unit).unwrap()].newest().incarnation != old.incarnation
    });
    let new = pulse(monitor, unit);
    monitor.power_up(rig);
    if process(rig, unit) != Some(first) || !monitor.volts_flow() {
        return false;
    }
    // Powered through the second process; now the first continues.
    let struck_ns = monitor.mark();
    let before = sender_of(monitor, unit, old.incarnation);
    kill(first.pid, Signal::CONT);
    let spoke = wait_for(LIMIT, || {
        sender_of(monitor, unit, old.incarnation).sequence > before.sequence
            || process(rig, unit) != Some(first)
    });
    if !spoke || process(rig, unit) != Some(first) {
        return false;
    }
    monitor.pass_ticks(WATCHED);
    assert_off(monitor, unit, struck_ns, 0);
    let causes = monitor.seen().causes();
    let expected: BTreeSet<TripCause> = match unit {
        "acquisition" => [TripCause::AcquisitionChanged, TripCause::GateLatched].into(),
        _ => [TripCause::ControlChanged, TripCause::GateLatched].into(),
    };
    assert!(!causes.is_disjoint(&expected), "{unit}: {causes:?}");
    // While both keep publishing, `reset` is refused.
    assert!(sender_of(monitor, unit, new.incarnation).sequence > new.sequence);
    for _ in 0..3 {
        let refused = rig.run(["reset"]);
        let (one, other) =
            (pulse(monitor, unit), monitor.seen().streams[pulse_of(unit).unwrap()].senders.len());
        assert!(!refused.status.success(), "{unit}: reset although two publish ({one:?}, {other})");
    }
    drop(second);
    assert_eq!(process(rig, unit), Some(first));
    monitor.power_up(rig);
    true
}

#[test]
fn sr_19_a_frozen_and_continued_process_never_powers_the_motor() {
    let rig = TestRig::new("freeze");
    rig.up_homed();
    let mut monitor = Monitor::join(rig.name());
    monitor.load(1);
    eprintln!("profile {}", monitor.profile());
    monitor.power_up(&rig);

    // Longer than any timeout (100 ms without real-time scheduling), shorter than the launcher's
    // watchdog timeout (2 s).
    for unit in ["acquisition", "control", "watchdog"] {
        for ticks in [250, 600, 1500] {
            freeze_shortly(&rig, &monitor, unit, ticks);
        }
    }
    for unit in ["acquisition", "control", "watchdog"] {
        freeze_until_replaced(&rig, &monitor, unit);
    }
    for unit in ["control", "acquisition"] {
        let shown = (0..ATTEMPTS).any(|_| wakes_beside_its_replacement(&rig, &monitor, unit));
        assert!(shown, "{unit}: no attempt was fast enough for the launcher's watchdog timeout");
    }
    drop(monitor);
    rig.down();
}
