//! Friction laws with bristles (Dahl, LuGre) against their closed forms.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::mass::Mass;
use common::{close, frictionless, loose, plant};
use plant::friction::{Dahl, FrictionLaw, Load, LuGre, OperatingPoint, resistance};
use plant::hydrostatic::Transmission;

/// Force over a travel at constant speed, from upright bristles.
fn slide(law: &mut dyn FrictionLaw, speed: f64, travel: f64, steps: usize) -> f64 {
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
            law.deflection(),
            speed.signum() * 0.9 / 50.0 * (1.0 - (-50.0 * travel / 0.9_f64).exp()),
            1e-9,
        );
    }
    // In one coarse step, too, the deflection is exact.
    let mut law = Dahl::new(0.9, 50.0);
    close(slide(&mut law, 3.0, 10.0, 1), 0.9, 3e-3);
}

#[test]
fn lugre_slides_on_its_stribeck_curve() {
    for speed in [-20.0, -3.0, 0.01, 0.3, 1.0, 3.0, 10.0_f64] {
        let mut law = LuGre::default();
        law.viscous = 0.05;
        let expected = law.curve().level(speed) * speed.signum() + 0.05 * speed;
        close(slide(&mut law, speed, 1.0, 4000), expected, 1e-9);
        // With steps in which the bristles slip many times over.
        law.reset();
        close(slide(&mut law, speed, 50.0, 50), expected, 1e-9);
    }
}

/// Canudas de Wit et al. 1995, § III: friction lags behind speed, so that it is higher while speed
/// rises than while it falls; the more, the faster it varies.
#[test]
fn lugre_friction_lags_behind_speed() {
    let loop_width = |frequency: f64| {
        let mut law = LuGre::default();
        // Less than g / v, as with the small damping of the paper: more would turn the loop round.
        law.damping = 0.1;
        let (parts, step) = (4000, 1.0 / frequency / 4000.0);
        let mut at_two = [0.0; 2];
        for index in 0..2 * parts {
            let angle = std::f64::consts::TAU * f64::from(index) / f64::from(parts);
            let velocity = 2.0 - 1.5 * angle.cos();
            let found = resistance(
                &mut law,
                &OperatingPoint { velocity, step, ..OperatingPoint::default() },
            );
            // Speed 2 rad/s comes a quarter into the last period, rising, and three quarters in,
            // falling.
            match index - parts {
                1000 => at_two[0] = found,
                3000 => at_two[1] = found,
                _ => {}
            }
        }
        at_two[0] - at_two[1]
    };
    let widths = [0.1, 1.0, 10.0].map(loop_width);
    println!("friction at 2 rad/s, rising less falling, at 0.1, 1, 10 Hz: {widths:.4?} N m");
    assert!(
        widths[0] > 0.0 && widths[1] > 5.0 * widths[0] && widths[2] > 3.0 * widths[1],
        "{widths:?}"
    );
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

/// Canudas de Wit et al. 1995, § III: the faster the force comes on, the sooner a mass breaks away.
#[test]
fn lugre_breakaway_falls_with_the_rate_of_force() {
    let level = |rate: f64| {
        let mut mass = Mass::new(Box::new(LuGre::default()));
        // A light mass: the law's own dependence, not that of inertia.
        mass.inertia = 1e-5;
        let (step, mut force) = (1e-5, 0.0);
        loop {
            force += rate * step;
            mass.step(force, step);
            // Away: far beyond the travel in which the bristles give way.
            if mass.velocity > 3.0 {
                return force;
            }
            assert!(force < 10.0, "never breaks away");
        }
    };
    let levels = [1.0, 10.0, 100.0].map(level);
    println!("break-away at 1, 10, 100 N m/s: {levels:.3?}");
    assert!(levels[0] > levels[1] && levels[1] > levels[2], "{levels:?}");
    let law = LuGre::default();
    close(levels[0], law.breakaway, 0.02);
    assert!(levels[2] > law.kinetic, "{levels:?}");
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
    assert_eq!(told.deflection(), untold.deflection());
    assert!(told.deflection() > 0.0);
}
