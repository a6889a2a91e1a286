//! Dead time at each of its sites: what it does, and that it makes no energy.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{DT_S, close, frictionless, plant, volts};
use plant::hydrostatic::{EnergyBalance, ImposedMotion, Input, Parameters, Transmission};

#[test]
fn transport_delay_of_drive_and_sensor() {
    let mut late = plant(Parameters::printed(), &["transport_delay@drive=0.02"]);
    let mut first = None;
    for index in 0..100 {
        late.step(volts(if index == 0 { 0.0 } else { 1.0 }), DT_S);
        if late.state().motor_torque_nm > 1.79 && first.is_none() {
            first = Some(f64::from(index) * DT_S);
        }
    }
    close(first.unwrap(), DT_S + 0.02, 0.05);

    let mut late = plant(Parameters::printed(), &["transport_delay@sensor=0.02"]);
    let mut past = Vec::new();
    for index in 0..400 {
        let torque = f64::from(index) * 0.01;
        late.step(Input { motor_v: 3.0, hand_torque_nm: torque }, DT_S);
        past.push((late.state().master_position_rad, late.state().slave_position_rad, torque));
        if index > 60 {
            let reading = late.reading();
            let (master, slave, torque) = past[index as usize - 40];
            close(reading.master_rad, master, 1e-3);
            close(reading.slave_rad, slave, 1e-3);
            close(reading.slave_torque_nm, torque, 1e-3);
            assert_eq!(reading.motor_v, 3.0);
        }
    }
}

/// Nothing reaches the slave before the dead time; afterwards it does, and the element makes no
/// energy of its own.
#[test]
fn transport_delay_of_line() {
    let mut late = plant(frictionless(Parameters::calibrated()), &["transport_delay@line=0.02"]);
    for index in 1..=4000 {
        late.step_imposed(ImposedMotion { position_rad: 0.1, velocity_rad_s: 0.0 }, 0.0, DT_S);
        let moved = late.state().slave_position_rad.abs();
        if index < 40 {
            assert_eq!(moved, 0.0, "after {} ms", f64::from(index) * 0.5);
        } else if index == 160 {
            assert!(moved > 1e-3, "{moved}");
        }
        assert!(moved < 1.0, "grows: {moved}");
    }
    let mut damped = plant(Parameters::calibrated(), &["transport_delay@line=0.02"]);
    for _ in 0..4000 {
        damped.step_imposed(ImposedMotion { position_rad: 1.0, velocity_rad_s: 0.0 }, 0.0, DT_S);
    }
    let rest = *damped.state();
    assert_eq!(rest.slave_velocity_rad_s, 0.0);
    assert!(
        (rest.slave_position_rad - Parameters::calibrated().transmission_ratio()).abs() < 0.2,
        "{rest:?}"
    );
}

#[test]
fn transport_delay_of_line_is_stable_with_strong_damping() {
    let mut strong =
        plant(Parameters::printed(), &["transport_delay@line=0.01", "line_damping=900"]);
    let mut farthest = 0.0_f64;
    for index in 0..4000 {
        strong.step(volts(4.0 * (f64::from(index) * 0.01).sin()), DT_S);
        farthest = farthest.max(strong.state().slave_position_rad.abs());
    }
    assert!(farthest.is_finite() && (0.01..20.0).contains(&farthest), "{farthest}");
    let energy = strong.energy();
    assert!(energy.defect_j().abs() < 2e-3 * energy.throughput_j, "{energy:?}");
}

/// Whatever the dead time, the element gives back no more than it took: not even after thousands of
/// reflections.
#[test]
fn transport_delay_of_line_creates_no_energy() {
    for delay_ms in [0.3, 0.5, 1.0, 2.0, 5.0, 7.0, 20.0] {
        for parameters in
            [frictionless(Parameters::printed()), frictionless(Parameters::calibrated())]
        {
            let name = format!("transport_delay@line={}", delay_ms * 1e-3);
            let mut late = plant(parameters, &[&name]);
            let mut farthest = [0.0_f64; 2];
            for index in 1..=20_000 {
                // Moved about for 2 s, then held for 8 s.
                let rate = std::f64::consts::TAU * 6.0;
                let (sine, cosine) = (rate * f64::from(index.min(4000)) * DT_S).sin_cos();
                let velocity_rad_s = if index < 4000 { 0.3 * rate * cosine } else { 0.0 };
                late.step_imposed(
                    ImposedMotion { position_rad: 0.3 * sine, velocity_rad_s },
                    0.0,
                    DT_S,
                );
                // What is in masses, springs and waves: the balance counts the declared springs as
                // stored.
                let EnergyBalance { stored_j, effects_j, throughput_j, .. } = late.energy();
                assert!(
                    stored_j + effects_j > -1e-3 * throughput_j,
                    "{name}, step {index}: {:?}",
                    late.energy()
                );
                let moved = &mut farthest[usize::from(index > 4000)];
                *moved = moved.max(late.state().slave_position_rad.abs());
            }
            assert!(
                farthest[0] > 0.2 && farthest[1] < 1.2 * farthest[0],
                "{name}: {farthest:?} rad"
            );
            let energy = late.energy();
            assert!(energy.defect_j().abs() < 1e-4 * energy.throughput_j, "{name}: {energy:?}");
        }
    }
}
