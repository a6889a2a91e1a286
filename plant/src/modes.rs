//! Undamped modes of four masses in a ring: master, slave and the middles of two lines. They set
//! the internal step.

use nalgebra::Matrix4;

/// Angular frequencies, rad/s, ascending; the first is the movement of the whole.
///
/// `inertia` of master and slave, kg·m²; `line_mass_kg` of each line; `half_line_n_per_m`, the
/// stiffness between a line's middle and the master's, the slave's end; `displacement_m_per_rad` of
/// the line per angle of master and slave.
pub(crate) fn modes(
    inertia: [f64; 2],
    line_mass_kg: f64,
    half_line_n_per_m: [f64; 2],
    displacement_m_per_rad: [f64; 2],
) -> [f64; 4] {
    let masses = [inertia[0], inertia[1], line_mass_kg, line_mass_kg];
    let mut stiffness = Matrix4::<f64>::zeros();
    for side in 0..2 {
        let (displacement, half_line) = (displacement_m_per_rad[side], half_line_n_per_m[side]);
        for line in [2, 3] {
            stiffness[(side, side)] += half_line * displacement * displacement;
            stiffness[(line, line)] += half_line;
            stiffness[(side, line)] -= half_line * displacement;
            stiffness[(line, side)] -= half_line * displacement;
        }
    }
    let scaled = Matrix4::<f64>::from_fn(|row, column| {
        stiffness[(row, column)] / (masses[row] * masses[column]).sqrt()
    });
    let mut squares: [f64; 4] = scaled.symmetric_eigenvalues().into();
    squares.sort_by(f64::total_cmp);
    squares.map(|square| square.max(0.0).sqrt())
}
