//! `multisine`: a sum of sines about a centre, with random phases.

use std::f64::consts::{PI, TAU};

use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng as _, SeedableRng as _};

use crate::checked_toml::{Keys, Section};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::sines::{Envelope, Line, sum};
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::{AMPLITUDE_DEG, AMPLITUDE_M, LINE_HZ, UnitKeys};

/// A sum of sines about a centre.
#[derive(Clone, Debug, PartialEq)]
pub struct Multisine {
    /// The sines.
    pub lines: Vec<Line>,
    /// Centre, duration and fades.
    pub envelope: Envelope,
}

pub(super) const KEYS: Keys = &[
    ("frequencies_hz", "Frequencies of the sines."),
    ("amplitudes_{deg,m}", "Amplitude of each sine; instead of `amplitude`."),
    ("amplitude_{deg,m}", "Bound of the whole movement, shared equally by the sines."),
    ("seed", "Seed of the random phases: the same seed gives the same phases."),
    ("duration_s", "Whole duration, fades included."),
    ("centre_{deg,m}", "Centre of the movement; 0, if left out."),
    ("fade_in_s", "Time of the blend from the start position into the movement."),
    ("fade_out_s", "Time of the blend from the movement to rest at the centre."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Multisine {
    let envelope = Envelope::read(section);
    let lines = read_lines(section, keys);
    Multisine { lines, envelope: envelope.about(keys.position("centre")) }
}

impl Multisine {
    /// Sum of the amplitudes (rad or m).
    fn amplitude(&self) -> f64 {
        self.lines.iter().map(|line| line.amplitude).sum()
    }
}

impl SegmentKind for Multisine {
    fn duration_s(&self) -> f64 {
        self.envelope.duration_s
    }

    fn range(&self) -> Option<(f64, f64)> {
        self.envelope.range(self.amplitude())
    }

    fn target(&self) -> Option<f64> {
        Some(self.envelope.centre)
    }

    fn peak_speed_from(&self, start: f64) -> f64 {
        let speed = self.lines.iter().map(|line| line.amplitude * TAU * line.frequency_hz).sum();
        self.envelope.peak_speed_from(start, self.amplitude(), speed)
    }

    /// Sampled at 16 points per period of the fastest sine, at most 20,000 in all: accurate to a
    /// few percent, which is enough for the shape of a feed-forward. The speed limit does not
    /// depend on it.
    fn feedforward_speed(&self) -> f64 {
        let fastest = self.lines.iter().map(|line| line.frequency_hz).fold(0.0, f64::max);
        let duration_s = self.envelope.duration_s;
        let points = (16.0 * fastest * duration_s).clamp(16.0, 20_000.0) as usize;
        (0..points)
            .map(|i| sum(&self.lines, 0.0, duration_s * i as f64 / points as f64).velocity.abs())
            .fold(0.0, f64::max)
    }

    fn at(&self, start: f64, time_s: f64, peak_speed: f64) -> Point {
        let sines = sum(&self.lines, self.envelope.centre, time_s);
        self.envelope.apply(sines, start, time_s, peak_speed)
    }

    fn advance_phase(&mut self, phase: f64) -> bool {
        self.lines.iter_mut().for_each(|line| line.phase += phase);
        true
    }

    fn scale(&mut self, factor: f64) -> Result<(), (&'static str, &'static str)> {
        for line in &mut self.lines {
            line.amplitude *= factor.abs();
            if factor < 0.0 {
                line.phase += PI;
            }
        }
        self.envelope.centre *= factor;
        Ok(())
    }
}

fn read_lines(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Vec<Line> {
    let frequencies = section.numbers("frequencies_hz", LINE_HZ);
    let count = frequencies.len().max(1);
    let amplitudes = if section.has("amplitudes_deg") || section.has("amplitudes_m") {
        for key in ["amplitude_deg", "amplitude_m"] {
            let expected = "either amplitudes, one a line, or one amplitude";
            section.misplaced(key, expected, "take one out");
        }
        let amplitudes = keys.list("amplitudes", AMPLITUDE_DEG, AMPLITUDE_M);
        if amplitudes.len() != frequencies.len() {
            let key = if section.has("amplitudes_m") { "amplitudes_m" } else { "amplitudes_deg" };
            let expected = format!("one for each of the {} frequencies", frequencies.len());
            let advice = "give as many amplitudes as frequencies";
            section.problem(key, expected, amplitudes.len(), advice);
        }
        amplitudes
    } else {
        vec![keys.amplitude("amplitude") / count as f64; count]
    };
    let seed =
        section.whole_or("seed", 1, 0, i64::MAX as u64, "any whole number; it draws the phases");
    // A published algorithm: the phases of a protocol do not depend on the release of a library.
    let mut random = SplitMix64::seed_from_u64(seed);
    let lines = frequencies.into_iter().zip(amplitudes);
    lines
        .map(|(frequency_hz, amplitude)| Line {
            amplitude,
            frequency_hz,
            phase: TAU * unit_random(&mut random),
        })
        .collect()
}

/// The next number in [0, 1).
fn unit_random(random: &mut SplitMix64) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}
