//! Writes the recording of a small experiment with a scan, for `.ci/readers`.
//!
//! `cargo run -p recorder --example experiment_recording -- RECORDING.mcap`

#[path = "../tests/common/experiment.rs"]
mod experiment;

fn main() -> Result<(), &'static str> {
    let path = std::env::args_os().nth(1).ok_or("expected the name of the recording to write")?;
    experiment::write(path.as_ref(), "S07", true);
    Ok(())
}
