//! A transmission of any kind, for code that knows the kind at run time only, as from a rig file.
//!
//! An enum, so that a loop steps it without allocation and without dynamic dispatch. The list of
//! transmissions stands here, one line each.
//!
//! ```
//! use plant::transmission::{Input, Transmission};
//! use plant::transmission_kinds::Kind;
//!
//! let mut plant = Kind::Cable.calibrated().plant(Vec::new())?;
//! plant.step(Input { motor_v: 5.0, hand_torque_nm: 0.0 }, 0.2);
//! assert!(plant.motion().slave_position_rad > 0.0);
//! # Ok::<(), plant::ParameterError>(())
//! ```

use std::ops::{Deref, DerefMut};

use crate::effects::Effect;
use crate::friction::Advance;
use crate::handle_inertia::AXES;
use crate::transmission::{
    Correction, EnergyBalance, ImposedMotion, Input, Motion, PendingStep, Reading, State,
    Transmission, TransmissionParameters,
};
use crate::{ParameterError, ParameterInfo, cable, hydrostatic};

macro_rules! transmissions {
    ($($(#[$doc:meta])* $kind:ident: $module:ident, $word:literal;)+) => {
        /// The kinds of transmissions.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Kind {
            $($(#[$doc])* $kind),+
        }

        impl Kind {
            /// All kinds, in the order of the list.
            pub const ALL: &[Self] = &[$(Self::$kind),+];

            /// Its name in a rig file.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$kind => $word),+
                }
            }

            /// Its constants as printed in the thesis.
            pub fn printed(self) -> Parameters {
                match self {
                    $(Self::$kind => Parameters::$kind($module::Parameters::printed())),+
                }
            }

            /// Its constants as printed, the line as soft as the traced responses show it.
            pub fn calibrated(self) -> Parameters {
                match self {
                    $(Self::$kind => Parameters::$kind($module::Parameters::calibrated())),+
                }
            }

            /// All its parameters with unit, range, printed value and source.
            pub const fn infos(self) -> &'static [ParameterInfo] {
                match self {
                    $(Self::$kind => $module::Parameters::NAMES),+
                }
            }
        }

        /// Constants of a transmission of any kind, SI; what all kinds have is in
        /// [`TransmissionParameters`].
        #[derive(Clone, Debug, PartialEq)]
        pub enum Parameters {
            $($(#[$doc])* $kind($module::Parameters)),+
        }

        $(impl From<$module::Parameters> for Parameters {
            fn from(parameters: $module::Parameters) -> Self {
                Self::$kind(parameters)
            }
        })+

        impl Deref for Parameters {
            type Target = dyn TransmissionParameters;

            fn deref(&self) -> &Self::Target {
                match self {
                    $(Self::$kind(own) => own),+
                }
            }
        }

        impl DerefMut for Parameters {
            fn deref_mut(&mut self) -> &mut Self::Target {
                match self {
                    $(Self::$kind(own) => own),+
                }
            }
        }

        impl Parameters {
            /// Which kind.
            pub const fn kind(&self) -> Kind {
                match self {
                    $(Self::$kind(_) => Kind::$kind),+
                }
            }

            /// A plant with these constants, at rest at zero.
            ///
            /// # Errors
            /// [`ParameterError::OutOfRange`] for a parameter of the plant or of an effect;
            /// [`ParameterError::EffectNotApplicable`] for an effect that does not act on this
            /// kind.
            pub fn plant(self, effects: Vec<Box<dyn Effect>>) -> Result<Plant, ParameterError> {
                Ok(match self {
                    $(Self::$kind(own) => {
                        Plant::$kind(Box::new($module::Plant::new(own, effects)?))
                    })+
                })
            }

            /// Changes the constants as an effect does at the start of a simulation.
            pub(crate) fn modify(&mut self, effect: &dyn Effect) {
                match self {
                    $(Self::$kind(own) => effect.modify(own)),+
                }
            }
        }

        /// A transmission of any kind, in motion.
        #[derive(Clone, Debug)]
        pub enum Plant {
            $($(#[$doc])* $kind(Box<$module::Plant>)),+
        }

        /// Calls the same method on the plant, whatever its kind.
        macro_rules! each {
            ($plant:expr, $inner:ident => $call:expr) => {
                match $plant {
                    $(Plant::$kind($inner) => $call),+
                }
            };
        }

        /// Calls the same on two plants of one kind; does nothing for two of different kinds.
        macro_rules! each_pair {
            ($plants:expr, $own:ident, $other:ident => $call:expr) => {
                match $plants {
                    $((Plant::$kind($own), Plant::$kind($other)) => $call,)+
                    _ => {}
                }
            };
        }
    };
}

transmissions! {
    /// Two oil lines (ch. 3).
    Hydrostatic: hydrostatic, "hydrostatic";
    /// Two cables (ch. 5).
    Cable: cable, "cable";
}

impl Plant {
    /// See [`crate::transmission::Plant::rest_at`].
    pub fn rest_at(&mut self, master_rad: f64, slave_rad: Option<f64>) {
        each!(self, plant => plant.rest_at(master_rad, slave_rad));
    }

    /// See [`crate::transmission::Plant::with_longest_step`].
    #[must_use]
    pub fn with_longest_step(mut self, longest_s: f64) -> Self {
        each!(&mut self, plant => plant.set_longest_step(longest_s));
        self
    }

    /// See [`crate::transmission::Plant::without_energy_balance`].
    #[must_use]
    pub fn without_energy_balance(mut self) -> Self {
        each!(&mut self, plant => plant.forgo_energy_balance());
        self
    }

    /// See [`crate::transmission::Plant::set_state`].
    pub fn set_state(&mut self, state: State) {
        each!(self, plant => plant.set_state(state));
    }

    /// Sets the clock by which effects change (s); nothing moves.
    pub fn set_time(&mut self, time_s: f64) {
        each!(self, plant => plant.set_state(State { time_s, ..*plant.state() }));
    }

    /// See [`crate::transmission::Plant::correct`].
    pub fn correct(&mut self, correction: Correction) {
        each!(self, plant => plant.correct(correction));
    }

    /// The true state at the end of the last step.
    pub fn state(&self) -> &State {
        each!(self, plant => plant.state())
    }

    /// Longest internal step, s.
    pub fn longest_step_s(&self) -> f64 {
        each!(self, plant => plant.longest_step_s())
    }

    /// See [`crate::transmission::Plant::end_breakdown`].
    pub fn end_breakdown(&mut self, number: u64) {
        each!(self, plant => plant.end_breakdown(number));
    }

    /// Takes over what the breakdowns of another machine of the same kind are at; before
    /// [`Plant::set_state`].
    pub(crate) fn take_over_breakdowns(&mut self, other: &Self) {
        each_pair!((self, other), own, before => own.take_over_breakdowns(before));
    }

    pub(crate) fn slave_inertia_kg_m2(&self) -> f64 {
        each!(self, plant => plant.slave_inertia_kg_m2())
    }

    pub(crate) fn handle_coupling_kg_m2(&self) -> [f64; AXES] {
        each!(self, plant => plant.handle_coupling_kg_m2())
    }

    pub(crate) fn begin(&mut self, input: Input, step_s: f64) -> PendingStep {
        each!(self, plant => plant.begin(input, step_s))
    }

    pub(crate) fn complete(&mut self, pending: &PendingStep, slave: Advance) {
        each!(self, plant => plant.complete(pending, slave));
    }

    pub(crate) fn read(&mut self, input: Input) {
        each!(self, plant => plant.read(input.motor_v, input.hand_torque_nm));
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
        each!(self, plant => plant.reading())
    }

    fn energy(&self) -> EnergyBalance {
        each!(self, plant => plant.energy())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::parse;

    fn kinds() -> impl Iterator<Item = Parameters> {
        Kind::ALL.iter().map(|kind| kind.calibrated())
    }

    #[test]
    fn inertia_at_the_handle_slows_the_slave() {
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
    fn an_inertia_beyond_the_range_is_refused_and_changes_nothing() {
        for parameters in kinds() {
            let mut loaded = parameters.clone();
            let error = loaded.load_handle(1e3).unwrap_err();
            assert!(matches!(error, ParameterError::OutOfRange { .. }), "{error}");
            assert_eq!(loaded, parameters);
        }
    }

    #[test]
    fn a_plant_at_rest_away_from_zero_stays_there() {
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
    fn leakage_acts_in_oil_lines_only() {
        let leaking = |kind: Kind| kind.calibrated().plant(vec![parse("leakage").unwrap()]);
        assert!(leaking(Kind::Hydrostatic).is_ok());
        let error = leaking(Kind::Cable).unwrap_err().to_string();
        assert!(error.contains("`leakage`") && error.contains("cable transmission"), "{error}");
    }
}
