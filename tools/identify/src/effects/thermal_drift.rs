//! Friction that changes as the machine warms up.
//!
//! `F = (coulomb_excess · sign(v) + viscous_excess · v) · exp(-t / time_constant)`, `t` since the
//! start of the record: higher when cold if the excess is positive. Source: viscosity falls with
//! temperature, which approaches its final value exponentially; Bittencourt and Gunnarsson, J. Dyn.
//! Sys. Meas. Control 134 (2012), fig. 6.
//!
//! Parameters: `coulomb_excess` (N or N·m), `viscous_excess` (N·s/m or N·m·s/rad), up to twice the
//! warm values; `time_constant` (s), 3 s and a thirtieth of the record at least, two fifths of it at
//! most: slower drift acts like a constant. Nothing on a machine warms faster, and in a short record
//! any change of the movement would look like it.
//!
//! In a residual: an error that is large early in the record (or late) and follows the sign of the
//! velocity. Confused with: drift of a sensor (which does not change sign with the velocity),
//! differences between records.

use super::{Axis, Effect, Shape, Term};

/// Shortest time constant (s).
const SHORTEST_S: f64 = 3.0;

pub(super) const EFFECT: Effect = Effect {
    id: "thermal_drift",
    sites: &["master", "slave", "line"],
    words: "friction that drifts as the machine warms",
    experiment: "the same movement for ten times as long, begun cold, with the temperature \
                 recorded",
    refines: Some("coulomb_friction"),
    applies: |axis| time_constants(axis).1 > 2.0 * SHORTEST_S,
    uses_sign: true,
    terms: |axis| {
        vec![
            Term::free("coulomb_excess", axis.units.force),
            Term::free("viscous_excess", axis.units.damping),
        ]
    },
    shapes: |axis| vec![Shape::by_factors("time_constant", "s", time_constants(axis), 6)],
    force: Some(|now, shapes, _, out| {
        let cold = (-now.time / shapes[0]).exp();
        (out[0], out[1]) = (now.sign * cold, now.velocity * cold);
    }),
    ..Effect::NONE
};

/// Shortest and longest time constant that the records can show (s).
fn time_constants(axis: &Axis) -> (f64, f64) {
    ((0.03 * axis.seconds).max(SHORTEST_S), 0.4 * axis.seconds)
}
