//! `hose_rupture`: both hoses of the line have burst.
//!
//! The pressure at the break falls to that of the room; what the pistons still feel of their lines
//! dies away as the relief reaches them: `F → F e^{-t/T}`, spring and damper alike, so that the
//! line's stiffness falls to nothing within a few `T`. Master and slave then move apart, each with
//! its own friction; the fluid that is left coasts under the friction of the hose. With the traced
//! stiffness (a fourteenth of the fluid's) the relief takes 13 ms for the 5 m from the middle of
//! the line: `ℓ/2 / √(B/(14 ρ))` = 5 m / 396 m/s.
//!
//! Once over, the line is as if filled anew: it transmits from where master and slave then are.

use super::super::{Breakdown, Effect, LineConstants, Link, Moment, effect};

effect! {
    "hose_rupture": "burst hoses: the line transmits nothing";
    at Line = 0.013 "s";
    /// Burst hoses.
    pub struct HoseRupture {
        /// Time constant with which the force dies away.
        relief_s: "s", 1e-4, 100.0, 0.013, "travel time of the relief, traced stiffness";
    }
    state {
        breakdown: Breakdown = Breakdown::default();
    }
}

impl Effect for HoseRupture {
    fn applies(&self, constants: &dyn LineConstants) -> bool {
        constants.fluid_area_m2().is_some()
    }

    fn breakdown(&self) -> Option<&Breakdown> {
        Some(&self.breakdown)
    }

    fn breakdown_mut(&mut self) -> Option<&mut Breakdown> {
        Some(&mut self.breakdown)
    }

    fn deflect(&mut self, link: &mut Link, _moment: &Moment) {
        let (line, end, state) = (link.line, link.end as usize, &mut self.breakdown);
        if state.over && !state.refilled[line][end] {
            state.refilled[line][end] = true;
            state.offset_m[line][end] = link.deflection_m;
        }
        link.deflection_m -= state.offset_m[line][end];
    }

    fn link(&mut self, link: &mut Link, moment: &Moment) {
        if self.breakdown.over {
            return;
        }
        let begun_s = *self.breakdown.begun_s.get_or_insert(moment.time_s);
        let left = (-(moment.time_s - begun_s) / self.relief_s).exp();
        link.force_n *= left;
        link.fluid_force_n *= left;
    }
}
