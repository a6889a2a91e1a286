//! `extra_inertia`: inertia in addition to the declared.
//!
//! `I' = I + J`.
//!
//! # In a model of one channel
//!
//! Mass or inertia beyond the declared tolerance.
//!
//! `F = m a` with `m` outside the declared range: missing physics that acts like a changed
//! parameter. Within the tolerance, such a change is calibration and not an effect. Where no mass
//! is declared, as for a part tested by itself, the declared mass is 0.
//!
//! Parameter: `mass_beyond_declared` (kg or kg·m²), fitted less declared; any sign; the sum is at
//! least 0.
//!
//! In a residual: plotted over the acceleration, a straight line. Confused with: a wrong scale of
//! the force, dead time beside a spring.

use super::one_channel::{Declared, Term};
use super::{Effect, effect};

effect! {
    "extra_inertia": "inertia beyond the declared";
    at Master = 1e-3 "kg m^2", Slave = 1e-3 "kg m^2";
    /// Inertia beyond the declared.
    pub struct ExtraInertia {
        /// Added inertia `J`.
        inertia: "kg m^2 (kg)", 0.0, 1e4, 1e-3, "assumed: half the slave";
    }
    search {
        space: |of| of.sizes(of.up_to("inertia", 20.0), &[0.3, 1.0]),
    }
    one_channel {
        rank: 50,
        words: "mass beyond the declared tolerance",
        experiment: "quick reversals with and without a known mass clamped on: the known mass \
                     gives the scale of force",
        lifts: Some(Declared::Mass),
        linear: true,
        terms: |axis| vec![Term::positive("mass_beyond_declared", axis.units.mass)],
        columns: Some(|view, _| vec![view.signals.acceleration.clone()]),
        beside_functions: true,
        of_plant: |fit| fit.renamed(&[("mass_beyond_declared", "inertia")]),
    }
}

impl Effect for ExtraInertia {
    fn extra_inertia(&self) -> f64 {
        self.inertia
    }
}
