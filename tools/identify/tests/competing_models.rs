//! Machines with something that no list contains, and machines that imitate it: names are given
//! only where the model with them describes the records.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod one_channel;

use std::f64::consts::TAU;

use identify::input::Series;
use identify::outcome::{Outcome, Verdict};
use one_channel::{Noise, ids, parameter, rig, run, series};

/// What the machine has beside mass, damping and offset.
#[derive(Clone, Copy)]
struct Truth {
    /// Coulomb friction (N).
    coulomb: f64,
    /// Stiffness about the centre (N/m).
    spring: f64,
    /// Stiffness beyond 0.02 m, on one side only (N/m).
    contact: f64,
    /// Limit of the amplifier (N); the record holds the command.
    limit: f64,
}

const PLAIN: Truth = Truth { coulomb: 0.0, spring: 0.0, contact: 0.0, limit: f64::INFINITY };
const MASS: f64 = 90.0;
const VISCOUS: f64 = 210.0;

/// A carriage under position control, 500 Hz, 16 s, by semi-implicit Euler steps of 50 µs; dry
/// friction as an impulse that stops the mass exactly, force with 1 N of noise.
fn record(truth: Truth, seed: u64) -> Series {
    let mut noise = Noise(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let phase: Vec<f64> = (0..4).map(|_| TAU * noise.uniform()).collect();
    let reference = |t: f64| -> f64 {
        let waves = [(0.31, 0.05), (0.83, 0.02), (2.1, 0.004), (4.3, 0.001)];
        let wave = |(k, (f, a)): (usize, &(f64, f64))| {
            a * ((TAU * f * t + phase[k]).sin() - phase[k].sin())
        };
        waves.iter().enumerate().map(wave).sum()
    };
    let h = 5e-5;
    let (mut x, mut v) = (0.0f64, 0.0f64);
    let (mut time, mut position, mut forces) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..320_000 {
        let t = f64::from(i) * h;
        let speed = (reference(t + 1e-4) - reference(t - 1e-4)) / 2e-4;
        let command = 3e4 * (reference(t) - x) + 3e3 * (speed - v);
        if i % 40 == 0 {
            time.push(t);
            position.push((x / 1e-7).round() * 1e-7);
            forces.push(command + noise.normal());
        }
        let force = command.clamp(-truth.limit, truth.limit);
        let line = truth.spring * x + truth.contact * (x - 0.02).max(0.0);
        let free = v + h / MASS * (force - VISCOUS * v - line);
        v = free.signum() * (free.abs() - h * truth.coulomb / MASS).max(0.0);
        x += h * v;
    }
    series(
        &format!("machine-{seed}.csv"),
        [("t_s", time), ("position_m", position), ("force_n", forces)],
    )
}

fn identify(truth: Truth, records: u64) -> Outcome {
    let parameters = vec![
        parameter("mass_kg", 95.0, 0.25, None),
        parameter("viscous_friction_n_s_per_m", 200.0, 1.0, None),
        parameter("force_offset_n", 0.0, 0.0, Some(10.0)),
    ];
    let records: Vec<Series> = (1..=records).map(|seed| record(truth, seed)).collect();
    run(&rig(rig::ModelKind::Drive, parameters), &records).unwrap()
}

/// The verdict is that something depends on position, and friction is named only where it is.
fn depends_on_position(outcome: &Outcome, friction: bool) {
    let found = (ids(outcome), &outcome.verdict, &outcome.unlisted);
    assert_eq!(outcome.verdict, Verdict::Unlisted, "{found:?} {:#?}", outcome.candidates);
    assert!(outcome.unlisted.as_ref().unwrap().depends_on.starts_with("position"), "{found:?}");
    let expected: &[&str] = if friction { &["coulomb_friction"] } else { &[] };
    assert_eq!(ids(outcome), expected, "{:#?}", outcome.candidates);
    let error = outcome.error.values().next().unwrap();
    assert!(error.after < 0.5 * error.before, "{error:?}");
}

/// What the function of position looks like.
fn looks_like(outcome: &Outcome, words: &str) {
    let resembles = outcome.unlisted.as_ref().and_then(|unlisted| unlisted.resembles.as_deref());
    assert!(resembles.is_some_and(|own| own.starts_with(words)), "{resembles:?}, not {words}");
}

#[test]
fn an_undeclared_spring_is_a_function_of_position() {
    for records in [1, 3] {
        let outcome = identify(Truth { spring: 4e3, ..PLAIN }, records);
        depends_on_position(&outcome, false);
        looks_like(&outcome, "like a spring of ");
        let rough = Truth { spring: 4e3, coulomb: 40.0, ..PLAIN };
        depends_on_position(&identify(rough, records), true);
    }
}

#[test]
fn a_contact_on_one_side_is_a_function_of_position() {
    let outcome = identify(Truth { contact: 2e4, ..PLAIN }, 3);
    depends_on_position(&outcome, false);
    looks_like(&outcome, "like a wall or foam of ");
}

#[test]
fn an_amplifier_that_clips_is_named() {
    for records in [1, 3] {
        // A tenth of the rows are beyond the limit.
        let outcome = identify(Truth { limit: 150.0, ..PLAIN }, records);
        assert_eq!(ids(&outcome), ["amplifier_saturation"], "{:#?}", outcome.candidates);
        let (limit, _) = one_channel::effect(&outcome, "limit");
        assert!((limit - 150.0).abs() < 5.0, "{limit}");
    }
}

#[test]
fn correlated_noise_is_no_effect_and_no_adequate_model() {
    let mut record = record(PLAIN, 3);
    let mut noise = Noise(17);
    let (time, force) = (record.columns[0].1.clone(), &mut record.columns[2].1);
    let rms = (force.iter().map(|f| f * f).sum::<f64>() / time.len() as f64).sqrt();
    // First-order, 3 Hz: half the force's root mean square, independent of the movement.
    let (mut state, kept) = (0.0, (-TAU * 3.0 * 2e-3_f64).exp());
    for value in force.iter_mut() {
        state = kept * state + (1.0 - kept * kept).sqrt() * 0.5 * rms * noise.normal();
        *value += state;
    }
    let parameters = vec![
        parameter("mass_kg", 95.0, 0.25, None),
        parameter("viscous_friction_n_s_per_m", 200.0, 1.0, None),
        parameter("force_offset_n", 0.0, 0.0, Some(10.0)),
    ];
    let outcome = run(&rig(rig::ModelKind::Drive, parameters), &[record]).unwrap();
    assert_eq!(outcome.verdict, Verdict::Inadequate, "{:?}", ids(&outcome));
    assert!(outcome.effects.is_empty() && outcome.remains);
}
