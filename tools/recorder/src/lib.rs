//! `farreach rec`: what is in recordings, whether they are complete; cutting, joining and exporting
//! them.
//!
//! A recording is an MCAP file that Foxglove, PlotJuggler, `mcap-ros2-support` and `rosbags` open
//! as it is.
//!
//! ```text
//! $ farreach rec info run.mcap
//! run.mcap: 225,601 bytes, 5 chunks, written by farreach 0.1.0
//!   from 2026-11-23T13:15:03Z, 1.000 s
//!   rig hydrostatic, profile best-effort, part 1
//!   run guided-1hz, subject S07
//!   axis 0 handle (rad), analog 0 torque (N·m)
//!   ended cleanly
//!   topic                 count        rate Hz    first s     last s
//!   command                 500          500.0      0.000      0.998
//!   sample                 2000         2000.0      0.000      1.000
//!
//! $ farreach rec verify run.mcap
//! run.mcap: nothing lost: 2,500 messages, 2 topics with data, every checksum right
//!   sample: ticks 1000 to 2999, none missing, none filled in late
//!
//! $ farreach rec verify killed.mcap ; echo $?
//! killed.mcap: DATA LOST
//!   the file ends without a footer: the writer was stopped before it could end it
//!   (0 bytes unreadable)
//!   sample: ticks 1000 to 2800, none missing, none filled in late
//! 3
//!
//! $ farreach rec recover killed.mcap -o recovered.mcap ; echo $?
//! recovered.mcap: 2,252 messages; 0 damaged chunks and 0 bytes at the end left out
//! 3
//!
//! $ farreach rec cat run.mcap --topic command --json | head -n 1
//! {"fields":{"axes":1, ... ,"volts":[0.5,0.0,0.0]},"log_time_ns":1700000000500200000,
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
//! Standard output carries the result, standard error the diagnosis. Exit code 0: done; 1: failed;
//! 3: done, but data is missing. It does not depend on who reads the output.

mod all_parts;
mod args;
mod bdf_file;
mod bids;
mod cat;
mod edit;
mod ended_sessions;
mod export;
mod innovations;
mod innovations_page;
mod inspect;
mod mat;
mod mat_file;
mod monitored;
mod muscles;
mod names;
mod notes;
mod output;
mod parquet_export;
mod parquet_file;
mod progress;
mod recorded_events;
mod replacements;
mod resimulation;
mod runs;
mod samples;
mod sessions;
mod sessions_figure;
mod signals;
mod topic_rows;
mod volumes;

use std::io::Write;

pub use args::{BidsOptions, Command, ExportFormat, ExportOptions, LengthUnit};
pub use bids::FirstRun;
pub use edit::{Copied, Part, copy_interval};
pub use mat::{WantedSession, session_path, write_session};
use output::Output;
use recording::mcap_read::Recording;
pub use replacements::replaced_lines;
pub use runs::{PlayedSegment, played_segments};
pub use samples::{AxisColumns, Samples, rows_of};
use scanner::Series;
pub use sessions::{SessionReport, session_reports};
pub use signals::{Signal, rig_file, signals};

/// Everything was done.
pub const DONE: i32 = 0;
/// Done, but data is missing.
pub const DATA_LOST: i32 = 3;

/// Runs a command, printing to stdout; returns the exit code.
///
/// # Errors
/// What prevents the command, with the file.
pub fn run(command: &Command) -> anyhow::Result<i32> {
    run_to(command, &mut std::io::stdout().lock())
}

/// Runs a command, printing to `output`. A reader that closes it (`| head`) is no error.
///
/// # Errors
/// As [`run`].
pub fn run_to(command: &Command, output: &mut dyn Write) -> anyhow::Result<i32> {
    let mut output = Output::new(output);
    let out = &mut output;
    let code = match command {
        Command::Info { file, text: Some(key), .. } => inspect::text(file, key, out),
        Command::Info { file, json, .. } => inspect::info(file, *json, out),
        Command::Verify { file, json } => inspect::verify(file, *json, out),
        Command::Cat { file, topic, json } => cat::cat(file, topic, *json, out),
        Command::Recover { file, out: to, json } => edit::recover(file, to, *json, out),
        Command::Cut { file, from, to, out: target, json } => {
            edit::cut(file, *from, *to, target, *json, out)
        }
        Command::Merge { files, force, out: to, json } => {
            edit::merge(files, *force, to, *json, out)
        }
        Command::Volumes { file, repetition, pulses, volumes, out: table, figure, json } => {
            let series = |repetition_s| (Series::new(repetition_s, *volumes), *pulses);
            let series = repetition.map(series);
            let files = volumes::Files { table: table.as_deref(), figure: figure.as_deref() };
            volumes::volumes(file, series, &files, *json, out)
        }
        Command::Innovations { file, out: table, page, json } => {
            let files = innovations::Files { table: table.as_deref(), page: page.as_deref() };
            innovations::innovations(file, &files, *json, out)
        }
        Command::Resim { file, control, json } => {
            resimulation::resim(file, control.as_deref(), *json, out)
        }
        Command::Sessions { file, out: table, figure, json } => {
            sessions::sessions(file, table.as_deref(), figure.as_deref(), *json, out)
        }
        Command::Export { file, options } => export::export(file, options, out),
    }?;
    output.flush()?;
    Ok(code)
}

/// Exit code by how the file ends: `DATA_LOST` for a truncated file, `DONE` for a complete one or
/// one still being written.
pub fn exit_code_of_tail(recording: &Recording) -> i32 {
    let tail = &recording.tail;
    if tail.complete || tail.being_written { DONE } else { DATA_LOST }
}
