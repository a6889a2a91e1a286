//! Effects by the site at which they act.

use super::{Effect, End, LineConstants, Moment, Side, SideLoad, Site};
use crate::ParameterError;
use crate::transmission::{Motion, Reading};

/// Effects by site.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sited {
    pub(crate) drive: Vec<Box<dyn Effect>>,
    pub(crate) master: Vec<Box<dyn Effect>>,
    pub(crate) line: Vec<Box<dyn Effect>>,
    pub(crate) slave: Vec<Box<dyn Effect>>,
    pub(crate) sensor: Vec<Box<dyn Effect>>,
    /// Inertia added to master and slave, kg·m².
    pub(crate) extra_inertia: [f64; 2],
    /// Largest factor by which effects stiffen the lines.
    pub(crate) stiffness_factor: f64,
    /// Highest rate that effects add, rad/s.
    pub(crate) rate_rad_s: f64,
    /// Whether there is any effect other than of sensors.
    pub(crate) any: bool,
}

impl Sited {
    /// Lets all effects modify the constants, then prepares them and sorts them by site.
    pub(crate) fn install(
        effects: Vec<Box<dyn Effect>>,
        constants: &mut impl LineConstants,
    ) -> Result<Self, ParameterError> {
        // All modifications first, so that every effect prepares from the final constants.
        for effect in &effects {
            effect.check()?;
            if !effect.applies(constants) {
                let (id, site) = (effect.id(), effect.site().name());
                return Err(ParameterError::EffectNotApplicable {
                    id,
                    site,
                    model: constants.model(),
                });
            }
            effect.modify(constants);
        }
        let mut sited = Self { stiffness_factor: 1.0, ..Self::default() };
        for mut effect in effects {
            effect.prepare(constants);
            sited.any |= effect.site() != Site::Sensor;
            let demand = effect.demand();
            sited.stiffness_factor *= demand.stiffness_factor.max(1.0);
            sited.rate_rad_s = sited.rate_rad_s.max(demand.rate_rad_s);
            match effect.site() {
                Site::Drive => sited.drive.push(effect),
                Site::Master => {
                    sited.extra_inertia[0] += effect.extra_inertia();
                    sited.master.push(effect);
                }
                Site::Line => sited.line.push(effect),
                Site::Slave => {
                    sited.extra_inertia[1] += effect.extra_inertia();
                    sited.slave.push(effect);
                }
                Site::Sensor => sited.sensor.push(effect),
            }
        }
        Ok(sited)
    }

    /// The motor's torque at the volts commanded, N·m.
    pub(crate) fn motor_torque(
        &mut self,
        volts: f64,
        torque_per_volt_nm: f64,
        moment: &Moment,
    ) -> f64 {
        let volts =
            self.drive.iter_mut().fold(volts, |volts, effect| effect.amplifier(volts, moment));
        let torque = torque_per_volt_nm * volts;
        self.drive.iter_mut().fold(torque, |torque, effect| effect.motor(torque, moment))
    }

    /// Lets a side's effects add to its load; returns the torque that they add, N·m.
    pub(crate) fn side(&mut self, load: &mut SideLoad, moment: &Moment) -> f64 {
        let own = load.load.force;
        let effects = match load.side {
            Side::Master => &mut self.master,
            Side::Slave => &mut self.slave,
        };
        for effect in effects {
            effect.side(load, moment);
        }
        load.load.force - own
    }

    /// Calls the effects of the line, then those of the side at its `end`.
    #[inline]
    pub(crate) fn links(&mut self, end: End, call: impl FnMut(&mut Box<dyn Effect>)) {
        let at_end = match end {
            End::Master => &mut self.master,
            End::Slave => &mut self.slave,
        };
        self.line.iter_mut().chain(at_end).for_each(call);
    }

    /// A line's loss coefficient with effects, N·s/m.
    pub(crate) fn fluid(&mut self, coefficient: f64, moment: &Moment) -> f64 {
        self.line
            .iter_mut()
            .fold(coefficient, |coefficient, effect| effect.fluid(coefficient, moment))
    }

    /// Reports the displacement of a line's fluid in the step, m.
    pub(crate) fn flowed(&mut self, line: usize, displacement_m: f64, moment: &Moment) {
        for effect in &mut self.line {
            effect.flowed(line, displacement_m, moment);
        }
    }

    /// Reports the displacement of both sides in the step.
    pub(crate) fn moved(&mut self, [master, slave]: [f64; 2], moment: &Moment) {
        for (effects, displacement) in [(&mut self.master, master), (&mut self.slave, slave)] {
            for effect in effects {
                effect.moved(displacement, moment);
            }
        }
    }

    /// What the instruments read at the end of a step.
    pub(crate) fn sense(&mut self, motion: &Motion, motor_v: f64, hand_torque_nm: f64) -> Reading {
        let mut reading = Reading {
            motor_v,
            master_rad: motion.master_position_rad,
            slave_rad: motion.slave_position_rad,
            slave_torque_nm: hand_torque_nm,
        };
        let moment = Moment {
            time_s: motion.time_s,
            step_s: 0.0,
            master_position_rad: motion.master_position_rad,
            master_velocity_rad_s: motion.master_velocity_rad_s,
            slave_position_rad: motion.slave_position_rad,
            slave_velocity_rad_s: motion.slave_velocity_rad_s,
        };
        for effect in &mut self.sensor {
            effect.sense(&mut reading, &moment);
        }
        reading
    }
}
