//! Iterative learning: contraction on a plant with a closed form, symmetry, refusals, and what is
//! kept on disk.
#![allow(clippy::unwrap_used)]

use std::f64::consts::TAU;

use files::FormatError;
use learning::store::{LearntReference, ReferenceScope, StoreError};
use learning::{
    BlockOutcome, Complex, Frozen, Learner, LearnerConfig, LearningError, LearningLaw, ModelBased,
    Published, Response, Stop,
};
use proptest::prelude::*;

const STEPS: usize = 500;
const RATE_HZ: u32 = 500;
/// 30 ms at 500 Hz.
const DELAY: usize = 15;

fn scope(rig: u64, axis: u32, rate_hz: u32, steps: usize) -> ReferenceScope {
    ReferenceScope {
        rig,
        rig_name: "bench".to_owned(),
        axis,
        rate_hz,
        period_s: steps as f64 / f64::from(rate_hz),
        amplitude: 0.5,
        centre: 0.0,
        feedforward: true,
    }
}

fn sine(amplitude: f64, harmonic: usize, step: usize) -> f64 {
    amplitude * (TAU * (harmonic * step % STEPS) as f64 / STEPS as f64).sin()
}

fn desired() -> Vec<f64> {
    (0..STEPS).map(|step| sine(0.5, 1, step)).collect()
}

fn config(law: LearningLaw) -> LearnerConfig {
    LearnerConfig {
        rate_hz: f64::from(RATE_HZ),
        cycles_per_block: 2,
        settling_cycles: 1,
        law,
        stop: Stop { growth: 1.2, patience: 3 },
        position_limits: (-2.0, 2.0),
        speed_limit: 30.0,
    }
}

fn published(gamma_p: f64, gamma_d: f64) -> LearningLaw {
    LearningLaw::Published(Published { gamma_p, gamma_d, cutoff_hz: 20.0, delay_s: 0.03 })
}

/// One block on a plant; its report's step, and the error of the settled cycle (rad).
fn block(learner: &mut Learner, plant: impl Fn(&[f64], usize) -> f64) -> (BlockOutcome, f64) {
    let reference = learner.reference().to_vec();
    for step in 0..learner.steps_per_block() {
        learner.record(step, plant(&reference, step % STEPS));
    }
    let report = learner.finish_block();
    (report.outcome, report.settled.unwrap())
}

/// A gain behind a delay, both linear.
fn delayed(gain: f64) -> impl Fn(&[f64], usize) -> f64 {
    move |reference, step| gain * reference[(step + STEPS - DELAY) % STEPS]
}

/// Eq. 4.3.11 to the letter: `e_k = (1 - (γp + γd) g w) e_{k-1} + γd g w e_{k-2}` on the harmonic
/// of the movement.
#[test]
fn the_error_follows_the_recursion_of_the_proof() {
    let (gain, gamma_p, gamma_d) = (0.8, 0.3, 0.05);
    let mut learner = Learner::new(&desired(), config(published(gamma_p, gamma_d))).unwrap();
    let weight = gain / (1.0 + (1.0 / 20.0f64).powi(4));
    let errors: Vec<f64> = (0..30).map(|_| block(&mut learner, delayed(gain)).1).collect();
    // The first difference has no block before it.
    let mut expected = vec![errors[0], errors[0] * (1.0 - gamma_p * weight)];
    for k in 2..30 {
        expected.push(
            (1.0 - (gamma_p + gamma_d) * weight) * expected[k - 1]
                + gamma_d * weight * expected[k - 2],
        );
    }
    for (error, expected) in errors.iter().zip(&expected) {
        assert!((error - expected).abs() < 1e-9, "{error}, expected {expected}");
    }
    assert!(errors[29] < 1e-3 * errors[0]);
}

/// A contraction is what eq. 4.3.12 needs: with `(γp + γd) g` above 2 the matrix is negative
/// definite, and the error grows.
#[test]
fn a_negative_definite_matrix_is_no_convergence() {
    let mut learner = Learner::new(&desired(), config(published(1.0, 0.0))).unwrap();
    let first = block(&mut learner, delayed(3.0)).1;
    let second = block(&mut learner, delayed(3.0)).1;
    assert!(second > 1.9 * first, "{first}, then {second}");
    let mut learner = Learner::new(&desired(), config(published(0.3, 0.0))).unwrap();
    let errors: Vec<f64> = (0..20).map(|_| block(&mut learner, delayed(3.0)).1).collect();
    assert!(errors.windows(2).all(|pair| pair[1] < pair[0] || pair[0] < 1e-9), "{errors:?}");
}

