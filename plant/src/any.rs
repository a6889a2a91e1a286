//! A transmission whose kind is known at run time only: what a rig file declares.
//!
//! An enum, so that a loop steps it without allocating and without a table of functions.
//!
//! ```
//! use plant::transmission::{Input, Transmission};
//! use plant::{any, cable};
//!
//! let mut plant = any::Parameters::from(cable::Parameters::traced()).plant(Vec::new())?;
//! plant.step(Input { motor_v: 5.0, hand_torque_nm: 0.0 }, 0.2);
//! assert!(plant.motion().slave_position_rad > 0.0);
//! # Ok::<(), plant::ParameterError>(())
//! ```

use crate::effects::Effect;
use crate::friction::{Advance, Load};
use crate::shared::Shared;
use crate::transmission::{
    Correction, EnergyBalance, ImposedMotion, Input, Motion, Reading, Transmission,
};
use crate::{ParameterError, ParameterInfo, ParameterSet, cable, hydrostatic};

/// Constants of a transmission of either kind, SI.
#[derive(Clone, Debug, PartialEq)]
pub enum Parameters {
    /// Two oil lines (ch. 3).
    Hydrostatic(hydrostatic::Parameters),
    /// Two cables (ch. 5).
    Cable(cable::Parameters),
}

impl From<hydrostatic::Parameters> for Parameters {
    fn from(parameters: hydrostatic::Parameters) -> Self {
        Self::Hydrostatic(parameters)
    }
}

impl From<cable::Parameters> for Parameters {
    fn from(parameters: cable::Parameters) -> Self {
        Self::Cable(parameters)
    }
}

impl ParameterSet for Parameters {
    fn infos(&self) -> &'static [ParameterInfo] {
        match self {
            Self::Hydrostatic(own) => own.infos(),
            Self::Cable(own) => own.infos(),
        }
    }

    fn get(&self, name: &str) -> Option<f64> {
        match self {
            Self::Hydrostatic(own) => own.get(name),
            Self::Cable(own) => own.get(name),
        }
    }

    fn set(&mut self, name: &str, value: f64) -> Result<(), ParameterError> {
        match self {
            Self::Hydrostatic(own) => own.set(name, value),
            Self::Cable(own) => own.set(name, value),
        }
    }
}

impl Parameters {
    /// Fixes an inertia to the handle (kg·m²): that of the hand that holds it.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`] where handle and hand together are beyond what the model
    /// stands for.
    pub fn load_handle(&mut self, inertia_kg_m2: f64) -> Result<(), ParameterError> {
        match self {
            Self::Hydrostatic(own) => {
                let handle = own.slave_handle_inertia_kg_m2;
                own.set("slave_handle_inertia_kg_m2", handle + inertia_kg_m2)
            }
            Self::Cable(own) => {
                let slave = own.slave_inertia_kg_m2;
                own.set("slave_inertia_kg_m2", slave + inertia_kg_m2)
            }
        }
    }

    /// Inertia of the slave with its handle (kg·m²), effects left out.
    pub fn slave_inertia_kg_m2(&self) -> f64 {
        match self {
            Self::Hydrostatic(own) => own.slave_inertia_kg_m2(),
            Self::Cable(own) => own.total_slave_inertia_kg_m2(),
        }
    }

    /// Torque of the motor for each volt at its amplifier (N·m/V).
    pub const fn motor_torque_per_volt_nm(&self) -> f64 {
        match self {
            Self::Hydrostatic(own) => own.motor_torque_per_volt_nm,
            Self::Cable(own) => own.motor_torque_per_volt_nm,
        }
    }

    /// What the line moves for each radian of the master (m/rad).
    pub fn master_displacement_m_per_rad(&self) -> f64 {
        match self {
            Self::Hydrostatic(own) => own.master_displacement_m_per_rad(),
            Self::Cable(own) => own.master_pulley_radius_m,
        }
    }

    /// Stiffness of one line (N/m).
    pub fn line_stiffness_n_per_m(&self) -> f64 {
        match self {
            Self::Hydrostatic(own) => own.line_stiffness_n_per_m(),
            Self::Cable(own) => own.line_stiffness_n_per_m(),
        }
    }

