//! `position_dependent`: varies along the stroke.

use super::{FrictionLaw, Load, OperatingPoint};
use crate::parameter::parameter_set;

parameter_set! {
    /// Dry friction that varies along the stroke: `c (1 + a sin(n q + φ) + b sin(2 n q + ψ))`,
    /// never below zero.
    ///
    /// Ch. 4 (introduction): "static friction varies with position"; fig. 5.5 shows it over the
    /// stroke of both transmissions, as a wave with an overtone.
    #[derive(Copy, PartialEq)]
    pub struct PositionDependent {
        /// Mean level `c`.
        level: "N m (N)", 0.0, 1e4, 0.95, "§ 5.2.2, at the motor";
        /// Relative amplitude `a`.
        amplitude: "1", -1.0, 1.0, 0.3, "fig. 5.5, order of magnitude";
        /// Waves per radian of angle `n`.
        order: "1/rad (1/m)", 0.01, 1000.0, 1.0, "assumed";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.785, "assumed";
        /// Relative amplitude of the overtone `b`.
        overtone_amplitude: "1", -1.0, 1.0, 0.0, "assumed";
        /// Phase of the overtone `ψ`.
        overtone_phase: "rad", -3.15, 3.15, 0.0, "assumed";
    }
}

impl PositionDependent {
    /// Level over mean level at a position, rad (m); never negative.
    #[inline]
    pub fn factor(&self, position: f64) -> f64 {
        let angle = self.order * position;
        let mut factor = 1.0 + self.amplitude * (angle + self.phase).sin();
        if self.overtone_amplitude != 0.0 {
            factor += self.overtone_amplitude * (2.0 * angle + self.overtone_phase).sin();
        }
        factor.max(0.0)
    }
}

impl FrictionLaw for PositionDependent {
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint) {
        let level = self.level * self.factor(at.position);
        load.dry.add(level, level);
    }
}
