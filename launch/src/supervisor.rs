//! The launcher's loop: carries out the actions of the [`Lifecycle`] and reports events to it.

mod report;
mod requests;

use std::fs::File;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::Signal;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::control_socket::ControlServer;
use crate::identity::has_ended;
use crate::lifecycle::{Action, Lifecycle};
use crate::log::{self, Journal};
use crate::notify::{Notification, NotifySocket};
use crate::process::{self, Process};
use crate::status::{RigState, Status, StopReport, UnitState, UnitStatus, UnitStop, unix_ms};
use crate::units::Unit;
use crate::{Config, Error, ProcessIdentity, RunDir, Scheduling, StartError, Supervision, boot_id};

/// `status.json` is written at least this often.
const STATUS_PERIOD: Duration = Duration::from_millis(200);
/// Log lengths are checked this often.
const ROTATE_PERIOD: Duration = Duration::from_secs(1);

/// Body of `service launcher --run-dir DIR`: reads `launch.json` of that directory and supervises
/// until stopped.
///
/// # Errors
/// As [`supervise`]; the cause is also left in `failure.json` for [`crate::start`].
pub fn launcher_main(run_dir: &Path) -> Result<(), Error> {
    let run_dir = RunDir::new(
        std::path::absolute(run_dir)
            .map_err(|source| Error::io("make absolute", run_dir, source))?,
    );
    let lock = match run_dir.inherited_lock()? {
        Some(lock) => lock,
        None => run_dir.lock()?.ok_or_else(|| run_dir.already_up("of this directory"))?.into(),
    };
    let supervised = || {
        let config = run_dir
            .config()?
            .ok_or_else(|| Error::NotUp { run_dir: run_dir.path().to_path_buf() })?;
        Supervisor::open(config, &run_dir, lock)?.until_stopped()
    };
    supervised().map(|_| ()).inspect_err(|error| {
        let cause = match error {
            Error::Start(cause) => cause.clone(),
            other => StartError::Launcher(other.to_string()),
        };
        // If it cannot be written, `start` shows the log instead.
        let _ = run_dir.write_json(&run_dir.failure_json(), &cause);
    })
}

/// Launches in this process and supervises until a signal (`SIGTERM`, `SIGINT`, `SIGHUP`) or
/// [`crate::stop`] ends it. For `up --foreground`; [`crate::start`] uses a process of its own.
///
/// # Errors
/// If the rig is already up, or a unit cannot be brought up: then all is stopped.
pub fn supervise(config: Config) -> Result<StopReport, Error> {
    let config = config.checked()?;
    let run_dir = RunDir::new(&config.run_dir);
    let lock = prepare(&config, &run_dir)?;
    Supervisor::open(config, &run_dir, lock.into())?.until_stopped()
}

/// Locks the run directory, checks for living processes, and writes `launch.json`.
pub(crate) fn prepare(config: &Config, run_dir: &RunDir) -> Result<File, Error> {
    run_dir.create()?;
    let lock = run_dir.lock()?.ok_or_else(|| run_dir.already_up(&config.rig_name))?;
    let leftovers = process::leftovers(run_dir)?;
    let same = run_dir.config()?.is_some_and(|earlier| config.same_processes(&earlier));
    if !leftovers.is_empty() && !same {
        return Err(Error::OtherSettings { rig: config.rig_name.clone(), leftovers });
    }
    if leftovers.is_empty() {
        let _ = std::fs::remove_file(run_dir.status_json());
    }
    let _ = std::fs::remove_file(run_dir.failure_json());
    run_dir.write_json(&run_dir.launch_json(), config)?;
    Ok(lock)
}

