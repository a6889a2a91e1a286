//! `farreach service NAME`: one process of a rig, as the unit files call it.

use std::net::SocketAddr;
use std::path::PathBuf;

use acquisition::{AcquisitionError, CardOptions};
use clap::builder::FalseyValueParser;
use clap::{Args, Subcommand};
use ipc_types::CardKind;
use operator::command::{card_parser, parse_key_value};
use rig::RigFile;
use runtime::RigName;
use simulator::SimulatorError;

use crate::failure::Usage;

/// The processes.
#[derive(Debug, Subcommand)]
pub(crate) enum Service {
    /// Creates the rig's shared memory, holds it open, cleans up after processes that died
    #[command(after_help = "Example:\n  farreach --rig-name bench service keeper")]
    Keeper {
        /// Describes the rig in its run directory, as the launcher does elsewhere, and removes it
        /// at the end (its unit file sets FARREACH_SYSTEMD)
        #[arg(
            long,
            env = "FARREACH_SYSTEMD",
            value_parser = FalseyValueParser::new(),
            hide_env_values = true
        )]
        systemd: bool,
    },
    /// The simulated card with the simulated plant
    #[command(
        after_help = "Example:\n  farreach service simulator --rig launch/rigs/hydrostatic.toml \
        --effect sensor_drift"
    )]
    Simulator {
        #[command(flatten)]
        rig: RigArgument,
        /// Adds an effect to the simulated plant that the declared model lacks (repeatable)
        #[arg(
            long = "effect",
            value_name = "ID[@SITE][=SIZE]",
            env = "FARREACH_EFFECTS",
            value_delimiter = ',',
            hide_env_values = true
        )]
        effects: Vec<String>,
        /// Rig file of the machine that is simulated, where it is not that of --rig
        #[arg(long, value_name = "FILE", env = "FARREACH_MACHINE", hide_env_values = true)]
        machine: Option<String>,
    },
    /// Reads the card, publishes samples, writes motor voltages through the gate
    #[command(
        after_help = "Example:\n  farreach service acquisition --rig launch/rigs/hydrostatic.toml \
        --card replay --replay run.mcap"
    )]
    Acquisition {
        #[command(flatten)]
        rig: RigArgument,
        /// The card that it reads and writes; that of the rig file, if left out
        #[arg(
            long,
            env = "FARREACH_CARD",
            hide_env_values = true,
            value_parser = card_parser()
        )]
        card: Option<CardKind>,
        /// Measured record, with --card replay
        #[arg(long, value_name = "RECORD", env = "FARREACH_REPLAY", hide_env_values = true)]
        replay: Option<String>,
        /// Repeats the record from its start
        #[arg(
            long = "loop",
            env = "FARREACH_REPLAY_LOOP",
            value_parser = FalseyValueParser::new(),
            hide_env_values = true
        )]
        looped: bool,
    },
    /// The control law
    #[command(
        after_help = "Example:\n  farreach service control --rig launch/rigs/hydrostatic.toml"
    )]
    Control(RigArgument),
    /// The interlocks and the motor's enable line
    #[command(
        after_help = "Example:\n  farreach service watchdog --rig launch/rigs/hydrostatic.toml"
    )]
    Watchdog {
        #[command(flatten)]
        rig: RigArgument,
        #[command(flatten)]
        doctor: DoctorFolder,
        /// The card behind acquisition, whose enable line it switches; that of the rig file, if
        /// left out
        #[arg(
            long,
            env = "FARREACH_CARD",
            hide_env_values = true,
            value_parser = card_parser()
        )]
        card: Option<CardKind>,
    },
    /// Writes all topics to disk
    #[command(
        after_help = "Example:\n  farreach service logger --rig launch/rigs/hydrostatic.toml \
        --record /data/run.mcap"
    )]
    Logger {
        #[command(flatten)]
        rig: RigArgument,
        /// Records from the start into this file (absolute path)
        #[arg(long, value_name = "FILE", env = "FARREACH_RECORD", hide_env_values = true)]
        record: Option<String>,
        /// Metadata of the recording (repeatable)
        #[arg(long, value_name = "KEY=VALUE", value_parser = parse_key_value)]
        metadata: Vec<(String, String)>,
        #[command(flatten)]
        doctor: DoctorFolder,
    },
    /// Plays protocols
    #[command(
        after_help = "Example:\n  farreach service experiment --rig launch/rigs/hydrostatic.toml"
    )]
    Experiment {
        #[command(flatten)]
        rig: RigArgument,
        /// Folder of the learned references; without it they last as long as the rig is up
        #[arg(long, value_name = "DIR", env = "FARREACH_LEARNT", hide_env_values = true)]
        learnt: Option<PathBuf>,
    },
    /// Runs the declared model beside the machine and tells when the machine departs from it
    #[command(
        after_help = "Example:\n  farreach service monitor --rig launch/rigs/hydrostatic.toml"
    )]
    Monitor(RigArgument),
    /// Serves the pages of operator and subject to browsers
    #[command(
        after_help = "Example:\n  farreach --rig-name bench service console --listen 127.0.0.1:8321"
    )]
    Console {
        /// Address and port to listen at
        #[arg(long, value_name = "ADDRESS", env = "FARREACH_CONSOLE", hide_env_values = true)]
        listen: SocketAddr,
    },
    /// Starts, supervises and restarts the other processes where systemd does not; called by
    /// `farreach up`
    #[command(after_help = "Example:\n  farreach service launcher \
        --run-dir /dev/shm/farreach-1000-bench/run")]
    Launcher {
        /// The rig's run directory, with launch.json
        #[arg(long, value_name = "DIR")]
        run_dir: PathBuf,
    },
}

