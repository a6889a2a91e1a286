//! Friction that changes as the machine warms up.
//!
//! `F = (coulomb_excess · sign(v) + viscous_excess · v) · exp(-t / time_constant)`, `t` since the
//! start of the record: higher when cold if the excess is positive. Source: viscosity falls with
//! temperature, which approaches its final value exponentially; Bittencourt and Gunnarsson, J. Dyn.
//! Sys. Meas. Control 134 (2012), fig. 6.
//!
//! Parameters: `coulomb_excess` (N or N·m), `viscous_excess` (N·s/m or N·m·s/rad), up to twice the
//! warm values; `time_constant` (s), a thirtieth to two fifths of the record: slower drift acts
//! like a constant.
//!
//! In a residual: an error that is large early in the record (or late) and follows the sign of the
//! velocity. Confused with: drift of a sensor (which does not change sign with the velocity),
//! differences between records.

use super::{Axis, Effect, Instant, Law, Regressor, Shape, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "thermal_drift",
    sites: &["master", "slave", "line"],
    words: "friction that drifts as the machine warms",
    experiment: "the same movement for ten times as long, begun cold, with the temperature \
                 recorded",
    regressor: &ThermalDrift,
};

struct ThermalDrift;

impl Regressor for ThermalDrift {
    fn refines(&self) -> Option<&'static str> {
        Some("coulomb_friction")
    }
    fn uses_sign(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![
            Term::free("coulomb_excess", axis.units.force),
            Term::free("viscous_excess", axis.units.damping),
        ]
    }
    fn shapes(&self, axis: &Axis) -> Vec<Shape> {
        vec![Shape::by_factors("time_constant", "s", (0.03 * axis.seconds, 0.4 * axis.seconds), 6)]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for ThermalDrift {
    fn force(&self, now: &Instant, shapes: &[f64], _: &[f64], out: &mut [f64]) {
        let cold = (-now.time / shapes[0]).exp();
        (out[0], out[1]) = (now.sign * cold, now.velocity * cold);
    }
}