#[test]
fn learning_ends_at_the_best_reference_when_the_error_grows() {
    let mut learner = Learner::new(&desired(), config(published(0.6, 0.0))).unwrap();
    block(&mut learner, delayed(1.0));
    let best = learner.reference().to_vec();
    let (_, error) = block(&mut learner, delayed(1.0));
    // From now on the plant does as it likes.
    let steps: Vec<BlockOutcome> = (1..=3)
        .map(|k| block(&mut learner, |_, step| sine(-0.1 * f64::from(k), 1, step)).0)
        .collect();
    assert!(matches!(steps[..2], [BlockOutcome::Learnt, BlockOutcome::Learnt]), "{steps:?}");
    let BlockOutcome::Frozen(Frozen::Grew { best: least, found }) = steps[2] else {
        panic!("{steps:?}")
    };
    assert!(least == error && found > 0.5, "{steps:?}");
    assert_eq!(learner.reference(), best);
    block(&mut learner, delayed(1.0));
    assert_eq!(learner.reference(), best, "frozen stays frozen");
}

#[test]
fn a_reference_beyond_the_limits_is_never_used() {
    let config = LearnerConfig { position_limits: (-0.55, 0.55), ..config(published(0.5, 0.0)) };
    let mut learner = Learner::new(&desired(), config).unwrap();
    for _ in 0..10 {
        block(&mut learner, delayed(0.5));
        assert!(learner.reference().iter().all(|position| position.abs() <= 0.55));
    }
    assert!(matches!(learner.frozen(), Some(Frozen::Limit { position, .. }) if position > 0.55));
}

#[test]
fn the_inverse_of_the_true_response_needs_one_block() {
    let mut response = Response::default();
    for harmonic in 1..=3 {
        let lag = TAU * (harmonic * DELAY) as f64 / STEPS as f64;
        response.set(harmonic, Complex::from(1.0), Complex::from_polar(0.8, -lag), 1e-3);
    }
    let law = ModelBased { response, gain: 1.0, regularisation: 1e-6 };
    let mut learner = Learner::new(&desired(), config(LearningLaw::ModelBased(law))).unwrap();
    block(&mut learner, delayed(0.8));
    let (_, error) = block(&mut learner, delayed(0.8));
    assert!(error < 1e-9, "{error}");
}

#[test]
fn where_the_response_is_unknown_nothing_is_learnt() {
    let mut response = Response::default();
    response.set(1, Complex::from(1.0), Complex::from(0.8), 1e-3);
    response.set(3, Complex::from(1.0), Complex::from(1e-4), 1e-3);
    assert_eq!((response.known(), response.at(3)), (1, None));
    let law = ModelBased { response, gain: 1.0, regularisation: 1e-6 };
    let mut learner =
        Learner::new(&desired(), config(LearningLaw::ModelBased(law.clone()))).unwrap();
    block(&mut learner, |reference, step| 0.8 * reference[step] + sine(0.1, 3, step));
    for (step, position) in learner.reference().iter().enumerate() {
        assert!((position - sine(0.5 / 0.8, 1, step)).abs() < 1e-6);
    }
    let law = ModelBased { response: Response::default(), ..law };
    let refused = Learner::new(&desired(), config(LearningLaw::ModelBased(law))).unwrap_err();
    assert!(matches!(refused, LearningError::Setting { name: "response", .. }), "{refused}");
}

#[test]
fn velocity_and_acceleration_belong_to_the_reference() {
    let learner = Learner::new(&desired(), config(published(0.1, 0.0))).unwrap();
    for step in 0..2 * STEPS {
        let (angle, point) = (TAU * step as f64 / STEPS as f64, learner.aim(step));
        assert!((point.position - 0.5 * angle.sin()).abs() < 1e-12);
        assert!((point.velocity - 0.5 * TAU * angle.cos()).abs() < 1e-9);
        assert!((point.acceleration + 0.5 * TAU * TAU * angle.sin()).abs() < 1e-7);
    }
    assert!((learner.peak_speed() - 0.5 * TAU).abs() < 1e-9);
}

