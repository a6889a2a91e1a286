//! A part tested by itself under imposed motion, motion in and force out: `k x + d v + offset =
//! force`.
//!
//! The cable in a testing machine, a seal, a damper, a piece of hose. The equation error is
//! minimised as for a drive ([`super::drive`]), except for the low-pass: its cut-off is 100 Hz, or
//! 0.15 of the sampling frequency if that is lower, since only one derivative is taken and mains
//! hum should remain visible. The residual is the measured force minus the model's, in percent of
//! the force's rms.
//!
//! Signs: the force that must be put on the part to move it; a positive stiffness needs a positive
//! force at a positive position. The offset is the force at position 0 and at rest. A mass that
//! moves with the part is declared as `mass_kg`; where it is not, the part has none, and one that
//! shows is `extra_inertia`.

use report::Page;
use rig::Model as Declared;

use super::equation_error_study::{
    CHECK_UNITS, Declaration, axis, check_channels, check_scale, study, units_of,
};
use super::{Model, Options};
use crate::effects::Units;
use crate::equation_error::model::{Column, Parameter, RegressionModel};
use crate::equation_error::signals::{CutOff, ForceBalance};
use crate::error::Result;
use crate::input::Series;
use crate::outcome::Outcome;

/// The model kind `element`.
pub(super) struct Element;

/// Sites at which effects of an element are searched: the part, its moved end, the instruments.
const SITES: &[&str] = &["line", "slave", "sensor"];

const CUT_OFF: CutOff = CutOff { highest: 100.0, share: 0.15 };

impl Model for Element {
    fn columns(&self) -> &'static [&'static str] {
        &["t_s", "position_m", "position_rad", "force_n", "torque_nm"]
    }

    fn identify(
        &self,
        rig_file: &str,
        declared: &Declared,
        records: &[Series],
        options: Options,
    ) -> Result<(Outcome, Page)> {
        let mut notes: Vec<String> = records.iter().flat_map(|r| r.notes.iter().cloned()).collect();
        let (mut balances, mut channel) = (Vec::new(), "force_n");
        for series in records {
            let time = series.time()?;
            let (position_name, position) = series.any(&["position_m", "position_rad"])?;
            let (force_name, force) = series.any(&["force_n", "torque_nm"])?;
            check_channels(
                series,
                &[(position_name, "the position"), (force_name, "the force")],
                &mut notes,
            )?;
            let balance = ForceBalance::new(&series.file, time, position, force, CUT_OFF);
            balances.push(balance.ok_or_else(|| series.short(time.len()))?);
            channel = force_name;
        }
        let units = units_of(channel);
        let parameters =
            declared_parameters(&Declaration { file: rig_file, model: declared }, &units)?;
        let axis = axis(&balances, units, true, false);
        let regression = RegressionModel { balances, parameters, axis, sites: SITES };
        let scale = (Column::Position, "force and position give a stiffness");
        check_scale(&regression, channel, scale, CHECK_UNITS)?;
        study(regression, records, options, (channel, notes))
    }
}

/// Reads the declaration: stiffness, damping, and mass, friction and offset where they are
/// declared.
fn declared_parameters(declaration: &Declaration<'_>, units: &Units) -> Result<Vec<Parameter>> {
    let stiffness = ["stiffness_n_per_m", "stiffness_nm_per_rad"];
    let damping = ["viscous_damping_n_s_per_m", "viscous_damping_nm_s_per_rad"];
    let mut parameters = vec![
        declaration.need_positive(&stiffness, units.stiffness, Column::Position)?,
        declaration.need(&damping, units.damping, Column::Velocity)?,
    ];
    parameters.extend(declaration.of(
        &["mass_kg", "inertia_kg_m2"],
        units.mass,
        Column::Acceleration,
    ));
    parameters.extend(declaration.of(
        &["coulomb_friction_n", "coulomb_nm"],
        units.force,
        Column::Sign,
    ));
    parameters.extend(declaration.of(&["force_offset_n", "offset_nm"], units.force, Column::One));
    Ok(parameters)
}
