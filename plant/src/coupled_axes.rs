//! One to three transmissions at one handle.
//!
//! Each axis has its own transmission; they share the handle. Its inertia matrix is constant and
//! symmetric: the diagonal is in the axes' own constants, [`HandleCoupling`] is the rest (a product
//! of inertia, a link that turns about two axes). With the slaves' inertia `I_i`, the coupling `C`
//! and all other torque `τ_i` on slave `i`, friction included:
//!
//! ```text
//! I_i q̈_i + Σ_j C_ij q̈_j = τ_i          (i ≠ j)
//! ```
//!
//! In each internal step the masters move first, then all slaves together, then the lines. The
//! torque that the others exert on an axis uses the accelerations of the same step, so that it
//! neither lags nor adds energy: each slave in turn is moved by [`crate::friction::advance`], with
//! exact stick, until none changes (Gauss-Seidel). As each such move minimises a convex function
//! and the inertia matrix is positive definite, the iteration converges to the unique solution; its
//! rate depends on the matrix alone, and [`LEAST_EIGENVALUE`] bounds it.
//!
//! ```
//! use plant::coupled_axes::{HandleCoupling, Plant};
//! use plant::transmission::Input;
//! use plant::transmission_kinds;
//!
//! let axis = || transmission_kinds::Kind::Hydrostatic.calibrated().plant(Vec::new());
//! let mut plant = Plant::new(vec![axis()?, axis()?], &HandleCoupling::of_pairs(2, &[4e-4])?)?;
//! let push = Input { motor_v: 8.0, hand_torque_nm: 0.0 };
//! plant.step(&[push, Input::default()], 0.2);
//! assert!(plant.motion(0).slave_position_rad > 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::friction::{Advance, Load, advance};
use crate::handle_inertia::PAIRS;
pub use crate::handle_inertia::{AXES, CouplingError, HandleCoupling, LEAST_EIGENVALUE};
use crate::transmission::{EnergyBalance, Input, Motion, Reading, Transmission, sub_steps};
use crate::transmission_kinds;

/// Maximum number of iterations; about 60 are needed at the strongest coupling allowed.
const ITERATIONS: usize = 200;
/// Converged when no slave changes its velocity by more than this part of the fastest one's ...
const PRECISION: f64 = 1e-13;
/// ... or of this (rad/s), so that rounding errors near rest do not prevent convergence.
const SLOW_RAD_S: f64 = 0.01;

/// One to three transmissions at one handle, in motion.
#[derive(Clone, Debug)]
pub struct Plant {
    axes: Vec<transmission_kinds::Plant>,
    coupling: HandleCoupling,
    coupled: bool,
    longest_step_s: f64,
    /// Change of the slaves' velocities over the last internal step: start of the iteration.
    increments: [f64; AXES],
    coupled_at_start_j: f64,
}

impl Plant {
    /// Joins transmissions at one handle; their effects may add to its products of inertia.
    ///
    /// # Errors
    /// [`CouplingError`].
    pub fn new(
        axes: Vec<transmission_kinds::Plant>,
        coupling: &HandleCoupling,
    ) -> Result<Self, CouplingError> {
        if !(1..=AXES).contains(&axes.len()) {
            return Err(CouplingError::Axes { found: axes.len() });
        }
        let (mut inertia, mut coupling) = ([0.0; AXES], *coupling);
        for (at, (inertia, axis)) in inertia.iter_mut().zip(&axes).enumerate() {
            *inertia = axis.slave_inertia_kg_m2();
            let others = axis.handle_coupling_kg_m2();
            if axes.len() == 1 && others != [0.0; AXES] {
                return Err(CouplingError::Alone);
            }
            let others = others.into_iter().enumerate().take(axes.len());
            others.for_each(|(other, product)| {
                coupling.set((at, other), coupling.between(at, other) + product);
            });
        }
        let least = coupling.check(&inertia[..axes.len()])?;
        let longest = axes
            .iter()
            .map(transmission_kinds::Plant::longest_step_s)
            .fold(f64::INFINITY, f64::min);
        let mut plant = Self {
            // A handle with less inertia in some direction oscillates faster there, at most by the
            // inverse root of the least eigenvalue.
            longest_step_s: longest * least.min(1.0).sqrt(),
            coupled: axes.len() > 1 && !coupling.is_none(),
            axes,
            coupling,
            increments: [0.0; AXES],
            coupled_at_start_j: 0.0,
        };
        plant.coupled_at_start_j = plant.coupled_j();
        Ok(plant)
    }

    /// Number of axes.
    pub fn count(&self) -> usize {
        self.axes.len()
    }

    /// The transmission of an axis; none where there is no such axis.
    pub fn axis(&self, axis: usize) -> Option<&transmission_kinds::Plant> {
        self.axes.get(axis)
    }

    /// Longest internal step while the axes are coupled (s).
    pub fn longest_step_s(&self) -> f64 {
        self.longest_step_s
    }

    /// Puts an axis at rest at this position of its slave (rad), its line unstrained. Call before
    /// the first step; does nothing where there is no such axis.
    pub fn rest_at(&mut self, axis: usize, slave_rad: f64) {
        /// Trial position of the master, for the ratio of the line (rad).
        const TRIAL_RAD: f64 = 1e-3;
        let Some(plant) = self.axes.get_mut(axis) else { return };
        plant.rest_at(TRIAL_RAD, None);
        let ratio = plant.motion().slave_position_rad / TRIAL_RAD;
        plant.rest_at(slave_rad / ratio, None);
    }

