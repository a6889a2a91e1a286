//! What there is to read off a linear approximation (eq. 3.3.1 and 3.3.2, and our own fits).

use plant::response::LinearSystem;

use crate::simulated_response::CUT_OFF_GAIN;

/// Resolution of the readings, as a share of the natural frequency.
const RESOLUTION: f64 = 5e-4;

/// Where the gain is largest, Hz; below twice the natural frequency.
pub fn peak_hz(system: &LinearSystem) -> f64 {
    let natural = system.natural_frequency_hz();
    let frequency = |step: i32| natural * RESOLUTION * f64::from(step);
    (1..4000)
        .map(frequency)
        .max_by(|a, b| system.gain(*a).total_cmp(&system.gain(*b)))
        .unwrap_or(natural)
}

/// First frequency above the peak at which the gain is below 0.707, Hz; none within ten times the
/// peak.
pub fn cut_off_hz(system: &LinearSystem) -> Option<f64> {
    let peak = peak_hz(system);
    (0..18_000)
        .map(|step| peak * (1.0 + RESOLUTION * f64::from(step)))
        .find(|frequency| system.gain(*frequency) < CUT_OFF_GAIN)
}

/// Position of the slave over one cycle, degrees, of a master that moves along a sine: without
/// friction's corners.
pub fn cycle_deg(
    system: &LinearSystem,
    frequency_hz: f64,
    amplitude_deg: f64,
    time_s: &[f64],
) -> Vec<f64> {
    let (gain, phase) = (system.gain(frequency_hz), system.phase_rad(frequency_hz));
    let omega = std::f64::consts::TAU * frequency_hz;
    time_s.iter().map(|time| amplitude_deg * gain * (omega * time + phase).sin()).collect()
}
