//! Transmissions, hydrostatic or of cables: volts and the hand's torque in, positions of master and
//! slave out.
//!
//! Identified by the prediction-error method ([`crate::prediction_error`]). Whole records fit,
//! select and report; if there are too few of them, segments do ([`super::segmentation`]).

use report::Page;
use rig::Model as Declared;

use super::bootstrap::calibrate;
use super::transmission_study::Study;
use super::{Model, Options, segmentation, transmission_outcome};
use crate::equation_error::block_roles::Role;
use crate::error::{IdentifyError, Result};
use crate::input::Series;
use crate::naming::recording_of;
use crate::outcome::Outcome;
use crate::prediction_error::record::{Record, share_out};
use crate::prediction_error::search::search;
use crate::prediction_error::transmission_model::TransmissionModel;

/// The model of transmissions of any kind.
pub(super) struct Transmission;

impl Model for Transmission {
    fn columns(&self) -> &'static [&'static str] {
        &USED
    }

    fn is_located(&self) -> bool {
        true
    }

    fn identify(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options,
    ) -> Result<(Outcome, Page)> {
        let mut notes: Vec<String> =
            records.iter().flat_map(|record| record.notes.iter().cloned()).collect();
        notes.extend(not_used(records));
        let cut = segmentation::segment(records, &mut notes)?;
        let records = cut.as_deref().unwrap_or(records);
        let mut laid_out = records
            .iter()
            .map(|series| Record::new(series, options.gear, &mut notes))
            .collect::<Result<Vec<_>>>()?;
        if let Some(cut) = &cut {
            hand_throughout(&mut laid_out, cut);
        }
        share_out(&mut laid_out, records.iter().all(|record| record.role.is_some()));
        let mut model =
            TransmissionModel::new(rig_file, declared, laid_out, options.slave_count_rad)?;
        for role in [Role::Fit, Role::Select, Role::Report] {
            if model.of_role(role).is_empty() {
                return Err(IdentifyError::Unusable(format!(
                    "expected at least three records of a transmission, found {}; whole records \
                     fit, select and report: give more of them, with movements that differ",
                    model.records.len()
                )));
            }
        }
        if model.records.iter().all(|record| record.idle) {
            notes.push(
                "no record has a hand that drives the slave: the scale of every torque relies on \
                 the motor constant alone"
                    .to_owned(),
            );
        }
        let found = search(&mut model).ok_or_else(|| lost(&model))?;
        let mut study = Study { model, found, notes, calibration: None };
        if let (1.., Some(capability)) = (options.calibrate, &options.capability) {
            calibrate(&mut study, capability.servo_gains(), options.calibrate, options.seed);
        }
        let capability = options.capability.filter(|_| options.propose);
        transmission_outcome::conclude(&study, capability.as_ref())
            .ok_or_else(|| lost(&study.model))
    }
}

/// A hand in one segment of a recording is assumed in all of its segments, however lightly it acts:
/// the reading of the torque sensor is then a torque in each.
fn hand_throughout(records: &mut [Record], stretches: &[Series]) {
    let of = |stretch: &Series| recording_of(&stretch.file).to_owned();
    let held: Vec<String> = records
        .iter()
        .zip(stretches)
        .filter(|(record, _)| !record.idle)
        .map(|(_, stretch)| of(stretch))
        .collect();
    for (record, stretch) in records.iter_mut().zip(stretches) {
        record.idle &= !held.contains(&of(stretch));
    }
}

/// Columns of the model of a transmission.
const USED: [&str; 5] = ["t_s", "motor_v", "master_rad", "slave_rad", "slave_torque_nm"];

/// Notes columns that are not used.
fn not_used(records: &[Series]) -> Option<String> {
    let mut names: Vec<&str> = records
        .iter()
        .flat_map(|record| &record.columns)
        .map(|(name, _)| name.as_str())
        .filter(|name| !USED.contains(name))
        .collect();
    names.sort_unstable();
    names.dedup();
    (!names.is_empty()).then(|| {
        format!("{} are recorded but not used: the model has no such signal", names.join(", "))
    })
}

fn lost(model: &TransmissionModel) -> IdentifyError {
    let files: Vec<&str> = model.records.iter().map(|record| record.name.as_str()).collect();
    IdentifyError::Unusable(format!(
        "{}: the declared model diverges from these records for all parameters within their \
         tolerances; expected records of this rig: check the rig file, the units and the signs of \
         the columns",
        files.join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_in_one_segment_is_assumed_in_the_whole_recording() {
        let names = [
            "a.mcap[0.0..3.0 s]",
            "a.mcap[3.0..6.0 s]",
            "b[1].mcap[0.0..3.0 s]",
            "b[1].mcap[3.0..6.0 s]",
        ];
        let stretches = names.map(|name| {
            let time: Vec<f64> = (0..4000).map(|row| f64::from(row) * 1e-3).collect();
            // 0.02 N·m are too little to be a hand by themselves.
            let most = if name == names[1] { 2.0 } else { 0.02 };
            let wave =
                |size: f64| time.iter().map(|t| size * (5.0 * t).sin()).collect::<Vec<f64>>();
            let columns = [
                ("motor_v", time.iter().map(|t| 3.0 * (3.0 * t).sin()).collect()),
                ("master_rad", wave(1.0)),
                ("slave_rad", wave(0.8)),
                ("slave_torque_nm", wave(most)),
                ("t_s", time.clone()),
            ];
            let columns =
                columns.into_iter().map(|(name, column)| (name.to_owned(), column)).collect();
            Series { file: name.to_owned(), columns, ..Series::default() }
        });
        let mut records: Vec<Record> = stretches
            .iter()
            .filter_map(|series| Record::new(series, 1.0, &mut Vec::new()).ok())
            .collect();
        let idle =
            |records: &[Record]| records.iter().map(|record| record.idle).collect::<Vec<bool>>();
        assert_eq!(idle(&records), [true, false, true, true]);
        hand_throughout(&mut records, &stretches);
        assert_eq!(idle(&records), [false, false, true, true]);
    }

    #[test]
    fn unused_columns_are_reported_once() {
        let series = |names: &[&str]| Series {
            columns: names.iter().map(|name| ((*name).to_owned(), Vec::new())).collect(),
            ..Series::default()
        };
        let all = [
            series(&["t_s", "temperature_c", "motor_v"]),
            series(&["temperature_c", "hose_pressure_pa"]),
        ];
        let told = not_used(&all).unwrap_or_default();
        assert!(told.starts_with("hose_pressure_pa, temperature_c are recorded"), "{told}");
        assert_eq!(not_used(&[series(&USED)]), None);
    }
}
