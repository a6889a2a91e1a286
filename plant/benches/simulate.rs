//! 30 s of the transmission at 2 kHz: plain, with effects, with the shortest hose.
#![allow(clippy::unwrap_used, missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use plant::hydrostatic::{Input, Parameters, Plant, Transmission};
use std::hint::black_box;

fn run(plant: &Plant) -> f64 {
    let mut plant = plant.clone();
    for index in 0..60_000 {
        let motor_v = 3.0 * (f64::from(index) * 0.003).sin();
        plant.step(Input { motor_v, hand_torque_nm: 0.0 }, 0.5e-3);
    }
    plant.state().slave_position_rad
}

fn simulate(criterion: &mut Criterion) {
    let names = ["backlash@slave", "stribeck_friction@slave", "torque_ripple", "sensor_drift"];
    let effects = names.map(|name| plant::effects::parse(name).unwrap()).to_vec();
    let cases = [
        ("traced", Plant::new(Parameters::calibrated(), Vec::new()).unwrap()),
        ("traced, four effects", Plant::new(Parameters::calibrated(), effects).unwrap()),
        (
            "printed, 0.5 m",
            Plant::new(Parameters::printed().with_hose_length(0.5), Vec::new()).unwrap(),
        ),
    ];
    let mut group = criterion.benchmark_group("30 s at 2 kHz");
    group.sample_size(10);
    for (name, plant) in &cases {
        group.bench_function(*name, |bencher| bencher.iter(|| run(black_box(plant))));
    }
    group.finish();
}

criterion_group!(benches, simulate);
criterion_main!(benches);
