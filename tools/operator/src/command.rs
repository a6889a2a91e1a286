//! Command-line arguments of the operator's commands, and their dispatch.

mod actions;
mod faults;
mod show_status;
mod snapshot;
mod split;
mod up_down;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use ipc_types::{CardKind, Profile, Split, Verb};
use runtime::RigName;

use crate::{PhaseSource, RunOptions};
pub use faults::{FaultArguments, FaultCommand};
pub use snapshot::{SnapshotArguments, Trigger};
use split::{parse_split, ring_of, whichever_first};

/// Where the console listens unless told: not to be reached from other computers.
const CONSOLE_AT: &str = "127.0.0.1:8321";

/// The rig file unless told.
const DEFAULT_RIG: &str = "hydrostatic";

/// The operator's commands.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Starts all processes of a rig and waits until they are ready
    #[command(after_help = "Examples:\n  \
        farreach up --simulate --effect backlash@slave=0.05 --record run.mcap\n  \
        farreach up --simulate --console --record run.mcap\n  \
        farreach up --rig launch/rigs/emps.toml --replay emps.csv --loop\n  \
        farreach --rig-name bench up    # a rig of /etc/farreach/bench, under systemd")]
    Up(UpArguments),
    /// Removes motor power, stops all processes and removes the rig's shared memory
    #[command(after_help = "Example:\n  farreach --rig-name bench down")]
    Down(OutputFormat),
    /// Shows processes, restarts, rates, missed periods, interlocks and the recording. Exits
    /// with code 1 if the rig is not up
    #[command(after_help = "Examples:\n  farreach status --watch\n  \
        farreach status --json | jq .watchdog.state")]
    Status {
        /// Refreshes every second until Ctrl-C
        #[arg(long)]
        watch: bool,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: OutputFormat,
    },
    /// Clears a latched fault or trip whose cause is no longer present
    #[command(after_help = "Example:\n  farreach reset && farreach arm && farreach enable")]
    Reset(OutputFormat),
    /// Arms the rig, so that it can be enabled. `doctor --move` and `tune` arm by themselves once a
    /// person has agreed at their terminal; `demo` does, on a simulated card
    #[command(after_help = "Example:\n  farreach doctor && farreach arm")]
    Arm {
        /// Arms a real card although no report of `farreach doctor` allows it: one of this boot,
        /// younger than a day and without failures. The override is recorded as an event
        #[arg(long)]
        unchecked: bool,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: OutputFormat,
    },
    /// Enables the motor on an armed rig
    #[command(after_help = "Example:\n  farreach enable")]
    Enable(OutputFormat),
    /// Removes motor power and leaves the armed state, without a trip
    #[command(after_help = "Example:\n  farreach disarm")]
    Disarm(OutputFormat),
    /// Emergency stop: removes motor power at once and stays tripped until `reset`
    #[command(after_help = "Example:\n  farreach estop")]
    Estop(OutputFormat),
    /// Enables the motor on an armed rig and runs a protocol; Ctrl-C stops the protocol and brings
    /// the handle to rest
    #[command(after_help = "Examples:\n  farreach run home\n  farreach run guided-1hz\n  \
        farreach run guided-1hz --subject S07 --set segments.0.amplitude_deg=20\n  \
        farreach run block-design --emulate-scanner 2\n  \
        farreach run force-matching --subject S07 --mat S07_\n  \
        farreach run --from S07.mcap")]
    Run(RunArguments),
    /// Prints the addresses of the console's pages
    #[command(after_help = "Example:\n  farreach up --simulate --console && farreach console")]
    Console(OutputFormat),
    /// Stops the running protocol: the handle comes to rest, the motor stays enabled at 0 V
    #[command(after_help = "Example:\n  farreach stop")]
    Stop(OutputFormat),
    /// Restarts one process of a rig that is up, and waits until it is ready again
    #[command(after_help = "Example:\n  farreach restart logger")]
    Restart {
        /// Name of the process, as in `farreach status`
        #[arg(value_name = "PROCESS")]
        process: String,
        /// Also while the motor is enabled, which then loses its power
        #[arg(long)]
        force: bool,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: OutputFormat,
    },
    /// Runs a program of your own in place of one process of a rig that is up (docs/replacing.md),
    /// until `--undo` or the rig is down
    #[command(after_help = "Examples:\n  \
        farreach replace control -- python3 control.py --target-rad 0.6\n  \
        farreach replace control --undo")]
    Replace {
        /// Name of the process, as in `farreach status`
        #[arg(value_name = "PROCESS")]
        process: String,
        /// Runs farreach's own process again
        #[arg(long, conflicts_with = "program")]
        undo: bool,
        /// Also while the motor is enabled, which then loses its power
        #[arg(long)]
        force: bool,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: OutputFormat,
        /// The program and its arguments; it gets the variables of the process
        #[arg(last = true, value_name = "COMMAND", required_unless_present = "undo")]
        program: Vec<String>,
    },
    /// Puts a fault into the simulated card or machine of a rig that is up
    #[command(after_help = "Examples:\n  farreach fault encoder_stuck@master\n  \
        farreach fault encoder_dropout@slave --for 0.05\n  farreach fault adc_rail@torque=-1\n  \
        farreach fault list\n  farreach fault clear")]
    Fault(FaultArguments),
}

