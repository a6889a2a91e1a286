//! Presliding friction (bristles): it builds up over a small travel.
//!
//! `F = bristle_force · z`, `dz/dx = (1 - z sign(v)) / travel`: Dahl's law, whose limit for a small
//! `travel` is Coulomb friction. Source: Dahl 1968; Canudas de Wit, Olsson, Åström, Lischinsky,
//! IEEE Transactions on Automatic Control 40 (1995). The state starts at 0; an error of this
//! initial state decays over a few `travel`.
//!
//! Parameters: `bristle_force` (N or N·m), at least 0; `travel` (m or rad), 0.01 to 5 % of the
//! record's travel (30 % for elements and oscillators).
//!
//! In a residual: after each reversal the force changes from one side to the other as a function of
//! *position*, however slow the movement. Confused with: Coulomb friction (small travel), a Maxwell
//! branch (a function of time instead), backlash.

use super::{Effect, Shape, Term};

/// Longest travel, as a share of the record's: over a longer one a drive would be elastic, and what
/// it touches is taken for friction.
const LONGEST: f64 = 0.05;
/// The same for elements and oscillators, which are elastic.
const LONGEST_OF_ELEMENTS: f64 = 0.3;

pub(super) const EFFECT: Effect = Effect {
    id: "presliding_hysteresis",
    sites: &["slave", "master"],
    words: "presliding friction that builds up over a small travel",
    experiment: "small strokes about one place at two speeds that differ tenfold: presliding \
                 follows the travel, smoothing of friction the speed, a relaxing branch the time",
    refines: Some("coulomb_friction"),
    terms: |axis| vec![Term::positive("bristle_force", axis.units.force)],
    shapes: |axis| {
        let longest = if axis.spring { LONGEST_OF_ELEMENTS } else { LONGEST };
        let range = (1e-4 * axis.travel(), longest * axis.travel());
        vec![Shape::by_factors("travel", axis.units.position, range, 8)]
    },
    columns: Some(|view, shapes| {
        let mut state = 0.0;
        let mut last = view.signals.position.first().copied().unwrap_or(0.0);
        // Exact for a movement that keeps its direction between samples.
        let bristle = |x: &f64| {
            let step = x - last;
            last = *x;
            if step != 0.0 {
                let side = step.signum();
                state = side + (state - side) * (-step.abs() / shapes[0]).exp();
            }
            state
        };
        vec![view.signals.position.iter().map(bristle).collect()]
    }),
    states: 1,
    rates: |now, shapes, states, rates| {
        rates[0] = (now.velocity - now.velocity.abs() * states[0]) / shapes[0]
    },
    force: Some(|_, _, states, out| out[0] = states[0]),
    ..Effect::NONE
};
