//! `line_damping`: damping beyond the declared.
//!
//! `D' = D + c` in eq. 3.1.9, at both ends of both lines. Acts like a changed
//! `port_damping_n_s_per_m`.
//!
//! # In a model of one channel
//!
//! Damping in the line beyond the declared tolerance.
//!
//! `F = d v` with `d` outside the declared range, in parallel with a spring (Kelvin-Voigt).
//!
//! Parameter: `damping_beyond_declared` (N·s/m or N·m·s/rad), fitted less declared; any sign; the
//! sum is at least 0.
//!
//! In a residual: plotted over the velocity, a straight line; plotted over the position, loops that
//! widen with frequency. Confused with: a relaxing branch faster than the movement, viscous
//! friction, dead time.

use super::one_channel::{Declared, Term};
use super::{Effect, LineConstants, effect};

effect! {
    "line_damping": "damping beyond the declared";
    at Line = 20.0 "N s/m";
    /// Damping beyond the declared.
    pub struct LineDamping {
        /// Added damping at each port.
        damping: "N s/m", 0.0, 1000.0, 20.0, "about 0.1 of critical in the traced line";
    }
    one_channel {
        rank: 160,
        words: "damping in the line beyond the declared tolerance",
        experiment: "sines of the same amplitude at frequencies spaced by factors of two: the loop \
                     of a damper grows with frequency, that of a relaxing branch has a largest \
                     one, that of friction stays",
        lifts: Some(Declared::Viscous),
        applies: |axis| axis.spring,
        linear: true,
        terms: |axis| vec![Term::positive("damping_beyond_declared", axis.units.damping)],
        columns: Some(|view, _| vec![view.signals.velocity.clone()]),
        of_plant: |fit| fit.renamed(&[("damping_beyond_declared", "damping")]),
    }
}

impl Effect for LineDamping {
    fn modify(&self, constants: &mut dyn LineConstants) {
        constants.add_line_damping(self.damping);
    }
}
