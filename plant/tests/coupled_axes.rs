//! Several transmissions at one handle: closed forms, energy, symmetry, stick, limits.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{effects, frictionless, loose, observed_errors};
use plant::coupled_axes::{CouplingError, HandleCoupling, LEAST_EIGENVALUE, Plant};
use plant::transmission::{Input, Transmission};
use plant::{cable, hydrostatic, transmission_kinds};
use proptest::prelude::*;

const DT_S: f64 = 0.5e-3;

fn calibrated() -> hydrostatic::Parameters {
    hydrostatic::Parameters::calibrated()
}

fn oil(parameters: &hydrostatic::Parameters) -> transmission_kinds::Plant {
    transmission_kinds::Parameters::from(parameters.clone()).plant(Vec::new()).unwrap()
}

fn coupled(axes: Vec<transmission_kinds::Plant>, pairs: &[f64]) -> Plant {
    let coupling = HandleCoupling::of_pairs(axes.len(), pairs).unwrap();
    Plant::new(axes, &coupling).unwrap()
}

/// Volts on each axis, and no hand.
fn volts<const N: usize>(volts: [f64; N]) -> [Input; N] {
    volts.map(|motor_v| Input { motor_v, hand_torque_nm: 0.0 })
}

/// With nothing but the handle's inertia, a hand's torque accelerates as the inverse of the matrix
/// says.
#[test]
fn a_free_handle_accelerates_as_its_inertia_matrix_says() {
    let parameters = loose(frictionless(calibrated()));
    let own = parameters.slave_inertia_kg_m2();
    let pairs = [0.4 * own, -0.2 * own, 0.3 * own];
    let mut plant = coupled(vec![oil(&parameters), oil(&parameters), oil(&parameters)], &pairs);
    let torque = [0.02, -0.01, 0.005];
    let inputs = torque.map(|hand_torque_nm| Input { motor_v: 0.0, hand_torque_nm });
    for _ in 0..100 {
        plant.step(&inputs, DT_S);
    }
    let matrix = nalgebra::Matrix3::new(
        own, pairs[0], pairs[1], //
        pairs[0], own, pairs[2], //
        pairs[1], pairs[2], own,
    );
    let expected = matrix.try_inverse().unwrap() * nalgebra::Vector3::from(torque) * 0.05;
    for axis in 0..3 {
        let speed = plant.motion(axis).slave_velocity_rad_s;
        assert!(
            (speed / expected[axis] - 1.0).abs() < 1e-4,
            "axis {axis}: {speed} against {}",
            expected[axis]
        );
    }
}

#[test]
fn without_coupling_every_axis_moves_as_if_alone() {
    let long = calibrated();
    let short = calibrated().with_hose_length(2.0);
    let other = transmission_kinds::Parameters::from(cable::Parameters::calibrated());
    let mut alone = [oil(&long), oil(&short), other.clone().plant(Vec::new()).unwrap()];
    for pairs in [&[][..], &[0.0, 0.0, 0.0]] {
        let mut plant = coupled(alone.to_vec(), pairs);
        for index in 0..1000 {
            let phase = f64::from(index) * 0.01;
            let inputs = volts([6.0 * phase.sin(), 5.0 * phase.cos(), 4.0]);
            plant.step(&inputs, DT_S);
            for (axis, single) in alone.iter_mut().enumerate() {
                single.step(inputs[axis], DT_S);
                assert_eq!(
                    (plant.motion(axis), plant.reading(axis)),
                    (single.motion(), single.reading())
                );
            }
        }
        assert!(plant.motion(0).slave_position_rad.abs() > 0.1);
        alone = [oil(&long), oil(&short), other.clone().plant(Vec::new()).unwrap()];
    }
}

