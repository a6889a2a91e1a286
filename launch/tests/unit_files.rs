//! The unit files: what the parser accepts and refuses, and what systemd says about them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use launch::units::{Limit, Restart, SchedulingPolicy, UnitError, UnitSet, parse_service};

const MINIMAL: &str = "[Service]\nType=notify\n\
    ExecStart=/usr/local/bin/farreach service control\nTimeoutStartSec=10s\nTimeoutStopSec=3s\n";

fn parse(text: &str) -> Result<launch::units::Unit, UnitError> {
    parse_service(Path::new("units/farreach-control@.service"), "control", text, "bench")
}

fn all() -> Vec<launch::units::Unit> {
    let set = UnitSet::embedded();
    let mut wanted = set.target("bench").unwrap();
    wanted.push("simulator".to_owned());
    set.load(&wanted, "bench").unwrap()
}

#[test]
fn the_keeper_starts_first_and_the_watchdog_last() {
    let names: Vec<String> = all().into_iter().map(|unit| unit.name).collect();
    assert_eq!(
        names,
        ["keeper", "logger", "simulator", "acquisition", "control", "experiment", "watchdog"]
    );
}

#[test]
fn a_rig_with_a_card_starts_no_simulator() {
    let set = UnitSet::embedded();
    let units = set.load(&set.target("bench").unwrap(), "bench").unwrap();
    assert!(units.iter().all(|unit| unit.name != "simulator"));
    assert_eq!(units.len(), 6);
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
    for name in ["watchdog", "acquisition", "simulator", "control", "experiment"] {
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
