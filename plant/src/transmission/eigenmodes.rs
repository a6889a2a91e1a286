//! Undamped modes of four masses in a ring: master, slave and the middles of the two lines. They
//! determine the internal step.

use nalgebra::Matrix4;

/// Angular frequencies, rad/s, ascending; the first is the rigid-body motion.
///
/// Pairs are of master and slave: `inertia` (kg·m²), the stiffness between the middle of a line and
/// either end (N/m), the displacement of the line per angle (m/rad).
pub(super) fn modes(
    [master, slave]: [f64; 2],
    line_kg: f64,
    half_lines: [f64; 2],
    displacements: [f64; 2],
) -> [f64; 4] {
    let masses = [master, slave, line_kg, line_kg];
    let mut stiffness = Matrix4::<f64>::zeros();
    for side in 0..2 {
        let (displacement, half_line) = (displacements[side], half_lines[side]);
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
