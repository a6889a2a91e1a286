//! Coulomb friction: a constant force against the motion.
//!
//! `F = coulomb · sign(v)`, the sign smoothed as `tanh(v / smoothing_speed)`. Source: Coulomb;
//! Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994), eq. 1.
//!
//! Parameter: `coulomb` (N or N·m), at least 0, since friction dissipates energy; from a few per
//! cent of the drive's force with ball bearings to half of it with rubber seals.
//!
//! In a residual: a step at each reversal, constant in between. Confused with: presliding
//! hysteresis (the step extends over a travel instead of a speed), load-dependent friction where
//! the load hardly varies.

use super::{Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "coulomb_friction",
    sites: &["master", "slave"],
    words: "Coulomb friction",
    experiment: "slow strokes at several constant speeds, both ways: the force that is left at \
                 vanishing speed is Coulomb friction",
    uses_sign: true,
    terms: |axis| vec![Term::positive("coulomb", axis.units.force)],
    force: Some(|now, _, _, out| out[0] = now.sign),
    beside_functions: true,
    ..Effect::NONE
};
