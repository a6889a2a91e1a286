//! `viscous_friction`: friction proportional to speed.
//!
//! `τ_f = b q̇`.
//!
//! # In a model of one channel
//!
//! Viscous friction beyond the declared tolerance.
//!
//! `F = c v` with `c` outside the declared range: missing physics that acts like a changed
//! parameter. Within the tolerance, such a change is calibration and not an effect.
//!
//! Parameter: `viscous_beyond_declared` (N·s/m or N·m·s/rad), fitted less declared; any sign; the
//! sum is at least 0.
//!
//! In a residual: plotted over the velocity, a straight line. Confused with: quadratic drag,
//! damping by a hand, damping in the line.

use super::one_channel::{Declared, Term};
use super::{Effect, Moment, SideLoad, effect};
use crate::friction::{FrictionLaw, Viscous};

effect! {
    "viscous_friction": "friction proportional to speed";
    at Master = 0.05 "N m s/rad", Slave = 0.05 "N m s/rad";
    /// Friction proportional to speed.
    pub struct ViscousFriction {
        /// Coefficient `b`.
        coefficient: "N m s/rad (N s/m)", 0.0, 1e5, 0.05, "assumed";
    }
    search {
        space: |of| of.sizes(of.up_to("coefficient", 20.0), &[0.3, 1.0]),
    }
    one_channel {
        rank: 40,
        words: "viscous friction beyond the declared tolerance",
        experiment: "strokes at several constant speeds, both ways: the slope of force over speed \
                     is the viscous friction",
        lifts: Some(Declared::Viscous),
        linear: true,
        terms: |axis| vec![Term::positive("viscous_beyond_declared", axis.units.damping)],
        columns: Some(|view, _| vec![view.signals.velocity.clone()]),
        of_plant: |fit| fit.renamed(&[("viscous_beyond_declared", "coefficient")]),
    }
}

impl Effect for ViscousFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        Viscous { coefficient: self.coefficient }.contribute(&mut load.load, &at);
    }

    fn extra_friction(&self) -> (f64, f64) {
        (0.0, self.coefficient)
    }
}
