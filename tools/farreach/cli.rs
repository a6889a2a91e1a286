//! The command line.

use std::path::PathBuf;
use std::sync::OnceLock;

use clap::{CommandFactory as _, Parser, Subcommand};
use runtime::RigName;

use crate::reference;
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
    after_help = "Example, a whole session with the simulated rig:\n  \
        farreach up --simulate --record run.mcap\n  farreach reset && farreach arm\n  \
        farreach run home\n  farreach run guided-1hz\n  farreach down\n\n\
        Exit codes: 0 done, 1 failed, 2 usage, 3 done but data was lost"
)]
pub(crate) struct Cli {
    /// Name of the rig: several may run on one computer
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
    /// Compares the declared model with measured records and names the effects that it lacks
    Identify(Box<identify::Args>),
    /// Tunes the control of a rig that is up, from its own recordings
    Tune(tune::Args),
    Doctor(doctor::Args),
    /// Redraws the thesis's figures from the models, beside the published values
    Figures(figures::Args),
    /// Starts and stops recordings, inspects, verifies, repairs and exports them
    #[command(subcommand)]
    Rec(Rec),
    /// Observes a running rig without disturbing it, or reads a recording in the same way
    #[command(subcommand)]
    Probe(probe::Command),
    /// Hands a running rig's topics to other people's programs
    #[command(subcommand)]
    Bridge(bridge::Command),
    /// Runs a complete session on the built-in simulated rig and reports on it
    Demo(demo::Args),
    /// Runs one process of a rig (called by the unit files)
    #[command(subcommand)]
    Service(Service),
    /// Prints a completion script for a shell
    #[command(
        after_help = "Example:\n  farreach completions bash > /etc/bash_completion.d/farreach"
    )]
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Writes a man page for each command into a folder
    #[command(after_help = "Example:\n  farreach man /usr/local/share/man/man1")]
    Man {
        /// Existing folder
        #[arg(value_name = "DIR")]
        directory: PathBuf,
    },
}

#[derive(Debug, Subcommand)]
enum Rec {
    #[command(flatten)]
    Live(operator::command::Recording),
    #[command(flatten)]
    File(recorder::Command),
}

impl Command {
    /// Whether it joins a running rig, and so must be run by the rig's user. `up` and `down` ask
    /// whoever supervises it.
    fn joins_rig(&self) -> bool {
        use operator::command::Command as Operator;
        match self {
            Self::Operator(Operator::Up(_) | Operator::Down(_)) => false,
            Self::Probe(command) => command.joins_rig(),
            Self::Operator(_) | Self::Tune(_) | Self::Rec(Rec::Live(_)) | Self::Bridge(_) => true,
            _ => false,
        }
    }
}

/// Runs the command; returns the exit code.
pub(crate) fn run(cli: Cli) -> anyhow::Result<i32> {
    if cli.command.joins_rig() {
        operator::become_its_user(&cli.rig_name)?;
    }
    match cli.command {
        Command::Operator(command) => operator::command::run(command, &cli.rig_name),
        Command::Identify(arguments) => {
            die_on_closed_pipe();
            identify::run(*arguments, &logger::revision())
        }
        Command::Tune(arguments) => tune::run(&arguments, &cli.rig_name, &logger::revision()),
        Command::Doctor(arguments) => doctor::run(&arguments, &cli.rig_name, &logger::revision()),
        Command::Figures(arguments) => {
            die_on_closed_pipe();
            figures::run(&arguments)
        }
        Command::Rec(Rec::Live(command)) => operator::command::record(command, &cli.rig_name),
        Command::Rec(Rec::File(command)) => recorder::run(&command),
        Command::Probe(command) => probe::run(&command, &cli.rig_name),
        Command::Bridge(command) => bridge::run(&command, &cli.rig_name),
        Command::Demo(arguments) => demo::run(arguments, &logger::revision()),
        Command::Service(service) => service::run(service, &cli.rig_name),
        Command::Completions { shell } => reference::completions(Cli::command(), shell),
        Command::Man { directory } => reference::man(Cli::command(), &directory),
    }
}

/// Lets a closed pipe (`| head`) end the program, as with other Unix tools. For commands that print
/// with `println!` and have nothing to clean up.
fn die_on_closed_pipe() {
    // SAFETY: called before there is a second thread; the default action is not our code.
    unsafe {
        libc::signal(libc::SIGPIPE, libc::SIG_DFL);
    }
}
