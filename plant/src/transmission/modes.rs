//! Undamped modes of four masses in a ring: master, slave and the middles of the two lines. They
//! determine the internal step.

use nalgebra::Matrix4;

use super::TransmissionParameters;

/// Angular frequencies, rad/s, ascending; the first is the rigid-body motion.
///
/// `extra_inertia` (kg·m²) is added to master and slave; the links are `stiffer` by a factor.
pub(crate) fn modes_rad_s<P: TransmissionParameters + ?Sized>(
    parameters: &P,
    extra_inertia: [f64; 2],
    stiffer: f64,
) -> [f64; 4] {
    let [master, slave] = parameters.inertia_kg_m2();
    let line = parameters.middle_mass_kg();
    let masses = [master + extra_inertia[0], slave + extra_inertia[1], line, line];
    let half_lines = parameters.half_line_stiffness_n_per_m();
    let displacements = parameters.displacement_m_per_rad();
    let mut stiffness = Matrix4::<f64>::zeros();
    for side in 0..2 {
        let (displacement, half_line) = (displacements[side], stiffer * half_lines[side]);
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
