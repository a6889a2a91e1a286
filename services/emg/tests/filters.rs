//! The filters against known responses.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::f64::consts::{PI, TAU};

use emg::{Conditioner, Conditioning, zero_phase};
use proptest::prelude::*;

const RATE_HZ: f64 = 2000.0;

fn sine(at_hz: f64, seconds: f64) -> Vec<f64> {
    let samples = (seconds * RATE_HZ) as usize;
    (0..samples).map(|k| (TAU * at_hz * k as f64 / RATE_HZ).sin()).collect()
}

fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}

/// Gain of the causal filters at a frequency, once they have settled.
fn gain(how: &Conditioning, at_hz: f64) -> f64 {
    let mut conditioner = Conditioner::new(how, RATE_HZ).unwrap();
    let out: Vec<f64> =
        sine(at_hz, 6.0).iter().map(|value| conditioner.update(*value).filtered).collect();
    rms(out[8000..].iter().copied()) * 2.0_f64.sqrt()
}

/// Gain of a fourth-order Butterworth filter by the bilinear transform, `ratio` of the warped
/// frequency to its corner: 1 / √(1 + ratio⁸).
fn butterworth(ratio: f64) -> f64 {
    (1.0 + ratio.powi(8)).powf(-0.5)
}

#[test]
fn the_band_is_that_of_fourth_order_butterworth_filters() {
    let how = Conditioning { notch_hz: None, ..Conditioning::default() };
    let warped = |hz: f64| (PI * hz / RATE_HZ).tan();
    for at_hz in [3.0, 10.0, 20.0, 100.0, 300.0, 400.0, 600.0, 800.0] {
        let expected = butterworth(warped(at_hz) / warped(how.high_hz))
            * butterworth(warped(how.low_hz) / warped(at_hz));
        let found = gain(&how, at_hz);
        assert!((found - expected).abs() < 2e-3, "{at_hz} Hz: {found} instead of {expected}");
    }
}

#[test]
fn the_notch_takes_the_mains_out_and_leaves_its_neighbours() {
    let how = Conditioning::default();
    assert!(gain(&how, 50.0) < 1e-3, "{}", gain(&how, 50.0));
    for at_hz in [45.0, 55.0, 100.0] {
        assert!(gain(&how, at_hz) > 0.95, "{at_hz} Hz: {}", gain(&how, at_hz));
    }
}

#[test]
fn the_envelope_of_a_sine_is_its_mean_magnitude() {
    let mut conditioner = Conditioner::new(&Conditioning::default(), RATE_HZ).unwrap();
    let last = sine(120.0, 4.0).iter().map(|value| conditioner.update(*value)).last().unwrap();
    assert!((last.envelope - 2.0 / PI).abs() < 0.01, "{}", last.envelope);
}

#[test]
fn nothing_is_delayed_in_a_recording() {
    // A burst of 100 Hz whose amplitude is a Gaussian about the middle.
    let seconds = |k: usize| k as f64 / RATE_HZ;
    let amplitude = |k: usize| (-0.5 * ((seconds(k) - 1.0) / 0.1).powi(2)).exp();
    let burst: Vec<f64> =
        (0..4000).map(|k| amplitude(k) * (TAU * 100.0 * seconds(k)).sin()).collect();
    let centre = |envelope: &[f64]| {
        let total: f64 = envelope.iter().sum();
        envelope.iter().enumerate().map(|(k, value)| seconds(k) * value).sum::<f64>() / total
    };
    let how = Conditioning::default();
    let found = zero_phase(&how, RATE_HZ, &burst).unwrap();
    let offline: Vec<f64> = found.iter().map(|activity| activity.envelope).collect();
    let mut conditioner = Conditioner::new(&how, RATE_HZ).unwrap();
    let live: Vec<f64> = burst.iter().map(|value| conditioner.update(*value).envelope).collect();
    assert!((centre(&offline) - 1.0).abs() < 1e-3, "{}", centre(&offline));
    assert!(centre(&live) > 1.03, "the causal one is late: {}", centre(&live));
    // In the middle of the band a signal passes unchanged.
    let error = found.iter().zip(&burst).map(|(activity, value)| activity.filtered - value);
    assert!(rms(error.collect::<Vec<_>>().into_iter()) < 0.01);
}

#[test]
fn short_recordings_and_an_offset_do_no_harm() {
    let how = Conditioning::default();
    assert!(zero_phase(&how, RATE_HZ, &[]).unwrap().is_empty());
    assert!(zero_phase(&how, RATE_HZ, &[3.0]).unwrap()[0].filtered.abs() < 3.0);
    // An electrode's offset of a thousand times the signal is gone.
    let offset: Vec<f64> = sine(100.0, 2.0).iter().map(|value| 1000.0 + value).collect();
    let found = zero_phase(&how, RATE_HZ, &offset).unwrap();
    let settled = &found[1000..3000];
    let rms = rms(settled.iter().map(|activity| activity.filtered));
    assert!((rms - 0.5_f64.sqrt()).abs() < 0.02, "{rms}");
}

#[test]
fn frequencies_that_cannot_be_are_refused() {
    for how in [
        Conditioning { low_hz: 0.0, ..Conditioning::default() },
        Conditioning { high_hz: 901.0, ..Conditioning::default() },
        Conditioning { envelope_hz: f64::NAN, ..Conditioning::default() },
        Conditioning { notch_hz: Some(-50.0), ..Conditioning::default() },
    ] {
        let error = Conditioner::new(&how, RATE_HZ).unwrap_err();
        assert!(error.to_string().contains("of the 2000 Hz of sampling"), "{error}");
    }
}

proptest! {
    /// Twice the signal is twice the activity, and bounded signals have bounded activity.
    #[test]
    fn activity_scales_with_the_signal(values in prop::collection::vec(-10.0f64..10.0, 1..400)) {
        let mut one = Conditioner::new(&Conditioning::default(), RATE_HZ).unwrap();
        let mut two = one;
        for value in values {
            let (first, second) = (one.update(value), two.update(2.0 * value));
            prop_assert!((2.0 * first.envelope - second.envelope).abs() < 1e-9);
            prop_assert!(first.rectified >= 0.0 && first.rectified < 100.0);
        }
    }
}
