//! The command line: arguments, and what is printed.

mod bring;
mod watch;
mod work;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use ipc_types::Verb;
use runtime::RigName;

/// The operator's commands.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Starts all processes of a rig, and waits until they are ready
    #[command(
        after_help = "Examples:\n  farreach up --simulate --effect backlash@slave=0.05 --record run.mcap\n  \
        farreach up --rig launch/rigs/emps.toml --replay emps.csv --loop"
    )]
    Up(UpArguments),
    /// Stops all processes, motor first, and removes the rig's shared memory
    #[command(after_help = "Example:\n  farreach --rig-name bench down")]
    Down(Json),
    /// Who is up, since when, restarts, rates, late ticks, interlocks, recording. Exit code 1 if
    /// the rig is not up
    #[command(
        after_help = "Examples:\n  farreach status --watch\n  farreach status --json | jq .watchdog.state"
    )]
    Status {
        /// Shows it again each second, until Ctrl-C
        #[arg(long)]
        watch: bool,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: Json,
    },
    /// Clears a fault that no longer stands
    #[command(after_help = "Example:\n  farreach reset && farreach arm && farreach enable")]
    Reset(Json),
    /// Makes ready; only a person does this
    #[command(after_help = "Example:\n  farreach arm")]
    Arm(Json),
    /// Powers the motor
    #[command(after_help = "Example:\n  farreach enable")]
    Enable(Json),
    /// Takes power and readiness away in good order
    #[command(after_help = "Example:\n  farreach disarm")]
    Disarm(Json),
    /// Cuts the motor's power at once; stays so until `reset`
    #[command(after_help = "Example:\n  farreach estop")]
    Estop(Json),
    /// Runs a protocol on an armed rig; Ctrl-C stops it: the handle comes to rest
    #[command(after_help = "Examples:\n  farreach run guided-1hz\n  \
        farreach run launch/protocols/guided-1hz.toml --subject S07 --set segments.0.amplitude_deg=20")]
    Run(RunArguments),
    /// Stops the running protocol: the handle comes to rest, the motor stays enabled at 0 V
    #[command(after_help = "Example:\n  farreach stop")]
    Stop(Json),
}

/// `farreach rec start`, `farreach rec stop`: the recording of a rig that is up.
#[derive(Clone, Debug, Subcommand)]
pub enum Recording {
    /// Begins to record all topics of the rig that is up
    #[command(after_help = "Example:\n  farreach rec start S07.mcap --metadata subject=S07")]
    Start {
        /// The new file (MCAP)
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// What the recording shall say about itself (repeatable)
        #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
        metadata: Vec<(String, String)>,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: Json,
    },
    /// Ends it; returns when everything is on disk. Exit code 3 if messages were lost
    #[command(after_help = "Example:\n  farreach rec stop && farreach rec verify S07.mcap")]
    Stop(Json),
}

/// Reads `KEY=VALUE`.
///
/// # Errors
/// Where there is no `=`.
pub fn key_and_value(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| "expected KEY=VALUE".to_owned())?;
    Ok((key.to_owned(), value.to_owned()))
}

/// For programs.
#[derive(Clone, Copy, Debug, Args)]
pub struct Json {
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// `farreach up`.
#[derive(Clone, Debug, Args)]
pub struct UpArguments {
    /// Rig file, or the name of one that comes with farreach
    #[arg(long, value_name = "FILE|NAME", default_value = "hydrostatic")]
    pub rig: PathBuf,
    /// Puts the simulated card behind the rig
    #[arg(long, conflicts_with = "replay")]
    pub simulate: bool,
    /// Puts an effect into the simulated plant that no model is told of (repeatable)
    #[arg(long = "effect", value_name = "ID[@SITE][=SIZE]", requires = "simulate")]
    pub effects: Vec<String>,
    /// Puts a measured record (MCAP or CSV) where the card would be
    #[arg(long, value_name = "RECORD")]
    pub replay: Option<PathBuf>,
    /// Begins the record again at its end
    #[arg(long = "loop", requires = "replay")]
    pub looped: bool,
    /// Supervises the processes in this terminal, until Ctrl-C or `farreach down`
    #[arg(long)]
    pub foreground: bool,
    /// Records from the start into this file (MCAP)
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub json: Json,
}

/// `farreach run`.
#[derive(Clone, Debug, Args)]
pub struct RunArguments {
    /// Protocol, or the name of one that comes with farreach
    #[arg(value_name = "PROTOCOL.toml")]
    pub protocol: PathBuf,
    /// Changes a value of the protocol before it is checked (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Whom it is run with; goes into the recording
    #[arg(long, value_name = "ID")]
    pub subject: Option<String>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub json: Json,
}

/// Does what was asked, printing to standard output; returns the exit code.
///
/// # Errors
/// [`crate::Error`], or that the output could not be written.
pub fn run(command: Command, rig_name: &RigName) -> anyhow::Result<i32> {
    match command {
        Command::Up(arguments) => bring::up(&arguments, rig_name),
        Command::Down(Json { json }) => bring::down(rig_name, json),
        Command::Status { watch, json: Json { json } } => watch::status(rig_name, watch, json),
        Command::Reset(Json { json }) => work::verb(rig_name, Verb::Reset, json),
        Command::Arm(Json { json }) => work::verb(rig_name, Verb::Arm, json),
        Command::Enable(Json { json }) => work::verb(rig_name, Verb::Enable, json),
        Command::Disarm(Json { json }) => work::verb(rig_name, Verb::Disarm, json),
        Command::Estop(Json { json }) => work::verb(rig_name, Verb::Estop, json),
        Command::Run(arguments) => work::run(&arguments, rig_name),
        Command::Stop(Json { json }) => work::stop(rig_name, json),
    }
}

/// Begins or ends a recording; returns the exit code.
///
/// # Errors
/// [`crate::Error`], or that the output could not be written.
pub fn record(command: Recording, rig_name: &RigName) -> anyhow::Result<i32> {
    match command {
        Recording::Start { file, metadata, json: Json { json } } => {
            work::start_recording(rig_name, &file, metadata, json)
        }
        Recording::Stop(Json { json }) => work::stop_recording(rig_name, json),
    }
}
