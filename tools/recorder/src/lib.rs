//! `farreach rec`: recordings on and off, and what to do with the files.
//!
//! A recording is an MCAP file that Foxglove, PlotJuggler, `mcap-ros2-support` and `rosbags` open
//! as it is.
//!
//! ```text
//! $ farreach rec info run.mcap
//! run.mcap: 225,601 bytes, 5 chunks, written by farreach 0.1.0
//!   rig hydrostatic, profile best-effort, part 1
//!   ended in good order
//!   topic                 count        rate Hz    first s     last s
//!   command                 500          500.0      0.000      0.998
//!   sample                 2000         2000.0      0.000      1.000
//!
//! $ farreach rec verify run.mcap
//! run.mcap: nothing lost: 2,500 messages, 2 topics with data, every checksum right
//!   sample: ticks 1000 to 2999, none missing
//!
//! $ farreach rec verify killed.mcap ; echo $?
//! killed.mcap: DATA LOST
//!   the file ends without a footer: the writer was stopped before it could end it (0 bytes unreadable)
//!   sample: ticks 1000 to 2800, none missing
//! 3
//!
//! $ farreach rec recover killed.mcap -o mended.mcap ; echo $?
//! mended.mcap: 2,252 messages; 0 damaged chunks and 0 bytes at the end left out
//! 3
//!
//! $ farreach rec cat run.mcap --topic command --json | head -n 1
//! {"fields":{"axes":1,"computed_ns":0, ... ,"volts":[0.5,0.0,0.0]},"log_time_ns":1700000000500200000,
//! "publish_time_ns":1700000000500200000,"sequence":0,"topic":"command"}
//!
//! $ farreach rec cut run.mcap --from 0.25 --to 0.75 -o middle.mcap
//! middle.mcap: 1,250 messages
//!
//! $ farreach rec merge run.mcap run.part2.mcap -o whole.mcap
//! $ farreach rec export run.mcap --to csv | head -n 2
//! t_s,master_rad,motor_v,slave_rad
//! 0,0,1,-0.15297538471219713
//! ```
//!
//! stdout carries the result, stderr the diagnosis. Exit code 0: done; 1: failed; 3: done, but data
//! is missing.

mod args;
mod edit;
mod export;
mod look;
mod print;

pub use args::{Command, ExportFormat, LengthUnit};

/// Everything was done.
pub const DONE: i32 = 0;
/// Done, but data is missing.
pub const DATA_LOST: i32 = 3;

/// Does what the command says, printing to stdout; returns the exit code.
///
/// # Errors
/// What keeps the command from being done, file named.
pub fn run(command: &Command) -> anyhow::Result<i32> {
    let mut stdout = std::io::stdout().lock();
    match run_to(command, &mut stdout) {
        // `farreach rec cat run.mcap | head` closes our output: that is how it is meant to end
        Err(error) if closed_pipe(&error) => Ok(DONE),
        result => result,
    }
}

/// The same with another place for the result.
///
/// # Errors
/// As [`run`].
pub fn run_to(command: &Command, output: &mut dyn std::io::Write) -> anyhow::Result<i32> {
    let code = match command {
        Command::Info { file, json } => look::info(file, *json, output),
        Command::Verify { file, json } => look::verify(file, *json, output),
        Command::Cat { file, topic, json } => print::cat(file, topic, *json, output),
        Command::Recover { file, out, json } => edit::recover(file, out, *json, output),
        Command::Cut { file, from, to, out, json } => {
            edit::cut(file, *from, *to, out, *json, output)
        }
        Command::Merge { files, out, json } => edit::merge(files, out, *json, output),
        Command::Export { file, to, topic, unit, axis, out } => {
            export::export(file, *to, topic.as_deref(), *unit, *axis, out.as_deref(), output)
        }
    }?;
    output.flush()?;
    Ok(code)
}

fn closed_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause
            .downcast_ref::<std::io::Error>()
            .is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
            || cause
                .downcast_ref::<serde_json::Error>()
                .is_some_and(|e| e.io_error_kind() == Some(std::io::ErrorKind::BrokenPipe))
    })
}

#[cfg(test)]
mod tests {
    use super::closed_pipe;

    #[test]
    fn a_closed_pipe_is_known_in_any_wrapping() {
        let pipe = || std::io::Error::from(std::io::ErrorKind::BrokenPipe);
        assert!(closed_pipe(&anyhow::Error::from(pipe()).context("while writing")));
        assert!(closed_pipe(&anyhow::Error::from(serde_json::Error::io(pipe()))));
        assert!(!closed_pipe(&anyhow::anyhow!("something else")));
    }
}
