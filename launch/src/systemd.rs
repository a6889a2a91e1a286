//! Rigs that systemd supervises: the same questions and requests as the launcher's, by `systemctl`.
//!
//! The keeper's unit describes the rig in its run directory ([`describe`]), as the launcher would.
//! By that, [`crate::status`], [`crate::stop`], [`crate::restart`] and [`crate::change`] find out
//! whom to ask; their callers need not know.

pub(crate) mod show;

use std::collections::BTreeMap;
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use ipc_types::{PROCESSES, ProcessEntry};
use rustix::process::Signal;

use self::show::Shown;
use crate::identity::has_ended;
use crate::status::{RigState, Status, StopReport, UnitState, UnitStatus, UnitStop, unix_ms};
use crate::{Config, Error, ProcessIdentity, RunDir, Supervision, boot_id};

/// Folder of what systemd makes for each rig (`RuntimeDirectory=` of the keeper's unit). The owner
/// of a rig's folder in it is the user that the rig runs as.
const RUNTIME: &str = "/run/farreach";
/// Folder of what a person wrote for each rig.
const SETTINGS: &str = "/etc/farreach";
/// How long all units may take to stop, one after another: more than the sum of `TimeoutStopSec=`.
const STOP_LIMIT: Duration = Duration::from_secs(90);
/// So often a stop looks which processes have ended.
const POLL_PERIOD: Duration = Duration::from_millis(1);

/// The target of a rig.
pub fn target(rig: &str) -> String {
    format!("farreach@{rig}.target")
}

/// The unit of a process of a rig.
pub fn unit(rig: &str, process: &str) -> String {
    format!("farreach-{process}@{rig}.service")
}

/// The folder that is there while systemd runs the rig.
pub fn runtime_directory(rig: &str) -> PathBuf {
    Path::new(RUNTIME).join(rig)
}

/// Whether a person has installed a rig of that name: its `environment` is there.
pub fn is_installed(rig: &str) -> bool {
    Path::new(SETTINGS).join(rig).join("environment").exists()
}

/// The name of the rig, if the run directory describes one that systemd supervises.
pub(crate) fn rig_of(run_dir: &RunDir) -> Option<String> {
    let config = run_dir.config().ok().flatten()?;
    (config.supervision == Supervision::Systemd).then_some(config.rig_name)
}

/// Leaves in the run directory what the launcher would leave, for clients, and passes the variables
/// on to the units that start from now on. For the keeper, before it is ready: all other units
/// start after it.
///
/// # Errors
/// If a file cannot be written.
pub fn describe(config: Config) -> Result<(), Error> {
    let config = Config { supervision: Supervision::Systemd, ..config }.checked()?;
    let run_dir = RunDir::new(&config.run_dir);
    pass_on(&config)?;
    run_dir.write_json(&run_dir.launch_json(), &config)
}

/// Writes the variables where the unit files read them (`EnvironmentFile=`).
fn pass_on(config: &Config) -> Result<(), Error> {
    let path = runtime_directory(&config.rig_name).join("environment");
    let text = environment_file(&config.environment);
    files::replace(&path, text).map_err(|source| Error::io("write", &path, source))
}

/// Variables in the syntax of `EnvironmentFile=`.
fn environment_file(variables: &BTreeMap<String, String>) -> String {
    let quoted = |value: &str| {
        let escape = |character| match character {
            '"' | '\\' | '$' | '`' => format!("\\{character}"),
            _ => character.to_string(),
        };
        value.chars().map(escape).collect::<String>()
    };
    variables.iter().map(|(name, value)| format!("{name}=\"{}\"\n", quoted(value))).collect()
}

/// Starts all units of a rig and waits until they are ready.
///
/// # Errors
/// [`Error::NotPermitted`], or [`Error::Systemctl`] with the units that did not come up.
pub fn start(rig: &str) -> Result<Status, Error> {
    manage("start", &target(rig))?;
    let status = status(rig)?;
    let failed = status.units.iter().filter(|unit| unit.state != UnitState::Ready);
    let failed: Vec<String> = failed.map(|of| unit(rig, &of.name)).collect();
    if failed.is_empty() {
        return Ok(status);
    }
    Err(Error::Systemctl {
        command: format!("systemctl start {}", target(rig)),
        message: format!(
            "not ready: {}; `journalctl -u {}` tells why",
            failed.join(", "),
            failed.join(" -u ")
        ),
    })
}

