//! `viscoelastic_line`: a line whose stiffness decays with time.
//!
//! A Maxwell branch beside each spring: `F += κ 2K e`, `ė = ẋ - e/τ`. Fast movement sees `(1 + κ)
//! 2K`, slow movement `2K`. Source: standard linear solid (plastic hose).

use super::search::{SearchRange, pairs};
use super::{Demand, Effect, LineConstants, Link, Moment, effect};

effect! {
    "viscoelastic_line": "a relaxing branch (Maxwell): stiffness that decays with time";
    at Line = 0.5 "1";
    /// A relaxing branch beside each spring.
    pub struct ViscoelasticLine {
        /// Stiffness of the branch over the declared, `κ`.
        stiffness_ratio: "1", 0.0, 10.0, 0.5, "assumed";
        /// Relaxation time `τ`.
        relaxation_s: "s", 1e-3, 100.0, 0.1, "assumed";
    }
    state {
        stretch_m: [[f64; 2]; 2] = [[0.0; 2]; 2];
        deflection_m: [[f64; 2]; 2] = [[0.0; 2]; 2];
    }
    search {
        space: |of| of.space(
            [
                SearchRange::linear("stiffness_ratio", 0.0, 10.0),
                SearchRange::logarithmic("relaxation_s", 3e-3, 3.0),
            ],
            pairs(("stiffness_ratio", &[0.2, 1.0]), ("relaxation_s", &[0.01, 0.03, 0.1, 0.3])),
        ),
    }
}

impl Effect for ViscoelasticLine {
    fn prepare(&mut self, _constants: &dyn LineConstants) {
        self.stretch_m = [[0.0; 2]; 2];
        self.deflection_m = [[0.0; 2]; 2];
    }

    fn demand(&self) -> Demand {
        Demand { stiffness_factor: 1.0 + self.stiffness_ratio, rate_rad_s: 0.1 / self.relaxation_s }
    }

    fn link(&mut self, link: &mut Link, moment: &Moment) {
        let (line, end) = (link.line, link.end as usize);
        let half_decay = (-0.5 * moment.step_s / self.relaxation_s).exp();
        let change = link.deflection_m - self.deflection_m[line][end];
        // Exact for a deflection that changes in the middle between two calls.
        let stretch = (self.stretch_m[line][end] * half_decay + change) * half_decay;
        self.stretch_m[line][end] = stretch;
        self.deflection_m[line][end] = link.deflection_m;
        let force = self.stiffness_ratio * link.stiffness_n_per_m * stretch;
        link.force_n += force;
        link.fluid_force_n += force;
    }
}
