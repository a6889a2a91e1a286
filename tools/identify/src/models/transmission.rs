//! Transmissions, hydrostatic or of cables: volts and the hand's torque in, positions of master and slave out.
//!
//! The model is simulated forward and pulled along the records ([`crate::forward`]). Whole records fit, select and report; where there
//! are too few of them, stretches of them do ([`super::stretches`]).

use report::Page;
use rig::{Model as Declared, ModelKind};

use super::calibrate::calibrate;
use super::{Model, Options, stretches, transmission_outcome, transmission_page};
use crate::error::{IdentifyError, Result};
use crate::forward::machine::Machine;
use crate::forward::record::{Record, share_out};
use crate::forward::search::{Found, search};
use crate::input::Series;
use crate::inverse::split::Role;
use crate::outcome::{Calibration, Outcome};

/// The model kinds `hydrostatic` and `cable`.
pub(super) struct Transmission(pub(super) ModelKind);

/// A transmission's records, and what they turned out to say.
pub(super) struct Study {
    /// Declared model and records.
    pub(super) machine: Machine,
    /// What the search found.
    pub(super) found: Found,
    /// What a reader should know of the data.
    pub(super) notes: Vec<String>,
    /// What chance gives, where that was asked for.
    pub(super) calibration: Option<Calibration>,
}

impl Model for Transmission {
    fn kind(&self) -> ModelKind {
        self.0
    }

    fn sentences(&self, outcome: &Outcome) -> (String, String) {
        let (_, sentence, detail) = transmission_page::sentences(outcome);
        (sentence, detail)
    }

    fn identify(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options,
    ) -> Result<(Outcome, Page)> {
        let mut notes: Vec<String> = records.iter().flat_map(|record| record.notes.iter().cloned()).collect();
        notes.extend(not_used(records));
        let cut = stretches::enough(records, &mut notes)?;
        let records = cut.as_deref().unwrap_or(records);
        let mut laid_out =
            records.iter().map(|series| Record::new(series, options.gear, &mut notes)).collect::<Result<Vec<_>>>()?;
        share_out(&mut laid_out, records.iter().all(|record| record.role.is_some()));
        let mut machine = Machine::new(rig_file, declared, laid_out, options.slave_count_rad)?;
        for role in [Role::Fit, Role::Select, Role::Report] {
            if machine.of_role(role).is_empty() {
                return Err(IdentifyError::Roles {
                    what: format!("expected at least three records of a transmission, found {}", machine.records.len()),
                    advice: "whole records fit, select and report: give more of them, with movements that differ",
                });
            }
        }
        if machine.records.iter().all(|record| record.idle) {
            notes.push(
                "no record has a hand that drives the slave: the torque's scale, and with it every torque, rests on the motor's constant alone".to_owned(),
            );
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(options.jobs)
            .build()
            .map_err(|error| IdentifyError::Read(format!("no threads: {error}")))?;
        let found = pool.install(|| search(&mut machine)).ok_or_else(|| lost(&machine))?;
        let mut study = Study { machine, found, notes, calibration: None };
        if let (1.., Some(stage)) = (options.calibrate, &options.stage) {
            pool.install(|| calibrate(&mut study, stage.drive(), options.calibrate, options.seed));
        }
        let stage = options.stage.filter(|_| options.propose);
        pool.install(|| transmission_outcome::conclude(&study, stage.as_ref())).ok_or_else(|| lost(&study.machine))
    }
}

/// Columns of a transmission's records that its model knows.
const USED: [&str; 5] = ["t_s", "motor_v", "master_rad", "slave_rad", "slave_torque_nm"];

/// What is there and takes no part: whoever recorded it may think that it does.
fn not_used(records: &[Series]) -> Option<String> {
    let mut names: Vec<&str> = records
        .iter()
        .flat_map(|record| &record.columns)
        .map(|(name, _)| name.as_str())
        .filter(|name| !USED.contains(name))
        .collect();
    names.sort_unstable();
    names.dedup();
    (!names.is_empty())
        .then(|| format!("{} are recorded and take no part: the model has no such signal", names.join(", ")))
}

fn lost(machine: &Machine) -> IdentifyError {
    let files: Vec<&str> = machine.records.iter().map(|record| record.name.as_str()).collect();
    IdentifyError::Lost { file: files.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_take_no_part_are_told_once() {
        let series = |names: &[&str]| Series {
            columns: names.iter().map(|name| ((*name).to_owned(), Vec::new())).collect(),
            ..Series::default()
        };
        let all = [series(&["t_s", "temperature_c", "motor_v"]), series(&["temperature_c", "hose_pressure_pa"])];
        let told = not_used(&all).unwrap_or_default();
        assert!(told.starts_with("hose_pressure_pa, temperature_c are recorded"), "{told}");
        assert_eq!(not_used(&[series(&USED)]), None);
    }
}
