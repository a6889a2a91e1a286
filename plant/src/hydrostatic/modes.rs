//! Undamped modes of the hydrostatic transmission.

use super::Parameters;

impl Parameters {
    /// Angular frequencies of the undamped modes, rad/s, ascending; the first is the movement of
    /// the whole.
    ///
    /// Coordinates: master, slave, line 1, line 2.
    pub fn modes_rad_s(&self) -> [f64; 4] {
        modes(self, 0.0, 0.0)
    }
}

/// The modes with inertia added at either side.
pub(crate) fn modes(parameters: &Parameters, extra_master: f64, extra_slave: f64) -> [f64; 4] {
    crate::modes::modes(
        [
            parameters.master_inertia_kg_m2() + extra_master,
            parameters.slave_inertia_kg_m2() + extra_slave,
        ],
        parameters.fluid_mass_kg(),
        parameters.half_line_stiffness_n_per_m(),
        [parameters.master_displacement_m_per_rad(), parameters.slave_displacement_m_per_rad()],
    )
}
