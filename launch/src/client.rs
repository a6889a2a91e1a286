//! The calls of the command line: `start`, `stop`, `status`, `restart`; those on a rig that systemd
//! supervises go to [`crate::systemd`].

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::Signal;

use crate::control_socket::{Answer, Request, send};
use crate::status::{RigState, Status, StopReport, UnitState};
use crate::supervisor::{Supervisor, prepare};
use crate::{Config, Error, Leftover, ProcessIdentity, RunDir, StartError, log, process, systemd};

/// Time after which a launcher that does not answer counts as hung (s).
const ANSWER_SECONDS: u64 = 5;
/// Polling period of `start`.
const POLL_PERIOD: Duration = Duration::from_millis(10);

/// A rig that is up.
#[derive(Clone, Debug, PartialEq)]
pub struct Running {
    /// Its directory, absolute.
    pub run_dir: PathBuf,
    /// Its launcher's process.
    pub launcher: ProcessIdentity,
    /// Status when all units had become ready.
    pub status: Status,
}

/// Starts the launcher as a process in a session of its own and waits until all units are ready.
///
/// Processes that outlived an earlier launcher of this directory are adopted if they were started
/// with the same configuration. Ignores `config.foreground`; see [`crate::supervise`].
///
/// # Errors
/// If the rig is already up, processes with other settings are alive, or a unit cannot be brought
/// up: then all is stopped, and the error contains the end of its log.
pub fn start(mut config: Config) -> Result<Running, Error> {
    config.foreground = false;
    let config = config.checked()?;
    let run_dir = RunDir::new(&config.run_dir);
    let lock = prepare(&config, &run_dir)?;
    let output = log::open(&run_dir.launcher_log())?;
    let errors = output
        .try_clone()
        .map_err(|source| Error::io("open the log", &run_dir.launcher_log(), source))?;
    let mut command = Command::new(&config.executable);
    command
        .args(["service", "launcher", "--run-dir"])
        .arg(run_dir.path())
        .current_dir("/")
        .stdin(Stdio::from(lock))
        .stdout(output)
        .stderr(errors);
    // SAFETY: setsid is one system call; it neither allocates nor locks.
    unsafe {
        command.pre_exec(|| {
            rustix::process::setsid()?;
            Ok(())
        });
    }
    let mut child =
        command.spawn().map_err(|source| Error::io("start", &config.executable, source))?;
    drop(command);
    // Reaps the launcher, so that a caller that outlives the rig keeps no zombie.
    let (sender, ended) = mpsc::channel();
    std::thread::Builder::new()
        .name("launcher-reaper".to_owned())
        .spawn(move || {
            let _ = sender.send(child.wait());
        })
        .map_err(|source| Error::system("start a thread", source))?;
    wait_until_up(&run_dir, &ended)
}

fn wait_until_up(
    run_dir: &RunDir,
    ended: &mpsc::Receiver<std::io::Result<ExitStatus>>,
) -> Result<Running, Error> {
    loop {
        let outcome = ended.recv_timeout(POLL_PERIOD);
        if let Ok(status) = outcome {
            return Err(why_it_ended(run_dir, status));
        }
        let Ok(Some(status)) = run_dir.last_status() else { continue };
        // The status of an earlier launcher may say `up` as well, but that launcher is dead.
        if status.state == RigState::Up && status.launcher.is_alive() {
            return Ok(Running {
                run_dir: run_dir.path().to_path_buf(),
                launcher: status.launcher,
                status,
            });
        }
    }
}

fn why_it_ended(run_dir: &RunDir, status: std::io::Result<ExitStatus>) -> Error {
    let cause: Option<StartError> = run_dir.read_json(&run_dir.failure_json()).ok().flatten();
    let _ = std::fs::remove_file(run_dir.failure_json());
    match cause {
        Some(cause) => cause.into(),
        None => {
            let exit = status.map_or_else(|error| error.to_string(), |status| status.to_string());
            let tail = log::tail(&run_dir.launcher_log(), 20);
            let log = run_dir.launcher_log();
            let message = format!("{exit}. Last lines of {}:\n{tail}", log.display());
            StartError::Launcher(message).into()
        }
    }
}

