//! The same fit over what the thesis leaves open: the movement's amplitude, and the friction.

use rayon::prelude::*;

use super::{
    PRINTED_RANGE_HZ, Prediction, fit_softening, measured_resonance_hz, near, predict,
    predict_response,
};
use crate::error::Result;
use crate::line::{Line, MEASURED_FRICTION_NM};

/// Amplitudes of the master's sine, degrees; none is printed.
pub const AMPLITUDES_DEG: [f64; 7] = [10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0];

/// Which friction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Friction {
    /// As § 3.2.1 prints it.
    Printed,
    /// Scaled so that the model's static friction at the motor is what § 5.2.2 measured.
    Measured,
    /// Half-way between.
    Between,
}

impl Friction {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Printed, Self::Between, Self::Measured];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Printed => "printed",
            Self::Measured => "measured",
            Self::Between => "between",
        }
    }

    /// By how much the printed friction is multiplied.
    pub fn share(self) -> f64 {
        let measured =
            MEASURED_FRICTION_NM / Line::printed().parameters.static_friction_at_motor_nm();
        match self {
            Self::Printed => 1.0,
            Self::Measured => measured,
            Self::Between => 0.5 * (1.0 + measured),
        }
    }
}

/// One combination, fitted separately.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Amplitude, degrees.
    pub amplitude_deg: f64,
    /// Friction.
    pub friction: Friction,
    /// The softening that gives the measured resonance; none where no softening does.
    pub factor: Option<f64>,
    /// What the line as printed predicts.
    pub printed: Prediction,
    /// What the softened one predicts.
    pub traced: Prediction,
}

impl Cell {
    /// Its name.
    pub fn name(&self) -> String {
        format!("{:.0}deg_{}_friction", self.amplitude_deg, self.friction.name())
    }
}

/// Fits and predicts in every cell; calls `done` after each.
///
/// # Errors
/// Where a constant is out of range.
pub fn grid(amplitudes_deg: &[f64], done: impl Fn() + Sync) -> Result<Vec<Cell>> {
    let target = measured_resonance_hz()?;
    let cells: Vec<(Friction, f64)> = Friction::ALL
        .iter()
        .flat_map(|friction| amplitudes_deg.iter().map(|a| (*friction, *a)))
        .collect();
    cells
        .par_iter()
        .map(|(friction, amplitude_deg)| {
            let line = Line::printed().with_friction(friction.share()).at_amplitude(*amplitude_deg);
            let factor = fit_softening(&line, target)?;
            let traced = match factor {
                Some(factor) => predict(&line.clone().softened(factor), near(target))?,
                None => Prediction::default(),
            };
            let printed = predict_response(&line, PRINTED_RANGE_HZ)?;
            done();
            Ok(Cell { amplitude_deg: *amplitude_deg, friction: *friction, factor, printed, traced })
        })
        .collect()
}
