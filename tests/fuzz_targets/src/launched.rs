//! What launcher, keeper and console read from processes, clients and systemd, and of their own
//! files.

use ipc_types::PROCESSES;
use launch::parsers::{notifications, request, units_shown};
use launch::{
    Config, ProcessIdentity, RigState, Status, StopReport, UnitState, UnitStatus, UnitStop,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{Outcome, chosen};

/// The first byte chooses what is read.
pub(crate) fn read(bytes: &[u8]) -> Outcome {
    let (way, bytes) = chosen(bytes, 8);
    match way {
        0 => kept::<Config>(bytes),
        1 => kept::<Status>(bytes),
        2 => kept::<StopReport>(bytes),
        3 => {
            let again = request(bytes)?;
            assert_eq!(request(again.as_bytes()), Ok(again.clone()));
            Ok(())
        }
        4 => {
            let lines = bytes.iter().filter(|byte| **byte == b'\n').count() + 1;
            assert!(notifications(bytes) <= lines);
            Ok(())
        }
        5 => {
            let session = runtime::check_session(&String::from_utf8_lossy(bytes));
            session.map(drop).map_err(|error| error.to_string())
        }
        6 => {
            let state = |text: &[u8]| web_console::check_state(text).map_err(|e| e.to_string());
            let again = state(bytes)?;
            assert!(state(again.as_bytes())? == again, "it changes when it is kept");
            Ok(())
        }
        _ => {
            let text = String::from_utf8_lossy(bytes);
            assert!(units_shown(&text).len() <= text.lines().count());
            Ok(())
        }
    }
}

fn kept<T: Serialize + DeserializeOwned + PartialEq>(text: &[u8]) -> Outcome {
    let read = |text: &[u8]| serde_json::from_slice::<T>(text).map_err(|error| error.to_string());
    let value = read(text)?;
    let again = serde_json::to_vec_pretty(&value).map_err(|error| error.to_string())?;
    assert!(read(&again)? == value, "it changes when it is written again");
    Ok(())
}

pub(crate) fn seeds() -> Vec<Vec<u8>> {
    let config = Config::new("bench", "/run/farreach/bench", "/usr/bin/farreach")
        .with_processes(PROCESSES)
        .with_environment("FARREACH_RIG", "/etc/farreach/bench/rig.toml");
    let own = ProcessIdentity { pid: 4711, start_time: 99 };
    let status = Status {
        rig_name: "bench".to_owned(),
        supervision: config.supervision,
        state: RigState::Up,
        cause: None,
        launcher: own,
        boot_id: "b".to_owned(),
        since_unix_ms: 1_800_000_000_000,
        updated_unix_ms: 1_800_000_000_100,
        units: vec![UnitStatus {
            name: "control".to_owned(),
            state: UnitState::Ready,
            process: Some(own),
            adopted: false,
            since_unix_ms: 1_800_000_000_000,
            restarts: 1,
            last_exit: Some("signal 9 (SIGKILL)".to_owned()),
            restart_reason: None,
            scheduling: None,
            replaced_by: None,
            status_text: Some("realtime".to_owned()),
            log: "control.log".into(),
        }],
    };
    let report = StopReport {
        rig_name: "bench".to_owned(),
        cause: "stop".to_owned(),
        units: vec![UnitStop { name: "control".to_owned(), exit: None, killed: true, took_ms: 12 }],
        strays: vec![own],
    };
    let json = |way: u8, text: serde_json::Result<Vec<u8>>| {
        [vec![way], text.expect("it can be written")].concat()
    };
    let text = |way: u8, text: &str| [&[way], text.as_bytes()].concat();
    vec![
        json(0, serde_json::to_vec_pretty(&config)),
        json(1, serde_json::to_vec_pretty(&status)),
        json(2, serde_json::to_vec_pretty(&report)),
        text(3, r#"{"request":"status"}"#),
        text(3, r#"{"request":"restart","unit":"control"}"#),
        text(3, r#"{"request":"change","environment":{"A":"b"},"units":["control"]}"#),
        text(3, r#"{"request":"replace","unit":"control","command":["/bin/true","x"]}"#),
        text(3, r#"{"request":"stop"}"#),
        text(4, "READY=1\nSTATUS=best-effort\nWATCHDOG=1\nMAINPID=4\n"),
        text(
            5,
            "session = \"0123456789abcdef\"\nprofile = \"best_effort\"\nfifo = true\n\
             prefix = \"farreach-0-x.\"\n\n[stall]\nlongest_ns = 5\nstalls = 0\n\
             wakes = 9\nprocessors = 2\nstolen_ppm = 0\nfifo = true\n\n[placement]\ncontrol = 1\n",
        ),
        text(
            6,
            r#"{"client":3,"takes_keys":true,"protocol":"[protocol]","subject":"S07",
            "over_before":1,"files":{"name":"/data/S07_","recording":"/data/run.mcap",
            "since_ns":1152921504606846976},"completed":false}"#,
        ),
        text(
            7,
            "Id=farreach-control@bench.service\nActiveState=active\nSubState=running\n\
             StateChangeTimestampMonotonic=2000\nMainPID=1\nNRestarts=2\nExecMainCode=2\n\
             ExecMainStatus=9\nStatusText=realtime\n\nId=x\nActiveState=failed\n",
        ),
    ]
}