/// The path of the coupled handle at a coupling of next to nothing is that of the independent axes.
#[test]
fn a_coupling_that_vanishes_changes_nothing() {
    let mut together = coupled(vec![oil(&calibrated()), oil(&calibrated())], &[1e-15]);
    let mut alone = coupled(vec![oil(&calibrated()), oil(&calibrated())], &[]);
    for index in 0..2000 {
        let phase = f64::from(index) * 0.01;
        let inputs = volts([6.0 * phase.sin(), 3.0 * (2.0 * phase).sin()]);
        together.step(&inputs, DT_S);
        alone.step(&inputs, DT_S);
    }
    for axis in 0..2 {
        let (one, two) = (together.motion(axis), alone.motion(axis));
        assert!((one.slave_position_rad - two.slave_position_rad).abs() < 1e-8, "{one:?} {two:?}");
    }
}

/// A coupling that is an effect of one axis, or of both, moves the handle as the declared one does.
#[test]
fn a_coupling_by_an_effect_is_that_of_the_handle() {
    let beside = |names: &[&str]| {
        transmission_kinds::Parameters::from(calibrated()).plant(effects(names)).unwrap()
    };
    let (plain, with_second) = (|| oil(&calibrated()), "handle_coupling=0");
    let mut of_second = effects(&[with_second]);
    of_second[0].set("with_axis_1", 2e-4).unwrap();
    let first = transmission_kinds::Parameters::from(calibrated()).plant(of_second).unwrap();
    let mut declared = coupled(vec![plain(), plain()], &[5e-4]);
    let mut by_both = coupled(vec![first, beside(&["handle_coupling=3e-4"])], &[]);
    // Of the product with itself an axis takes no notice.
    let every = || beside(&["handle_coupling=1e-4"]);
    let mut in_part = coupled(vec![every(), every()], &[4e-4]);
    for index in 0..2000 {
        let phase = f64::from(index) * 0.01;
        let inputs = volts([6.0 * phase.sin(), 3.0 * (2.0 * phase).sin()]);
        for plant in [&mut declared, &mut by_both, &mut in_part] {
            plant.step(&inputs, DT_S);
        }
    }
    for axis in 0..2 {
        let expected = declared.motion(axis).slave_position_rad;
        for plant in [&by_both, &in_part] {
            assert!((plant.motion(axis).slave_position_rad - expected).abs() < 1e-9, "{axis}");
        }
    }
    let alone = Plant::new(vec![every()], &HandleCoupling::none()).unwrap_err();
    assert_eq!(alone, CouplingError::Alone);
}

#[test]
fn mirrored_inputs_give_the_mirrored_movement_and_axes_may_be_swapped() {
    let run = |sign: f64, swapped: bool| {
        let mut plant = coupled(vec![oil(&calibrated()), oil(&calibrated())], &[9e-4]);
        for index in 0..1500 {
            let phase = f64::from(index) * 0.01;
            let mut inputs = volts([sign * 6.0 * phase.sin(), sign * 2.5 * phase.cos()]);
            if swapped {
                inputs.reverse();
            }
            plant.step(&inputs, DT_S);
        }
        [0, 1].map(|axis| plant.motion(axis).slave_position_rad)
    };
    let plain = run(1.0, false);
    assert_eq!(run(-1.0, false), plain.map(|position| -position));
    assert!(plain[0].abs() > 0.05 && plain[1].abs() > 0.05, "{plain:?}");
    // The turns begin with the first axis, so here they agree as far as they are precise.
    let [second, first] = run(1.0, true);
    assert!((first - plain[0]).abs() < 1e-8 && (second - plain[1]).abs() < 1e-8);
}

/// A slave that sticks stands exactly still while the other accelerates beside it, and breaks away
/// when the other's inertial torque is too much for it.
#[test]
fn stick_is_exact_on_every_axis() {
    let strong = hydrostatic::Parameters { slave_static_friction_nm: 2.3, ..calibrated() };
    let run = |coupling: f64| {
        let mut plant = coupled(vec![oil(&strong), oil(&strong)], &[coupling]);
        let mut moved = false;
        for index in 0..600 {
            let phase = f64::from(index) * 0.05;
            // The hand shakes the first handle hard; nothing acts on the second.
            let hand = Input { motor_v: 0.0, hand_torque_nm: 6.0 * phase.sin() };
            plant.step(&[hand, Input::default()], DT_S);
            moved |= plant.motion(1).slave_velocity_rad_s != 0.0;
        }
        assert!(plant.energy().throughput_j > 0.01, "{:?}", plant.energy());
        moved
    };
    let own = strong.slave_inertia_kg_m2();
    assert!(!run(0.05 * own));
    assert!(run(0.79 * own));
}

