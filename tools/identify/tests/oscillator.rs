//! Oscillators made by an integrator of the test's own, at 16 steps a sample and with the input as
//! a closed form.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod one_channel;

use identify::outcome::{Outcome, Verdict};
use one_channel::{Noise, close, ids, measured, parameter, rig, run, series, shipped};
use rig::ModelKind::Oscillator;

const MASS: f64 = 5.3e-6;
const DAMPING: f64 = 3e-4;
const STIFFNESS: f64 = 1.05;
const OFFSET: f64 = 0.002;

/// What the test's machine has beyond mass, damper, spring and offset, as a force against the
/// input.
type Extra<'a> = &'a dyn Fn(f64, f64, f64) -> f64;

/// 14 s at 600 Hz; the input is forty sines of random phase up to 150 Hz, 40 mV rms, the output has
/// 0.1 mV of noise.
fn record(
    seed: u64,
    shape_input: &dyn Fn(f64) -> f64,
    extra: Extra<'_>,
) -> identify::input::Series {
    let mut noise = Noise(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let tau = std::f64::consts::TAU;
    let waves: Vec<(f64, f64)> = (0..40)
        .map(|k| (tau * (1.3 + 3.7 * f64::from(k) + 0.5 * noise.uniform()), tau * noise.uniform()))
        .collect();
    let size = 0.04 * (2.0f64 / 40.0).sqrt();
    let input = |t: f64| waves.iter().map(|(w, p)| size * (w * t + p).sin()).sum::<f64>();
    let (sampling, fine) = (600.0, 16);
    let h = 1.0 / sampling / f64::from(fine);
    let rate = |t: f64, u: f64, y: f64, v: f64| {
        (v, (shape_input(u) - DAMPING * v - STIFFNESS * y - OFFSET - extra(t, y, v)) / MASS)
    };
    let (mut y, mut v) = (0.0, 0.0);
    let (mut time, mut inputs, mut outputs) = (Vec::new(), Vec::new(), Vec::new());
    let mut u = input(0.0);
    for i in 0..8400 * fine {
        let t = f64::from(i) * h;
        if i % fine == 0 {
            time.push(t);
            inputs.push(u);
            outputs.push(y + 1e-4 * noise.normal());
        }
        // Heun's method with a correction by the midpoint: third order (Kutta), unlike the code
        // under test.
        let (middle, end) = (input(t + 0.5 * h), input(t + h));
        let k1 = rate(t, u, y, v);
        let k2 = rate(t + 0.5 * h, middle, y + 0.5 * h * k1.0, v + 0.5 * h * k1.1);
        let k3 = rate(t + h, end, y + h * (2.0 * k2.0 - k1.0), v + h * (2.0 * k2.1 - k1.1));
        y += h / 6.0 * (k1.0 + 4.0 * k2.0 + k3.0);
        v += h / 6.0 * (k1.1 + 4.0 * k2.1 + k3.1);
        u = end;
    }
    series(&format!("circuit-{seed}.csv"), [("t_s", time), ("input", inputs), ("output", outputs)])
}

fn declared() -> rig::Model {
    rig(
        Oscillator,
        vec![
            parameter("mass_s2", 5e-6, 0.25, None),
            parameter("damping_s", 2.5e-4, 0.5, None),
            parameter("stiffness", 1.0, 0.25, None),
            parameter("input_offset_v", 0.0, 0.0, Some(0.02)),
        ],
    )
}

fn identify(seed: u64, extra: Extra<'_>) -> Outcome {
    run(&declared(), &[record(seed, &|u| u, extra)]).unwrap()
}

/// The effect is the only one, and the error that is left is about the noise of 0.1 mV.
fn only(outcome: &Outcome, id: &str) {
    one_channel::only(outcome, id, ("output", 1.2e-4));
}

#[test]
fn nothing_is_found_where_nothing_is_missing() {
    for seed in 1..=6 {
        let outcome = identify(seed, &|_, _, _| 0.0);
        assert_eq!(
            outcome.verdict,
            Verdict::None,
            "seed {seed}: {:?} {:?}",
            ids(&outcome),
            outcome.unlisted
        );
        let error = &outcome.error["output"];
        assert!(error.after < 1.1e-4, "the noise is 0.1 mV: {error:?}");
        for (p, truth) in outcome.parameters.iter().zip([MASS, DAMPING, STIFFNESS, OFFSET]) {
            let std = p.std.unwrap();
            assert!(
                (p.fitted - truth).abs() < 4.5 * std && std < 0.02 * truth,
                "{p:?}, true {truth}"
            );
        }
    }
}

#[test]
fn beside_dry_friction_of_another_smoothing_the_spring_alone_is_named() {
    let mut model = declared();
    model.parameters.push(parameter("coulomb_friction_v", 0.007, 0.5, None));
    let friction = |v: f64| 0.006 * std::f64::consts::FRAC_2_PI * (v / 0.8).atan();
    for seed in [11, 12] {
        let record = record(seed, &|u| u, &|_, y, v| 4.0 * y.powi(3) + friction(v));
        let outcome = run(&model, &[record]).unwrap();
        // An arctangent is no hyperbolic tangent: 0.4 mV remain of 8.
        one_channel::only(&outcome, "nonlinear_stiffness", ("output", 5e-4));
    }
}

#[test]
fn a_cubic_and_a_quadratic_spring_are_measured() {
    let outcome = identify(11, &|_, y, _| 4.0 * y.powi(3) + 0.2 * y * y);
    only(&outcome, "nonlinear_stiffness");
    close(&outcome, "cubic", 4.0, 0.03);
    close(&outcome, "quadratic", 0.2, 0.05);
    let error = &outcome.error["output"];
    assert!(error.before > 10.0 * error.after, "{error:?}");
    let models: Vec<&str> = outcome.steps.iter().map(|s| s.model.as_str()).collect();
    assert_eq!(models, ["declared", "nonlinear_stiffness, cubic alone", "nonlinear_stiffness"]);
}

#[test]
fn a_record_of_six_seconds_is_enough_and_one_of_two_is_refused() {
    for seed in 1..=3 {
        let whole = record(seed, &|u| u, &|_, y, _| 4.0 * y.powi(3));
        let first = |seconds: f64| {
            let mut series = whole.clone();
            let rows = (seconds / whole.columns[0].1[1]).round() as usize + 1;
            series.columns.iter_mut().for_each(|column| column.1.truncate(rows));
            series
        };
        let text = run(&declared(), &[first(2.0)]).unwrap_err().to_string();
        assert!(text.contains("12 stretches"), "{text}");
        let series = first(6.0);
        let outcome = run(&declared(), &[series]).unwrap();
        only(&outcome, "nonlinear_stiffness");
        close(&outcome, "cubic", 4.0, 0.05);
    }
}

#[test]
fn drag_is_measured() {
    let outcome = identify(12, &|_, _, v| 1.5e-5 * v * v.abs());
    only(&outcome, "quadratic_drag");
    close(&outcome, "coefficient", 1.5e-5, 0.05);
}

#[test]
fn saturation_is_measured() {
    let series = record(13, &|u| u.clamp(-0.07, 0.07), &|_, _, _| 0.0);
    let outcome = run(&declared(), &[series]).unwrap();
    assert_eq!(ids(&outcome), ["amplifier_saturation"], "{:#?}", outcome.candidates);
    assert_eq!(outcome.effects[0].site, "drive");
    close(&outcome, "limit", 0.07, 0.02);
}

#[test]
fn a_vibration_is_measured() {
    let outcome = identify(14, &|t, _, _| 0.002 * (std::f64::consts::TAU * 31.7 * t).sin());
    only(&outcome, "periodic_disturbance");
    close(&outcome, "frequency", 31.7, 5e-4);
}

#[test]
fn an_unlisted_effect_is_reported_as_unlisted() {
    let outcome = identify(15, &|_, _, v| 0.004 * (v / 6.0).cos());
    assert_eq!(outcome.verdict, Verdict::Unlisted, "{:?} {:#?}", ids(&outcome), outcome.candidates);
    assert_eq!(outcome.unlisted.unwrap().depends_on, "velocity");
}

#[test]
fn unusable_data_are_refused_with_a_reason() {
    let good = record(20, &|u| u, &|_, _, _| 0.0);
    let broken = |change: &dyn Fn(&mut identify::input::Series)| {
        let mut series = good.clone();
        change(&mut series);
        run(&declared(), &[series]).unwrap_err().to_string()
    };
    let scaled = |column: usize, factor: f64| {
        broken(&move |s| s.columns[column].1.iter_mut().for_each(|v| *v *= factor))
    };
    assert!(scaled(2, 1000.0).contains("check the units"), "output in mV");
    assert!(scaled(1, 1000.0).contains("check the units"), "input in mV");
    assert!(scaled(2, -1.0).contains("change the sign"));
    let text = scaled(0, 1000.0);
    assert!(text.contains("samples a second"), "time in ms: {text}");
    let text = broken(&|s| s.columns[1].1.iter_mut().for_each(|v| *v = 0.1));
    assert!(text.contains("input") && text.contains("never changes"), "{text}");
    let text = broken(&|s| s.columns[2].1[41] = f64::NAN);
    assert!(text.contains("row 42") && text.contains("output"), "{text}");
    let text = broken(&|s| s.columns[1].0 = "force".into());
    assert!(text.contains("expected a column input"), "{text}");
    let text = broken(&|s| s.columns.iter_mut().for_each(|c| c.1.truncate(200)));
    assert!(text.contains("200 rows"), "{text}");
}

#[test]
fn the_measured_silverbox_record_has_a_cubic_spring() {
    let Some(mut series) = measured("silverbox_multisine.csv") else { return };
    // A quarter of the record: the whole takes more than a minute, and its figures stand in
    // `docs/identify-measured.md`.
    series.columns.iter_mut().for_each(|column| column.1.truncate(17_000));
    let outcome = run(&shipped("silverbox.toml"), &[series]).unwrap();
    assert_eq!(ids(&outcome)[0], "nonlinear_stiffness", "{:#?}", outcome.candidates);
    let error = &outcome.error["output"];
    let volts = |percent: f64| percent / error.before_percent * error.before;
    for s in &outcome.steps {
        eprintln!(
            "{}: {:.4} mV held back, {:.4} mV fit",
            s.model,
            1e3 * volts(s.report_percent),
            1e3 * volts(s.fit_percent)
        );
    }
    assert!((5e-3..9e-3).contains(&error.before), "{error:?}");
    let cubic = &outcome.steps[1];
    assert_eq!(cubic.model, "nonlinear_stiffness, cubic alone");
    assert!(volts(cubic.report_percent) < 0.6e-3, "{cubic:?}");
    // With the even term of the same effect, before any other.
    let spring = &outcome.steps[2];
    assert_eq!(spring.model, "nonlinear_stiffness");
    assert!(
        volts(spring.report_percent) < 0.35e-3 && error.after < 0.35e-3,
        "{spring:?} {error:?}"
    );
    assert!(outcome.ambiguous_with.is_empty(), "{:?}", outcome.ambiguous_with);
    close(&outcome, "cubic", 3.95, 0.02);
}
