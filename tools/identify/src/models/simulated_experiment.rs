//! Records of candidate movements, simulated, and how the innovations of models along them differ.

use nalgebra::{DMatrix, DVector};
use plant::transmission_kinds::Plant;

use super::candidate_movements::{Movement, RigCapability};
use super::transmission_study::Study;
use crate::equation_error::block_roles::Role;
use crate::prediction_error::dataset::Dataset;
use crate::prediction_error::free_parameter::FreeParameter;
use crate::prediction_error::noise_floor::errors;
use crate::prediction_error::record::Record;
use crate::prediction_error::screening::basis;
use crate::prediction_error::transmission_model::{
    Channel, PlacedEffect, Residual, Setting, TransmissionModel,
};

/// Noise floor of each channel: the repeatability, or the residual of the fitted model if nothing
/// was repeated.
pub(super) fn floors(study: &Study<'_>) -> Option<Vec<(Channel, f64)>> {
    let report = study.model.of_role(Role::Report);
    let errors = errors(&study.model, &report, &study.found.last().setting)?;
    Some(
        errors
            .into_iter()
            .map(|(channel, error, floor)| (channel, floor.unwrap_or(error).max(1e-7)))
            .collect(),
    )
}

/// Simulates the record of a movement with a setting.
pub(super) fn recorded(
    study: &Study<'_>,
    capability: &RigCapability,
    movement: Movement,
    setting: &Setting,
) -> Option<Record> {
    let model = &study.model;
    let mut record = capability.record(movement, plant(model, setting)?);
    let zero = model.slave_zero_rad(setting);
    let measured = |of: fn(&Record) -> bool| model.records.iter().all(of);
    record.slave = record
        .slave
        .filter(|_| measured(|record| record.slave.is_some()))
        .map(|slave| slave.into_iter().map(|position| position + zero).collect());
    record.torque = record.torque.filter(|_| measured(|record| record.torque.is_some()));
    Some(record)
}

/// Returns the plant of a setting, with sensor effects in its readings.
pub(super) fn plant(model: &TransmissionModel, setting: &Setting) -> Option<Plant> {
    let effects = setting.placed.iter().map(PlacedEffect::effect).collect::<Option<Vec<_>>>()?;
    model.constants(setting)?.plant(effects).ok()
}

/// Inverse noise floor, by record and channel.
pub(super) fn weights(model: &TransmissionModel, floors: &[(Channel, f64)]) -> Vec<Vec<f64>> {
    let weight = |channel: Channel| {
        floors.iter().find(|(own, _)| *own == channel).map_or(0.0, |(_, floor)| 1.0 / floor)
    };
    (0..model.records.len())
        .map(|record| model.channels(record).into_iter().map(weight).collect())
        .collect()
}

/// Difference of the innovations of two settings, in noise floors.
pub(super) fn difference(
    model: &TransmissionModel,
    own: &Setting,
    other: &Setting,
    floors: &[(Channel, f64)],
) -> Option<DVector<f64>> {
    let dataset = Dataset::whole(model);
    let weights = weights(model, floors);
    let stacked = |residuals: Vec<Residual>| Dataset::stack(&residuals, &weights);
    Some(stacked(dataset.residuals(other)?) - stacked(dataset.residuals(own)?))
}

pub(super) fn jacobian(
    model: &TransmissionModel,
    setting: &Setting,
    parameters: &[FreeParameter],
    floors: &[(Channel, f64)],
) -> Option<DMatrix<f64>> {
    let dataset = Dataset::whole(model);
    let fitted = dataset.evaluate(setting.clone())?;
    Some(dataset.jacobian(&fitted, parameters, &weights(model, floors)))
}

/// Projects a column onto the complement of others.
pub(super) fn without(column: &DVector<f64>, others: &DMatrix<f64>) -> DVector<f64> {
    let basis = basis(others.column_iter().map(|other| other.into_owned()), others.nrows());
    column - &basis * (basis.transpose() * column)
}