#[test]
fn second_order_convergence_of_coupled_axes() {
    let parameters = frictionless(calibrated());
    let own = parameters.slave_inertia_kg_m2();
    let path = |step: f64| {
        let mut plant = coupled(
            vec![oil(&parameters), oil(&parameters.clone().with_hose_length(7.0))],
            &[0.6 * own],
        );
        assert!(step <= plant.longest_step_s(), "{step} {}", plant.longest_step_s());
        let count = (1e-3 / step).round() as usize;
        (0..200)
            .map(|hold| {
                let phase = 0.02 * f64::from(hold);
                let inputs = [
                    Input { motor_v: 2.0 * phase.sin(), hand_torque_nm: 0.3 * (0.7 * phase).cos() },
                    Input { motor_v: -phase.cos(), hand_torque_nm: 0.0 },
                ];
                for _ in 0..count {
                    plant.step(&inputs, step);
                }
                let [one, two] = [0, 1].map(|axis| plant.motion(axis).slave_position_rad);
                [one, two, plant.motion(0).master_position_rad]
            })
            .collect::<Vec<_>>()
    };
    let errors = observed_errors(1.0e-4, 1.0e-3 / 640.0, path);
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.7..2.4).contains(&order), "order {order} of {errors:?}");
    }
}

/// A handle that is heavier to turn about both axes at once swings at other frequencies: the
/// stiffness is the lines', the inertia `I ± C`.
#[test]
fn sum_and_difference_of_two_equal_axes_move_as_single_axes_of_other_inertia() {
    let parameters = frictionless(calibrated());
    let shared = 8e-4;
    let mut plant = coupled(vec![oil(&parameters), oil(&parameters)], &[shared]);
    for (sign, inertia) in [(1.0, shared), (-1.0, -shared)] {
        let handle = parameters.slave_handle_inertia_kg_m2 + inertia;
        let mut single = oil(&hydrostatic::Parameters {
            slave_handle_inertia_kg_m2: handle,
            ..parameters.clone()
        });
        for index in 0..400 {
            let motor_v = 2.0 * (f64::from(index) * 0.05).sin();
            plant.step(&volts([motor_v, sign * motor_v]), 1e-4);
            single.step(volts([motor_v])[0], 1e-4);
        }
        let (two, one) = (plant.motion(0).slave_position_rad, single.motion().slave_position_rad);
        assert!(one.abs() > 0.01 && (two / one - 1.0).abs() < 1e-3, "{two} against {one}");
        plant = coupled(vec![oil(&parameters), oil(&parameters)], &[shared]);
    }
}

