//! Tests of the simulator against closed forms.

use super::*;
use crate::smoothing::Shape;

const SAMPLE_S: f64 = 0.5e-3;

fn frictionless() -> Simulator {
    let mut machine = MachineParameters::declared();
    for name in [
        "motor_coulomb_nm",
        "motor_viscous_nm_s",
        "master_piston_static_friction_n",
        "fluid_viscosity_pa_s",
        "master_piston_falling_slope_n_s_per_m",
        "master_piston_kinetic_friction_n",
        "port_damping_n_s_per_m",
        "master_piston_rising_slope_n_s_per_m",
        "slave_static_friction_nm",
        "slave_kinetic_friction_nm",
        "slave_falling_slope_nm_s",
        "slave_rising_slope_nm_s",
    ] {
        *machine.named_mut(name).unwrap() = 0.0;
    }
    // No loss in the hose: a fluid so thin that it is turbulent loses by its density only, so
    // Re is kept low instead.
    machine.fluid_viscosity_pa_s = 1e-12;
    machine.hose_diameter_m = 1e6;
    machine.hose_roughness_m = 0.0;
    Simulator::new(
        machine,
        Smoothing { shape: Shape::Root, speed_rad_s: 0.1 },
        Vec::new(),
        SAMPLE_S,
    )
    .unwrap()
}

/// Both lines move alike, so that there are three masses in a row; with `u = d_m q_m`, `w = d_s
/// q_s` and the rates `A = k d_m²/I_m`, `B = k/2m`, `C = k d_s²/I_s`, `k = 4K`: `λ² - λ (A + 2B
/// + C) + AB + BC + CA = 0` beside the rigid one.
#[test]
fn frictionless_modes_as_in_closed_form() {
    let model = frictionless();
    let [m, s] = model.displacement;
    let k = 2.0 * model.half_line_n_per_m;
    let (a, b, c) = (
        k * m * m / model.inertia[0],
        k / (2.0 * model.fluid_mass_kg),
        k * s * s / model.inertia[1],
    );
    let (sum, product) = (a + 2.0 * b + c, a * b + b * c + c * a);
    for sign in [-1.0, 1.0] {
        let lambda = 0.5 * (sum + sign * (sum * sum - 4.0 * product).sqrt());
        // Fluid displaced by 1 mm; the ends follow from (A - λ) u = A s.
        let fluid = 1e-3;
        let (u, w) = (a * fluid / (a - lambda), c * fluid / (c - lambda));
        let mut state = State::default();
        (state.0[0], state.0[2], state.0[4], state.0[6]) = (u / m, w / s, fluid, fluid);
        let start = state;
        let period = std::f64::consts::TAU / lambda.sqrt();
        let periods = 20.0;
        let samples = (periods * period / SAMPLE_S).round();
        let held = Simulator { sample_s: periods * period / samples, ..frictionless() };
        for index in 0..samples as usize {
            let time = index as f64 * held.sample_s;
            held.advance(&mut state, time, time, &Input { volts: &[0.0], ..Input::default() });
        }
        for i in [0, 2, 4, 6] {
            let off = (state.0[i] - start.0[i]) / start.0[i];
            assert!(off.abs() < 1e-4, "mode {}: state {i} off by {off:e}", lambda.sqrt());
        }
        let kept = model.energy_j(&state) / model.energy_j(&start);
        assert!((kept - 1.0).abs() < 1e-6, "{kept}");
    }
}

/// With friction and no input, energy only falls.
#[test]
fn friction_dissipates() {
    let model = Simulator::new(
        MachineParameters::declared(),
        Smoothing { shape: Shape::Tanh, speed_rad_s: 0.05 },
        Vec::new(),
        SAMPLE_S,
    )
    .unwrap();
    let mut state = State::default();
    (state.0[1], state.0[3]) = (8.0, -6.0);
    let mut energy = model.energy_j(&state);
    let begin = energy;
    for index in 0..2000 {
        let time = f64::from(index) * SAMPLE_S;
        model.advance(&mut state, time, time, &Input { volts: &[0.0], ..Input::default() });
        let now = model.energy_j(&state);
        assert!(now <= energy * (1.0 + 1e-9) + 1e-12, "at {time}: {energy} to {now}");
        energy = now;
    }
    assert!(energy < 0.5 * begin);
}

/// Halving the step changes little: the record is the machine's, not the integrator's.
#[test]
fn converged_at_its_step() {
    let build = |steps: usize| {
        let smoothing = Smoothing { shape: Shape::Root, speed_rad_s: 0.04 };
        Simulator {
            steps,
            ..Simulator::new(MachineParameters::declared(), smoothing, Vec::new(), SAMPLE_S)
                .unwrap()
        }
    };
    let run = |model: &Simulator| {
        let mut state = State::default();
        for index in 0..4000 {
            let time = f64::from(index) * SAMPLE_S;
            let volts = [3.0 * (std::f64::consts::TAU * time).sin()];
            model.advance(&mut state, time, time, &Input { volts: &volts, ..Input::default() });
        }
        [state.0[0], state.0[2]]
    };
    let chosen = Simulator::new(
        MachineParameters::declared(),
        Smoothing { shape: Shape::Root, speed_rad_s: 0.04 },
        Vec::new(),
        SAMPLE_S,
    )
    .unwrap();
    let (coarse, fine) = (run(&chosen), run(&build(4 * chosen.steps)));
    for side in 0..2 {
        assert!(
            (coarse[side] - fine[side]).abs() < 2e-5,
            "{coarse:?} {fine:?} at {} steps",
            chosen.steps
        );
    }
}

#[derive(Debug)]
struct Many(usize);

impl Deviation for Many {
    fn states(&self) -> usize {
        self.0
    }
}

#[test]
fn too_many_states_are_refused() {
    let smoothing = Smoothing { shape: Shape::Root, speed_rad_s: 0.1 };
    let build = |states: usize| {
        Simulator::new(
            MachineParameters::declared(),
            smoothing,
            vec![Box::new(Many(states))],
            SAMPLE_S,
        )
        .map(|model| model.states())
    };
    assert_eq!(build(MOST - OWN), Ok(MOST));
    assert_eq!(build(MOST - OWN + 1), Err(TooManyStates(MOST + 1)));
}
