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
}

impl Effect for ExtraInertia {
    fn extra_inertia(&self) -> f64 {
        self.inertia
    }
}
