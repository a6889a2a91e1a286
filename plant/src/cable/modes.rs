//! Undamped modes of the four masses: they set the internal step.

use super::Parameters;
use nalgebra::Matrix4;

impl Parameters {
    /// Angular frequencies of the undamped modes with aligned cables without sag, rad/s, ascending; the first is the
    /// movement of the whole.
    ///
    /// Coordinates: master, slave, forward cable, backward cable.
    pub fn modes_rad_s(&self) -> [f64; 4] {
        modes(self, [0.0; 2], 1.0)
    }
}

/// The modes with inertia added at master and slave, and cables stiffer by a factor.
pub(super) fn modes(parameters: &Parameters, extra: [f64; 2], stiffer: f64) -> [f64; 4] {
    let half_line = 2.0 * stiffer * parameters.line_stiffness_n_per_m();
    let middle = parameters.middle_mass_kg();
    let masses = [
        parameters.total_master_inertia_kg_m2() + extra[0],
        parameters.total_slave_inertia_kg_m2() + extra[1],
        middle,
        middle,
    ];
    let mut stiffness = Matrix4::<f64>::zeros();
    for (side, radius) in [(0, parameters.master_pulley_radius_m), (1, parameters.slave_pulley_radius_m())] {
        for line in [2, 3] {
            stiffness[(side, side)] += half_line * radius * radius;
            stiffness[(line, line)] += half_line;
            stiffness[(side, line)] -= half_line * radius;
            stiffness[(line, side)] -= half_line * radius;
        }
    }
    let scaled =
        Matrix4::<f64>::from_fn(|row, column| stiffness[(row, column)] / (masses[row] * masses[column]).sqrt());
    let mut squares: [f64; 4] = scaled.symmetric_eigenvalues().into();
    squares.sort_by(f64::total_cmp);
    squares.map(|square| square.max(0.0).sqrt())
}
