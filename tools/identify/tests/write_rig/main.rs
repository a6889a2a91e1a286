//! `--write-rig`: the file that is written makes the plant that was fitted, and keeps what the
//! laboratory wrote.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use identify::outcome::{
    EffectParameter, FittedParameter, FoundEffect, Identifiability, Named, NextExperiment, Outcome,
    Roles, UNKNOWN, UnlistedTable, Verdict,
};
use identify::write_rig::{Provenance, WriteRigError, Written, fitted};
use plant::ParameterSet as _;
use plant::drive;
use plant::effects::{Effect, Moment, Side, SideLoad, Site, make};
use plant::friction::Load;
use plant::transmission::{Input, Motion, Transmission as _};
use plant::transmission_kinds::Parameters;
use rig::{ParameterSource, RigFile};

mod one_channel;
mod several_axes;
mod transmission;

const RIG: &str = include_str!("../../../../launch/rigs/hydrostatic.toml");
const TWO_AXES: &str = include_str!("../../../../launch/rigs/two-axis.toml");
const DRIVE: &str = include_str!("../../../../launch/rigs/emps.toml");
const ELEMENT: &str = include_str!("../../../../launch/rigs/element.toml");
const OSCILLATOR: &str = include_str!("../../../../launch/rigs/silverbox.toml");

fn parameter(name: &str, declared: Option<f64>, fitted: f64, std: Option<f64>) -> FittedParameter {
    FittedParameter {
        name: name.into(),
        declared,
        fitted,
        std,
        unit: String::new(),
        identifiable: std.is_some(),
        at_tolerance: false,
        identifiability: if std.is_some() {
            Identifiability::Identified
        } else {
            Identifiability::Weak
        },
        trades_with: None,
    }
}

fn effect(id: &str, site: &str, values: &[(&str, f64)]) -> FoundEffect {
    let parameters = values
        .iter()
        .map(|(name, value)| EffectParameter {
            name: (*name).into(),
            value: *value,
            std: None,
            unit: String::new(),
        })
        .collect();
    FoundEffect { id: id.into(), site: site.into(), parameters, t: 9.0, gain_percent: 40.0 }
}

/// As a fit of one channel tells it: names of its own, with units.
fn found_by_columns(id: &str, site: &str, values: &[(&str, f64, &str)]) -> FoundEffect {
    let plain: Vec<(&str, f64)> = values.iter().map(|(name, value, _)| (*name, *value)).collect();
    let mut found = effect(id, site, &plain);
    for (parameter, (_, _, unit)) in found.parameters.iter_mut().zip(values) {
        parameter.unit = (*unit).into();
    }
    found
}

/// The file that is written for an outcome.
fn write(original: &str, outcome: &Outcome) -> Result<Written, WriteRigError> {
    let provenance = Provenance { date: "2026-11-23".into(), revision: "1a2b3c4".into() };
    fitted(original, "rig.toml", outcome, &provenance)
}

/// A declared parameter in its unit: declared, fitted.
fn in_unit(name: &str, unit: &str, (declared, fitted): (f64, f64)) -> FittedParameter {
    FittedParameter {
        unit: unit.into(),
        ..parameter(name, Some(declared), fitted, Some(1e-3 * fitted.abs()))
    }
}

/// The file that is written for a model of one channel.
fn written_for(
    original: &str,
    parameters: Vec<FittedParameter>,
    effects: Vec<FoundEffect>,
) -> (Written, RigFile) {
    let written = write(original, &outcome(Verdict::Effect, parameters, effects)).unwrap();
    let rig = RigFile::parse(text(&written), "fitted.toml").unwrap();
    (written, rig)
}

fn outcome(
    verdict: Verdict,
    parameters: Vec<FittedParameter>,
    effects: Vec<FoundEffect>,
) -> Outcome {
    Outcome {
        axis: None,
        unsettled: None,
        verdict,
        early: false,
        effects,
        ambiguous_with: Vec::new(),
        remains: false,
        unlisted: None,
        calibration: None,
        false_alarms: Vec::new(),
        left: Vec::new(),
        error: Default::default(),
        residual_tests: Default::default(),
        parameters,
        at_bounds: None,
        correlations: Vec::new(),
        records: Roles::default(),
        next_experiment: NextExperiment { why: String::new(), what: String::new(), protocol: None },
        steps: Vec::new(),
        candidates: Vec::new(),
        notes: Vec::new(),
        seconds: 0.0,
    }
}

const FITTED: [(&str, f64, f64); 5] = [
    ("motor_torque_per_volt_nm", 1.621_234_567, 0.04),
    ("line_stiffness_factor", 0.062_857_1, 1e-4),
    ("slave_static_friction_nm", 2.531, 0.5),
    ("friction_smoothing_rad_s", 0.071_3, 0.002),
    ("friction_smoothing_shape", -0.6, 0.1),
];

fn found(effects: Vec<FoundEffect>) -> Outcome {
    let original = RigFile::parse(RIG, "rig.toml").unwrap();
    let declared = |name: &str| original.model.parameter(name).map(|parameter| parameter.value);
    let parameters =
        FITTED.iter().map(|(name, value, std)| parameter(name, declared(name), *value, Some(*std)));
    let mut parameters: Vec<_> = parameters.collect();
    parameters.push(parameter("slave_encoder_zero_rad", None, 4e-4, Some(1e-5)));
    parameters.push(parameter("bulk_modulus_pa", declared("bulk_modulus_pa"), 1.86e9, None));
    let verdict = if effects.is_empty() { Verdict::None } else { Verdict::Effect };
    outcome(verdict, parameters, effects)
}

fn text(written: &Written) -> &str {
    written.text.as_deref().unwrap()
}

/// Where a plant is after it was pulled to and fro.
fn moved(parameters: Parameters, effects: Vec<Box<dyn Effect>>) -> Motion {
    let mut plant = parameters.plant(effects).unwrap();
    for row in 0..1500 {
        let motor_v = 5.0 * (12.0 * f64::from(row) * 1e-3).sin();
        plant.step(Input { motor_v, hand_torque_nm: 0.0 }, 1e-3);
    }
    plant.motion()
}
