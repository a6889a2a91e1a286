//! `extra_inertia`: inertia beyond the declared.
//!
//! `I' = I + J`.

use super::{Effect, Site, effect};

effect! {
    /// Inertia beyond the declared.
    pub struct ExtraInertia {
        /// Added inertia `J`.
        inertia: "kg m^2 (kg)", 0.0, 1e4, 1e-3, "assumed: half the slave";
    }
}

impl Effect for ExtraInertia {
    fn id(&self) -> &'static str {
        "extra_inertia"
    }

    fn site(&self) -> Site {
        self.site
    }

    fn extra_inertia(&self) -> f64 {
        self.inertia
    }
}
