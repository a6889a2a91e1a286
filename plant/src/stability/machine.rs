//! The transmission as a linear system: what stays of it when dry friction is left out.

use nalgebra::{DMatrix, DVector, Matrix3};

use super::Hand;
use crate::any::Parameters;

/// Coordinates: master, slave, and the two lines as one, for they move together.
const COORDINATES: usize = 3;
/// Speeds at which friction is held against a damper.
const SPEEDS: u32 = 100;
/// Positions and speeds of the coordinates, and the torque in the cell.
pub(super) const STATES: usize = 2 * COORDINATES + 1;

/// A transmission about rest: the masses of master, slave and lines, the springs between them, what
/// brakes them.
///
/// The slave's dry friction counts as the weakest damper that it is ever worth: the least of
/// friction over speed, up to the speed that the rig allows. Left out: the dry friction of motor
/// and master piston, against which the offset of eq. 4.2.3 works; that of a cable's supports; toe,
/// sag and hysteresis of cables, which are taken at their stiffest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Machine {
    /// Inertia of master, slave (kg·m²), and both lines together (kg).
    mass: [f64; COORDINATES],
    stiffness: Matrix3<f64>,
    damping: Matrix3<f64>,
    /// Motor torque per volt (N·m/V).
    pub torque_per_volt: f64,
}

impl Machine {
    /// A transmission whose handle turns no faster than `speed_max` (rad/s).
    pub fn new(parameters: &Parameters, speed_max: f64) -> Self {
        let weakest = |level: &dyn Fn(f64) -> f64| {
            let speeds = (1..=SPEEDS).map(|step| speed_max * f64::from(step) / f64::from(SPEEDS));
            let least = speeds.map(|speed| level(speed) / speed).fold(f64::INFINITY, f64::min);
            if least.is_finite() { least.max(0.0) } else { 0.0 }
        };
        match parameters {
            Parameters::Hydrostatic(own) => Self::of_lines(
                [own.master_inertia_kg_m2(), own.slave_inertia_kg_m2(), 2.0 * own.fluid_mass_kg()],
                own.half_line_stiffness_n_per_m(),
                own.port_damping_n_s_per_m,
                [own.master_displacement_m_per_rad(), own.slave_displacement_m_per_rad()],
                [
                    own.motor_viscous_nm_s,
                    weakest(&|speed| own.slave_friction().level(speed)),
                    2.0 * own.pipe().coefficient(0.0),
                ],
                own.motor_torque_per_volt_nm,
            ),
            Parameters::Cable(own) => {
                let (master, slave) = (own.master_pulley_radius_m, own.slave_pulley_radius_m());
                let viscous = own.cables * own.support_viscous_n_s_per_m;
                let inner = (own.supports() - 2.0).max(0.0);
                Self::of_lines(
                    [
                        own.total_master_inertia_kg_m2(),
                        own.total_slave_inertia_kg_m2(),
                        2.0 * own.middle_mass_kg(),
                    ],
                    [2.0 * own.line_stiffness_n_per_m(); 2],
                    own.cables * own.cable_damping_n_s_per_m,
                    [master, slave],
                    [
                        own.motor_viscous_nm_s + 2.0 * viscous * master * master,
                        2.0 * viscous * slave * slave + weakest(&|_| own.slave_bearing_nm),
                        2.0 * viscous * inner,
                    ],
                    own.motor_torque_per_volt_nm,
                )
            }
        }
    }

    /// `half_line` and `link_damping` belong to one line's link to master and slave, `displacement`
    /// is the line's per angle of either, `viscous` what brakes each coordinate against the ground.
    fn of_lines(
        mass: [f64; COORDINATES],
        half_line: [f64; 2],
        link_damping: f64,
        displacement: [f64; 2],
        viscous: [f64; COORDINATES],
        torque_per_volt: f64,
    ) -> Self {
        let mut machine = Self {
            mass,
            stiffness: Matrix3::zeros(),
            damping: Matrix3::from_diagonal(&viscous.into()),
            torque_per_volt,
        };
        for side in 0..2 {
            let stretch = nalgebra::Vector3::from_fn(|at, _| match at {
                2 => 1.0,
                _ if at == side => -displacement[side],
                _ => 0.0,
            });
            let outer = 2.0 * stretch * stretch.transpose();
            machine.stiffness += half_line[side] * outer;
            machine.damping += link_damping * outer;
        }
        machine
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
        // virtual card.
        let (last, corner) = (STATES - 1, std::f64::consts::TAU * cell_hz);
        a[(last, 1)] = -corner * hand.stiffness;
        a[(last, COORDINATES + 1)] = -corner * hand.damping;
        a[(last, last)] = -corner;
        (a, b)
    }
}
