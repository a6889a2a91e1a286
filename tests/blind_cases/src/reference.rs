//! Reference of the master and torque of a hand at the slave, sample by sample.

use std::f64::consts::{PI, TAU};

use crate::random::Draw;

/// Fade-in of a movement, s.
const FADE_S: f64 = 0.5;

/// Kind of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Sum of sines of random phase, 0.1 to 3 Hz.
    Multisine,
    /// Slow triangles.
    Triangles,
    /// A chirp from low to high frequency.
    Chirp,
    /// Steps between levels that are held for about a second.
    Steps,
    /// Sines of several frequencies and amplitudes, one after another.
    Sines,
}

/// The reference of a record: angle (rad) at each sample.
pub fn reference(kind: Kind, draw: &mut Draw, samples: usize, sample_s: f64) -> Vec<f64> {
    let duration = samples as f64 * sample_s;
    let time = |index: usize| index as f64 * sample_s;
    let mut angles: Vec<f64> = match kind {
        Kind::Multisine => {
            let tones = tones(draw, 12, 0.1, 3.0);
            scaled(
                (0..samples).map(|index| sum(&tones, time(index))).collect(),
                draw.uniform(0.7, 1.0),
            )
        }
        Kind::Triangles => {
            let (amplitude, period) = (draw.uniform(0.6, 0.95), draw.uniform(3.0, 5.5));
            // Corners are rounded over about a fiftieth of the period.
            (0..samples)
                .map(|index| {
                    let phase = TAU * time(index) / period;
                    amplitude * (0.98 * phase.sin()).asin() / 0.98_f64.asin()
                })
                .collect()
        }
        Kind::Chirp => {
            let (amplitude, from, to) =
                (draw.uniform(0.5, 0.9), draw.uniform(0.15, 0.3), draw.uniform(3.0, 5.0));
            let rate = (to / from).ln() / duration;
            (0..samples)
                .map(|index| {
                    let frequency = from * (rate * time(index)).exp();
                    let phase = TAU * (frequency - from) / rate;
                    // No faster than 9 rad/s.
                    amplitude.min(9.0 / (TAU * frequency)) * phase.sin()
                })
                .collect()
        }
        Kind::Steps => {
            let hold = draw.uniform(0.8, 1.3);
            let rise = draw.uniform(0.12, 0.3);
            let count = (duration / hold).ceil() as usize + 1;
            let mut levels = vec![0.0];
            levels.extend((0..count).map(|_| draw.uniform(-0.9, 0.9)));
            (0..samples)
                .map(|index| {
                    let at = time(index) / hold;
                    let step = at.floor() as usize;
                    let part = ((at - at.floor()) * hold / rise).min(1.0);
                    // Minimum jerk: 10 x³ - 15 x⁴ + 6 x⁵.
                    let rising = part.powi(3) * (10.0 + part * (6.0 * part - 15.0));
                    levels[step] + (levels[step + 1] - levels[step]) * rising
                })
                .collect()
        }
        Kind::Sines => {
            let parts: Vec<(f64, f64)> = (0..5)
                .map(|index| {
                    let frequency = draw.log_uniform(0.4, 2.5);
                    let amplitude = [0.12, 0.25, 0.45, 0.7, 1.0][index] * draw.uniform(0.9, 1.1);
                    (amplitude.min(9.0 / (TAU * frequency)), frequency)
                })
                .collect();
            let each = duration / parts.len() as f64;
            (0..samples)
                .map(|index| {
                    let part = ((time(index) / each) as usize).min(parts.len() - 1);
                    let (amplitude, frequency) = parts[part];
                    let within = time(index) - part as f64 * each;
                    // With faded ends.
                    let ends = smooth(within / 0.3) * smooth((each - within) / 0.3);
                    amplitude * (TAU * frequency * within).sin() * ends
                })
                .collect()
        }
    };
    for (index, angle) in angles.iter_mut().enumerate() {
        *angle *= smooth(time(index) / FADE_S);
    }
    angles
}

/// Torque of a hand that pushes the handle back and forth, smooth and random, with a peak of about
/// 2 N·m; N·m.
pub fn hand(draw: &mut Draw, samples: usize, sample_s: f64) -> Vec<f64> {
    let tones = tones(draw, 10, 0.2, 1.6);
    let torque = scaled(
        (0..samples).map(|index| sum(&tones, index as f64 * sample_s)).collect(),
        draw.uniform(1.8, 2.4),
    );
    torque
        .iter()
        .enumerate()
        .map(|(index, value)| value * smooth(index as f64 * sample_s / FADE_S))
        .collect()
}

/// Tones of random phase with frequencies spread logarithmically: amplitude, angular frequency
/// (rad/s), phase.
fn tones(draw: &mut Draw, count: usize, from_hz: f64, to_hz: f64) -> Vec<(f64, f64, f64)> {
    (0..count)
        .map(|index| {
            let place = (index as f64 + draw.uniform(0.2, 0.8)) / count as f64;
            let frequency = from_hz * (to_hz / from_hz).powf(place);
            // Decreasing with frequency, so that neither speed nor angle dominates.
            ((1.0 + frequency / from_hz / 4.0).recip(), TAU * frequency, draw.phase())
        })
        .collect()
}

fn sum(tones: &[(f64, f64, f64)], time: f64) -> f64 {
    tones.iter().map(|(amplitude, rate, phase)| amplitude * (rate * time + phase).sin()).sum()
}

fn scaled(values: Vec<f64>, largest: f64) -> Vec<f64> {
    let peak = values.iter().fold(1e-12_f64, |peak, value| peak.max(value.abs()));
    values.iter().map(|value| value * largest / peak).collect()
}

fn smooth(part: f64) -> f64 {
    0.5 - 0.5 * (PI * part.clamp(0.0, 1.0)).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_stay_within_reach() {
        for kind in [Kind::Multisine, Kind::Triangles, Kind::Chirp, Kind::Steps, Kind::Sines] {
            for seed in 0..20 {
                let angles = reference(kind, &mut Draw::new(seed), 20_000, 0.5e-3);
                let largest =
                    angles.iter().fold(0.0_f64, |largest, angle| largest.max(angle.abs()));
                assert!((0.3..1.3).contains(&largest), "{kind:?} of {seed}: {largest} rad");
                let fastest = angles
                    .windows(2)
                    .fold(0.0_f64, |fastest, two| fastest.max((two[1] - two[0]).abs()));
                assert!(fastest / 0.5e-3 < 30.0, "{kind:?} of {seed}: {} rad/s", fastest / 0.5e-3);
                assert_eq!(angles[0], 0.0);
            }
        }
    }

    #[test]
    fn a_hand_pushes_about_two_newton_metres() {
        for seed in 0..20 {
            let torque = hand(&mut Draw::new(seed), 20_000, 0.5e-3);
            let largest = torque.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
            assert!((1.2..=2.4).contains(&largest), "{largest}");
        }
    }
}
