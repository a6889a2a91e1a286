//! What the recorded motion of the other axes does to the axis identified.
//!
//! The products of inertia `C_j` of the handle make the others' accelerations a torque on the
//! slave, `-Σ_j C_j q̈_j` ([`plant::coupled_axes`]). The accelerations are known from the record,
//! so that one axis is identified at a time, with the products as further parameters.

use plant::coupled_axes::AXES;
use rig::Parameter;

use super::other_axes::{OtherAcceleration, OtherAxis};
use super::transmission_model::{BaseParameter, Setting, TransmissionModel};

impl TransmissionModel {
    /// Adds the other axes at the handle that every record has, with the declared products of
    /// inertia as parameters; returns a note on each that is left out.
    #[must_use]
    pub fn with_other_axes(mut self, others: &[OtherAxis]) -> (Self, Vec<String>) {
        let mut notes = Vec::new();
        for other in others {
            let is_recorded = self
                .records
                .iter()
                .all(|record| record.others.iter().any(|own| own.axis == other.index));
            if !is_recorded {
                notes.push(format!(
                    "not every record has a column `{}`: what the motion of axis \"{}\" does to \
                     this one through the handle is left out of the model",
                    other.column(),
                    other.name
                ));
                continue;
            }
            let declared = other.coupling_kg_m2;
            let spread = Parameter::DEFAULT_TOLERANCE * declared.abs();
            if spread > 0.0 {
                let range = (declared - spread, declared + spread);
                let product =
                    BaseParameter::declared(&other.parameter(), "kg m^2", declared, range);
                self.base.push(product);
            }
            self.others.push(other.clone());
        }
        (self, notes)
    }

    /// Adds the torque of the other axes' accelerations to the torque on the slave (N·m), row by
    /// row; `by_effects` are products of inertia beside those of the setting (kg·m²), by axis.
    pub(super) fn add_coupling(
        &self,
        setting: &Setting,
        by_effects: &[f64; AXES],
        accelerations: &[OtherAcceleration],
        torque_nm: &mut [f64],
    ) {
        for other in &self.others {
            let fitted = self.base_value(setting, &other.parameter());
            let product = fitted.unwrap_or(other.coupling_kg_m2)
                + by_effects.get(other.index).copied().unwrap_or_default();
            let Some(recorded) = accelerations.iter().find(|own| own.axis == other.index) else {
                continue;
            };
            for (torque, acceleration) in torque_nm.iter_mut().zip(&recorded.rad_s2) {
                *torque -= product * acceleration;
            }
        }
    }
}
