//! `viscoelastic_line`: a line whose stiffness decays with time.
//!
//! A Maxwell branch beside each spring: `F += κ 2K e`, `ė = ẋ - e/τ`. Fast movement sees `(1 + κ)
//! 2K`, slow movement `2K`. Source: standard linear solid (plastic hose).
//!
//! # In a model of one channel
//!
//! A relaxing branch: stiffness that decays with time.
//!
//! `F = branch_stiffness · e`, `ė = v - e / relaxation`: a Maxwell branch in parallel with the
//! declared spring (standard linear solid). In fast movement both springs act, in slow movement
//! only the declared one. Source: Findley, Lai, Onaran, Creep and Relaxation of Nonlinear
//! Viscoelastic Materials (1976), ch. 5. The branch starts relaxed.
//!
//! Parameters: `branch_stiffness` (N/m or N·m/rad), at least 0, a few per cent to several times the
//! declared stiffness; `relaxation` (s), from half a radian at the cut-off frequency to a third of
//! the record: faster branches act like a damper, slower ones like a spring.
//!
//! In a residual: after a step of the position the force decays; the width of the loop has a
//! maximum over frequency. Confused with: damping (movement slower than the relaxation), stiffness
//! (faster), leakage (decays to zero).

use super::one_channel::{Quantity, Shape, Term};
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
    one_channel {
        rank: 140,
        words: "a relaxing branch (viscoelasticity)",
        experiment: "a step that is held for ten times the relaxation, and sines of the same \
                     amplitude at frequencies spaced by factors of two",
        applies: |axis| axis.spring,
        linear: true,
        terms: |axis| vec![Term::positive("branch_stiffness", axis.units.stiffness)],
        shapes: |axis| {
            let fastest = 0.5 / (std::f64::consts::TAU * axis.cut_off);
            vec![Shape::by_factors("relaxation", "s", (fastest, axis.seconds / 3.0), 10)]
        },
        columns: Some(|view, shapes| {
            let (time, position) = (&view.signals.time, &view.signals.position);
            let mut stretch = 0.0;
            let mut column = vec![0.0; position.len()];
            for i in 1..position.len() {
                // Exact for a position that is linear between samples.
                let share = (time[i] - time[i - 1]) / shapes[0];
                let kept = (-share).exp();
                stretch = stretch * kept + (position[i] - position[i - 1]) * (1.0 - kept) / share;
                column[i] = stretch;
            }
            vec![column]
        }),
        states: 1,
        rates: |now, shapes, states, rates| rates[0] = now.velocity - states[0] / shapes[0],
        force: Some(|_, _, states, out| out[0] = states[0]),
        // The plant's branch is relative to the spring in parallel, added compliance included.
        of_plant: |fit| {
            let branch = fit.own("branch_stiffness")?;
            let value = branch.value / fit.declared_in(branch.unit)?.fitted;
            let relaxation = Quantity { name: "relaxation_s", ..*fit.own("relaxation")? };
            Some(vec![Quantity { name: "stiffness_ratio", value, unit: "1" }, relaxation])
        },
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