    /// A plant with these constants, at rest at zero.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`] for a parameter of the plant or of an effect;
    /// [`ParameterError::EffectNotApplicable`] for an effect that has no meaning in this kind.
    pub fn plant(self, effects: Vec<Box<dyn Effect>>) -> Result<Plant, ParameterError> {
        Ok(match self {
            Self::Hydrostatic(own) => {
                Plant::Hydrostatic(Box::new(hydrostatic::Plant::new(own, effects)?))
            }
            Self::Cable(own) => Plant::Cable(Box::new(cable::Plant::new(own, effects)?)),
        })
    }
}

/// A transmission of either kind, moving.
#[derive(Clone, Debug)]
pub enum Plant {
    /// Two oil lines.
    Hydrostatic(Box<hydrostatic::Plant>),
    /// Two cables.
    Cable(Box<cable::Plant>),
}

impl Plant {
    /// Puts the plant to rest with the master there (rad), and the slave there or, for `None`,
    /// where the line at rest would have it. The middle of each line stands midway between what its
    /// two ends ask of it.
    pub fn rest_at(&mut self, master_rad: f64, slave_rad: Option<f64>) {
        let radii = match self {
            Self::Hydrostatic(plant) => {
                let own = plant.parameters();
                [own.master_displacement_m_per_rad(), own.slave_displacement_m_per_rad()]
            }
            Self::Cable(plant) => {
                let own = plant.parameters();
                [own.master_pulley_radius_m, own.slave_pulley_radius_m()]
            }
        };
        let slave_rad = slave_rad.unwrap_or(master_rad * radii[0] / radii[1]);
        let middle = [0.5 * (radii[0] * master_rad + radii[1] * slave_rad); 2];
        match self {
            Self::Hydrostatic(plant) => plant.set_state(hydrostatic::State {
                master_position_rad: master_rad,
                slave_position_rad: slave_rad,
                line_position_m: middle,
                ..hydrostatic::State::default()
            }),
            Self::Cable(plant) => plant.set_state(cable::State {
                master_position_rad: master_rad,
                slave_position_rad: slave_rad,
                line_position_m: middle,
                ..cable::State::default()
            }),
        }
    }
}

impl Plant {
    /// Lets internal steps be as long as `longest_s` where the plant is stable with it.
    #[must_use]
    pub fn with_longest_step(self, longest_s: f64) -> Self {
        match self {
            Self::Hydrostatic(plant) => {
                Self::Hydrostatic(Box::new(plant.with_longest_step(longest_s)))
            }
            Self::Cable(plant) => Self::Cable(Box::new(plant.with_longest_step(longest_s))),
        }
    }

    /// Sets the clock by which effects change (s); nothing moves.
    pub fn set_time(&mut self, time_s: f64) {
        match self {
            Self::Hydrostatic(plant) => {
                plant.set_state(hydrostatic::State { time_s, ..*plant.state() })
            }
            Self::Cable(plant) => plant.set_state(cable::State { time_s, ..*plant.state() }),
        }
    }

    /// Adds to positions and speeds without a fresh start: how an observer pulls the model toward a
    /// measurement.
    pub fn correct(&mut self, correction: Correction) {
        match self {
            Self::Hydrostatic(plant) => plant.correct(correction),
            Self::Cable(plant) => plant.correct(correction),
        }
    }
}

/// The same call on whichever plant there is.
macro_rules! each {
    ($plant:expr, $inner:ident => $call:expr) => {
        match $plant {
            Plant::Hydrostatic($inner) => $call,
            Plant::Cable($inner) => $call,
        }
    };
}

/// An internal step of either kind, the slave still to be moved.
pub(crate) enum Stage {
    Hydrostatic(hydrostatic::Stage),
    Cable(cable::Stage),
}

impl Shared for Plant {
    type Stage = Stage;

    fn begin(&mut self, input: Input, step_s: f64) -> (Stage, Load) {
        match self {
            Self::Hydrostatic(plant) => {
                let (stage, load) = Shared::begin(plant.as_mut(), input, step_s);
                (Stage::Hydrostatic(stage), load)
            }
            Self::Cable(plant) => {
                let (stage, load) = Shared::begin(plant.as_mut(), input, step_s);
                (Stage::Cable(stage), load)
            }
        }
    }

    fn complete(&mut self, stage: Stage, slave: Advance) {
        match (self, stage) {
            (Self::Hydrostatic(plant), Stage::Hydrostatic(stage)) => {
                Shared::complete(plant.as_mut(), stage, slave)
            }
            (Self::Cable(plant), Stage::Cable(stage)) => {
                Shared::complete(plant.as_mut(), stage, slave)
            }
            // A stage comes back to the plant that began it.
            _ => debug_assert!(false, "a stage of another kind of plant"),
        }
    }

