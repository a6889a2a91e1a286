//! Movements as laboratories make them, as functions of time.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use crate::random::Draw;

/// Kind of a movement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// Sum of sines of random phase.
    #[default]
    Multisine,
    /// A chirp.
    Chirp,
    /// Strokes at several constant speeds, both ways, with pauses.
    Trapezoids,
    /// Steps between levels that are held.
    Steps,
    /// `sin(t²)`.
    SineOfSquare,
}

impl Shape {
    /// All kinds.
    pub const ALL: [Self; 5] =
        [Self::Multisine, Self::Trapezoids, Self::Chirp, Self::Steps, Self::SineOfSquare];
}

/// A movement of some length.
#[derive(Clone, Debug)]
pub struct Movement {
    seconds: f64,
    parts: Parts,
}

#[derive(Clone, Debug)]
enum Parts {
    Tones(Vec<[f64; 3]>),
    Chirp {
        amplitude: f64,
        from: f64,
        rate: f64,
    },
    /// Time and place of corners, and whether they are joined smoothly.
    Corners(Vec<(f64, f64)>, bool),
    Square {
        amplitude: f64,
        rate: f64,
    },
    Joined(Vec<(f64, Movement)>),
}

impl Movement {
    /// A movement of an amplitude with frequencies up to `top_hz`.
    pub fn drawn(shape: Shape, seconds: f64, amplitude: f64, top_hz: f64, draw: &mut Draw) -> Self {
        let size = amplitude * draw.uniform(0.7, 1.0);
        let parts = match shape {
            Shape::Multisine => tones(seconds, size, top_hz, draw),
            Shape::Chirp => {
                let from = (0.08 * top_hz).max(1.0 / seconds);
                let rate = (draw.uniform(0.7, 1.0) * top_hz / from).ln() / seconds;
                Parts::Chirp { amplitude: 0.8 * size, from, rate }
            }
            Shape::Trapezoids => trapezoids(seconds, size, top_hz, draw),
            Shape::Steps => steps(seconds, size, top_hz, draw),
            Shape::SineOfSquare => {
                Parts::Square { amplitude: 0.7 * size, rate: 0.6 * PI * top_hz / seconds }
            }
        };
        Self { seconds, parts }
    }

    /// Movements of these kinds one after another, about eight seconds each.
    pub fn joined(seconds: f64, amplitude: f64, top_hz: f64, draw: &mut Draw) -> Self {
        let count = ((seconds / 8.0).round() as usize).max(2);
        let each = seconds / count as f64;
        let first = draw.below(Shape::ALL.len());
        let parts = (0..count)
            .map(|index| {
                let shape = Shape::ALL[(first + index) % Shape::ALL.len()];
                (index as f64 * each, Self::drawn(shape, each, amplitude, top_hz, draw))
            })
            .collect();
        Self { seconds, parts: Parts::Joined(parts) }
    }

    /// Where it is at a time (s); 0 at both ends.
    pub fn at(&self, time: f64) -> f64 {
        let time = time.clamp(0.0, self.seconds);
        let fade = 0.06 * self.seconds;
        let ends = smooth(time / fade) * smooth((self.seconds - time) / fade);
        match &self.parts {
            Parts::Tones(tones) => {
                ends * tones.iter().map(|[a, w, p]| a * (w * time + p).sin()).sum::<f64>()
            }
            Parts::Chirp { amplitude, from, rate } => {
                let frequency = from * (rate * time).exp();
                let part = (3.0 * from / frequency).sqrt().min(1.0);
                ends * amplitude * part * (TAU * (frequency - from) / rate).sin()
            }
            Parts::Corners(corners, rounded) => ends * along(corners, time, *rounded),
            Parts::Square { amplitude, rate } => ends * amplitude * (rate * time * time).sin(),
            Parts::Joined(parts) => parts
                .iter()
                .rev()
                .find(|(start, _)| time >= *start)
                .map_or(0.0, |(start, part)| part.at(time - start)),
        }
    }
}

