//! Writes a recording of so many seconds as a rig's logger would, to measure with:
//! `long_recording FILE SECONDS`. An hour has about 4 GB.

#[path = "../tests/common/long.rs"]
mod long;

use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [file, seconds] = words.as_slice() else {
        eprintln!("usage: long_recording FILE SECONDS");
        return ExitCode::from(2);
    };
    let Ok(seconds) = seconds.parse() else {
        eprintln!("SECONDS: expected a whole number, found {seconds}");
        return ExitCode::from(2);
    };
    let path = Path::new(file);
    if path.exists() {
        eprintln!("{file}: it is there already; files are never overwritten");
        return ExitCode::FAILURE;
    }
    long::write(path, seconds);
    ExitCode::SUCCESS
}
