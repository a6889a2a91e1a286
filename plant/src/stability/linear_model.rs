//! The transmission as a linear system, dry friction left out.

use nalgebra::{DMatrix, DVector, Matrix3};

use crate::transmission::TransmissionParameters;

/// Coordinates: master, slave, and the two lines as one, for they move together.
const COORDINATES: usize = 3;
/// Positions and speeds of the coordinates, and the torque in the cell.
pub(super) const STATES: usize = 2 * COORDINATES + 1;

/// Impedance of a hand at the handle, about its rest position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hand {
    /// Inertia that goes with the handle (kg·m²).
    pub inertia: f64,
    /// Damping (N·m·s/rad).
    pub damping: f64,
    /// Stiffness (N·m/rad).
    pub stiffness: f64,
}

/// A transmission about rest: the masses of master, slave and lines, the springs between them, what
/// brakes them.
///
/// The slave's dry friction counts as the weakest damper that it is ever worth: the least of
/// friction over speed, up to the speed that the rig allows. Left out: the dry friction of motor
/// and master piston, against which the offset of eq. 4.2.3 works; that of a cable's supports; toe,
/// sag and hysteresis of cables, which are taken at their stiffest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearModel {
    /// Inertia of master, slave (kg·m²), and both lines together (kg).
    mass: [f64; COORDINATES],
    stiffness: Matrix3<f64>,
    damping: Matrix3<f64>,
    /// Motor torque per volt (N·m/V).
    pub torque_per_volt: f64,
}

impl LinearModel {
    /// The model of a transmission whose handle turns no faster than `speed_max` (rad/s).
    pub fn new(parameters: &dyn TransmissionParameters, speed_max: f64) -> Self {
        let [master, slave] = parameters.inertia_kg_m2();
        let damping = parameters.linear_damping(speed_max);
        let mut model = Self {
            mass: [master, slave, 2.0 * parameters.middle_mass_kg()],
            stiffness: Matrix3::zeros(),
            damping: Matrix3::from_diagonal(&damping.into()),
            torque_per_volt: parameters.motor_torque_per_volt_nm(),
        };
        let half_line = parameters.half_line_stiffness_n_per_m();
        let displacement = parameters.displacement_m_per_rad();
        for side in 0..2 {
            let stretch = nalgebra::Vector3::from_fn(|at, _| match at {
                2 => 1.0,
                _ if at == side => -displacement[side],
                _ => 0.0,
            });
            let outer = 2.0 * stretch * stretch.transpose();
            model.stiffness += half_line[side] * outer;
            model.damping += parameters.link_damping_n_s_per_m() * outer;
        }
        model
    }

    /// `ẋ = A x + b V` with a hand at the handle; the last state is the torque that the cell shows
    /// (N·m).
    pub(super) fn continuous(&self, hand: &Hand, cell_hz: f64) -> (DMatrix<f64>, DVector<f64>) {
        let (mut stiffness, mut damping, mut mass) = (self.stiffness, self.damping, self.mass);
        stiffness[(1, 1)] += hand.stiffness;
        damping[(1, 1)] += hand.damping;
        mass[1] += hand.inertia;
        let mut a = DMatrix::zeros(STATES, STATES);
        let mut b = DVector::zeros(STATES);
        for row in 0..COORDINATES {
            a[(row, COORDINATES + row)] = 1.0;
            for column in 0..COORDINATES {
                a[(COORDINATES + row, column)] = -stiffness[(row, column)] / mass[row];
                a[(COORDINATES + row, COORDINATES + column)] = -damping[(row, column)] / mass[row];
            }
        }
        b[COORDINATES] = self.torque_per_volt / mass[0];
        // The cell sits between hand and handle: the hand's inertia goes with the handle, as on the
        // simulated card.
        let (last, corner) = (STATES - 1, std::f64::consts::TAU * cell_hz);
        a[(last, 1)] = -corner * hand.stiffness;
        a[(last, COORDINATES + 1)] = -corner * hand.damping;
        a[(last, last)] = -corner;
        (a, b)
    }
}
