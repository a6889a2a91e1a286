//! Transmissions, hydrostatic or of cables: volts and the hand's torque in, positions of master and
//! slave out.
//!
//! Identified by the prediction-error method ([`crate::prediction_error`]). Whole records fit,
//! select and report; if there are too few of them, segments do ([`super::segmentation`]).

use report::Page;
use rig::Model as Declared;

use super::bootstrap::calibrate;
use super::false_alarms::find_false_alarms;
use super::transmission_study::Study;
use super::{
    DeclaredFit, Model, Options, segmentation, transmission_declared_fit, transmission_outcome,
};
use crate::equation_error::block_roles::Role;
use crate::error::{IdentifyError, Result};
use crate::input::Series;
use crate::naming::recording_of;
use crate::outcome::Outcome;
use crate::prediction_error::other_axes::OtherAxis;
use crate::prediction_error::record::{Record, Uninformative, share_out, uninformative};
use crate::prediction_error::search::{fit_declared, search};
use crate::prediction_error::search_result::SearchResult;
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
        options: Options<'_>,
    ) -> Result<(Outcome, Page)> {
        let (mut model, mut notes) = noted_model(rig_file, declared, records, &options)?;
        if model.records.iter().all(|record| record.idle) {
            notes.push(
                "no record has a hand that drives the slave: the scale of every torque relies on \
                 the motor constant alone"
                    .to_owned(),
            );
        }
        let deadline = options.deadline;
        let found = search(&mut model, deadline).ok_or_else(|| lost(&model))?;
        let axis = options.axis.map(str::to_owned);
        let mut study = Study {
            model,
            found,
            notes,
            calibration: None,
            false_alarms: Vec::new(),
            axis,
            deadline,
        };
        if let (1.., Some(capability)) = (options.calibrate, &options.capability) {
            calibrate(&mut study, capability.servo_gains(), options.calibrate, options.seed);
        }
        find_false_alarms(&mut study, options.seed);
        let capability = options.capability.filter(|_| options.propose);
        transmission_outcome::conclude(&study, capability.as_ref())
            .ok_or_else(|| lost(&study.model))
    }

    fn fit_declared(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options<'_>,
    ) -> Result<DeclaredFit> {
        let (mut model, notes) = noted_model(rig_file, declared, records, &options)?;
        let selecting = model.records.iter_mut().filter(|record| record.role == Role::Select);
        selecting.for_each(|record| record.role = Role::Fit);
        let base = fit_declared(&mut model, options.deadline).ok_or_else(|| lost(&model))?;
        let found = SearchResult { base, ..SearchResult::default() };
        let deadline = options.deadline;
        let study = Study {
            model,
            found,
            notes,
            calibration: None,
            false_alarms: Vec::new(),
            axis: None,
            deadline,
        };
        transmission_declared_fit::conclude(&study).ok_or_else(|| lost(&study.model))
    }
}

/// The model with the records, and notes on these.
fn noted_model(
    rig_file: &str,
    declared: &Declared,
    records: &[Series],
    options: &Options<'_>,
) -> Result<(TransmissionModel, Vec<String>)> {
    let mut notes: Vec<String> =
        records.iter().flat_map(|record| record.notes.iter().cloned()).collect();
    notes.extend(not_used(records, options.others));
    let model = model_of(rig_file, declared, records, options, &mut notes)?;
    Ok((model, notes))
}

