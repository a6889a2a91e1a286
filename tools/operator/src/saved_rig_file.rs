//! The rig file that a rig runs with.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use ipc_types::{PROCESSES, Process};
use launch::RunDir;
use rig::RigFile;
use runtime::RigName;

use crate::Error;
use crate::up::absolute;

/// How long the processes may take to be ready again.
const RESTART_LIMIT: Duration = Duration::from_secs(15);
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// Variable with the rig file of all processes.
pub(crate) const RIG: &str = "FARREACH_RIG";
/// Variable with that of the machine that is simulated; empty where it is the same.
pub(crate) const MACHINE: &str = "FARREACH_MACHINE";

/// Puts the text of a rig file into the run directory. All processes read that copy, also those
/// that are started again hours later, so that a rig runs with one file however its original is
/// edited. Its identity stands in its name: a rig file with other contents is another setting,
/// which the launcher sees.
pub(crate) fn keep_copy(run_dir: &Path, asked: &Path, rig: &RigFile) -> Result<PathBuf, Error> {
    let stem = asked.file_stem().and_then(|stem| stem.to_str()).unwrap_or("rig");
    let path = run_dir.join(format!("{stem}.{:016x}.toml", rig.identity()));
    match files::replace(&path, rig.text()) {
        Ok(()) => Ok(path),
        Err(source) => Err(Error::Io { doing: "write", path, source }),
    }
}

/// What a rig that is up was started with.
///
/// # Errors
/// [`Error::NotUp`] where there is none.
pub fn running(name: &RigName) -> Result<launch::Config, Error> {
    let path = RunDir::new(name.run_directory()).launch_json();
    let text = match fs::read(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Err(Error::NotUp(name.to_string()));
        }
        Err(source) => return Err(Error::Io { doing: "read", path, source }),
    };
    serde_json::from_slice(&text)
        .map_err(|error| Error::Launched { path, reason: error.to_string() })
}

/// The rig file of a rig that is up.
///
/// # Errors
/// [`Error::NotUp`], or what is wrong with the file.
pub fn rig_of(name: &RigName) -> Result<RigFile, Error> {
    let environment: BTreeMap<String, String> = running(name)?.environment;
    match environment.get(RIG) {
        Some(path) => Ok(RigFile::load(path)?),
        None => Err(Error::Launched {
            path: RunDir::new(name.run_directory()).launch_json(),
            reason: format!("expected {RIG} among the variables"),
        }),
    }
}

/// Whether a process reads anything of a rig file that may change while the rig is up: gains,
/// options of the control, the declared model. What the others read, a change must leave as it is.
fn reads_model(process: Process) -> bool {
    match process {
        Process::Control
        | Process::Experiment
        | Process::Monitor
        | Process::Logger
        | Process::Console => true,
        Process::Keeper
        | Process::Simulator
        | Process::Acquisition
        | Process::Watchdog
        | Process::Launcher
        | Process::Operator => false,
    }
}

/// Has a rig that is up go on with another rig file, which may differ in gains, options of the
/// control and the declared model: the processes that read these are restarted, the card and with
/// it the homed positions stay. A simulated machine stays what it was. The motor must be without
/// power. `name` names the file for people. Returns when they are ready again.
///
/// # Errors
/// [`Error::RigFileDiffers`] where it differs in anything else; where the rig is not up.
pub fn change_rig_file(rig_name: &RigName, name: &Path, rig: &RigFile) -> Result<(), Error> {
    let config = running(rig_name)?;
    let before = rig_of(rig_name)?;
    if let Some(part) = other_part(&before, rig) {
        return Err(Error::RigFileDiffers { file: rig.file_name().to_owned(), part });
    }
    let run_dir = rig_name.run_directory();
    let path = absolute(&keep_copy(&run_dir, name, rig)?)?;
    let mut variables = BTreeMap::from([(RIG.to_owned(), path)]);
    let was = |name: &str| config.environment.get(name).cloned().unwrap_or_default();
    let simulated = config.units.iter().any(|unit| unit.name == Process::Simulator.text());
    if simulated && was(MACHINE).is_empty() {
        variables.insert(MACHINE.to_owned(), was(RIG));
    }
    let reading = PROCESSES.iter().map(|entry| entry.process).filter(|own| reads_model(*own));
    let units: Vec<String> = reading
        .map(|process| process.text().to_owned())
        .filter(|name| config.units.iter().any(|unit| unit.name == *name))
        .collect();
    let processes = |status: &launch::Status| -> Vec<(launch::UnitState, Option<_>)> {
        let of_unit = |name: &String| status.unit(name).map(|unit| (unit.state, unit.process));
        units.iter().filter_map(of_unit).collect()
    };
    let old = processes(&launch::status(&run_dir)?);
    launch::change(&run_dir, variables, &units)?;
    let begun = Instant::now();
    loop {
        let now = processes(&launch::status(&run_dir)?);
        let again = now.len() == old.len()
            && now.iter().zip(&old).all(|((state, process), (_, before))| {
                *state == launch::UnitState::Ready && process != before
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

/// The first part in which two rig files differ, of those that acquisition, watchdog and card read.
fn other_part(before: &RigFile, after: &RigFile) -> Option<&'static str> {
    let axes = |rig: &RigFile| {
        let of_axis = |axis: &rig::Axis| {
            let control = rig::AxisControl::default();
            let (model, effects) = (Vec::new(), Vec::new());
            rig::Axis { control, model, effects, ..axis.clone() }
        };
        rig.axes.iter().map(of_axis).collect::<Vec<_>>()
    };
    let parts = [
        ("name", before.name == after.name),
        ("rates", before.rates == after.rates),
        ("phases_us", before.phases == after.phases),
        ("axes", axes(before) == axes(after)),
        ("channels", before.channels == after.channels),
        ("emg", before.emg == after.emg),
        ("scanner", before.scanner == after.scanner),
        ("sync", before.sync == after.sync),
        ("model.kind", before.model.kind == after.model.kind),
    ];
    parts.iter().find(|(_, same)| !same).map(|(part, _)| *part)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn a_copy_is_named_after_its_contents() {
        let directory = tempfile::tempdir().unwrap();
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let path = keep_copy(directory.path(), Path::new("/somewhere/bench.toml"), &rig).unwrap();
        assert!(path.file_name().unwrap().to_str().unwrap().starts_with("bench."));
        assert_eq!(RigFile::load(&path).unwrap().identity(), rig.identity());
        let text = rig.text().replace("10 m line", "11 m line");
        let other = RigFile::parse(&text, "bench.toml").unwrap();
        assert_ne!(keep_copy(directory.path(), Path::new("bench.toml"), &other).unwrap(), path);
    }
}
