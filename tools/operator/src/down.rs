//! Bringing a rig down, in whatever state it is.

use std::sync::mpsc;
use std::time::Duration;

use ipc_types::{Verb, VerbAnswer};
use launch::StopReport;
use runtime::RigName;

use crate::{Error, RigLink};

/// How long the watchdog may take to answer, and how long the way to it may take. A hung process
/// must not keep the rig from being stopped, and stopping the watchdog takes the motor's power away
/// all the same.
const DISARM_LIMIT: Duration = Duration::from_millis(500);
const JOIN_LIMIT: Duration = Duration::from_secs(2);

/// What became of the rig's shared memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cleaning {
    /// It is gone.
    Removed,
    /// Somebody still uses it (a probe); the next start cleans up.
    InUse,
}

/// What was done.
#[derive(Clone, Debug)]
pub struct Down {
    /// Whether the watchdog disarmed; `None` when it could not be asked.
    pub disarmed: Option<bool>,
    /// What was stopped; `None` when nothing ran.
    pub stopped: Option<StopReport>,
    /// What became of the shared memory.
    pub cleaning: Cleaning,
}

/// Brings a rig down: the watchdog takes the motor's power away, the launcher stops all processes
/// in order (killing those that hang), the shared memory is removed. Works also when the launcher
/// is dead, and when nothing runs.
///
/// # Errors
/// When something lives that cannot be stopped, or the shared memory cannot be removed.
pub fn down(name: &RigName) -> Result<Down, Error> {
    let run_dir = name.run_directory();
    let disarmed = if launch::status(&run_dir).is_ok() { disarm(name) } else { None };
    let stopped = match launch::stop(&run_dir) {
        Ok(report) => Some(report),
        Err(launch::Error::NotUp { .. }) => None,
        Err(error) => return Err(error.into()),
    };
    let cleaning = if name.remove()? { Cleaning::Removed } else { Cleaning::InUse };
    Ok(Down { disarmed, stopped, cleaning })
}

/// Asks on a thread of its own: with a hung process in the rig, joining it may hang as well.
fn disarm(name: &RigName) -> Option<bool> {
    let (sender, answer) = mpsc::channel();
    let name = name.clone();
    std::thread::Builder::new()
        .name("disarm".to_owned())
        .spawn(move || {
            let asked =
                RigLink::open(&name).and_then(|link| link.verb_within(Verb::Disarm, DISARM_LIMIT));
            // Nobody listens any more when it took too long.
            let _told = sender.send(asked.ok());
        })
        .ok()?;
    let answer: VerbAnswer = answer.recv_timeout(JOIN_LIMIT).ok()??;
    Some(answer.done)
}
