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

use super::{Effect, Shape, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "viscoelastic_line",
    sites: &["line"],
    words: "a relaxing branch (viscoelasticity)",
    experiment: "a step that is held for ten times the relaxation, and sines of the same amplitude \
                 at frequencies spaced by factors of two",
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
    ..Effect::NONE
};
