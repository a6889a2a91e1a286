//! The unit files: what the parser accepts and refuses, and what systemd says about them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use ipc_types::{CardKind, PROCESSES, ProcessEntry, processes_with};
use launch::units::{Limit, Restart, SchedulingPolicy, UnitError, UnitSet, parse_service};

const MINIMAL: &str = "[Service]\nType=notify\n\
    ExecStart=/usr/local/bin/farreach service control\nTimeoutStartSec=10s\nTimeoutStopSec=3s\n";

fn parse(text: &str) -> Result<launch::units::Unit, UnitError> {
    parse_service(Path::new("units/farreach-control@.service"), "control", text, "bench")
}

fn all() -> Vec<launch::units::Unit> {
    let wanted: Vec<String> = PROCESSES.iter().map(|entry| entry.name().to_owned()).collect();
    UnitSet::embedded().load(&wanted, "bench").unwrap()
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
    let (only, install) = match entry.card {
        Some(card) => (
            format!(
                "# Only wanted on a rig with the {card} card: systemctl enable \
                 farreach-{name}@RIG.\n"
            ),
            "\n[Install]\nWantedBy=farreach@%i.target\n",
        ),
        None => (String::new(), ""),
    };
    format!(
        "# {}\n{only}{GENERATED}\n[Unit]\nDescription=farreach %i: {name}\n{waits}{PART_OF}\n\
         [Service]\nType=notify\nNotifyAccess=main\n\
         ExecStart=/usr/local/bin/farreach service {name}\n{PLACES}{}{class}LimitMEMLOCK=infinity\n\
         OOMScoreAdjust={}\nTimeoutStartSec=10s\nTimeoutStopSec={}s\nWatchdogSec={}s\n\
         {ENDS}{install}",
        entry.process.about().replace(". ", ".\n# "),
        entry.unit,
        entry.oom_score,
        entry.stop_s,
        entry.silence_s,
    )
}

const GENERATED: &str = "\
# Generated from ipc-types/src/process.rs: UPDATE_UNITS=1 cargo test -p launch --test unit_files
# Read by systemd and by farreach's own launcher; launch/README.md lists the keys that it honours.
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
Environment=FARREACH_RIG_NAME=%i FARREACH_RUN_DIR=/run/farreach/%i
EnvironmentFile=/etc/farreach/%i/environment
RuntimeDirectory=farreach/%i
RuntimeDirectoryMode=0700
RuntimeDirectoryPreserve=yes
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
    let wanted: Vec<_> = PROCESSES.iter().filter(|entry| entry.card.is_none()).collect();
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
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("units");
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
    let embedded: Vec<_> = UnitSet::embedded().files().map(|(name, _)| name.to_owned()).collect();
    assert_eq!(embedded, expected.into_keys().collect::<Vec<_>>());
}

#[test]
fn the_keeper_starts_first_and_the_watchdog_last() {
    let names: Vec<String> = all().into_iter().map(|unit| unit.name).collect();
    assert_eq!((names[0].as_str(), names.last().unwrap().as_str()), ("keeper", "watchdog"));
    assert_eq!(names.len(), PROCESSES.len());
}

#[test]
fn a_rig_with_a_card_starts_no_simulator() {
    let set = UnitSet::embedded();
    let units = set.load(&set.target("bench").unwrap(), "bench").unwrap();
    let mut names: Vec<_> = units.iter().map(|unit| unit.name.as_str()).collect();
    let mut expected: Vec<_> = processes_with(CardKind::Replay).map(|entry| entry.name()).collect();
    names.sort_unstable();
    expected.sort_unstable();
    assert_eq!(names, expected);
    assert!(!names.contains(&"simulator"));
}

#[test]
fn every_other_unit_waits_for_the_keeper() {
    for unit in all().iter().filter(|unit| unit.name != "keeper") {
        assert_eq!(unit.gates().collect::<Vec<_>>(), ["keeper"], "{}", unit.name);
    }
}

#[test]
fn the_watchdog_starts_after_all_that_it_supervises() {
    let units = all();
    let watchdog = units.iter().find(|unit| unit.name == "watchdog").unwrap();
    for unit in units.iter().filter(|unit| unit.name != "watchdog") {
        assert!(watchdog.after.contains(&unit.name), "{}", unit.name);
    }
}

/// A process that started at its loop's priority would hold up the loops of lower priority during
/// its start.
#[test]
fn units_start_below_the_priority_of_every_loop_and_may_raise_it() {
    let units = all();
    for entry in PROCESSES.iter().filter(|entry| entry.real_time.is_some()) {
        let name = entry.name();
        let unit = units.iter().find(|unit| unit.name == name).unwrap();
        assert_eq!(unit.scheduling, SchedulingPolicy::Fifo(10), "{name}");
        assert_eq!(unit.limit_rtprio, Some(Limit::Value(90)), "{name}");
        // Without isolated cores, a loop bound to one core can wait for it while another is idle.
        assert!(unit.cpu_affinity.is_empty(), "{name}");
    }
}

