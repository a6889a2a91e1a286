//! Frequency response with the master moved along a sine (fig. 3.4, 3.5, 3.6, 3.7 and 5.7).

mod fit;

pub use fit::{FitError, LinearSystem};

use crate::transmission::{ImposedMotion, Transmission};

/// Slave over master at one frequency: the fundamental, friction included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude of the slave's fundamental over the master's, rad/rad.
    pub gain: f64,
    /// Phase of the slave's fundamental against the master's, rad; negative is lag.
    pub phase_rad: f64,
    /// Efficiency `μ` (eq. 3.2.1 with each side's own torque and speed): peak power into the slave
    /// over peak power from the motor.
    pub efficiency: f64,
}

impl Response {
    /// Phase lag as a time, s.
    pub fn lag_s(&self) -> f64 {
        -self.phase_rad / (std::f64::consts::TAU * self.frequency_hz)
    }
}

/// Output interval, s.
const INTERVAL_S: f64 = 0.5e-3;
/// Cycles over which the movement is brought to full amplitude; the next ones let it settle.
const RAMP_CYCLES: f64 = 2.0;

/// Moves the plant's master along `amplitude_rad · sin(2π f t)` and measures the slave's
/// fundamental over whole cycles, once settled. The plant is used up: it is left moving.
pub fn frequency_response(
    plant: &mut impl Transmission,
    frequency_hz: f64,
    amplitude_rad: f64,
) -> Response {
    let settle_cycles = RAMP_CYCLES + (1.0 * frequency_hz).ceil().max(2.0);
    let measured_cycles = (0.5 * frequency_hz).ceil().max(2.0);
    let omega = std::f64::consts::TAU * frequency_hz;
    // A whole number of steps per cycle, so that the sums below are exact Fourier sums.
    let steps_per_cycle = (1.0 / (frequency_hz * INTERVAL_S)).ceil().max(32.0);
    let interval = 1.0 / (frequency_hz * steps_per_cycle);
    let count = ((settle_cycles + measured_cycles) * steps_per_cycle) as usize;
    let settled = (settle_cycles * steps_per_cycle) as usize;
    let mut sums = [0.0; 4];
    let (mut power_in, mut power_out) = (0.0_f64, 0.0_f64);
    let start = plant.motion();
    for index in 1..=count {
        let time = index as f64 * interval;
        let (position, velocity) = ramped_sine(omega, RAMP_CYCLES / frequency_hz, time);
        let target = ImposedMotion {
            position_rad: start.master_position_rad + amplitude_rad * position,
            velocity_rad_s: amplitude_rad * velocity,
        };
        plant.step_imposed(target, 0.0, interval);
        if index > settled {
            let (sine, cosine) = (omega * time).sin_cos();
            let state = plant.motion();
            sums[0] += state.master_position_rad * sine;
            sums[1] += state.master_position_rad * cosine;
            sums[2] += state.slave_position_rad * sine;
            sums[3] += state.slave_position_rad * cosine;
            power_in = power_in.max(state.motor_torque_nm * state.master_velocity_rad_s);
            power_out = power_out.max(state.transmitted_torque_nm * state.slave_velocity_rad_s);
        }
    }
    let [master_sine, master_cosine, slave_sine, slave_cosine] = sums;
    let phase = slave_cosine.atan2(slave_sine) - master_cosine.atan2(master_sine);
    let wrapped = phase - std::f64::consts::TAU * ((phase - 0.5) / std::f64::consts::TAU).ceil();
    Response {
        frequency_hz,
        gain: slave_sine.hypot(slave_cosine) / master_sine.hypot(master_cosine),
        phase_rad: wrapped,
        efficiency: if power_in > 0.0 { power_out / power_in } else { 0.0 },
    }
}

/// A sine of unit amplitude that grows smoothly over `ramp` seconds, and its rate.
fn ramped_sine(omega: f64, ramp: f64, time: f64) -> (f64, f64) {
    let (sine, cosine) = (omega * time).sin_cos();
    if time >= ramp {
        return (sine, omega * cosine);
    }
    let part = time / ramp;
    let envelope = part * part * (3.0 - 2.0 * part);
    let slope = 6.0 * part * (1.0 - part) / ramp;
    (envelope * sine, envelope * omega * cosine + slope * sine)
}
