//! The transmission against the same integration scheme in plain C, compiled with `cc -O3` and run
//! in turn with it; and many parameter sets at once on all cores. Prints ns per internal step, the
//! ratio Rust/C with its quartiles, and records per second.
//!
//! Both run the same record (30 s at 2 kHz) and must end with the same positions and energies, or
//! the comparison is void.
#![allow(missing_docs)]

use std::hint::black_box;
use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;

use plant::hydrostatic::{Input, Parameters, Plant, Transmission};
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};

const STEPS: usize = 60_000;
const RUNS: usize = 15;
const VOLTS: f64 = 3.0;
const HAND_NM: f64 = 2.0;

type Failure = Box<dyn std::error::Error>;

fn input(index: usize) -> Input {
    let index = index as f64;
    Input {
        motor_v: VOLTS * (index * 0.003).sin(),
        hand_torque_nm: HAND_NM * (index * 0.0007).sin(),
    }
}

fn rust(parameters: &Parameters) -> Result<(f64, Plant), Failure> {
    let mut plant = Plant::new(black_box(parameters).clone(), Vec::new())?;
    let began = Instant::now();
    for index in 0..STEPS {
        plant.step(input(index), 0.5e-3);
    }
    Ok((began.elapsed().as_nanos() as f64, plant))
}

/// In the order in which c_reference.c reads them.
fn arguments(parameters: &Parameters, longest_step_s: f64) -> Vec<f64> {
    let [master, slave] = parameters.half_line_stiffness_n_per_m();
    let area = parameters.hose_area_m2;
    let (length, diameter) = (parameters.hose_length_m, parameters.hose_diameter_m);
    let (piston, friction) = (parameters.master_piston_friction(), parameters.slave_friction());
    let law = |law: plant::friction::Stribeck| {
        [law.at_rest, law.falling, law.corner, law.above_corner, law.rising]
    };
    let mut numbers = vec![1.0, STEPS as f64, master, slave];
    numbers.extend([
        parameters.master_displacement_m_per_rad(),
        parameters.slave_displacement_m_per_rad(),
    ]);
    numbers.extend([parameters.master_inertia_kg_m2(), parameters.slave_inertia_kg_m2()]);
    numbers.extend([parameters.fluid_mass_kg(), parameters.port_damping_n_s_per_m]);
    numbers.push(32.0 * parameters.fluid_viscosity_pa_s * length * area / (diameter * diameter));
    numbers.push(parameters.fluid_density_kg_m3 * diameter / parameters.fluid_viscosity_pa_s);
    numbers.push(parameters.fluid_density_kg_m3 * area * length / (2.0 * diameter));
    numbers.push(parameters.hose_roughness_m / diameter);
    numbers.extend([
        parameters.motor_torque_per_volt_nm,
        parameters.motor_coulomb_nm,
        parameters.motor_viscous_nm_s,
    ]);
    numbers.extend(law(piston));
    numbers.extend(law(friction));
    numbers.extend([longest_step_s, VOLTS, HAND_NM]);
    numbers
}

/// One run of the C program: its ns, and what its state ended in.
fn c(program: &PathBuf, numbers: &[f64]) -> Result<(f64, Vec<f64>), Failure> {
    let output = Command::new(program)
        .args(numbers.iter().map(|number| format!("{number:.17e}")))
        .output()?;
    let text = String::from_utf8(output.stdout)?;
    let mut lines = text.lines();
    let time = lines.next().ok_or("the C program printed nothing")?.parse()?;
    let state = lines
        .next()
        .and_then(|line| line.strip_prefix("state "))
        .ok_or("the C program printed no state")?;
    Ok((time, state.split(' ').map(str::parse).collect::<Result<_, _>>()?))
}

fn quartiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [0.25, 0.5, 0.75].map(|part| values[((values.len() - 1) as f64 * part).round() as usize])
}

