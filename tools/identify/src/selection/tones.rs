//! Tones that are the machine's own movement.
//!
//! A wave of fixed frequency imitates every effect of a periodic movement at its frequency, and of
//! a machine that turns evenly it is a wave over the angle.

use std::f64::consts::TAU;

use super::candidates::FittedCandidate;
use crate::equation_error::block_roles::Block;
use crate::equation_error::model::RegressionModel;
use crate::regression::{Gram, solve};

/// Share of the variance of the one that the other explains, from which a tone is not
/// distinguished from the movement.
const MOST_SHARED: f64 = 0.3;
/// Relative range about the mean speed in which a wave over the angle is searched, and its points.
const ORDERS: (f64, f64, usize) = (0.9, 1.1, 41);

/// Whether a candidate is a tone that the movement itself has: it explains a good part of the
/// position, or a wave over the position explains a good part of it.
pub(super) fn is_tone_of_motion(
    regression: &RegressionModel,
    candidate: &FittedCandidate<'_>,
    blocks: &[Block],
) -> bool {
    if !candidate.sited.effect.is_tone {
        return false;
    }
    let Some(frequency) = candidate.model.fitted.shapes.last().copied() else { return false };
    let tone = |time: f64| TAU * frequency * time;
    let of_position =
        explained(regression, blocks, |_| move |time, position| (position, tone(time)));
    let (low, high, points) = ORDERS;
    let step = (high - low) / (points - 1) as f64;
    let of_angle = (0..points).map(|point| {
        let factor = low + step * point as f64;
        explained(regression, blocks, |rate| {
            let wave = factor * TAU * frequency / rate.abs().max(f64::MIN_POSITIVE);
            move |time, position| (tone(time).sin(), wave * position)
        })
    });
    of_position > MOST_SHARED || of_angle.fold(0.0, f64::max) > MOST_SHARED
}

/// Share of the variance of a signal that sine and cosine of a phase explain, over all blocks, each
/// record with its own amplitudes. `of` takes the mean speed of a record and returns signal and
/// phase as functions of time (s) and position.
fn explained<F: Fn(f64, f64) -> (f64, f64)>(
    regression: &RegressionModel,
    blocks: &[Block],
    of: impl Fn(f64) -> F,
) -> f64 {
    let (mut variance, mut left) = (0.0, 0.0);
    for (record, balance) in regression.balances.iter().enumerate() {
        let signals = &balance.signals;
        let (time, position) = (signals.rows(&signals.time), signals.rows(&signals.position));
        let own = blocks.iter().filter(|block| block.record == record);
        let rows: Vec<usize> = own.flat_map(|block| block.rows.clone()).collect();
        let (Some(&first), Some(&last)) = (rows.first(), rows.last()) else { continue };
        let of = of((position[last] - position[first]) / (time[last] - time[first]));
        let (signal, phase): (Vec<f64>, Vec<f64>) =
            rows.iter().map(|row| of(time[*row], position[*row])).unzip();
        let mean = signal.iter().sum::<f64>() / signal.len() as f64;
        let target: Vec<f64> = signal.iter().map(|value| value - mean).collect();
        let (sine, cosine) = phase.iter().map(|phase| phase.sin_cos()).unzip();
        let mut gram = Gram::empty(2);
        gram.add(&[sine, cosine], &target, 0..target.len());
        let Some(fit) = solve(&gram, &[(f64::NEG_INFINITY, f64::INFINITY); 2]) else { continue };
        variance += gram.yy;
        left += fit.squares;
    }
    if variance > 0.0 { 1.0 - left / variance } else { 0.0 }
}
