//! A movement so slow that the motor's torque is friction (§ 5.2.2).

use std::f64::consts::TAU;

use anyhow::Result;
use plant::transmission::{ImposedMotion, Motion, Transmission};

use crate::simulated_response::Rig;

/// Frequency of § 5.2.2's movement, Hz.
const SLOW_HZ: f64 = 0.008;
/// Step along it, s.
const STEP_S: f64 = 5e-3;

/// One cycle of the slow movement.
#[derive(Clone, Debug)]
pub struct QuasiStaticCycle {
    /// Slave position, degrees.
    pub position_deg: Vec<f64>,
    /// Motor torque there, N·m.
    pub torque_nm: Vec<f64>,
    /// Mean magnitude of the torque forward and backward, over the second half of each stroke, N·m.
    pub mean_nm: [f64; 2],
}

/// Moves the master out to one end and then once to and fro.
///
/// # Errors
/// Those of [`Rig::plant`].
pub fn quasi_static_cycle(rig: &impl Rig) -> Result<QuasiStaticCycle> {
    let mut plant = rig.plant()?;
    let amplitude = rig.amplitude_rad();
    let half = (0.5 / (SLOW_HZ * STEP_S)) as usize;
    let mut cycle =
        QuasiStaticCycle { position_deg: Vec::new(), torque_nm: Vec::new(), mean_nm: [0.0; 2] };
    let mut counts = [0.0; 2];
    for step in 1..=3 * half {
        let (sine, cosine) = (TAU * SLOW_HZ * STEP_S * step as f64).sin_cos();
        let target = ImposedMotion {
            position_rad: amplitude * (1.0 - cosine),
            velocity_rad_s: amplitude * TAU * SLOW_HZ * sine,
        };
        plant.step_imposed(target, 0.0, STEP_S);
        if step <= half {
            continue;
        }
        let Motion { motor_torque_nm, slave_position_rad, .. } = plant.motion();
        cycle.position_deg.push(slave_position_rad.to_degrees());
        cycle.torque_nm.push(motor_torque_nm);
        // A soft line is wound up for a good part of each stroke, so only the second half of it
        // counts.
        if step % half > half / 2 {
            let side = usize::from(sine < 0.0);
            cycle.mean_nm[side] += motor_torque_nm.abs();
            counts[side] += 1.0;
        }
    }
    for (mean, count) in cycle.mean_nm.iter_mut().zip(counts) {
        *mean /= count;
    }
    Ok(cycle)
}
