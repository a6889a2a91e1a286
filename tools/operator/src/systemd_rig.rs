//! Rigs that systemd runs: their description for clients, and the user whom clients must be.

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use ipc_types::{CardKind, Process, processes_with};
use launch::{Config, RunDir, Supervision, systemd};
use runtime::RigName;

use crate::Error;
use crate::saved_rig_file::{RIG, keep_copy};

/// Variables of the processes begin with this.
const PREFIX: &str = "FARREACH_";
/// Those that differ by unit, or are of the unit files.
const NOT_PASSED_ON: [&str; 4] =
    ["FARREACH_RIG_NAME", "FARREACH_RUN_DIR", "FARREACH_LEARNT", "FARREACH_SYSTEMD"];

/// Leaves in the run directory what `up` leaves elsewhere, from this process's variables: the copy
/// of the rig file that all processes read, and what was started. For the keeper's unit, before it
/// is ready. A keeper that comes back to a session that runs (not `cold`) changes nothing: the rig
/// goes on with what it was started with.
///
/// # Errors
/// What is wrong with the rig file or the variables, or if a file cannot be written.
pub fn describe_to_clients(name: &RigName, cold: bool) -> Result<(), Error> {
    let run_dir = name.make_run_directory()?;
    if !cold && RunDir::new(&run_dir).launch_json().exists() {
        return Ok(());
    }
    let passed_on =
        |name: &String| name.starts_with(PREFIX) && !NOT_PASSED_ON.contains(&name.as_str());
    let mut variables: BTreeMap<String, String> = std::env::vars_os()
        .filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)))
        .filter(|(name, _)| passed_on(name))
        .collect();
    let asked = PathBuf::from(variables.get(RIG).ok_or(Error::NoVariable { name: RIG })?);
    let rig = rig::load_rig(&asked)?;
    let copy = crate::kept_folder::absolute(&keep_copy(&run_dir, &asked, &rig)?)?;
    variables.insert(RIG.to_owned(), copy);
    let card = variables.get("FARREACH_CARD").map_or("", String::as_str);
    let card = acquisition::DRIVERS.iter().map(|driver| driver.kind).find(|of| of.text() == card);
    let optional = [Process::Console, Process::Monitor].into_iter().filter_map(Process::entry);
    let config = Config {
        environment: variables,
        supervision: Supervision::Systemd,
        ..Config::new(name.as_str(), run_dir, executable()?)
    };
    let config =
        config.with_processes(processes_with(card.unwrap_or(CardKind::Simulated)).chain(optional));
    Ok(systemd::describe(config)?)
}

fn executable() -> Result<PathBuf, Error> {
    std::env::current_exe().map_err(|source| Error::Io {
        doing: "find the executable",
        path: PathBuf::from("/proc/self/exe"),
        source,
    })
}

/// The user of a rig that systemd runs, and that is not this user's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct OtherUser {
    /// User id.
    pub(crate) user: u32,
    group: u32,
}

impl OtherUser {
    /// The user of the rig of that name; `None` where this user has a rig of that name, or where
    /// systemd runs none.
    pub(crate) fn of(name: &RigName) -> Option<Self> {
        if name.directory().exists() {
            return None;
        }
        let found = systemd::runtime_directory(name.as_str()).metadata().ok()?;
        let own = rustix::process::geteuid().as_raw();
        (found.uid() != own).then_some(Self { user: found.uid(), group: found.gid() })
    }

    /// This program with other arguments, as that user: root becomes that user, others ask sudo,
    /// whose rules say who may.
    fn command<I, S>(self, arguments: I) -> Result<Command, Error>
    where
        I: IntoIterator<Item = S>,
        S: AsRef<OsStr>,
    {
        let program = executable()?;
        let mut command = if rustix::process::geteuid().is_root() {
            let mut command = Command::new(program);
            command.uid(self.user).gid(self.group);
            command
        } else {
            let mut command = Command::new("sudo");
            command.args(["-n", "-u", &format!("#{}", self.user), "--"]).arg(program);
            command
        };
        command.args(arguments);
        Ok(command)
    }

    /// Whether the watchdog disarmed; `None` if it could not be asked.
    pub(crate) fn disarm(self, name: &RigName) -> Option<bool> {
        let arguments = ["--rig-name", name.as_str(), "disarm"];
        let mut command = self.command(arguments).ok()?;
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().ok().map(|status| status.success())
    }
}

/// Becomes the user of a rig that systemd runs: its shared memory is open to that user alone. This
/// program is started again with the same arguments, and this function does not return. Does
/// nothing where the rig is this user's own, or where systemd runs no rig of that name.
///
/// # Errors
/// [`Error::NotItsUser`] where that is not allowed.
pub fn become_its_user(name: &RigName) -> Result<(), Error> {
    let Some(other) = OtherUser::of(name) else { return Ok(()) };
    let given: Vec<OsString> = std::env::args_os().skip(1).collect();
    let refused =
        |reason: String| Error::NotItsUser { rig: name.to_string(), user: other.user, reason };
    if !rustix::process::geteuid().is_root() {
        // sudo itself would say in its own words that it wants a password.
        let mut asked = other.command(["--version"])?;
        match asked.stdin(Stdio::null()).stdout(Stdio::null()).output() {
            Ok(output) if output.status.success() => {}
            Ok(output) => {
                let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
                return Err(refused(said));
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                return Err(refused("there is no sudo".to_owned()));
            }
            Err(error) => return Err(refused(format!("sudo: {error}"))),
        }
    }
    let error = other.command(with_name(name, given))?.exec();
    Err(refused(error.to_string()))
}

/// sudo does not pass FARREACH_RIG_NAME on: the name becomes an argument.
fn with_name(name: &RigName, given: Vec<OsString>) -> Vec<OsString> {
    const OPTION: &str = "--rig-name";
    let is_option = |text: &OsString| {
        text.to_str().is_some_and(|text| {
            text.strip_prefix(OPTION).is_some_and(|rest| rest.is_empty() || rest.starts_with('='))
        })
    };
    if given.iter().any(is_option) {
        return given;
    }
    let name: [OsString; 2] = [OPTION.into(), name.as_str().into()];
    name.into_iter().chain(given).collect()
}

/// Whether the shared memory of that user's rig is gone.
pub(crate) fn is_gone(name: &RigName, user: u32) -> bool {
    !name.directory_of(user).exists()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn the_name_of_the_rig_is_passed_on_once() {
        let name: RigName = "bench".parse().unwrap();
        let with = |given: &[&str]| {
            let given = given.iter().map(OsString::from).collect();
            with_name(&name, given).join(OsStr::new(" ")).into_string().unwrap()
        };
        assert_eq!(with(&["status", "--json"]), "--rig-name bench status --json");
        assert_eq!(with(&["status", "--rig-name", "bench"]), "status --rig-name bench");
        assert_eq!(with(&["--rig-name=bench", "status"]), "--rig-name=bench status");
    }

    #[test]
    fn a_rig_that_systemd_does_not_run_has_no_other_user() {
        let name: RigName = format!("none-{}", std::process::id()).parse().unwrap();
        assert_eq!(OtherUser::of(&name), None);
        assert!(become_its_user(&name).is_ok());
    }
}
