//! `line_compliance`: more compliance in series than the fluid's.
//!
//! `1/K' = (1 + r)/K`: hose bulging, belts, entrained gas, which § 3.2.2 neglects. The traced rig
//! is the printed one with `r = 13`. Acts like a changed `line_stiffness_factor`.

use super::{Effect, LineConstants, effect};

effect! {
    "line_compliance": "more compliance in series than the fluid's (hose bulging, belts)";
    at Line = 1.0 "1";
    /// More compliance in series.
    pub struct LineCompliance {
        /// Added compliance over the line's own.
        compliance_ratio: "1", 0.0, 200.0, 1.0, "§ 3.2.2; 13 traces the rig";
    }
}

impl Effect for LineCompliance {
    fn modify(&self, constants: &mut dyn LineConstants) {
        constants.scale_line_stiffness(1.0 / (1.0 + self.compliance_ratio));
    }
}
