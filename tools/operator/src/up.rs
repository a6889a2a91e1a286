//! Bringing a rig up.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use acquisition::CardOptions;
use ipc_types::{CardKind, Process, Profile, processes_with};
use launch::{Config, StopReport};
use rig::RigFile;
use runtime::placement::{PLACEMENT_VARIABLE, placement_is_on};
use runtime::realtime::{self, PROFILE_VARIABLE};
use runtime::{Domain, HostStall, MEASURED_FOR, RigName, Timeouts, WakeLateness};

use crate::Error;
use crate::kept_folder::{DOCTOR, LEARNT, absolute};
use crate::saved_rig_file::{MACHINE, RIG, keep_copy};

/// Where the phases of the loops come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum PhaseSource {
    /// The rig file
    #[default]
    File,
    /// How late loops wake on this computer, measured before the processes start
    Measured,
}

/// What to bring up.
#[derive(Clone, Debug)]
pub struct UpOptions {
    /// Name of the rig: its shared memory, its processes.
    pub rig_name: RigName,
    /// Rig file: a path, or the name of a shipped one.
    pub rig: PathBuf,
    /// The card; `None` for that of the rig file, without which it is an error.
    pub card: Option<CardOptions>,
    /// Effects in the plant of the simulated card that no model is told of (`ID[@SITE][=SIZE]`).
    pub effects: Vec<String>,
    /// Rig file of the machine that the simulated card simulates, where it is not `rig`: a path,
    /// or the name of a shipped one. No model is told of it.
    pub machine: Option<PathBuf>,
    /// Records from the start into this file.
    pub record: Option<PathBuf>,
    /// Serves the console's pages at this address; `None` for a rig without a console.
    pub console: Option<SocketAddr>,
    /// Runs the declared model beside the machine.
    pub monitor: bool,
    /// Timing profile; `None` for that of `FARREACH_PROFILE`, or else the one that suits the
    /// measured stalls of the host.
    pub profile: Option<Profile>,
    /// Binds each loop to a processor that the keeper chooses; `FARREACH_PLACEMENT=on` does the
    /// same.
    pub placement: bool,
    /// Where the phases of the loops come from.
    pub phases: PhaseSource,
    /// The `farreach` binary, which every process runs.
    pub executable: PathBuf,
}

/// A rig that is up.
#[derive(Clone, Debug)]
pub struct Up {
    /// What the launcher says of it.
    pub running: launch::Running,
    /// The rig file, as it was checked.
    pub rig: RigFile,
    /// The copy of it that all processes read.
    pub rig_file: PathBuf,
    /// The card behind acquisition.
    pub card: CardKind,
    /// Timing profile of the rig.
    pub profile: Profile,
    /// Measured stalls of the host; `None` if the profile was chosen by a person.
    pub host_stall: Option<HostStall>,
    /// How late bare loops woke, where the phases were chosen by it.
    pub lateness: Option<WakeLateness>,
    /// The session, drawn at this start.
    pub session: u64,
}

/// Brings a rig up: all is checked before anything starts, and when something does not come up, all
/// is stopped again and its shared memory removed. Returns when all processes are ready.
///
/// # Errors
/// What is wrong with the files or the card, or why a process did not come up.
pub fn up(options: &UpOptions) -> Result<Up, Error> {
    let prepared = Prepared::new(options)?;
    let running = launch::start(prepared.config.clone()).map_err(|error| prepared.failed(error))?;
    let domain = Domain::observe(&options.rig_name)?;
    Ok(Up {
        running,
        rig: prepared.rig,
        rig_file: prepared.rig_file,
        card: prepared.card,
        profile: domain.profile(),
        host_stall: domain.host_stall(),
        lateness: prepared.lateness,
        session: domain.session(),
    })
}

/// Brings a rig up and supervises it in this very process, until a signal or [`crate::down`] ends
/// it. `begin` is told the rig file and the card when all is checked, before the first process
/// starts.
///
/// # Errors
/// As [`up`].
pub fn up_in_foreground(
    options: &UpOptions,
    begin: impl FnOnce(&RigFile, CardKind),
) -> Result<StopReport, Error> {
    let mut prepared = Prepared::new(options)?;
    begin(&prepared.rig, prepared.card);
    prepared.config.foreground = true;
    let report =
        launch::supervise(prepared.config.clone()).map_err(|error| prepared.failed(error))?;
    options.rig_name.remove()?;
    Ok(report)
}

