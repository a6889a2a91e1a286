//! What the constants of every transmission provide, whatever its lines are made of.

use super::eigenmodes::modes;
use crate::effects::LineConstants;
use crate::{ParameterError, ParameterSet};

/// The constants of a transmission of two lines between a motor and a handle, SI.
///
/// Pairs are of master and slave.
pub trait TransmissionParameters: ParameterSet + LineConstants {
    /// Torque of the motor per volt at its amplifier, N·m/V.
    fn motor_torque_per_volt_nm(&self) -> f64;

    /// Inertia of the master and of the slave with its handle, effects left out, kg·m².
    fn inertia_kg_m2(&self) -> [f64; 2];

    /// Mass of the middle of one line, kg.
    fn middle_mass_kg(&self) -> f64;

    /// Displacement of the line per angle of master and slave, m/rad.
    fn displacement_m_per_rad(&self) -> [f64; 2];

    /// Stiffness between the middle of one line and each of its ends, N/m.
    fn half_line_stiffness_n_per_m(&self) -> [f64; 2];

    /// Damping between the middle of one line and each of its ends, N·s/m.
    fn link_damping_n_s_per_m(&self) -> f64;

    /// Friction as viscous coefficients: of master and slave (N·m·s/rad), and of both lines
    /// together (N·s/m). Dry friction of the slave counts by `least_damping` up to `speed_max`
    /// (rad/s); other dry friction is left out.
    fn linear_damping(&self, speed_max: f64) -> [f64; 3];

    /// Name of the parameter to which inertia fixed to the handle adds.
    fn handle_inertia(&self) -> &'static str;

    /// Additions to named parameters that are equivalent to friction added at the slave: a constant
    /// one, `dry_nm`, and one proportional to velocity, `viscous_nm_s`. What the constants cannot
    /// express is left out.
    fn slave_friction_parameters(&self, dry_nm: f64, viscous_nm_s: f64)
    -> Vec<(&'static str, f64)>;

    /// Slave angle per master angle with rigid lines.
    fn transmission_ratio(&self) -> f64;

    /// Friction at the motor of motor and master, and of line and slave, N·m, at a motor velocity
    /// (rad/s, not negative); the friction along the line counts by `line_share` (0 to 1).
    fn friction_at_motor_nm(&self, motor_rad_s: f64, line_share: f64) -> [f64; 2];

    /// Inertia of the slave with its handle, effects left out, kg·m².
    fn slave_inertia_kg_m2(&self) -> f64 {
        self.inertia_kg_m2()[1]
    }

    /// Displacement of the line per angle of the master, m/rad.
    fn master_displacement_m_per_rad(&self) -> f64 {
        self.displacement_m_per_rad()[0]
    }

    /// Angular frequencies of the undamped modes, rad/s, ascending; the first is the rigid-body
    /// motion.
    fn modes_rad_s(&self) -> [f64; 4] {
        self.changed_modes_rad_s([0.0; 2], 1.0)
    }

    /// The modes with inertia (kg·m²) added to master and slave and links `stiffer` by a factor.
    fn changed_modes_rad_s(&self, extra_inertia: [f64; 2], stiffer: f64) -> [f64; 4] {
        let [master, slave] = self.inertia_kg_m2();
        modes(
            [master + extra_inertia[0], slave + extra_inertia[1]],
            self.middle_mass_kg(),
            self.half_line_stiffness_n_per_m().map(|half_line| stiffer * half_line),
            self.displacement_m_per_rad(),
        )
    }

    /// Adds to a parameter.
    ///
    /// # Errors
    /// As [`ParameterSet::set`].
    fn add(&mut self, name: &str, part: f64) -> Result<(), ParameterError> {
        let value = self.get(name).unwrap_or_default();
        self.set(name, value + part)
    }

    /// Fixes an inertia (kg·m²) to the handle, such as that of the hand that holds it.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`] where handle and hand together exceed the range of the model.
    fn load_handle(&mut self, inertia_kg_m2: f64) -> Result<(), ParameterError> {
        self.add(self.handle_inertia(), inertia_kg_m2)
    }
}

/// Speeds at which [`least_damping`] compares friction with a damper.
const SPEEDS: u32 = 100;

/// The weakest damper that a dry friction `level` (N·m over rad/s) is ever equivalent to, up to
/// `speed_max` (rad/s): the least of friction over speed, N·m·s/rad.
pub(crate) fn least_damping(speed_max: f64, level: impl Fn(f64) -> f64) -> f64 {
    let speeds = (1..=SPEEDS).map(|step| speed_max * f64::from(step) / f64::from(SPEEDS));
    let least = speeds.map(|speed| level(speed) / speed).fold(f64::INFINITY, f64::min);
    if least.is_finite() { least.max(0.0) } else { 0.0 }
}
