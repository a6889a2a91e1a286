//! Whether a sampled control law keeps a transmission stable, by the poles of both together.
//!
//! The transmission is taken as linear ([`Machine`]), the law as it is computed: samples at its period, volts that answer a sample a
//! fixed time later and are held, difference quotients behind their low passes, the forgetting of eq. 4.2.1. The whole is one matrix
//! that leads from sample to sample; its largest eigenvalue says how fast a disturbance grows or fades.
//!
//! **What it does not see.** Dry friction takes energy from every movement, so that a real machine stands where the linear one would
//! creep; the offset of eq. 4.2.3 gives such energy back, but never more than its 1.5 V can: about a loop that is stable here, both together
//! make a bounded chatter, and no growth. Saturation, quantisation and lateness are left out.
//!
//! **The hand.** Nobody knows how stiff a hand is. [`HANDS`] spans what a check has to hold for.

mod machine;

use nalgebra::{DMatrix, DVector};

pub use machine::Machine;
use machine::STATES;

/// A hand at the handle: what it adds to it, about where it wants to be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hand {
    /// Inertia that goes with the handle (kg·m²).
    pub inertia: f64,
    /// Damping (N·m·s/rad).
    pub damping: f64,
    /// Stiffness (N·m/rad).
    pub stiffness: f64,
}

/// The times of a sampled law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Period of the law (s).
    pub period_s: f64,
    /// From a sample to the volts that answer it (s).
    pub answer_s: f64,
    /// Cut-off of the velocity estimate's low pass (Hz).
    pub velocity_hz: f64,
    /// Cut-off of the acceleration estimate's low pass, behind that (Hz).
    pub acceleration_hz: f64,
    /// Cut-off of the torque cell (Hz).
    pub cell_hz: f64,
}

/// A law on one axis: volts out of what is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// Force control (eq. 4.2.1, 4.2.2) with a field.
    Force {
        /// Volts per torque of hand and field (V/(N·m)).
        gain: f64,
        /// Share of the new value in a period, eq. 4.2.1.
        share: f64,
        /// Whether the field goes by the encoder at the handle; else by the motor's.
        by_slave: bool,
        /// The field.
        field: Field,
    },
    /// Position control (§ 4.1) of the motor: volts per position and velocity error (V/rad, V·s/rad), of the handle through `gear`.
    Position {
        /// P (V/rad).
        proportional: f64,
        /// D (V·s/rad).
        derivative: f64,
    },
}

/// A linear force field on one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Field {
    /// Stiffness, negative where it diverges (N·m/rad).
    pub stiffness: f64,
    /// Damping, negative where it drives (N·m·s/rad).
    pub damping: f64,
    /// Inertia (kg·m²).
    pub inertia: f64,
}

/// An axis that is to be stable: machine, times, law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loop {
    /// The transmission.
    pub machine: Machine,
    /// The times.
    pub sampling: Sampling,
    /// Turns of the motor per turn of the handle, where the master's position is the handle's through a gear.
    pub gear: f64,
}

impl Loop {
    /// How fast the slowest-fading disturbance grows (1/s); negative where all fade. The law's gains are taken `raised` times.
    ///
    /// Not finite where a number is none.
    pub fn growth(&self, law: &Law, hand: &Hand, raised: f64) -> f64 {
        let matrix = self.closed(law, hand, raised);
        if !matrix.iter().all(|number| number.is_finite()) {
            return f64::NAN;
        }
        let largest = matrix.complex_eigenvalues().iter().map(|pole| pole.norm()).fold(0.0, f64::max);
        largest.ln() / self.sampling.period_s
    }

    /// The matrix from sample to sample. States: the machine's, the volts of the last samples (newest first), the last position
    /// that a difference was taken of, its velocity and acceleration estimates.
    fn closed(&self, law: &Law, hand: &Hand, raised: f64) -> DMatrix<f64> {
        let Sampling { period_s, answer_s, velocity_hz, acceleration_hz, cell_hz } = self.sampling;
        let (a, b) = self.machine.continuous(hand, cell_hz);
        // Volts that are on their way reach over `whole` periods and a part.
        let whole = (answer_s / period_s + 1e-9).floor().max(0.0);
        let late_s = (answer_s - whole * period_s).max(0.0);
        let whole = whole as usize;
        let (free, early) = held(&a, &b, period_s - late_s);
        let (rest, late) = held(&a, &b, late_s);
        // First the older volts for `late_s`, then the newer for the rest of the period.
        let (transition, older, newer) = (&free * &rest, &free * late, early);
        let volts = STATES;
        let (position, velocity, acceleration) = (volts + whole + 1, volts + whole + 2, volts + whole + 3);
        let states = volts + whole + 4;
        let weight = |hz: f64| -(-std::f64::consts::TAU * hz * period_s).exp_m1();
        let (wv, wa) = (weight(velocity_hz), weight(acceleration_hz));

        // What the law sees now, as rows over the states before.
        let row = |at: usize| {
            let mut row = DVector::zeros(states);
            row[at] = 1.0;
            row
        };
        let (slave, motor) = (row(1), row(0) / self.gear);
        let (cell, last_volts) = (row(STATES - 1), row(volts));
        let (last_position, last_velocity, last_acceleration) = (row(position), row(velocity), row(acceleration));
        let seen = match law {
            Law::Force { by_slave: true, .. } => slave,
            _ => motor,
        };
        let speed = (1.0 - wv) * &last_velocity + wv / period_s * (&seen - last_position);
        let change = (1.0 - wa) * last_acceleration + wa / period_s * (&speed - last_velocity);
        let answer = match law {
            Law::Force { gain, share, field, .. } => {
                let torque = cell - field.stiffness * &seen - field.damping * &speed - field.inertia * &change;
                (1.0 - share) * last_volts + share * raised * gain * torque
            }
            Law::Position { proportional, derivative } => -raised * (*proportional * &seen + *derivative * &speed),
        };

        let mut closed = DMatrix::zeros(states, states);
        closed.view_mut((0, 0), (STATES, STATES)).copy_from(&transition);
        // Volts index: 0 is the newest before this sample. `newer` acts through the answer of `whole` samples ago.
        match whole.checked_sub(1) {
            None => {
                let through = newer * answer.transpose();
                let mut rows = closed.rows_mut(0, STATES);
                rows += through;
            }
            Some(at) => {
                let mut column = closed.view_mut((0, volts + at), (STATES, 1));
                column += newer;
            }
        }
        let mut column = closed.view_mut((0, volts + whole), (STATES, 1));
        column += older;
        closed.row_mut(volts).copy_from(&answer.transpose());
        for at in 0..whole {
            closed[(volts + at + 1, volts + at)] = 1.0;
        }
        closed.row_mut(position).copy_from(&seen.transpose());
        closed.row_mut(velocity).copy_from(&speed.transpose());
        closed.row_mut(acceleration).copy_from(&change.transpose());
        closed
    }
}