fn tones(seconds: f64, size: f64, top_hz: f64, draw: &mut Draw) -> Parts {
    let low = (0.05 * top_hz).max(1.0 / seconds);
    let count = 10;
    let tones: Vec<[f64; 3]> = (0..count)
        .map(|index| {
            let place = (f64::from(index) + draw.uniform(0.2, 0.8)) / f64::from(count);
            let frequency = low * (top_hz / low).powf(place);
            [1.0 / (1.0 + frequency / low / 5.0), TAU * frequency, draw.phase()]
        })
        .collect();
    let peak = (0..2000)
        .map(|index| {
            let time = f64::from(index) * seconds / 2000.0;
            tones.iter().map(|[a, w, p]| a * (w * time + p).sin()).sum::<f64>().abs()
        })
        .fold(1e-12, f64::max);
    Parts::Tones(tones.into_iter().map(|[a, w, p]| [a * size / peak, w, p]).collect())
}

/// Strokes there and back at speeds spread over a decade.
fn trapezoids(seconds: f64, size: f64, top_hz: f64, draw: &mut Draw) -> Parts {
    let mut corners = vec![(0.0, 0.0)];
    let (mut time, mut side) = (0.0, draw.sign());
    let mut at = 0.0;
    while time < seconds {
        let to = side * size * draw.uniform(0.5, 1.0);
        let speed = size * top_hz * draw.log_uniform(0.3, 3.0);
        time += ((to - at) / speed).abs();
        corners.push((time, to));
        if draw.below(2) == 0 {
            time += draw.uniform(0.05, 0.3) / top_hz;
            corners.push((time, to));
        }
        (at, side) = (to, -side);
    }
    Parts::Corners(corners, false)
}

fn steps(seconds: f64, size: f64, top_hz: f64, draw: &mut Draw) -> Parts {
    let mut corners = vec![(0.0, 0.0)];
    let mut time = 0.0;
    while time < seconds {
        let to = draw.uniform(-size, size);
        time += draw.uniform(0.6, 1.2) / top_hz;
        corners.push((time, to));
        time += draw.uniform(0.3, 1.2) / top_hz;
        corners.push((time, to));
    }
    Parts::Corners(corners, true)
}

fn along(corners: &[(f64, f64)], time: f64, rounded: bool) -> f64 {
    let next = corners.partition_point(|corner| corner.0 <= time);
    let Some(&(after, to)) = corners.get(next) else {
        return corners.last().map_or(0.0, |corner| corner.1);
    };
    let (before, from) = corners[next.saturating_sub(1)];
    let part = ((time - before) / (after - before).max(1e-12)).clamp(0.0, 1.0);
    // Minimum jerk.
    let part = if rounded { part.powi(3) * (10.0 + part * (6.0 * part - 15.0)) } else { part };
    from + (to - from) * part
}

fn smooth(part: f64) -> f64 {
    0.5 - 0.5 * (PI * part.clamp(0.0, 1.0)).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn movements_stay_within_their_amplitude_and_end_at_zero() {
        for seed in 0..20 {
            for shape in Shape::ALL {
                let movement = Movement::drawn(shape, 8.0, 0.4, 2.0, &mut Draw::new(seed));
                let places: Vec<f64> =
                    (0..=8000).map(|index| movement.at(f64::from(index) * 1e-3)).collect();
                let peak = places.iter().fold(0.0_f64, |peak, place| peak.max(place.abs()));
                assert!((0.05..=0.41).contains(&peak), "{shape:?} {seed}: {peak}");
                assert!(places[0].abs() < 1e-9 && places[8000].abs() < 1e-9, "{shape:?}");
                let fastest =
                    places.windows(2).fold(0.0_f64, |top, two| top.max((two[1] - two[0]).abs()));
                assert!(fastest / 1e-3 < 0.4 * TAU * 2.0 * 1.2, "{shape:?}: {fastest}");
            }
        }
    }

    #[test]
    fn joined_movements_are_continuous() {
        let movement = Movement::joined(40.0, 1.0, 1.0, &mut Draw::new(4));
        for index in 0..40_000 {
            let time = f64::from(index) * 1e-3;
            assert!((movement.at(time + 1e-3) - movement.at(time)).abs() < 0.02, "{time}");
        }
    }
}
