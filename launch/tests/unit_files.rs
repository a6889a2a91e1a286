//! The unit files: generated from the table of processes, in agreement with the launcher's units
//! and with systemd.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use ipc_types::{PROCESSES, Process, ProcessEntry};
use launch::lifecycle::{NO_RESTART, RESTART_DELAY, START_LIMIT, START_LIMIT_INTERVAL};
use launch::units::{PRIORITY_LIMIT, START_PRIORITY, SchedulingPolicy, Unit};

fn directory() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("units")
}

/// The units that the launcher makes of the table.
fn all() -> Vec<Unit> {
    PROCESSES.iter().map(Unit::of).collect()
}

/// `Key=`, with at most three units a line.
fn list(key: &str, entries: &[&ProcessEntry]) -> String {
    let line = |chunk: &[&ProcessEntry]| {
        let names = chunk.iter().map(|entry| format!(" farreach-{}@%i.service", entry.name()));
        format!("{key}={}\n", names.collect::<String>().trim_start())
    };
    entries.chunks(3).map(line).collect()
}

/// The text of a unit file, by the table of processes.
fn service(entry: &ProcessEntry) -> String {
    let name = entry.name();
    let after: Vec<&ProcessEntry> =
        entry.after.iter().map(|process| process.entry().unwrap()).collect();
    let waits = if after.is_empty() {
        String::new()
    } else {
        format!("{WAITS}Wants=farreach-keeper@%i.service\n{}", list("After", &after))
    };
    let class = entry.real_time.map_or("", |_| CLASS);
    // The keeper writes the second file of variables.
    let passed_on = if after.is_empty() { "" } else { PASSED_ON };
    let wanted_on = match (entry.card, entry.optional) {
        (Some(card), _) => Some(format!("wanted on a rig with the {card} card")),
        (None, true) => Some("where it is wanted".to_owned()),
        (None, false) => None,
    };
    let (only, install) = match wanted_on {
        Some(wanted) => (
            format!("# Only {wanted}: systemctl enable farreach-{name}@RIG.\n"),
            "\n[Install]\nWantedBy=farreach@%i.target\n",
        ),
        None => (String::new(), ""),
    };
    format!(
        "# {}\n{only}{GENERATED}\n[Unit]\nDescription=farreach %i: {name}\n{waits}{PART_OF}\n\
         [Service]\nType=notify\nNotifyAccess=main\n\
         # In /usr/local/bin, or else in /usr/bin.\nExecStart=farreach service {name}\n\
         {PLACES}{passed_on}{}{class}LimitMEMLOCK=infinity\n\
         OOMScoreAdjust={}\nTimeoutStartSec=10s\nTimeoutStopSec={}s\nWatchdogSec={}s\n\
         {ENDS}{}{install}",
        entry.process.about().replace(". ", ".\n# "),
        entry.unit,
        entry.oom_score,
        entry.stop_s,
        entry.silence_s,
        rights(entry),
    )
}

/// What a process may do and reach: its own user, two capabilities where it has a loop, the devices
/// of its loop, and nothing else.
fn rights(entry: &ProcessEntry) -> String {
    let schedules = entry.real_time.is_some() || entry.process == Process::Keeper;
    let capabilities = if schedules { "CAP_SYS_NICE CAP_IPC_LOCK" } else { "" };
    let mut devices = String::new();
    if entry.real_time.is_some() {
        devices += "DeviceAllow=/dev/cpu_dma_latency rw\n";
    }
    if entry.process == Process::Acquisition {
        devices += "DeviceAllow=char-comedi rw\n";
    }
    let network = match entry.network {
        true => "RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6\n",
        false => "RestrictAddressFamilies=AF_UNIX\nPrivateNetwork=yes\n",
    };
    format!(
        "{USER}CapabilityBoundingSet={capabilities}\nAmbientCapabilities={capabilities}\n{CLOSED}\
         DevicePolicy=closed\n{devices}{network}"
    )
}

