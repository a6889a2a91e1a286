//! The arithmetic of `docs/errata.md`.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::close;
use plant::hydrostatic::{ImposedMotion, Parameters, Plant, Transmission};
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

#[test]
fn diameter_area_and_mass_contradict_each_other() {
    let printed = Parameters::printed();
    close(PI * printed.hose_diameter_m.powi(2) / 4.0, 6.362e-5, 1e-3);
    close((4.0 * printed.hose_area_m2 / PI).sqrt(), 14.97e-3, 1e-3);
    close(printed.fluid_mass_kg(), 1.491, 1e-3);
    close((4.0 * 1.197 / (10.0 * 847.0) / PI).sqrt(), 13.41e-3, 1e-3);
    close(printed.fluid_viscosity_pa_s / printed.fluid_density_kg_m3, 1e-5, 1e-3);
}

#[test]
fn linear_fits_are_not_what_the_text_says() {
    // |(b s + c) / (s² + d s + e)| at a frequency.
    let gain = |[b, c, d, e]: [f64; 4], hz: f64| {
        let w = TAU * hz;
        (b * w).hypot(c) / (d * w).hypot(e - w * w)
    };
    for (formula, peak, cutoff) in
        [([7.0, 1000.0, 7.0, 1300.0], 5.69, 8.36), ([0.0, 8.0e4, 18.0, 95_500.0], 49.14, 72.65)]
    {
        let grid = || (1..200_000).map(|index| f64::from(index) * 1e-3);
        let found = grid().max_by(|a, b| gain(formula, *a).total_cmp(&gain(formula, *b))).unwrap();
        close(found, peak, 1e-3);
        close(
            grid().find(|hz| *hz > peak && gain(formula, *hz) < FRAC_1_SQRT_2).unwrap(),
            cutoff,
            1e-3,
        );
    }
}

/// A slave that sticks, a line that the master winds up slowly: what the lines store is what the
/// motor gave. With the torque of eq. 3.1.12 as printed, `r F`, the motor would have given 1/1.780
/// of what was stored.
#[test]
fn torques_without_area_ratio_do_not_balance() {
    let parameters = common::frictionless(Parameters::printed());
    let parameters = Parameters {
        slave_static_friction_nm: 40.0,
        slave_kinetic_friction_nm: 40.0,
        ..parameters
    };
    let mut plant = Plant::new(parameters, Vec::new()).unwrap();
    let mut printed_work = 0.0;
    for index in 1..=4000 {
        let before = plant.state().master_position_rad;
        // Slow at both ends, so that the fluid hardly swings.
        let angle = PI * f64::from(index) / 4000.0;
        let target = ImposedMotion {
            position_rad: 0.05 * (1.0 - angle.cos()),
            velocity_rad_s: 0.05 * PI / 2.0 * angle.sin(),
        };
        plant.step_imposed(target, 0.0, 0.5e-3);
        let state = plant.state();
        let force = -(state.line_force_n[0][0] + state.line_force_n[1][0]);
        printed_work += force * 0.031 * (state.master_position_rad - before);
    }
    let energy = plant.energy();
    assert_eq!(plant.state().slave_velocity_rad_s, 0.0);
    close(energy.stored_j, energy.input_j - energy.dissipated_j, 1e-4);
    close(energy.stored_j / printed_work, 1.780, 2e-2);
}

/// The linear part of ch. 3 (master held, fluid friction, port damping), explicit Euler at 2 kHz,
/// as § 3.2 has it.
#[test]
fn explicit_euler_at_2_khz_diverges() {
    let printed = Parameters::printed();
    let (k, damping) = (2.0 * printed.line_stiffness_n_per_m(), printed.port_damping_n_s_per_m);
    let (a, mass, inertia) = (
        printed.slave_displacement_m_per_rad(),
        printed.fluid_mass_kg(),
        printed.slave_inertia_kg_m2(),
    );
    let loss = printed.pipe().coefficient(0.0);
    let (mut s, mut s_dot, mut q, mut q_dot) = (1e-3_f64, 0.0, 0.0, 0.0);
    for _ in 0..2000 {
        let at_master = k * s + damping * s_dot;
        let at_slave = k * (s - a * q) + damping * (s_dot - a * q_dot);
        let line = (-at_master - at_slave - loss * s_dot) / mass;
        let slave = 2.0 * a * at_slave / inertia;
        (s, q) = (s + 0.5e-3 * s_dot, q + 0.5e-3 * q_dot);
        (s_dot, q_dot) = (s_dot + 0.5e-3 * line, q_dot + 0.5e-3 * slave);
    }
    assert!(s.abs() > 1e6, "1 mm has become {s} m in a second");
}

#[test]
fn assumed_values() {
    let zero_compensation = 1000.0 + 1.2 / 1.11e-4;
    close(zero_compensation, 11_811.0, 1e-4);
    close(zero_compensation / (3.0 * PI / 3.0), 3760.0, 1e-3);
    close(zero_compensation / (3.0 * 2.0 * PI / 3.0), 1880.0, 1e-3);
    let friction = Parameters::printed().static_friction_at_motor_nm();
    close(friction / 1.5, 1.83, 5e-3);
    close(0.95 / 1.5, 0.63, 1e-2);
    close(Parameters::printed().transmission_ratio(), 0.854, 1e-3);
    close(0.333 * 0.5 * 1.8 / Parameters::printed().transmission_ratio(), 0.35, 1e-2);
}

#[test]
fn largest_learning_gain() {
    let largest = 10.0_f64.powf(12.0 / 20.0);
    close(2.0 / largest, 0.50, 1e-2);
    let contraction = |gain: f64| (1.0 - gain * largest).abs();
    assert!(contraction(0.49) < 1.0 && contraction(0.51) > 1.0);
}
