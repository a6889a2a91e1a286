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

use super::{Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "nonlinear_stiffness",
    sites: &["line", "slave"],
    words: "a spring that is not linear",
    experiment: "slow load and unload in steps over the whole travel, both ways: the curve itself",
    applies: |axis| axis.spring,
    terms: |axis| {
        let unit = |power| format!("{}/{}{power}", axis.units.force, axis.units.position);
        vec![Term::free("cubic", unit("³")), Term::free("quadratic", unit("²"))]
    },
    force: Some(|now, _, _, out| {
        let square = now.position * now.position;
        (out[0], out[1]) = (square * now.position, square);
    }),
    ..Effect::NONE
};