const GENERATED: &str = "\
# Generated from ipc-types/src/process.rs: UPDATE_UNITS=1 cargo test -p launch --test unit_files
# farreach's own launcher does the same by the same table.
";
const WAITS: &str = "\
# Wants= and After=, not Requires= or BindsTo=: a start waits for the keeper, but a keeper that dies
# and restarts must not take this process with it (Requires= propagates automatic restarts, too).
";
const PART_OF: &str = "\
# Stopped and restarted with the target, never because another process died.
PartOf=farreach@%i.target
StartLimitIntervalSec=20s
StartLimitBurst=10
";
const PLACES: &str = "\
Environment=FARREACH_RIG_NAME=%i FARREACH_RIG=/etc/farreach/%i/rig.toml
EnvironmentFile=/etc/farreach/%i/environment
StateDirectory=farreach/%i
StateDirectoryMode=0750
";
const PASSED_ON: &str = "\
# What the keeper passes on: the copy of the rig file that all processes of the session read.
EnvironmentFile=-/run/farreach/%i/environment
";
const USER: &str = "\
# All processes of a rig have the same user, to whom alone its shared memory is open.
User=farreach
Group=farreach
UMask=0027
NoNewPrivileges=yes
";
// No PrivateTmp=: a recording asked for in /tmp is refused, and not written where nobody finds it.
// No RemoveIPC=, RestrictRealtime=, PrivateDevices= (/dev/shm, /dev/cpu_dma_latency, the card).
const CLOSED: &str = "\
# Recordings go to the state directory; ReadWritePaths= in a drop-in names further folders.
ProtectSystem=strict
ProtectHome=yes
ProtectProc=invisible
ProtectClock=yes
ProtectControlGroups=yes
ProtectHostname=yes
ProtectKernelLogs=yes
ProtectKernelModules=yes
ProtectKernelTunables=yes
LockPersonality=yes
MemoryDenyWriteExecute=yes
RestrictNamespaces=yes
RestrictSUIDSGID=yes
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallErrorNumber=EPERM
";
const CLASS: &str = "\
# Priority during start: above everything outside the rig, below every loop. The process raises
# itself (LimitRTPRIO=) when it enters its loop.
CPUSchedulingPolicy=fifo
CPUSchedulingPriority=10
LimitRTPRIO=90
";
const ENDS: &str = "\
KillMode=mixed
KillSignal=SIGTERM
WatchdogSignal=SIGKILL
Restart=on-failure
# The card's FIFO holds 256 ms: with acquisition back within about 150 ms of a crash, nothing is
# lost.
RestartSec=50ms
# 2: wrong command line or rig file; a restart cannot help.
RestartPreventExitStatus=2
";

/// The text of the target, which wants what every rig has.
fn target() -> String {
    let every = |entry: &&ProcessEntry| entry.card.is_none() && !entry.optional;
    let wanted: Vec<_> = PROCESSES.iter().filter(every).collect();
    format!(
        "# All of one rig: systemctl start farreach@RIG.target.\n{GENERATED}\n[Unit]\n\
         Description=farreach %i: all processes of the rig\n\
         # Wants=, not Requires=: the watchdog handles the failure of one process; the others go \
         on.\n\
         # A rig without a card also enables the simulator.\n{}\n\
         [Install]\nWantedBy=multi-user.target\n",
        list("Wants", &wanted)
    )
}

#[test]
fn the_unit_files_are_those_of_the_table_of_processes() {
    let mut expected: BTreeMap<String, String> = PROCESSES
        .iter()
        .map(|entry| (format!("farreach-{}@.service", entry.name()), service(entry)))
        .collect();
    expected.insert("farreach@.target".to_owned(), target());
    let directory = directory();
    if std::env::var_os("UPDATE_UNITS").is_some_and(|value| value == "1") {
        for (name, text) in &expected {
            std::fs::write(directory.join(name), text).unwrap();
        }
        return;
    }
    for (name, text) in &expected {
        let found = std::fs::read_to_string(directory.join(name)).unwrap_or_default();
        assert_eq!(&found, text, "{name}: stale; run the test with UPDATE_UNITS=1");
    }
    let mut found: Vec<_> = std::fs::read_dir(directory)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    found.sort();
    assert_eq!(found, expected.into_keys().collect::<Vec<_>>());
}

