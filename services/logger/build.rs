//! Tells the logger which revision it is built from: every recording carries it.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-env-changed=FARREACH_REVISION");
    for file in ["../../.git/HEAD", "../../.git/logs/HEAD"] {
        if Path::new(file).exists() {
            println!("cargo:rerun-if-changed={file}");
        }
    }
    let described = || {
        let output = Command::new("git")
            .args(["describe", "--always", "--dirty", "--abbrev=12"])
            .output()
            .ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        (output.status.success() && !text.trim().is_empty()).then(|| text.trim().to_owned())
    };
    // A build outside a checkout may be given its revision.
    if let Some(revision) = std::env::var("FARREACH_REVISION").ok().or_else(described) {
        println!("cargo:rustc-env=FARREACH_REVISION={revision}");
    }
}
