//! `stribeck_friction`: friction that is higher at rest and falls with speed.
//!
//! `τ_f += s exp(-(q̇/v_s)²) sgn(q̇)`. Source: Armstrong-Hélouvry, Dupont, Canudas de Wit,
//! Automatica 30 (1994).

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
}

impl Effect for StribeckFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        let mut law =
            StribeckCurve { kinetic: 0.0, breakaway: self.level, speed: self.speed, exponent: 2.0 };
        law.contribute(&mut load.load, &at);
    }
}
