//! Bringing a rig down, in whatever state it is.

use std::sync::mpsc;
use std::time::Duration;

use ipc_types::{Verb, VerbAnswer};
use launch::StopReport;
use runtime::RigName;

use crate::systemd_rig::{self, OtherUser};
use crate::{Error, RigLink};

/// How long the watchdog may take to answer, and joining the rig may take. A hung process must not
/// delay the stop, and stopping the watchdog removes motor power anyway.
const DISARM_LIMIT: Duration = Duration::from_millis(500);
const JOIN_LIMIT: Duration = Duration::from_secs(2);

/// Whether the rig's shared memory was removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cleaning {
    /// It was removed.
    Removed,
    /// It was left in place for a living process of the rig that the launcher did not start.
    InUse,
}

/// What [`down`] did.
#[derive(Clone, Debug)]
pub struct Down {
    /// Whether the watchdog disarmed; `None` when it could not be asked.
    pub disarmed: Option<bool>,
    /// What was stopped; `None` when nothing ran.
    pub stopped: Option<StopReport>,
    /// Whether the shared memory was removed.
    pub cleaning: Cleaning,
}

/// Brings a rig down: the watchdog removes motor power, the launcher stops all processes in order
/// (killing those that hang), and the shared memory is removed. Also works if the launcher is dead
/// or nothing runs.
///
/// # Errors
/// If a process cannot be stopped or the shared memory cannot be removed.
pub fn down(name: &RigName) -> Result<Down, Error> {
    if let Some(other) = OtherUser::of(name) {
        return down_of(name, other);
    }
    let run_dir = name.run_directory();
    let disarmed = if launch::status(&run_dir).is_ok() { disarm(name) } else { None };
    let stopped = match launch::stop(&run_dir) {
        Ok(report) => Some(report),
        Err(launch::Error::NotUp { .. }) => None,
        Err(error) => return Err(not_stopped(disarmed, error)),
    };
    let cleaning = if name.remove()? { Cleaning::Removed } else { Cleaning::InUse };
    Ok(Down { disarmed, stopped, cleaning })
}

/// The same for a rig that systemd runs as another user.
fn down_of(name: &RigName, other: OtherUser) -> Result<Down, Error> {
    let disarmed = other.disarm(name);
    let stopped = match launch::systemd::stop(name.as_str()) {
        Ok(report) => Some(report),
        Err(launch::Error::NotUp { .. }) => None,
        Err(error) => return Err(not_stopped(disarmed, error)),
    };
    let gone = systemd_rig::is_gone(name, other.user);
    Ok(Down { disarmed, stopped, cleaning: if gone { Cleaning::Removed } else { Cleaning::InUse } })
}

/// systemd may refuse to stop the processes after the watchdog has done its part.
fn not_stopped(disarmed: Option<bool>, error: launch::Error) -> Error {
    match error {
        launch::Error::NotPermitted { .. } => {
            Error::NotStopped { disarmed: disarmed == Some(true), refusal: error }
        }
        other => other.into(),
    }
}

/// Disarms on a thread of its own: with a hung process in the rig, joining it may hang as well.
fn disarm(name: &RigName) -> Option<bool> {
    let (sender, answer) = mpsc::channel();
    let name = name.clone();
    std::thread::Builder::new()
        .name("disarm".to_owned())
        .spawn(move || {
            let asked =
                RigLink::open(&name).and_then(|link| link.verb_within(Verb::Disarm, DISARM_LIMIT));
            // The receiver is gone if this took too long.
            let _sent = sender.send(asked.ok());
        })
        .ok()?;
    let answer: VerbAnswer = answer.recv_timeout(JOIN_LIMIT).ok()??;
    Some(answer.done)
}