/// The rig file of a process.
#[derive(Debug, Args)]
pub(crate) struct RigArgument {
    /// The rig file
    #[arg(long = "rig", value_name = "FILE", env = "FARREACH_RIG", hide_env_values = true)]
    file: PathBuf,
}

impl RigArgument {
    fn load(&self) -> anyhow::Result<RigFile> {
        RigFile::load(&self.file).map_err(usage)
    }
}

/// Where the doctor's reports are.
#[derive(Debug, Args)]
pub(crate) struct DoctorFolder {
    /// Folder of the reports of `farreach doctor`
    #[arg(long = "doctor", value_name = "DIR", env = "FARREACH_DOCTOR", hide_env_values = true)]
    folder: Option<PathBuf>,
}

impl DoctorFolder {
    /// `up` sets every variable; an empty one counts as absent.
    fn given(self) -> Option<PathBuf> {
        self.folder.filter(|folder| !folder.as_os_str().is_empty())
    }
}

/// An error that no restart can cure.
fn usage(error: impl std::error::Error) -> anyhow::Error {
    Usage(error.to_string()).into()
}

/// `up` sets every variable; an empty one counts as absent.
fn given(text: Option<String>) -> Option<PathBuf> {
    text.filter(|text| !text.is_empty()).map(PathBuf::from)
}

/// Runs one process until a signal ends it. A wrong file is a [`Usage`] error: a restart cannot
/// help, and exit code 2 tells the service manager so.
pub(crate) fn run(service: Service, rig_name: &RigName) -> anyhow::Result<i32> {
    let name = rig_name.as_str();
    match service {
        Service::Keeper { systemd: true } => {
            // A wrong rig file is a wrong one for all: nothing starts without the keeper.
            keeper::run(name, |cold| -> anyhow::Result<()> {
                operator::describe_to_clients(rig_name, cold).map_err(|error| match error {
                    operator::Error::File(_) => usage(error),
                    other => other.into(),
                })
            })?;
            rig_name.remove()?;
        }
        Service::Keeper { systemd: false } => {
            keeper::run(name, |_| Ok::<(), runtime::ServiceError>(()))?;
        }
        Service::Launcher { run_dir } => launch::launcher_main(&run_dir)?,
        Service::Simulator { rig, effects, machine } => {
            let effects: Vec<_> = effects.into_iter().filter(|effect| !effect.is_empty()).collect();
            let machine = given(machine).map_or(rig, |file| RigArgument { file });
            simulator::run(name, &machine.load()?, &effects).map_err(|error| match error {
                SimulatorError::Card(_) => usage(error),
                other => other.into(),
            })?;
        }
        Service::Acquisition { rig, card, replay, looped } => {
            let rig = rig.load()?;
            let kind = card.or(rig.card).ok_or_else(|| usage(operator::Error::NoCard))?;
            let card = CardOptions { kind, replay: given(replay), looped };
            acquisition::run(name, &rig, &card).map_err(|error| match error {
                AcquisitionError::Card(_) => usage(error),
                other => other.into(),
            })?;
        }
        Service::Control(rig) => control::run(name, &rig.load()?)?,
        Service::Watchdog { rig, card, doctor } => {
            let rig = rig.load()?;
            watchdog::run(name, &rig, card.or(rig.card), doctor.given().as_deref())?;
        }
        Service::Logger { rig, record, metadata, doctor } => {
            let metadata = metadata.into_iter().collect();
            let options =
                logger::Options { record: given(record), metadata, doctor: doctor.given() };
            logger::run(name, &rig.load()?, &options)?;
        }
        Service::Experiment { rig, learnt } => {
            let learnt = learnt.filter(|folder| !folder.as_os_str().is_empty());
            experiment::run(name, &rig.load()?, learnt.as_deref())?;
        }
        Service::Monitor(rig) => monitor::run(name, &rig.load()?)?,
        Service::Console { listen } => web_console::run(rig_name, listen)?,
    }
    Ok(operator::DONE)
}