/// Checked, and written down in the run directory; nothing runs yet.
struct Prepared {
    config: Config,
    rig_name: RigName,
    rig: RigFile,
    rig_file: PathBuf,
    card: CardKind,
    lateness: Option<WakeLateness>,
}

/// The card that was asked for, or that of the rig file.
fn card_of(asked: Option<&CardOptions>, rig: &RigFile) -> Result<CardOptions, Error> {
    let of_rig = || rig.card.map(CardOptions::of);
    asked.cloned().or_else(of_rig).ok_or(Error::NoCard)
}

/// The machine that is simulated, checked against the rig file that all others read.
fn machine_of(options: &UpOptions, rig: &RigFile) -> Result<Option<RigFile>, Error> {
    let Some(asked) = &options.machine else { return Ok(None) };
    let machine = rig::load_rig(asked)?;
    let told = |rig: &RigFile| {
        let units: Vec<&str> = rig.axes.iter().map(|axis| axis.unit.symbol()).collect();
        let rates = rig.rates;
        format!(
            "axes in {}, acquired at {} Hz and controlled at {} Hz",
            units.join(", "),
            rates.acquisition_hz,
            rates.control_hz
        )
    };
    let (expected, found) = (told(rig), told(&machine));
    if expected != found {
        let file = machine.file_name().to_owned();
        return Err(Error::Machine { file, expected, found });
    }
    Ok(Some(machine))
}

impl Prepared {
    fn new(options: &UpOptions) -> Result<Self, Error> {
        let (rig, lateness) = phased(rig::load_rig(&options.rig)?, options.phases)?;
        let card = &card_of(options.card.as_ref(), &rig)?;
        let machine = machine_of(options, &rig)?;
        if card.kind == CardKind::Simulated {
            // what the simulator process does with it; the line's life does not matter here
            let line_ns = Timeouts::of(Profile::BestEffort).enable_line_ns;
            simulator::Card::new(machine.as_ref().unwrap_or(&rig), &options.effects, line_ns)?;
        }
        let _checked = card.open(&rig)?;
        let profile = profile_of(options, card.kind, &rig)?;
        options.rig_name.make_directory()?;
        let run_dir = options.rig_name.run_directory();
        make_private(&run_dir)?;
        let rig_file = keep_copy(&run_dir, &options.rig, &rig)?;
        let mut config = config_of(options, card, profile, &run_dir, &rig_file)?;
        let machine = match (&options.machine, &machine) {
            (Some(asked), Some(machine)) => absolute(&keep_copy(&run_dir, asked, machine)?)?,
            _ => String::new(),
        };
        config = config.with_environment(MACHINE, machine);
        let (rig_name, card) = (options.rig_name.clone(), card.kind);
        Ok(Self { config, rig_name, rig, rig_file, card, lateness })
    }

    /// The launcher stopped what it had started; what is left of the rig is its directory.
    fn failed(&self, error: launch::Error) -> Error {
        if !matches!(error, launch::Error::AlreadyUp { .. } | launch::Error::OtherSettings { .. }) {
            // The failure is the news; what could not be removed, the next start removes.
            let _removed = self.rig_name.remove();
        }
        error.into()
    }
}

/// The rig with the phases that were asked for, and the lateness that they rest on where it was
/// measured.
fn phased(rig: RigFile, source: PhaseSource) -> Result<(RigFile, Option<WakeLateness>), Error> {
    if source == PhaseSource::File {
        return Ok((rig, None));
    }
    let measured = WakeLateness::measure(MEASURED_FOR);
    let lateness = measured.map_err(|error| Error::Lateness(error.to_string()))?;
    let phases = rig::Phases::for_lateness(&rig.rates, lateness.p99_ns);
    Ok((rig.with_phases(&phases)?, Some(lateness)))
}

