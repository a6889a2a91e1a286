//! `quadratic_drag`: drag that grows with the square of speed.
//!
//! `τ_f = c |q̇| q̇`: turbulent flow through ports and bends.

use super::{Effect, Moment, SideLoad, effect};

effect! {
    "quadratic_drag": "drag with the square of speed";
    at Master = 0.005 "N m s^2/rad^2", Slave = 0.005 "N m s^2/rad^2";
    /// Drag with the square of speed.
    pub struct QuadraticDrag {
        /// Coefficient `c`.
        coefficient: "N m s^2/rad^2 (N s^2/m^2)", 0.0, 1e6, 0.005, "assumed: 0.5 N m at 10 rad/s";
    }
    search {
        space: |of| of.sizes(of.up_to("coefficient", 20.0), &[0.3, 1.0]),
    }
}

impl Effect for QuadraticDrag {
    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        let viscous = self.coefficient * load.velocity_rad_s.abs();
        load.load.viscous_forward += viscous;
        load.load.viscous_backward += viscous;
    }
}
