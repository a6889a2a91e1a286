//! Frequency response of a recorded movement, with its coherence (Welch's method).

use std::f64::consts::PI;

use identify::spectral::transform;
use realfft::num_complex::Complex;
use serde::Serialize;

/// Shortest and longest window, s.
const WINDOW_S: (f64, f64) = (2.0, 10.0);
/// Windows that overlap by half, below which a coherence means nothing.
const LEAST_WINDOWS: usize = 5;
/// Correlation of the spectra of two such windows: a sixth.
const OVERLAP: f64 = 1.0 / 6.0;
/// Bands of a chirp, each as wide as the others on a logarithmic axis.
const BANDS: usize = 30;

/// A point of a frequency response.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Point {
    pub(super) frequency_hz: f64,
    /// Slave over master.
    pub(super) gain: f64,
    pub(super) phase_deg: f64,
    /// Share of the slave's power that is linear in the master's, 0 to 1.
    pub(super) coherence: f64,
    /// Standard deviations (Bendat and Piersol, Random Data, eq. 9.90).
    pub(super) gain_sd: f64,
    pub(super) phase_sd_deg: f64,
}

/// Where the response is looked at.
pub(super) enum Frequencies {
    /// At lines, Hz.
    Lines(Vec<f64>),
    /// In bands from one frequency to another, Hz.
    Bands(f64, f64),
}

/// Sums of the spectra in some bins.
#[derive(Clone, Copy, Default)]
struct Sums {
    input: f64,
    output: f64,
    cross: Complex<f64>,
    bins: usize,
}

/// The response from `input` to `output`, by the H1 estimator; `None` where they are too short.
pub(super) fn response(
    input: &[f64],
    output: &[f64],
    rate_hz: f64,
    frequencies: &Frequencies,
) -> Option<Vec<Point>> {
    let share = 2 * input.len().min(output.len()) / (LEAST_WINDOWS + 1);
    let length = share.min((WINDOW_S.1 * rate_hz) as usize) & !1;
    if (length as f64) < WINDOW_S.0 * rate_hz {
        return None;
    }
    let mut bins = vec![Sums::default(); length / 2 + 1];
    let mut windows = 0;
    for from in (0..=input.len().min(output.len()) - length).step_by(length / 2) {
        let spectrum = |signal: &[f64]| transform(windowed(&signal[from..from + length]));
        let (x, y) = (spectrum(input)?, spectrum(output)?);
        windows += 1;
        for (sums, (x, y)) in bins.iter_mut().zip(x.iter().zip(&y)) {
            sums.input += x.norm_sqr();
            sums.output += y.norm_sqr();
            sums.cross += x.conj() * y;
            sums.bins = 1;
        }
    }
    let width_hz = rate_hz / length as f64;
    let independent = f64::from(windows) / (1.0 + 2.0 * OVERLAP * OVERLAP);
    let within = |from_hz: f64, to_hz: f64| {
        let mut sums = Sums::default();
        for (bin, one) in bins.iter().enumerate().skip(1) {
            if (from_hz..to_hz).contains(&(bin as f64 * width_hz)) {
                sums.input += one.input;
                sums.output += one.output;
                sums.cross += one.cross;
                sums.bins += 1;
            }
        }
        sums
    };
    let bands: Vec<(f64, Sums)> = match frequencies {
        Frequencies::Lines(lines) => lines
            .iter()
            .map(|line| (*line, within(line - 0.5 * width_hz, line + 0.5 * width_hz)))
            .collect(),
        Frequencies::Bands(from, to) => (0..BANDS)
            .map(|band| {
                let edge = |band: usize| from * (to / from).powf(band as f64 / BANDS as f64);
                let (low, high) = (edge(band), edge(band + 1));
                ((low * high).sqrt(), within(low, high))
            })
            .collect(),
    };
    let point = |(frequency_hz, sums): (f64, Sums)| point(frequency_hz, &sums, independent);
    Some(bands.into_iter().filter_map(point).collect())
}

