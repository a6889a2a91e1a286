//! Golden tests of the command line: exact output for people and scripts. The help of each command
//! is in `docs/cli.md`.
//!
//! `TRYCMD=overwrite cargo test --test cli` rewrites them; read the difference before it is
//! committed.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Stdio};

fn rig_name(tag: &str) -> String {
    format!("cli-{tag}-{}", std::process::id())
}

#[test]
fn cli() {
    let rig_name = rig_name("golden");
    trycmd::TestCases::new()
        .register_bin("farreach", std::path::Path::new(env!("CARGO_BIN_EXE_farreach")))
        .env("FARREACH_RIG_NAME", &rig_name)
        .insert_var("[RIG]", rig_name.clone())
        .unwrap()
        .case("tests/cli/*.trycmd")
        .run();
}

/// `farreach ... | head`: the reader closes the pipe before everything is written.
#[test]
fn a_closed_pipe_is_no_panic() {
    for arguments in [["status", "--json"].as_slice(), &["down"], &["--help"], &["rec", "--help"]] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_farreach"))
            .args(arguments)
            .env("FARREACH_RIG_NAME", rig_name("pipe"))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(!errors.contains("panicked"), "{arguments:?}: {errors}");
        assert!(output.status.signal().is_none(), "{arguments:?}: {}", output.status);
    }
}
