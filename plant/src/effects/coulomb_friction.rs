//! `coulomb_friction`: dry friction beyond the declared.
//!
//! `τ_f = c sgn(q̇)`, up to `c` at rest.
//!
//! # In a model of one channel
//!
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

use super::one_channel::{Declared, Term};
use super::search::MultiStart;
use super::{Effect, Moment, SideLoad, effect};
use crate::friction::{Coulomb, FrictionLaw};

effect! {
    "coulomb_friction": "constant friction beyond the declared";
    at Master = 0.3 "N m", Slave = 0.3 "N m";
    /// Constant friction.
    pub struct CoulombFriction {
        /// Friction.
        level: "N m (N)", 0.0, 1e4, 0.3, "assumed";
    }
    search {
        space: |of| of
            .sizes(of.up_to("level", 10.0), &[0.3, 1.0, 3.0])
            .multi_start(MultiStart::WhenLocalised),
    }
    one_channel {
        rank: 10,
        words: "Coulomb friction",
        experiment: "slow strokes at several constant speeds, both ways: the force that is left at \
                     vanishing speed is Coulomb friction",
        same_as: Some(Declared::Coulomb),
        uses_sign: true,
        terms: |axis| vec![Term::positive("coulomb", axis.units.force)],
        force: Some(|now, _, _, out| out[0] = now.sign),
        beside_functions: true,
        of_plant: |fit| fit.renamed(&[("coulomb", "level")]),
    }
}

impl Effect for CoulombFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        Coulomb { level: self.level }.contribute(&mut load.load, &at);
    }

    fn extra_friction(&self) -> (f64, f64) {
        (self.level, 0.0)
    }
}
