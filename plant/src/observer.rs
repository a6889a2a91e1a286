//! The model beside the machine: a transmission that is pulled toward the measured positions.
//!
//! Simulated freely, a model drifts from the machine by noise, stick and slip. With the measured
//! positions fed back it stays beside it, and what it lacks shows as the innovation, the measured
//! position less the modelled one. A disturbance torque on an inertia I shows, below the
//! bandwidth ω, as an innovation of about torque / (I ω²).
//!
//! ```
//! use plant::observer::Observer;
//! use plant::transmission::Input;
//! use plant::transmission_kinds::Kind;
//!
//! let plant = Kind::Hydrostatic.calibrated().plant(Vec::new())?;
//! let mut observer = Observer::new(plant, 2e-3);
//! observer.rest_at(0.1, Some(0.1));
//! let innovation = observer.innovation(0.1, Some(0.101));
//! assert_eq!(innovation.master_rad, 0.0);
//! assert!((innovation.slave_rad.unwrap() - 1e-3).abs() < 1e-12);
//! observer.advance(innovation, Input { motor_v: 0.0, hand_torque_nm: 0.0 });
//! assert!(observer.plant().state().slave_position_rad > 0.1);
//! # Ok::<(), plant::ParameterError>(())
//! ```

use crate::transmission::{Correction, Input, Transmission as _};
use crate::transmission_kinds::Plant;

/// Bandwidth of the observer (rad/s). A lower one would show slow effects with more contrast, but
/// leaves a stick-slip model with two solutions from the same state.
pub const BANDWIDTH_RAD_S: f64 = 150.0;
/// Position gain as a factor on the bandwidth: twice the damping ratio.
pub const DAMPING: f64 = 1.4;
/// Gain from the master's innovation to the position of a slave that is not observed (1/s). Without
/// it, a slave that once stopped at a wrong place pulls at the master through the line from then
/// on; a higher one hides what the model of the line lacks.
const UNOBSERVED_SLAVE_PER_S: f64 = 30.0;
/// An innovation beyond this counts as divergence (rad).
const DIVERGED_RAD: f64 = 1e3;

/// Measured less modelled position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Innovation {
    /// Of the master (rad).
    pub master_rad: f64,
    /// Of the slave (rad); `None` where it is not observed.
    pub slave_rad: Option<f64>,
}

impl Innovation {
    /// No correction.
    pub fn none(slave_observed: bool) -> Self {
        Self { master_rad: 0.0, slave_rad: slave_observed.then_some(0.0) }
    }

    /// Whether the model has not diverged from the machine; one that is not a number has.
    pub fn is_bounded(&self) -> bool {
        self.master_rad.abs() < DIVERGED_RAD && self.slave_rad.unwrap_or(0.0).abs() < DIVERGED_RAD
    }
}

/// A transmission with its observer. Does not allocate after it is made.
#[derive(Clone, Debug)]
pub struct Observer {
    plant: Plant,
    step_s: f64,
    on_position: f64,
    on_speed: f64,
}

impl Observer {
    /// Observes with a row each `step_s` (s); `plant` is the model of the machine.
    pub fn new(plant: Plant, step_s: f64) -> Self {
        Self {
            plant,
            step_s,
            on_position: DAMPING * BANDWIDTH_RAD_S * step_s,
            on_speed: BANDWIDTH_RAD_S * BANDWIDTH_RAD_S * step_s,
        }
    }

    /// The model at rest at these positions (rad); without one of the slave, where the line leaves
    /// it.
    pub fn rest_at(&mut self, master_rad: f64, slave_rad: Option<f64>) {
        self.plant.rest_at(master_rad, slave_rad);
    }

    /// Puts the model into the state of another's, clock included.
    pub fn follow(&mut self, other: &Self) {
        self.plant.set_state(*other.plant.state());
    }

    /// Sets the clock by which effects change (s); nothing moves.
    pub fn set_time(&mut self, time_s: f64) {
        self.plant.set_time(time_s);
    }

    /// What the measured positions (rad) say of the model; call before [`Self::advance`].
    pub fn innovation(&self, master_rad: f64, slave_rad: Option<f64>) -> Innovation {
        let reading = self.plant.reading();
        Innovation {
            master_rad: master_rad - reading.master_rad,
            slave_rad: slave_rad.map(|slave_rad| slave_rad - reading.slave_rad),
        }
    }

    /// Corrects the model by an innovation and moves it by a row with the input held.
    pub fn advance(&mut self, innovation: Innovation, input: Input) {
        let Innovation { master_rad, slave_rad } = innovation;
        self.plant.correct(Correction {
            master_position_rad: self.on_position * master_rad,
            master_velocity_rad_s: self.on_speed * master_rad,
            slave_position_rad: match slave_rad {
                Some(slave_rad) => self.on_position * slave_rad,
                None => UNOBSERVED_SLAVE_PER_S * self.step_s * master_rad,
            },
            slave_velocity_rad_s: self.on_speed * slave_rad.unwrap_or(0.0),
        });
        self.plant.step(input, self.step_s);
    }

    /// The model.
    pub const fn plant(&self) -> &Plant {
        &self.plant
    }
}
