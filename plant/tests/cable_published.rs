//! What chapter 5 measured, against the model with one value fitted: the cables' stiffness in
//! place, by the peak at 8 Hz. All else is predicted, well or badly; the limits below are what was
//! seen.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::close;
use plant::cable::{Parameters, Plant};
use plant::hydrostatic;
use plant::response::{Response, frequency_response};
use plant::transmission::TransmissionParameters;
use plant::transmission::{ImposedMotion, Transmission};
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// The gain is normalised by the mechanical ratio, as in fig. 5.7; the amplitude is the slave's
/// with rigid cables.
fn at(parameters: &Parameters, frequency_hz: f64, slave_deg: f64) -> Response {
    let mut plant = Plant::new(parameters.clone(), Vec::new()).unwrap();
    let ratio = parameters.mechanical_ratio;
    let response = frequency_response(&mut plant, frequency_hz, slave_deg.to_radians() * ratio);
    Response { gain: response.gain * ratio, ..response }
}

/// Peak, its gain, and where the gain falls below 0.707 above it.
fn peak_and_cutoff(
    parameters: &Parameters,
    to_hz: f64,
    step_hz: f64,
    slave_deg: f64,
) -> (f64, f64, f64) {
    let count = ((to_hz - 4.0) / step_hz) as usize;
    let curve: Vec<_> =
        (0..=count).map(|index| at(parameters, 4.0 + step_hz * index as f64, slave_deg)).collect();
    let peak = curve.iter().max_by(|a, b| a.gain.total_cmp(&b.gain)).unwrap();
    let cutoff = curve
        .iter()
        .find(|point| point.frequency_hz > peak.frequency_hz && point.gain < FRAC_1_SQRT_2);
    (peak.frequency_hz, peak.gain, cutoff.map_or(f64::INFINITY, |point| point.frequency_hz))
}

/// Longest time within 1 % of the slave's range, s, at 1 Hz; and the range, rad.
fn plateau(mut plant: impl Transmission, master_rad: f64) -> (f64, f64) {
    let steps = 2000;
    let mut angles = Vec::new();
    for index in 1..=6 * steps {
        let time = f64::from(index) / f64::from(steps);
        let growth = (0.5 * time).min(1.0);
        let (sine, cosine) = (TAU * time).sin_cos();
        let target = ImposedMotion {
            position_rad: growth * master_rad * sine,
            velocity_rad_s: master_rad
                * (growth * TAU * cosine + if time < 2.0 { 0.5 * sine } else { 0.0 }),
        };
        plant.step_imposed(target, 0.0, 1.0 / f64::from(steps));
        if index > 3 * steps {
            angles.push(plant.motion().slave_position_rad);
        }
    }
    let (least, most) =
        angles.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    let (mut longest, mut run, mut level) = (0, 0, f64::NAN);
    for angle in angles {
        if (angle - level).abs() < 0.01 * (most - least) {
            run += 1;
        } else {
            (run, level) = (0, angle);
        }
        longest = longest.max(run);
    }
    (f64::from(longest) / f64::from(steps), most - least)
}

/// § 5.2.2's experiment: a slow sine (0.008 Hz, ±30° of the slave); mean motor torque forward and
/// backward.
fn slow_sine_torque(parameters: &Parameters) -> [f64; 2] {
    let mut plant = Plant::new(parameters.clone(), Vec::new()).unwrap();
    let (amplitude, omega) = (30f64.to_radians() * parameters.mechanical_ratio, TAU * 0.008);
    let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
    let interval = 5e-3;
    for index in 1..=31_250 {
        let (sine, cosine) = (omega * f64::from(index) * interval).sin_cos();
        let target = ImposedMotion {
            position_rad: amplitude * sine,
            velocity_rad_s: amplitude * omega * cosine,
        };
        plant.step_imposed(target, 0.0, interval);
        // One cycle after the start, away from the turns.
        if index > 6250 && sine.abs() < 0.8 {
            let direction = usize::from(cosine < 0.0);
            sums[direction] += plant.state().motor_torque_nm.abs();
            counts[direction] += 1.0;
        }
    }
    [sums[0] / counts[0], sums[1] / counts[1]]
}

fn hydrostatic_plateau(master_deg: f64) -> (f64, f64) {
    let plant = hydrostatic::Plant::new(hydrostatic::Parameters::calibrated(), Vec::new()).unwrap();
    plateau(plant, master_deg.to_radians())
}

