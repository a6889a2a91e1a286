//! Stability of sampled laws on transmissions: closed forms, and what is promised of the check.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use plant::stability::{
    Field, HANDS, Hand, Law, LinearModel, Loop, MARGIN, Sampling, check, growth,
};
use plant::transmission::{Input, Transmission};
use plant::{hydrostatic, transmission_kinds};

const COUNTS: f64 = 4000.0 / std::f64::consts::TAU;
const SPEED: f64 = 26.18;
const NONE: Hand = HANDS[0];

fn sampling(hz: f64) -> Sampling {
    Sampling {
        period_s: 1.0 / hz,
        answer_s: 1e-3,
        velocity_hz: 40.0,
        acceleration_hz: 10.0,
        cell_hz: 200.0,
    }
}

fn axis(parameters: hydrostatic::Parameters, hz: f64, law: Law) -> Loop {
    Loop { model: LinearModel::new(&parameters, SPEED), sampling: sampling(hz), gear: 1.0, law }
}

fn force(hz: f64) -> Law {
    Law::Force { gain: 0.333 * 0.5, share: 1.0 - 0.6_f64.powf(hz.recip() * 500.0), by_slave: true }
}

fn position(raised: f64) -> Law {
    Law::Position { proportional: raised * 4.5e-3 * COUNTS, derivative: raised * 7e-4 * COUNTS }
}

/// Constants without any dry friction, so that the plant is linear but for turbulence.
fn frictionless(mut parameters: hydrostatic::Parameters) -> hydrostatic::Parameters {
    for value in [
        &mut parameters.motor_coulomb_nm,
        &mut parameters.master_piston_static_friction_n,
        &mut parameters.master_piston_falling_slope_n_s_per_m,
        &mut parameters.master_piston_kinetic_friction_n,
        &mut parameters.master_piston_rising_slope_n_s_per_m,
        &mut parameters.slave_static_friction_nm,
        &mut parameters.slave_falling_slope_nm_s,
        &mut parameters.slave_kinetic_friction_nm,
        &mut parameters.slave_rising_slope_nm_s,
    ] {
        *value = 0.0;
    }
    parameters
}

/// Growth of a real, frictionless plant under the sampled position law, by simulation from a small
/// push (1/s): from the envelope of the slave's movement over two windows, when faster modes are
/// gone.
fn simulated_growth(parameters: hydrostatic::Parameters, law: Law, seconds: f64) -> f64 {
    let Law::Position { proportional, derivative } = law else { panic!("a position law") };
    let mut plant = transmission_kinds::Parameters::from(parameters).plant(Vec::new()).unwrap();
    let weight = 1.0 - (-std::f64::consts::TAU * 40.0 * 2e-3_f64).exp();
    let (mut volts, mut last, mut velocity) = (0.0, 0.0, 0.0);
    let steps = (seconds / 2e-3) as usize;
    let mut peaks = [0.0_f64; 2];
    for step in 0..steps {
        let at = plant.motion().master_position_rad;
        velocity += weight * ((at - last) / 2e-3 - velocity);
        last = at;
        let push = if step < 5 { 1e-8 } else { 0.0 };
        // The answer to a scan is at the motor half a period later.
        plant.step(Input { motor_v: volts + push, hand_torque_nm: 0.0 }, 1e-3);
        volts = -(proportional * at + derivative * velocity);
        plant.step(Input { motor_v: volts + push, hand_torque_nm: 0.0 }, 1e-3);
        // A fifth each, the third and the last.
        let fifth = 5 * step / steps;
        if fifth == 2 || fifth == 4 {
            let place = usize::from(fifth == 4);
            peaks[place] = peaks[place].max(plant.motion().slave_position_rad.abs());
        }
    }
    (peaks[1] / peaks[0]).ln() / (0.4 * seconds)
}

#[test]
fn growth_is_that_of_the_plant_itself() {
    // Stable and unstable, soft line and stiff: the poles say what the simulation without friction
    // does.
    for (parameters, raised) in [
        (hydrostatic::Parameters::calibrated(), 1.0),
        (hydrostatic::Parameters::calibrated(), 3.0),
        (hydrostatic::Parameters::printed(), 1.0),
        (hydrostatic::Parameters::printed(), 0.5),
    ] {
        let parameters = frictionless(parameters);
        let expected = growth(
            &[axis(parameters.clone(), 500.0, position(raised))],
            &Field::default(),
            &NONE,
            1.0,
        );
        // Long enough for the mode that grows to leave all others behind.
        let seconds = (20.0 / expected.abs()).clamp(0.05, 6.0);
        let found = simulated_growth(parameters, position(raised), seconds);
        println!("P and D times {raised}: poles {expected:.2}/s, simulated {found:.2}/s");
        assert!(
            (found - expected).abs() < 0.15 * expected.abs() + 0.1,
            "poles {expected}/s, simulated {found}/s"
        );
    }
}

