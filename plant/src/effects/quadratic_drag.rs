//! `quadratic_drag`: drag that grows with the square of speed.
//!
//! `τ_f = c |q̇| q̇`: turbulent flow through ports and bends.
//!
//! # In a model of one channel
//!
//! Drag that grows with the square of speed.
//!
//! `F = coefficient · |v| v`: turbulent flow through ports and bends, air. Source: Borda-Carnot;
//! Merritt, Hydraulic Control Systems (1967), ch. 3.
//!
//! Parameter: `coefficient` (N·s²/m² or N·m·s²/rad²), at least 0; at the highest speed, from a few
//! per cent to the whole of the viscous friction.
//!
//! In a residual: plotted over the velocity, an S that is steeper at both ends. Confused with:
//! viscous friction (over a narrow range of speed), negative Stribeck friction.

use super::one_channel::Term;
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
    one_channel {
        rank: 60,
        words: "drag that grows with the square of speed",
        experiment: "constant speeds up to the highest that the drive can hold, both ways: drag \
                     quadruples when speed doubles",
        terms: |axis| {
            vec![Term::positive(
                "coefficient",
                format!("{}·({})⁻²", axis.units.force, axis.units.velocity),
            )]
        },
        force: Some(|now, _, _, out| out[0] = now.velocity.abs() * now.velocity),
        of_plant: |fit| fit.renamed(&[("coefficient", "coefficient")]),
    }
}

impl Effect for QuadraticDrag {
    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        let viscous = self.coefficient * load.velocity_rad_s.abs();
        load.load.viscous_forward += viscous;
        load.load.viscous_backward += viscous;
    }
}