pub(crate) struct Supervisor {
    config: Config,
    run_dir: RunDir,
    /// Held for as long as this lives.
    _lock: OwnedFd,
    origin: Instant,
    lifecycle: Lifecycle,
    /// As it is written; its units are those of the configuration.
    status: Status,
    /// By unit.
    processes: Vec<Option<Process>>,
    notify: NotifySocket,
    control: ControlServer,
    journal: Journal,
    /// Whether it was asked to stop before all units had been ready.
    aborted: bool,
    stopped: Vec<UnitStop>,
    strays: Vec<ProcessIdentity>,
    written: Option<Duration>,
    status_unwritten: bool,
    rotated: Duration,
}

impl Supervisor {
    /// Opens the sockets and adopts the processes that an earlier launcher left alive.
    pub(crate) fn open(config: Config, run_dir: &RunDir, lock: OwnedFd) -> Result<Self, Error> {
        let identity = ProcessIdentity::own().ok_or_else(|| {
            Error::system("read /proc/self/stat", std::io::Error::other("/proc is not there"))
        })?;
        let pid_line = format!("{} {}\n", identity.pid, identity.start_time);
        run_dir.write(&run_dir.launcher_pid(), pid_line.as_bytes())?;
        let mut supervisor = Self {
            lifecycle: Lifecycle::new(&config.units),
            status: Status {
                rig_name: config.rig_name.clone(),
                supervision: Supervision::Launcher,
                state: RigState::Starting,
                cause: None,
                launcher: identity,
                boot_id: boot_id(),
                since_unix_ms: unix_ms(),
                updated_unix_ms: unix_ms(),
                units: {
                    let unit = |unit: &Unit| inactive(&unit.name, &config, run_dir);
                    config.units.iter().map(unit).collect()
                },
            },
            processes: config.units.iter().map(|_| None).collect(),
            notify: NotifySocket::bind(&run_dir.notify_socket())?,
            control: ControlServer::bind(&run_dir.control_socket())?,
            journal: Journal::new(run_dir.launcher_log(), config.foreground)?,
            config,
            run_dir: run_dir.clone(),
            _lock: lock,
            origin: Instant::now(),
            aborted: false,
            stopped: Vec::new(),
            strays: Vec::new(),
            written: None,
            status_unwritten: false,
            rotated: Duration::ZERO,
        };
        let greeting = format!("launcher of rig {}, {identity}", supervisor.config.rig_name);
        supervisor.journal.say(&greeting);
        supervisor.adopt()?;
        supervisor.write_status();
        Ok(supervisor)
    }

    /// Runs until all is stopped. Signals that ask to end stop all first.
    pub(crate) fn until_stopped(self) -> Result<StopReport, Error> {
        let (reader, writer) =
            UnixStream::pair().map_err(|source| Error::system("make a socket pair", source))?;
        for stream in [&reader, &writer] {
            stream
                .set_nonblocking(true)
                .map_err(|source| Error::system("set up a socket pair", source))?;
        }
        let mut registered = Vec::new();
        for signal in [SIGTERM, SIGINT, SIGHUP] {
            let writer =
                writer.try_clone().map_err(|source| Error::system("copy a socket", source))?;
            let id = signal_hook::low_level::pipe::register(signal, writer)
                .map_err(|source| Error::system("listen for signals", source))?;
            registered.push(id);
        }
        let outcome = self.run(Some(&reader));
        for id in registered {
            signal_hook::low_level::unregister(id);
        }
        outcome
    }

    /// Stops all and returns; for `stop` without a launcher.
    pub(crate) fn stop_now(mut self, cause: &str) -> Result<StopReport, Error> {
        self.stop_all(cause);
        self.aborted = false;
        self.run(None)
    }

    fn now(&self) -> Duration {
        self.origin.elapsed()
    }

