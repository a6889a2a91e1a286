//! `farreach`: one binary. Each service runs as a process of its own (`farreach service control`);
//! the other commands are for people.

mod cli;
#[cfg(test)]
mod cli_tests;
mod failure;
mod reference;
mod service;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    failure::exit(cli::run(cli))
}
