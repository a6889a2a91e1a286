//! Stribeck friction: higher near standstill.
//!
//! `F = stribeck · sign(v) · exp(-(v/stribeck_speed)²)` in addition to Coulomb friction, which a
//! high Stribeck speed would otherwise imitate. Source: Armstrong-Hélouvry, Dupont, Canudas de Wit,
//! Automatica 30 (1994), eq. 3.
//!
//! Parameters: `stribeck` (N or N·m), at least 0, usually 5 to 60 % of the Coulomb friction;
//! `stribeck_speed` (m/s or rad/s), 1 to 35 % of the record's highest speed: above that, the curve
//! is as wide as the speed range and acts like a changed viscous friction.
//!
//! In a residual: a spike on either side of a reversal. Confused with: presliding hysteresis, a
//! wrong smoothing speed.

use super::{Axis, Effect, Instant, Law, Regressor, Shape, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "stribeck_friction",
    sites: &["master", "slave"],
    words: "friction that falls with speed near standstill (Stribeck)",
    experiment: "constant speeds spaced by factors of two down to the slowest that the drive can \
                 hold, both ways",
    regressor: &StribeckFriction,
};

struct StribeckFriction;

impl Regressor for StribeckFriction {
    fn needs(&self) -> &'static [&'static str] {
        &["coulomb_friction"]
    }
    fn uses_sign(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::positive("stribeck", axis.units.force)]
    }
    fn shapes(&self, axis: &Axis) -> Vec<Shape> {
        let range = (0.01 * axis.velocity_peak, 0.35 * axis.velocity_peak);
        vec![Shape::by_factors("stribeck_speed", axis.units.velocity, range, 7)]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for StribeckFriction {
    fn force(&self, now: &Instant, shapes: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = now.sign * (-(now.velocity / shapes[0]).powi(2)).exp();
    }
}