    fn adopt(&mut self) -> Result<(), Error> {
        let now = self.now();
        let earlier = self.run_dir.last_status()?;
        for status in earlier.into_iter().flat_map(|status| status.units) {
            let Some(process) = status.process.and_then(Process::adopt) else { continue };
            let Some(index) = self.index_of(&status.name) else { continue };
            self.lifecycle.adopt(index, status.state == UnitState::Ready, status.restarts, now);
            self.journal.say(&format!("{}: adopted {}", status.name, process.identity));
            let own = &mut self.status.units[index];
            own.scheduling =
                Some(Scheduling::read(&self.config.units[index], process.identity.pid));
            own.adopted = true;
            own.state = self.lifecycle.state(index);
            own.since_unix_ms = status.since_unix_ms;
            own.status_text = status.status_text;
            self.processes[index] = Some(process);
        }
        self.end_strays();
        Ok(())
    }

    fn index_of(&self, name: &str) -> Option<usize> {
        self.config.units.iter().position(|unit| unit.name == name)
    }

    /// Kills processes with this rig's environment that no unit knows.
    fn end_strays(&mut self) {
        for (unit, identity) in process::find(&self.run_dir) {
            let known = self.index_of(&unit).is_some_and(|index| self.processes[index].is_some());
            if !known && identity.signal(Signal::KILL) {
                self.journal.say(&format!("{unit}: {identity} is unknown to the launcher: killed"));
                self.strays.push(identity);
            }
        }
    }

    fn run(mut self, signals: Option<&UnixStream>) -> Result<StopReport, Error> {
        loop {
            let phase = self.lifecycle.phase();
            let now = self.now();
            let actions = self.lifecycle.tick(now);
            let acted = !actions.is_empty();
            for action in actions {
                self.perform(action);
            }
            if self.lifecycle.phase() != phase {
                let phase = self.lifecycle.phase();
                self.journal.say(&format!("rig {}: {phase:?}", self.config.rig_name));
            }
            let changed = self.follow_states() || acted || self.lifecycle.phase() != phase;
            if changed || self.written.is_none_or(|written| self.now() >= written + STATUS_PERIOD) {
                self.write_status();
            }
            if self.lifecycle.phase() == RigState::Down {
                return self.finish();
            }
            if acted {
                // A failed start needs its follow-up at once.
                continue;
            }
            self.wait(signals)?;
            self.receive_signals(signals);
            self.receive_notifications();
            self.reap();
            self.receive_requests();
            if self.now() >= self.rotated + ROTATE_PERIOD {
                self.rotated = self.now();
                for unit in &self.status.units {
                    let _ = log::rotate(&unit.log, log::LIMIT);
                }
            }
        }
    }

    fn perform(&mut self, action: Action) {
        match action {
            Action::Start(index) => {
                let unit = &self.config.units[index];
                let status = &mut self.status.units[index];
                status.adopted = false;
                status.status_text = None;
                match Process::start(unit, &self.config, &self.run_dir) {
                    Ok(process) => {
                        self.journal.say(&format!("{}: started, {}", unit.name, process.identity));
                        status.scheduling = Some(Scheduling::read(unit, process.identity.pid));
                        self.processes[index] = Some(process);
                    }
                    Err(error) => {
                        self.journal.say(&format!("{}: {error}", unit.name));
                        let now = self.now();
                        self.lifecycle.start_refused(index, error.to_string(), now);
                    }
                }
                // At once, so that the successor of a launcher that dies now finds the process.
                self.follow_states();
                self.write_status();
            }
            Action::AskToStop(index) => {
                self.journal.say(&format!("{}: asked to stop", self.config.units[index].name));
                if let Some(process) = &self.processes[index] {
                    process.ask_to_stop();
                }
            }
            Action::Kill(index) => {
                let why = self.lifecycle.reason(index).unwrap_or("it did not stop in time");
                self.journal.say(&format!("{}: killed: {why}", self.config.units[index].name));
                if let Some(process) = &self.processes[index] {
                    process.kill();
                }
            }
        }
    }

