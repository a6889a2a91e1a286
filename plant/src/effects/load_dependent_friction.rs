//! `load_dependent_friction`: friction that grows with the transmitted torque.
//!
//! `τ_f += μ |τ_line| sgn(q̇)`: seals pressed by the fluid, bearings by the belt; the law of
//! [`crate::friction::LoadDependent`] without its saturation.
//!
//! # In a model of one channel
//!
//! Friction that grows with the transmitted force.
//!
//! `F = coefficient · |f| · sign(v)`, where `f` is the force that the rest of the model predicts:
//! bearings loaded by the belt, seals loaded by the fluid. `f` is computed from the motion, not
//! measured, since noise of the measured force would explain itself.
//!
//! Parameter: `coefficient` (1), 0 to 0.9; 0.01 for ball bearings, 0.1 to 0.3 for dry seals.
//!
//! In a residual: plotted over the force, a V in one direction and its mirror image in the other;
//! nothing without load. Confused with: Coulomb friction (constant load), a wrong scale of the
//! force.

use super::one_channel::Term;
use super::search::SearchRange;
use super::{Effect, Moment, SideLoad, effect};
use crate::friction::{FrictionLaw, LoadDependent};

effect! {
    "load_dependent_friction": "friction that grows with the transmitted torque";
    at Master = 0.1 "1", Slave = 0.1 "1";
    /// Friction that grows with load.
    pub struct LoadDependentFriction {
        /// Friction per transmitted torque `μ`.
        coefficient: "1", 0.0, 0.9, 0.1, "assumed";
    }
    search {
        space: |of| {
            of.sizes(SearchRange::linear("coefficient", 0.0, 0.9), &[0.3, 1.0, 2.0])
        },
    }
    one_channel {
        rank: 90,
        words: "friction that grows with the load",
        experiment: "the same strokes with two different known loads: Coulomb friction stays, \
                     load-dependent friction grows in proportion",
        uses_sign: true,
        uses_model: true,
        terms: |_| vec![Term { bound: (0.0, 0.9), ..Term::positive("coefficient", "1") }],
        columns: Some(|view, _| {
            vec![view.model.iter().zip(view.sign).map(|(f, s)| f.abs() * s).collect()]
        }),
        force: Some(|now, _, _, out| out[0] = now.load.abs() * now.sign),
        beside_functions: true,
        // The fit's coefficient refers to the force without this friction, the plant's to all
        // that is transmitted.
        of_plant: |_| None,
    }
}

impl Effect for LoadDependentFriction {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let at = load.operating_point(moment);
        let mut law = LoadDependent { coefficient: self.coefficient, saturation: f64::INFINITY };
        law.contribute(&mut load.load, &at);
    }
}