fn beside_c(name: &str, parameters: &Parameters, program: &PathBuf) -> Result<(), Failure> {
    let (_, plant) = rust(parameters)?;
    let per_output = (0.5e-3 / plant.longest_step_s() - 1e-9).ceil().max(1.0);
    let numbers = arguments(parameters, plant.longest_step_s());
    let (_, state) = c(program, &numbers)?;
    let energy = plant.energy();
    let ours = [
        plant.state().master_position_rad,
        plant.state().slave_position_rad,
        energy.dissipated_j,
        energy.input_j,
    ];
    for (ours, theirs) in ours.into_iter().zip(state) {
        // The last bits may differ: sums are taken in another order, or one
        // program sticks a step earlier.
        if (ours - theirs).abs() > 1e-6 * (1.0 + theirs.abs()) {
            return Err(format!(
                "{name}: the two programs computed different things: {ours} and {theirs}"
            )
            .into());
        }
    }
    let (mut rust_ns, mut c_ns, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..RUNS {
        let (ours, _) = rust(parameters)?;
        let (theirs, _) = c(program, &numbers)?;
        rust_ns.push(ours);
        c_ns.push(theirs);
        ratios.push(ours / theirs);
    }
    let [_, ours, _] = quartiles(rust_ns);
    let [_, theirs, _] = quartiles(c_ns);
    let [low, ratio, high] = quartiles(ratios);
    let steps = STEPS as f64 * per_output;
    println!(
        "{name:<22} {per_output:>3.0} steps each  Rust {:>6.1} ms ({:>5.1} ns per step)  \
         C {:>6.1} ms ({:>5.1} ns)  ratio {ratio:.2} ({low:.2} to {high:.2})",
        ours * 1e-6,
        ours / steps,
        theirs * 1e-6,
        theirs / steps
    );
    Ok(())
}

fn in_batch() -> Result<(), Failure> {
    let sets: Vec<_> = (0..64)
        .map(|index| Parameters {
            slave_static_friction_nm: 1.5 + 0.02 * f64::from(index),
            ..Parameters::calibrated()
        })
        .collect();
    let inputs: Vec<_> = (0..STEPS).map(input).collect();
    let simulate = |parameters: &Parameters| {
        let mut plant = Plant::new(parameters.clone(), Vec::new())?;
        let mut sum = 0.0;
        for input in &inputs {
            plant.step(*input, 0.5e-3);
            sum += plant.state().slave_position_rad.powi(2);
        }
        Ok::<f64, plant::ParameterError>(sum)
    };
    let mut rates = [Vec::new(), Vec::new()];
    for _ in 0..5 {
        for (parallel, rates) in [false, true].into_iter().zip(&mut rates) {
            let began = Instant::now();
            let sum: Result<Vec<f64>, _> = match parallel {
                true => sets.par_iter().map(simulate).collect(),
                false => sets.iter().map(simulate).collect(),
            };
            black_box(sum?);
            rates.push(sets.len() as f64 / began.elapsed().as_secs_f64());
        }
    }
    let [one, all] = rates.map(|rates| quartiles(rates)[1]);
    let cores = std::thread::available_parallelism()?;
    println!(
        "batch of 64 records of 30 s: {one:.0} a second on one core, {all:.0} on {cores} \
         ({:.2} times)",
        all / one
    );
    Ok(())
}

fn main() -> Result<(), Failure> {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let program = folder.join(format!("c-reference-{}", std::process::id()));
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/c_reference.c");
    let built = Command::new("cc")
        .args(["-O3", "-std=c11", "-Wall", "-Werror", "-o"])
        .arg(&program)
        .arg(source)
        .arg("-lm")
        .status()?;
    if !built.success() {
        return Err("cc could not build c_reference.c".into());
    }
    let printed = Parameters::printed();
    let result = beside_c("traced, 10 m", &Parameters::calibrated(), &program)
        .and_then(|()| beside_c("printed, 10 m", &printed, &program))
        .and_then(|()| beside_c("printed, 0.5 m", &printed.clone().with_hose_length(0.5), &program))
        .and_then(|()| in_batch());
    std::fs::remove_file(&program)?;
    result
}