fn cable_plateau(parameters: &Parameters, slave_deg: f64) -> (f64, f64) {
    let plant = Plant::new(parameters.clone(), Vec::new()).unwrap();
    plateau(plant, slave_deg.to_radians() * parameters.mechanical_ratio)
}

#[test]
fn fitted_peak_and_predicted_cutoff() {
    let traced = Parameters::calibrated();
    let (peak, gain, cutoff) = peak_and_cutoff(&traced, 17.0, 0.25, 30.0);
    println!("30 deg: peak {peak} Hz (gain {gain}), cut-off {cutoff} Hz; measured 8 and 12");
    assert!((7.75..=8.25).contains(&peak), "fitted: {peak}");
    // Predicted, and too high: measured 12 Hz.
    assert!((14.0..=16.5).contains(&cutoff), "{cutoff}");
    // Fig. 5.7 is flat till after the resonance; the model is not.
    assert!(gain > 3.0, "{gain}");
    for amplitude in [20.0, 40.0] {
        let (peak, gain, cutoff) = peak_and_cutoff(&traced, 17.0, 0.5, amplitude);
        println!("{amplitude} deg: peak {peak} Hz (gain {gain}), cut-off {cutoff} Hz");
        assert!((7.0..=9.5).contains(&peak), "{amplitude}: {peak}");
    }
}

/// § 5.2.3: "the phase lag is similar in both the transmissions".
#[test]
fn predicted_lag_is_similar_to_the_hydrostatic_line() {
    let cable = at(&Parameters::calibrated(), 1.0, 30.0);
    let mut plant =
        hydrostatic::Plant::new(hydrostatic::Parameters::calibrated(), Vec::new()).unwrap();
    let hydrostatic = frequency_response(&mut plant, 1.0, 30f64.to_radians());
    println!("lag {} s, gain {}; hydrostatic {} s", cable.lag_s(), cable.gain, hydrostatic.lag_s());
    close(cable.lag_s(), hydrostatic.lag_s(), 0.25);
}

/// Fig. 5.8: the slave sticks visibly longer with cables, for similar slave movements.
#[test]
fn predicted_plateau_is_longer_than_the_hydrostatic_line_s() {
    let cable = cable_plateau(&Parameters::calibrated(), 30.0);
    let ratio = hydrostatic::Parameters::calibrated().transmission_ratio();
    let same = hydrostatic_plateau(30.0 / ratio);
    let same_master = hydrostatic_plateau(30.0);
    println!(
        "cable {cable:?}, hydrostatic for the same rigid slave {same:?}, \
         at 30 deg of the master {same_master:?}"
    );
    close(cable.1, same.1, 0.1);
    assert!(cable.0 > 1.1 * same.0, "{cable:?} {same:?}");
}

/// The level is declared from § 5.2.2. That the experiment finds it again with stiff cables is a
/// check of the model, not a prediction. With the fitted cables the slave moves in stick-slip, and
/// the mean torque, which § 5.2.2 takes for the static friction, lies a quarter below it.
#[test]
fn slow_sine_and_the_declared_friction() {
    close(Parameters::printed().static_friction_at_motor_nm(), 0.475, 1e-2);
    let [forward, backward] = slow_sine_torque(&Parameters::printed());
    println!("printed: forward {forward} N m, backward {backward} N m; measured 0.5 and 0.45");
    close(forward, 0.5, 0.03);
    close(backward, 0.45, 0.03);
    let [forward, backward] = slow_sine_torque(&Parameters::calibrated());
    println!("traced: forward {forward} N m, backward {backward} N m; measured 0.5 and 0.45");
    for (found, measured) in [(forward, 0.5), (backward, 0.45)] {
        assert!((0.70..0.82).contains(&(found / measured)), "{found} of {measured}");
    }
}

/// The stiffness as printed, with the slave's inertia fitted to 8 Hz in its stead: nothing else
/// comes out.
#[test]
fn a_heavier_slave_would_not_explain_it() {
    let heavy = Parameters { slave_inertia_kg_m2: 0.0405, ..Parameters::printed() };
    let (peak, gain, cutoff) = peak_and_cutoff(&heavy, 12.0, 0.25, 30.0);
    let (lag, sticking) = (at(&heavy, 1.0, 30.0).lag_s(), cable_plateau(&heavy, 30.0).0);
    println!(
        "heavy slave: peak {peak} Hz (gain {gain}), cut-off {cutoff} Hz, lag {lag} s, \
         plateau {sticking} s"
    );
    assert!((7.5..=8.5).contains(&peak), "{peak}");
    let hydrostatic = hydrostatic_plateau(30.0 / 0.854).0;
    assert!(lag < 0.005 && sticking < 0.6 * hydrostatic, "{lag} {sticking} {hydrostatic}");
}