/// What systemd is told and what the launcher does are the same.
#[test]
fn the_unit_files_say_what_the_launcher_does() {
    for unit in all() {
        let text =
            std::fs::read_to_string(directory().join(format!("farreach-{}@.service", unit.name)))
                .unwrap();
        let value = |key: &str| {
            let mut lines = text.lines();
            lines.find_map(|line| line.strip_prefix(key)?.strip_prefix('=')).map(str::to_owned)
        };
        let names = |names: &[String]| {
            let files: Vec<_> =
                names.iter().map(|name| format!("farreach-{name}@%i.service")).collect();
            (!files.is_empty()).then(|| files.join(" "))
        };
        let after = text.lines().filter_map(|line| line.strip_prefix("After="));
        let after = after.collect::<Vec<_>>().join(" ");
        assert_eq!(Some(after).filter(|list| !list.is_empty()), names(&unit.after));
        let (class, priority) = match unit.scheduling {
            SchedulingPolicy::Fifo(priority) => (Some("fifo"), Some(priority)),
            _ => (None, None),
        };
        for (key, wanted) in [
            ("Wants", names(&unit.gates)),
            ("CPUSchedulingPolicy", class.map(str::to_owned)),
            ("CPUSchedulingPriority", priority.map(|priority| priority.to_string())),
            ("LimitRTPRIO", unit.limit_rtprio.map(|limit| limit.to_string())),
            ("LimitMEMLOCK", unit.locks_memory.then(|| "infinity".to_owned())),
            ("OOMScoreAdjust", unit.oom_score_adjust.map(|score| score.to_string())),
            ("TimeoutStartSec", Some(format!("{:?}", unit.timeout_start))),
            ("TimeoutStopSec", Some(format!("{:?}", unit.timeout_stop))),
            ("WatchdogSec", Some(format!("{:?}", unit.watchdog))),
            ("RestartSec", Some(format!("{RESTART_DELAY:?}"))),
            ("RestartPreventExitStatus", Some(NO_RESTART.to_string())),
            ("StartLimitBurst", Some(START_LIMIT.to_string())),
            ("StartLimitIntervalSec", Some(format!("{START_LIMIT_INTERVAL:?}"))),
        ] {
            assert_eq!(value(key), wanted, "{}: {key}", unit.name);
        }
    }
}

#[test]
fn some_order_starts_every_unit_after_those_that_it_names() {
    let mut left = all();
    while !left.is_empty() {
        let names: Vec<String> = left.iter().map(|unit| unit.name.clone()).collect();
        left.retain(|unit| unit.after.iter().any(|name| names.contains(name)));
        assert!(left.len() < names.len(), "each after another: {names:?}");
    }
}

#[test]
fn every_other_unit_waits_for_the_keeper() {
    for unit in all().iter().filter(|unit| unit.name != "keeper") {
        assert_eq!(unit.gates, ["keeper"], "{}", unit.name);
    }
}

#[test]
fn the_watchdog_starts_after_all_that_it_supervises() {
    let units = all();
    let watchdog = units.iter().find(|unit| unit.name == "watchdog").unwrap();
    let optional =
        |unit: &&Unit| PROCESSES.iter().any(|entry| entry.name() == unit.name && entry.optional);
    for unit in units.iter().filter(|unit| unit.name != "watchdog" && !optional(unit)) {
        assert!(watchdog.after.contains(&unit.name), "{}", unit.name);
    }
}

/// A process that started at its loop's priority would hold up the loops of lower priority during
/// its start.
#[test]
fn units_start_below_the_priority_of_every_loop_and_may_raise_it() {
    for entry in PROCESSES {
        let Some(real_time) = entry.real_time else { continue };
        assert!(START_PRIORITY < real_time.priority, "{}", entry.name());
        assert!(real_time.priority as u64 <= PRIORITY_LIMIT, "{}", entry.name());
    }
}

/// systemd-analyze exits with 0 even on an unknown key, so the test asserts that it prints nothing.
#[test]
fn systemd_analyze_verify_prints_nothing() {
    if Command::new("systemd-analyze").arg("--version").output().is_err() {
        eprintln!(
            "SKIPPED: systemd-analyze is not on this machine, so the unit files were not verified"
        );
        return;
    }
    let copies = tempfile::tempdir().unwrap();
    let verify = |spoil: bool| {
        let mut files = Vec::new();
        for entry in std::fs::read_dir(directory()).unwrap() {
            let entry = entry.unwrap();
            let text = std::fs::read_to_string(entry.path()).unwrap();
            let mut text = text.replace("ExecStart=farreach", "ExecStart=/bin/true");
            if spoil {
                text = text.replace("WatchdogSec", "WatchdgSec");
            }
            let path = copies.path().join(entry.file_name());
            std::fs::write(&path, text).unwrap();
            files.push(path);
        }
        let output = Command::new("systemd-analyze")
            .arg("verify")
            .arg("--man=no")
            .args(files)
            .output()
            .unwrap();
        format!(
            "{}{}",
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        )
    };
    let spoilt = verify(true);
    assert!(
        spoilt.contains("Unknown key"),
        "this systemd-analyze does not report an unknown key: {spoilt}"
    );
    assert_eq!(verify(false), "");
}
