//! The integrator against closed forms and a fine reference.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{DT_S, close, frictionless, loose, plant};
use plant::hydrostatic::{
    Correction, ImposedMotion, Input, Parameters, Plant, State, Transmission,
};
use plant::transmission::TransmissionParameters;

/// Slave and lines against a held master. With the slave as a mass `μ = I_s / 2a²` per line and `k
/// = 2K`: `m μ ω⁴ - k (2μ + m) ω² + k² = 0`.
#[test]
fn mode_against_held_master_has_the_closed_form_frequency() {
    let parameters =
        Parameters { fluid_viscosity_pa_s: 1e-5, ..frictionless(Parameters::printed()) };
    let (a, mass) = (parameters.slave_displacement_m_per_rad(), parameters.fluid_mass_kg());
    let (k, mu) = (
        2.0 * parameters.line_stiffness_n_per_m(),
        parameters.slave_inertia_kg_m2() / (2.0 * a * a),
    );
    let square = k * ((2.0 * mu + mass) - (4.0 * mu * mu + mass * mass).sqrt()) / (2.0 * mass * mu);
    let mut plant = Plant::new(parameters, Vec::new()).unwrap();
    // The mode's shape: the slave's equation gives a q / s.
    let slave = 1e-6 * (k / mu) / (k / mu - square) / a;
    plant.set_state(State {
        slave_position_rad: slave,
        line_position_m: [1e-6; 2],
        ..State::default()
    });
    let (mut crossings, mut first, mut last, mut before) = (0, 0.0, 0.0, slave);
    for index in 1..=20_000 {
        plant.step_imposed(ImposedMotion::default(), 0.0, DT_S);
        let now = plant.state().slave_position_rad;
        if before > 0.0 && now <= 0.0 {
            last = (f64::from(index) - now / (now - before)) * DT_S;
            if crossings == 0 {
                first = last;
            }
            crossings += 1;
        }
        before = now;
    }
    let frequency = f64::from(crossings - 1) / (last - first);
    let expected = square.sqrt() / std::f64::consts::TAU;
    assert!(crossings > 250, "{crossings}");
    close(frequency, expected, 5e-4);
}

#[test]
fn modes_of_the_free_plant() {
    let modes = Parameters::printed().modes_rad_s();
    assert!(modes[0] < 1e-2, "the whole moves freely: {modes:?}");
    // The antisymmetric movement of the two lines against each other: both ends stand still, ω² =
    // 4K/m.
    let printed = Parameters::printed();
    let against = (4.0 * printed.line_stiffness_n_per_m() / printed.fluid_mass_kg()).sqrt();
    assert!(modes.iter().any(|mode| (mode / against - 1.0).abs() < 1e-6), "{modes:?} {against}");
}

#[test]
fn coulomb_stop_takes_the_closed_form_time_and_distance() {
    let parameters = Parameters {
        slave_static_friction_nm: 1.0,
        slave_kinetic_friction_nm: 1.0,
        ..frictionless(loose(Parameters::printed()))
    };
    let inertia = parameters.slave_inertia_kg_m2();
    for speed in [10.0, -10.0, 3.3, 0.123_4] {
        let mut plant = Plant::new(parameters.clone(), Vec::new()).unwrap();
        plant.set_state(State { slave_velocity_rad_s: speed, ..State::default() });
        let mut stopped = None;
        for index in 1..=200 {
            plant.step(Input::default(), DT_S);
            if plant.state().slave_velocity_rad_s == 0.0 && stopped.is_none() {
                stopped = Some(f64::from(index) * DT_S);
            }
        }
        let time = inertia * speed.abs() / 1.0;
        let found = stopped.expect("stops");
        assert!(found >= time && found < time + DT_S, "{time} {found}");
        close(plant.state().slave_position_rad, 0.5 * speed * time, 1e-4);
    }
}

#[test]
fn laminar_flow_decays_exponentially() {
    let parameters = frictionless(loose(Parameters::printed()));
    // 32 ν L A / d² over A L ρ.
    let rate = 32.0 * 8.470e-3 / (0.009 * 0.009 * 847.0);
    let mut plant = Plant::new(parameters, Vec::new()).unwrap();
    plant.set_state(State { line_velocity_m_s: [0.5, 0.5], ..State::default() });
    for _ in 0..1000 {
        plant.step(Input::default(), DT_S);
    }
    close(plant.state().line_velocity_m_s[0], 0.5 * (-rate * 0.5_f64).exp(), 5e-5);
}

/// Turbulent: `v̇ = -c v²` with nearly constant `f`, against a fine integration of the same law.
#[test]
fn turbulent_flow_decays_as_of_darcy() {
    let parameters = frictionless(loose(Parameters::printed())).with_hose_diameter(0.006);
    let (pipe, mass) = (parameters.pipe(), parameters.fluid_mass_kg());
    let mut expected = 20.0;
    assert!(pipe.reynolds(expected) > 10_000.0);
    for _ in 0..1_000_000 {
        let middle = expected - 0.5e-6 * 0.5 * pipe.coefficient(expected) * expected / mass;
        expected -= 0.5e-6 * pipe.coefficient(middle) * middle / mass;
    }
    let mut plant = Plant::new(parameters, Vec::new()).unwrap();
    plant.set_state(State { line_velocity_m_s: [20.0, 20.0], ..State::default() });
    for _ in 0..1000 {
        plant.step(Input::default(), DT_S);
    }
    close(plant.state().line_velocity_m_s[0], expected, 1e-4);
}