/// Returns the status of the rig in this directory. If the launcher is dead, the rig is `abandoned`
/// and its living processes are `unsupervised`.
///
/// # Errors
/// [`Error::NotUp`] if there is neither a launcher nor a living process.
pub fn status(run_dir: &Path) -> Result<Status, Error> {
    let directory = RunDir::new(run_dir);
    if let Some(rig) = systemd::rig_of(&directory) {
        return systemd::status(&rig);
    }
    let not_up = || Error::NotUp { run_dir: run_dir.to_path_buf() };
    let mut status = directory.last_status()?.ok_or_else(not_up)?;
    if status.launcher.is_alive() {
        return Ok(status);
    }
    status.state = RigState::Abandoned;
    for unit in &mut status.units {
        unit.process = unit.process.filter(ProcessIdentity::is_alive);
        unit.state =
            if unit.process.is_some() { UnitState::Unsupervised } else { UnitState::Inactive };
    }
    if status.units.iter().all(|unit| unit.process.is_none()) {
        return Err(not_up());
    }
    Ok(status)
}

/// Stops all units in the reverse of their start order, and the launcher. If the launcher is dead
/// or hangs, this process stops the living processes, which it finds by pid and start time.
///
/// # Errors
/// [`Error::NotUp`] if there is nothing to stop.
pub fn stop(run_dir: &Path) -> Result<StopReport, Error> {
    let path = std::path::absolute(run_dir)
        .map_err(|source| Error::io("make absolute", run_dir, source))?;
    let directory = RunDir::new(path);
    if let Some(rig) = systemd::rig_of(&directory) {
        return systemd::stop(&rig);
    }
    if directory.is_held()? {
        match ask_to_stop(&directory) {
            Ok(report) => return Ok(report),
            Err(Error::Silent { launcher, .. }) => {
                // A hung launcher stops nothing, and the motor must not wait for it.
                launcher.signal(Signal::KILL);
            }
            // It may have ended meanwhile.
            Err(_) => {}
        }
    }
    let not_up = || Error::NotUp { run_dir: run_dir.to_path_buf() };
    if !directory.path().is_dir() {
        return Err(not_up());
    }
    let until = Instant::now() + Duration::from_secs(ANSWER_SECONDS);
    let lock = loop {
        match directory.lock()? {
            Some(lock) => break lock,
            None if Instant::now() < until => {}
            None => return Err(directory.already_up("of this directory")),
        }
    };
    let leftovers = process::leftovers(&directory)?;
    if leftovers.is_empty() {
        directory.clean();
        return Err(not_up());
    }
    let cause = "a request to stop, the launcher being dead";
    match directory.config() {
        Ok(Some(config)) => Supervisor::open(config, &directory, lock.into())?.stop_now(cause),
        _ => Ok(kill_leftovers(&directory, leftovers, cause)),
    }
}

/// Kills processes whose units are unknown, and with them their stop order and timeouts: last
/// started first.
fn kill_leftovers(directory: &RunDir, leftovers: Vec<Leftover>, cause: &str) -> StopReport {
    let status = directory.last_status().ok().flatten();
    let strays: Vec<ProcessIdentity> =
        leftovers.into_iter().rev().map(|leftover| leftover.process).collect();
    for process in &strays {
        process.signal(Signal::KILL);
    }
    directory.clean();
    StopReport {
        rig_name: status.map_or_else(String::new, |status| status.rig_name),
        cause: cause.to_owned(),
        units: Vec::new(),
        strays,
    }
}

fn ask_to_stop(directory: &RunDir) -> Result<StopReport, Error> {
    let mut connection = Connection::open(directory)?;
    match connection.ask(&Request::Stop)? {
        Answer::Done => {}
        other => return Err(unexpected(&other)),
    }
    // A stop takes as long as the units take, but the launcher updates its status meanwhile: one
    // that does not hangs.
    let updated = || directory.last_status().ok().flatten().map(|status| status.updated_unix_ms);
    let mut before = updated();
    let report = loop {
        match connection.receive("go on with the stop") {
            Ok(Answer::Stopped { report }) => break report,
            Ok(other) => return Err(unexpected(&other)),
            Err(Error::Silent { .. }) if updated() != before => before = updated(),
            Err(error) => return Err(error),
        }
    };
    // The launcher still holds the lock: a start right after this needs it gone.
    connection.wait_until_gone();
    Ok(report)
}

/// Sets variables for every process that starts from now on, and restarts these units: a rig goes
/// on with another rig file while its card stays as it is.
///
/// # Errors
/// If there is no launcher or no such unit, the rig is not up, or `launch.json` cannot be written.
/// Nothing is then changed.
pub fn change(
    run_dir: &Path,
    environment: BTreeMap<String, String>,
    units: &[String],
) -> Result<(), Error> {
    let directory = RunDir::new(run_dir);
    if systemd::rig_of(&directory).is_some() {
        return systemd::change(&directory, environment, units);
    }
    ask(run_dir, &Request::Change { environment, units: units.to_vec() })
}

