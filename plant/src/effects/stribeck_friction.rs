//! `stribeck_friction`: friction that is higher at rest and falls with speed.
//!
//! `τ_f += s exp(-(q̇/v_s)²) sgn(q̇)`. Source: Armstrong-Hélouvry, Dupont, Canudas de Wit,
//! Automatica 30 (1994).

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
}

impl Effect for StribeckFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        let mut law =
            StribeckCurve { kinetic: 0.0, breakaway: self.level, speed: self.speed, exponent: 2.0 };
        law.contribute(&mut load.load, &at);
    }
}
