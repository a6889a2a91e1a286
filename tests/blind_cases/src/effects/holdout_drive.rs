//! Hold-out effects at amplifier and motor.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, View};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "thermal_foldback",
        site: Site::Drive,
        depends_on: &[Variable::Volts, Variable::Load],
        draw: |draw, _| {
            // Ordinary movement heats like a constant 0.9 to 1.1 V: it trips during fast movement
            // or under load, but not permanently, which would be a mere saturation.
            Values::of([
                ("limit", draw.uniform(1.15, 1.4), "V"),
                ("trip", draw.uniform(1.05, 1.2), "V"),
                ("time_constant", draw.log_uniform(0.3, 0.8), "s"),
            ])
        },
        build: |values, _| {
            Box::new(Foldback {
                limit: values.get("limit"),
                trip: values.get("trip"),
                time_constant: values.get("time_constant"),
            })
        },
    },
    Entry {
        id: "coarse_command",
        site: Site::Drive,
        depends_on: &[Variable::Volts],
        draw: |draw, _| Values::of([("step", draw.uniform(0.5, 0.9), "V")]),
        build: |values, _| Box::new(Coarse { step: values.get("step") }),
    },
    Entry {
        id: "amplifier_dropout",
        site: Site::Drive,
        depends_on: &[Variable::Time],
        draw: |draw, _| {
            Values::of([
                ("length", draw.uniform(0.04, 0.1), "s"),
                ("period", draw.uniform(0.7, 1.6), "s"),
                ("start", draw.uniform(0.0, 0.5), "s"),
            ])
        },
        build: |values, _| {
            Box::new(Dropout {
                length: values.get("length"),
                period: values.get("period"),
                start: values.get("start"),
            })
        },
    },
];

/// Output limit of a cold amplifier, V.
const COLD_V: f64 = 10.0;
/// Relative width of the transition of the limit.
const TRIP_WIDTH: f64 = 0.05;

/// An amplifier that protects its motor: the square of its output heats a model of the winding, and
/// beyond the heat of a constant `trip` the output is limited to `limit`, until the winding has
/// cooled. The state is the heat, V².
#[derive(Debug)]
struct Foldback {
    limit: f64,
    trip: f64,
    time_constant: f64,
}

impl Deviation for Foldback {
    fn states(&self) -> usize {
        1
    }

    fn amplifier(&self, volts: f64, _view: &View<'_>, own: &[f64], rates: &mut [f64]) -> f64 {
        let trip = self.trip * self.trip;
        let cold = 1.0 / (1.0 + ((own[0] - trip) / (TRIP_WIDTH * trip)).exp());
        let most = self.limit + (COLD_V - self.limit).max(0.0) * cold;
        let given = volts.clamp(-most, most);
        rates[0] = (given * given - own[0]) / self.time_constant;
        given
    }
}

/// A converter with dead lower bits: voltages are rounded to whole steps.
#[derive(Debug)]
struct Coarse {
    step: f64,
}

impl Deviation for Coarse {
    fn amplifier(&self, volts: f64, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) -> f64 {
        (volts / self.step).round() * self.step
    }
}

/// A stage that restarts by itself: every `period` the motor is without current for `length`.
#[derive(Debug)]
struct Dropout {
    length: f64,
    period: f64,
    start: f64,
}

impl Deviation for Dropout {
    fn amplifier(&self, volts: f64, view: &View<'_>, _own: &[f64], _rates: &mut [f64]) -> f64 {
        if (view.time_s - self.start).rem_euclid(self.period) < self.length { 0.0 } else { volts }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hot_amplifier_is_limited_and_recovers() {
        let foldback = Foldback { limit: 1.5, trip: 1.2, time_constant: 0.5 };
        let mut heat = [0.0];
        let mut run = |volts: f64, seconds: f64| {
            let mut given = 0.0;
            for _ in 0..(seconds / 1e-3) as usize {
                let mut rates = [0.0];
                given = foldback.amplifier(volts, &View::at_rest(), &heat, &mut rates);
                heat[0] += 1e-3 * rates[0];
            }
            given
        };
        assert_eq!(run(2.5, 0.01), 2.5, "cold");
        let hot = run(2.5, 4.0);
        assert!((1.5..1.7).contains(&hot), "{hot}");
        assert_eq!(run(-1.0, 4.0), -1.0, "what is below the limit passes");
        assert_eq!(run(-2.5, 0.01), -2.5, "cold again");
    }

    #[test]
    fn coarse_commands_are_whole_steps_and_unbiased() {
        let coarse = Coarse { step: 0.5 };
        let given: Vec<f64> = (-200..=200)
            .map(|index| coarse.amplifier(f64::from(index) * 0.01, &View::at_rest(), &[], &mut []))
            .collect();
        assert!(given.iter().all(|volts| (volts / 0.5).fract() == 0.0));
        let slope: f64 = given
            .iter()
            .enumerate()
            .map(|(index, volts)| (index as f64 - 200.0) * 0.01 * volts)
            .sum::<f64>()
            / (0..401).map(|index| (f64::from(index) * 0.01 - 2.0).powi(2)).sum::<f64>();
        assert!((slope - 1.0).abs() < 0.02, "{slope}");
    }

    #[test]
    fn dropouts_last_for_their_share_of_time() {
        let dropout = Dropout { length: 0.08, period: 1.0, start: 0.3 };
        let off = (0..10_000).filter(|index| {
            let view = View { time_s: f64::from(*index) * 1e-3, ..View::at_rest() };
            dropout.amplifier(2.0, &view, &[], &mut []) == 0.0
        });
        let count = off.count();
        assert!((799..=801).contains(&count), "{count} ms of 10 s");
    }
}
