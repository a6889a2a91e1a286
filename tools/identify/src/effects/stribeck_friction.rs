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

use super::{Effect, Shape, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "stribeck_friction",
    sites: &["master", "slave"],
    words: "friction that falls with speed near standstill (Stribeck)",
    experiment: "constant speeds spaced by factors of two down to the slowest that the drive can \
                 hold, both ways",
    needs: &["coulomb_friction"],
    uses_sign: true,
    terms: |axis| vec![Term::positive("stribeck", axis.units.force)],
    shapes: |axis| {
        let range = (0.01 * axis.velocity_peak, 0.35 * axis.velocity_peak);
        vec![Shape::by_factors("stribeck_speed", axis.units.velocity, range, 7)]
    },
    force: Some(|now, shapes, _, out| {
        out[0] = now.sign * (-(now.velocity / shapes[0]).powi(2)).exp()
    }),
    ..Effect::NONE
};
