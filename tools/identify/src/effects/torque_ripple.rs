//! Torque that varies with the motor's angle (cogging).
//!
//! `F = sine · sin(2π n x / turn) + cosine · cos(2π n x / turn)`. Source: Hanselman, Brushless
//! Permanent Magnet Motor Design (2003), ch. 7.
//!
//! Parameters: `sine`, `cosine` (N or N·m), 0.5 to 10 % of the rated force; `order` `n` (waves a
//! turn), from 4 on a rotary axis, where lower ones are gravity, from 1 on a linear one; at least
//! three waves over the travel. `turn` is the travel of one motor turn where the rig file declares
//! it (`motor_turn_m`); else orders are waves per metre.
//!
//! In a residual: a fast wave over the position, the same both ways; in time a tone that follows
//! the speed. Confused with: gravity (low orders), encoder eccentricity (grows with speed squared),
//! a vibration at constant speed.

use std::f64::consts::TAU;

use super::{Axis, Effect, InverseEffect, Shape, Term, View, waves};

pub(super) struct TorqueRipple;

impl Effect for TorqueRipple {
    fn id(&self) -> &'static str {
        "torque_ripple"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["drive"]
    }
    fn words(&self) -> &'static str {
        "torque that varies with the motor's angle (ripple)"
    }
    fn experiment(&self) -> &'static str {
        "the whole stroke at one slow constant speed, both ways, recorded fast enough for ten \
         samples a wave"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for TorqueRipple {
    fn applies(&self, axis: &Axis) -> bool {
        let (low, high) = orders(axis);
        !axis.spring && low < high
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::free("sine", axis.units.force), Term::free("cosine", axis.units.force)]
    }
    fn shapes(&self, axis: &Axis) -> Vec<Shape> {
        let (low, high) = orders(axis);
        let unit = if axis.turn.is_some() { "waves/turn" } else { "waves/m" };
        // Waves over the travel that differ by one can just be told apart.
        let points = waves::points((high - low) * axis.travel() / axis.turn.unwrap_or(1.0));
        vec![Shape::by_steps("order", unit, (low, high), points)]
    }
    fn columns(&self, view: &View<'_>, shapes: &[f64]) -> Vec<Vec<f64>> {
        let wave = TAU * shapes[0] / view.axis.turn.unwrap_or(1.0);
        waves::pair(&view.signals.position, wave)
    }
}

/// Lowest and highest order that the records can show.
fn orders(axis: &Axis) -> (f64, f64) {
    let turn = axis.turn.unwrap_or(1.0);
    let three_waves = 3.0 * turn / axis.travel();
    let lowest = match (axis.rotary, axis.turn) {
        (true, _) => 3.5,
        (false, Some(_)) => 0.9,
        (false, None) => 0.0,
    };
    // At the usual speed the wave must still pass the low-pass.
    (three_waves.max(lowest), axis.cut_off * turn / axis.velocity_rms)
}
