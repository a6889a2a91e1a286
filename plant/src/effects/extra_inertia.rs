//! `extra_inertia`: inertia in addition to the declared.
//!
//! `I' = I + J`.

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
}

impl Effect for ExtraInertia {
    fn extra_inertia(&self) -> f64 {
        self.inertia
    }
}
