//! Each effect does what it says, in numbers.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{DT_S, close, frictionless, loose, plant, volts};
use plant::ParameterError;
use plant::effects::{self, EffectError, Site, of_plants};
use plant::hydrostatic::{ImposedMotion, Input, Parameters, Plant, State, Transmission};
use std::f64::consts::TAU;

fn hand(torque: f64) -> Input {
    Input { motor_v: 0.0, hand_torque_nm: torque }
}

/// Where a hand holds a slave without dry friction, the master held; with enough damping to come to
/// rest.
fn held(names: &[&str], torque: f64) -> f64 {
    let parameters =
        Parameters { port_damping_n_s_per_m: 100.0, ..frictionless(Parameters::calibrated()) };
    settle(plant(parameters, names), torque, 4000)
}

fn settle(mut plant: Plant, torque: f64, steps: usize) -> f64 {
    for _ in 0..steps {
        plant.step_imposed(ImposedMotion::default(), torque, DT_S);
    }
    plant.state().slave_position_rad
}

/// Smallest hand torque, to 1 mN·m, at which the slave of a loose line moves from `position`, after
/// `wait` seconds.
fn breakaway(names: &[&str], position: f64, sign: f64, wait: f64) -> f64 {
    let (mut low, mut high) = (0.0, 10.0);
    while high - low > 1e-3 {
        let middle = 0.5 * (low + high);
        let mut plant = plant(loose(Parameters::printed()), names);
        if wait > 0.0 {
            plant.step(hand(0.0), wait);
        }
        plant.set_state(State { slave_position_rad: position, ..*plant.state() });
        plant.step(hand(sign * middle), DT_S);
        if plant.state().slave_velocity_rad_s == 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Speed and position of a free slave without dry friction after a constant torque.
fn free_slave(names: &[&str], torque: f64, seconds: f64) -> State {
    let mut plant = plant(frictionless(loose(Parameters::printed())), names);
    for _ in 0..(seconds / DT_S).round() as usize {
        plant.step(hand(torque), DT_S);
    }
    *plant.state()
}

fn slave_inertia() -> f64 {
    Parameters::printed().slave_inertia_kg_m2()
}

/// Both springs of both lines in series and parallel: `2 K a²`.
fn held_stiffness() -> f64 {
    let traced = Parameters::calibrated();
    2.0 * traced.line_stiffness_n_per_m() * traced.slave_displacement_m_per_rad().powi(2)
}

#[test]
fn held_slave_without_effects() {
    close(held(&[], 1.0), 1.0 / held_stiffness(), 1e-3);
}

#[test]
fn line_compliance() {
    close(held(&["line_compliance=1"], 1.0), 2.0 / held_stiffness(), 1e-3);
    let mut traced = plant(Parameters::printed(), &["line_compliance=13"]);
    traced.step(volts(1.0), DT_S);
    close(
        traced.parameters().line_stiffness_n_per_m(),
        Parameters::calibrated().line_stiffness_n_per_m(),
        1e-9,
    );
}

#[test]
fn nonlinear_stiffness() {
    // At 20 N·(1 + c) per line the deflection is the reference, per end; the line has two ends, the
    // slave one.
    let a = Parameters::calibrated().slave_displacement_m_per_rad();
    let reference = 20.0 / (2.0 * Parameters::calibrated().line_stiffness_n_per_m());
    let torque = 2.0 * a * 20.0 * 1.5;
    close(held(&["nonlinear_stiffness@line=0.5"], torque), 2.0 * reference / a, 1e-3);
    close(held(&["nonlinear_stiffness@slave=0.5"], torque), (1.0 + 1.5) * reference / a, 1e-3);
    // Softening, and an even term that tells the directions apart.
    assert!(held(&["nonlinear_stiffness@line=-0.1"], 1.0) > held(&[], 1.0) * 1.01);
    let mut even = effects::parse("nonlinear_stiffness@line=0").unwrap();
    even.set("even", 0.5).unwrap();
    let at = |torque: f64| {
        let parameters =
            Parameters { port_damping_n_s_per_m: 100.0, ..frictionless(Parameters::calibrated()) };
        settle(Plant::new(parameters, vec![even.clone()]).unwrap(), torque, 4000)
    };
    assert!((at(1.0) + at(-1.0)).abs() > 0.1 * at(1.0).abs());
}

#[test]
fn viscoelastic_line() {
    let with = |relaxation: f64| {
        let mut effect = effects::parse("viscoelastic_line=0.5").unwrap();
        effect.set("relaxation_s", relaxation).unwrap();
        let parameters =
            Parameters { port_damping_n_s_per_m: 100.0, ..frictionless(Parameters::calibrated()) };
        settle(Plant::new(parameters, vec![effect]).unwrap(), 1.0, 2000)
    };
    // Long relaxation: stiffer by half. Short: as declared.
    close(with(100.0), 1.0 / (1.5 * held_stiffness()), 1e-2);
    close(with(0.02), 1.0 / held_stiffness(), 1e-3);
}

#[test]
fn leakage() {
    let parameters =
        Parameters { port_damping_n_s_per_m: 100.0, ..frictionless(Parameters::calibrated()) };
    let (a, area) = (parameters.slave_displacement_m_per_rad(), parameters.hose_area_m2);
    let mut plant = plant(parameters, &["leakage=1e-12"]);
    let torque = 1.0;
    let at = |plant: &mut Plant, steps: usize| {
        for _ in 0..steps {
            plant.step_imposed(ImposedMotion::default(), torque, DT_S);
        }
        plant.state().slave_position_rad
    };
    let early = at(&mut plant, 4000);
    let late = at(&mut plant, 4000);
    // Two pistons, each 2 G F / A² of fluid displacement, with F = τ / 2a per line.
    let expected = 2.0 * (2.0 * 1e-12 * (torque / (2.0 * a)) / (area * area)) / a;
    close((late - early) / 2.0, expected, 1e-2);
}

#[test]
fn backlash() {
    let a = Parameters::calibrated().slave_displacement_m_per_rad();
    let am = Parameters::calibrated().master_displacement_m_per_rad();
    for (name, play) in [
        ("backlash@slave=0.02", 0.02),
        ("backlash@line=0.001", 1e-3 / a),
        ("backlash@master=0.02", 0.02 * am / a),
    ] {
        let found = held(&[name], 1.0) - held(&[name], -1.0) - 2.0 * held(&[], 1.0);
        close(found, play, 1e-2);
    }
}

#[test]
fn line_damping() {
    // Free swing of the slave against the held master: the mode's decay is the sum of fluid's and
    // ports'.
    let rate = |damping: f64, names: &[&str]| {
        let parameters = Parameters {
            port_damping_n_s_per_m: damping,
            ..frictionless(Parameters::calibrated())
        };
        let a = parameters.slave_displacement_m_per_rad();
        let mut plant = plant(parameters, names);
        plant.set_state(State {
            slave_position_rad: 0.1,
            line_position_m: [0.05 * a; 2],
            ..State::default()
        });
        let mut peaks = [0.0_f64; 2];
        for index in 0..1600 {
            plant.step_imposed(ImposedMotion::default(), 0.0, DT_S);
            let part = usize::from(index >= 800);
            peaks[part] = peaks[part].max(plant.state().slave_position_rad.abs());
        }
        (peaks[0] / peaks[1]).ln()
    };
    close(rate(1.0, &["line_damping=4"]), rate(5.0, &[]), 1e-9);
    assert!(rate(1.0, &["line_damping=4"]) > 1.3 * rate(1.0, &[]));
}

#[test]
fn coulomb_friction() {
    close(breakaway(&["coulomb_friction@slave=0.3"], 0.0, 1.0, 0.0), 2.6, 1e-3);
    // At the master: free run at 1 V less 0.3 N·m.
    let mut free =
        plant(frictionless(loose(Parameters::printed())), &["coulomb_friction@master=0.3"]);
    for _ in 0..100 {
        free.step(volts(1.0), DT_S);
    }
    let expected = (1.8 - 0.3) / Parameters::printed().master_inertia_kg_m2() * 0.05;
    close(free.state().master_velocity_rad_s, expected, 1e-3);
}

#[test]
fn viscous_friction_and_quadratic_drag() {
    close(free_slave(&["viscous_friction@slave=0.05"], 1.0, 2.0).slave_velocity_rad_s, 20.0, 1e-3);
    close(free_slave(&["quadratic_drag@slave=0.005"], 0.5, 2.0).slave_velocity_rad_s, 10.0, 1e-3);
}

#[test]
fn stribeck_friction() {
    close(breakaway(&["stribeck_friction@slave=0.5"], 0.0, -1.0, 0.0), 2.8, 1e-3);
    // Well above its speed nothing is left: a free slave runs up as if there were none.
    let with = free_slave(&["stribeck_friction@slave=0.1"], 1.0, 0.05).slave_velocity_rad_s;
    let expected = 0.05 / slave_inertia();
    assert!(with < expected && with > 0.98 * expected, "{with} {expected}");
}

#[test]
fn asymmetric_friction() {
    close(breakaway(&["asymmetric_friction@slave=0.2"], 0.0, 1.0, 0.0), 2.5, 1e-3);
    close(breakaway(&["asymmetric_friction@slave=0.2"], 0.0, -1.0, 0.0), 2.1, 1e-3);
    // The viscous part: terminal speed forward under 0.2 N·m of dry and 0.02 N·m·s/rad.
    close(
        free_slave(&["asymmetric_friction@slave=0.2"], 0.6, 2.0).slave_velocity_rad_s,
        20.0,
        1e-3,
    );
}

#[test]
fn position_dependent_friction() {
    for position in [-1.0, 0.0, 0.7] {
        let expected = 2.3 * (1.0 + 0.3 * (position + 0.785_f64).sin());
        close(
            breakaway(&["position_dependent_friction@slave=0.3"], position, 1.0, 0.0),
            expected,
            1e-3,
        );
    }
}

#[test]
fn load_dependent_friction() {
    // The line winds up until it overcomes 2.3 N·m and a tenth of itself.
    let wound = |names: &[&str]| {
        let mut plant = plant(Parameters::calibrated(), names);
        for index in 1..20_000 {
            let position = f64::from(index) * 1e-5;
            let before = plant.state().transmitted_torque_nm;
            plant.step_imposed(
                ImposedMotion { position_rad: position, velocity_rad_s: 0.02 },
                0.0,
                DT_S,
            );
            if plant.state().slave_velocity_rad_s != 0.0 {
                return before;
            }
        }
        panic!("never moved")
    };
    close(wound(&[]), 2.3, 2e-3);
    close(wound(&["load_dependent_friction@slave=0.1"]), 2.3 / 0.9, 2e-3);
}

#[test]
fn presliding_hysteresis() {
    // Torque rises slowly to 2 N·m of 2.3: half is dry (1.15), the bristles hold 0.85 of their
    // 1.15.
    let flat = Parameters {
        slave_falling_slope_nm_s: 0.0,
        slave_kinetic_friction_nm: 2.3,
        slave_rising_slope_nm_s: 0.0,
        ..loose(Parameters::printed())
    };
    let mut plant = plant(flat, &["presliding_hysteresis@slave=0.5"]);
    for index in 0..8000 {
        plant.step(hand(2.0 * f64::from(index) / 8000.0), DT_S);
    }
    let expected = -0.02 * (1.0 - 0.85_f64 / 1.15).ln();
    close(plant.state().slave_position_rad, expected, 0.03);
    // Released, the bristles push back only what exceeds the dry half: nothing here.
    let before = plant.state().slave_position_rad;
    for _ in 0..2000 {
        plant.step(hand(0.0), DT_S);
    }
    assert!((plant.state().slave_position_rad - before).abs() < 1e-3);
}

#[test]
fn gravity_imbalance() {
    let state =
        free_slave(&["gravity_imbalance@slave=0.2", "viscous_friction@slave=0.02"], 0.1, 4.0);
    close(state.slave_position_rad, 0.5_f64.asin(), 1e-3);
}

#[test]
fn extra_inertia() {
    let expected = 0.01 * 0.1 / (slave_inertia() + 1e-3);
    close(
        free_slave(&["extra_inertia@slave=0.001"], 0.01, 0.1).slave_velocity_rad_s,
        expected,
        1e-3,
    );
}

#[test]
fn hand_impedance() {
    close(free_slave(&["hand_impedance=2"], 0.5, 4.0).slave_position_rad, 0.25, 1e-3);
}

#[test]
fn torque_ripple() {
    let mut ripple = plant(Parameters::printed(), &["torque_ripple=0.1"]);
    for part in [-0.25_f64, 0.25, 0.125] {
        ripple.set_state(State { master_position_rad: part * TAU / 6.0, ..State::default() });
        ripple.step(volts(0.0), DT_S / 10.0);
        assert!((ripple.state().motor_torque_nm - 0.1 * (part * TAU).sin()).abs() < 1e-4);
    }
}

#[test]
fn amplifier() {
    let torque = |name: &str, input: f64, seconds: f64| {
        let mut plant = plant(Parameters::printed(), &[name]);
        for _ in 0..(seconds / DT_S).round() as usize {
            plant.step(volts(input), DT_S);
        }
        plant.state().motor_torque_nm
    };
    close(torque("amplifier_saturation=2", 5.0, DT_S), 3.6, 1e-12);
    close(torque("amplifier_saturation=2", -5.0, DT_S), -3.6, 1e-12);
    close(torque("amplifier_deadzone=0.1", 0.5, DT_S), 1.8 * 0.4, 1e-12);
    assert_eq!(torque("amplifier_deadzone=0.1", -0.09, DT_S), 0.0);
    // The torque is that of the middle of the last internal step of 0.25 ms.
    close(
        torque("amplifier_lag=0.005", 1.0, 5e-3),
        1.8 * (1.0 - (-(5e-3 - 0.125e-3) / 5e-3_f64).exp()),
        1e-9,
    );
}

#[test]
fn thermal_drift() {
    close(breakaway(&["thermal_drift@slave=0.5"], 0.0, 1.0, 0.0), 2.3 * 1.5, 1e-3);
    close(
        breakaway(&["thermal_drift@slave=0.5"], 0.0, 1.0, 20.0),
        2.3 * (1.0 + 0.5 * (-1.0_f64).exp()),
        1e-3,
    );
    // Twice the loss when cold: the flow decays twice as fast.
    let decay = |names: &[&str]| {
        let mut plant = plant(frictionless(loose(Parameters::printed())), names);
        plant.set_state(State { line_velocity_m_s: [0.5; 2], ..State::default() });
        for _ in 0..200 {
            plant.step(hand(0.0), DT_S);
        }
        (0.5 / plant.state().line_velocity_m_s[0]).ln()
    };
    close(decay(&["thermal_drift@line=1"]), 2.0 * decay(&[]), 5e-3);
}

#[test]
fn periodic_disturbance() {
    let mut shaken =
        plant(frictionless(loose(Parameters::printed())), &["periodic_disturbance@slave=0.2"]);
    let mut fastest = 0.0_f64;
    for _ in 0..400 {
        shaken.step(hand(0.0), DT_S);
        fastest = fastest.max(shaken.state().slave_velocity_rad_s);
    }
    close(fastest, 2.0 * 0.2 / (slave_inertia() * TAU * 11.0), 5e-3);
}

#[test]
fn sensors() {
    let reading = |name: &str, torque: f64| {
        let mut plant = plant(Parameters::printed(), &[name]);
        plant.set_state(State {
            slave_position_rad: 0.5,
            master_position_rad: 0.6,
            ..State::default()
        });
        for _ in 0..20 {
            plant.step(Input { motor_v: 0.1, hand_torque_nm: torque }, DT_S);
        }
        (plant.reading(), *plant.state())
    };
    close(reading("sensor_offset=0.1", 0.5).0.slave_torque_nm, 0.6, 1e-12);
    close(reading("sensor_gain=0.1", 0.5).0.slave_torque_nm, 0.55, 1e-12);
    close(reading("sensor_drift=0.2", 0.5).0.slave_torque_nm, 0.5 + 0.2 * 0.01, 1e-9);
    close(reading("sensor_crosstalk=0.5", 0.5).0.slave_torque_nm, 0.55, 1e-12);
    close(reading("rectified_sensor=1", -0.5).0.slave_torque_nm, 0.5, 1e-12);
    close(reading("rectified_sensor=0.5", -0.5).0.slave_torque_nm + 1.0, 1.0, 1e-12);
    let expected = 0.5 + 0.05 * (TAU * 50.0 * 0.01_f64).sin();
    assert!((reading("mains_hum=0.05", 0.5).0.slave_torque_nm - expected).abs() < 1e-9);
    let (read, state) = reading("encoder_eccentricity=0.01", 0.5);
    close(read.slave_rad, state.slave_position_rad + 0.01 * state.slave_position_rad.sin(), 1e-12);
    assert_eq!(read.master_rad, state.master_position_rad);
}

#[test]
fn names_and_sites_are_those_of_the_interface() {
    for entry in of_plants() {
        let effect = effects::parse(entry.id).unwrap();
        assert_eq!((effect.id(), effect.site()), (entry.id, entry.sites[0].site));
        for place in entry.sites {
            let effect = effects::parse(&format!("{}@{}", entry.id, place.site)).unwrap();
            assert_eq!(effect.site(), place.site);
            let size = effect.infos()[0].name;
            assert_eq!(effect.get(size), Some(place.size));
            let effect =
                effects::parse(&format!("{}@{}={}", entry.id, place.site, 0.5 * place.size))
                    .unwrap();
            assert_eq!(effect.get(size), Some(0.5 * place.size));
        }
    }
}

#[test]
fn errors_name_what_is_allowed() {
    let unknown = effects::parse("backlsh").unwrap_err();
    assert!(unknown.to_string().contains("backlash, "), "{unknown}");
    let site = effects::parse("backlash@sensor=1").unwrap_err();
    assert!(site.to_string().ends_with("expected one of: line, master, slave"), "{site}");
    assert!(effects::parse("backlash@nowhere").is_err());
    let number = effects::parse("backlash=much").unwrap_err();
    assert!(number.to_string().contains("`much`"), "{number}");
    for bad in ["backlash=-1", "backlash=NaN", "backlash=inf"] {
        let range = effects::parse(bad).unwrap_err();
        assert!(
            matches!(range, EffectError::Size { error: ParameterError::OutOfRange { .. }, .. }),
            "{bad}: {range}"
        );
    }
    assert!(matches!(
        effects::make("leakage", Site::Slave, 1e-12),
        Err(EffectError::WrongSite { .. })
    ));
}
