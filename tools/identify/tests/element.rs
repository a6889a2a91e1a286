//! Parts under imposed motion, made by integrators of their own: fine steps, exact motion, no code
//! of the models.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod one_channel;

use identify::outcome::{Outcome, Verdict};
use one_channel::{Noise, close, ids, parameter, rig, run, series};
use rig::ModelKind::Element;

const STIFFNESS: f64 = 2.1e4;
const DAMPING: f64 = 55.0;
const OFFSET: f64 = 1.2;

/// The motion at an instant and what the part has kept of it.
struct Now {
    time: f64,
    position: f64,
    velocity: f64,
    acceleration: f64,
    /// Change of position since the step before.
    step: f64,
    /// Length of the step (s).
    h: f64,
}

/// Force beyond spring, damper and offset.
type Extra<'a> = &'a mut dyn FnMut(&Now) -> f64;

/// 24 s at 500 Hz, followed at 10 kHz; position in counts of 0.1 µm, force with 0.08 N of noise.
/// The motion is a sum of sines with a slow one that covers the travel, and a held step every 6 s.
fn record(seed: u64, stiffness: f64, damping: f64, extra: Extra<'_>) -> identify::input::Series {
    let mut noise = Noise(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let tau = std::f64::consts::TAU;
    let waves: Vec<(f64, f64, f64)> =
        [(0.23, 1.6e-3), (1.1, 6e-4), (4.7, 2e-4), (11.9, 5e-5), (23.0, 2e-5)]
            .map(|(f, a)| (tau * f, a, tau * noise.uniform()))
            .to_vec();
    let motion = |t: f64| {
        let mut m = (0.0, 0.0, 0.0);
        for (w, a, p) in &waves {
            let (s, c) = (w * t + p).sin_cos();
            m = (m.0 + a * s, m.1 + a * w * c, m.2 - a * w * w * s);
        }
        // A smooth step up and down again: half a cosine of 0.2 s.
        let (phase, size) = (t % 6.0, 8e-4);
        let turn = tau / 0.4;
        let (x, v, a) = match phase {
            p if p < 2.0 => (0.0, 0.0, 0.0),
            p if p < 2.2 => {
                let q = turn * (p - 2.0);
                (0.5 - 0.5 * q.cos(), 0.5 * turn * q.sin(), 0.5 * turn * turn * q.cos())
            }
            p if p < 5.0 => (1.0, 0.0, 0.0),
            p if p < 5.2 => {
                let q = turn * (p - 5.0);
                (0.5 + 0.5 * q.cos(), -0.5 * turn * q.sin(), -0.5 * turn * turn * q.cos())
            }
            _ => (0.0, 0.0, 0.0),
        };
        (m.0 + size * x, m.1 + size * v, m.2 + size * a)
    };
    let h = 1e-4;
    let (mut time, mut position, mut force) = (Vec::new(), Vec::new(), Vec::new());
    let mut before = motion(0.0).0;
    for i in 0..240_000 {
        let t = f64::from(i) * h;
        let (x, v, a) = motion(t);
        let now = Now { time: t, position: x, velocity: v, acceleration: a, step: x - before, h };
        before = x;
        let f = stiffness * x + damping * v + OFFSET + extra(&now);
        if i % 20 == 0 {
            time.push(t);
            position.push((x / 1e-7).round() * 1e-7);
            force.push(f + 0.08 * noise.normal());
        }
    }
    series(
        &format!("part-{seed}.csv"),
        [("t_s", time), ("position_m", position), ("force_n", force)],
    )
}

fn declared(stiffness_tolerance: f64, damping_tolerance: f64) -> rig::Model {
    rig(
        Element,
        vec![
            parameter("stiffness_n_per_m", 2e4, stiffness_tolerance, None),
            parameter("viscous_damping_n_s_per_m", 50.0, damping_tolerance, None),
            parameter("force_offset_n", 0.0, 0.0, Some(5.0)),
        ],
    )
}

fn identify(seed: u64, extra: Extra<'_>) -> Outcome {
    run(&declared(0.25, 0.5), &[record(seed, STIFFNESS, DAMPING, extra)]).unwrap()
}

/// The effect is the only one, and the error that is left is about the noise of 0.08 N.
fn only(outcome: &Outcome, id: &str) {
    one_channel::only(outcome, id, ("force_n", 0.085));
}

#[test]
fn nothing_is_found_where_nothing_is_missing() {
    for seed in 1..=12 {
        let outcome = identify(seed, &mut |_| 0.0);
        assert_eq!(
            outcome.verdict,
            Verdict::None,
            "seed {seed}: {:?} {:?}",
            ids(&outcome),
            outcome.unlisted
        );
        assert!(!outcome.remains);
        let stiffness = &outcome.parameters[0];
        assert!((stiffness.fitted / STIFFNESS - 1.0).abs() < 0.003, "{stiffness:?}");
    }
}

#[test]
fn a_cubic_and_a_quadratic_spring_are_measured() {
    let outcome = identify(21, &mut |n| 6e8 * n.position.powi(3) - 4e5 * n.position.powi(2));
    only(&outcome, "nonlinear_stiffness");
    close(&outcome, "cubic", 6e8, 0.02);
    close(&outcome, "quadratic", -4e5, 0.02);
    assert_eq!(outcome.effects[0].site, "line");
}

#[test]
fn a_relaxing_branch_is_measured() {
    let mut stretch = 0.0;
    let outcome = identify(22, &mut |n| {
        stretch += n.step - n.h * stretch / 0.35;
        6e3 * stretch
    });
    only(&outcome, "viscoelastic_line");
    close(&outcome, "branch_stiffness", 6e3, 0.03);
    close(&outcome, "relaxation", 0.35, 0.05);
}

#[test]
fn dry_friction_is_measured() {
    let outcome = identify(23, &mut |n| 1.5 * n.velocity.signum());
    only(&outcome, "coulomb_friction");
    close(&outcome, "coulomb", 1.5, 0.05);
}

/// A part with 8 N of dry friction, 12 s at 500 Hz: sines, or strokes that rest at their upper end
/// for `rest_s`, where the friction keeps 6 N of what it had.
fn with_friction(name: &str, rest_s: f64) -> identify::input::Series {
    let mut noise = Noise(name.len() as u64 * 77 + 5);
    let (mut time, mut position, mut force) = (Vec::new(), Vec::new(), Vec::new());
    let tau = std::f64::consts::TAU;
    // A stroke of one second whose speed and acceleration start and end at zero.
    let stroke = |p: f64| (p - (tau * p).sin() / tau, 1.0 - (tau * p).cos());
    for i in 0..6000 {
        let t = f64::from(i) * 2e-3;
        let (x, v) = match t % (2.0 + rest_s) {
            _ if rest_s == 0.0 => {
                let w = tau * (0.5 + 0.05 * name.len() as f64);
                (3e-3 * (w * t).sin(), 3e-3 * w * (w * t).cos())
            }
            p if p < 1.0 => (3e-3 * stroke(p).0, 3e-3 * stroke(p).1),
            p if p < 1.0 + rest_s => (3e-3, 0.0),
            p => (3e-3 * (1.0 - stroke(p - 1.0 - rest_s).0), -3e-3 * stroke(p - 1.0 - rest_s).1),
        };
        let friction = if v == 0.0 { 6.0 } else { 8.0 * v.signum() };
        time.push(t);
        position.push((x / 1e-7).round() * 1e-7);
        force.push(STIFFNESS * x + DAMPING * v + OFFSET + friction + 0.08 * noise.normal());
    }
    series(name, [("t_s", time), ("position_m", position), ("force_n", force)])
}

#[test]
fn friction_at_rest_is_neither_inertia_nor_a_function_of_one_variable() {
    let records = [("a.csv", 0.0), ("bb.csv", 0.0), ("ccc.csv", 0.2), ("d.csv", 2.0)]
        .into_iter()
        .chain([("eeee.csv", 0.0)])
        .map(|(name, rest_s)| with_friction(name, rest_s));
    let mut model = declared(0.25, 0.5);
    model
        .parameters
        .extend(rig(Element, vec![parameter("coulomb_friction_n", 7.0, 0.5, None)]).parameters);
    let outcome = run(&model, &records.collect::<Vec<_>>()).unwrap();
    assert_eq!(outcome.verdict, Verdict::None, "{:?} {:?}", ids(&outcome), outcome.unlisted);
}

#[test]
fn a_record_of_two_and_a_half_seconds_is_enough() {
    for seed in 1..=4 {
        let cut = |mut series: identify::input::Series| {
            series.columns.iter_mut().for_each(|column| column.1.truncate(1251));
            series
        };
        let short = cut(record(seed, STIFFNESS, DAMPING, &mut |n| 1.5 * n.velocity.signum()));
        let outcome = run(&declared(0.25, 0.5), &[short]).unwrap();
        only(&outcome, "coulomb_friction");
        close(&outcome, "coulomb", 1.5, 0.1);
        let clean = cut(record(seed, STIFFNESS, DAMPING, &mut |_| 0.0));
        let outcome = run(&declared(0.25, 0.5), &[clean]).unwrap();
        assert_eq!(outcome.verdict, Verdict::None, "seed {seed}: {:?}", ids(&outcome));
    }
}

#[test]
fn presliding_is_distinguished_from_dry_friction() {
    let mut bristle = 0.0;
    let outcome = identify(24, &mut |n| {
        bristle += (n.step - n.step.abs() * bristle) / 1.5e-4;
        2.5 * bristle
    });
    only(&outcome, "presliding_hysteresis");
    close(&outcome, "bristle_force", 2.5, 0.05);
    close(&outcome, "travel", 1.5e-4, 0.1);
}

#[test]
fn backlash_is_measured() {
    let outcome = identify(25, &mut |n| -STIFFNESS * (n.position - 2e-4).clamp(-1.5e-4, 1.5e-4));
    only(&outcome, "backlash");
    close(&outcome, "gap", 3e-4, 0.05);
    close(&outcome, "centre", 2e-4, 0.1);
    close(&outcome, "stiffness_lost", STIFFNESS, 0.05);
}

#[test]
fn drag_is_measured() {
    let outcome = identify(26, &mut |n| 2.5e4 * n.velocity * n.velocity.abs());
    only(&outcome, "quadratic_drag");
    close(&outcome, "coefficient", 2.5e4, 0.1);
}

#[test]
fn hum_and_vibration_are_distinguished_by_frequency() {
    let tone = |f: f64| move |n: &Now| 0.4 * (std::f64::consts::TAU * f * n.time + 0.7).sin();
    let outcome = identify(27, &mut tone(50.02));
    only(&outcome, "mains_hum");
    close(&outcome, "frequency", 50.02, 2e-4);
    let outcome = identify(28, &mut tone(17.3));
    only(&outcome, "periodic_disturbance");
    close(&outcome, "frequency", 17.3, 5e-4);
}

#[test]
fn drift_of_the_zero_is_measured() {
    let outcome = identify(29, &mut |n| 0.05 * n.time);
    only(&outcome, "sensor_drift");
    close(&outcome, "rate", 0.05, 0.03);
}

#[test]
fn parameters_outside_their_tolerance_are_effects_and_inside_are_not() {
    let softer = record(30, 1.2e4, DAMPING, &mut |_| 0.0);
    let outcome = run(&declared(0.25, 0.5), std::slice::from_ref(&softer)).unwrap();
    only(&outcome, "line_compliance");
    close(&outcome, "stiffness_beyond_declared", -0.8e4, 0.01);
    assert_eq!(run(&declared(0.5, 0.5), &[softer]).unwrap().verdict, Verdict::None);

    let damped = record(31, STIFFNESS, 160.0, &mut |_| 0.0);
    let outcome = run(&declared(0.25, 0.5), &[damped]).unwrap();
    only(&outcome, "line_damping");
    close(&outcome, "damping_beyond_declared", 110.0, 0.03);

    let outcome = identify(32, &mut |n| 2.0 * n.acceleration);
    only(&outcome, "extra_inertia");
    close(&outcome, "mass_beyond_declared", 2.0, 0.05);
}

#[test]
fn an_unlisted_effect_is_reported_as_unlisted() {
    // A wave along the position, and one along the velocity.
    let outcome = identify(33, &mut |n| 0.5 * (std::f64::consts::TAU * n.position / 9e-4).sin());
    assert_eq!(outcome.verdict, Verdict::Unlisted, "{:?} {:#?}", ids(&outcome), outcome.candidates);
    assert_eq!(outcome.unlisted.unwrap().depends_on, "position");
    let outcome = identify(34, &mut |n| 0.8 * (n.velocity / 1.5e-3).cos());
    assert_eq!(outcome.verdict, Verdict::Unlisted, "{:?} {:#?}", ids(&outcome), outcome.candidates);
    assert_eq!(outcome.unlisted.unwrap().depends_on, "velocity");
}

#[test]
fn unusable_data_are_refused_with_a_reason() {
    let good = record(40, STIFFNESS, DAMPING, &mut |_| 0.0);
    let broken = |change: &dyn Fn(&mut identify::input::Series)| {
        let mut series = good.clone();
        change(&mut series);
        run(&declared(0.25, 0.5), &[series]).unwrap_err().to_string()
    };
    let scaled = |column: usize, factor: f64| {
        broken(&move |s| s.columns[column].1.iter_mut().for_each(|v| *v *= factor))
    };
    assert!(scaled(1, 1000.0).contains("check the units"), "position in mm");
    assert!(scaled(2, 1e-3).contains("check the units"), "force in kN");
    assert!(scaled(2, -1.0).contains("change the sign"));
    let text = broken(&|s| s.columns[2].1.iter_mut().for_each(|v| *v = 0.1));
    assert!(text.contains("force_n") && text.contains("never changes"), "{text}");
    let text = broken(&|s| s.columns[1].1[41] = f64::NAN);
    assert!(text.contains("row 42") && text.contains("position_m"), "{text}");
    let text = broken(&|s| s.columns.iter_mut().for_each(|c| c.1.truncate(400)));
    assert!(text.contains("400 rows"), "{text}");
    let text = run(&rig(Element, vec![parameter("stiffness_n_per_m", 2e4, 0.25, None)]), &[good])
        .unwrap_err()
        .to_string();
    assert!(text.contains("viscous_damping_n_s_per_m") && text.contains("element"), "{text}");
}
