//! The published frequency responses, measured by simulation.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use plant::hydrostatic::{Parameters, Plant, Response, frequency_response};

fn at(parameters: Parameters, frequency_hz: f64, amplitude_deg: f64) -> Response {
    let mut plant = Plant::new(parameters, Vec::new()).unwrap();
    frequency_response(&mut plant, frequency_hz, amplitude_deg.to_radians())
}

/// Frequency of the largest gain, on a grid.
fn peak_hz(parameters: Parameters, from: f64, to: f64, step: f64, amplitude_deg: f64) -> f64 {
    let count = ((to - from) / step).round() as usize;
    (0..=count)
        .map(|index| at(parameters.clone(), from + step * index as f64, amplitude_deg))
        .max_by(|a, b| a.gain.total_cmp(&b.gain))
        .unwrap()
        .frequency_hz
}

#[test]
fn look() {
    for (name, p) in [
        ("printed", Parameters::printed()),
        ("traced", Parameters::traced()),
        ("traced1m", Parameters::traced().with_hose_length(1.0)),
    ] {
        for f in [
            0.2, 0.5, 1.0, 2.0, 4.0, 6.0, 7.0, 7.5, 8.0, 8.5, 9.0, 10.0, 12.0, 12.5, 13.0, 14.0, 14.5, 16.0, 20.0,
            25.0, 28.0, 30.0, 32.0, 35.0, 40.0, 43.0, 45.0, 47.0, 49.0, 55.0, 65.0, 70.0, 75.0, 80.0,
        ] {
            let r = at(p.clone(), f, 30.0);
            println!("{name} {f} gain {:.3} lag {:.1} ms eff {:.3}", r.gain, r.lag_s() * 1e3, r.efficiency);
        }
    }
    let t = std::time::Instant::now();
    let mut plant = Plant::new(Parameters::printed(), Vec::new()).unwrap();
    for i in 0..60000 {
        plant.step(plant::hydrostatic::Input { motor_v: 3.0 * (i as f64 * 0.003).sin(), hand_torque_nm: 0.0 }, 0.5e-3);
    }
    println!("{:?} {:?} {:?}", t.elapsed(), plant.energy(), plant.energy().defect_j());
    let _ = peak_hz;
}