/// Builds the model with the records that tell something, and notes what was left out.
fn model_of(
    rig_file: &str,
    declared: &Declared,
    records: &[Series],
    options: &Options<'_>,
    notes: &mut Vec<String>,
) -> Result<TransmissionModel> {
    let (informative, left_out) = informative(records);
    let beside_left_out = |error: IdentifyError| match (error, &left_out[..]) {
        (error, []) => error,
        (error, left_out) => IdentifyError::Unusable(format!("{error} ({})", left_out.join("; "))),
    };
    let records = informative.as_deref().unwrap_or(records);
    let mut cutting = Vec::new();
    let cut = segmentation::segment(records, &mut cutting).map_err(beside_left_out)?;
    let records = cut.as_deref().unwrap_or(records);
    let mut laid_out = records
        .iter()
        .map(|series| Record::new(series, options.gear, options.others, &mut cutting))
        .collect::<Result<Vec<_>>>()?;
    if let Some(cut) = &cut {
        hand_throughout(&mut laid_out, cut);
    }
    share_out(&mut laid_out, records.iter().all(|record| record.role.is_some()));
    let model = TransmissionModel::new(rig_file, declared, laid_out, options.slave_zero_rad)?;
    let (model, not_recorded) = model.with_other_axes(options.others);
    for role in [Role::Fit, Role::Select, Role::Report] {
        if model.of_role(role).is_empty() {
            return Err(beside_left_out(IdentifyError::Unusable(format!(
                "expected at least three records of a transmission, found {}; whole records fit, \
                 select and report: give more of them, with movements that differ",
                model.records.len()
            ))));
        }
    }
    notes.extend(left_out);
    notes.append(&mut cutting);
    notes.extend(not_recorded);
    Ok(model)
}

/// Leaves out records that tell nothing, with a note on each. Returns no records where all do or
/// none does: in the first case the first is refused with its reason, as every one would be.
fn informative(records: &[Series]) -> (Option<Vec<Series>>, Vec<String>) {
    let why: Vec<_> = records.iter().map(uninformative).collect();
    if why.iter().all(Option::is_some) || why.iter().all(Option::is_none) {
        return (None, Vec::new());
    }
    let notes = records.iter().zip(&why).filter_map(|(record, why)| {
        let Uninformative { column, found, .. } = why.as_ref()?;
        Some(format!("{} is left out: {column}: {found}", record.file))
    });
    let kept = records.iter().zip(&why).filter(|(_, why)| why.is_none());
    (Some(kept.map(|(record, _)| record.clone()).collect()), notes.collect())
}

/// A hand in one segment of a recording is assumed in all of its segments, however lightly it acts:
/// the reading of the torque sensor is then a torque in each.
fn hand_throughout(records: &mut [Record], segments: &[Series]) {
    let of = |segment: &Series| recording_of(&segment.file).to_owned();
    let held: Vec<String> = records
        .iter()
        .zip(segments)
        .filter(|(record, _)| !record.idle)
        .map(|(_, segment)| of(segment))
        .collect();
    for (record, segment) in records.iter_mut().zip(segments) {
        record.idle &= !held.contains(&of(segment));
    }
}

/// Columns of the model of a transmission.
const USED: [&str; 5] = ["t_s", "motor_v", "master_rad", "slave_rad", "slave_torque_nm"];