#[test]
fn invalid_couplings_are_refused() {
    let own = calibrated().slave_inertia_kg_m2();
    let axes = || vec![oil(&calibrated()), oil(&calibrated())];
    let refusal = |axes: Vec<transmission_kinds::Plant>, pairs: &[f64]| {
        HandleCoupling::of_pairs(axes.len(), pairs)
            .and_then(|coupling| Plant::new(axes, &coupling))
            .unwrap_err()
    };
    assert!(matches!(refusal(axes(), &[0.81 * own]), CouplingError::TooStrong { .. }));
    assert!(matches!(refusal(axes(), &[-0.81 * own]), CouplingError::TooStrong { .. }));
    assert!(matches!(refusal(axes(), &[f64::NAN]), CouplingError::TooStrong { .. }));
    assert!(matches!(refusal(axes(), &[f64::INFINITY]), CouplingError::TooStrong { .. }));
    assert!(
        refusal(axes(), &[0.81 * own]).to_string().contains("0.190"),
        "{}",
        refusal(axes(), &[0.81 * own])
    );
    assert_eq!(refusal(axes(), &[0.0; 3]), CouplingError::Pairs { axes: 2, expected: 1, found: 3 });
    assert_eq!(refusal(Vec::new(), &[]), CouplingError::Axes { found: 0 });
    assert_eq!(refusal([axes(), axes()].concat(), &[]), CouplingError::Axes { found: 4 });
    // Each pair may be as strong, and all together too strong.
    let three = || vec![oil(&calibrated()), oil(&calibrated()), oil(&calibrated())];
    assert!(matches!(refusal(three(), &[-0.5 * own; 3]), CouplingError::TooStrong { .. }));
    assert!(Plant::new(three(), &HandleCoupling::of_pairs(3, &[0.5 * own; 3]).unwrap()).is_ok());
    // Inertia that an effect adds to the slave makes room for more.
    let heavier = transmission_kinds::Parameters::from(calibrated())
        .plant(effects(&["extra_inertia@slave=0.01"]))
        .unwrap();
    assert!(
        Plant::new(
            vec![heavier, oil(&calibrated())],
            &HandleCoupling::of_pairs(2, &[0.9 * own]).unwrap()
        )
        .is_ok()
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    /// Energy balances with any handle that is allowed, with and without friction, and friction
    /// only takes.
    #[test]
    fn balance_closes(
        pairs in prop::array::uniform3(-1.0_f64..1.0),
        softness in 0.0_f64..3.0,
        frictions in prop::array::uniform3(0.0_f64..3.0),
        motor_friction in 0.0_f64..1.5,
        levels in prop::collection::vec(prop::array::uniform6(-3.0_f64..3.0), 10..30),
    ) {
        let axis = |friction: f64| hydrostatic::Parameters {
            line_stiffness_factor: (-softness).exp(),
            slave_static_friction_nm: friction,
            slave_kinetic_friction_nm: (friction - 1.2).max(0.0),
            motor_coulomb_nm: motor_friction,
            ..calibrated()
        };
        let inertia = frictions.map(|friction| axis(friction).slave_inertia_kg_m2());
        let scaled = pairs.map(|pair| pair * inertia[0]);
        let coupling = HandleCoupling::of_pairs(3, &scaled).unwrap();
        let least = coupling.least_eigenvalue(&inertia);
        // Too strong a handle is made as weak as it must be: the matrix shrinks toward no coupling.
        let share = if least < LEAST_EIGENVALUE {
            0.999 * (1.0 - LEAST_EIGENVALUE) / (1.0 - least)
        } else {
            1.0
        };
        let axes = frictions.map(|friction| oil(&axis(friction))).to_vec();
        let mut plant = coupled(axes, &scaled.map(|pair| share * pair));
        let mut last_dissipated = 0.0;
        for level in levels {
            let input = |at: usize| Input {
                motor_v: 2.0 * level[at],
                hand_torque_nm: level[3 + at],
            };
            let inputs = [0, 1, 2].map(input);
            for _ in 0..60 {
                plant.step(&inputs, DT_S);
                let energy = plant.energy();
                let least = last_dissipated - 1e-9 * energy.throughput_j;
                prop_assert!(energy.dissipated_j >= least, "friction gives energy");
                last_dissipated = energy.dissipated_j;
            }
        }
        let energy = plant.energy();
        let open = energy.defect_j();
        prop_assert!(open.abs() <= 1e-3 * energy.throughput_j, "open {open} J of {energy:?}");
    }

    /// Left alone the stored energy only falls, at the strongest coupling as well.
    #[test]
    fn stored_energy_only_falls_without_input(
        motor_v in prop::array::uniform2(-5.0_f64..5.0),
        sign in prop::bool::ANY,
    ) {
        let coupling = if sign { 0.8 } else { -0.8 } * calibrated().slave_inertia_kg_m2() * 0.999;
        let mut plant = coupled(vec![oil(&calibrated()), oil(&calibrated())], &[coupling]);
        for _ in 0..600 {
            plant.step(&volts(motor_v), DT_S);
        }
        let start = plant.energy().stored_j;
        let mut last = start;
        for _ in 0..2000 {
            plant.step(&[], DT_S);
            let stored = plant.energy().stored_j;
            prop_assert!(stored <= last + 2e-3 * start.max(1e-6), "{last} {stored} of {start}");
            last = stored;
        }
    }
}
