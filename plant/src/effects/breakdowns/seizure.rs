//! `seizure`: one side is stuck, as a piston that has jammed.
//!
//! Dry friction far beyond what motor, line and hand can exert: `τ_f = c sgn(q̇)`, up to `c` at
//! rest. The integrator sticks exactly, so the side stops within one internal step and is held
//! without a stiff spring.

use super::super::{Breakdown, Effect, Moment, SideLoad, effect};
use crate::friction::{Coulomb, FrictionLaw};

effect! {
    "seizure": "a side that is stuck";
    at Slave = 1e3 "N m", Master = 1e3 "N m";
    /// A side that is stuck.
    pub struct Seizure {
        /// Friction that holds it.
        friction_nm: "N m (N)", 0.0, 1e4, 1e3, "assumed: a hundred times what a hand exerts";
    }
    state {
        breakdown: Breakdown = Breakdown::default();
    }
}

impl Effect for Seizure {
    fn breakdown(&self) -> Option<&Breakdown> {
        Some(&self.breakdown)
    }

    fn breakdown_mut(&mut self) -> Option<&mut Breakdown> {
        Some(&mut self.breakdown)
    }

    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        if !self.breakdown.over {
            let at = load.operating_point(moment);
            Coulomb { level: self.friction_nm }.contribute(&mut load.load, &at);
        }
    }
}