/// As printed (9 m of 3.725e4 N/m): no peak near 8 Hz. As the slope of the 20 cm of fig. 5.4: 0.2/9
/// of it.
#[test]
fn printed_stiffness_belongs_to_a_shorter_piece() {
    let printed = Parameters::printed();
    assert!(at(&printed, 8.0, 30.0).gain < 1.1 && at(&printed, 18.0, 30.0).gain < 1.5);
    // Kevlar 49 has 112 GPa as a fibre; the printed value asks for 427 GPa of a solid section.
    let modulus_pa = |set: &Parameters| {
        let area_m2 = 0.25 * std::f64::consts::PI * set.cable_diameter_m.powi(2);
        set.line_stiffness_n_per_m() / set.cables * set.line_length_m / area_m2
    };
    close(modulus_pa(&printed), 427e9, 1e-2);
    close(modulus_pa(&Parameters::calibrated()), 11.9e9, 1e-2);
    let piece = Parameters { cable_stiffness_factor: 0.2 / 9.0, ..printed };
    close(modulus_pa(&piece), 9.5e9, 1e-2);
    let (peak, _, cutoff) = peak_and_cutoff(&piece, 15.0, 0.25, 30.0);
    let (lag, sticking) = (at(&piece, 1.0, 30.0).lag_s(), cable_plateau(&piece, 30.0).0);
    println!(
        "slope of 20 cm: peak {peak} Hz, cut-off {cutoff} Hz, lag {lag} s, plateau {sticking} s"
    );
    assert!((7.0..=8.0).contains(&peak) && (12.5..=14.5).contains(&cutoff), "{peak} {cutoff}");
    assert!((0.035..0.055).contains(&lag) && (0.2..0.26).contains(&sticking), "{lag} {sticking}");
}

/// Ch. 6: what more cables would do. A prediction; nothing is measured.
#[test]
fn more_cables_raise_the_resonance() {
    let traced = Parameters::calibrated();
    let mut last = 0.0;
    for count in [1.0, 2.0, 4.0] {
        let tight = Parameters { cables: count, ..traced.clone() };
        let shared = Parameters { pretension_n: tight.pretension_n / count, ..tight.clone() };
        let (peak, _, cutoff) = peak_and_cutoff(&tight, 32.0, 1.0, 30.0);
        let (shared_peak, _, shared_cutoff) = peak_and_cutoff(&shared, 26.0, 1.0, 30.0);
        println!(
            "{count} cables: mode {:.1} Hz; peak {peak} Hz, cut-off {cutoff} Hz, \
             friction {:.3} N m, lag {:.1} ms; shared pretension: \
             peak {shared_peak} Hz, cut-off {shared_cutoff} Hz, friction {:.3} N m, lag {:.1} ms",
            tight.modes_rad_s()[1] / TAU,
            tight.static_friction_at_motor_nm(),
            1e3 * at(&tight, 1.0, 30.0).lag_s(),
            shared.static_friction_at_motor_nm(),
            1e3 * at(&shared, 1.0, 30.0).lag_s(),
        );
        assert!(peak > last, "{count}: {peak} {last}");
        assert!(shared.static_friction_at_motor_nm() <= tight.static_friction_at_motor_nm());
        last = peak;
    }
}

/// Arithmetic of `docs/errata.md`.
#[test]
fn weight_is_no_cause_of_slack_and_the_ratio_multiplies_friction() {
    let weight = 1440.0 * 0.7 * 0.25 * std::f64::consts::PI * 1e-6 * 9.81;
    close(weight, 7.77e-3, 1e-2);
    let parameters = Parameters::printed();
    for (set, halves_at) in [(Parameters::printed(), 2.47), (Parameters::calibrated(), 0.75)] {
        let sag = 3.0 * (set.cable_mass_kg_per_m * set.gravity_m_s2).powi(2) * 27.0 / 12.0;
        close((sag * set.line_stiffness_n_per_m()).cbrt(), halves_at, 1e-2);
    }
    // Sag of one span at 60 N.
    close(weight * 9.0 / (8.0 * parameters.pretension_n), 0.146e-3, 1e-2);
    // Friction at the slave: 0.475 N m times 6 against 0.95 N m over 0.854.
    close(0.475 * parameters.mechanical_ratio, 2.85, 1e-3);
    close(0.95 / hydrostatic::Parameters::calibrated().transmission_ratio(), 1.11, 1e-2);
}
