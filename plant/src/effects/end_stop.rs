//! `end_stop`: hard stops that end the handle's travel.
//!
//! Beyond an end the stop pushes back, `τ = -k (q - q_end)`, and a damper `b = k t_b` brakes the
//! approach; the stop never pulls. It acts on the slave; the torque cell, between hand and handle,
//! does not measure it. It is part of the rig that the simulated card simulates
//! (`simulation.end_stop_min_deg`), not a deviation from the model, and therefore not in
//! [`LIST`](super::LIST).
//!
//! The spring acts at the midpoint of the internal step, which conserves its energy; the damper
//! only dissipates. Defaults are assumed: a rubber buffer that yields 0.4° under 3.5 N·m.

use super::{Effect, Moment, SideLoad, Site, effect};

effect! {
    "end_stop": "hard stops that end the travel of the handle";
    at Slave = 500.0 "N m/rad";
    /// Two stiff, damped stops.
    pub struct EndStop {
        /// Stiffness `k`.
        stiffness: "N m/rad", 0.0, 2000.0, 500.0, "assumed";
        /// Damping over stiffness `t_b`.
        damper_time_s: "s", 0.0, 0.1, 0.002, "assumed";
        /// Where the lower stop begins.
        lower_rad: "rad", -100.0, 100.0, -2.0, "assumed";
        /// Where the upper stop begins.
        upper_rad: "rad", -100.0, 100.0, 2.0, "assumed";
    }
}

impl EndStop {
    /// Stops at these angles of the handle (rad).
    pub fn between(lower_rad: f64, upper_rad: f64) -> Self {
        Self { lower_rad, upper_rad, ..Self::at(Site::Slave) }
    }
}

impl Effect for EndStop {
    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        let inside = load.position_rad.max(self.lower_rad).min(self.upper_rad);
        let beyond = load.position_rad - inside;
        load.load.force -= self.stiffness * beyond;
        let viscous = self.stiffness * self.damper_time_s;
        if beyond > 0.0 {
            load.load.viscous_forward += viscous;
        } else if beyond < 0.0 {
            load.load.viscous_backward += viscous;
        }
    }
}
