//! `m ÿ + d ẏ + k y + offset + effects = input`, integrated by the classical Runge-Kutta method of
//! fourth order.
//!
//! The input is band-limited and sampled at twice the rate of the integration, so that each step
//! has a value at its start, middle and end. At `ω h = 0.3` the phase error of a step is 2e-5 rad
//! (`(ω h)⁵/120`), equivalent to a relative error of 7e-5 in the natural frequency; the fitted mass
//! compensates it by twice that.

use crate::effects::{Instant, Regressor};

/// Largest number of states of all effects together.
const STATES: usize = 6;

/// Largest phase of the natural frequency in one step (rad).
const ANGLE_PER_STEP: f64 = 0.3;

/// Largest number of terms of one effect or nonparametric function.
const TERMS: usize = 32;

/// Least share of the input in the load: friction in proportion to the load cannot exceed it.
const LEAST_SHARE: f64 = 0.05;

/// An effect as a force, with its parameters.
#[derive(Clone)]
pub struct Force<'a> {
    /// The effect.
    pub effect: &'a dyn Regressor,
    /// One amplitude per term.
    pub amplitudes: Vec<f64>,
    /// Its shapes.
    pub shapes: Vec<f64>,
}

/// The oscillator that is simulated.
pub struct Oscillator<'a> {
    /// Mass.
    pub mass: f64,
    /// Damping.
    pub damping: f64,
    /// Stiffness.
    pub stiffness: f64,
    /// Coulomb friction, where it is declared.
    pub coulomb: f64,
    /// The input for which it rests at 0.
    pub offset: f64,
    /// Smoothing speed of the sign of the velocity; `None` if nothing depends on it.
    pub smoothing: Option<f64>,
    /// Effects.
    pub forces: Vec<Force<'a>>,
}

/// An oversampled input.
#[derive(Clone, Debug)]
pub struct Input {
    /// Values, two per step.
    pub values: Vec<f64>,
    /// Steps per sampling period of the record.
    pub steps: usize,
    /// Length of a step (s).
    pub step: f64,
    /// Time of the first value (s).
    pub start: f64,
}

/// Steps per sampling period for a machine with a natural frequency `natural` (rad/s), sampled
/// every `sampling` seconds.
pub fn steps(natural: f64, sampling: f64) -> usize {
    ((natural * sampling / ANGLE_PER_STEP).ceil() as usize).clamp(1, 64)
}

type State = [f64; STATES + 2];

impl Oscillator<'_> {
    /// Number of states of all effects.
    fn states(&self) -> usize {
        self.forces.iter().map(|force| force.effect.declaration().states).sum()
    }

    /// The force `f` that the machine without dry friction takes of the input, with dry friction
    /// `c s` and `μ |f| s`: `f = (input - c s) / (1 ± μ s)`, with the sign of the numerator.
    fn load(&self, now: &Instant, input: f64, terms: &mut [f64; TERMS]) -> f64 {
        let taken = input - self.coulomb * now.sign;
        let mut share = 0.0;
        for Force { effect, amplitudes, shapes } in &self.forces {
            if effect.declaration().uses_model {
                effect.force(&Instant { load: 1.0, ..*now }, shapes, &[], terms);
                share += amplitudes.iter().zip(terms.iter()).map(|(a, f)| a * f).sum::<f64>();
            }
        }
        taken / (1.0 + share * taken.signum()).max(LEAST_SHARE)
    }

    /// `terms` is scratch memory, which is not cleared at each call.
    fn rate(&self, time: f64, input: f64, state: &State, terms: &mut [f64; TERMS]) -> State {
        let (position, velocity) = (state[0], state[1]);
        let sign = self.smoothing.map_or(0.0, |s| (velocity / s).tanh());
        let mut now = Instant { time, position, velocity, sign, load: 0.0 };
        now.load = self.load(&now, input, terms);
        let mut force = self.damping * velocity
            + self.stiffness * position
            + self.coulomb * now.sign
            + self.offset;
        let mut rate = [0.0; STATES + 2];
        let mut next = 2;
        for Force { effect, amplitudes, shapes } in &self.forces {
            let count = effect.declaration().states;
            let own = &state[next..next + count];
            effect.force(&now, shapes, own, terms);
            force += amplitudes.iter().zip(terms.iter()).map(|(a, f)| a * f).sum::<f64>();
            (effect.declaration().rates)(&now, shapes, own, &mut rate[next..next + count]);
            next += count;
        }
        (rate[0], rate[1]) = (velocity, (input - force) / self.mass);
        rate
    }

    /// The output at the samples of the record, from position and velocity at the first. `None` if
    /// its magnitude exceeds `largest`, or if the effects have too many states.
    pub fn run(
        &self,
        input: &Input,
        (position, velocity): (f64, f64),
        largest: f64,
    ) -> Option<Vec<f64>> {
        let count = self.states();
        if count > STATES {
            return None;
        }
        let used = count + 2;
        let mut state: State = [0.0; STATES + 2];
        (state[0], state[1]) = (position, velocity);
        let h = input.step;
        let samples = (input.values.len() - 1) / (2 * input.steps) + 1;
        let mut output = Vec::with_capacity(samples);
        output.push(position);
        let mut terms = [0.0; TERMS];
        let along = |state: &State, rate: &State, h: f64| {
            let mut moved = *state;
            for (moved, rate) in moved.iter_mut().zip(rate).take(used) {
                *moved += h * rate;
            }
            moved
        };
        for sample in 1..samples {
            for step in 0..input.steps {
                let at = (sample - 1) * input.steps + step;
                let time = input.start + at as f64 * h;
                let [begin, middle, end] = [0, 1, 2].map(|i| input.values[2 * at + i]);
                let k1 = self.rate(time, begin, &state, &mut terms);
                let k2 =
                    self.rate(time + 0.5 * h, middle, &along(&state, &k1, 0.5 * h), &mut terms);
                let k3 =
                    self.rate(time + 0.5 * h, middle, &along(&state, &k2, 0.5 * h), &mut terms);
                let k4 = self.rate(time + h, end, &along(&state, &k3, h), &mut terms);
                for i in 0..used {
                    state[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
                }
            }
            if !state[0].is_finite() || state[0].abs() > largest {
                return None;
            }
            output.push(state[0]);
        }
        Some(output)
    }
}