#[test]
fn settings_out_of_range_are_refused() {
    let refused = |config: LearnerConfig| Learner::new(&desired(), config).unwrap_err();
    let good = config(published(0.1, 0.01));
    for bad in [
        LearnerConfig { rate_hz: 0.0, ..good.clone() },
        LearnerConfig { speed_limit: f64::NAN, ..good.clone() },
        LearnerConfig { settling_cycles: 2, ..good.clone() },
        LearnerConfig { stop: Stop { growth: 1.0, patience: 3 }, ..good.clone() },
        LearnerConfig { stop: Stop { growth: 1.2, patience: 0 }, ..good.clone() },
        LearnerConfig { law: published(-0.1, 0.0), ..good.clone() },
        LearnerConfig { law: published(0.1, f64::NAN), ..good.clone() },
    ] {
        assert!(matches!(refused(bad), LearningError::Setting { .. }));
    }
    assert!(matches!(
        refused(LearnerConfig { position_limits: (-0.4, 0.4), ..good.clone() }),
        LearningError::Desired { .. }
    ));
    assert!(matches!(
        refused(LearnerConfig { speed_limit: 1.0, ..good.clone() }),
        LearningError::Desired { .. }
    ));
    assert!(matches!(Learner::new(&[0.0; 3], good.clone()), Err(LearningError::Desired { .. })));
    assert!(matches!(Learner::new(&[f64::NAN; 99], good), Err(LearningError::Desired { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn mirrored_measurements_give_a_mirrored_reference(
        gain in 0.3..1.2f64, disturbance in -0.1..0.1f64, harmonic in 1usize..6,
    ) {
        let mirrored: Vec<f64> = desired().iter().map(|position| -position).collect();
        let mut one = Learner::new(&desired(), config(published(0.3, 0.05))).unwrap();
        let mut other = Learner::new(&mirrored, config(published(0.3, 0.05))).unwrap();
        for _ in 0..4 {
            let disturbance = |step| sine(disturbance, harmonic, step);
            block(&mut one, |reference, step| gain * reference[step] + disturbance(step));
            block(&mut other, |reference, step| gain * reference[step] - disturbance(step));
        }
        for (one, other) in one.reference().iter().zip(other.reference()) {
            prop_assert!((one + other).abs() < 1e-12);
        }
    }

    /// Whatever the sensor says, the reference stays finite and within the limits; steps without a
    /// value are not learnt from.
    #[test]
    fn what_is_no_number_never_enters_the_reference(
        bad in prop::collection::vec((0usize..2 * STEPS, prop_oneof![
            Just(f64::NAN),
            Just(f64::INFINITY),
            Just(f64::NEG_INFINITY),
            Just(1e300),
            Just(f64::MAX),
        ]), 1..40),
    ) {
        let mut learner = Learner::new(&desired(), config(published(0.3, 0.05))).unwrap();
        for _ in 0..3 {
            let reference = learner.reference().to_vec();
            for step in 0..learner.steps_per_block() {
                let value = bad.iter().find(|(at, _)| *at == step).map(|(_, value)| *value);
                learner.record(step, value.unwrap_or(0.8 * reference[step % STEPS]));
            }
            let report = learner.finish_block();
            let lost = bad.iter().any(|(at, value)| {
                let first = bad.iter().find(|(other, _)| other == at);
                *at >= STEPS
                    && !value.is_finite()
                    && first.is_some_and(|(_, first)| !first.is_finite())
            });
            if lost && learner.frozen().is_none() {
                let missing = matches!(report.outcome, BlockOutcome::Missing(1..));
                prop_assert!(missing, "{:?}", report.outcome);
                prop_assert_eq!(learner.reference(), &reference[..]);
            }
            for step in 0..STEPS {
                let point = learner.aim(step);
                prop_assert!(point.position.abs() <= 2.0);
                prop_assert!(point.velocity.is_finite() && point.acceleration.is_finite());
            }
        }
    }

    #[test]
    fn what_was_saved_is_loaded_and_what_is_damaged_is_not(
        positions in prop::collection::vec(-2.0..2.0f64, 8..200),
        rig: u64, axis in 0u32..3, at in 0usize..4000, bit in 0u8..8, cut in 1usize..4000,
    ) {
        let scope = scope(rig, axis, RATE_HZ, positions.len());
        let reference = LearntReference::new(&scope, 0.02, positions).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sine.learnt");
        reference.save(&path).unwrap();
        prop_assert_eq!(&LearntReference::load(&path, &scope).unwrap(), &reference);
        let refused = |scope: ReferenceScope| LearntReference::load(&path, &scope).unwrap_err();
        let differs = |error, expected: &str| {
            matches!(error, StoreError::OtherScope { scope, .. } if scope == expected)
        };
        let other = refused(ReferenceScope { rig: rig ^ 1, ..scope.clone() });
        let other_rig = differs(other, "on another rig");
        let other = refused(ReferenceScope { axis: axis + 1, ..scope.clone() });
        let other_axis = differs(other, "for another axis");
        let other = refused(ReferenceScope { rate_hz: 1000, ..scope.clone() });
        let other_rate = differs(other, "at another rate");
        let other_movement = [
            ReferenceScope { amplitude: 0.4, ..scope.clone() },
            ReferenceScope { centre: 0.1, ..scope.clone() },
            ReferenceScope { feedforward: false, ..scope.clone() },
            ReferenceScope { period_s: scope.period_s + 0.002, ..scope.clone() },
        ];
        prop_assert!(other_rig && other_axis && other_rate);
        for other in other_movement {
            prop_assert!(differs(refused(other), "for another movement"));
        }
        let bytes = std::fs::read(&path).unwrap();
        let mut damaged = bytes.clone();
        damaged[at % bytes.len()] ^= 1 << bit;
        prop_assert!(LearntReference::decode(&damaged).is_err());
        let kept = bytes.len() - cut.min(bytes.len());
        prop_assert!(LearntReference::decode(&bytes[..kept]).is_err());
        // A save that cannot be leaves the older file alone, and nothing beside it.
        let broken = LearntReference { positions: vec![f64::NAN], ..reference };
        let refused = matches!(broken.save(&path).unwrap_err(), StoreError::Positions { .. });
        prop_assert!(refused);
        prop_assert_eq!(std::fs::read(&path).unwrap(), bytes);
        prop_assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

#[test]
fn files_of_others_are_refused_with_a_reason() {
    let error = LearntReference::decode(b"FRPS and more that is long enough").unwrap_err();
    assert!(
        matches!(
            &error,
            StoreError::Format(FormatError::Mark { found, .. }) if found == "\"FRPS\""
        ),
        "{error}"
    );
    let mut bytes = LearntReference::new(&scope(1, 0, 500, 500), 0.0, vec![0.0; 500])
        .unwrap()
        .encode()
        .unwrap();
    bytes[4] = 9;
    assert!(matches!(
        LearntReference::decode(&bytes).unwrap_err(),
        StoreError::Format(FormatError::Version { found: 9, .. })
    ));
    let missing = LearntReference::load("/nowhere/at/all", &scope(1, 0, 500, 500)).unwrap_err();
    assert!(missing.to_string().contains("/nowhere/at/all"), "{missing}");
    assert!(LearntReference::new(&scope(1, 0, 0, 5), 0.0, vec![0.0; 5]).is_err());
}

/// What one process kept, another goes on from: reference, best block, and the error that the
/// published law compares with.
#[test]
fn a_learner_goes_on_from_what_another_knew() {
    let mut response = Response::default();
    response.set(1, Complex::from(1.0), Complex::from(0.5), 1e-3);
    let model_based = ModelBased {
        response: Response::from_parts(&response.parts()),
        gain: 0.5,
        regularisation: 0.1,
    };
    for law in [published(0.2, 0.1), LearningLaw::ModelBased(model_based)] {
        let mut whole = Learner::new(&desired(), config(law.clone())).unwrap();
        let mut first = Learner::new(&desired(), config(law.clone())).unwrap();
        for _ in 0..4 {
            block(&mut whole, delayed(0.8));
            block(&mut first, delayed(0.8));
        }
        let memory = first.state();
        let mut second = Learner::restore(&desired(), memory.clone(), config(law.clone())).unwrap();
        for _ in 0..4 {
            assert_eq!(block(&mut whole, delayed(0.8)).1, block(&mut second, delayed(0.8)).1);
        }
        assert_eq!(whole.state(), second.state());
        let broken = [
            learning::LearnerState { reference: vec![0.0; 9], ..memory.clone() },
            learning::LearnerState { reference: vec![f64::NAN; STEPS], ..memory.clone() },
            learning::LearnerState { best: Some((0.1, vec![0.0; 9])), ..memory.clone() },
            learning::LearnerState { previous_error: Some(vec![f64::INFINITY; STEPS]), ..memory },
        ];
        for memory in broken {
            assert!(Learner::restore(&desired(), memory, config(law.clone())).is_err());
        }
    }
}
