//! The published frequency responses, measured by simulation with the master moved along a sine.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use plant::hydrostatic::{Parameters, Plant};
use plant::response::{Response, frequency_response};

fn at(parameters: &Parameters, frequency_hz: f64, amplitude_deg: f64) -> Response {
    let mut plant = Plant::new(parameters.clone(), Vec::new()).unwrap();
    frequency_response(&mut plant, frequency_hz, amplitude_deg.to_radians())
}

/// Frequency of the largest gain, and where the gain falls below 0.707 above it.
fn peak_and_cutoff_hz(parameters: &Parameters, from: f64, to: f64, step: f64) -> (f64, f64) {
    let count = ((to - from) / step).round() as usize;
    let curve: Vec<_> =
        (0..=count).map(|index| at(parameters, from + step * index as f64, 30.0)).collect();
    let peak = curve.iter().max_by(|a, b| a.gain.total_cmp(&b.gain)).unwrap().frequency_hz;
    let cutoff = curve
        .iter()
        .find(|point| point.frequency_hz > peak && point.gain < std::f64::consts::FRAC_1_SQRT_2);
    (peak, cutoff.map_or(f64::INFINITY, |point| point.frequency_hz))
}

#[test]
fn printed_constants_cannot_give_the_printed_results() {
    let printed = Parameters::printed();
    let (peak, cutoff) = peak_and_cutoff_hz(&printed, 25.0, 55.0, 0.5);
    assert!((28.0..32.0).contains(&peak), "peak {peak} Hz");
    assert!((49.0..53.0).contains(&cutoff), "cut-off {cutoff} Hz");
    println!("peak {peak} Hz, cut-off {cutoff} Hz");
    let slow = at(&printed, 1.0, 30.0);
    assert!((0.0015..0.0030).contains(&slow.lag_s()), "{slow:?}");
}

#[test]
fn traced_line_gives_the_measured_response() {
    let traced = Parameters::calibrated();
    let (peak, cutoff) = peak_and_cutoff_hz(&traced, 6.0, 16.0, 0.25);
    println!("peak {peak} Hz, cut-off {cutoff} Hz");
    assert!((7.5..=8.5).contains(&peak), "peak {peak} Hz, measured 8");
    assert!((12.5..=14.5).contains(&cutoff), "cut-off {cutoff} Hz, measured 12");
    let slow = at(&traced, 1.0, 30.0);
    assert!((0.028..0.038).contains(&slow.lag_s()), "{slow:?}, measured about 30 ms");
    assert!((0.76..0.80).contains(&slow.gain), "{slow:?}, eq. 3.3.1 has 0.769");
}

#[test]
fn traced_line_of_one_metre_gives_the_short_hose() {
    let short = Parameters::calibrated().with_hose_length(1.0);
    let (peak, cutoff) = peak_and_cutoff_hz(&short, 40.0, 82.0, 1.0);
    println!("peak {peak} Hz, cut-off {cutoff} Hz");
    assert!((43.0..=49.5).contains(&peak), "peak {peak} Hz, eq. 3.3.2 has 49.2");
    assert!((70.0..=80.0).contains(&cutoff), "cut-off {cutoff} Hz, eq. 3.3.2 has 72.7");
}

/// The lag at 1 Hz is made by dry friction across a soft line: less amplitude, more lag; less
/// friction, less lag.
#[test]
fn lag_depends_on_amplitude_and_friction() {
    let traced = Parameters::calibrated();
    let lags = [20.0, 30.0, 40.0].map(|amplitude| at(&traced, 1.0, amplitude).lag_s());
    assert!(lags[0] > 1.3 * lags[1] && lags[1] > 1.15 * lags[2], "{lags:?}");
    let slippery = Parameters {
        slave_static_friction_nm: 0.35 * traced.slave_static_friction_nm,
        slave_falling_slope_nm_s: 0.35 * traced.slave_falling_slope_nm_s,
        slave_kinetic_friction_nm: 0.35 * traced.slave_kinetic_friction_nm,
        slave_rising_slope_nm_s: 0.35 * traced.slave_rising_slope_nm_s,
        ..traced
    };
    let slippery = at(&slippery, 1.0, 30.0).lag_s();
    println!("lags {lags:?}, friction x 0.35: {slippery}");
    assert!(slippery < 0.6 * lags[1], "{slippery} {lags:?}");
}
