//! Parameters by name; sensors; the one-mass drive.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{close, effects};
use plant::hydrostatic::Parameters;
use plant::sensors::{TorqueCell, TorqueCellParameters};
use plant::{ParameterError, ParameterSet, drive};

#[test]
fn printed_and_derived_constants() {
    let printed = Parameters::printed();
    close(printed.line_stiffness_n_per_m(), 32_736.0, 1e-6);
    close(printed.fluid_mass_kg(), 1.490_72, 1e-6);
    close(printed.master_inertia_kg_m2(), 2.5e-3 + 4.5e-4 + 0.239 * 0.031 * 0.031, 1e-12);
    close(printed.slave_inertia_kg_m2(), 1.6e-3 + 1.27e-4 + 0.254 * 0.034 * 0.034, 1e-12);
    close(printed.static_friction_at_motor_nm(), 2.738, 1e-3);
    // F_mf jumps at the corner: 0.163 to 0.240 N.
    let (friction, radius) = (printed.master_piston_friction(), printed.master_pulley_radius_m);
    close(friction.level(6.0 - 1e-9) / radius, 0.1628, 1e-3);
    close(friction.level(6.0) / radius, 0.240, 1e-9);
    // τ_sf does not.
    close(printed.slave_friction().level(6.0 - 1e-9), 1.10, 1e-6);
    close(printed.slave_friction().level(-8.0), 1.50, 1e-9);
    assert_eq!(printed.slave_friction().level(0.0), 2.30);
}

#[test]
fn by_name() {
    let mut parameters = Parameters::printed();
    for info in Parameters::NAMES {
        assert_eq!(parameters.get(info.name), Some(info.printed), "{}", info.name);
        info.check(info.printed).unwrap();
        parameters.set(info.name, info.minimum).unwrap();
        assert_eq!(parameters.get(info.name), Some(info.minimum));
        parameters.set(info.name, info.printed).unwrap();
        let beyond =
            if info.maximum.is_finite() { info.maximum * 1.1 + 1.0 } else { info.minimum - 1.0 };
        let error = parameters.set(info.name, beyond).unwrap_err();
        assert!(error.to_string().contains(info.name), "{error}");
        assert!(parameters.set(info.name, f64::NAN).is_err());
    }
    assert_eq!(parameters, Parameters::printed());
    assert_eq!(parameters.get("hose_lenght_m"), None);
    assert!(matches!(parameters.set("hose_lenght_m", 1.0), Err(ParameterError::Unknown { .. })));
    let broken = Parameters { hose_length_m: f64::NAN, ..Parameters::printed() };
    assert!(plant::hydrostatic::Plant::new(broken, Vec::new()).is_err());
}

#[test]
fn another_hose_leaves_the_cylinders() {
    let thin = Parameters::printed().with_hose_diameter(0.005);
    let printed = Parameters::printed();
    close(thin.hose_area_m2, std::f64::consts::PI * 0.0025 * 0.0025, 1e-12);
    close(
        thin.master_area_ratio * thin.hose_area_m2,
        printed.master_area_ratio * printed.hose_area_m2,
        1e-12,
    );
    close(thin.transmission_ratio(), printed.transmission_ratio(), 1e-12);
}

#[test]
fn torque_cell_noise_is_seeded_and_sized() {
    let parameters = TorqueCellParameters {
        volts_per_nm: 2.0,
        offset_v: 0.1,
        noise_v: 0.01,
        bandwidth_hz: 100.0,
        limit_v: 10.0,
    };
    let read = |seed: u64| {
        let mut cell = TorqueCell::new(parameters, seed);
        (0..20_000).map(|_| cell.read(1.0, 0.5e-3)).collect::<Vec<_>>()
    };
    let (first, again, other) = (read(1), read(1), read(2));
    assert_eq!(first, again);
    assert_ne!(first, other);
    let settled = &first[1000..];
    let mean = settled.iter().sum::<f64>() / settled.len() as f64;
    let deviation =
        (settled.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / settled.len() as f64).sqrt();
    close(mean, 2.1, 1e-3);
    close(deviation, 0.01, 0.03);
    // The low pass, without noise: 63 % after 1 / (2π f).
    let quiet = TorqueCellParameters { noise_v: 0.0, offset_v: 0.0, ..parameters };
    let mut cell = TorqueCell::new(quiet, 0);
    close(
        cell.read(1.0, 1.0 / (std::f64::consts::TAU * 100.0)),
        2.0 * (1.0 - (-1.0_f64).exp()),
        1e-9,
    );
    let mut cell = TorqueCell::new(
        TorqueCellParameters { bandwidth_hz: f64::INFINITY, limit_v: 1.0, ..quiet },
        0,
    );
    assert_eq!(cell.read(100.0, 0.5e-3), 1.0);
}

#[test]
fn drive_approaches_its_terminal_speed_and_stops_with_coulomb_friction() {
    let parameters = drive::Parameters {
        mass_kg: 95.0,
        viscous_friction_n_s_per_m: 200.0,
        force_offset_n: -3.0,
    };
    let mut plant =
        drive::Plant::new(parameters.clone(), effects(&["coulomb_friction@slave=20"])).unwrap();
    let tau: f64 = 95.0 / 200.0;
    for _ in 0..1000 {
        plant.step(117.0, 1e-3);
    }
    close(plant.state().velocity_m_s, 0.5 * (1.0 - (-1.0 / tau).exp()), 1e-5);
    for _ in 0..5000 {
        plant.step(0.0, 1e-3);
    }
    assert_eq!(plant.state().velocity_m_s, 0.0);
    assert_eq!(plant.reading().master_rad, plant.state().position_m);
    assert!(drive::Plant::new(parameters, effects(&["leakage"])).is_err());
}
