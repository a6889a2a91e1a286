//! Shared by the tests.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

pub mod laws;
pub mod mass;

use plant::effects::Effect;
use plant::hydrostatic::{Parameters, Plant};
use plant::transmission::{Input, Transmission};

/// Output interval of the rig, s.
pub const DT_S: f64 = 0.5e-3;

/// Effects by name.
pub fn effects(names: &[&str]) -> Vec<Box<dyn Effect>> {
    names.iter().map(|name| plant::effects::parse(name).unwrap()).collect()
}

/// Volts at the motor, and no hand.
pub fn volts(motor_v: f64) -> Input {
    Input { motor_v, hand_torque_nm: 0.0 }
}

/// A plant with effects.
pub fn plant(parameters: Parameters, names: &[&str]) -> Plant {
    Plant::new(parameters, effects(names)).unwrap()
}

/// No dry friction, no damping but the fluid's.
pub fn frictionless(parameters: Parameters) -> Parameters {
    Parameters {
        port_damping_n_s_per_m: 0.0,
        motor_coulomb_nm: 0.0,
        motor_viscous_nm_s: 0.0,
        master_piston_static_friction_n: 0.0,
        master_piston_falling_slope_n_s_per_m: 0.0,
        master_piston_kinetic_friction_n: 0.0,
        master_piston_rising_slope_n_s_per_m: 0.0,
        slave_static_friction_nm: 0.0,
        slave_falling_slope_nm_s: 0.0,
        slave_kinetic_friction_nm: 0.0,
        slave_rising_slope_nm_s: 0.0,
        ..parameters
    }
}

/// A line so soft that both sides move by themselves.
pub fn loose(parameters: Parameters) -> Parameters {
    Parameters {
        bulk_modulus_pa: 1e6,
        line_stiffness_factor: 1e-6,
        port_damping_n_s_per_m: 0.0,
        ..parameters
    }
}

/// Relative closeness.
#[track_caller]
pub fn close(found: f64, expected: f64, relative: f64) {
    assert!(
        (found - expected).abs() <= relative * expected.abs(),
        "expected {expected} within {} %, found {found}",
        100.0 * relative
    );
}

/// What `observe` sees over 0.4 s, every 1 ms; the input changes with each of them. Internal step
/// `dt`.
pub fn trajectory<P: Transmission>(
    mut plant: P,
    dt: f64,
    amplitude_v: f64,
    observe: impl Fn(&P) -> [f64; 3],
) -> Vec<[f64; 3]> {
    let count = (1e-3 / dt).round() as usize;
    (0..400)
        .map(|hold| {
            let time = f64::from(hold) * 1e-3;
            let hand_torque_nm = 0.5 * (13.0 * time).cos();
            let input = Input { motor_v: amplitude_v * (20.0 * time).sin(), hand_torque_nm };
            for _ in 0..count {
                plant.step(input, dt);
            }
            observe(&plant)
        })
        .collect()
}

/// Root mean square over the trajectory against the one with the finest step, for each halving of
/// the coarsest, rad.
pub fn observed_errors(
    coarsest_s: f64,
    finest_s: f64,
    trajectory: impl Fn(f64) -> Vec<[f64; 3]>,
) -> Vec<f64> {
    let finest = trajectory(finest_s);
    [1.0, 0.5, 0.25, 0.125]
        .iter()
        .map(|part| {
            let found = trajectory(part * coarsest_s);
            let squares = found
                .iter()
                .zip(&finest)
                .flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)));
            (squares.sum::<f64>() / found.len() as f64).sqrt()
        })
        .collect()
}
