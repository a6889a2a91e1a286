//! Effects by the site at which they act.

use super::{Effect, LineConstants, Moment, Side, SideLoad, Site};
use crate::ParameterError;
use crate::handle_inertia::AXES;
use crate::transmission::{Motion, Reading};

/// Effects by site.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sited {
    /// In the order of [`Site::ALL`].
    at: [Vec<Box<dyn Effect>>; 5],
    /// Inertia that they add there, kg·m².
    pub(crate) extra_inertia: [f64; 5],
    /// Products of inertia that they add to a shared handle, by axis, kg·m².
    pub(crate) handle_coupling_kg_m2: [f64; AXES],
    /// Largest factor by which effects stiffen the lines.
    pub(crate) stiffness_factor: f64,
    /// Highest rate that effects add, rad/s.
    pub(crate) rate_rad_s: f64,
    /// Which hooks must be called.
    pub(crate) reach: Reach,
}

/// Which hooks the effects of a plant have, beside those of sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Reach {
    /// None.
    #[default]
    Nothing,
    /// Those of drive and sides.
    Sides,
    /// Those of links and fluid, too.
    Links,
}

impl Reach {
    fn of(effect: &dyn Effect) -> Self {
        match effect.site() {
            Site::Sensor => Self::Nothing,
            Site::Drive => Self::Sides,
            Site::Line => Self::Links,
            Site::Master | Site::Slave if effect.acts_on_links() => Self::Links,
            Site::Master | Site::Slave => Self::Sides,
        }
    }
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
            sited.reach = sited.reach.max(Reach::of(effect.as_ref()));
            let demand = effect.demand();
            sited.stiffness_factor *= demand.stiffness_factor.max(1.0);
            sited.rate_rad_s = sited.rate_rad_s.max(demand.rate_rad_s);
            let site = effect.site() as usize;
            sited.extra_inertia[site] += effect.extra_inertia();
            let coupling = sited.handle_coupling_kg_m2.iter_mut();
            coupling.zip(effect.handle_coupling_kg_m2()).for_each(|(sum, own)| *sum += own);
            sited.at[site].push(effect);
        }
        Ok(sited)
    }

    /// Takes over what the breakdowns of another machine are at, by their numbers.
    pub(crate) fn take_over_breakdowns(&mut self, other: &Self) {
        for state in self.at.iter_mut().flatten().filter_map(|effect| effect.breakdown_mut()) {
            let mut before = other.at.iter().flatten().filter_map(|effect| effect.breakdown());
            if let Some(before) = before.find(|before| before.number == state.number) {
                *state = *before;
            }
        }
    }

    /// Ends the breakdown of that number.
    pub(crate) fn end_breakdown(&mut self, number: u64) {
        let all = self.at.iter_mut().flatten().filter_map(|effect| effect.breakdown_mut());
        all.filter(|state| state.number == number).for_each(|state| state.over = true);
    }

    /// Deflection of a link at which it carries no force, by what breakdowns have left behind, m.
    pub(crate) fn offset_m(&self, line: usize, end: usize) -> f64 {
        let all = self.at.iter().flatten().filter_map(|effect| effect.breakdown());
        all.map(|state| state.offset_m[line][end]).sum()
    }

    /// The motor's torque at the volts commanded, N·m.
    pub(crate) fn motor_torque(
        &mut self,
        volts: f64,
        torque_per_volt_nm: f64,
        moment: &Moment,
    ) -> f64 {
        let [drive, ..] = &mut self.at;
        let volts = drive.iter_mut().fold(volts, |volts, effect| effect.amplifier(volts, moment));
        let torque = torque_per_volt_nm * volts;
        drive.iter_mut().fold(torque, |torque, effect| effect.motor(torque, moment))
    }

    /// Lets a side's effects add to its load; returns the torque that they add, N·m.
    pub(crate) fn side(&mut self, load: &mut SideLoad, moment: &Moment) -> f64 {
        let own = load.load.force;
        for effect in self.line_and_side(load.side)[1].iter_mut() {
            effect.side(load, moment);
        }
        load.load.force - own
    }

    /// The effects of the line, and those of a side.
    fn line_and_side(&mut self, side: Side) -> [&mut Vec<Box<dyn Effect>>; 2] {
        let [_, master, line, slave, _] = &mut self.at;
        match side {
            Side::Master => [line, master],
            Side::Slave => [line, slave],
        }
    }

    /// Calls the effects of the line, then those of the side at its `end`.
    #[inline]
    pub(crate) fn links(&mut self, end: Side, call: impl FnMut(&mut Box<dyn Effect>)) {
        self.line_and_side(end).into_iter().flatten().for_each(call);
    }

    /// A line's loss coefficient with effects, N·s/m.
    pub(crate) fn fluid(&mut self, coefficient: f64, moment: &Moment) -> f64 {
        let line = self.at[Site::Line as usize].iter_mut();
        line.fold(coefficient, |coefficient, effect| effect.fluid(coefficient, moment))
    }

    /// Reports the displacement of a line's fluid in the step, m.
    pub(crate) fn flowed(&mut self, line: usize, displacement_m: f64, moment: &Moment) {
        for effect in &mut self.at[Site::Line as usize] {
            effect.flowed(line, displacement_m, moment);
        }
    }

    /// Reports the displacement of both sides in the step.
    pub(crate) fn moved(&mut self, [master, slave]: [f64; 2], moment: &Moment) {
        for (site, displacement) in [(Site::Master, master), (Site::Slave, slave)] {
            for effect in &mut self.at[site as usize] {
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
        let positions = [motion.master_position_rad, motion.slave_position_rad];
        let speeds = [motion.master_velocity_rad_s, motion.slave_velocity_rad_s];
        let moment = Moment::middle(motion.time_s, 0.0, &positions, &speeds);
        for effect in &mut self.at[Site::Sensor as usize] {
            effect.sense(&mut reading, &moment);
        }
        reading
    }
}