/// Restarts one unit, also one that had been given up.
///
/// # Errors
/// If there is no launcher or no such unit, or the rig is not up.
pub fn restart(run_dir: &Path, unit: &str) -> Result<(), Error> {
    if let Some(rig) = systemd::rig_of(&RunDir::new(run_dir)) {
        return systemd::restart(&rig, unit);
    }
    ask(run_dir, &Request::Restart { unit: unit.to_owned() })
}

/// Runs a program of others in place of a unit's own, with the same environment, or the unit's own
/// again where `command` is empty. `command` has an absolute path first.
///
/// # Errors
/// As [`restart`]; under systemd, whose units a person edits.
pub fn replace(run_dir: &Path, unit: &str, command: &[String]) -> Result<(), Error> {
    if let Some(rig) = systemd::rig_of(&RunDir::new(run_dir)) {
        let unit = systemd::unit(&rig, unit);
        return Err(Error::Refused {
            reason: format!(
                "systemd runs this rig: `systemctl edit {unit}` with an empty ExecStart= and one \
                 with your program, then `systemctl restart {unit}`"
            ),
        });
    }
    ask(run_dir, &Request::Replace { unit: unit.to_owned(), command: command.to_vec() })
}

/// Asks the launcher for something that it does, or refuses.
fn ask(run_dir: &Path, request: &Request) -> Result<(), Error> {
    let directory = RunDir::new(run_dir);
    if !directory.is_held()? {
        return Err(Error::NotUp { run_dir: run_dir.to_path_buf() });
    }
    match Connection::open(&directory)?.ask(request)? {
        Answer::Done => Ok(()),
        other => Err(unexpected(&other)),
    }
}

fn unexpected(answer: &Answer) -> Error {
    Error::Refused {
        reason: match answer {
            Answer::Refused { reason } => reason.clone(),
            other => format!("unexpected answer: {other:?}"),
        },
    }
}

struct Connection {
    stream: BufReader<UnixStream>,
    /// The part of the next line received so far.
    line: String,
    launcher: ProcessIdentity,
    socket: PathBuf,
}

impl Connection {
    fn open(directory: &RunDir) -> Result<Self, Error> {
        let socket = directory.control_socket();
        let text = std::fs::read_to_string(directory.launcher_pid())
            .map_err(|source| Error::io("read", &directory.launcher_pid(), source))?;
        let mut numbers = text.split_whitespace();
        let launcher = (|| {
            Some(ProcessIdentity {
                pid: numbers.next()?.parse().ok()?,
                start_time: numbers.next()?.parse().ok()?,
            })
        })()
        .ok_or_else(|| Error::File {
            path: directory.launcher_pid(),
            message: format!("found `{}`, expected pid and start time", text.trim()),
        })?;
        let stream = UnixStream::connect(&socket)
            .map_err(|source| Error::io("connect to", &socket, source))?;
        Ok(Self { stream: BufReader::new(stream), line: String::new(), launcher, socket })
    }

    fn ask(&mut self, request: &Request) -> Result<Answer, Error> {
        send(self.stream.get_mut(), request)
            .map_err(|source| Error::io("write to", &self.socket, source))?;
        self.receive("answer")
    }

    /// The next answer; may be called again after [`Error::Silent`].
    fn receive(&mut self, what: &'static str) -> Result<Answer, Error> {
        let patience = Duration::from_secs(ANSWER_SECONDS);
        let fail = |source| Error::io("read from", &self.socket, source);
        self.stream.get_ref().set_read_timeout(Some(patience)).map_err(fail)?;
        match self.stream.read_line(&mut self.line) {
            Ok(_) => {
                let line = std::mem::take(&mut self.line);
                serde_json::from_str(&line).map_err(|error| Error::File {
                    path: self.socket.clone(),
                    message: format!("`{line}`: {error}"),
                })
            }
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {
                Err(Error::Silent { launcher: self.launcher, what, seconds: patience.as_secs() })
            }
            Err(error) => Err(fail(error)),
        }
    }

    fn wait_until_gone(&self) {
        let Some(handle) = self.launcher.open() else { return };
        let timeout = Timespec::try_from(Duration::from_secs(ANSWER_SECONDS)).ok();
        let _ = poll(&mut [PollFd::new(&handle, PollFlags::IN)], timeout.as_ref());
    }
}
