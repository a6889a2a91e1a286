//! Deviations from the declared model, added to a plant by name: one file each.
//!
//! An effect acts at a [`Site`] through the hooks of [`Effect`], which a plant calls once per
//! internal step. Each effect is a [`ParameterSet`]; its first parameter is its size, the value
//! after `=` in `ID[@SITE][=SIZE]`. Its file also declares how it is searched in records
//! ([`search`]), how it is looked for beside a running machine ([`monitoring`]) and its form in
//! models of one channel ([`one_channel`]). To add one: a file here, and its name in two lines of
//! this file (`pub mod` and [`LIST`]).

use crate::ParameterSet;
use crate::friction::{Load, OperatingPoint};
use crate::handle_inertia::AXES;
use crate::transmission::Reading;
use std::fmt;

mod adjustable_constants;
mod breakdown;
mod by_name;
mod by_site;
mod declaration;
mod delay_line;

pub mod amplifier_deadzone;
pub mod amplifier_lag;
pub mod amplifier_saturation;
pub mod asymmetric_friction;
pub mod backlash;
pub mod breakdowns;
pub mod coulomb_friction;
pub mod encoder_eccentricity;
pub mod end_stop;
pub mod extra_inertia;
pub mod gravity_imbalance;
pub mod hand_impedance;
pub mod handle_coupling;
pub mod leakage;
pub mod line_compliance;
pub mod line_damping;
pub mod load_dependent_friction;
pub mod mains_hum;
pub mod monitoring;
pub mod nonlinear_stiffness;
pub mod one_channel;
pub mod periodic_disturbance;
pub mod position_dependent_friction;
pub mod presliding_hysteresis;
pub mod quadratic_drag;
pub mod rectified_sensor;
pub mod search;
pub mod sensor_crosstalk;
pub mod sensor_drift;
pub mod sensor_gain;
pub mod sensor_offset;
pub mod stribeck_friction;
pub mod thermal_drift;
pub mod torque_ripple;
pub mod transport_delay;
pub mod viscoelastic_line;
pub mod viscous_friction;

pub use adjustable_constants::LineConstants;
pub use breakdown::Breakdown;
pub use by_name::{EffectError, entry, make, of_one_axis, of_one_channel, of_plants, parse, split};
pub(crate) use by_site::{Reach, Sited};
pub(crate) use declaration::effect;
pub use declaration::{Entry, Place};

/// Every effect, grouped by kind. Names and sites are an interface.
pub const LIST: &[Entry] = &[
    line_compliance::ENTRY,
    nonlinear_stiffness::ENTRY,
    viscoelastic_line::ENTRY,
    leakage::ENTRY,
    backlash::ENTRY,
    transport_delay::ENTRY,
    line_damping::ENTRY,
    coulomb_friction::ENTRY,
    viscous_friction::ENTRY,
    quadratic_drag::ENTRY,
    stribeck_friction::ENTRY,
    asymmetric_friction::ENTRY,
    position_dependent_friction::ENTRY,
    load_dependent_friction::ENTRY,
    presliding_hysteresis::ENTRY,
    gravity_imbalance::ENTRY,
    extra_inertia::ENTRY,
    hand_impedance::ENTRY,
    handle_coupling::ENTRY,
    torque_ripple::ENTRY,
    amplifier_saturation::ENTRY,
    amplifier_deadzone::ENTRY,
    amplifier_lag::ENTRY,
    thermal_drift::ENTRY,
    periodic_disturbance::ENTRY,
    encoder_eccentricity::ENTRY,
    sensor_offset::ENTRY,
    sensor_gain::ENTRY,
    sensor_drift::ENTRY,
    sensor_crosstalk::ENTRY,
    mains_hum::ENTRY,
    rectified_sensor::ENTRY,
];

/// Where an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Site {
    /// Amplifier and motor.
    Drive,
    /// Master side: pulley, piston, motor bearing.
    Master,
    /// The transmission between them.
    Line,
    /// Slave side: piston, pulley, handle.
    Slave,
    /// The instruments.
    Sensor,
}