/// What becomes of the state in `time_s`, and what of volts that are held over it.
fn held(a: &DMatrix<f64>, b: &DVector<f64>, time_s: f64) -> (DMatrix<f64>, DVector<f64>) {
    let states = a.nrows();
    let mut both = DMatrix::zeros(states + 1, states + 1);
    both.view_mut((0, 0), (states, states)).copy_from(&(a * time_s));
    both.view_mut((0, states), (states, 1)).copy_from(&(b * time_s));
    let both = both.exp();
    (both.view((0, 0), (states, states)).into_owned(), both.view((0, states), (states, 1)).column(0).into_owned())
}

/// Hands that a check has to hold for: nobody; a relaxed hand; a firm one; a stiff, tense one. Assumed: a relaxed wrist has
/// some 0.5 to 3 N·m/rad, a tense one ten times that; a limb's damping ratio is about 0.3 with the inertia of hand and handle.
pub const HANDS: [Hand; 4] = [
    Hand { inertia: 0.0, damping: 0.0, stiffness: 0.0 },
    Hand { inertia: 0.0, damping: 0.05, stiffness: 0.3 },
    Hand { inertia: 0.0, damping: 0.2, stiffness: 5.0 },
    Hand { inertia: 0.0, damping: 0.5, stiffness: 20.0 },
];

#[cfg(test)]
mod explore {
    use super::*;
    use crate::{cable, hydrostatic};

    #[test]
    fn explore() {
        let c = 4000.0 / std::f64::consts::TAU;
        let sampling =
            Sampling { period_s: 2e-3, answer_s: 1e-3, velocity_hz: 40.0, acceleration_hz: 10.0, cell_hz: 200.0 };
        let khz = Sampling { period_s: 1e-3, ..sampling };
        let machines = [
            ("traced", Machine::new(&hydrostatic::Parameters::traced().into())),
            ("printed", Machine::new(&hydrostatic::Parameters::printed().into())),
        ];
        let hands = [
            (0.0, 0.0, 0.0),
            (0.0, 0.05, 0.3),
            (0.0, 0.2, 5.0),
            (0.0, 0.5, 20.0),
            (0.0, 1.0, 50.0),
            (0.0, 1.0, 100.0),
            (3e-3, 0.5, 20.0),
        ];
        for (name, machine) in machines {
            for (rate, sampling) in [(500, sampling), (1000, khz)] {
                let whole = Loop { machine, sampling, gear: 1.0 };
                for (inertia, damping, stiffness) in hands {
                    let hand = Hand { inertia, damping, stiffness };
                    let law = Law::Position { proportional: 4.5e-3 * c, derivative: 7e-4 * c };
                    print!(
                        "{name} {rate} hand {stiffness} pos {:+.2} {:+.2} |",
                        whole.growth(&law, &hand, 1.0),
                        whole.growth(&law, &hand, 1.5)
                    );
                    let share = 1.0 - 0.6f64.powf(sampling.period_s / 2e-3);
                    for (k, d, i) in [
                        (0.0, 0.0, 0.0),
                        (1.0, 0.0, 0.0),
                        (5.0, 0.0, 0.0),
                        (10.0, 0.0, 0.0),
                        (-1.0, 0.0, 0.0),
                        (0.0, 0.2, 0.0),
                        (0.0, 0.5, 0.0),
                        (0.0, 1.0, 0.0),
                        (0.0, 2.0, 0.0),
                        (0.0, -0.2, 0.0),
                        (0.0, 0.0, 0.01),
                        (0.0, 0.0, -0.01),
                        (5.0, 0.3, 0.0),
                    ] {
                        let law = Law::Force {
                            gain: 0.1665,
                            share,
                            by_slave: true,
                            field: Field { stiffness: k, damping: d, inertia: i },
                        };
                        print!(
                            " {k}/{d}/{i}: {:+.2}/{:+.2}",
                            whole.growth(&law, &hand, 1.0),
                            whole.growth(&law, &hand, 1.5)
                        );
                    }
                    println!();
                }
            }
        }
        let cs = 20000.0 * 6.0 / std::f64::consts::TAU;
        let whole = Loop { machine: Machine::new(&cable::Parameters::traced().into()), sampling, gear: 6.0 };
        for (inertia, damping, stiffness) in hands {
            let hand = Hand { inertia, damping, stiffness };
            let law = Law::Position { proportional: 4.5e-3 * cs, derivative: 1e-4 * cs };
            println!("cable {stiffness} {:+.2} {:+.2}", whole.growth(&law, &hand, 1.0), whole.growth(&law, &hand, 1.5));
        }
    }
}