    /// Sleeps until an event or the next deadline.
    fn wait(&self, signals: Option<&UnixStream>) -> Result<(), Error> {
        let now = self.now();
        let status_due = self.written.map_or(now, |written| written + STATUS_PERIOD);
        let due =
            self.lifecycle.next_deadline().map_or(status_due, |deadline| deadline.min(status_due));
        // One millisecond more, so that the deadline has passed on waking.
        let left = due.saturating_sub(now) + Duration::from_millis(1);
        let timeout =
            Timespec::try_from(left).unwrap_or(Timespec { tv_sec: 0, tv_nsec: 100_000_000 });
        let mut handles: Vec<PollFd<'_>> = std::iter::once(self.notify.as_fd())
            .chain(signals.map(AsFd::as_fd))
            .chain(self.control.handles())
            .chain(self.processes.iter().flatten().map(Process::handle))
            .map(|handle| PollFd::from_borrowed_fd(handle, PollFlags::IN))
            .collect();
        match poll(&mut handles, Some(&timeout)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
            Err(source) => Err(Error::system("wait for processes", source)),
        }
    }

    fn receive_signals(&mut self, signals: Option<&UnixStream>) {
        let Some(mut signals) = signals else { return };
        let mut bytes = [0u8; 16];
        if std::io::Read::read(&mut signals, &mut bytes).is_ok_and(|count| count > 0) {
            self.stop_all("a signal to the launcher");
        }
    }

    fn receive_notifications(&mut self) {
        while let Some((pid, notifications)) = self.notify.receive() {
            let is_sender = |process: &Process| process.identity.pid == pid;
            let sender = self.processes.iter().position(|of| of.as_ref().is_some_and(is_sender));
            // NotifyAccess=main: messages of other processes are ignored.
            let Some(index) = sender else { continue };
            let now = self.now();
            for notification in notifications {
                match notification {
                    Notification::Ready => {
                        self.lifecycle.ready(index, now);
                        self.status.units[index].scheduling =
                            Some(Scheduling::read(&self.config.units[index], pid));
                    }
                    Notification::KeepAlive => {
                        self.lifecycle.ping(index, self.status.units[index].adopted, now)
                    }
                    Notification::Status(text) => self.status.units[index].status_text = Some(text),
                }
            }
        }
    }

    fn reap(&mut self) {
        for index in 0..self.processes.len() {
            let ended = |process: &mut Process| has_ended(process.handle());
            let Some(process) = self.processes[index].take_if(ended) else { continue };
            let exit = process.exit();
            let now = self.now();
            self.lifecycle.exited(index, exit, now);
            let unit = &mut self.status.units[index];
            unit.last_exit = Some(exit.to_string());
            unit.scheduling = None;
            unit.adopted = false;
            self.journal.say(&format!("{}: ended: {exit}", unit.name));
            if self.lifecycle.phase() == RigState::Stopping {
                let (asked, killed) = self.lifecycle.stop_of(index).unwrap_or((now, false));
                self.stopped.push(UnitStop {
                    name: unit.name.clone(),
                    exit: Some(exit.to_string()),
                    killed,
                    took_ms: u64::try_from(now.saturating_sub(asked).as_millis())
                        .unwrap_or(u64::MAX),
                });
            }
        }
    }

    fn stop_all(&mut self, cause: &str) {
        if self.status.cause.is_none() {
            self.journal.say(&format!("stopping: {cause}"));
            self.status.cause = Some(cause.to_owned());
            self.aborted |= self.lifecycle.phase() == RigState::Starting;
        }
        self.lifecycle.stop_all();
    }
}

/// The status of a unit that has not been started.
fn inactive(name: &str, config: &Config, run_dir: &RunDir) -> UnitStatus {
    UnitStatus {
        name: name.to_owned(),
        state: UnitState::Inactive,
        process: None,
        adopted: false,
        since_unix_ms: unix_ms(),
        restarts: 0,
        last_exit: None,
        restart_reason: None,
        scheduling: None,
        replaced_by: config.replaced.get(name).map(|command| command.join(" ")),
        status_text: None,
        log: run_dir.log(name),
    }
}