impl Site {
    /// All sites.
    pub const ALL: [Self; 5] = [Self::Drive, Self::Master, Self::Line, Self::Slave, Self::Sensor];

    /// Its name, as in `ID@SITE`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drive => "drive",
            Self::Master => "master",
            Self::Line => "line",
            Self::Slave => "slave",
            Self::Sensor => "sensor",
        }
    }

    /// The site of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|site| site.name() == name)
    }
}

impl fmt::Display for Site {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The midpoint of an internal step (for sensors, the end of a step).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// Time since the start, s.
    pub time_s: f64,
    /// Length of the internal step, s; 0 for sensors.
    pub step_s: f64,
    /// Master angle, rad.
    pub master_position_rad: f64,
    /// Master speed, rad/s.
    pub master_velocity_rad_s: f64,
    /// Slave angle, rad.
    pub slave_position_rad: f64,
    /// Slave speed, rad/s.
    pub slave_velocity_rad_s: f64,
}

impl Moment {
    /// The midpoint of an internal step that begins at `time_s` (the instant itself where `step_s`
    /// is 0), from positions and velocities of master and slave there.
    #[inline(always)]
    pub(crate) fn middle(time_s: f64, step_s: f64, half: &[f64], mean: &[f64]) -> Self {
        Self {
            time_s: time_s + 0.5 * step_s,
            step_s,
            master_position_rad: half[0],
            master_velocity_rad_s: mean[0],
            slave_position_rad: half[1],
            slave_velocity_rad_s: mean[1],
        }
    }
}

/// A side of the transmission, and the end of a line there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Master.
    Master,
    /// Slave.
    Slave,
}

/// The spring and damper between one end of a line's fluid and the piston there (eq. 3.1.9).
///
/// For a cable read middle for fluid and pulley for piston; its force is relative to the
/// pretension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// Which end.
    pub end: Side,
    /// Line 0 or 1.
    pub line: usize,
    /// Declared stiffness `2K`, N/m.
    pub stiffness_n_per_m: f64,
    /// Declared damping `D`, N·s/m.
    pub damping_n_s_per_m: f64,
    /// `α r`: fluid displacement per pulley angle, m/rad.
    pub displacement_m_per_rad: f64,
    /// Fluid less piston displacement, m.
    pub deflection_m: f64,
    /// Its rate, m/s.
    pub rate_m_s: f64,
    /// Fluid displacement, m.
    pub fluid_position_m: f64,
    /// Fluid speed, m/s.
    pub fluid_velocity_m_s: f64,
    /// Force on the piston's coordinate, N.
    pub force_n: f64,
    /// Force on the fluid, against its coordinate, N; equals `force_n` unless an effect stores
    /// momentum between.
    pub fluid_force_n: f64,
    /// Damping of the fluid's own velocity, N·s/m: adds to the force on the fluid, implicitly in
    /// the velocity of the step (`fluid_velocity_m_s` is extrapolated).
    pub fluid_damping_n_s_per_m: f64,
}

/// What acts on one side; effects add to `load`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SideLoad {
    /// Which side.
    pub side: Side,
    /// Angle at the middle of the step, rad (for a drive: m).
    pub position_rad: f64,
    /// Speed there, rad/s (m/s).
    pub velocity_rad_s: f64,
    /// Torque of the lines on this side, N·m (for a drive: the applied force, N).
    pub transmitted_nm: f64,
    /// Force, inertia and friction.
    pub load: Load,
}

impl SideLoad {
    /// The operating point of the side, for a friction law.
    pub fn operating_point(&self, moment: &Moment) -> OperatingPoint {
        OperatingPoint {
            position: self.position_rad,
            velocity: self.velocity_rad_s,
            transmitted: self.transmitted_nm,
            step: moment.step_s,
        }
    }
}

/// What an effect requires of the integrator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// Largest factor by which it stiffens the line; 1 if it does not.
    pub stiffness_factor: f64,
    /// Highest angular frequency or decay rate that the effect adds, rad/s.
    pub rate_rad_s: f64,
}

impl Default for Demand {
    fn default() -> Self {
        Self { stiffness_factor: 1.0, rate_rad_s: 0.0 }
    }
}

