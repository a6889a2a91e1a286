//! `presliding_hysteresis`: bristles: friction that builds up over a small travel.
//!
//! Of the side's dry friction `F` the part `p` follows Dahl's law ([`crate::friction::Bristle`])
//! with the stiffness `p F / q_d`, `F` being the side's breakaway where it first moves, mean of
//! both directions. The rest stays dry. Source: Dahl, 1968; Canudas de Wit et al., IEEE TAC 40
//! (1995).

use super::search::{SearchRange, pairs};
use super::{Demand, Effect, LineConstants, Moment, SideLoad, Site, effect};
use crate::friction::Bristle;

/// Shortest travel that is searched, in counts of that side's encoder.
const LEAST_COUNTS: f64 = 2.0;

effect! {
    "presliding_hysteresis": "bristles: friction that builds up over a small travel";
    at Master = 0.5 "1", Slave = 0.5 "1";
    /// A part of the dry friction as bristles.
    pub struct PreslidingHysteresis {
        /// Part of the dry friction that is bristles `p`.
        part: "1", 0.0, 1.0, 0.5, "assumed";
        /// Travel over which it builds up `q_d`.
        travel: "rad (m)", 1e-6, 1.0, 0.02, "assumed";
    }
    state {
        bristle: Bristle = Bristle::default();
        stiffness: f64 = 0.0;
    }
    search {
        space: |of| {
            let count_rad = of.features.count_rad[usize::from(of.site == Site::Slave)];
            let least = (LEAST_COUNTS * count_rad).clamp(5e-4, 0.05);
            let travels = [0.004, 0.015, 0.06].map(|travel| f64::max(travel, 1.3 * least));
            of.space(
                [
                    SearchRange::linear("part", 0.0, 1.0),
                    SearchRange::logarithmic("travel", least, 0.3),
                ],
                pairs(("part", &[0.4, 0.95]), ("travel", &travels)),
            )
        },
        imitates_coarse_steps: true,
    }
}

impl Effect for PreslidingHysteresis {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let dry = load.load.dry;
        if self.stiffness == 0.0 {
            // Fixed from here on: a spring whose stiffness changes while it is bent would give
            // energy.
            self.stiffness =
                0.5 * self.part * (dry.forward_at_rest + dry.backward_at_rest) / self.travel;
        }
        let level = self.part * if load.velocity_rad_s >= 0.0 { dry.forward } else { dry.backward };
        let at = load.operating_point(moment);
        self.bristle.contribute(&mut load.load, self.stiffness, level, &at);
        load.load.dry.scale(1.0 - self.part);
    }

    fn moved(&mut self, displacement: f64, _moment: &Moment) {
        self.bristle.settle(displacement);
    }

    fn prepare(&mut self, _constants: &dyn LineConstants) {
        self.bristle = Bristle::default();
        self.stiffness = 0.0;
    }

    fn demand(&self) -> Demand {
        // Bristle stiffness p F / q_d on the side's inertia, for frictions of a few N m on 2e-3 kg
        // m².
        Demand { rate_rad_s: (1000.0 * self.part / self.travel).sqrt(), ..Demand::default() }
    }
}