#[test]
fn stick_holds_exactly_and_releases() {
    for (torque, sticks) in [(2.299, true), (-2.299, true), (2.301, false), (-2.301, false)] {
        let mut plant = Plant::new(Parameters::printed(), Vec::new()).unwrap();
        for _ in 0..20_000 {
            plant.step(Input { motor_v: 0.0, hand_torque_nm: torque }, DT_S);
        }
        let state = plant.state();
        let still = state.slave_position_rad == 0.0 && state.slave_velocity_rad_s == 0.0;
        assert_eq!(still, sticks, "{torque}: {state:?}");
    }
}

/// An alternating torque below breakaway neither creeps nor chatters, wherever the slave stopped.
#[test]
fn stick_does_not_creep_under_alternating_torque() {
    let mut plant = Plant::new(Parameters::calibrated(), Vec::new()).unwrap();
    for index in 0..2000 {
        let volts = if index < 600 { 2.5 } else { 0.0 };
        plant.step(Input { motor_v: volts, hand_torque_nm: 0.0 }, DT_S);
    }
    for _ in 0..20_000 {
        plant.step(Input::default(), DT_S);
    }
    let rest = *plant.state();
    assert!(rest.slave_position_rad.abs() > 0.05 && rest.slave_velocity_rad_s == 0.0);
    let room = 2.3 - rest.transmitted_torque_nm.abs();
    for index in 0..60_000 {
        let torque = 0.95 * room * (f64::from(index) * 0.02).sin();
        plant.step(Input { motor_v: 0.0, hand_torque_nm: torque }, DT_S);
        assert_eq!(plant.state().slave_velocity_rad_s, 0.0);
    }
    assert_eq!(plant.state().slave_position_rad, rest.slave_position_rad);
}

/// A slow movement through stick-slip reverses as often as the drive does, not with every step.
#[test]
fn slow_movement_does_not_chatter() {
    let mut plant = Plant::new(Parameters::calibrated(), Vec::new()).unwrap();
    let (mut sign, mut reversals) = (0.0, 0);
    for index in 1..=40_000 {
        let angle = std::f64::consts::TAU * 0.1 * f64::from(index) * DT_S;
        let target = ImposedMotion {
            position_rad: 0.5 * angle.sin(),
            velocity_rad_s: 0.5 * 0.2 * std::f64::consts::PI * angle.cos(),
        };
        plant.step_imposed(target, 0.0, DT_S);
        let speed = plant.state().slave_velocity_rad_s;
        if speed != 0.0 && speed.signum() != sign {
            sign = speed.signum();
            reversals += 1;
        }
    }
    // Two cycles: a start, four reversals, and a swing back after a slip here and there.
    assert!((4..60).contains(&reversals), "{reversals}");
}

fn trajectory(parameters: &Parameters, dt: f64, amplitude_v: f64) -> Vec<[f64; 3]> {
    let plant = Plant::new(parameters.clone(), Vec::new()).unwrap();
    assert!(dt <= plant.longest_step_s() * (1.0 + 1e-9), "sub-steps would hide the order");
    let ratio = plant.parameters().slave_displacement_m_per_rad();
    common::trajectory(plant, dt, amplitude_v, |plant| {
        let state = plant.state();
        [state.master_position_rad, state.slave_position_rad, state.line_position_m[0] / ratio]
    })
}

fn observed_errors(parameters: &Parameters, amplitude_v: f64) -> Vec<f64> {
    common::observed_errors(0.25e-3, 0.25e-3 / 256.0, |dt| trajectory(parameters, dt, amplitude_v))
}

#[test]
fn second_order_without_dry_friction() {
    let parameters = Parameters {
        port_damping_n_s_per_m: 20.0,
        motor_viscous_nm_s: 0.05,
        ..frictionless(Parameters::calibrated())
    };
    let errors = observed_errors(&parameters, 1.0);
    println!("{errors:?}");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!(order > 1.9, "{errors:?}");
    }
}

#[test]
fn converges_through_stick_slip() {
    let errors = observed_errors(&Parameters::calibrated(), 3.0);
    println!("{errors:?}");
    let order = (errors[0] / errors[3]).log2() / 3.0;
    assert!(order > 1.5 && errors[0] < 1e-3, "order {order}, {errors:?}");
}