/// Which effect it is, and where.
pub trait Identity {
    /// Its name in [`LIST`].
    fn id(&self) -> &'static str;

    /// Where it acts.
    fn site(&self) -> Site;
}

/// A deviation from the declared model. Hooks do nothing by default; they must not allocate, and
/// each is called exactly once per internal step (per link, line or side).
pub trait Effect: Identity + ParameterSet + CloneEffect + fmt::Debug + Send {
    /// Changes the plant's constants, once, before the first step.
    fn modify(&self, _constants: &mut dyn LineConstants) {}

    /// Prepares for a plant with these constants and clears its inner state; may allocate.
    fn prepare(&mut self, _constants: &dyn LineConstants) {}

    /// Whether it acts on a plant with such lines.
    fn applies(&self, _constants: &dyn LineConstants) -> bool {
        true
    }

    /// What it requires of the integrator.
    fn demand(&self) -> Demand {
        Demand::default()
    }

    /// Inertia that it adds to its side, kg·m² (kg).
    fn extra_inertia(&self) -> f64 {
        0.0
    }

    /// Products of inertia that it adds between its side and the slaves of the axes at the same
    /// handle, by axis, kg·m².
    fn handle_coupling_kg_m2(&self) -> [f64; AXES] {
        [0.0; AXES]
    }

    /// Constant and viscous friction that it adds to its side, N·m and N·m·s/rad (N, N·s/m).
    fn extra_friction(&self) -> (f64, f64) {
        (0.0, 0.0)
    }

    /// Dead time by which it delays all that the instruments read, where it does nothing else, s.
    fn delay_of_all_readings_s(&self) -> Option<f64> {
        None
    }

    /// Whether it acts on the links at its side (sites master and slave; at the line any effect
    /// may): [`Effect::deflect`] and [`Effect::link`] may otherwise not be called.
    fn acts_on_links(&self) -> bool {
        false
    }

    /// State of a breakdown; `None` for what an intact machine has.
    fn breakdown(&self) -> Option<&Breakdown> {
        None
    }

    /// The same, to be changed.
    fn breakdown_mut(&mut self) -> Option<&mut Breakdown> {
        None
    }

    /// Site drive: the amplifier's volts from the commanded.
    fn amplifier(&mut self, volts: f64, _moment: &Moment) -> f64 {
        volts
    }

    /// Site drive: the motor's torque from the ideal one.
    fn motor(&mut self, torque_nm: f64, _moment: &Moment) -> f64 {
        torque_nm
    }

    /// Sites line, master, slave: changes a link's deflection before its force is computed.
    fn deflect(&mut self, _link: &mut Link, _moment: &Moment) {}

    /// Sites line, master, slave: changes a link's force.
    fn link(&mut self, _link: &mut Link, _moment: &Moment) {}

    /// Site line: the fluid's loss coefficient, N·s/m; called once per line.
    fn fluid(&mut self, coefficient: f64, _moment: &Moment) -> f64 {
        coefficient
    }

    /// Site line: displacement of the fluid of a line in the step for which [`Effect::link`] was
    /// called, m.
    fn flowed(&mut self, _line: usize, _displacement_m: f64, _moment: &Moment) {}

    /// Sites master, slave: adds force, friction.
    fn side(&mut self, _load: &mut SideLoad, _moment: &Moment) {}

    /// Sites master, slave: displacement of the side in the step for which [`Effect::side`] was
    /// called, rad (m).
    fn moved(&mut self, _displacement: f64, _moment: &Moment) {}

    /// Site sensor: changes what the instruments read; called once per output step.
    fn sense(&mut self, _reading: &mut Reading, _moment: &Moment) {}
}

/// Cloning of boxed effects; implemented for every effect that is `Clone`.
pub trait CloneEffect {
    /// A copy with its inner state.
    fn boxed_clone(&self) -> Box<dyn Effect>;
}

impl<T: Effect + Clone + 'static> CloneEffect for T {
    fn boxed_clone(&self) -> Box<dyn Effect> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn Effect> {
    fn clone(&self) -> Self {
        // Through the inner value: the box itself does not implement `Effect`.
        self.as_ref().boxed_clone()
    }
}
