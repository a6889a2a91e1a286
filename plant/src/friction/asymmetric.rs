//! `asymmetric`: differs by direction.

use super::{FrictionLaw, Load, OperatingPoint};
use crate::parameter::parameter_set;

parameter_set! {
    /// Dry and viscous friction that differ by direction: `c ± a` dry and `b ± d` viscous, `+` for
    /// forward movement.
    ///
    /// Differences beyond the declared parts take from what other laws put into the load before;
    /// the total of a direction never falls below zero.
    #[derive(Copy, PartialEq)]
    pub struct Asymmetric {
        /// Dry part `c`, mean of the two directions.
        level: "N m (N)", 0.0, 1e4, 0.95,
            "§ 5.2.2: 0.9 N m forward, 1.0 N m backward, at the motor";
        /// Half the difference `a` of the dry parts, positive for more forward.
        difference: "N m (N)", -1e4, 1e4, -0.05, "§ 5.2.2";
        /// Viscous part `b`, mean of the two directions.
        viscous: "N m s/rad (N s/m)", 0.0, 1e5, 0.0, "§ 5.2.2 measured at 0.008 Hz only";
        /// Half the difference `d` of the viscous parts, positive for more forward.
        viscous_difference: "N m s/rad (N s/m)", -1e5, 1e5, 0.0,
            "§ 5.2.2 measured at 0.008 Hz only";
    }
}

impl FrictionLaw for Asymmetric {
    fn contribute(&mut self, load: &mut Load, _at: &OperatingPoint) {
        let (forward, backward) = (self.level + self.difference, self.level - self.difference);
        load.dry.forward += forward;
        load.dry.forward_at_rest += forward;
        load.dry.backward += backward;
        load.dry.backward_at_rest += backward;
        // `advance` keeps the dry total from falling below zero, not the viscous one.
        load.viscous_forward =
            (load.viscous_forward + self.viscous + self.viscous_difference).max(0.0);
        load.viscous_backward =
            (load.viscous_backward + self.viscous - self.viscous_difference).max(0.0);
    }
}
