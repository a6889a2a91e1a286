//! The cable's fit over what the thesis leaves open: the movement's amplitude, and the damping.

use anyhow::Result;
use plant::cable::Parameters;
use rayon::prelude::*;

use super::{fit, measured};
use crate::plots::cable::Cable;
use crate::simulated_response::cut_off;
use crate::table_row::{Role, Row};

/// Amplitudes of the slave if the cables were rigid, degrees; none is printed. At smaller ones
/// friction holds the slave at some frequencies, and there is no single peak.
pub const AMPLITUDES_DEG: [f64; 2] = [20.0, 30.0];
/// Damping of each half of a cable (N·s/m): as declared, and so much that the gain at the peak
/// halves.
pub const DAMPINGS: [f64; 2] = [0.6, 5.0];
/// Factors on the printed stiffness between which the fit looks.
const FACTORS: (f64, f64) = (1.0 / 25.0, 1.0 / 90.0);

/// One combination, with the stiffness fitted separately.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CableCell {
    /// Amplitude of the slave where the cables are rigid, degrees.
    pub amplitude_deg: f64,
    /// Damping of each half of a cable (N·s/m).
    pub damping_n_s_per_m: f64,
    /// Factor on the printed stiffness that gives the measured resonance; none where none does.
    pub factor: Option<f64>,
    /// Gain there, over the mechanical ratio.
    pub peak_gain: Option<f64>,
    /// Where the gain falls below 0.707, Hz.
    pub cut_off_hz: Option<f64>,
}

/// Fits and predicts in every cell; calls `done` after each.
///
/// # Errors
/// Where a constant is out of range.
pub fn cells(done: impl Fn() + Sync) -> Result<Vec<CableCell>> {
    let target = measured("cable.resonance_hz")?;
    let open: Vec<(f64, f64)> = DAMPINGS
        .iter()
        .flat_map(|damping| AMPLITUDES_DEG.iter().map(|amplitude| (*damping, *amplitude)))
        .collect();
    open.par_iter()
        .map(|(damping, amplitude)| {
            let cable = |factor: f64| Cable {
                parameters: Parameters {
                    cable_stiffness_factor: factor,
                    cable_damping_n_s_per_m: *damping,
                    ..Parameters::printed()
                },
                slave_amplitude_deg: *amplitude,
            };
            let found = fit(target, FACTORS.0, FACTORS.1, cable)?;
            let (factor, top) = found.unzip();
            let peak_hz = top.and_then(|top| top.frequency_hz());
            let cut_off_hz = cut_off(&cable(factor.unwrap_or(1.0)), peak_hz)?;
            done();
            Ok(CableCell {
                amplitude_deg: *amplitude,
                damping_n_s_per_m: *damping,
                factor,
                peak_gain: top.and_then(|top| top.gain()),
                cut_off_hz,
            })
        })
        .collect()
}

/// The cells' rows.
pub fn rows(cells: &[CableCell]) -> Vec<Row> {
    let mut rows = Vec::new();
    for cell in cells {
        let name = format!(
            "own.cable.grid.{:.0}deg_{:.1}ns_per_m",
            cell.amplitude_deg, cell.damping_n_s_per_m
        );
        for (what, unit, role, value) in [
            ("cable_stiffness_factor", "1", Role::Fitted, cell.factor),
            ("peak_gain", "1", Role::Predicted, cell.peak_gain),
            ("cutoff_hz", "Hz", Role::Predicted, cell.cut_off_hz),
        ] {
            rows.push(Row::own(format!("{name}.{what}"), "5.7", unit, [None, value]).role(role));
        }
    }
    rows
}

/// Smallest and largest cut-off over the cells, Hz; `None` where a cell has none.
pub fn cut_off_range_hz(cells: &[CableCell]) -> Option<(f64, f64)> {
    let cuts: Vec<f64> = cells.iter().map(|cell| cell.cut_off_hz).collect::<Option<_>>()?;
    let low = cuts.iter().copied().reduce(f64::min)?;
    Some((low, cuts.iter().copied().fold(low, f64::max)))
}
