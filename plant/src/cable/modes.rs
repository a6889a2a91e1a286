//! Undamped modes of the cable transmission.

use super::Parameters;

impl Parameters {
    /// Angular frequencies of the undamped modes with aligned cables without sag, rad/s, ascending;
    /// the first is the movement of the whole.
    ///
    /// Coordinates: master, slave, forward cable, backward cable.
    pub fn modes_rad_s(&self) -> [f64; 4] {
        modes(self, [0.0; 2], 1.0)
    }
}

/// The modes with inertia added at master and slave, and cables stiffer by a factor.
pub(super) fn modes(parameters: &Parameters, extra: [f64; 2], stiffer: f64) -> [f64; 4] {
    let half_line = 2.0 * stiffer * parameters.line_stiffness_n_per_m();
    crate::modes::modes(
        [
            parameters.total_master_inertia_kg_m2() + extra[0],
            parameters.total_slave_inertia_kg_m2() + extra[1],
        ],
        parameters.middle_mass_kg(),
        [half_line; 2],
        [parameters.master_pulley_radius_m, parameters.slave_pulley_radius_m()],
    )
}
