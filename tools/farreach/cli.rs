//! The command line.

use std::sync::OnceLock;

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
    long_version = long_version(),
    arg_required_else_help = true,
    after_help = "Example, a whole session with the simulated rig:\n  farreach up --simulate --record run.mcap\n  \
    farreach reset && farreach arm\n  farreach run guided-1hz\n  farreach down\n\n\
    Exit codes: 0 done, 1 failed, 2 usage, 3 done but data was lost"
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

/// Version and revision: what a figure was measured with.
fn long_version() -> &'static str {
    static TEXT: OnceLock<String> = OnceLock::new();
    TEXT.get_or_init(|| format!("{}, revision {}", env!("CARGO_PKG_VERSION"), logger::revision()))
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(flatten)]
    Operator(operator::command::Command),
    /// Holds the declared model against measured records and names what it lacks
    Identify(identify::Args),
    /// Redraws the thesis's figures from the models, beside the published values
    Figures(figures::Args),
    /// Recordings on and off, what is in them, are they whole, tables out of them
    #[command(subcommand)]
    Rec(Rec),
    /// Looks into a running rig and never disturbs it
    #[command(subcommand)]
    Probe(probe::Command),
    /// Runs the main job on the embedded simulated rig and reports on it
    Demo(demo::Args),
    /// One process of a rig (what unit files call)
    #[command(subcommand)]
    Service(Service),
}

#[derive(Debug, Subcommand)]
enum Rec {
    #[command(flatten)]
    Live(operator::command::Recording),
    #[command(flatten)]
    File(recorder::Command),
}

/// Does what was asked; returns the exit code.
pub(crate) fn run(cli: Cli) -> anyhow::Result<i32> {
    match cli.command {
        Command::Operator(command) => operator::command::run(command, &cli.rig_name),
        Command::Identify(arguments) => {
            end_with_the_reader();
            identify::run(arguments)
        }
        Command::Figures(arguments) => {
            end_with_the_reader();
            figures::run(&arguments)
        }
        Command::Rec(Rec::Live(command)) => operator::command::record(command, &cli.rig_name),
        Command::Rec(Rec::File(command)) => recorder::run(&command),
        Command::Probe(command) => probe::run(command, &cli.rig_name),
        Command::Demo(arguments) => demo::run(arguments),
        Command::Service(service) => service::run(service, &cli.rig_name),
    }
}

/// Lets a closed pipe end the program (`| head`), as it does other Unix tools. For commands that
/// print with `println!` and look after nothing else.
fn end_with_the_reader() {
    // SAFETY: called before there is a second thread; the default action is not our code.
    unsafe {
        libc::signal(libc::SIGPIPE, libc::SIG_DFL);
    }
}
