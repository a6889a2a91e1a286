//! `stribeck`: falls smoothly with speed from breakaway to kinetic.

use super::{FrictionLaw, Load, OperatingPoint};
use crate::parameter::parameter_set;

parameter_set! {
    /// Smooth Stribeck curve: `F(v) = F_c + (F_s - F_c) exp(-(|v|/v_s)^δ)`, against movement; up to
    /// `F_s` at rest.
    ///
    /// `δ` = 1 is Tustin's form, 2 the Gaussian one. What grows with speed is [`super::Viscous`].
    /// The level is taken at the speed of the [`OperatingPoint`]; a curve that falls in less than a
    /// step's change of speed is not resolved.
    #[derive(Copy, PartialEq)]
    pub struct StribeckCurve {
        /// Kinetic friction `F_c`, left at high speed.
        kinetic: "N m (N)", 0.0, 1e4, 1.10, "§ 3.2.1: τ_sf at its corner";
        /// Breakaway `F_s`.
        breakaway: "N m (N)", 0.0, 1e4, 2.30, "§ 3.2.1: τ_sf at rest";
        /// Speed `v_s` at which 1/e of the difference is left.
        speed: "rad/s (m/s)", 1e-4, 100.0, 3.0, "assumed: half the corner speed of § 3.2.1";
        /// Exponent `δ`.
        exponent: "1", 0.5, 4.0, 2.0,
            "Armstrong-Hélouvry, Dupont, Canudas de Wit 1994: 1 Tustin, 2 Gaussian";
    }
}

impl StribeckCurve {
    /// Magnitude at a speed (its sign does not matter).
    #[inline]
    pub fn level(&self, speed: f64) -> f64 {
        let ratio = speed.abs() / self.speed;
        let power = if self.exponent == 2.0 { ratio * ratio } else { ratio.powf(self.exponent) };
        self.kinetic + (self.breakaway - self.kinetic) * (-power).exp()
    }
}

impl FrictionLaw for StribeckCurve {
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint) {
        load.dry.add(self.level(at.velocity), self.breakaway);
    }
}
