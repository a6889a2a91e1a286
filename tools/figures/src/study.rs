//! Computes all results.

use anyhow::Result;
use plant::response::LinearSystem;
use rayon::prelude::*;

use crate::calibration::alternatives::{Alternative, FITTED, alternatives};
use crate::calibration::cable::{self, CableCell};
use crate::calibration::conclusions::{Conclusion, conclusions};
use crate::calibration::sensitivity::{AMPLITUDES_DEG, Friction, SweepPoint, sensitivity};
use crate::calibration::{SHORT_M, calibrate, table_rows};
use crate::guided;
use crate::learning::{PARTS, learn};
use crate::plots::{Common, PLOTS, Plot};
use crate::simulated_line::Line;
use crate::simulated_response::{logarithmic, sweep};
use crate::table_row::Row;

/// All results.
#[derive(Debug)]
pub struct Study {
    /// What all figures share.
    pub common: Common,
    /// The figures.
    pub plots: Vec<Plot>,
    /// The fit over amplitude and friction.
    pub cells: Vec<SweepPoint>,
    /// The cable's fit over amplitude and damping.
    pub cable: Vec<CableCell>,
    /// Alternative explanations.
    pub alternatives: Vec<Alternative>,
    /// The statements, and where they fail.
    pub conclusions: Vec<Conclusion>,
    /// All rows, of the figures and the calibration.
    pub rows: Vec<Row>,
}

/// How many times [`study`] calls `done`.
pub const STEPS: usize = 2
    + guided::PARTS
    + PLOTS.len()
    + PARTS
    + AMPLITUDES_DEG.len() * Friction::ALL.len()
    + FITTED
    + cable::AMPLITUDES_DEG.len() * cable::DAMPINGS.len();

/// Computes everything; calls `done` after each part.
///
/// # Errors
/// Where a constant is out of range, or no softening gives the measured resonance.
pub fn study(done: impl Fn() + Sync) -> Result<Study> {
    // One after the other, calibration leaves a core idle.
    let (calibration, (learning, guided)) =
        rayon::join(calibrate, || rayon::join(|| learn(&done), || guided::laws(&done)));
    let (calibration, learning) = (calibration?, learning?);
    let guided = guided?.with_learnt(&learning);
    done();
    let lines = [Line::printed(), calibration.line.clone()];
    let fit = |line: &Line, low: f64, high: f64| -> Result<Option<LinearSystem>> {
        // A response that no such system comes near has no fit; that is a result.
        Ok(LinearSystem::fit(&sweep(line, &logarithmic(low, high, FIT_POINTS))?).ok())
    };
    let [printed, traced] = &lines;
    let short = lines.clone().map(|line| line.with_length(SHORT_M));
    let common = Common {
        fitted: [fit(printed, 0.2, 24.0)?, fit(traced, 0.2, 24.0)?],
        fitted_short: [fit(&short[0], 0.2, 250.0)?, fit(&short[1], 0.2, 100.0)?],
        calibration,
        learning,
        guided,
    };
    done();
    let (figures, calibration_results) = rayon::join(
        || {
            PLOTS
                .par_iter()
                .map(|draw| {
                    let plot = draw(&common);
                    done();
                    plot
                })
                .collect::<Result<Vec<Plot>>>()
        },
        || {
            let cells = sensitivity(&AMPLITUDES_DEG, &done)?;
            let alternatives =
                alternatives(common.calibration.factor, common.calibration.traced, &done)?;
            anyhow::Ok((cells, alternatives, cable::cells(&done)?))
        },
    );
    let plots = figures?;
    let (cells, alternatives, cable) = calibration_results?;
    let conclusions = conclusions(&cells, common.calibration.factor)?;
    let mut all: Vec<Row> = plots.iter().flat_map(|figure| figure.rows.clone()).collect();
    all.extend(table_rows::rows(&common.calibration, &cells, &alternatives, &conclusions)?);
    all.extend(cable::rows(&cable));
    all.extend(common.guided.rows());
    Ok(Study { common, plots, cells, cable, alternatives, conclusions, rows: all })
}

/// Points of a response to which a linear system is fitted.
const FIT_POINTS: usize = 60;
