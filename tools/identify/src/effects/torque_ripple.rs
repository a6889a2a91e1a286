//! Torque that varies with the motor's angle (cogging).
//!
//! `F = sine · sin(2π n x / turn) + cosine · cos(2π n x / turn)`. Source: Hanselman, Brushless
//! Permanent Magnet Motor Design (2003), ch. 7.
//!
//! Parameters: `sine`, `cosine` (N or N·m), 0.5 to 10 % of the rated force; `order` `n` (waves per
//! turn), 3.5 or more on a rotary axis, where lower orders are gravity, 0.9 or more on a linear
//! one; at least three waves over the travel. `turn` is the travel of one motor turn where the rig
//! file declares it (`motor_turn_m`); else orders are waves per metre.
//!
//! In a residual: plotted over the position, a short wave, equal in both directions; over time, a
//! tone whose frequency follows the speed. Confused with: gravity (low orders), encoder
//! eccentricity (grows with the square of speed), a vibration if the speed is constant.

use std::f64::consts::TAU;

use super::{Axis, Effect, Shape, Term, waves};

pub(super) const EFFECT: Effect = Effect {
    id: "torque_ripple",
    sites: &["drive"],
    words: "torque that varies with the motor's angle (ripple)",
    experiment: "the whole stroke at one slow constant speed, both ways, recorded fast enough for \
                 ten samples a wave",
    applies: |axis| {
        let (low, high) = orders(axis);
        !axis.spring && low < high
    },
    terms: Term::sine_and_cosine,
    shapes: |axis| {
        let (low, high) = orders(axis);
        let unit = if axis.turn.is_some() { "waves/turn" } else { "waves/m" };
        // Orders that differ by one wave over the travel can just be resolved.
        let points = waves::points((high - low) * axis.travel() / axis.turn.unwrap_or(1.0));
        vec![Shape::by_steps("order", unit, (low, high), points)]
    },
    columns: Some(|view, shapes| {
        let wave = TAU * shapes[0] / view.axis.turn.unwrap_or(1.0);
        waves::pair(&view.signals.position, wave)
    }),
    repeats: true,
    ..Effect::NONE
};

/// Lowest and highest order that the records can show.
fn orders(axis: &Axis) -> (f64, f64) {
    let turn = axis.turn.unwrap_or(1.0);
    let three_waves = 3.0 * turn / axis.travel();
    let lowest = match (axis.rotary, axis.turn) {
        (true, _) => 3.5,
        (false, Some(_)) => 0.9,
        (false, None) => 0.0,
    };
    // At the rms speed the wave must still pass the low-pass.
    (three_waves.max(lowest), axis.cut_off * turn / axis.velocity_rms)
}