/// The status of a rig.
///
/// # Errors
/// [`Error::NotUp`] if no process of it lives, [`Error::Systemctl`] if systemd cannot be asked.
pub(crate) fn status(rig: &str) -> Result<Status, Error> {
    let (target, shown) = show(rig)?;
    let now_us = now_us();
    let now_ms = unix_ms();
    let wall =
        |monotonic_us: u64| now_ms.saturating_sub(now_us.saturating_sub(monotonic_us) / 1000);
    let units: Vec<UnitStatus> = shown
        .iter()
        .filter(|(entry, shown)| belongs(entry, shown))
        .map(|(entry, shown)| UnitStatus {
            name: entry.name().to_owned(),
            state: shown.state(),
            process: ProcessIdentity::of(shown.pid),
            adopted: false,
            since_unix_ms: wall(shown.changed_us),
            restarts: shown.restarts,
            last_exit: shown.exit(),
            restart_reason: None,
            scheduling: None,
            replaced_by: None,
            status_text: shown.status_text.clone(),
            log: PathBuf::new(),
        })
        .collect();
    if units.iter().all(|unit| matches!(unit.state, UnitState::Inactive | UnitState::Failed)) {
        return Err(Error::NotUp { run_dir: runtime_directory(rig) });
    }
    Ok(Status {
        rig_name: rig.to_owned(),
        supervision: Supervision::Systemd,
        state: state_of(&target, &units),
        cause: None,
        launcher: ProcessIdentity { pid: 1, start_time: 0 },
        boot_id: boot_id(),
        since_unix_ms: wall(target.changed_us),
        updated_unix_ms: now_ms,
        units,
    })
}

/// Whether a unit is one of this rig: one that is not wanted by every rig counts once it was
/// started.
fn belongs(entry: &ProcessEntry, shown: &Shown) -> bool {
    let on_every_rig = !entry.optional && entry.card.is_none();
    on_every_rig || shown.state() != UnitState::Inactive
}

fn state_of(target: &Shown, units: &[UnitStatus]) -> RigState {
    let any = |state: UnitState| units.iter().any(|unit| unit.state == state);
    match target.state() {
        UnitState::Ready => RigState::Up,
        _ if any(UnitState::Stopping) || any(UnitState::Killing) => RigState::Stopping,
        _ if any(UnitState::Starting) || any(UnitState::Inactive) => RigState::Starting,
        // Started one by one, without their target.
        _ => RigState::Up,
    }
}

/// Stops all units of a rig, the watchdog first; the order is in the unit files.
///
/// # Errors
/// [`Error::NotUp`], or [`Error::NotPermitted`] with what root is to enter.
pub fn stop(rig: &str) -> Result<StopReport, Error> {
    let before = status(rig)?;
    // systemd forgets a unit that is over, so that it cannot be asked how that was: the processes
    // themselves are watched.
    let handle = |unit: &UnitStatus| Some((unit.name.clone(), unit.process?.open()?));
    let mut alive: Vec<(String, OwnedFd)> = before.units.iter().filter_map(handle).collect();
    let asked = Instant::now();
    let mut units = Vec::new();
    let mut see_the_ended = |alive: &mut Vec<(String, OwnedFd)>| {
        for (name, _) in alive.extract_if(.., |(_, handle)| has_ended(handle)) {
            let took_ms = u64::try_from(asked.elapsed().as_millis()).unwrap_or(u64::MAX);
            let exit = Some("ended".to_owned());
            units.push(UnitStop { name, exit, killed: false, took_ms });
        }
    };
    std::thread::scope(|scope| {
        let request = scope.spawn(|| manage("stop", &target(rig)));
        while !request.is_finished() {
            see_the_ended(&mut alive);
            std::thread::sleep(POLL_PERIOD);
        }
        request.join().unwrap_or_else(|_| {
            Err(Error::system("stop the units", io::Error::other("a thread failed")))
        })
    })?;
    // The target is over before its units are.
    while !alive.is_empty() {
        if asked.elapsed() > STOP_LIMIT {
            let left: Vec<String> = alive.iter().map(|(name, _)| unit(rig, name)).collect();
            return Err(Error::Systemctl {
                command: format!("systemctl stop {}", target(rig)),
                message: format!("still alive after {STOP_LIMIT:?}: {}", left.join(", ")),
            });
        }
        see_the_ended(&mut alive);
        std::thread::sleep(POLL_PERIOD);
    }
    Ok(StopReport {
        rig_name: rig.to_owned(),
        cause: "a request to systemd".to_owned(),
        units,
        strays: Vec::new(),
    })
}

/// Ends the process of a unit; systemd starts it again, as it does after a crash. So the rig's own
/// user may do it.
pub(crate) fn restart(rig: &str, process: &str) -> Result<(), Error> {
    let status = status(rig)?;
    let known = || status.units.iter().map(|unit| unit.name.as_str()).collect::<Vec<_>>();
    let Some(found) = status.unit(process) else {
        let reason = format!("no unit `{process}`; there are: {}", known().join(", "));
        return Err(Error::Refused { reason });
    };
    match found.process {
        Some(running) if running.signal(Signal::KILL) => Ok(()),
        _ => manage("restart", &unit(rig, process)),
    }
}

