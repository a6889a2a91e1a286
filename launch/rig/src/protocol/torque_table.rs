//! A torque over position or velocity, given by points.

use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Bounds, Section, bounds};

/// Number of evenly spaced points to which a table is resampled.
pub const POINTS: usize = 17;

/// A torque over position or velocity: linear between evenly spaced points, constant beyond the
/// ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueTable {
    /// Position or speed of the first point (rad or m, rad/s or m/s).
    pub least: f64,
    /// Position or speed of the last point (same unit).
    pub most: f64,
    /// Torques (N·m or N).
    pub torques: [f64; POINTS],
}

const PLACE: Bounds = bounds(
    -3000.0,
    3000.0,
    "each pair is [place, torque]; the place is in the unit that the key's name ends in",
);
/// Places and torques, as in the file.
type Pairs = Vec<(f64, f64)>;

/// Largest number of pairs in a file.
const PAIRS: usize = 64;
/// Largest deviation of the resampled table from a point of the file, over the span of its torques.
const MISS: f64 = 0.02;

impl TorqueTable {
    /// The table under `position_table_deg` or `position_table_m`.
    pub(super) fn of_positions(section: &Section<'_>) -> Option<Self> {
        let (key, scale, pairs) = read(section, ["position_table_deg", "position_table_m"])?;
        let (first, last) = (pairs.first()?.0, pairs.last()?.0);
        Self::resampled(section, key, &pairs, first, last, scale)
    }

    /// The table under `velocity_table_deg_s` or `velocity_table_m_s`, resampled from minus to plus
    /// its highest speed.
    pub(super) fn of_velocities(section: &Section<'_>) -> Option<Self> {
        let (key, scale, pairs) = read(section, ["velocity_table_deg_s", "velocity_table_m_s"])?;
        let fastest = pairs.first()?.0.abs().max(pairs.last()?.0.abs());
        Self::resampled(section, key, &pairs, -fastest, fastest, scale)
    }

    fn resampled(
        section: &Section<'_>,
        key: &str,
        pairs: &[(f64, f64)],
        least: f64,
        most: f64,
        scale: f64,
    ) -> Option<Self> {
        let step = (most - least) / (POINTS - 1) as f64;
        let torques = std::array::from_fn(|point| interpolate(pairs, least + step * point as f64));
        let table = Self { least: scale * least, most: scale * most, torques };
        let span = pairs.iter().map(|pair| pair.1).fold(f64::NEG_INFINITY, f64::max)
            - pairs.iter().map(|pair| pair.1).fold(f64::INFINITY, f64::min);
        for (place, torque) in pairs {
            let kept = table.at(scale * place);
            if (kept - torque).abs() > MISS * span {
                let expected = format!(
                    "points that {POINTS} evenly spaced ones from {least} to {most} come near"
                );
                let advice = format!(
                    "move it to a multiple of {step} from {least}, or make the curve smoother"
                );
                let found = format!("[{place}, {torque}], which would become {kept:.3}");
                return section.refuse(key, expected, found, advice);
            }
        }
        Some(table)
    }

    /// Torque at a position or speed (N·m or N).
    pub fn at(&self, place: f64) -> f64 {
        let share =
            ((place - self.least) / (self.most - self.least)).clamp(0.0, 1.0) * (POINTS - 1) as f64;
        let below = (share as usize).min(POINTS - 2);
        self.torques[below]
            + (share - below as f64) * (self.torques[below + 1] - self.torques[below])
    }

    /// Positions or speeds of its points (rad or m, rad/s or m/s).
    pub fn places(&self) -> impl Iterator<Item = f64> {
        let (least, step) = (self.least, self.step());
        (0..POINTS).map(move |point| least + step * point as f64)
    }

    /// Its lowest and its highest slope (torque per position or speed).
    pub fn slopes(&self) -> (f64, f64) {
        let slopes = self.torques.windows(2).map(|pair| (pair[1] - pair[0]) / self.step());
        slopes.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), slope| {
            (least.min(slope), most.max(slope))
        })
    }

    /// Its largest torque, either way (N·m or N).
    pub fn largest(&self) -> f64 {
        self.torques.iter().map(|torque| torque.abs()).fold(0.0, f64::max)
    }

    fn step(&self) -> f64 {
        (self.most - self.least) / (POINTS - 1) as f64
    }
}

/// Interpolates linearly between the pairs of a file, constant beyond them.
fn interpolate(pairs: &[(f64, f64)], place: f64) -> f64 {
    let after = pairs.partition_point(|pair| pair.0 <= place);
    match (after.checked_sub(1).and_then(|at| pairs.get(at)), pairs.get(after)) {
        (Some(from), Some(to)) => from.1 + (place - from.0) / (to.0 - from.0) * (to.1 - from.1),
        (Some(end), None) | (None, Some(end)) => end.1,
        (None, None) => 0.0,
    }
}

/// Reads the pairs under whichever of two keys is present (degrees, metres), with the factor of
/// their places to SI.
fn read<'k>(
    section: &Section<'_>,
    [degrees, metres]: [&'k str; 2],
) -> Option<(&'k str, f64, Pairs)> {
    let (key, unit) = match section.has(metres) {
        true => {
            section.misplaced(degrees, &format!("`{metres}` alone"), "give the table once");
            (metres, AxisUnit::Metre)
        }
        false => (degrees, AxisUnit::Radian),
    };
    let expected = "a list of pairs [place, torque]";
    let rows = section.rows_or_none(key, expected, PLACE)?;
    let pairs: Option<Pairs> = rows
        .iter()
        .map(|row| match row.as_slice() {
            [place, torque] => Some((*place, *torque)),
            _ => None,
        })
        .collect();
    let Some(pairs) = pairs else {
        let advice = "write it as [[-40, 0.0], [0, 0.5], [40, 0.0]]";
        return section.refuse(key, expected, "a row of another length", advice);
    };
    if pairs.len() < 2 || pairs.len() > PAIRS {
        return section.refuse(
            key,
            format!("2 to {PAIRS} pairs"),
            pairs.len(),
            "two pairs make a line",
        );
    }
    if let Some(wrong) = pairs.windows(2).find(|pair| pair[0].0 >= pair[1].0) {
        let found = format!("{} after {}", wrong[1].0, wrong[0].0);
        let advice = "sort the pairs; no place twice";
        return section.refuse(key, "places that rise from pair to pair", found, advice);
    }
    Some((key, unit.si_per_file_unit(), pairs))
}
