//! Compliance in series beyond the declared tolerance.
//!
//! `F = k x` with `k` outside the declared range: bulging of the hose, belts, a compliant clamp (or
//! one that stiffens). A spring in series with the declared one acts as a smaller stiffness:
//! `1/k = 1/k_declared + compliance`.
//!
//! Parameter: `stiffness_beyond_declared` (N/m or N·m/rad), fitted less declared; negative where
//! compliance is added.
//!
//! In a residual: plotted over the position, a straight line. Confused with: a wrong scale of force
//! or position, a relaxing branch in records much slower or much faster than its relaxation.

use super::{Declared, Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "line_compliance",
    sites: &["line"],
    words: "compliance in series (a stiffness outside of its declared tolerance)",
    experiment: "slow load and unload in steps, with the position measured on both sides of each \
                 clamp: what gives way is the compliance",
    lifts: Some(Declared::Stiffness),
    applies: |axis| axis.spring,
    linear: true,
    terms: |axis| vec![Term::free("stiffness_beyond_declared", axis.units.stiffness)],
    columns: Some(|view, _| vec![view.signals.position.clone()]),
    ..Effect::NONE
};
