//! Restarting a process of a rig that is up, or putting a program of others in its place.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use ipc_types::{Process, WatchdogState};
use launch::{ProcessIdentity, UnitState};
use runtime::RigName;

use crate::Error;

/// How long the processes may take to be ready again.
const RESTART_LIMIT: Duration = Duration::from_secs(15);
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// State and process of some units, in their order.
type Units = Vec<(UnitState, Option<ProcessIdentity>)>;

/// Present state and process of these units.
pub(crate) fn processes(status: &launch::Status, units: &[String]) -> Units {
    let of_unit = |name: &String| status.unit(name).map(|unit| (unit.state, unit.process));
    units.iter().filter_map(of_unit).collect()
}

/// Waits until these units, whose processes were `old`, are ready again with other processes.
///
/// # Errors
/// [`Error::NotRestarted`] after 15 s; where the rig is not up.
pub(crate) fn until_ready_again(
    run_dir: &Path,
    units: &[String],
    old: &Units,
) -> Result<(), Error> {
    let begun = Instant::now();
    loop {
        let now = processes(&launch::status(run_dir)?, units);
        let again = now.len() == old.len()
            && now.iter().zip(old).all(|((state, process), (_, before))| {
                *state == UnitState::Ready && process != before
            });
        if again {
            return Ok(());
        }
        if begun.elapsed() > RESTART_LIMIT {
            return Err(Error::NotRestarted { units: units.join(", ") });
        }
        std::thread::sleep(POLL_PERIOD);
    }
}

/// Restarts a process, and waits until it is ready again. Returns how long that took.
///
/// # Errors
/// [`Error::MotorEnabled`] unless `force`, where the process's absence cuts the motor's power;
/// where there is no such process, the rig is not up, or it does not become ready.
pub fn restart(rig: &RigName, process: &str, force: bool) -> Result<Duration, Error> {
    go_on(rig, process, force, |run_dir| launch::restart(run_dir, process))
}

/// Runs a program of others in place of a process, or farreach's own again where `command` is
/// empty, and waits until it is ready. Returns how long that took. What it has to do stands in
/// `docs/replacing.md`.
///
/// # Errors
/// As [`restart`]; [`Error::Program`] where the program cannot be run; for the keeper, which holds
/// the rig's shared memory; where systemd runs the rig.
pub fn replace(
    rig: &RigName,
    process: &str,
    command: &[String],
    force: bool,
) -> Result<Duration, Error> {
    if process == Process::Keeper.text() {
        return Err(Error::KeeperStays);
    }
    let mut command = command.to_vec();
    if let Some(program) = command.first_mut() {
        *program = program_path(program)?;
    }
    go_on(rig, process, force, |run_dir| launch::replace(run_dir, process, &command))
}

fn go_on(
    rig: &RigName,
    process: &str,
    force: bool,
    act: impl FnOnce(&Path) -> Result<(), launch::Error>,
) -> Result<Duration, Error> {
    let run_dir = rig.run_directory();
    let units = [process.to_owned()];
    let old = processes(&launch::status(&run_dir)?, &units);
    if !force && cuts_power(process) && is_enabled(rig) {
        return Err(Error::MotorEnabled { process: process.to_owned() });
    }
    let begun = Instant::now();
    act(&run_dir)?;
    until_ready_again(&run_dir, &units, &old)?;
    Ok(begun.elapsed())
}

/// Whether the rig trips, or its protocol ends, while the process is away.
fn cuts_power(process: &str) -> bool {
    let found = Process::ALL.iter().find(|one| one.text() == process);
    found.is_some_and(|found| found.real_time().is_some())
}

fn is_enabled(rig: &RigName) -> bool {
    let state = crate::status::status(rig).ok().and_then(|status| status.watchdog);
    state.is_some_and(|watchdog| watchdog.state == WatchdogState::Enabled)
}

/// The absolute path of a program, looked for in PATH where it has no `/`, as a shell does.
fn program_path(program: &str) -> Result<String, Error> {
    let runs = |path: &Path| {
        path.metadata()
            .is_ok_and(|found| found.is_file() && found.permissions().mode() & 0o111 != 0)
    };
    let found = if program.contains('/') {
        std::path::absolute(program).ok().filter(|path| runs(path))
    } else {
        let folders = std::env::var_os("PATH").unwrap_or_default();
        std::env::split_paths(&folders).map(|folder| folder.join(program)).find(|path| runs(path))
    };
    let path: Option<PathBuf> = found;
    path.and_then(|path| path.into_os_string().into_string().ok())
        .ok_or_else(|| Error::Program { program: program.to_owned() })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn programs_are_found_as_by_a_shell() {
        assert!(program_path("sh").unwrap().ends_with("/sh"));
        assert_eq!(program_path("/bin/sh").unwrap(), "/bin/sh");
        for wrong in ["no-such-program", "/etc/passwd", "/bin", "./nothing"] {
            let error = program_path(wrong).unwrap_err().to_string();
            assert!(error.contains(wrong) && error.contains("executable"), "{error}");
        }
    }

    #[test]
    fn the_loops_cut_power_and_the_others_do_not() {
        for process in ["simulator", "acquisition", "control", "watchdog", "experiment"] {
            assert!(cuts_power(process), "{process}");
        }
        for process in ["keeper", "logger", "monitor", "console", "nobody"] {
            assert!(!cuts_power(process), "{process}");
        }
    }
}
