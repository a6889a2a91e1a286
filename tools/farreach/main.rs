//! `farreach`: one binary for everything. Each service is a process of its own (`farreach service
//! control`); the rest is what people run.

mod cli;
mod failure;
mod service;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    failure::exit(cli::run(cli))
}
