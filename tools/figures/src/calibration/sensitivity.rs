//! Sensitivity study: the calibration repeated over what the thesis does not print, the movement's
//! amplitude and the level of friction.

use anyhow::Result;
use rayon::prelude::*;

use super::{
    PRINTED_RANGE_HZ, Prediction, fit_softening, measured_resonance_hz, near, predict,
    predict_response,
};
use crate::simulated_line::{Line, MEASURED_FRICTION_NM};

/// Amplitudes of the master's sine (degrees). The thesis prints none.
pub const AMPLITUDES_DEG: [f64; 7] = [10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0];

/// Level of friction that the model is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Friction {
    /// The values printed in § 3.2.1.
    Printed,
    /// Scaled so that the model's static friction at the motor equals the value measured in
    /// § 5.2.2.
    Measured,
    /// Mean of the two factors.
    Between,
}

impl Friction {
    /// All levels, in rising order of deviation from the printed one.
    pub const ALL: [Self; 3] = [Self::Printed, Self::Between, Self::Measured];

    /// Name used in file names and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Printed => "printed",
            Self::Measured => "measured",
            Self::Between => "between",
        }
    }

    /// Factor on the printed dry and viscous friction (1).
    pub fn factor(self) -> f64 {
        let measured =
            MEASURED_FRICTION_NM / Line::printed().parameters.static_friction_at_motor_nm();
        match self {
            Self::Printed => 1.0,
            Self::Measured => measured,
            Self::Between => 0.5 * (1.0 + measured),
        }
    }
}

/// Result of the calibration for one combination of amplitude and friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepPoint {
    /// Amplitude of the master's sine (degrees).
    pub amplitude_deg: f64,
    /// Level of friction.
    pub friction: Friction,
    /// Fitted factor on the line's stiffness (1); `None` if no factor gives the measured resonance.
    pub factor: Option<f64>,
    /// Prediction with the printed stiffness.
    pub printed: Prediction,
    /// Prediction with the fitted stiffness; empty if none was fitted.
    pub traced: Prediction,
}

impl SweepPoint {
    /// Name used in tables.
    pub fn name(&self) -> String {
        format!("{:.0}deg_{}_friction", self.amplitude_deg, self.friction.name())
    }
}

/// Calibrates every combination in parallel; calls `on_done` after each.
///
/// # Errors
/// If a parameter leaves its allowed range.
pub fn sensitivity(amplitudes_deg: &[f64], on_done: impl Fn() + Sync) -> Result<Vec<SweepPoint>> {
    let target = measured_resonance_hz()?;
    let cells: Vec<(Friction, f64)> = Friction::ALL
        .iter()
        .flat_map(|friction| amplitudes_deg.iter().map(|a| (*friction, *a)))
        .collect();
    cells
        .par_iter()
        .map(|(friction, amplitude_deg)| {
            let line =
                Line::printed().with_friction(friction.factor()).at_amplitude(*amplitude_deg);
            let factor = fit_softening(&line, target)?;
            let traced = match factor {
                Some(factor) => predict(&line.clone().softened(factor), near(target))?,
                None => Prediction::default(),
            };
            let printed = predict_response(&line, PRINTED_RANGE_HZ)?;
            on_done();
            Ok(SweepPoint {
                amplitude_deg: *amplitude_deg,
                friction: *friction,
                factor,
                printed,
                traced,
            })
        })
        .collect()
}