#[test]
fn mirrored_input_gives_the_mirrored_movement() {
    let mut forward = plant(Parameters::calibrated(), &[]);
    let mut backward = plant(Parameters::calibrated(), &[]);
    for index in 0..4000 {
        let time = f64::from(index) * DT_S;
        let (volts, hand) = (3.0 * (9.0 * time).sin(), (4.0 * time).cos());
        forward.step(Input { motor_v: volts, hand_torque_nm: hand }, DT_S);
        backward.step(Input { motor_v: -volts, hand_torque_nm: -hand }, DT_S);
        let (a, b) = (forward.state(), backward.state());
        assert_eq!(a.slave_position_rad, -b.slave_position_rad);
        assert_eq!(a.master_velocity_rad_s, -b.master_velocity_rad_s);
        assert_eq!(a.line_position_m[0], -b.line_position_m[0]);
        assert_eq!(a.line_position_m[0], a.line_position_m[1], "identical lines move alike");
    }
    assert!(forward.state().slave_position_rad != 0.0);
}

/// Length and diameter over the whole range of the studies: bounded, and the same with half the
/// step.
#[test]
fn stable_over_the_range_of_hoses() {
    for length in [0.5, 1.0, 5.0, 10.0, 20.0] {
        for diameter in [0.003, 0.005, 0.009, 0.015, 0.020] {
            for base in [Parameters::printed(), Parameters::calibrated()] {
                let parameters = base.with_hose_length(length).with_hose_diameter(diameter);
                let run = |dt: f64| {
                    let mut plant = Plant::new(parameters.clone(), Vec::new()).unwrap();
                    let holds = (1e-3 / dt).round() as usize;
                    let mut range = 0.0_f64;
                    for index in 0..1000 {
                        let volts = 3.0 * (f64::from(index) * 0.006).sin();
                        for _ in 0..holds {
                            plant.step(Input { motor_v: volts, hand_torque_nm: 0.0 }, dt);
                        }
                        range = range.max(plant.state().master_position_rad.abs());
                    }
                    (*plant.state(), plant.energy(), range)
                };
                let (coarse, energy, _) = run(0.5e-3);
                let (fine, _, range) = run(0.5e-3 / 32.0);
                let scale = range.max(0.1);
                let error = (coarse.master_position_rad - fine.master_position_rad).abs() / scale;
                assert!(error < 2e-3, "{length} {diameter}: {error} {coarse:?} {fine:?}");
                assert!(
                    energy.defect_j().abs() < 1e-3 * energy.throughput_j,
                    "{length} {diameter}: {energy:?}"
                );
            }
        }
    }
}

/// A long step with held input is the same as many short ones.
#[test]
fn a_long_step_is_divided() {
    let mut long = plant(Parameters::printed(), &[]);
    let mut short = plant(Parameters::printed(), &[]);
    let input = Input { motor_v: 2.0, hand_torque_nm: 0.0 };
    long.step(input, 0.1);
    for _ in 0..200 {
        short.step(input, DT_S);
    }
    close(long.state().slave_position_rad, short.state().slave_position_rad, 1e-9);
    let before = *long.state();
    long.step(input, 0.0);
    long.step(input, f64::NAN);
    assert_eq!(before, *long.state());
}

#[test]
fn smoothed_friction_tends_to_the_exact_one() {
    let run = |smoothing: f64| {
        let parameters =
            Parameters { friction_smoothing_rad_s: smoothing, ..Parameters::calibrated() };
        let mut plant = Plant::new(parameters, Vec::new()).unwrap();
        let mut most = 0.0_f64;
        for index in 0..2000 {
            plant.step(
                Input { motor_v: 3.0 * (f64::from(index) * 0.006).sin(), hand_torque_nm: 0.0 },
                DT_S,
            );
            most = most.max(plant.state().slave_position_rad.abs());
        }
        most
    };
    let exact = run(0.0);
    let (near, far) = ((run(1e-4) - exact).abs(), (run(0.5) - exact).abs());
    assert!(near < 5e-3 * exact && far > near, "{exact} {near} {far}");
}

/// A model that starts elsewhere and is pulled toward another, as an observer does, ends where that
/// one is.
#[test]
fn corrections_lead_one_plant_to_another() {
    let mut truth = plant(Parameters::calibrated(), &[]);
    let mut model = plant(Parameters::calibrated(), &[]);
    model.set_state(State {
        master_position_rad: 0.2,
        slave_position_rad: -0.1,
        ..State::default()
    });
    let omega = 60.0;
    let mut gaps = Vec::new();
    for index in 0..4000 {
        let input = Input { motor_v: 3.0 * (f64::from(index) * 0.004).sin(), hand_torque_nm: 0.0 };
        truth.step(input, DT_S);
        model.step(input, DT_S);
        let (a, b) = (truth.state(), *model.state());
        let (master, slave) = (
            a.master_position_rad - b.master_position_rad,
            a.slave_position_rad - b.slave_position_rad,
        );
        model.correct(Correction {
            master_position_rad: 1.4 * omega * DT_S * master,
            master_velocity_rad_s: omega * omega * DT_S * master,
            slave_position_rad: 1.4 * omega * DT_S * slave,
            slave_velocity_rad_s: omega * omega * DT_S * slave,
        });
        gaps.push(master.abs().max(slave.abs()));
    }
    assert!(gaps[0] > 0.09 && gaps[3999] < 1e-3, "{} {}", gaps[0], gaps[3999]);
    let energy = model.energy();
    assert!(energy.defect_j().abs() < 1e-3 * energy.throughput_j, "{energy:?}");
}
