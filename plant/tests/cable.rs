//! The cable transmission against closed forms, a fine reference, symmetry and the balance of
//! energy.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{DT_S, close, effects};
use plant::ParameterSet;
use plant::cable::{ImposedMotion, Input, Parameters, Plant, State, Transmission};
use plant::transmission::TransmissionParameters;
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

/// No friction anywhere, no damping.
fn frictionless(parameters: Parameters) -> Parameters {
    Parameters {
        motor_coulomb_nm: 0.0,
        motor_viscous_nm_s: 0.0,
        slave_bearing_nm: 0.0,
        support_friction_limit_n: 0.0,
        support_viscous_n_s_per_m: 0.0,
        fibre_friction_ratio: 0.0,
        cable_damping_n_s_per_m: 0.0,
        ..parameters
    }
}

/// A pair of springs: no friction, toe, sag, set or rubbing.
fn linear(parameters: Parameters) -> Parameters {
    Parameters {
        fibre_branch_ratio: 0.0,
        set_ratio: 0.0,
        toe_tension_n: 0.0,
        gravity_m_s2: 0.0,
        ..frictionless(parameters)
    }
}

fn plain(parameters: &Parameters) -> Plant {
    Plant::new(parameters.clone(), Vec::new()).unwrap()
}

/// Where a hand's torque holds the slave, the master held.
fn held(parameters: Parameters, torque: f64) -> f64 {
    let mut plant =
        Plant::new(Parameters { cable_damping_n_s_per_m: 60.0, ..parameters }, Vec::new()).unwrap();
    for _ in 0..3000 {
        plant.step_imposed(ImposedMotion::default(), torque, DT_S);
    }
    plant.state().slave_position_rad
}

