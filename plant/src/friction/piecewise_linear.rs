//! `piecewise_linear`: the thesis's Stribeck friction (fig. 3.2B).

use super::{FrictionLaw, Load, OperatingPoint};
use crate::parameter::parameter_set;

parameter_set! {
    /// Piecewise linear Stribeck friction (fig. 3.2B): falls from the static value up to a corner
    /// speed, then rises.
    ///
    /// The print leaves out the sign of speed; here the law acts against movement either way.
    #[derive(Copy, PartialEq)]
    pub struct Stribeck {
        /// At rest.
        at_rest: "N m (N)", 0.0, 1e4, 2.30, "§ 3.2.1: τ_sf";
        /// Fall per speed below the corner, positive for falling.
        falling: "N m s/rad (N s/m)", -1e4, 1e4, 0.2, "§ 3.2.1: τ_sf";
        /// Corner speed.
        corner: "rad/s (m/s)", 0.0, 1e4, 6.0, "§ 3.2.1: τ_sf";
        /// Just above the corner.
        above_corner: "N m (N)", 0.0, 1e4, 1.10, "§ 3.2.1: τ_sf";
        /// Rise per speed above the corner.
        rising: "N m s/rad (N s/m)", -1e4, 1e4, 0.2, "§ 3.2.1: τ_sf";
    }
}

impl Stribeck {
    /// Magnitude at a speed (its sign does not matter); never negative.
    #[inline(always)]
    pub fn level(&self, speed: f64) -> f64 {
        let speed = speed.abs();
        let level = if speed < self.corner {
            self.at_rest - self.falling * speed
        } else {
            self.above_corner + self.rising * (speed - self.corner)
        };
        level.max(0.0)
    }
}

impl FrictionLaw for Stribeck {
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint) {
        load.dry.add(self.level(at.velocity), self.level(0.0));
    }
}