/// `farreach rec start`, `rec stop` and `rec tag`: the recording of a rig that is up.
#[derive(Clone, Debug, Subcommand)]
pub enum Recording {
    /// Starts recording all topics of a rig that is up
    #[command(after_help = "Examples:\n  farreach rec start S07.mcap --metadata subject=S07\n  \
        farreach rec start long.mcap --split 10min --split 2GB\n  \
        farreach rec start --ring 30s /dev/shm/ring.mcap")]
    Start {
        /// MCAP file to create; it must not exist
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Metadata to store in the recording (repeatable)
        #[arg(long, value_name = "KEY=VALUE", value_parser = parse_key_value)]
        metadata: Vec<(String, String)>,
        /// Goes on in another file (S07.part2.mcap, …) whenever one is so long (10min) or so large
        /// (500MB), without losing a message; given twice, at whichever comes first
        #[arg(long, value_name = "TIME|SIZE", value_parser = parse_split)]
        split: Vec<Split>,
        /// Keeps only so much of the past, in parts of FILE of which the oldest are removed, for
        /// `rec snapshot`
        #[arg(long, value_name = "TIME", conflicts_with = "split",
            value_parser = humantime::parse_duration)]
        ring: Option<Duration>,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: OutputFormat,
    },
    /// Writes what a ring holds into a file, and what comes then
    #[command(after_help = "Examples:\n  farreach rec snapshot --after 5s odd-noise.mcap\n  \
        farreach rec snapshot --on trip --before 10s --after 5s trip.mcap")]
    Snapshot(SnapshotArguments),
    /// Stops the recording; returns once everything is on disk. Exit code 3 if messages were lost
    #[command(after_help = "Example:\n  farreach rec stop && farreach rec verify S07.mcap")]
    Stop(OutputFormat),
    /// Puts a note into the running recording, with time and author: an event, which `rec info`
    /// lists and exports have
    #[command(after_help = "Example:\n  farreach rec tag \"subject moved the elbow\"")]
    Tag {
        /// What it says: a line
        #[arg(value_name = "TEXT")]
        text: String,
        /// Who says it; the user who calls, if left out
        #[arg(long, value_name = "NAME")]
        author: Option<String>,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: OutputFormat,
    },
}

/// Reads `KEY=VALUE`.
///
/// # Errors
/// If `text` contains no `=`.
pub fn parse_key_value(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| "expected KEY=VALUE".to_owned())?;
    Ok((key.to_owned(), value.to_owned()))
}

/// Clap parser for the name of any card that has a driver.
pub fn card_parser() -> impl TypedValueParser<Value = CardKind> {
    parser_of(acquisition::DRIVERS.iter().map(|driver| driver.kind).collect())
}

