//! `line_damping`: damping beyond the declared.
//!
//! `D' = D + c` in eq. 3.1.9, at both ends of both lines. Acts like a changed
//! `port_damping_n_s_per_m`.

use super::{Effect, LineConstants, effect};

effect! {
    "line_damping": "damping beyond the declared";
    at Line = 20.0 "N s/m";
    /// Damping beyond the declared.
    pub struct LineDamping {
        /// Added damping at each port.
        damping: "N s/m", 0.0, 1000.0, 20.0, "about 0.1 of critical in the traced line";
    }
}

impl Effect for LineDamping {
    fn modify(&self, constants: &mut dyn LineConstants) {
        constants.add_line_damping(self.damping);
    }
}
