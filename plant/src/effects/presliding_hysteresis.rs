//! `presliding_hysteresis`: bristles: friction that builds up over a small travel.
//!
//! Of the side's dry friction the part `p` follows Dahl's law: `τ = p F z`, `dz/dq = (1 - z sgn(q̇))/q_d`, integrated exactly
//! over each step. The rest stays dry. Source: Dahl, 1968; Canudas de Wit et al., IEEE TAC 40 (1995).

use super::{Demand, Effect, LineConstants, Moment, SideLoad, Site, effect};

effect! {
    /// A part of the dry friction as bristles.
    pub struct PreslidingHysteresis {
        /// Part of the dry friction that is bristles `p`.
        part: "1", 0.0, 1.0, 0.5, "assumed";
        /// Travel over which it builds up `q_d`.
        travel: "rad (m)", 1e-6, 1.0, 0.02, "assumed";
    }
    state {
        stretch: f64 = 0.0;
    }
}

impl Effect for PreslidingHysteresis {
    fn id(&self) -> &'static str {
        "presliding_hysteresis"
    }

    fn site(&self) -> Site {
        self.site
    }

    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let travel = load.velocity_rad_s * moment.step_s;
        let forward = travel >= 0.0;
        let level = if forward { load.load.dry.forward } else { load.load.dry.backward };
        let target = if forward { 1.0 } else { -1.0 };
        // Half before, half after: the force is that of the middle of the step.
        let decay = (-0.5 * travel.abs() / self.travel).exp();
        let middle = target + (self.stretch - target) * decay;
        self.stretch = target + (middle - target) * decay;
        load.load.force -= self.part * level * middle;
        load.load.dry.scale(1.0 - self.part);
    }

    fn prepare(&mut self, _constants: &dyn LineConstants) {
        self.stretch = 0.0;
    }

    fn demand(&self) -> Demand {
        // Bristle stiffness p F / q_d on the side's inertia, for frictions of a few N m on 2e-3 kg m².
        Demand { rate_rad_s: (1000.0 * self.part / self.travel).sqrt(), ..Demand::default() }
    }
}