/// The same for `up`, where `--replay RECORD` chooses the replay.
fn card_without_record_parser() -> impl TypedValueParser<Value = CardKind> {
    let kinds = acquisition::DRIVERS.iter().map(|driver| driver.kind);
    parser_of(kinds.filter(|kind| *kind != CardKind::Replay).collect())
}

fn parser_of(kinds: Vec<CardKind>) -> impl TypedValueParser<Value = CardKind> {
    let value =
        |kind: &CardKind| PossibleValue::new(kind.text()).help(kind.about().trim_end_matches('.'));
    PossibleValuesParser::new(kinds.iter().map(value)).try_map(move |name| {
        let found = kinds.iter().find(|kind| kind.text() == name);
        found.copied().ok_or_else(|| format!("unknown card {name}"))
    })
}

/// The `--json` switch, shared by all commands.
#[derive(Clone, Copy, Debug, Args)]
pub struct OutputFormat {
    /// Prints the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `farreach up`.
#[derive(Clone, Debug, Args)]
pub struct UpArguments {
    /// Rig file, or the name of a rig shipped with farreach
    #[arg(long, value_name = "FILE|NAME", default_value = DEFAULT_RIG)]
    pub rig: PathBuf,
    /// Uses the simulated card
    #[arg(long, conflicts_with = "replay")]
    pub simulate: bool,
    /// Uses the named card; by default that of the rig file
    #[arg(long, conflicts_with_all = ["simulate", "replay"],
        value_parser = card_without_record_parser())]
    pub card: Option<CardKind>,
    /// Adds to the simulated plant an effect that the declared model does not have; SIZE in the
    /// effect's own unit (repeatable)
    #[arg(long = "effect", value_name = "ID[@SITE][=SIZE]", requires = "simulate")]
    pub effects: Vec<String>,
    /// Simulates the machine of this rig file in place of that of --rig, which stays what control
    /// and models know
    #[arg(long, value_name = "FILE|NAME", requires = "simulate")]
    pub machine: Option<PathBuf>,
    /// Replays a measured record (MCAP or CSV) in place of a card
    #[arg(long, value_name = "RECORD")]
    pub replay: Option<PathBuf>,
    /// Starts the record again when it ends
    #[arg(long = "loop", requires = "replay")]
    pub loop_replay: bool,
    /// Supervises the processes in this terminal, until Ctrl-C or `farreach down`
    #[arg(long)]
    pub foreground: bool,
    /// Records from the start into this file (MCAP)
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Serves the console, the pages of operator and subject, at this address; `farreach console`
    /// prints it with its token
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = CONSOLE_AT)]
    pub console: Option<SocketAddr>,
    /// Runs the declared model beside the machine, and tells when the machine departs from it
    #[arg(long)]
    pub monitor: bool,
    /// Timing profile (realtime, best-effort). By default farreach measures the scheduling stalls
    /// of this computer and chooses; overrides FARREACH_PROFILE
    #[arg(long, value_name = "PROFILE", value_parser = parse_profile)]
    pub profile: Option<Profile>,
    /// Binds each loop to a processor of its own as far as there are enough: isolated ones
    /// (isolcpus=), else those with the least load; FARREACH_PLACEMENT=on does the same
    #[arg(long)]
    pub place: bool,
    /// Where the phases of the loops come from: what acquisition waits for the card, and control
    /// for acquisition. Measured ones stand in the recording, as those of a rig file do
    #[arg(long, value_name = "SOURCE", value_enum, default_value_t)]
    pub phases: PhaseSource,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub json: OutputFormat,
}

impl UpArguments {
    /// Whether it names neither a card nor anything else of a rig: that of an installed rig stands
    /// in its files.
    fn says_nothing(&self) -> bool {
        let Self { simulate, card, effects, machine, replay, foreground, .. } = self;
        let a_card = *simulate || card.is_some() || replay.is_some();
        let of_card = !effects.is_empty() || machine.is_some();
        let another_rig = self.rig.as_os_str() != DEFAULT_RIG;
        let more = self.record.is_some()
            || self.console.is_some()
            || self.profile.is_some()
            || self.phases != PhaseSource::File;
        !(a_card || of_card || another_rig || more || *foreground || self.monitor)
    }
}

