//! Mass or inertia beyond the declared tolerance.
//!
//! `F = m a` with `m` outside the declared range: missing physics that acts like a changed
//! parameter. Within the tolerance, such a change is calibration and not an effect. Where no mass
//! is declared, as for a part tested by itself, the declared mass is 0.
//!
//! Parameter: `mass_beyond_declared` (kg or kg·m²), fitted less declared; any sign; the sum is at
//! least 0.
//!
//! In a residual: plotted over the acceleration, a straight line. Confused with: a wrong scale of
//! the force, dead time beside a spring.

use super::{Axis, Declared, Effect, Regressor, Term, View};

pub(super) const EFFECT: Effect = Effect {
    id: "extra_inertia",
    sites: &["master", "slave"],
    words: "mass beyond the declared tolerance",
    experiment: "quick reversals with and without a known mass clamped on: the known mass gives \
                 the scale of force",
    regressor: &ExtraInertia,
};

struct ExtraInertia;

impl Regressor for ExtraInertia {
    fn lifts(&self) -> Option<Declared> {
        Some(Declared::Mass)
    }
    fn linear(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::positive("mass_beyond_declared", axis.units.mass)]
    }
    fn columns(&self, view: &View<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![view.signals.acceleration.clone()]
    }
}
