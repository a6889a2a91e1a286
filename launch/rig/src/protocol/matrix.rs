//! A force field over several axes: constant matrices.

use crate::checked_toml::{Bounds, Section, bounds};

/// Axes that a matrix may span.
pub const MATRIX_AXES: usize = 3;

/// Rows are the axes on which the torque acts, columns the axes whose movement causes it; rows and
/// columns beyond `axes` are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Matrix {
    /// Number of axes that it spans, from the first.
    pub axes: usize,
    /// Torque = - stiffness (position - centre) (N·m/rad or N/m).
    pub stiffness: [[f64; MATRIX_AXES]; MATRIX_AXES],
    /// Torque = - damping velocity (N·m·s/rad or N·s/m); the curl is part of it.
    pub damping: [[f64; MATRIX_AXES]; MATRIX_AXES],
    /// Torque = - inertia acceleration (kg·m² or kg).
    pub inertia: [[f64; MATRIX_AXES]; MATRIX_AXES],
    /// Centre of each axis (rad or m).
    pub centres: [f64; MATRIX_AXES],
}

const STIFFNESS: Bounds = bounds(-10.0, 10.0, "N·m/rad, or N/m between axes in m");
const DAMPING: Bounds = bounds(-2.0, 2.0, "N·m·s/rad, or N·s/m between axes in m");
const INERTIA: Bounds = bounds(-0.1, 0.1, "kg·m², or kg between axes in m");
const CENTRE_DEG: Bounds =
    bounds(-120.0, 120.0, "positions lie within ±120° (§ 4.2); the value is in degrees");
const CENTRE_M: Bounds = bounds(-5.0, 5.0, "the value is in m");
const KEYS: [&str; 4] = ["matrix_stiffness", "matrix_damping", "matrix_inertia", "curl"];

impl Matrix {
    /// Reads the matrices of a segment; `None` where it has none.
    pub(super) fn read(section: &Section<'_>) -> Option<Self> {
        let mut matrix = Self::default();
        let mut sizes = Vec::new();
        let [stiffness, damping, inertia, curl] = KEYS;
        for (key, bounds, part) in [
            (stiffness, STIFFNESS, &mut matrix.stiffness),
            (damping, DAMPING, &mut matrix.damping),
            (inertia, INERTIA, &mut matrix.inertia),
        ] {
            if let Some(size) = read_square(section, key, bounds, part) {
                sizes.push((key, size));
            }
        }
        if let Some(curl) = section.number_or_none(curl, DAMPING) {
            // A positive curl pushes a positive movement of the first axis towards positive on the
            // second, one of the second towards negative on the first.
            matrix.damping[0][1] += curl;
            matrix.damping[1][0] -= curl;
            sizes.push((KEYS[3], 2));
        }
        let wide = sizes.iter().map(|(_, size)| *size).max();
        let centres = read_centres(section, wide, &mut matrix.centres);
        let first = sizes.iter().filter(|(key, _)| *key != KEYS[3]).map(|(_, size)| *size).next();
        if let Some((key, size)) =
            sizes.iter().find(|(key, size)| *key != KEYS[3] && Some(*size) != first)
        {
            let expected = format!(
                "as many rows as the segment's other matrices ({})",
                first.unwrap_or_default()
            );
            section.problem(key, expected, size, "give one row for each axis");
        }
        matrix.axes = wide?;
        centres.then_some(matrix)
    }

    /// The keys of a matrix.
    pub(super) fn keys(&self) -> impl Iterator<Item = &'static str> {
        KEYS.into_iter()
    }

    /// Largest torque at rest on an axis, with every axis at the worse of its limits (N·m or N).
    pub(super) fn largest_torque(&self, axis: usize, limits: impl Fn(usize) -> (f64, f64)) -> f64 {
        (0..self.axes)
            .map(|other| {
                let (least, most) = limits(other);
                let centre = self.centres[other];
                self.stiffness[axis][other].abs()
                    * (centre - least).abs().max((most - centre).abs())
            })
            .sum()
    }
}

/// Reads a square matrix into `part`; returns its size.
fn read_square(
    section: &Section<'_>,
    key: &str,
    bounds: Bounds,
    part: &mut [[f64; MATRIX_AXES]; MATRIX_AXES],
) -> Option<usize> {
    let rows = section.rows_or_none(key, "a list of rows, one for each axis", bounds)?;
    let size = rows.len();
    if size > MATRIX_AXES || rows.iter().any(|row| row.len() != size) {
        let lengths: Vec<String> = rows.iter().map(|row| row.len().to_string()).collect();
        let expected = format!("a square matrix of at most {MATRIX_AXES} rows");
        let found = format!("{size} rows of {}", lengths.join(", "));
        return section.refuse(key, expected, found, "two axes: [[1.0, 0.0], [0.0, 1.0]]");
    }
    for (into, row) in part.iter_mut().zip(&rows) {
        for (into, value) in into.iter_mut().zip(row) {
            *into = *value;
        }
    }
    Some(size)
}

/// Reads the centres of a matrix of `wide` rows; false where they are wrong.
fn read_centres(
    section: &Section<'_>,
    wide: Option<usize>,
    centres: &mut [f64; MATRIX_AXES],
) -> bool {
    for (key, bounds, scale) in
        [("centres_deg", CENTRE_DEG, std::f64::consts::PI / 180.0), ("centres_m", CENTRE_M, 1.0)]
    {
        let Some(values) = section.numbers_or_none(key, bounds) else { continue };
        if Some(values.len()) != wide {
            let expected = match wide {
                Some(wide) => format!("{wide} centres, one for each row of the matrix"),
                None => "a matrix that they belong to".to_owned(),
            };
            let advice = "or leave it out: the centre is then 0 on every axis";
            section.problem(key, expected, values.len(), advice);
            return false;
        }
        for (centre, value) in centres.iter_mut().zip(&values) {
            *centre = scale * value;
        }
    }
    true
}
