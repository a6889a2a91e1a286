//! Helpers of the sinusoidal effects.

/// Grid points for a frequency or wave number whose range spans so many waves over the record: four
/// per wave, since a wave that is a quarter off over the record is still found.
pub(super) fn points(waves: f64) -> usize {
    ((4.0 * waves).ceil().clamp(2.0, 6000.0)) as usize
}

/// Sine and cosine of `wave` times the values.
pub(super) fn pair(values: &[f64], wave: f64) -> Vec<Vec<f64>> {
    let (sine, cosine) = values.iter().map(|x| (wave * x).sin_cos()).unzip();
    vec![sine, cosine]
}

/// A frequency (Hz), kept 0.15 Hz away from 50 and 60 Hz.
pub(super) fn beside_mains(frequency: f64) -> f64 {
    for mains in [50.0, 60.0] {
        let off: f64 = frequency - mains;
        if off.abs() < 0.15 {
            return mains + 0.15f64.copysign(off);
        }
    }
    frequency
}

/// The signal `samples` later (earlier where negative), by cubic interpolation; the ends repeat the
/// last value.
pub(super) fn shifted(signal: &[f64], samples: f64) -> Vec<f64> {
    let last = signal.len() as i64 - 1;
    let at = |i: i64| signal[i.clamp(0, last) as usize];
    let whole = samples.floor();
    let s = samples - whole;
    // Lagrange's polynomial through four neighbours.
    let weights = [
        -s * (s - 1.0) * (s - 2.0) / 6.0,
        (s + 1.0) * (s - 1.0) * (s - 2.0) / 2.0,
        -(s + 1.0) * s * (s - 2.0) / 2.0,
        (s + 1.0) * s * (s - 1.0) / 6.0,
    ];
    (0..=last)
        .map(|i| {
            let from = i + whole as i64 - 1;
            weights.iter().zip(from..).map(|(w, i)| w * at(i)).sum()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_by_part_of_a_sample_is_exact_to_fourth_order() {
        let wave: Vec<f64> = (0..200).map(|i| (0.1 * f64::from(i)).sin()).collect();
        for samples in [-3.7, -0.5, 0.0, 0.25, 2.0, 6.9] {
            let moved = shifted(&wave, samples);
            for (i, value) in moved.iter().enumerate().take(180).skip(10) {
                let exact = (0.1 * (i as f64 + samples)).sin();
                assert!((value - exact).abs() < 5e-6, "{samples}, row {i}: {value} {exact}");
            }
        }
    }

    #[test]
    fn a_tone_is_moved_out_of_the_mains_band_alone() {
        assert_eq!(beside_mains(33.0), 33.0);
        assert!(
            (beside_mains(50.01) - 50.15).abs() < 1e-12
                && (beside_mains(59.9) - 59.85).abs() < 1e-12
        );
    }
}
