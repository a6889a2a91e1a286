//! The process of a unit, started or adopted, and held by a pidfd so that a recycled pid is never
//! signalled.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, Stdio};

use rustix::process::{Pid, PidfdFlags, Signal, kill_process_group, pidfd_open, pidfd_send_signal};

use crate::lifecycle::Exit;
use crate::units::Unit;
use crate::{Config, Error, Leftover, ProcessIdentity, RunDir, log, scheduling};

/// Set in every process's environment: they identify a process of the rig that is in no status.
const UNIT_VARIABLE: &str = "FARREACH_UNIT";
const SOCKET_VARIABLE: &str = "NOTIFY_SOCKET";

pub(crate) struct Process {
    pub(crate) identity: ProcessIdentity,
    handle: OwnedFd,
    child: Option<Child>,
}

impl Process {
    /// Starts the process of a unit with its log, limits and scheduling class, in a process group
    /// of its own.
    pub(crate) fn start(unit: &Unit, config: &Config, run_dir: &RunDir) -> Result<Self, Error> {
        let log_path = run_dir.log(&unit.name);
        let _ = log::rotate(&log_path, log::LIMIT);
        let output = log::open(&log_path)?;
        let errors =
            output.try_clone().map_err(|source| Error::io("open the log", &log_path, source))?;
        let (program, arguments) = config.command(&unit.name);
        let mut command = Command::new(&program);
        command
            .args(arguments)
            .envs(environment(unit, config, run_dir))
            .env_remove("WATCHDOG_PID")
            .current_dir("/")
            .stdin(Stdio::null())
            .stdout(output)
            .stderr(errors)
            // Ctrl-C at a terminal must reach the launcher alone, which stops the units in order.
            .process_group(0);
        let own = unit.clone();
        // SAFETY: `request` makes system calls on numbers in the unit; it neither allocates nor
        // locks.
        unsafe {
            command.pre_exec(move || {
                scheduling::request(&own);
                Ok(())
            });
        }
        let child = command.spawn().map_err(|source| Error::io("start", &program, source))?;
        let pid = i32::try_from(child.id()).unwrap_or(i32::MAX);
        if let Some(score) = unit.oom_score_adjust {
            // Lowering it needs CAP_SYS_RESOURCE; a refusal is in the status.
            let _ = fs::write(format!("/proc/{pid}/oom_score_adj"), score.to_string());
        }
        // The child is not reaped before `exit`, so its pid is its own until then.
        match Self::of_child(pid) {
            Ok((identity, handle)) => Ok(Self { identity, handle, child: Some(child) }),
            Err(error) => {
                let mut child = child;
                let _ = child.kill();
                let _ = child.wait();
                Err(error)
            }
        }
    }

    fn of_child(pid: i32) -> Result<(ProcessIdentity, OwnedFd), Error> {
        let raw = Pid::from_raw(pid)
            .ok_or_else(|| Error::system("read a pid", io::Error::other("pid 0")))?;
        let handle = pidfd_open(raw, PidfdFlags::NONBLOCK).map_err(|source| {
            Error::system("open a pidfd (Linux 5.10 or later is needed)", source)
        })?;
        // A child that has already ended is a zombie without identity; its handle shows the end.
        let identity = ProcessIdentity::of(pid).unwrap_or(ProcessIdentity { pid, start_time: 0 });
        Ok((identity, handle))
    }

    /// Adopts a living process; `None` if it has ended.
    pub(crate) fn adopt(identity: ProcessIdentity) -> Option<Self> {
        Some(Self { identity, handle: identity.open()?, child: None })
    }

