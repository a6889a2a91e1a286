//! Friction that differs by direction.
//!
//! With `c₊, c₋` the viscous and `F₊, F₋` the Coulomb terms of the two directions, friction is
//!
//! `F = (c₊+c₋)/2 · v + (c₊-c₋)/2 · |v| + (F₊+F₋)/2 · sign v + (F₊-F₋)/2 · |sign v|`.
//!
//! The first and third terms are the symmetric model. The last one is 1 wherever the machine moves,
//! as is the column of the offset: the two differ only at standstill, where the force is hidden by
//! static friction. The difference of the Coulomb terms can therefore not be distinguished from the
//! offset, is absorbed by it, and has no column here. What remains is the viscous part. Source:
//! Janot, Gautier, Brunot 2019 (EMPS), direction-dependent friction.
//!
//! Parameter: `viscous_difference = (c₊-c₋)/2` (N·s/m or N·m·s/rad), any sign, positive where
//! friction is higher in the positive direction; at most the viscous friction itself.
//!
//! In a residual: plotted over the velocity, a V. Confused with: an offset, where the speed is the
//! same in both directions; quadratic drag that acts in one direction only.

use super::{Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "asymmetric_friction",
    sites: &["master", "slave"],
    words: "friction that differs by direction",
    experiment: "strokes both ways at several constant speeds, and the force at rest with the \
                 motor free: the slopes give the viscous difference, and the force at rest parts \
                 the Coulomb difference from the offset",
    terms: |axis| vec![Term::free("viscous_difference", axis.units.damping)],
    force: Some(|now, _, _, out| out[0] = now.velocity.abs()),
    ..Effect::NONE
};
