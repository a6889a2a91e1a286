//! `gravity_imbalance`: a centre of mass off the axis.
//!
//! `τ = -m g l sin(q + φ)`; at `φ = 0` it pulls towards zero.

use super::search::each;
use super::{Effect, Moment, SideLoad, effect};

effect! {
    "gravity_imbalance": "a centre of mass off the axis";
    at Master = 0.2 "N m", Slave = 0.2 "N m";
    /// A centre of mass off the axis.
    pub struct GravityImbalance {
        /// Largest torque `m g l`.
        torque: "N m (N)", -1e3, 1e3, 0.2, "assumed: 0.2 kg at 0.1 m";
        /// Angle `φ` from hanging, at zero position.
        phase: "rad", -3.15, 3.15, 0.0, "assumed";
    }
    search {
        space: |of| of
            .space([], each("torque", &[0.5 * of.size]))
            .phasor("torque", 10.0 * of.size),
    }
}

impl Effect for GravityImbalance {
    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        load.load.force -= self.torque * (load.position_rad + self.phase).sin();
    }
}
