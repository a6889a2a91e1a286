//! Undamped modes of the four masses: they set the internal step.

use super::Parameters;
use nalgebra::Matrix4;

impl Parameters {
    /// Angular frequencies of the undamped modes, rad/s, ascending; the first is the movement of the whole.
    ///
    /// Coordinates: master, slave, line 1, line 2.
    pub fn modes_rad_s(&self) -> [f64; 4] {
        modes(self, 0.0, 0.0)
    }
}

/// The modes with inertia added at either side.
pub(crate) fn modes(parameters: &Parameters, extra_master: f64, extra_slave: f64) -> [f64; 4] {
    let half_lines = parameters.half_line_stiffness_n_per_m();
    let (a_m, a_s) = (parameters.master_displacement_m_per_rad(), parameters.slave_displacement_m_per_rad());
    let masses = [
        parameters.master_inertia_kg_m2() + extra_master,
        parameters.slave_inertia_kg_m2() + extra_slave,
        parameters.fluid_mass_kg(),
        parameters.fluid_mass_kg(),
    ];
    let mut stiffness = Matrix4::<f64>::zeros();
    for (side, displacement, half_line) in [(0, a_m, half_lines[0]), (1, a_s, half_lines[1])] {
        for line in [2, 3] {
            stiffness[(side, side)] += half_line * displacement * displacement;
            stiffness[(line, line)] += half_line;
            stiffness[(side, line)] -= half_line * displacement;
            stiffness[(line, side)] -= half_line * displacement;
        }
    }
    let scaled =
        Matrix4::<f64>::from_fn(|row, column| stiffness[(row, column)] / (masses[row] * masses[column]).sqrt());
    let mut squares: [f64; 4] = scaled.symmetric_eigenvalues().into();
    squares.sort_by(f64::total_cmp);
    squares.map(|square| square.max(0.0).sqrt())
}
