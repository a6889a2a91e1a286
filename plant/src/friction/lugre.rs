//! `lugre`: bristles, the Stribeck curve and viscous friction in one.

use super::{Bristle, FrictionLaw, Load, OperatingPoint, StribeckCurve};
use crate::parameter::parameter_set;

parameter_set! {
    /// The LuGre law: `ż = v - σ₀ |v| z / g(v)`, `F = σ₀ z + σ₁ ż + σ₂ v`, with `g` the Gaussian
    /// [`StribeckCurve`].
    ///
    /// Sliding steadily, `F = g(v) + σ₂ v`. It has presliding, a breakaway that falls as the force
    /// comes on faster, and a lag of friction behind speed; no exact stick: a constant force below
    /// breakaway ends at a deflection, one that also shakes creeps on, as with [`super::Dahl`].
    /// `σ₁` falls with speed (see [`Bristle`]), so that the law stays passive.
    pub struct LuGre {
        /// Kinetic friction `F_c`.
        kinetic: "N m (N)", 1e-9, 1e4, 1.10, "§ 3.2.1: τ_sf at its corner";
        /// Breakaway under a slow force `F_s`.
        breakaway: "N m (N)", 1e-9, 1e4, 2.30, "§ 3.2.1: τ_sf at rest";
        /// Stribeck speed `v_s`.
        speed: "rad/s (m/s)", 1e-4, 100.0, 3.0, "assumed: half the corner speed of § 3.2.1";
        /// Stiffness of the bristles `σ₀`.
        stiffness: "N m/rad (N/m)", 1e-6, 1e9, 200.0, "assumed: breakaway within 1 degree";
        /// Damping of the bristles `σ₁`.
        damping: "N m s/rad (N s/m)", 0.0, 1e6, 1.3, "assumed: critical on 2 g m^2";
        /// Viscous friction `σ₂`.
        viscous: "N m s/rad (N s/m)", 0.0, 1e5, 0.0, "assumed";
    }
    state {
        bristle: Bristle = Bristle::default();
    }
}

impl LuGre {
    /// Deflection of the bristles, rad (m).
    pub fn deflection(&self) -> f64 {
        self.bristle.deflection()
    }

    /// `g(v)`, the level at which the bristles slip, N·m (N).
    pub fn curve(&self) -> StribeckCurve {
        StribeckCurve {
            kinetic: self.kinetic,
            breakaway: self.breakaway,
            speed: self.speed,
            exponent: 2.0,
        }
    }
}

impl FrictionLaw for LuGre {
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint) {
        let level = self.curve().level(at.velocity);
        self.bristle.contribute(load, self.stiffness, self.damping, level, at);
        load.viscous_forward += self.viscous;
        load.viscous_backward += self.viscous;
    }

    fn settle(&mut self, displacement: f64, _step: f64) {
        self.bristle.settle(displacement);
    }

    fn reset(&mut self) {
        self.bristle = Bristle::default();
    }

    fn stored_j(&self) -> f64 {
        self.bristle.stored_j()
    }
}
