//! Friction that varies along the stroke.
//!
//! `F = sign(v) · (sine · sin(n x) + cosine · cos(n x))` beside Coulomb friction: a bent spindle,
//! an eccentric pulley, a bore that is not straight. Source: first harmonic of any variation;
//! thesis, ch. 4 and fig. 5.5.
//!
//! Parameters: `sine`, `cosine` (N or N·m), of an amplitude below the Coulomb friction; `order` `n`
//! (rad/m, or waves per turn), 0.4 to 12 waves over the travel.
//!
//! In a residual: plotted over the position, a wave in one direction and its mirror image in the
//! other. Confused with: torque ripple and gravity (equal in both directions), drift where the
//! stroke is made only once.

use super::{Effect, Shape, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "position_dependent_friction",
    sites: &["master", "slave"],
    words: "friction that varies along the stroke",
    experiment: "the whole stroke at one slow constant speed, both ways, several times: half the \
                 difference of the two directions over the position is the friction",
    needs: &["coulomb_friction"],
    uses_sign: true,
    terms: Term::sine_and_cosine,
    shapes: |axis| {
        let wave = std::f64::consts::TAU / axis.travel();
        vec![Shape::by_steps(
            "order",
            format!("rad/{}", axis.units.position),
            (0.4 * wave, 12.0 * wave),
            59,
        )]
    },
    force: Some(|now, shapes, _, out| {
        let (sine, cosine) = (shapes[0] * now.position).sin_cos();
        (out[0], out[1]) = (now.sign * sine, now.sign * cosine);
    }),
    ..Effect::NONE
};
