//! `thermal_drift`: friction that changes as the machine warms.
//!
//! Friction (at a side: dry and viscous; at the line: the fluid's loss) times `1 + a exp(-t/τ)`,
//! `t` since the start: more when cold for positive `a`.
//!
//! # In a model of one channel
//!
//! Friction that changes as the machine warms up.
//!
//! `F = (coulomb_excess · sign(v) + viscous_excess · v) · exp(-t / time_constant)`, `t` since the
//! start of the record: higher when cold if the excess is positive. Source: viscosity falls with
//! temperature, which approaches its final value exponentially; Bittencourt and Gunnarsson, J. Dyn.
//! Sys. Meas. Control 134 (2012), fig. 6.
//!
//! Parameters: `coulomb_excess` (N or N·m), `viscous_excess` (N·s/m or N·m·s/rad), up to twice the
//! warm values; `time_constant` (s), 3 s and a thirtieth of the record at least, two fifths of
//! it at most: slower drift acts like a constant. Nothing on a machine warms faster, and in a short
//! record any change of the movement would look like it.
//!
//! In a residual: an error that is large early in the record (or late) and follows the sign of the
//! velocity. Confused with: drift of a sensor (which does not change sign with the velocity),
//! differences between records.

use super::one_channel::{Axis, Shape, Term};
use super::search::{Becomes, SearchRange, pairs};
use super::{Effect, Moment, SideLoad, effect};

/// Shortest time constant (s).
const SHORTEST_S: f64 = 3.0;

effect! {
    "thermal_drift": "friction or viscosity that drifts with time on the run";
    at Master = 0.5 "1", Slave = 0.5 "1", Line = 0.5 "1";
    /// Friction that changes as the machine warms.
    pub struct ThermalDrift {
        /// Excess when cold `a`.
        excess: "1", -0.9, 20.0, 0.5, "assumed";
        /// Time constant `τ`.
        time_constant_s: "s", 0.1, 1e5, 20.0, "assumed";
    }
    search {
        space: |of| of
            .space(
                [
                    SearchRange::linear("excess", -0.9, 6.0),
                    SearchRange::logarithmic("time_constant_s", 3.0, 1000.0),
                ],
                pairs(("excess", &[0.3]), ("time_constant_s", &[10.0, 30.0, 100.0])),
            )
            .signed(),
        becomes: Some(Becomes { parameter: "time_constant_s", id: "coulomb_friction" }),
    }
    monitoring {
        sudden: false,
    }
    one_channel {
        rank: 100,
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
        shapes: |axis| {
            vec![Shape::by_factors("time_constant", "s", time_constants(axis), 6)]
        },
        force: Some(|now, shapes, _, out| {
            let cold = (-now.time / shapes[0]).exp();
            (out[0], out[1]) = (now.sign * cold, now.velocity * cold);
        }),
        // The plant's is a fraction of the friction of the side.
        of_plant: |_| None,
    }
}

/// Shortest and longest time constant that the records of one channel can show (s).
fn time_constants(axis: &Axis) -> (f64, f64) {
    ((0.03 * axis.seconds).max(SHORTEST_S), 0.4 * axis.seconds)
}

impl Effect for ThermalDrift {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let factor = self.factor(moment);
        load.load.dry.scale(factor);
        load.load.viscous_forward *= factor;
        load.load.viscous_backward *= factor;
    }

    fn fluid(&mut self, coefficient: f64, moment: &Moment) -> f64 {
        coefficient * self.factor(moment)
    }
}

impl ThermalDrift {
    fn factor(&self, moment: &Moment) -> f64 {
        1.0 + self.excess * (-moment.time_s / self.time_constant_s).exp()
    }
}
