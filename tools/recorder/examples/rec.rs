//! `farreach rec` alone, which compiles in a fraction of the time: `rec verify run.mcap`.

use std::process::ExitCode;

use clap::Parser;

/// The command line.
#[derive(Debug, Parser)]
struct Line {
    #[command(subcommand)]
    command: recorder::Command,
}

fn main() -> ExitCode {
    match recorder::run(&Line::parse().command) {
        Ok(code) => ExitCode::from(code as u8),
        Err(error) => {
            eprintln!("{error:#}");
            ExitCode::FAILURE
        }
    }
}
