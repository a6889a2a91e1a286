//! Stability of a sampled control law with a transmission, from the poles of the closed loop.
//!
//! The transmission is linearised ([`LinearModel`]); the law is modelled as computed: sampled at
//! its period, its output applied a fixed time after the sample and held, velocities and
//! accelerations as low-passed difference quotients, the exponential forgetting of eq. 4.2.1. The
//! closed loop is one transition matrix from sample to sample; its spectral radius gives the growth
//! rate of a disturbance. A setting passes if nothing grows for any of the hands of [`HANDS`], with
//! the gains as set and [`MARGIN`] times as high.
//!
//! **Not modelled.** The offset of eq. 4.2.3 works against the dry friction of motor and
//! piston and is left out with it. Where it gives more than they take, handle and hand chatter,
//! under force control without any field as well: bounded, since the offset is. Saturation,
//! quantisation and lateness are left out too, and the coupling of several axes by anything but the
//! field.

mod linear_model;

use nalgebra::{DMatrix, DVector, Matrix3};

use linear_model::STATES;
pub use linear_model::{Hand, LinearModel};

/// Gain margin required, as a factor (1).
pub const MARGIN: f64 = 1.5;
/// Growth that counts as none (1/s): a free handle stays where it is put, a pole at rest that
/// numbers hit nearly.
pub const STANDING: f64 = 0.05;
/// How fast a divergent field may drive the handle off with nobody to hold it (1/s): not more than
/// threefold in the 0.2 s in which a person reacts.
pub const DIVERGENCE: f64 = 5.0;

const fn hand(stiffness: f64, damping: f64) -> Hand {
    Hand { inertia: 0.0, damping, stiffness }
}

/// Hands that a check has to hold for: nobody; a relaxed hand; one that holds; a firm one; a tense
/// arm. Assumed: wrists are of 0.3 to 3 N·m/rad relaxed and ten times that tense; no inertia of
/// their own, which only makes things slower.
pub const HANDS: [Hand; 5] =
    [hand(0.0, 0.0), hand(0.3, 0.05), hand(5.0, 0.2), hand(20.0, 0.5), hand(50.0, 1.0)];
/// Those of them that hold the handle against a divergent field.
pub const HOLDING: [Hand; 3] = [HANDS[2], HANDS[3], HANDS[4]];
/// The relaxed one of them.
pub const RELAXED: Hand = HANDS[1];

/// Sampling and filtering of a control law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Period of the law (s).
    pub period_s: f64,
    /// Delay from a sample to the volts computed from it (s).
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
    /// Force control (eq. 4.2.1, 4.2.2), in a field or without.
    Force {
        /// Volts per torque of hand and field (V/(N·m)).
        gain: f64,
        /// Share of the new value in a period, eq. 4.2.1.
        share: f64,
        /// Whether the field goes by the encoder at the handle; else by the motor's.
        by_slave: bool,
    },
    /// Position control (§ 4.1) of the motor, its position that of the handle through the gear.
    Position {
        /// P (V/rad).
        proportional: f64,
        /// D (V·s/rad).
        derivative: f64,
    },
}

/// An axis under control: model, times, law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loop {
    /// The transmission.
    pub model: LinearModel,
    /// The times.
    pub sampling: Sampling,
    /// Turns of the motor per turn of the handle.
    pub gear: f64,
    /// The law.
    pub law: Law,
}

/// A linear force field over up to three axes: rows feel the torque, columns make it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Field {
    /// Stiffness, negative where it diverges (N·m/rad).
    pub stiffness: [[f64; 3]; 3],
    /// Damping, negative where it drives (N·m·s/rad).
    pub damping: [[f64; 3]; 3],
    /// Inertia (kg·m²).
    pub inertia: [[f64; 3]; 3],
}