fn parse_profile(text: &str) -> Result<Profile, String> {
    let known = Profile::ALL.iter().copied();
    known.clone().find(|profile| profile.text() == text).ok_or_else(|| {
        format!("expected {}", known.map(Profile::text).collect::<Vec<_>>().join(" or "))
    })
}

/// `farreach run`.
#[derive(Clone, Debug, Args)]
pub struct RunArguments {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub options: RunOptions,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub json: OutputFormat,
}

/// Runs a command, prints its result to standard output and returns the exit code.
///
/// # Errors
/// [`crate::Error`], or an I/O error if the output cannot be written.
pub fn run(command: Command, rig_name: &RigName) -> anyhow::Result<i32> {
    match command {
        Command::Up(arguments) => up_down::up(&arguments, rig_name),
        Command::Down(OutputFormat { json }) => up_down::down(rig_name, json),
        Command::Status { watch, json: OutputFormat { json } } => {
            show_status::status(rig_name, watch, json)
        }
        Command::Reset(OutputFormat { json }) => actions::verb(rig_name, Verb::Reset, json),
        Command::Arm { unchecked, json: OutputFormat { json } } => {
            let verb = if unchecked { Verb::ArmUnchecked } else { Verb::Arm };
            actions::verb(rig_name, verb, json)
        }
        Command::Enable(OutputFormat { json }) => actions::verb(rig_name, Verb::Enable, json),
        Command::Disarm(OutputFormat { json }) => actions::verb(rig_name, Verb::Disarm, json),
        Command::Estop(OutputFormat { json }) => actions::verb(rig_name, Verb::Estop, json),
        Command::Run(arguments) => actions::run(&arguments, rig_name),
        Command::Console(OutputFormat { json }) => actions::console(rig_name, json),
        Command::Stop(OutputFormat { json }) => actions::stop(rig_name, json),
        Command::Restart { process, force, json: OutputFormat { json } } => {
            actions::restarted(&process, crate::restart(rig_name, &process, force)?, json)
        }
        Command::Replace { process, undo: _, force, json: OutputFormat { json }, program } => {
            let took = crate::replace(rig_name, &process, &program, force)?;
            actions::restarted(&process, took, json)
        }
        Command::Fault(arguments) => faults::fault(rig_name, arguments),
    }
}

/// Starts, stops or tags a recording; returns the exit code.
///
/// # Errors
/// [`crate::Error`], or an I/O error if the output cannot be written.
pub fn record(command: Recording, rig_name: &RigName) -> anyhow::Result<i32> {
    match command {
        Recording::Start { file, metadata, split, ring, json: OutputFormat { json } } => {
            let split = ring.map_or_else(|| whichever_first(&split), ring_of);
            actions::start_recording(rig_name, &file, metadata, split, json)
        }
        Recording::Snapshot(arguments) => snapshot::snapshot(rig_name, &arguments),
        Recording::Stop(OutputFormat { json }) => actions::stop_recording(rig_name, json),
        Recording::Tag { text, author, json: OutputFormat { json } } => {
            actions::tag(rig_name, text, author, json)
        }
    }
}

/// Prints a result: as indented JSON, or as a line of text.
fn print(as_json: bool, value: serde_json::Value, text: &str) -> anyhow::Result<()> {
    use std::io::Write as _;
    if as_json { print_json(&value) } else { Ok(writeln!(std::io::stdout(), "{text}")?) }
}

/// Prints a value as indented JSON.
fn print_json(value: &serde_json::Value) -> anyhow::Result<()> {
    use std::io::Write as _;
    Ok(writeln!(std::io::stdout(), "{}", serde_json::to_string_pretty(value)?)?)
}
