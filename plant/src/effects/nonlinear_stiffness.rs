//! `nonlinear_stiffness`: a line that stiffens or softens.
//!
//! `F = k x (1 + e y/x₀ + c (y/x₀)²)` with `x₀ = 20 N / 2K`, about the deflection under the slave's
//! static friction, and `y` the deflection counted positive while the slave is driven forward. `c`
//! is the relative stiffening at `x₀`, odd in force; `e` makes forward stiffer than backward, as
//! gas trapped in one line only does (equal gas in both lines cancels). The secant stiffness never
//! falls below 5 % of the declared. At the slave only the slave's ends are nonlinear. Source:
//! polynomial spring (Duffing).
//!
//! # In a model of one channel
//!
//! A spring that stiffens or softens.
//!
//! `F = cubic · x³ + quadratic · x²` beside the declared `k x`: the odd term is symmetric, the even
//! one makes one direction stiffer than the other (gas trapped in one line, fibres that take up
//! load one after another, a position measured from another zero: a shift by `e` adds
//! `3 cubic e x²`). Source: Duffing 1918.
//!
//! Parameters: `cubic` (N/m³, N·m/rad³ or V⁻²), `quadratic` (N/m², N·m/rad² or V⁻¹), any sign; at
//! the largest deflection they add from a few per cent to several times the linear force.
//!
//! In a residual: plotted over the position, an S (odd) or a parabola (even), without a loop; in
//! the spectrum, second and third harmonics. Confused with: a compliance outside its tolerance,
//! backlash.

use super::one_channel::Term;
use super::search::{SearchRange, each, pairs};
use super::{Demand, Effect, LineConstants, Link, Moment, Side, effect};

/// Force at the reference deflection, N per line.
const REFERENCE_N: f64 = 20.0;

effect! {
    "nonlinear_stiffness": "stiffening or softening of the line";
    at Line = 0.5 "1", Slave = 0.5 "1";
    /// A spring with even and odd terms.
    pub struct NonlinearStiffness {
        /// Relative stiffening at the reference deflection; negative softens.
        cubic: "1", -1.0, 10.0, 0.5, "assumed";
        /// Relative stiffening at the reference deflection that changes sign with it.
        even: "1", -1.0, 1.0, 0.0, "assumed";
    }
    state {
        reference_m: f64 = 1.0;
    }
    search {
        // An odd and an even part.
        space: |of| {
            let free = [
                SearchRange::linear("cubic", -0.9, 10.0),
                SearchRange::linear("even", -0.95, 0.95),
            ];
            let odd = each("cubic", &[0.3, 1.5, -0.2]);
            let even = pairs(("cubic", &[0.01]), ("even", &[0.25, -0.25]));
            of.space(free, [odd, even].concat()).with_sizes(2)
        },
    }
    one_channel {
        rank: 120,
        words: "a spring that is not linear",
        experiment: "slow load and unload in steps over the whole travel, both ways: the curve \
                     itself",
        applies: |axis| axis.spring,
        terms: |axis| {
            let unit = |power| format!("{}/{}{power}", axis.units.force, axis.units.position);
            vec![Term::free("cubic", unit("³")), Term::free("quadratic", unit("²"))]
        },
        force: Some(|now, _, _, out| {
            let square = now.position * now.position;
            (out[0], out[1]) = (square * now.position, square);
        }),
        // The plant's spring is scaled by a reference force.
        of_plant: |_| None,
    }
}

impl Effect for NonlinearStiffness {
    fn prepare(&mut self, constants: &dyn LineConstants) {
        self.reference_m = REFERENCE_N / (2.0 * constants.line_stiffness_n_per_m());
    }

    fn demand(&self) -> Demand {
        // Tangent at twice the reference deflection.
        Demand {
            stiffness_factor: 1.0 + 12.0 * self.cubic.max(0.0) + 4.0 * self.even.abs(),
            ..Demand::default()
        }
    }

    fn acts_on_links(&self) -> bool {
        true
    }

    fn link(&mut self, link: &mut Link, _moment: &Moment) {
        let part = link.deflection_m / self.reference_m;
        // While the slave is driven forward the fluid lags at the master's end and leads at the
        // slave's.
        let forward = if link.end == Side::Slave { part } else { -part };
        let extra = (self.even * forward + self.cubic * part * part).max(-0.95);
        let force = link.stiffness_n_per_m * link.deflection_m * extra;
        link.force_n += force;
        link.fluid_force_n += force;
    }
}