impl Field {
    /// A field on the first axis alone: stiffness (N·m/rad), damping (N·m·s/rad), inertia (kg·m²).
    pub fn of_one(stiffness: f64, damping: f64, inertia: f64) -> Self {
        let first = |value| {
            let mut matrix = [[0.0; 3]; 3];
            matrix[0][0] = value;
            matrix
        };
        Self { stiffness: first(stiffness), damping: first(damping), inertia: first(inertia) }
    }

    /// Whether it drives the handle away in some direction: the symmetric part of its stiffness has
    /// a negative eigenvalue.
    pub fn diverges(&self) -> bool {
        let stiffness = Matrix3::from_fn(|row, column| {
            0.5 * (self.stiffness[row][column] + self.stiffness[column][row])
        });
        stiffness.symmetric_eigenvalues().iter().any(|value| *value < -1e-9)
    }
}

/// Why a setting does not pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unstable {
    /// With which hand.
    pub hand: Hand,
    /// With gains so many times as high as given.
    pub raised: f64,
    /// How fast a disturbance grows then (1/s).
    pub growth: f64,
}

/// Holds axes, at most three, in a field against every hand of [`HANDS`], as they are and with
/// their gains raised by [`MARGIN`].
///
/// A field that diverges is held against [`HOLDING`]; with nobody at the handle and with a relaxed
/// hand it may grow by [`DIVERGENCE`].
///
/// # Errors
/// [`Unstable`], the first that was found.
pub fn check(axes: &[Loop], field: &Field) -> Result<(), Unstable> {
    let diverges = field.diverges();
    for hand in HANDS {
        for raised in [1.0, MARGIN] {
            let growth = growth(axes, field, &hand, raised);
            let most = if diverges && !HOLDING.contains(&hand) { DIVERGENCE } else { STANDING };
            // What is no number passes nothing.
            if growth.is_nan() || growth > most {
                return Err(Unstable { hand, raised, growth });
            }
        }
    }
    Ok(())
}

/// How fast the slowest-fading disturbance of axes in a field grows (1/s), negative where all fade;
/// the same hand on each axis, gains taken `raised` times. Not a number where an input is none, or
/// where there is no axis.
pub fn growth(axes: &[Loop], field: &Field, hand: &Hand, raised: f64) -> f64 {
    let parts: Vec<Part> = axes.iter().take(3).map(|axis| Part::new(axis, hand, raised)).collect();
    let offsets: Vec<usize> = parts
        .iter()
        .scan(0, |next, part| {
            let offset = *next;
            *next += part.step.nrows();
            Some(offset)
        })
        .collect();
    let states = parts.iter().map(|part| part.step.nrows()).sum();
    let mut whole = DMatrix::zeros(states, states);
    for (row, into) in parts.iter().enumerate() {
        let size = into.step.nrows();
        whole.view_mut((offsets[row], offsets[row]), (size, size)).copy_from(&into.step);
        for (column, from) in parts.iter().enumerate() {
            let torque = field.stiffness[row][column] * &from.position
                + field.damping[row][column] * &from.velocity
                + field.inertia[row][column] * &from.acceleration;
            let through = -into.field_gain * &into.answer * torque.transpose();
            let mut block =
                whole.view_mut((offsets[row], offsets[column]), (size, from.step.nrows()));
            block += through;
        }
    }
    if axes.is_empty() || !whole.iter().all(|number| number.is_finite()) {
        return f64::NAN;
    }
    let Some(schur) = nalgebra::Schur::try_new(whole, f64::EPSILON, 10_000) else {
        return f64::NAN;
    };
    let largest = schur.complex_eigenvalues().iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    axes.first().map_or(f64::NAN, |axis| largest.ln() / axis.sampling.period_s)
}

/// One axis from sample to sample, the field left open. States: the model's, the volts of the
/// last samples (newest first), the last position of which a difference was taken, its velocity and
/// acceleration estimates.
struct Part {
    /// From the states at a sample to those at the next.
    step: DMatrix<f64>,
    /// What a volt of the answer adds to the states at the next.
    answer: DVector<f64>,
    /// Volts of the answer per torque of the field.
    field_gain: f64,
    /// The position that the law sees, and its estimates of velocity and acceleration, out of the
    /// states.
    position: DVector<f64>,
    velocity: DVector<f64>,
    acceleration: DVector<f64>,
}

