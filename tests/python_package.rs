//! The Python package (tools/python) on a live rig and on its recording: its own tests, which
//! compare it with what the program says.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use common::{TestRig, told};

/// A Python with numpy, pandas and the packages mcap and iceoryx2; without it the test is skipped.
const PYTHON: &str = "FARREACH_PYTHON";
/// Long enough for some seconds of every topic (s).
const RECORDED: Duration = Duration::from_secs(2);

#[test]
fn the_python_package_reads_a_live_rig_and_its_recording() {
    let Ok(python) = std::env::var(PYTHON) else {
        eprintln!("SKIPPED: {PYTHON} names no Python with the packages of tools/python");
        return;
    };
    let rig = TestRig::new("python-package");
    rig.up_homed();
    let recording = rig.path("run.mcap");
    rig.ok(["rec", "start", recording.to_str().unwrap()]);
    std::thread::sleep(RECORDED);
    rig.ok(["rec", "stop"]);

    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/python");
    let tests = Command::new(python)
        .args(["-m", "unittest", "discover", "--verbose", "--start-directory"])
        .arg(package.join("tests"))
        .env("PYTHONPATH", &package)
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("FARREACH_RIG_NAME", rig.name().as_str())
        .env("FARREACH_TEST_PROGRAM", env!("CARGO_BIN_EXE_farreach"))
        .env("FARREACH_TEST_RECORDING", &recording)
        .output()
        .unwrap();
    let said = told(&tests);
    assert!(tests.status.success(), "{said}");
    assert!(!said.contains("skipped"), "{said}");
    assert_eq!(rig.processes(), Vec::<i32>::new(), "the tests take the rig down");
}
