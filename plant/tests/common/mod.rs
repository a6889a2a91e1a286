//! Shared by the tests.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

use plant::effects::Effect;
use plant::hydrostatic::{Parameters, Plant};

/// Output interval of the rig, s.
pub const DT_S: f64 = 0.5e-3;

/// Effects by name.
pub fn effects(names: &[&str]) -> Vec<Box<dyn Effect>> {
    names.iter().map(|name| plant::effects::parse(name).unwrap()).collect()
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
    Parameters { bulk_modulus_pa: 1e6, line_stiffness_factor: 1e-6, port_damping_n_s_per_m: 0.0, ..parameters }
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
