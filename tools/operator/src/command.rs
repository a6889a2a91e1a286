//! The command line: arguments, and what is printed.

mod bring;
mod watch;
mod work;

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use ipc_types::{CardKind, Profile, Verb};
use runtime::RigName;

/// The operator's commands.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Starts all processes of a rig and waits until they are ready
    #[command(after_help = "Examples:\n  \
        farreach up --simulate --effect backlash@slave=0.05 --record run.mcap\n  \
        farreach up --rig launch/rigs/emps.toml --replay emps.csv --loop")]
    Up(UpArguments),
    /// Removes motor power, stops all processes and removes the rig's shared memory
    #[command(after_help = "Example:\n  farreach --rig-name bench down")]
    Down(Json),
    /// Shows processes, restarts, rates, missed periods, interlocks and the recording. Exit code 1
    /// if the rig is not up
    #[command(after_help = "Examples:\n  farreach status --watch\n  \
        farreach status --json | jq .watchdog.state")]
    Status {
        /// Repeats every second, until Ctrl-C
        #[arg(long)]
        watch: bool,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: Json,
    },
    /// Clears a fault or trip that is no longer active
    #[command(after_help = "Example:\n  farreach reset && farreach arm && farreach enable")]
    Reset(Json),
    /// Makes the rig ready to be enabled; only a person does this
    #[command(after_help = "Example:\n  farreach arm")]
    Arm(Json),
    /// Powers the motor
    #[command(after_help = "Example:\n  farreach enable")]
    Enable(Json),
    /// Removes motor power and leaves the armed state, without a trip
    #[command(after_help = "Example:\n  farreach disarm")]
    Disarm(Json),
    /// Removes motor power at once and latches until `reset`
    #[command(after_help = "Example:\n  farreach estop")]
    Estop(Json),
    /// Runs a protocol on an armed rig; Ctrl-C stops it: the handle comes to rest
    #[command(after_help = "Examples:\n  farreach run guided-1hz\n  \
        farreach run guided-1hz --subject S07 --set segments.0.amplitude_deg=20")]
    Run(RunArguments),
    /// Stops the running protocol: the handle comes to rest, the motor stays enabled at 0 V
    #[command(after_help = "Example:\n  farreach stop")]
    Stop(Json),
}

/// `farreach rec start`, `farreach rec stop`: the recording of a rig that is up.
#[derive(Clone, Debug, Subcommand)]
pub enum Recording {
    /// Starts recording all topics of a rig that is up
    #[command(after_help = "Example:\n  farreach rec start S07.mcap --metadata subject=S07")]
    Start {
        /// The new file (MCAP)
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Metadata of the recording (repeatable)
        #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
        metadata: Vec<(String, String)>,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: Json,
    },
    /// Stops the recording; returns when all is on disk. Exit code 3 if messages were lost
    #[command(after_help = "Example:\n  farreach rec stop && farreach rec verify S07.mcap")]
    Stop(Json),
}

/// Reads `KEY=VALUE`.
///
/// # Errors
/// If there is no `=`.
pub fn key_and_value(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| "expected KEY=VALUE".to_owned())?;
    Ok((key.to_owned(), value.to_owned()))
}

/// Reads the name of a card that has a driver.
pub fn card_name() -> impl TypedValueParser<Value = CardKind> {
    let kinds = || acquisition::DRIVERS.iter().map(|driver| driver.kind);
    let value =
        |kind: CardKind| PossibleValue::new(kind.text()).help(kind.about().trim_end_matches('.'));
    PossibleValuesParser::new(kinds().map(value)).try_map(move |name| {
        kinds().find(|kind| kind.text() == name).ok_or_else(|| format!("no card {name}"))
    })
}

/// Output for programs.
#[derive(Clone, Copy, Debug, Args)]
pub struct Json {
    /// Prints JSON
    #[arg(long)]
    pub json: bool,
}

/// `farreach up`.
#[derive(Clone, Debug, Args)]
pub struct UpArguments {
    /// Rig file, or the name of one that comes with farreach
    #[arg(long, value_name = "FILE|NAME", default_value = "hydrostatic")]
    pub rig: PathBuf,
    /// Uses the simulated card
    #[arg(long, conflicts_with = "replay")]
    pub simulate: bool,
    /// Uses the card of this name
    #[arg(long, conflicts_with_all = ["simulate", "replay"], value_parser = card_name())]
    pub card: Option<CardKind>,
    /// Adds an effect to the simulated plant that the declared model lacks (repeatable)
    #[arg(long = "effect", value_name = "ID[@SITE][=SIZE]", requires = "simulate")]
    pub effects: Vec<String>,
    /// Replays a measured record (MCAP or CSV) in place of a card
    #[arg(long, value_name = "RECORD")]
    pub replay: Option<PathBuf>,
    /// Repeats the record from its start
    #[arg(long = "loop", requires = "replay")]
    pub looped: bool,
    /// Supervises the processes in this terminal, until Ctrl-C or `farreach down`
    #[arg(long)]
    pub foreground: bool,
    /// Records from the start into this file (MCAP)
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Timing profile (realtime, best-effort) instead of the one that suits the measured stalls of
    /// this computer; overrides FARREACH_PROFILE
    #[arg(long, value_name = "PROFILE", value_parser = profile)]
    pub profile: Option<Profile>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub json: Json,
}

fn profile(text: &str) -> Result<Profile, String> {
    let known = Profile::ALL.iter().copied();
    known.clone().find(|profile| profile.text() == text).ok_or_else(|| {
        format!("expected {}", known.map(Profile::text).collect::<Vec<_>>().join(" or "))
    })
}

/// `farreach run`.
#[derive(Clone, Debug, Args)]
pub struct RunArguments {
    /// Protocol, or the name of one that comes with farreach
    #[arg(value_name = "PROTOCOL.toml")]
    pub protocol: PathBuf,
    /// Replaces a value of the protocol before it is checked (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Code of the subject; goes into the recording
    #[arg(long, value_name = "ID")]
    pub subject: Option<String>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub json: Json,
}

/// Runs the command and prints to standard output; returns the exit code.
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

/// Starts or stops a recording; returns the exit code.
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

/// Prints a value as indented JSON.
fn print_json(value: &serde_json::Value) -> anyhow::Result<()> {
    use std::io::Write as _;
    Ok(writeln!(std::io::stdout(), "{}", serde_json::to_string_pretty(value)?)?)
}