    fn observe(&mut self, input: Input) {
        each!(self, plant => plant.observe(input));
    }

    fn longest_step_s(&self) -> f64 {
        each!(self, plant => plant.longest_step_s())
    }

    fn slave_inertia_kg_m2(&self) -> f64 {
        each!(self, plant => Shared::slave_inertia_kg_m2(plant.as_ref()))
    }
}

impl Transmission for Plant {
    fn step(&mut self, input: Input, dt_s: f64) {
        each!(self, plant => plant.step(input, dt_s));
    }

    fn step_imposed(&mut self, master: ImposedMotion, hand_torque_nm: f64, dt_s: f64) {
        each!(self, plant => plant.step_imposed(master, hand_torque_nm, dt_s));
    }

    fn motion(&self) -> Motion {
        each!(self, plant => plant.motion())
    }

    fn reading(&self) -> Reading {
        each!(self, plant => *plant.reading())
    }

    fn energy(&self) -> EnergyBalance {
        each!(self, plant => plant.energy())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::parse;

    fn kinds() -> [Parameters; 2] {
        [hydrostatic::Parameters::traced().into(), cable::Parameters::traced().into()]
    }

    #[test]
    fn it_moves_as_the_plant_inside_does() {
        let input = Input { motor_v: 5.0, hand_torque_nm: 0.1 };
        let mut oil =
            hydrostatic::Plant::new(hydrostatic::Parameters::traced(), Vec::new()).unwrap();
        let mut cable = cable::Plant::new(cable::Parameters::traced(), Vec::new()).unwrap();
        let [mut any_oil, mut any_cable] = kinds().map(|kind| kind.plant(Vec::new()).unwrap());
        for _ in 0..400 {
            oil.step(input, 5e-4);
            cable.step(input, 5e-4);
            any_oil.step(input, 5e-4);
            any_cable.step(input, 5e-4);
        }
        assert_eq!(
            (any_oil.motion(), any_oil.reading()),
            (Motion::from(oil.state()), *oil.reading())
        );
        assert_eq!(
            (any_cable.motion(), any_cable.reading()),
            (Motion::from(cable.state()), *cable.reading())
        );
        assert!(
            any_oil.motion().slave_position_rad > 0.01
                && any_cable.motion().slave_position_rad > 0.01
        );
    }

    #[test]
    fn a_hand_makes_the_slave_slower() {
        for parameters in kinds() {
            let travel = |inertia| {
                let mut parameters = parameters.clone();
                parameters.load_handle(inertia).unwrap();
                let mut plant = parameters.plant(Vec::new()).unwrap();
                plant.step(Input { motor_v: 8.0, hand_torque_nm: 0.0 }, 0.1);
                plant.motion().slave_position_rad
            };
            let (free, held) = (travel(0.0), travel(0.05));
            assert!(held < 0.7 * free, "{parameters:?}: {held} against {free}");
        }
    }

    #[test]
    fn a_hand_beyond_the_model_is_refused_and_changes_nothing() {
        for parameters in kinds() {
            let mut loaded = parameters.clone();
            let error = loaded.load_handle(1e3).unwrap_err();
            assert!(matches!(error, ParameterError::OutOfRange { .. }), "{error}");
            assert_eq!(loaded, parameters);
        }
    }

    #[test]
    fn at_rest_away_from_zero_it_stays() {
        for parameters in kinds() {
            let mut plant = parameters.plant(Vec::new()).unwrap();
            plant.rest_at(0.8, None);
            let before = plant.motion();
            assert_eq!(before.master_position_rad, 0.8);
            assert!(before.slave_position_rad > 0.1);
            plant.step(Input::default(), 1.0);
            let after = plant.motion();
            assert!((after.master_position_rad - 0.8).abs() < 1e-9, "{after:?}");
            assert!(
                (after.slave_position_rad - before.slave_position_rad).abs() < 1e-9,
                "{after:?}"
            );
            plant.rest_at(0.8, Some(0.5));
            assert_eq!(plant.motion().slave_position_rad, 0.5);
        }
    }

    #[test]
    fn leakage_acts_in_oil_alone() {
        let [oil, cable] = kinds();
        assert!(oil.plant(vec![parse("leakage").unwrap()]).is_ok());
        let error = cable.plant(vec![parse("leakage").unwrap()]).unwrap_err().to_string();
        assert!(error.contains("`leakage`") && error.contains("cable transmission"), "{error}");
    }
}