    /// Takes over positions, velocities, time and breakdowns of another machine with the same axes.
    /// Lines with a history, and other effects with an inner state, begin anew.
    pub fn go_on_from(&mut self, other: &Self) {
        for (axis, from) in self.axes.iter_mut().zip(&other.axes) {
            axis.take_over_breakdowns(from);
            axis.set_state(*from.state());
        }
        self.coupled_at_start_j = self.coupled_j();
    }

    /// Ends the breakdown of that number ([`crate::effects::breakdowns`]): what it did ends, what
    /// it left behind stays. Allocates nothing.
    pub fn end_breakdown(&mut self, number: u64) {
        self.axes.iter_mut().for_each(|axis| axis.end_breakdown(number));
    }

    /// Motion of an axis; all zero where there is no such axis.
    pub fn motion(&self, axis: usize) -> Motion {
        self.axes.get(axis).map_or_else(Motion::default, Transmission::motion)
    }

    /// What the instruments of an axis read; all zero where there is no such axis.
    pub fn reading(&self, axis: usize) -> Reading {
        self.axes.get(axis).map_or_else(Reading::default, Transmission::reading)
    }

    /// Advances all axes by `dt_s` (s) with their inputs held, one per axis; an axis without one
    /// has 0 V and no hand. Does nothing unless `dt_s` is positive. Allocates nothing.
    pub fn step(&mut self, inputs: &[Input], dt_s: f64) {
        let input = |axis: usize| inputs.get(axis).copied().unwrap_or_default();
        if !self.coupled {
            for (axis, plant) in self.axes.iter_mut().enumerate() {
                plant.step(input(axis), dt_s);
            }
            return;
        }
        let (count, step) = sub_steps(dt_s, self.longest_step_s);
        for _ in 0..count {
            let mut pending = [const { None }; AXES];
            let mut loads = [Load::default(); AXES];
            let mut speeds = [0.0; AXES];
            for (axis, plant) in self.axes.iter_mut().enumerate() {
                speeds[axis] = plant.motion().slave_velocity_rad_s;
                let begun = plant.begin(input(axis), step);
                (loads[axis], pending[axis]) = (begun.load, Some(begun));
            }
            let slaves = self.move_slaves(&speeds, &loads, step);
            for ((axis, plant), begun) in self.axes.iter_mut().enumerate().zip(&pending) {
                self.increments[axis] = slaves[axis].velocity - speeds[axis];
                if let Some(begun) = begun {
                    plant.complete(begun, slaves[axis]);
                }
            }
        }
        for (axis, plant) in self.axes.iter_mut().enumerate() {
            plant.read(input(axis));
        }
    }

    /// Moves all slaves over one internal step, each with the torque of the others' accelerations.
    fn move_slaves(
        &self,
        speeds: &[f64; AXES],
        loads: &[Load; AXES],
        step: f64,
    ) -> [Advance; AXES] {
        let count = self.axes.len();
        let mut slaves: [Advance; AXES] = std::array::from_fn(|axis| Advance {
            velocity: speeds[axis] + self.increments[axis],
            displacement: 0.0,
            dissipated: 0.0,
        });
        for _ in 0..ITERATIONS {
            let (mut change, mut fastest) = (0.0_f64, SLOW_RAD_S);
            for axis in 0..count {
                let mut load = loads[axis];
                for other in (0..count).filter(|&other| other != axis) {
                    let acceleration = (slaves[other].velocity - speeds[other]) / step;
                    load.force -= self.coupling.between(axis, other) * acceleration;
                }
                let moved = advance(speeds[axis], step, &load);
                change = change.max((moved.velocity - slaves[axis].velocity).abs());
                fastest = fastest.max(moved.velocity.abs()).max(speeds[axis].abs());
                slaves[axis] = moved;
            }
            // NaN ends the iteration as well.
            if change <= PRECISION * fastest || change.is_nan() {
                break;
            }
        }
        slaves
    }

    /// Kinetic energy that the coupling adds to that of the axes (J); may be negative.
    fn coupled_j(&self) -> f64 {
        let speed = |axis: usize| self.motion(axis).slave_velocity_rad_s;
        PAIRS
            .iter()
            .map(|&(row, column)| self.coupling.between(row, column) * speed(row) * speed(column))
            .sum()
    }

    /// Energy balance of all axes since the start, the handle's coupling included.
    pub fn energy(&self) -> EnergyBalance {
        let start = EnergyBalance {
            stored_j: self.coupled_j() - self.coupled_at_start_j,
            ..EnergyBalance::default()
        };
        self.axes.iter().map(Transmission::energy).fold(start, |sum, axis| EnergyBalance {
            input_j: sum.input_j + axis.input_j,
            stored_j: sum.stored_j + axis.stored_j,
            dissipated_j: sum.dissipated_j + axis.dissipated_j,
            effects_j: sum.effects_j + axis.effects_j,
            throughput_j: sum.throughput_j + axis.throughput_j,
        })
    }
}