/// Notes columns that are not used.
fn not_used(records: &[Series], others: &[OtherAxis]) -> Option<String> {
    // Of another axis only the slave acts on this one; that the others are not used needs no note.
    let of_other = |name: &str| others.iter().any(|other| other.has(name));
    let is_used = |name: &str| USED.contains(&name) || of_other(name);
    let mut names: Vec<&str> = records
        .iter()
        .flat_map(|record| &record.columns)
        .map(|(name, _)| name.as_str())
        .filter(|name| !is_used(name))
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
    use crate::deadline::NEVER;

    #[test]
    fn a_hand_in_one_segment_is_assumed_in_the_whole_recording() {
        let names = [
            "a.mcap[0.0..3.0 s]",
            "a.mcap[3.0..6.0 s]",
            "b[1].mcap[0.0..3.0 s]",
            "b[1].mcap[3.0..6.0 s]",
        ];
        let segments = names.map(|name| {
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
        let mut records: Vec<Record> = segments
            .iter()
            .filter_map(|series| Record::new(series, 1.0, &[], &mut Vec::new()).ok())
            .collect();
        let idle =
            |records: &[Record]| records.iter().map(|record| record.idle).collect::<Vec<bool>>();
        assert_eq!(idle(&records), [true, false, true, true]);
        hand_throughout(&mut records, &segments);
        assert_eq!(idle(&records), [false, false, true, true]);
    }

    /// A record of 4 s in which the slave goes so far (rad).
    fn moving(name: &str, slave_rad: f64) -> Series {
        let time: Vec<f64> = (0..4000).map(|row| f64::from(row) * 1e-3).collect();
        let wave = |size: f64| time.iter().map(|t| size * (5.0 * t).sin()).collect::<Vec<f64>>();
        let columns = [
            ("motor_v", wave(3.0)),
            ("master_rad", wave(0.5)),
            ("slave_rad", wave(slave_rad)),
            ("t_s", time.clone()),
        ];
        let columns = columns.into_iter().map(|(name, column)| (name.to_owned(), column));
        Series { file: name.to_owned(), columns: columns.collect(), ..Series::default() }
    }

    fn model_of_moving(records: &[Series]) -> (Result<TransmissionModel>, Vec<String>) {
        let rig = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
        let rig = rig::RigFile::load(rig).unwrap();
        let options = Options {
            seed: 1,
            gear: 1.0,
            slave_zero_rad: None,
            axis: None,
            others: &[],
            capability: None,
            propose: false,
            calibrate: 0,
            deadline: &NEVER,
        };
        let mut notes = Vec::new();
        (model_of("rig.toml", &rig.model, records, &options, &mut notes), notes)
    }

    #[test]
    fn one_record_of_ten_with_a_stuck_slave_is_left_out_and_noted() {
        let name = |turn: usize| format!("record-{turn:02}.csv");
        let mut records: Vec<Series> = (0..10).map(|turn| moving(&name(turn), 0.4)).collect();
        records[3] = moving(&name(3), 0.004);
        let (model, notes) = model_of_moving(&records);
        let model = model.unwrap();
        assert_eq!(model.records.len(), 9);
        assert!(model.records.iter().all(|record| record.name != name(3)));
        for role in [Role::Fit, Role::Select, Role::Report] {
            assert!(!model.of_role(role).is_empty(), "{role:?}");
        }
        assert!(
            notes.iter().any(|note| note.starts_with("record-03.csv is left out: slave_rad")),
            "{notes:?}"
        );
    }

    #[test]
    fn records_are_refused_only_where_too_few_move() {
        let still = |turn: usize| moving(&format!("still-{turn}.csv"), 0.004);
        // All are refused with the reason of the first.
        let text = model_of_moving(&[still(0), still(1), still(2)]).0.unwrap_err().to_string();
        assert!(text.starts_with("still-0.csv, column `slave_rad`"), "{text}");
        // 4 s in one record are no three segments.
        let records = [moving("moves.csv", 0.4), still(1), still(2)];
        let text = model_of_moving(&records).0.unwrap_err().to_string();
        assert!(
            text.contains("three records") && text.contains("still-1.csv is left out"),
            "{text}"
        );
        // The only record that should report stuck.
        let mut records: Vec<Series> =
            (0..4).map(|turn| moving(&format!("{turn}.csv"), 0.4)).collect();
        records[3] = still(3);
        let roles = [Role::Fit, Role::Fit, Role::Select, Role::Report];
        records.iter_mut().zip(roles).for_each(|(record, role)| record.role = Some(role));
        let text = model_of_moving(&records).0.unwrap_err().to_string();
        assert!(
            text.contains("whole records fit") && text.contains("still-3.csv is left out"),
            "{text}"
        );
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
        let told = not_used(&all, &[]).unwrap_or_default();
        assert!(told.starts_with("hose_pressure_pa, temperature_c are recorded"), "{told}");
        assert_eq!(not_used(&[series(&USED)], &[]), None);
    }
}