#[test]
fn every_unit_is_restarted_within_the_span_of_the_cards_fifo() {
    for unit in all() {
        assert_eq!(unit.restart, Restart::OnFailure, "{}", unit.name);
        assert!(unit.restart_delay <= Duration::from_millis(50), "{}", unit.name);
        assert!(unit.watchdog.is_some(), "{}", unit.name);
        assert_eq!(unit.exec_start[1..], ["service".to_owned(), unit.name.clone()]);
    }
}

#[test]
fn an_unknown_key_names_file_line_key_and_what_is_supported() {
    let error = parse(&format!("{MINIMAL}WatchdgSec=2s\n")).unwrap_err();
    let UnitError::Key { line: 6, ref section, ref key, ref supported, .. } = error else {
        panic!("{error:?}")
    };
    assert_eq!((section.as_str(), key.as_str()), ("Service", "WatchdgSec"));
    assert!(supported.contains("WatchdogSec"));
    let text = error.to_string();
    assert!(text.starts_with(
        "units/farreach-control@.service:6: key `WatchdgSec` in [Service] is not supported"
    ));
}

#[test]
fn unsupported_values_are_refused() {
    let value = |line: &str| {
        let error = parse(&format!("{MINIMAL}{line}\n")).unwrap_err();
        assert!(matches!(error, UnitError::Value { line: 6, .. }), "{line}: {error:?}");
        assert!(error.to_string().contains("expected "), "{error}");
    };
    for line in [
        "KillMode=process",
        "NotifyAccess=all",
        "WatchdogSignal=SIGABRT",
        "Restart=on-abort",
        "RestartSec=1h",
        "CPUSchedulingPriority=0",
        "CPUAffinity=numa",
        "LimitMEMLOCK=8M",
        "OOMScoreAdjust=-1001",
        "Environment=\"A=b c\"",
        "Environment=A=%n",
        "EnvironmentFile=",
        "RuntimeDirectory=../etc",
    ] {
        value(line);
    }
    assert!(matches!(parse("[Servce]\n"), Err(UnitError::Section { line: 1, .. })));
    assert!(matches!(
        parse("[Unit]\nRequires=farreach-keeper@%i.service\n"),
        Err(UnitError::Key { .. })
    ));
    assert!(matches!(
        parse(&format!("[Unit]\nAfter=network.target\n{MINIMAL}")),
        Err(UnitError::Value { .. })
    ));
    assert!(matches!(parse("Type=notify\n"), Err(UnitError::Syntax { line: 1, .. })));
    assert!(matches!(parse("[Unit]\nnonsense\n"), Err(UnitError::Syntax { line: 2, .. })));
    assert!(matches!(
        parse("[Service]\nExecStart=/a \\\n b\n"),
        Err(UnitError::Syntax { line: 2, .. })
    ));
    assert!(matches!(
        parse(&format!("{MINIMAL}WatchdogSec=1s\nWatchdogSec=2s\n")),
        Err(UnitError::Repeated { line: 7, first: 6, .. })
    ));
    assert!(matches!(
        parse(&MINIMAL.replace("Type=notify\n", "")),
        Err(UnitError::Missing { section: "Service", key: "Type", .. })
    ));
    assert!(matches!(
        parse(&format!("{MINIMAL}CPUSchedulingPolicy=fifo\n")),
        Err(UnitError::Missing { key: "CPUSchedulingPriority", .. })
    ));
    assert!(matches!(
        parse(&MINIMAL.replace("/usr/local/bin/", "")),
        Err(UnitError::Value { line: 3, .. })
    ));
}

#[test]
fn install_and_specifiers_are_accepted() {
    let text = format!(
        "{MINIMAL}Environment=RIG=%i SHARE=90%%\n\n[Install]\nWantedBy=farreach@%i.target\n"
    );
    let unit = parse(&text).unwrap();
    assert_eq!(
        unit.environment,
        [("RIG".to_owned(), "bench".to_owned()), ("SHARE".to_owned(), "90%".to_owned())]
    );
}

#[test]
fn a_dependency_cycle_and_an_unknown_unit_are_errors() {
    let directory = tempfile::tempdir().unwrap();
    for (name, after) in [("a", "b"), ("b", "a")] {
        let text = format!("[Unit]\nAfter=farreach-{after}@%i.service\n{MINIMAL}");
        std::fs::write(directory.path().join(format!("farreach-{name}@.service")), text).unwrap();
    }
    let set = UnitSet::from_directory(directory.path()).unwrap();
    assert_eq!(
        set.load(&["a".to_owned()], "bench").map(|units| units.len()),
        Ok(1),
        "only the requested units count"
    );
    let ring = set.load(&["a".to_owned(), "b".to_owned()], "bench").unwrap_err();
    assert_eq!(ring, UnitError::Ring("a, b".to_owned()));
    let unknown = set.load(&["c".to_owned()], "bench").unwrap_err();
    assert!(unknown.to_string().contains("there are: a, b"), "{unknown}");
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
    let directory = tempfile::tempdir().unwrap();
    let verify = |spoil: bool| {
        let mut files = Vec::new();
        for (name, text) in UnitSet::embedded().files() {
            let mut text = text.replace("/usr/local/bin/farreach", "/bin/true");
            if spoil {
                text = text.replace("WatchdogSec", "WatchdgSec");
            }
            let path = directory.path().join(name);
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
