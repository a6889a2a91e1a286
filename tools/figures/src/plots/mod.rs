//! The figures, one file for each kind; what each shows, drawn and with its numbers.

pub mod cable;
mod curve;
pub mod free_movement;
pub mod friction;
pub mod hose;
pub mod learning;
pub mod position;
pub mod response;
pub mod sines;
mod style;

use anyhow::Result;
use plant::response::LinearSystem;
use report::Colour::{Black, Vermillion};
use report::{Figure, Panels};

use crate::calibration::Calibration;
use crate::guided::Guided;
use crate::learning::Learning;
use crate::simulated_response::Cycle;
use crate::table_row::Row;

/// A figure of the thesis, drawn from the models.
#[derive(Debug)]
pub struct Plot {
    /// Its number in the thesis.
    pub number: &'static str,
    /// What it is about.
    pub title: &'static str,
    /// What it shows and how it was made, in plain words.
    pub caption: String,
    /// Its panels.
    pub panels: Panels,
    /// Numbers read off it.
    pub rows: Vec<Row>,
}

/// What is computed once and drawn in several figures.
#[derive(Debug)]
pub struct Common {
    /// The line as traced, and what was found on the way.
    pub calibration: Calibration,
    /// Linear systems fitted to our own responses: printed constants and traced, at 10 m.
    pub fitted: [Option<LinearSystem>; 2],
    /// The same with 1 m of hose.
    pub fitted_short: [Option<LinearSystem>; 2],
    /// Iterative learning on the lock-step rig.
    pub learning: Learning,
    /// Guided movement under each law of position control.
    pub guided: Guided,
}

/// Time within the cycle, s, with master and slave in degrees.
fn columns(cycle: &Cycle) -> [Vec<f64>; 3] {
    let start = match cycle.motion.as_slice() {
        [first, second, ..] => 2.0 * first.time_s - second.time_s,
        _ => 0.0,
    };
    let of = |value: fn(&plant::transmission::Motion) -> f64| {
        cycle.motion.iter().map(value).collect::<Vec<_>>()
    };
    [
        cycle.motion.iter().map(|motion| motion.time_s - start).collect(),
        of(|motion| motion.master_position_rad.to_degrees()),
        of(|motion| motion.slave_position_rad.to_degrees()),
    ]
}

/// Master, over a ratio, and slave along one settled cycle.
fn over_cycle(title: &str, cycle: &Cycle, (name, ratio): (&str, f64)) -> Figure {
    let [time, master, slave] = columns(cycle);
    let master: Vec<f64> = master.iter().map(|angle| angle / ratio).collect();
    style::axes(title, "time / s", "position / °")
        .line(Black, name, &time, &master)
        .dashed(Vermillion, "slave", &time, &slave)
}

/// Angles in degrees.
fn degrees(radians: &[f64]) -> Vec<f64> {
    radians.iter().map(|angle| angle.to_degrees()).collect()
}

/// Draws one figure.
pub type PlotFunction = fn(&Common) -> Result<Plot>;

/// Every figure that the models can draw, in the order of the thesis.
pub const PLOTS: &[PlotFunction] = &[
    friction::laws,
    sines::movement,
    response::ten_metres,
    hose::diameter,
    hose::length,
    response::one_metre,
    position::movement,
    free_movement::movement,
    position::feedforward,
    learning::monotonicity,
    learning::learning,
    learning::before_and_after,
    cable::extension,
    cable::loops,
    cable::static_friction,
    cable::pretension,
    response::measured,
    cable::movement,
];