fn point(frequency_hz: f64, sums: &Sums, independent: f64) -> Option<Point> {
    let power = sums.input * sums.output;
    if sums.bins == 0 || power <= 0.0 {
        return None;
    }
    let transfer = sums.cross / sums.input;
    let coherence = (sums.cross.norm_sqr() / power).min(1.0);
    let averages = independent * sums.bins as f64;
    let relative = ((1.0 - coherence) / (2.0 * coherence.max(1e-12) * averages)).sqrt();
    Some(Point {
        frequency_hz,
        gain: transfer.norm(),
        phase_deg: transfer.arg().to_degrees(),
        coherence,
        gain_sd: transfer.norm() * relative,
        phase_sd_deg: relative.to_degrees(),
    })
}

/// A stretch without its mean, under a Hann window.
fn windowed(signal: &[f64]) -> Vec<f64> {
    let mean = signal.iter().sum::<f64>() / signal.len() as f64;
    let weight = |at: usize| (PI * at as f64 / signal.len() as f64).sin().powi(2);
    signal.iter().enumerate().map(|(at, value)| weight(at) * (value - mean)).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use std::f64::consts::TAU;

    use super::*;

    const RATE_HZ: f64 = 500.0;

    /// A first-order lag of 1 Hz behind a delay of 20 ms, driven by some sines.
    fn lagged(hertz: f64) -> (f64, f64) {
        let ratio = hertz / 1.0;
        (1.0 / (1.0 + ratio * ratio).sqrt(), -ratio.atan() - TAU * hertz * 0.02)
    }

    fn sines(lines: &[f64], of: impl Fn(f64) -> (f64, f64)) -> Vec<f64> {
        (0..15_000)
            .map(|at| {
                let time_s = f64::from(at) / RATE_HZ;
                let one = |line: &f64| {
                    let (gain, phase) = of(*line);
                    gain * (TAU * line * time_s + phase + line).sin()
                };
                lines.iter().map(one).sum()
            })
            .collect()
    }

    #[test]
    fn the_response_of_a_known_system_is_found() {
        let lines = [0.3, 0.7, 1.1, 1.9, 4.9, 7.9];
        let (input, output) = (sines(&lines, |_| (1.0, 0.0)), sines(&lines, lagged));
        let found =
            response(&input, &output, RATE_HZ, &Frequencies::Lines(lines.to_vec())).unwrap();
        for (line, point) in lines.iter().zip(found) {
            let (gain, phase) = lagged(*line);
            assert!((point.gain / gain - 1.0).abs() < 0.01, "{point:?}, expected {gain}");
            let turns = (point.phase_deg - phase.to_degrees()) / 360.0;
            assert!((turns - turns.round()).abs() < 0.003, "{point:?}, expected {phase}");
            assert!(point.coherence > 0.999);
        }
    }

    #[test]
    fn noise_lowers_the_coherence_and_widens_the_errors() {
        let lines = [0.3, 1.1, 4.9];
        let input = sines(&lines, |_| (1.0, 0.0));
        let mut seed = 1u64;
        let mut noise = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / f64::from(1u32 << 31) - 0.5
        };
        // Noise of as much power as a line within a bin.
        let polluted: Vec<f64> =
            sines(&lines, lagged).iter().map(|value| value + 60.0 * noise()).collect();
        let clean =
            response(&input, &sines(&lines, lagged), RATE_HZ, &Frequencies::Lines(lines.to_vec()));
        let found =
            response(&input, &polluted, RATE_HZ, &Frequencies::Lines(lines.to_vec())).unwrap();
        for (point, clean) in found.iter().zip(clean.unwrap()) {
            assert!(point.coherence < 0.97, "{point:?}");
            assert!(point.gain_sd > 10.0 * clean.gain_sd);
            // Within four standard deviations.
            assert!((point.gain - clean.gain).abs() < 4.0 * point.gain_sd, "{point:?}, {clean:?}");
        }
    }

    #[test]
    fn a_short_movement_has_no_response() {
        let short = vec![0.0; 2000];
        assert!(response(&short, &short, RATE_HZ, &Frequencies::Bands(0.5, 5.0)).is_none());
    }
}
