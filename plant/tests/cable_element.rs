//! One piece of cable: figs. 5.3 and 5.4.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::close;
use plant::cable::{Element, ElementLaw, Parameters};

/// Work over a ramp to an elongation, J; and the slope over its last tenth, N/m.
fn ramp(element: &mut Element, from: f64, to: f64) -> (f64, f64) {
    let count = 20_000;
    let (mut work, mut before, mut at_tenth) = (0.0, element.extend(from), (0.0, 0.0));
    for index in 1..=count {
        let part = f64::from(index) / f64::from(count);
        let tension = element.extend(from + part * (to - from));
        work += 0.5 * (before + tension) * (to - from) / f64::from(count);
        before = tension;
        if index == count * 9 / 10 {
            at_tenth = (from + part * (to - from), tension);
        }
    }
    (work, (before - at_tenth.1) / (to - at_tenth.0))
}

/// Fig. 5.3: the toe, then the printed slope once the fibres are aligned.
#[test]
fn slope_is_the_printed_one_above_the_toe() {
    let parameters = Parameters::printed();
    let (mut element, _) =
        Element::bedded(ElementLaw { sag_n2_m: 0.0, ..parameters.element_law(9.0) }, 200.0, 1e-6);
    let zero = element.set_m();
    let mut points = Vec::new();
    for index in 0..=200 {
        let elongation = f64::from(index) * 5e-6;
        points.push((elongation, element.extend(zero + elongation)));
    }
    // Least squares between 0.02 mm and 1.0 mm, as § 5.2.1 has it.
    let range: Vec<_> = points.iter().filter(|(x, _)| (2e-5..=1e-3).contains(x)).collect();
    let count = range.len() as f64;
    let (mean_x, mean_y) = (
        range.iter().map(|p| p.0).sum::<f64>() / count,
        range.iter().map(|p| p.1).sum::<f64>() / count,
    );
    let slope = range.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum::<f64>()
        / range.iter().map(|p| (p.0 - mean_x).powi(2)).sum::<f64>();
    println!("{slope} N/m");
    close(slope, 3.725e4, 5e-3);
    // Softer at low load.
    assert!(points[1].1 < 0.5 * 3.725e4 * points[1].0, "{:?}", points[1]);
}

/// Fig. 5.4: 20 cm, loaded and unloaded twice.
#[test]
fn second_loading_is_stiffer_and_every_cycle_is_a_loop() {
    let parameters = Parameters::printed();
    let mut specimen = parameters.specimen(0.2);
    let top = 1e-4;
    let (first_up, first_slope) = ramp(&mut specimen, 0.0, top);
    let first_down = ramp(&mut specimen, top, 0.0).0;
    let set = specimen.set_m();
    let (second_up, second_slope) = ramp(&mut specimen, 0.0, top);
    let (second_down, _) = ramp(&mut specimen, top, 0.0);
    let (first_loop, second_loop) = (first_up + first_down, second_up + second_down);
    println!(
        "slopes {first_slope} {second_slope}, loops {first_loop} {second_loop} J, set {set} m"
    );
    close(second_slope / first_slope, 1.25, 1e-2);
    assert!(first_loop > second_loop && second_loop > 0.0, "{first_loop} {second_loop}");
    close(set, 0.25 / 1.25 * top, 1e-6);
    assert_eq!(specimen.set_m(), set, "the second loading goes no further");
    close(specimen.dissipated_j(), first_loop + second_loop, 1e-3);
}

#[test]
fn work_is_stored_or_lost_along_any_path() {
    let sagging = ElementLaw {
        sag_n2_m: 1e-4,
        toe_tension_n: 3.0,
        ..Parameters::calibrated().element_law(4.5)
    };
    for (law, start) in
        [(Parameters::calibrated().specimen(4.5).law().to_owned(), 0.0), (sagging, -1e-5)]
    {
        let mut element = Element::new(law);
        element.extend(start);
        let (stored, lost) = (element.stored_j(), element.dissipated_j());
        let (mut work, mut from, mut size, mut last) = (0.0, start, 0.0_f64, 0.0);
        for target in [0.01, 0.004, 0.02, 0.0195, 0.03, -0.002, 0.035, 0.01] {
            work += ramp(&mut element, from, target).0;
            from = target;
            size = size.max(work.abs());
            assert!(element.dissipated_j() >= last);
            last = element.dissipated_j();
        }
        let found = element.stored_j() - stored + element.dissipated_j() - lost;
        assert!((found - work).abs() < 1e-4 * size, "{found} {work}");
    }
}

#[test]
fn a_cable_never_pushes_and_is_tensioned_by_its_weight() {
    let mut light = Parameters::printed().specimen(9.0);
    for elongation in [1e-3, -1e-3, 5e-4, 0.0, -1.0] {
        assert!(light.extend(elongation) >= 0.0);
    }
    assert_eq!(light.tension_n(), 0.0);
    let mut heavy = Element::new(Parameters::printed().element_law(9.0));
    heavy.extend(-0.01);
    // Slack by 1 cm over three spans: each hangs by √(3 ℓ Δ/8), T = w ℓ²/8 over that; let out, the
    // fibres' friction bears a twentieth.
    let hang = (3.0_f64 * 3.0 * 0.01 / 3.0 / 8.0).sqrt();
    close(heavy.tension_n(), 7.9e-4 * 9.81 * 9.0 / (8.0 * hang) * 0.95, 1e-2);
}

#[test]
fn sag_takes_little_of_the_stiffness_where_the_cable_is_tight() {
    let law = ElementLaw { friction_ratio: 0.0, ..Parameters::printed().element_law(9.0) };
    let slope = |tension: f64| 2e-3 / (law.stretch(tension + 1e-3) - law.stretch(tension - 1e-3));
    // § 5.3's slack: at 60 N it takes less than 0.1 % of the stiffness, at 2 N it leaves
    // a third.
    close(slope(60.0), 3.725e4, 1e-3);
    let left = slope(2.0) / 3.725e4;
    assert!((0.3..0.4).contains(&left), "{left}");
}