/// Slave and cables against a held master. With the slave as a mass `μ = I_s / 2r²` per line and `k
/// = 2K`: `m μ ω⁴ - k (2μ + m) ω² + k² = 0`.
#[test]
fn mode_against_held_master_has_the_closed_form_frequency() {
    let parameters = linear(Parameters::calibrated());
    let (radius, mass) = (parameters.slave_pulley_radius_m(), parameters.middle_mass_kg());
    let (k, mu) = (
        2.0 * parameters.line_stiffness_n_per_m(),
        parameters.total_slave_inertia_kg_m2() / (2.0 * radius * radius),
    );
    let square = k * ((2.0 * mu + mass) - (4.0 * mu * mu + mass * mass).sqrt()) / (2.0 * mass * mu);
    let mut plant = plain(&parameters);
    let slave = 1e-3 * (k / mu) / (k / mu - square) / radius;
    plant.set_state(State {
        slave_position_rad: slave,
        line_position_m: [1e-3; 2],
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
    println!("{frequency} Hz of {} Hz", square.sqrt() / TAU);
    assert!(crossings > 80, "{crossings}");
    close(frequency, square.sqrt() / TAU, 5e-4);
}

/// Master and slave against each other: with cables of hardly any mass `ω² = 2K (r_m²/I_m +
/// r_s²/I_s)`.
#[test]
fn two_mass_mode() {
    let light = Parameters {
        cable_mass_kg_per_m: 1e-6,
        support_mass_kg: 0.0,
        ..linear(Parameters::printed())
    };
    let (r_m, r_s) = (light.master_pulley_radius_m, light.slave_pulley_radius_m());
    let per_inertia = r_m * r_m / light.total_master_inertia_kg_m2()
        + r_s * r_s / light.total_slave_inertia_kg_m2();
    let expected = (2.0 * light.line_stiffness_n_per_m() * per_inertia).sqrt();
    close(light.modes_rad_s()[1], expected, 1e-4);
    assert!(light.modes_rad_s()[0] < 1e-2 * expected, "the whole moves freely");
}

#[test]
fn held_slave_deflects_as_a_pair_of_springs_until_one_goes_slack() {
    let parameters = linear(Parameters::calibrated());
    let (k, radius) = (parameters.line_stiffness_n_per_m(), parameters.slave_pulley_radius_m());
    close(held(parameters.clone(), 0.5), 0.5 / (2.0 * k * radius * radius), 1e-3);
    // Beyond twice the pretension one cable is slack and the other bears all: τ/r = T_0 + K x.
    let torque = 3.0 * parameters.pretension_n * radius;
    close(
        held(parameters.clone(), torque),
        (torque / radius - parameters.pretension_n) / k / radius,
        1e-3,
    );
}

/// Two tight cables with sag: `1/K_eff = 1/K + 3 w² ℓ³/(12 T³)` each.
#[test]
fn sag_softens_as_of_a_parabola() {
    for tension in [1.0, 2.0, 4.0, 60.0] {
        let parameters = Parameters {
            pretension_n: tension,
            gravity_m_s2: 9.81,
            ..linear(Parameters::printed())
        };
        let weight: f64 = 7.9e-4 * 9.81;
        let sag = 3.0 * weight.powi(2) * 27.0 / (12.0 * tension.powi(3));
        let effective = 1.0 / (1.0 / parameters.line_stiffness_n_per_m() + sag);
        let (radius, torque) = (parameters.slave_pulley_radius_m(), 1e-4 * tension);
        let found = torque / (held(parameters.clone(), torque) * 2.0 * radius * radius);
        println!("{tension} N: {effective} N/m, found {found}");
        close(found, effective, 2e-3);
    }
}

#[test]
fn support_friction_grows_with_tension_and_saturates() {
    let parameters = Parameters::printed();
    let at = |tension: f64| parameters.support_friction_n(tension);
    let mut last = (0.0, f64::INFINITY);
    for index in 1..200 {
        let tension = 5.0 * f64::from(index);
        let slope = (at(tension) - last.0) / 5.0;
        assert!(at(tension) > last.0 && slope < last.1, "grows ever less, at {tension} N");
        last = (at(tension), slope);
    }
    assert!(
        at(1e6) > 0.999 * parameters.support_friction_limit_n
            && at(1e9) <= parameters.support_friction_limit_n
    );
    assert_eq!(at(-1.0), 0.0);
    // Far from saturation, proportional.
    close(at(0.02) / at(0.01), 2.0, 1e-3);
    // More cables at the same tension each: as many times the friction; sharing the tension: less.
    let level = |set: &Parameters| set.support_friction_n(set.cables * set.pretension_n);
    let four = Parameters { cables: 4.0 * parameters.cables, ..parameters.clone() };
    let shared = Parameters { pretension_n: parameters.pretension_n / 4.0, ..four.clone() };
    close(level(&four), 4.0 * level(&parameters), 1e-12);
    assert!(level(&shared) < 0.5 * level(&four) && level(&shared) > level(&parameters));
}

/// The plant's own friction at the motor, wound up slowly until the slave follows: far from
/// saturation every support takes the same part of the tension, `c`, so that tension grows from
/// support to support.
#[test]
fn unsaturated_friction_multiplies_along_the_line() {
    let share = 0.1;
    let drop_of = |pretension: f64| {
        let parameters = Parameters {
            support_friction_limit_n: share * 1e5,
            support_half_tension_n: 1e5,
            kinetic_friction_ratio: 1.0,
            friction_asymmetry: 0.0,
            friction_position_amplitude: 0.0,
            pretension_n: pretension,
            cable_damping_n_s_per_m: 5.0,
            ..linear(Parameters::calibrated())
        };
        let mut plant = plain(&parameters);
        for index in 1..=8000 {
            let position_rad = 4.0 * f64::from(index) / 8000.0;
            plant.step_imposed(ImposedMotion { position_rad, velocity_rad_s: 1.0 }, 0.0, DT_S);
        }
        let state = *plant.state();
        (state.line_force_n[0][0] / state.line_force_n[0][1], state)
    };
    let (gentle, hard) = (drop_of(20.0), drop_of(80.0));
    println!("{gentle:?} {hard:?}");
    // Two inner supports at the mean tension of both ends: (1 + c)/(1 - c).
    close(gentle.0, (1.0 + share) / (1.0 - share), 1e-2);
    close(hard.0, gentle.0, 1e-2);
    // The slave's end: its two supports take their parts of both tensions.
    let [forward, backward] = hard.1.line_force_n.map(|[_, at_slave]| at_slave);
    close(forward - backward, share * (forward + backward), 1e-2);
}

#[test]
fn mirrored_input_gives_the_mirrored_movement() {
    let parameters =
        Parameters { friction_asymmetry: 0.0, bedding_tension_n: 70.0, ..Parameters::calibrated() };
    let (mut forward, mut backward) = (plain(&parameters), plain(&parameters));
    let mut most = 0.0_f64;
    for index in 0..4000 {
        let time = f64::from(index) * DT_S;
        let (volts, hand) = (6.0 * (9.0 * time).sin(), 3.0 * (4.0 * time).cos());
        forward.step(Input { motor_v: volts, hand_torque_nm: hand }, DT_S);
        backward.step(Input { motor_v: -volts, hand_torque_nm: -hand }, DT_S);
        let (a, b) = (forward.state(), backward.state());
        assert_eq!(a.slave_position_rad, -b.slave_position_rad);
        assert_eq!(a.master_velocity_rad_s, -b.master_velocity_rad_s);
        assert_eq!(a.line_position_m[0], -b.line_position_m[1], "the cables change places");
        assert_eq!(a.line_force_n[0][1], b.line_force_n[1][1]);
        most = most.max(a.slave_position_rad.abs());
    }
    assert!(most > 0.1, "{most}");
}

#[test]
fn directions_differ_as_declared() {
    // Breakaway at the slave with the line loose: bearing and both cables' end supports.
    let parameters = Parameters {
        cable_stiffness_factor: 1e-4,
        fibre_friction_ratio: 0.0,
        ..Parameters::printed()
    };
    let radius = parameters.slave_pulley_radius_m();
    let level = 2.0 * radius * parameters.support_friction_n(60.0) * 1.1;
    for (sign, factor) in [(1.0, 1.061), (-1.0, 0.939)] {
        let expected = 0.1 + factor * level;
        for (part, moves) in [(0.999, false), (1.001, true)] {
            let mut plant = plain(&parameters);
            plant.step(Input { motor_v: 0.0, hand_torque_nm: sign * part * expected }, DT_S);
            assert_eq!(
                plant.state().slave_velocity_rad_s != 0.0,
                moves,
                "{sign} {part} {expected}"
            );
        }
    }
}

/// Neither creep nor chatter under an alternating torque below breakaway, wherever the slave
/// stopped.
#[test]
fn stick_never_drifts() {
    let mut plant = plain(&Parameters::calibrated());
    for index in 0..2000 {
        plant.step(
            Input { motor_v: if index < 400 { 4.0 } else { 0.0 }, hand_torque_nm: 0.0 },
            DT_S,
        );
    }
    for _ in 0..4000 {
        plant.step(Input::default(), DT_S);
    }
    let rest = *plant.state();
    assert!(rest.slave_position_rad.abs() > 0.05 && rest.slave_velocity_rad_s == 0.0, "{rest:?}");
    let room = 0.1 + 2.0 * 0.06 * 5.0 * 0.8 - rest.transmitted_torque_nm.abs();
    assert!(room > 0.05, "{room} {rest:?}");
    for index in 0..40_000 {
        let hand_torque_nm = 0.5 * room * (f64::from(index) * 0.02).sin();
        plant.step(Input { motor_v: 0.0, hand_torque_nm }, DT_S);
        let state = plant.state();
        assert_eq!((state.slave_velocity_rad_s, state.line_velocity_m_s), (0.0, [0.0; 2]));
    }
    assert_eq!(plant.state().slave_position_rad, rest.slave_position_rad);
    assert_eq!(plant.state().line_position_m, rest.line_position_m);
}

/// However it is torn about, no cable ever has a tension below zero.
#[test]
fn cables_never_push() {
    let loose =
        Parameters { pretension_n: 3.0, cable_damping_n_s_per_m: 20.0, ..Parameters::calibrated() };
    let mut plant =
        Plant::new(loose, effects(&["nonlinear_stiffness@line=2", "viscoelastic_line=2"])).unwrap();
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for index in 0..6000 {
        let time = f64::from(index) * DT_S;
        plant.step(
            Input { motor_v: 8.0 * (23.0 * time).sin(), hand_torque_nm: 4.0 * (31.0 * time).cos() },
            DT_S,
        );
        for tension in plant.state().line_force_n.as_flattened() {
            least = least.min(*tension);
            most = most.max(*tension);
        }
    }
    assert!((0.0..0.5).contains(&least) && most > 30.0, "{least} {most}");
}

/// A cable that was never loaded beyond its pretension gets longer by the first hard pull, and
/// stays slacker.
#[test]
fn an_overload_reduces_pretension() {
    let tension_after = |bedding_tension_n: f64| {
        let parameters = Parameters { bedding_tension_n, ..linear(Parameters::calibrated()) };
        let set = Parameters { set_ratio: 0.25, cable_damping_n_s_per_m: 60.0, ..parameters };
        let mut plant = plain(&set);
        for torque in [4.0, -4.0, 0.0] {
            for _ in 0..2000 {
                plant.step_imposed(ImposedMotion::default(), torque, DT_S);
            }
        }
        plant.state().line_force_n[0][1]
    };
    close(tension_after(200.0), 60.0, 1e-3);
    // 4 N·m over 60 mm add half of 67 N to each; the set is a quarter of what that stretches, at
    // either cable.
    let (added, set) = (0.5 * 4.0 / 0.06, 0.25);
    let expected = 60.0 - set * added / (1.0 + 0.5 * set);
    let found = tension_after(1.0);
    println!("{found} N, estimated {expected} N");
    assert!(found < 56.0 && (found - expected).abs() < 3.0, "{found} {expected}");
}

fn trajectory(parameters: &Parameters, dt: f64, amplitude_v: f64) -> Vec<[f64; 3]> {
    let plant = plain(parameters);
    assert!(dt <= plant.longest_step_s() * (1.0 + 1e-9), "sub-steps would hide the order");
    let radius = plant.parameters().slave_pulley_radius_m();
    common::trajectory(plant, dt, amplitude_v, |plant| {
        let state = plant.state();
        [
            state.master_position_rad / 6.0,
            state.slave_position_rad,
            state.line_position_m[0] / radius,
        ]
    })
}

fn observed_errors(parameters: &Parameters, amplitude_v: f64) -> Vec<f64> {
    common::observed_errors(0.1e-3, 0.1e-3 / 128.0, |dt| trajectory(parameters, dt, amplitude_v))
}

/// Toe, sag and damping on, dry friction off.
#[test]
fn second_order_without_dry_friction() {
    let parameters = Parameters {
        cable_damping_n_s_per_m: 2.0,
        motor_viscous_nm_s: 0.02,
        fibre_branch_ratio: 0.0,
        pretension_n: 40.0,
        ..frictionless(Parameters::calibrated())
    };
    let errors = observed_errors(&parameters, 1.0);
    println!("{errors:?}");
    for pair in errors.windows(2) {
        assert!((pair[0] / pair[1]).log2() > 1.8, "{errors:?}");
    }
}

#[test]
fn converges_through_stick_slip_and_rubbing() {
    let errors = observed_errors(&Parameters::calibrated(), 4.0);
    println!("{errors:?}");
    let order = (errors[0] / errors[3]).log2() / 3.0;
    assert!(order > 1.5 && errors[0] < 3e-3, "order {order}, {errors:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn balance_closes(
        softness in 0.0_f64..5.0,
        pretension in 2.0_f64..150.0,
        bedding in 1.0_f64..200.0,
        fibre in 0.0_f64..0.3,
        branch in 0.0_f64..1.0,
        set in 0.0_f64..1.0,
        toe in 0.0_f64..20.0,
        friction in 0.0_f64..20.0,
        damping in 0.0_f64..10.0,
        levels in prop::collection::vec((-10.0_f64..10.0, -4.0_f64..4.0), 10..40),
    ) {
        let parameters = Parameters {
            cable_stiffness_factor: (-softness).exp(),
            pretension_n: pretension,
            bedding_tension_n: bedding,
            fibre_friction_ratio: fibre,
            fibre_branch_ratio: branch,
            set_ratio: set,
            toe_tension_n: toe,
            support_friction_limit_n: friction,
            cable_damping_n_s_per_m: damping,
            ..Parameters::printed()
        };
        let mut plant = plain(&parameters);
        let mut last = 0.0;
        for (motor_v, hand_torque_nm) in levels {
            for _ in 0..60 {
                plant.step(Input { motor_v, hand_torque_nm }, DT_S);
                let energy = plant.energy();
                let least = last - 1e-6 * energy.throughput_j;
                prop_assert!(energy.dissipated_j >= least, "friction gives energy");
                last = energy.dissipated_j;
            }
        }
        let energy = plant.energy();
        prop_assert!(energy.effects_j.abs() < 1e-9 * energy.throughput_j.max(1e-6), "{energy:?}");
        let open = energy.defect_j() / energy.throughput_j;
        prop_assert!(open.abs() <= 1e-3, "open {open} of {energy:?}");
    }
}

#[test]
fn effects_change_the_line() {
    let softer = Plant::new(Parameters::printed(), effects(&["line_compliance=35"])).unwrap();
    close(
        softer.parameters().line_stiffness_n_per_m(),
        Parameters::calibrated().line_stiffness_n_per_m(),
        1e-9,
    );
    let damped = Plant::new(Parameters::printed(), effects(&["line_damping=20"])).unwrap();
    close(damped.parameters().cable_damping_n_s_per_m, 20.6, 1e-12);
    let mut late =
        Plant::new(frictionless(Parameters::calibrated()), effects(&["transport_delay@line=0.02"]))
            .unwrap();
    for index in 1..=160 {
        late.step_imposed(ImposedMotion { position_rad: 0.5, velocity_rad_s: 0.0 }, 0.0, DT_S);
        if index < 40 {
            assert_eq!(late.state().slave_position_rad, 0.0, "{index}");
        }
    }
    assert!(late.state().slave_position_rad.abs() > 1e-3);
}

#[test]
fn parameters_by_name() {
    let mut parameters = Parameters::printed();
    for info in Parameters::NAMES {
        assert_eq!(parameters.get(info.name), Some(info.printed), "{}", info.name);
        info.check(info.printed).unwrap();
        parameters.set(info.name, info.minimum).unwrap();
        parameters.set(info.name, info.printed).unwrap();
        assert!(parameters.set(info.name, f64::NAN).is_err());
        assert!(!info.source.is_empty() && !info.unit.is_empty());
    }
    assert_eq!(parameters, Parameters::printed());
    close(parameters.total_slave_inertia_kg_m2(), 1.89e-3 + 2.0 * 2.8775e-3 * 3.6e-3, 1e-9);
    close(parameters.middle_mass_kg(), 4.5 * 7.9e-4 + 2.2e-3, 1e-12);
    close(parameters.element_law(3.0).stiffness_n_per_m, 3.0 * 3.725e4, 1e-12);
    close(0.5 * 1410.0 * PI * 0.01 * 0.06_f64.powi(4), 2.9e-4, 2e-2);
    assert!(Plant::new(Parameters { cables: f64::NAN, ..parameters }, Vec::new()).is_err());
}
