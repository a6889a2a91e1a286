//! Coulomb friction: a constant force against the motion.
//!
//! `F = coulomb · sign(v)`, the sign smoothed as `tanh(v / smoothing_speed)`. Source: Coulomb;
//! Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994), eq. 1.
//!
//! Parameter: `coulomb` (N or N·m), at least 0, since friction takes energy out; from some per cent
//! of the drive's force in ball bearings to half of it at rubber seals.
//!
//! In a residual: a step at each reversal of the velocity, flat between. Confused with: presliding
//! hysteresis (a step over a travel instead of a speed), load-dependent friction where the load
//! hardly varies.

use super::{Axis, Effect, Instant, InverseEffect, Law, Term};

pub(super) struct CoulombFriction;

impl Effect for CoulombFriction {
    fn id(&self) -> &'static str {
        "coulomb_friction"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["master", "slave"]
    }
    fn words(&self) -> &'static str {
        "Coulomb friction"
    }
    fn experiment(&self) -> &'static str {
        "slow strokes at several constant speeds, both ways: the force that is left at vanishing \
         speed is Coulomb friction"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for CoulombFriction {
    fn uses_sign(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::positive("coulomb", axis.units.force)]
    }
    fn law(&self) -> Option<&dyn Law> {
        Some(self)
    }
}

impl Law for CoulombFriction {
    fn force(&self, now: &Instant, _: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = now.sign;
    }
}
