//! `position_dependent_friction`: friction that varies along the stroke.
//!
//! All dry friction of the side times `1 + a sin(n q + φ)`. Ch. 4 (introduction): "static friction
//! varies with position"; fig. 5.5 shows it.

use super::search::{SearchRange, pairs};
use super::{Effect, Moment, SideLoad, effect};
use crate::friction::PositionDependent;

effect! {
    "position_dependent_friction": "friction that varies along the stroke";
    at Master = 0.3 "1", Slave = 0.3 "1";
    /// Friction that varies along the stroke.
    pub struct PositionDependentFriction {
        /// Relative amplitude `a`.
        amplitude: "1", -1.0, 1.0, 0.3, "fig. 5.5, order of magnitude";
        /// Waves per radian of angle `n`.
        order: "1/rad (1/m)", 0.01, 1000.0, 1.0, "assumed";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.785, "assumed";
    }
    search {
        space: |of| of
            .space(
                [SearchRange::spatial_frequency("order", 0.9, 12.0)],
                pairs(("amplitude", &[0.2]), ("order", &[1.0, 2.0, 3.0, 5.0])),
            )
            .phasor("amplitude", 1.0),
    }
}

impl Effect for PositionDependentFriction {
    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        let law = PositionDependent {
            level: 1.0,
            amplitude: self.amplitude,
            order: self.order,
            phase: self.phase,
            overtone_amplitude: 0.0,
            overtone_phase: 0.0,
        };
        load.load.dry.scale(law.factor(load.position_rad));
    }
}