/// The profile that was asked for, or the one that the rates need; `None` where the keeper is to
/// choose by the stalls of the host.
fn profile_of(
    options: &UpOptions,
    card: CardKind,
    rig: &RigFile,
) -> Result<Option<Profile>, Error> {
    let chosen = options.profile.or_else(realtime::chosen_profile);
    // A rig without outputs is armed in no profile.
    let missed = rig.missed_timeout(Profile::Realtime);
    let Some(missed) = missed.filter(|_| card.capabilities().accepts_output) else {
        return Ok(chosen);
    };
    let file = rig.file_name().to_owned();
    if card.capabilities().real || chosen == Some(Profile::Realtime) {
        return Err(Error::TooSlow { file, missed });
    }
    Ok(Some(Profile::BestEffort))
}

fn make_private(run_dir: &Path) -> Result<(), Error> {
    use std::os::unix::fs::DirBuilderExt;
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(run_dir).map_err(|source| {
        Error::Io { doing: "make the run directory", path: run_dir.to_path_buf(), source }
    })
}

fn config_of(
    options: &UpOptions,
    card: &CardOptions,
    profile: Option<Profile>,
    run_dir: &Path,
    rig_file: &Path,
) -> Result<Config, Error> {
    // Every variable is set, if only to nothing: those of the caller's shell must not get in.
    let path = |path: &Option<PathBuf>| path.as_deref().map_or_else(|| Ok(String::new()), absolute);
    let placed = if options.placement || placement_is_on() { "on" } else { "off" };
    let variables = [
        (RIG, absolute(rig_file)?),
        ("FARREACH_CARD", card.kind.text().to_owned()),
        ("FARREACH_REPLAY", path(&card.replay)?),
        ("FARREACH_REPLAY_LOOP", card.looped.to_string()),
        ("FARREACH_EFFECTS", options.effects.join(",")),
        ("FARREACH_RECORD", path(&options.record)?),
        ("FARREACH_CONSOLE", options.console.map_or_else(String::new, |at| at.to_string())),
        (LEARNT.variable, LEARNT.path_text()?),
        (DOCTOR.variable, DOCTOR.path_text()?),
        (PLACEMENT_VARIABLE, placed.to_owned()),
        (PROFILE_VARIABLE, profile.map_or_else(String::new, |it| it.text().to_owned())),
    ];
    let console = options.console.and_then(|_| Process::Console.entry());
    let monitor = options.monitor.then(|| Process::Monitor.entry()).flatten();
    let config = Config::new(options.rig_name.as_str(), run_dir, &options.executable)
        .with_processes(processes_with(card.kind).chain(console).chain(monitor));
    Ok(variables
        .into_iter()
        .fold(config, |config, (name, value)| config.with_environment(name, value)))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    fn options(card: Option<CardOptions>) -> UpOptions {
        UpOptions {
            rig_name: format!("up-{}", std::process::id()).parse().unwrap(),
            rig: "hydrostatic".into(),
            card,
            effects: Vec::new(),
            machine: None,
            record: Some("run.mcap".into()),
            console: None,
            monitor: false,
            profile: Some(Profile::BestEffort),
            placement: false,
            phases: PhaseSource::File,
            executable: "/bin/farreach".into(),
        }
    }

    fn replay(record: &str) -> CardOptions {
        CardOptions { kind: CardKind::Replay, replay: Some(record.into()), looped: true }
    }

    #[test]
    fn nothing_is_made_for_what_cannot_come_up() {
        let simulated = Some(CardOptions::of(CardKind::Simulated));
        let wrong = [
            options(None),
            UpOptions { effects: vec!["gremlins".to_owned()], ..options(simulated.clone()) },
            options(Some(replay("/nowhere/record.csv"))),
            UpOptions { rig: "/nowhere/rig.toml".into(), ..options(simulated) },
        ];
        for wrong in wrong {
            let error = up(&wrong).unwrap_err();
            let expected = if wrong.card.is_none() { crate::USAGE } else { crate::FAILED };
            assert_eq!(error.exit_code(), expected, "{error}");
            assert!(!wrong.rig_name.directory().exists(), "{error}");
        }
    }

    #[test]
    fn the_rig_file_names_the_card_where_no_option_does() {
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        assert!(matches!(card_of(None, &rig), Err(Error::NoCard)));
        let text = format!("card = \"null\"\n{}", rig.text());
        let rig = RigFile::parse(&text, "rig.toml").unwrap();
        assert_eq!(card_of(None, &rig).unwrap(), CardOptions::of(CardKind::Null));
        let simulated = CardOptions::of(CardKind::Simulated);
        assert_eq!(card_of(Some(&simulated), &rig).unwrap(), simulated);
    }

    #[test]
    fn measured_phases_stand_in_the_rig_file_of_all_processes() {
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let (same, lateness) = phased(rig.clone(), PhaseSource::File).unwrap();
        assert_eq!((same.identity(), lateness), (rig.identity(), None));
        let (other, lateness) = phased(rig.clone(), PhaseSource::Measured).unwrap();
        let p99_ns = lateness.unwrap().p99_ns;
        assert_eq!(other.phases, rig::Phases::for_lateness(&rig.rates, p99_ns));
        assert_eq!(RigFile::parse(other.text(), "again.toml").unwrap().phases, other.phases);
    }

    #[test]
    fn rates_that_are_too_low_for_the_realtime_profile_need_the_other() {
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let mut slow = rig.clone();
        slow.rates.control_hz = 125;
        let of = |profile, kind, rig: &RigFile| {
            let options = UpOptions { profile, ..options(Some(CardOptions::of(kind))) };
            profile_of(&options, kind, rig).map_err(|error| error.to_string())
        };
        let (realtime, simulated) = (Some(Profile::Realtime), CardKind::Simulated);
        assert_eq!(of(realtime, simulated, &rig), Ok(realtime));
        assert_eq!(of(None, CardKind::Null, &slow), of(None, CardKind::Null, &rig));
        assert_eq!(of(Some(Profile::BestEffort), simulated, &slow), Ok(Some(Profile::BestEffort)));
        let refused = "rates.control_hz is too low for the profile realtime: commands at the gate \
                       of at most 4.88 ms, found 7.88 ms; raise the rate, or bring a simulated \
                       card up in the profile best-effort (--profile best-effort)";
        let refused = format!("{}: {refused}", slow.file_name());
        assert_eq!(of(realtime, simulated, &slow), Err(refused.clone()));
        assert_eq!(of(None, CardKind::Comedi, &slow), Err(refused));
    }

    #[test]
    fn the_environment_is_whole_and_absolute() {
        let card = replay("record.csv");
        let options = options(Some(card.clone()));
        let config_of = |options: &UpOptions| {
            let (run, rig) = (Path::new("/run"), Path::new("/run/rig.toml"));
            config_of(options, &card, Some(Profile::BestEffort), run, rig).unwrap()
        };
        let config = config_of(&options);
        assert!(config.units.iter().all(|unit| unit.name != "simulator"));
        let here = std::env::current_dir().unwrap();
        assert_eq!(
            config.environment["FARREACH_REPLAY"],
            here.join("record.csv").to_str().unwrap()
        );
        assert_eq!(config.environment["FARREACH_RECORD"], here.join("run.mcap").to_str().unwrap());
        assert_eq!(config.environment["FARREACH_REPLAY_LOOP"], "true");
        assert_eq!(config.environment["FARREACH_EFFECTS"], "");
        assert_eq!(config.environment["FARREACH_CONSOLE"], "");
        assert!(config.units.iter().all(|unit| unit.name != "console"));
        let options = UpOptions { console: Some("127.0.0.1:8321".parse().unwrap()), ..options };
        let config = config_of(&options);
        assert_eq!(config.environment["FARREACH_CONSOLE"], "127.0.0.1:8321");
        assert!(config.units.iter().any(|unit| unit.name == "console"));
        assert_eq!(config.environment["FARREACH_PROFILE"], "best-effort");
        assert_eq!(config.environment["FARREACH_PLACEMENT"], "off");
        assert!(config.environment.contains_key("FARREACH_DOCTOR"));
    }
}
