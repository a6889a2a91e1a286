//! `load_dependent`: grows with the transmitted load, and saturates.

use super::{FrictionLaw, Load, OperatingPoint};
use crate::parameter::parameter_set;

parameter_set! {
    /// Dry friction that grows with the transmitted load: `S (1 - exp(-μ |τ| / S))`, which starts
    /// as `μ |τ|` and ends at `S`.
    ///
    /// § 5.2.2: friction "increases with the initial tension and seems to slowly converge to a
    /// constant value" (fig. 5.6). The exponential is assumed; the print shows the shape only.
    #[derive(Copy, PartialEq)]
    pub struct LoadDependent {
        /// Friction per transmitted load at little load `μ`; below 1, or nothing would ever move.
        coefficient: "1", 0.0, 0.9, 0.1, "assumed";
        /// Friction at high load `S`; infinite for none.
        saturation: "N m (N)", 1e-6, f64::INFINITY, 0.5, "§ 5.2.2: level of the cable's friction";
    }
}

impl LoadDependent {
    /// Magnitude under a load (its sign does not matter), N·m (N).
    #[inline]
    pub fn level(&self, transmitted: f64) -> f64 {
        let unsaturated = self.coefficient * transmitted.abs();
        let part = unsaturated / self.saturation;
        // -expm1 keeps its digits where little is saturated, and an infinite saturation leaves the
        // straight line.
        if part > 0.0 { unsaturated * (-(-part).exp_m1() / part) } else { unsaturated }
    }
}

impl FrictionLaw for LoadDependent {
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint) {
        let level = self.level(at.transmitted);
        load.dry.add(level, level);
    }
}