impl Part {
    fn new(axis: &Loop, hand: &Hand, raised: f64) -> Self {
        let Sampling { period_s, answer_s, velocity_hz, acceleration_hz, cell_hz } = axis.sampling;
        let (a, b) = axis.model.continuous(hand, cell_hz);
        // Volts that are on their way reach over `whole` periods and a part.
        let whole = (answer_s / period_s + 1e-9).floor().clamp(0.0, 100.0);
        let late_s = (answer_s - whole * period_s).clamp(0.0, period_s);
        let whole = whole as usize;
        // First the older volts for `late_s`, then the newer for the rest of the period.
        let (rest, late) = held(&a, &b, late_s);
        let (free, newer) = held(&a, &b, period_s - late_s);
        let (transition, older) = (&free * rest, &free * late);
        let volts = STATES;
        let [last_at, velocity_at, acceleration_at] = [1, 2, 3].map(|at| volts + whole + at);
        let states = acceleration_at + 1;
        let weight = |hz: f64| -(-std::f64::consts::TAU * hz * period_s).exp_m1();
        let (wv, wa) = (weight(velocity_hz), weight(acceleration_hz));

        // What the law sees and says, as rows over the states.
        let row = |at: usize| DVector::from_fn(states, |index, _| f64::from(u8::from(index == at)));
        let position = match axis.law {
            Law::Force { by_slave: true, .. } => row(1),
            _ => row(0) / axis.gear,
        };
        let velocity = (1.0 - wv) * row(velocity_at) + wv / period_s * (&position - row(last_at));
        let acceleration =
            (1.0 - wa) * row(acceleration_at) + wa / period_s * (&velocity - row(velocity_at));
        let (says, field_gain) = match axis.law {
            Law::Force { gain, share, .. } => {
                let gain = share * raised * gain;
                ((1.0 - share) * row(volts) + gain * row(STATES - 1), gain)
            }
            Law::Position { proportional, derivative } => {
                (-raised * (proportional * &position + derivative * &velocity), 0.0)
            }
        };

        // The newest volts begin to act in this period, or wait.
        let mut answer = row(volts);
        let mut step = DMatrix::zeros(states, states);
        step.view_mut((0, 0), (STATES, STATES)).copy_from(&transition);
        match whole.checked_sub(1) {
            None => answer.rows_mut(0, STATES).copy_from(&newer),
            Some(at) => step.view_mut((0, volts + at), (STATES, 1)).copy_from(&newer),
        }
        step.view_mut((0, volts + whole), (STATES, 1)).copy_from(&older);
        for at in 0..whole {
            step[(volts + at + 1, volts + at)] = 1.0;
        }
        step.row_mut(last_at).copy_from(&position.transpose());
        step.row_mut(velocity_at).copy_from(&velocity.transpose());
        step.row_mut(acceleration_at).copy_from(&acceleration.transpose());
        step += &answer * says.transpose();
        Self { step, answer, field_gain, position, velocity, acceleration }
    }
}

/// What becomes of the states in `time_s`, and what of a volt that is held over it.
fn held(a: &DMatrix<f64>, b: &DVector<f64>, time_s: f64) -> (DMatrix<f64>, DVector<f64>) {
    let states = a.nrows();
    let mut both = DMatrix::zeros(states + 1, states + 1);
    both.view_mut((0, 0), (states, states)).copy_from(&(a * time_s));
    both.view_mut((0, states), (states, 1)).copy_from(&(b * time_s));
    let both = both.exp();
    (
        both.view((0, 0), (states, states)).into_owned(),
        both.view((0, states), (states, 1)).column(0).into_owned(),
    )
}