/// Whether an effect can be simulated, as a force or as an effect on the input.
pub fn can_simulate(effect: &dyn Regressor) -> bool {
    effect.is_force() || effect.declaration().deliver.is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::find;

    fn plain(damping: f64) -> Oscillator<'static> {
        let forces = Vec::new();
        Oscillator {
            mass: 0.5,
            damping,
            stiffness: 200.0,
            coulomb: 0.0,
            offset: 0.0,
            smoothing: None,
            forces,
        }
    }

    /// Worst error of a free oscillation against its closed form.
    fn error(steps: usize) -> f64 {
        let sampling = 0.01;
        let input = Input {
            values: vec![0.0; 2 * 100 * steps + 1],
            steps,
            step: sampling / steps as f64,
            start: 0.0,
        };
        let out = plain(1.0).run(&input, (0.02, 0.0), 1.0).unwrap();
        let (decay, natural) = (1.0, (200.0f64 / 0.5 - 1.0).sqrt());
        let exact = |t: f64| {
            0.02 * (-decay * t).exp()
                * ((natural * t).cos() + decay / natural * (natural * t).sin())
        };
        out.iter()
            .enumerate()
            .fold(0.0, |worst: f64, (i, y)| worst.max((y - exact(0.01 * i as f64)).abs()))
    }

    #[test]
    fn a_free_oscillation_converges_with_fourth_order() {
        let order = (error(2) / error(4)).log2();
        assert!((order - 4.0).abs() < 0.2, "{order}");
        assert!(error(4) < 1e-6);
    }

    #[test]
    fn a_diverging_oscillation_is_abandoned() {
        let input = Input { values: vec![0.0; 20_001], steps: 1, step: 0.01, start: 0.0 };
        assert!(plain(-1.0).run(&input, (0.02, 0.0), 10.0).is_none());
        assert!(plain(1.0).run(&input, (0.02, 0.0), 10.0).is_some());
    }

    #[test]
    fn friction_in_proportion_to_the_load_takes_its_share_of_the_input() {
        let effect = find("load_dependent_friction").unwrap();
        let forces = vec![Force { effect, amplitudes: vec![0.25], shapes: Vec::new() }];
        let loaded = Oscillator { coulomb: 1.0, forces, ..plain(1.0) };
        let now = |sign| Instant { time: 0.0, position: 0.0, velocity: 0.0, sign, load: 0.0 };
        for (sign, input) in [(1.0, 6.0), (1.0, -6.0), (-1.0, 6.0), (-1.0, -6.0)] {
            let load = loaded.load(&now(sign), input, &mut [0.0; TERMS]);
            let needed = load + 0.25 * load.abs() * sign + sign;
            assert!((needed - input).abs() < 1e-12, "{sign} {input}: {load}");
        }
    }

    #[test]
    fn steps_follow_the_natural_frequency() {
        assert_eq!(steps(585.0, 1.0 / 610.35), 4);
        assert_eq!(steps(1.0, 1e-3), 1);
    }
}