    /// Readable once the process has ended.
    pub(crate) fn handle(&self) -> BorrowedFd<'_> {
        self.handle.as_fd()
    }

    /// Sends SIGTERM, and SIGCONT so that a stopped process can act on it.
    pub(crate) fn ask_to_stop(&self) {
        let _ = pidfd_send_signal(&self.handle, Signal::TERM);
        let _ = pidfd_send_signal(&self.handle, Signal::CONT);
    }

    pub(crate) fn kill(&self) {
        let _ = pidfd_send_signal(&self.handle, Signal::KILL);
    }

    /// Reaps the process and kills what it left in its process group. Call once
    /// [`Process::handle`] is readable.
    pub(crate) fn exit(self) -> Exit {
        let Some(mut child) = self.child else { return Exit::Unknown };
        if let Some(group) = Pid::from_raw(self.identity.pid) {
            // Before the child is reaped: until then its pid and group cannot be reused.
            let _ = kill_process_group(group, Signal::KILL);
        }
        match child.wait() {
            Ok(status) => match (status.code(), status.signal()) {
                (Some(code), _) => Exit::Code(code),
                (None, Some(signal)) => Exit::Signal(signal),
                (None, None) => Exit::Unknown,
            },
            Err(_) => Exit::Unknown,
        }
    }
}

/// The variables of a process; those of the configuration go before the rig's name and directory.
fn environment(unit: &Unit, config: &Config, run_dir: &RunDir) -> BTreeMap<String, OsString> {
    let directory = || OsString::from(run_dir.path());
    let rig = [
        ("FARREACH_RIG_NAME", OsString::from(&config.rig_name)),
        ("FARREACH_RUN_DIR", directory()),
    ];
    let given = config.environment.iter().map(|(name, value)| (name.as_str(), value.into()));
    let own = [
        ("RUNTIME_DIRECTORY", directory()),
        ("WATCHDOG_USEC", unit.watchdog.as_micros().to_string().into()),
        (SOCKET_VARIABLE, run_dir.notify_socket().into()),
        (UNIT_VARIABLE, OsString::from(&unit.name)),
    ];
    let all = rig.into_iter().chain(given).chain(own);
    all.map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Living processes of this rig by their environment, with their units; also those whose launcher
/// died before it wrote them down.
pub(crate) fn find(run_dir: &RunDir) -> Vec<(String, ProcessIdentity)> {
    let mut socket = format!("{SOCKET_VARIABLE}=").into_bytes();
    socket.extend(run_dir.notify_socket().as_os_str().as_bytes());
    let own = i32::try_from(std::process::id()).unwrap_or(0);
    let mut found = Vec::new();
    let Ok(entries) = fs::read_dir("/proc") else { return found };
    for pid in entries.flatten().filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok())
    {
        let Some(identity) = ProcessIdentity::of(pid).filter(|identity| identity.pid != own) else {
            continue;
        };
        // Other users' processes cannot be read, and are not ours.
        let Ok(environment) = fs::read(format!("/proc/{pid}/environ")) else { continue };
        let mut variables = environment.split(|byte| *byte == 0);
        if !variables.clone().any(|variable| variable == socket) {
            continue;
        }
        let prefix = format!("{UNIT_VARIABLE}=");
        let unit = variables.find_map(|variable| variable.strip_prefix(prefix.as_bytes()));
        if let Some(unit) = unit {
            found.push((String::from_utf8_lossy(unit).into_owned(), identity));
        }
    }
    found
}

/// Living processes of a rig whose launcher is dead: those in its last status, and any that it
/// started without writing it down.
pub(crate) fn leftovers(run_dir: &RunDir) -> Result<Vec<Leftover>, Error> {
    let units = run_dir.last_status()?.into_iter().flat_map(|status| status.units);
    let mut found: Vec<Leftover> = units
        .filter_map(|unit| {
            let process = unit.process.filter(ProcessIdentity::is_alive)?;
            Some(Leftover { unit: unit.name, process })
        })
        .collect();
    for (unit, process) in find(run_dir) {
        if !found.iter().any(|leftover| leftover.process == process) {
            found.push(Leftover { unit, process });
        }
    }
    Ok(found)
}