/// Changes variables for every unit that starts from now on, and restarts these.
pub(crate) fn change(
    run_dir: &RunDir,
    environment: BTreeMap<String, String>,
    units: &[String],
) -> Result<(), Error> {
    let not_up = || Error::NotUp { run_dir: run_dir.path().to_path_buf() };
    let mut config = run_dir.config()?.ok_or_else(not_up)?;
    let rig = config.rig_name.clone();
    let status = status(&rig)?;
    config.environment.extend(environment);
    describe(config)?;
    let mut running = units.iter().filter(|name| status.unit(name).is_some());
    running.try_for_each(|name| restart(&rig, name))
}

/// Each process with what `systemctl show` says of its unit.
type ShownUnits = Vec<(&'static ProcessEntry, Shown)>;

/// What `systemctl show` says of the target and of the unit of each process.
fn show(rig: &str) -> Result<(Shown, ShownUnits), Error> {
    let units: Vec<String> = PROCESSES.iter().map(|entry| unit(rig, entry.name())).collect();
    let mut command = systemctl(&["show"]);
    command.arg(format!("--property={}", show::PROPERTIES)).arg("--").arg(target(rig)).args(&units);
    let text = output(command)?;
    let mut blocks = show::parse(&text);
    let mut of = |name: &str| blocks.remove(name).unwrap_or_default();
    let target = of(&target(rig));
    Ok((target, PROCESSES.iter().zip(&units).map(|(entry, name)| (entry, of(name))).collect()))
}

/// Starts, stops or restarts a unit: as this user, which root and those whom polkit names may, or
/// else as sudo's rules allow.
fn manage(verb: &str, unit: &str) -> Result<(), Error> {
    let refusal = match output(systemctl(&[verb, unit])) {
        Ok(_) => return Ok(()),
        Err(error) if rustix::process::geteuid().is_root() => return Err(error),
        Err(error) => error,
    };
    let mut sudo = Command::new("sudo");
    sudo.args(["-n", "systemctl", verb, unit]);
    if output(sudo).is_ok() {
        return Ok(());
    }
    match refusal {
        Error::Systemctl { message, .. } => {
            Err(Error::NotPermitted { command: format!("systemctl {verb} {unit}"), message })
        }
        other => Err(other),
    }
}

fn systemctl(arguments: &[&str]) -> Command {
    let mut command = Command::new("systemctl");
    command.args(["--no-ask-password", "--no-pager"]).args(arguments).env("LC_ALL", "C");
    command
}

/// Runs a command; its standard output.
fn output(mut command: Command) -> Result<String, Error> {
    let text = format!("{command:?}").replace('"', "");
    let failed = |message: String| Error::Systemctl { command: text.clone(), message };
    let found = command.stdin(Stdio::null()).output().map_err(|error| failed(error.to_string()))?;
    if found.status.success() {
        return Ok(String::from_utf8_lossy(&found.stdout).into_owned());
    }
    let said = String::from_utf8_lossy(&found.stderr);
    Err(failed(said.trim().lines().next().unwrap_or("it said nothing").to_owned()))
}

/// `CLOCK_MONOTONIC`, in µs, by which systemd tells when something happened.
fn now_us() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000
        + u64::try_from(now.tv_nsec).unwrap_or(0) / 1000
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_quoted_for_systemd() {
        let variables = [("A", "plain"), ("B", "a \"b\" $c \\d `e`"), ("C", "")];
        let variables = variables.map(|(name, value)| (name.to_owned(), value.to_owned())).into();
        assert_eq!(
            environment_file(&variables),
            "A=\"plain\"\nB=\"a \\\"b\\\" \\$c \\\\d \\`e\\`\"\nC=\"\"\n"
        );
    }

    #[test]
    fn a_run_directory_of_the_launcher_is_not_systemds() {
        let directory = tempfile::tempdir().unwrap();
        let run_dir = RunDir::new(directory.path());
        assert_eq!(rig_of(&run_dir), None);
        let mut config = Config::new("bench", directory.path(), "/bin/true");
        run_dir.write_json(&run_dir.launch_json(), &config).unwrap();
        assert_eq!(rig_of(&run_dir), None);
        config.supervision = Supervision::Systemd;
        run_dir.write_json(&run_dir.launch_json(), &config).unwrap();
        assert_eq!(rig_of(&run_dir).as_deref(), Some("bench"));
        std::fs::write(run_dir.launch_json(), "{").unwrap();
        assert_eq!(rig_of(&run_dir), None);
    }
}