#[test]
fn raised_gains_are_gains_raised() {
    let at = |law, raised| {
        growth(
            &[axis(hydrostatic::Parameters::calibrated(), 500.0, law)],
            &Field::default(),
            &NONE,
            raised,
        )
    };
    assert!((at(position(1.0), MARGIN) - at(position(MARGIN), 1.0)).abs() < 1e-9);
}

#[test]
fn a_free_handle_is_marginal_and_nan_never_passes() {
    let free = axis(hydrostatic::Parameters::calibrated(), 500.0, force(500.0));
    let still = growth(&[free], &Field::default(), &NONE, 1.0);
    assert!(still.abs() < 1e-3, "{still}");
    assert!(check(&[free], &Field::default()).is_ok());
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for field in [
            Field::of_one(wrong, 0.0, 0.0),
            Field::of_one(0.0, wrong, 0.0),
            Field::of_one(0.0, 0.0, wrong),
        ] {
            assert!(check(&[free], &field).is_err(), "{field:?}");
        }
        let law = Law::Position { proportional: wrong, derivative: 0.0 };
        assert!(check(&[Loop { law, ..free }], &Field::default()).is_err());
    }
    assert!(check(&[], &Field::default()).is_err(), "no axis");
}

#[test]
fn equal_delays_give_equal_growth_at_both_rates() {
    for field in [
        Field::default(),
        Field::of_one(5.0, 0.0, 0.0),
        Field::of_one(0.0, 0.5, 0.0),
        Field::of_one(0.0, 0.0, 0.005),
    ] {
        for hand in HANDS {
            let [slow, fast, faster] = [500.0, 1000.0, 2000.0].map(|hz| {
                growth(
                    &[axis(hydrostatic::Parameters::calibrated(), hz, force(hz))],
                    &field,
                    &hand,
                    1.0,
                )
            });
            assert!(
                (slow - fast).abs() < 0.5 && (fast - faster).abs() < 0.5,
                "{field:?} {hand:?}: {slow} {fast} {faster}"
            );
        }
    }
}

#[test]
fn the_printed_gains_are_stable_on_the_traced_line_and_not_on_the_printed_one() {
    let verdict = |parameters| check(&[axis(parameters, 500.0, position(1.0))], &Field::default());
    assert_eq!(verdict(hydrostatic::Parameters::calibrated()), Ok(()));
    let unstable = verdict(hydrostatic::Parameters::printed()).unwrap_err();
    assert!(unstable.raised == 1.0 && unstable.growth > 5.0, "{unstable:?}");
}

#[test]
fn two_uncoupled_axes_are_as_stable_as_one_and_a_curl_field_couples_them() {
    let one = axis(hydrostatic::Parameters::calibrated(), 500.0, force(500.0));
    for hand in HANDS {
        let single = growth(&[one], &Field::of_one(2.0, 0.1, 0.001), &hand, 1.0);
        let mut both = Field::default();
        for at in 0..2 {
            (both.stiffness[at][at], both.damping[at][at], both.inertia[at][at]) =
                (2.0, 0.1, 0.001);
        }
        assert!((growth(&[one, one], &both, &hand, 1.0) - single).abs() < 1e-6, "{hand:?}");
    }
    let curl = |size: f64| {
        let mut field = Field::default();
        (field.damping[0][1], field.damping[1][0]) = (size, -size);
        check(&[one, one], &field)
    };
    // A curl drives whoever goes round with it: less of it is borne than of a damper.
    assert!(curl(0.2).is_ok() && curl(-0.2).is_ok());
    assert!(curl(0.4).is_err() && curl(-0.4).is_err());
    assert!(check(&[one, one], &Field::of_one(0.0, 0.4, 0.0)).is_ok());
}

#[test]
fn a_field_diverges_if_its_stiffness_has_a_negative_eigenvalue() {
    assert!(!Field::of_one(1.0, -1.0, 0.0).diverges() && Field::of_one(-0.1, 0.0, 0.0).diverges());
    let mut shear = Field::default();
    (shear.stiffness[0][1], shear.stiffness[1][0]) = (1.0, 1.0);
    assert!(shear.diverges(), "eigenvalues 1 and -1");
    shear.stiffness[1][0] = -1.0;
    assert!(!shear.diverges(), "antisymmetric: it turns, and drives nowhere");
}
