//! `stribeck_friction`: friction that is higher at rest and falls with speed.
//!
//! `τ_f += s exp(-(q̇/v_s)²) sgn(q̇)`. Source: Armstrong-Hélouvry, Dupont, Canudas de Wit,
//! Automatica 30 (1994).
//!
//! # In a model of one channel
//!
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

use super::one_channel::{Shape, Term};
use super::search::{MultiStart, SearchRange, pairs};
use super::{Effect, Moment, SideLoad, effect};
use crate::friction::{FrictionLaw, StribeckCurve};

effect! {
    "stribeck_friction": "friction that is higher at rest and falls with speed";
    at Master = 0.5 "N m", Slave = 0.5 "N m";
    /// Extra friction near rest.
    pub struct StribeckFriction {
        /// Extra breakaway `s`.
        level: "N m (N)", 0.0, 1e4, 0.5, "assumed";
        /// Speed `v_s` at which 1/e of it is left.
        speed: "rad/s (m/s)", 1e-4, 100.0, 1.0, "assumed";
    }
    search {
        space: |of| {
            let levels = [0.4, 1.0, 2.5].map(|level| level * of.size);
            let free = [of.up_to("level", 6.0), SearchRange::logarithmic("speed", 0.03, 10.0)];
            of.space(free, pairs(("level", &levels), ("speed", &[0.1, 0.4, 1.5])))
                .multi_start(MultiStart::Always)
        },
        bistable: true,
    }
    one_channel {
        rank: 30,
        words: "friction that falls with speed near standstill (Stribeck)",
        experiment: "constant speeds spaced by factors of two down to the slowest that the drive \
                     can hold, both ways",
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
        of_plant: |fit| fit.renamed(&[("stribeck", "level"), ("stribeck_speed", "speed")]),
    }
}

impl Effect for StribeckFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        let mut law =
            StribeckCurve { kinetic: 0.0, breakaway: self.level, speed: self.speed, exponent: 2.0 };
        law.contribute(&mut load.load, &at);
    }
}
