//! Another rig file for a rig that is up.

use std::collections::BTreeMap;
use std::path::Path;

use ipc_types::{PROCESSES, Process};
use rig::RigFile;
use runtime::RigName;

use crate::Error;
use crate::kept_folder::absolute;
use crate::restart::{processes, until_ready_again};
use crate::saved_rig_file::{MACHINE, RIG, keep_copy, rig_of, running};

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
    let simulated = config.has_unit(Process::Simulator.text());
    if simulated && was(MACHINE).is_empty() {
        variables.insert(MACHINE.to_owned(), was(RIG));
    }
    let reading = PROCESSES.iter().map(|entry| entry.process).filter(|own| reads_model(*own));
    let units: Vec<String> = reading
        .map(|process| process.text().to_owned())
        .filter(|name| config.has_unit(name))
        .collect();
    let old = processes(&launch::status(&run_dir)?, &units);
    launch::change(&run_dir, variables, &units)?;
    until_ready_again(&run_dir, &units, &old)
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
        ("card", before.card == after.card),
        ("comedi", before.comedi == after.comedi),
        ("rates", before.rates == after.rates),
        ("phases_us", before.phases == after.phases),
        ("axes", axes(before) == axes(after)),
        ("safety", before.safety == after.safety),
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
    fn control_and_model_may_change_and_nothing_else() {
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let with = |from: &str, to: &str| {
            assert!(rig.text().contains(from), "{from}");
            RigFile::parse(&rig.text().replacen(from, to, 1), "other.toml").unwrap()
        };
        for (from, to) in [
            ("kind = \"printed\"", "kind = \"identified\""),
            ("p_v_per_count = 4.5e-3", "p_v_per_count = 4.4e-3"),
            ("motor_coulomb_nm = { value = 0.767", "motor_coulomb_nm = { value = 0.8"),
        ] {
            assert_eq!(other_part(&rig, &with(from, to)), None, "{to}");
        }
        for (from, to, part) in [
            ("speed_max_deg_s = 1500.0", "speed_max_deg_s = 1400.0", "axes"),
            ("volts_per_nm = 0.5", "volts_per_nm = 0.4", "axes"),
            ("name = \"emg_1\"", "name = \"emg_one\"", "channels"),
            ("notch_hz = 50.0", "notch_hz = 60.0", "emg"),
            ("minimum_width_s = 0.0005", "minimum_width_s = 0.001", "scanner"),
            ("name = \"hydrostatic\"", "name = \"other\"", "name"),
        ] {
            assert_eq!(other_part(&rig, &with(from, to)), Some(part), "{to}");
        }
    }
}
