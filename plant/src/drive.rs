//! One mass with friction: `M ẍ = F - F_v ẋ - offset - friction`.
//!
//! Dry friction and other deviations are effects, at the sites drive (before the mass), master or
//! slave (the mass) and sensor. Positions are in m and forces in N, or in rad and N·m for a rotary
//! drive.

use crate::effects::{Effect, Moment, Side, SideLoad, Site};
use crate::friction::{Load, advance};
use crate::parameter::parameter_set;
use crate::transmission::{Reading, sub_steps};
use crate::{ParameterError, ParameterSet};

parameter_set! {
    /// Constants of a one-mass drive, SI.
    #[derive(PartialEq)]
    pub struct Parameters {
        /// Moving mass.
        mass_kg: "kg", 1e-6, 1e6, 95.1, "EMPS: Janot, Gautier, Brunot 2019";
        /// Viscous friction.
        viscous_friction_n_s_per_m: "N s/m", 0.0, 1e6, 203.5, "EMPS, as above";
        /// Constant force against positive movement.
        force_offset_n: "N", -1e6, 1e6, -3.2, "EMPS, as above";
    }
}

/// Longest internal step, s.
const LONGEST_STEP_S: f64 = 0.25e-3;

/// True state of the drive.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Time since the start, s.
    pub time_s: f64,
    /// Position, m.
    pub position_m: f64,
    /// Velocity, m/s.
    pub velocity_m_s: f64,
    /// Force that reaches the mass, N.
    pub force_n: f64,
}

/// The drive in motion.
#[derive(Clone, Debug)]
pub struct Plant {
    parameters: Parameters,
    inertia_kg: f64,
    longest_step_s: f64,
    drive: Vec<Box<dyn Effect>>,
    mass: Vec<Box<dyn Effect>>,
    sensor: Vec<Box<dyn Effect>>,
    state: State,
    increment: f64,
    reading: Reading,
}

impl Plant {
    /// A drive at rest at zero.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`]; [`ParameterError::EffectNotApplicable`] for an effect at the
    /// line.
    pub fn new(
        parameters: Parameters,
        effects: Vec<Box<dyn Effect>>,
    ) -> Result<Self, ParameterError> {
        parameters.check()?;
        let (mut drive, mut mass, mut sensor) = (Vec::new(), Vec::new(), Vec::new());
        let mut inertia_kg = parameters.mass_kg;
        let mut rate = parameters.viscous_friction_n_s_per_m / parameters.mass_kg;
        let elsewhere = crate::hydrostatic::Parameters::printed();
        for mut effect in effects {
            effect.check()?;
            effect.prepare(&elsewhere);
            rate = rate.max(effect.demand().rate_rad_s);
            match effect.site() {
                Site::Drive => drive.push(effect),
                Site::Master | Site::Slave => {
                    inertia_kg += effect.extra_inertia();
                    mass.push(effect);
                }
                Site::Sensor => sensor.push(effect),
                Site::Line => {
                    let (id, site) = (effect.id(), effect.site().name());
                    return Err(ParameterError::EffectNotApplicable { id, site, model: "drive" });
                }
            }
        }
        Ok(Self {
            parameters,
            inertia_kg,
            longest_step_s: LONGEST_STEP_S.min(0.2 / rate.max(1e-9)),
            drive,
            mass,
            sensor,
            state: State::default(),
            increment: 0.0,
            reading: Reading::default(),
        })
    }

    /// The declared constants.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The true state at the end of the last step.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// What the instruments read: `motor_v` is the commanded force, `master_rad` the
    /// position.
    pub fn reading(&self) -> &Reading {
        &self.reading
    }

    /// Sets position and velocity.
    pub fn set_state(&mut self, state: State) {
        self.state = state;
        self.increment = 0.0;
    }

    /// Advances by `dt_s` (s) with the force (N) held; does nothing unless `dt_s` is positive.
    pub fn step(&mut self, force_n: f64, dt_s: f64) {
        let (count, step) = sub_steps(dt_s, self.longest_step_s);
        if count == 0 {
            return;
        }
        for _ in 0..count {
            let velocity = self.state.velocity_m_s;
            let mean = velocity + 0.5 * self.increment;
            let mean = if mean * velocity < 0.0 { 0.0 } else { mean };
            let half = self.state.position_m + 0.5 * step * velocity;
            let moment = Moment::middle(self.state.time_s, step, &[half; 2], &[mean; 2]);
            let mut force = force_n;
            for effect in &mut self.drive {
                force = effect.amplifier(force, &moment);
            }
            for effect in &mut self.drive {
                force = effect.motor(force, &moment);
            }
            let mut load = SideLoad {
                side: Side::Master,
                position_rad: half,
                velocity_rad_s: mean,
                transmitted_nm: force,
                load: Load {
                    force: force - self.parameters.force_offset_n,
                    inertia: self.inertia_kg,
                    viscous_forward: self.parameters.viscous_friction_n_s_per_m,
                    viscous_backward: self.parameters.viscous_friction_n_s_per_m,
                    ..Load::default()
                },
            };
            for effect in &mut self.mass {
                effect.side(&mut load, &moment);
            }
            let moved = advance(velocity, step, &load.load);
            for effect in &mut self.mass {
                effect.moved(moved.displacement, &moment);
            }
            self.increment = if moved.velocity == 0.0 { 0.0 } else { moved.velocity - velocity };
            self.state = State {
                time_s: self.state.time_s + step,
                position_m: self.state.position_m + moved.displacement,
                velocity_m_s: moved.velocity,
                force_n: force,
            };
        }
        self.reading =
            Reading { motor_v: force_n, master_rad: self.state.position_m, ..Reading::default() };
        let State { time_s, position_m, velocity_m_s, .. } = self.state;
        let moment = Moment::middle(time_s, 0.0, &[position_m; 2], &[velocity_m_s; 2]);
        for effect in &mut self.sensor {
            effect.sense(&mut self.reading, &moment);
        }
    }
}
