//! `hand_impedance`: a hand on the handle that the torque cell does not measure.
//!
//! `τ = -k q - b q̇`, and inertia `J`: spring, damper and mass of a limb that holds the slave
//! inboard of the torque cell, relaxed at the slave's zero. Size is `k`; the damper is `b = k t_b`
//! and the inertia `J = k t_J²`. Defaults are of the order of a relaxed wrist; assumed.

use super::search::SearchRange;
use super::{Effect, Moment, SideLoad, effect};

effect! {
    "hand_impedance": "spring, damper and mass of a hand that the model leaves out";
    at Slave = 1.0 "N m/rad";
    /// Spring, damper and mass of a hand.
    pub struct HandImpedance {
        /// Stiffness `k`.
        stiffness: "N m/rad", 0.0, 100.0, 1.0, "relaxed wrist: about 1";
        /// Damping over stiffness `t_b`.
        damper_time_s: "s", 0.0, 1.0, 0.03, "assumed";
        /// Root of inertia over stiffness `t_J`.
        inertia_time_s: "s", 0.0, 1.0, 0.05, "assumed";
    }
    search {
        space: |of| {
            let names = ["stiffness", "damper_time_s", "inertia_time_s"];
            let most = [30.0, 0.5, 0.2];
            let free = [0, 1, 2].map(|which| SearchRange::linear(names[which], 0.0, most[which]));
            let starts = [[0.3, 0.02, 0.02], [1.0, 0.03, 0.05], [1.0, 0.1, 0.0]];
            of.space(free, starts.map(|values| names.into_iter().zip(values).collect()).to_vec())
        },
    }
    monitoring {
        of_the_hand: true,
    }
}

impl Effect for HandImpedance {
    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        load.load.force -= self.stiffness * load.position_rad;
        let viscous = self.stiffness * self.damper_time_s;
        load.load.viscous_forward += viscous;
        load.load.viscous_backward += viscous;
    }

    fn extra_inertia(&self) -> f64 {
        self.stiffness * self.inertia_time_s * self.inertia_time_s
    }
}
