//! `leakage`: flow past the piston seals: slow creep under load.
//!
//! `Q = G Δp` at each piston. Both chambers of a piston carry the same force with opposite sign, so
//! `Δp = 2F/A` and the deflection that carries force creeps away: `ẋ_leak = 2 G F / A²` (hose
//! area). Laminar gap flow. Source: Merritt, Hydraulic Control Systems, 1967, cross-port leakage.

use super::search::SearchRange;
use super::{Demand, Effect, LineConstants, Link, Moment, effect};

effect! {
    "leakage": "flow past the seals: slow creep under load";
    at Line = 1e-12 "m^3/(s Pa)";
    /// Flow past the seals.
    pub struct Leakage {
        /// Conductance `G` of one piston's seal.
        conductance: "m^3/(s Pa)", 0.0, 1e-9, 1e-12, "assumed: about 1 mm/s of fluid at 20 N";
    }
    state {
        rate_per_n: f64 = 0.0;
        stiffness_n_per_m: f64 = 0.0;
        crept_m: [[f64; 2]; 2] = [[0.0; 2]; 2];
    }
    search {
        space: |of| of.sizes(
            SearchRange::logarithmic("conductance", 0.01 * of.size, 100.0 * of.size),
            &[0.3, 1.0, 4.0],
        ),
    }
}

impl Effect for Leakage {
    fn prepare(&mut self, constants: &dyn LineConstants) {
        // No fluid, no leak.
        let area = constants.fluid_area_m2().unwrap_or(f64::INFINITY);
        self.rate_per_n = 2.0 * self.conductance / area.powi(2);
        self.stiffness_n_per_m = 2.0 * constants.line_stiffness_n_per_m();
        self.crept_m = [[0.0; 2]; 2];
    }

    fn applies(&self, constants: &dyn LineConstants) -> bool {
        constants.fluid_area_m2().is_some()
    }

    fn demand(&self) -> Demand {
        Demand { rate_rad_s: self.rate_per_n * self.stiffness_n_per_m, ..Demand::default() }
    }

    fn deflect(&mut self, link: &mut Link, _moment: &Moment) {
        link.deflection_m -= self.crept_m[link.line][link.end as usize];
    }

    fn link(&mut self, link: &mut Link, moment: &Moment) {
        self.crept_m[link.line][link.end as usize] +=
            moment.step_s * self.rate_per_n * link.force_n;
    }
}
