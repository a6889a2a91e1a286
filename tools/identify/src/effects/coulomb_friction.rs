//! Coulomb friction: a constant force against the motion.

use super::{Effect, InverseEffect, Term, Units};
use crate::inverse::signals::Signals;

/// `F = coulomb · sign(v)`, at least 0: friction takes energy out.
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
        "slow strokes at several constant speeds, both ways: the force that is left at vanishing speed is Coulomb friction"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for CoulombFriction {
    fn terms(&self, units: &Units) -> Vec<Term> {
        vec![Term { name: "coulomb".into(), unit: units.force.into(), bound: (0.0, f64::INFINITY) }]
    }
    fn columns(&self, _: &Signals, sign: &[f64], _: &[f64]) -> Vec<Vec<f64>> {
        vec![sign.to_vec()]
    }
}
