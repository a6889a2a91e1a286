//! Force control: the machine renders an impedance, so that the hand feels a spring, a damper and
//! an inertia ([`Mode::Impedance`], [`Mode::Rhythm`]).
//!
//! The thesis's command IMPEDENCE is something else: a sine under position control, played here as
//! a `guided_sine` segment in [`Mode::Position`].
//!
//! [`Mode::Impedance`]: ipc_types::Mode::Impedance
//! [`Mode::Rhythm`]: ipc_types::Mode::Rhythm
//! [`Mode::Position`]: ipc_types::Mode::Position

use ipc_types::{MotorCommand, Sample, Setpoint};

use super::field::{Handle, field_torque};
use super::force_law::{end_stop_torque, step};
use super::{AUTHORITY_S, Axis, Controller, Law, handle_position, within};

impl Law {
    /// Whether every axis has force control and a measured torque.
    pub(super) fn has_force_control(&self, sample: &Sample) -> bool {
        (0..self.config.axes).all(|axis| {
            self.config.axis[axis].control.force.is_some()
                && sample.torque_present & (1 << axis) != 0
                && sample.slave_torque[axis].is_finite()
        })
    }

    /// Position, velocity and acceleration of the handle on each axis of the rig.
    fn handle(&self, sample: &Sample) -> Handle {
        let mut handle = Handle::default();
        for (index, axis) in self.axis.iter().enumerate().take(self.config.axes) {
            handle.position[index] = handle_position(sample, index);
            handle.velocity[index] = axis.handle.velocity();
            handle.acceleration[index] = axis.acceleration.velocity();
        }
        handle
    }

    /// Writes the force control of one axis into the command. Returns false if a value is not
    /// finite.
    pub(super) fn control_force(
        &mut self,
        index: usize,
        sample: &Sample,
        setpoint: &Setpoint,
        elapsed_s: f64,
        command: &mut MotorCommand,
    ) -> bool {
        let handle = self.handle(sample);
        let (law, axis) = (&self.config.axis[index], &mut self.axis[index]);
        let Some(force) = &law.control.force else { return false };
        let limit_v = axis.limit_v;
        // The field's inertia term, the least certain one, is limited to the torque that takes the
        // output to its limit.
        let most = limit_v / force.volts_per_hand_torque();
        let (lowest, highest) = law.hand_range(axis.homed);
        let field = field_torque(setpoint, index, &handle, most)
            + end_stop_torque(force, handle.position[index], lowest, highest);
        let torque = sample.slave_torque[index] + field;
        let before_v = if axis.controller == Controller::Force { axis.force_v } else { 0.0 };
        // The motor's speed, since most of the friction is at the motor.
        axis.force_v = step(force, before_v, torque, axis.velocity.velocity(), elapsed_s, limit_v);
        if !axis.force_v.is_finite() {
            return false;
        }
        let wanted_v = self.latency.feedback_factor * axis.force_v;
        let carried_v = axis.carry(Controller::Force, wanted_v, limit_v * elapsed_s / AUTHORITY_S);
        let limited_v = within(wanted_v + carried_v, limit_v);
        axis.output_v = limited_v;
        let master = sample.master_position[index];
        axis.rest_at(master, sample.scan_time_ns);
        axis.transition = None;
        axis.release();
        axis.friction.reset();
        axis.inertia.reset();
        axis.options.reset();
        command.velocity[index] = axis.velocity.velocity();
        command.reference_position[index] = master;
        command.limited |= u8::from(limited_v.abs() >= limit_v);
        command.ramping |= u8::from(self.authority < 1.0 || carried_v != 0.0);
        command.volts[index] = self.authority * limited_v;
        true
    }
}

impl Axis {
    /// Bumpless transfer: the part of the last output that is still added to the `next_v` of this
    /// controller; fades by `fade_v` per step.
    pub(super) fn carry(&mut self, controller: Controller, next_v: f64, fade_v: f64) -> f64 {
        if controller == self.controller {
            self.carried_v -= self.carried_v.clamp(-fade_v, fade_v);
        } else {
            self.controller = controller;
            self.carried_v = self.output_v - next_v;
        }
        self.carried_v
    }

    /// Clears the output and all that bumpless transfer would carry over.
    pub(super) fn forget(&mut self) {
        self.force_v = 0.0;
        self.controller = Controller::default();
        self.output_v = 0.0;
        self.carried_v = 0.0;
    }
}
