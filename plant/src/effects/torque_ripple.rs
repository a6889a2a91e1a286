//! `torque_ripple`: torque that varies with the motor's angle.
//!
//! `τ += a sin(n q_m + φ)`: cogging; it is there without current.
//!
//! # In a model of one channel
//!
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

use super::one_channel::{Axis, Quantity, Shape, Term, samples};
use super::search::{SearchRange, pairs};
use super::{Effect, Moment, effect};
use std::f64::consts::TAU;

effect! {
    "torque_ripple": "torque that varies with the motor's angle (cogging)";
    at Drive = 0.1 "N m";
    /// Cogging.
    pub struct TorqueRipple {
        /// Amplitude `a`.
        amplitude: "N m (N)", 0.0, 1e3, 0.1, "assumed";
        /// Periods per turn `n` (per 2π m for a linear drive).
        order: "1", 1.0, 1e5, 6.0, "assumed: three pole pairs";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.0, "assumed";
    }
    search {
        space: |of| {
            let orders = [&of.features.orders[..], &[4.0, 5.0, 6.0, 7.0, 8.0]].concat();
            of.space(
                [SearchRange::spatial_frequency("order", 3.5, 200.0)],
                pairs(("amplitude", &[0.5 * of.size]), ("order", &orders)),
            )
            .phasor("amplitude", 10.0 * of.size)
        },
    }
    one_channel {
        rank: 170,
        words: "torque that varies with the motor's angle (ripple)",
        experiment: "the whole stroke at one slow constant speed, both ways, recorded fast enough \
                     for ten samples a wave",
        applies: |axis| {
            let (low, high) = orders(axis);
            !axis.spring && low < high
        },
        terms: Term::sine_and_cosine,
        shapes: |axis| {
            let (low, high) = orders(axis);
            let unit = if axis.turn.is_some() { "waves/turn" } else { "waves/m" };
            // Orders that differ by one wave over the travel can just be resolved.
            let points = samples::points((high - low) * axis.travel() / axis.turn.unwrap_or(1.0));
            vec![Shape::by_steps("order", unit, (low, high), points)]
        },
        columns: Some(|view, shapes| {
            let wave = TAU * shapes[0] / view.axis.turn.unwrap_or(1.0);
            samples::pair(&view.signals.position, wave)
        }),
        repeats: true,
        of_plant: |fit| {
            let order = fit.own("order")?;
            // The plant counts waves per 2π of the position.
            let turn = if order.unit == "waves/m" { 1.0 } else { fit.turn.unwrap_or(TAU) };
            let order = Quantity { name: "order", value: TAU * order.value / turn, unit: "1" };
            Some([fit.wave("amplitude", -1.0)?, vec![order]].concat())
        },
    }
}

impl Effect for TorqueRipple {
    fn motor(&mut self, torque_nm: f64, moment: &Moment) -> f64 {
        torque_nm + self.amplitude * (self.order * moment.master_position_rad + self.phase).sin()
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
    // At the rms speed the wave must still pass the low-pass.
    (three_waves.max(lowest), axis.cut_off * turn / axis.velocity_rms)
}
