//! The command line.

use clap::{Parser, Subcommand};
use runtime::RigName;

use crate::service::{self, Service};

/// Runs an MRI-compatible master-slave haptic interface in real time.
///
/// Results go to standard output, diagnosis to standard error.
#[derive(Debug, Parser)]
#[command(
    name = "farreach",
    version,
    arg_required_else_help = true,
    after_help = "Example, a whole session with the simulated rig:\n  farreach up --simulate --record run.mcap\n  \
    farreach reset && farreach arm\n  farreach run guided-1hz\n  farreach down\n\n\
    Exit codes: 0 done, 1 failed, 2 usage (also a wrong rig file or protocol), 3 done but data was lost"
)]
pub(crate) struct Cli {
    /// Which rig: several may run on one machine
    #[arg(
        long,
        global = true,
        value_name = "NAME",
        env = "FARREACH_RIG_NAME",
        default_value = "farreach",
        hide_env_values = true
    )]
    rig_name: RigName,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(flatten)]
    Operator(operator::command::Command),
    /// Holds the declared model against measured records and names what it lacks
    Identify(identify::Args),
    /// Recordings: what is in them, are they whole, tables out of them
    #[command(subcommand)]
    Rec(recorder::Command),
    // `probe` and `demo` come with their crates.
    /// One process of a rig (what unit files call)
    #[command(subcommand)]
    Service(Service),
}

/// Does what was asked; returns the exit code.
pub(crate) fn run(cli: Cli) -> anyhow::Result<i32> {
    match cli.command {
        Command::Operator(command) => operator::command::run(command, &cli.rig_name),
        Command::Identify(arguments) => identify::run(arguments),
        Command::Rec(command) => recorder::run(&command),
        Command::Service(service) => service::run(service, &cli.rig_name),
    }
}
