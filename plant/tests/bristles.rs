//! Bristles under Dahl's law against its closed forms.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::laws::{Dahl, Law, resistance};
use common::mass::Mass;
use common::{close, frictionless, loose, plant};
use plant::friction::{Load, OperatingPoint};
use plant::hydrostatic::Transmission;

/// Force over a travel at constant speed, from upright bristles.
fn slide(law: &mut dyn Law, speed: f64, travel: f64, steps: usize) -> f64 {
    let step = travel / speed.abs() / steps as f64;
    (0..steps).fold(0.0, |_, _| {
        resistance(law, &OperatingPoint { velocity: speed, step, ..OperatingPoint::default() })
    })
}

#[test]
fn dahl_starts_with_its_stiffness_and_ends_at_its_level() {
    let mut law = Dahl::new(0.9, 50.0);
    // The force is the mean of the last step: half a step less than the whole travel.
    close(slide(&mut law, 0.1, 1e-5, 100), 50.0 * 1e-5 * 0.995, 1e-3);
    for (speed, steps) in [(0.01, 1000), (30.0, 1000), (-30.0, 1000)] {
        let mut law = Dahl::new(0.9, 50.0);
        let travel = 0.02;
        let middle = travel * (1.0 - 0.5 / 1000.0);
        let expected = 0.9 * (1.0 - (-50.0 * middle / 0.9_f64).exp());
        close(slide(&mut law, speed, travel, steps), expected * speed.signum(), 1e-6);
        close(
            law.bristle.deflection(),
            speed.signum() * 0.9 / 50.0 * (1.0 - (-50.0 * travel / 0.9_f64).exp()),
            1e-9,
        );
    }
    // In one coarse step, too, the deflection is exact.
    let mut law = Dahl::new(0.9, 50.0);
    close(slide(&mut law, 3.0, 10.0, 1), 0.9, 3e-3);
}

/// The effect is the law: a slave on its own with all of its dry friction as bristles moves as a
/// mass under Dahl's law.
#[test]
fn presliding_effect_is_dahl_s_law() {
    let parameters = plant::hydrostatic::Parameters {
        slave_static_friction_nm: 2.3,
        slave_kinetic_friction_nm: 2.3,
        ..frictionless(loose(plant::hydrostatic::Parameters::printed()))
    };
    let mut mass = Mass::new(Box::new(Dahl::new(2.3, 2.3 / 0.02)));
    mass.inertia = parameters.slave_inertia_kg_m2();
    let mut slave = plant(parameters, &["presliding_hysteresis@slave=1"]);
    let mut farthest = 0.0_f64;
    for index in 0..4000 {
        let torque = 3.0 * (f64::from(index) * 0.01).sin();
        slave.step(plant::hydrostatic::Input { motor_v: 0.0, hand_torque_nm: torque }, 0.25e-3);
        mass.step(torque, 0.25e-3);
        farthest = farthest.max(mass.position.abs());
        let difference = (slave.state().slave_position_rad - mass.position).abs();
        assert!(difference < 1e-4 * farthest.max(1e-3), "{index}: {difference} of {farthest}");
    }
    assert!(farthest > 0.1, "{farthest}");
}

#[test]
fn a_law_without_settle_uses_the_predicted_travel() {
    let (mut told, mut untold) = (Dahl::new(1.0, 100.0), Dahl::new(1.0, 100.0));
    let at = OperatingPoint { velocity: 1.0, step: 1e-3, ..OperatingPoint::default() };
    for _ in 0..10 {
        resistance(&mut told, &at);
        untold.contribute(&mut Load::default(), &at);
    }
    untold.contribute(&mut Load::default(), &at);
    assert_eq!(told.bristle.deflection(), untold.bristle.deflection());
    assert!(told.bristle.deflection() > 0.0);
}
