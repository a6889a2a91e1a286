//! Position control: one step of feedback, feed-forward and the options.

use ipc_types::{Mode, MotorCommand, Sample, Setpoint};
use rig::CompensationKind;

use super::compensation::motor_v;
use super::transition::Motion;
use super::{
    AUTHORITY_S, Axis, AxisLaw, Controller, FRICTION_SLEW_S, INERTIA_SLEW_S, Law, observer,
    slave_loop, within,
};

/// Share of the reversal speed below which the reference counts as at rest.
const RESTS: f64 = 0.1;
/// Share of the range of positions that the loop on the slave keeps the master off either end.
const LIMIT_MARGIN: f64 = 0.025;

impl Law {
    /// Writes feedback, feed-forward and the options' contributions of one axis into the command.
    /// Returns false if they are not finite.
    pub(super) fn control_position(
        &mut self,
        index: usize,
        sample: &Sample,
        live: Option<&Setpoint>,
        elapsed_s: f64,
        command: &mut MotorCommand,
    ) -> bool {
        let (time_ns, position) = (sample.scan_time_ns, sample.master_position[index]);
        let law = &self.config.axis[index];
        let axis = &mut self.axis[index];
        let velocity = axis.velocity.velocity();
        command.velocity[index] = velocity;
        if self.source.is_none() {
            axis.rest_at(position, time_ns);
            command.reference_position[index] = position;
            return true;
        }
        let mode = Mode::from_code(command.mode).unwrap_or(Mode::Hold);
        let controller = Controller::of(mode, axis.homed);
        let searches = controller == Controller::Search;
        if searches {
            axis.options.reset();
        }
        let kind = law.compensation_of(controller);
        let peak_speed = live.map_or(0.0, |setpoint| setpoint.peak_speed[index].max(0.0));
        let peak_speed = axis
            .transition
            .map_or(peak_speed, |transition| peak_speed.max(transition.peak_speed()));
        let reference = if searches {
            axis.reference
        } else {
            axis.master_reference(law, sample, index, peak_speed, elapsed_s)
        };
        let friction_v =
            law.friction_wanted(kind, &mut axis.options.windup, &reference, peak_speed);
        let friction_v =
            axis.friction.follow(friction_v, law.friction_peak(kind) * elapsed_s / FRICTION_SLEW_S);
        let limit_v = axis.limit_v;
        let inertia_v = within(law.inertia(kind) * reference.acceleration, limit_v);
        let inertia_v = axis.inertia.follow(inertia_v, limit_v * elapsed_s / INERTIA_SLEW_S);
        let observed_v =
            if searches { 0.0 } else { axis.observed(law, sample, index, friction_v, elapsed_s) };
        let feedforward_v = friction_v + inertia_v + observed_v;
        let feedback_v = self.latency.feedback_factor
            * (law.control.position_gain * (reference.position - position)
                + law.control.velocity_gain * (reference.velocity - velocity));
        let wanted_v = feedback_v + feedforward_v;
        if !wanted_v.is_finite() {
            return false;
        }
        let carried_v =
            axis.carry(controller, within(wanted_v, limit_v), limit_v * elapsed_s / AUTHORITY_S);
        // Limited before it is scaled by the authority, so that the ramp to 0 V begins at the
        // actual output.
        let wanted_v = wanted_v + carried_v;
        let limited_v = within(wanted_v, limit_v);
        axis.output_v = limited_v;
        command.limited |= u8::from(limited_v != wanted_v);
        command.ramping |=
            u8::from(axis.transition.is_some() || self.authority < 1.0 || carried_v != 0.0);
        command.volts[index] = self.authority * limited_v;
        command.feedforward_v[index] = self.authority * feedforward_v;
        command.reference_position[index] = reference.position;
        command.reference_velocity[index] = reference.velocity;
        reference.is_finite()
    }
}

impl Axis {
    /// The master's reference: that of the movement, plus the offset of the slave loop if there is
    /// one.
    fn master_reference(
        &mut self,
        law: &AxisLaw,
        sample: &Sample,
        index: usize,
        peak_speed: f64,
        elapsed_s: f64,
    ) -> Motion {
        let (Some(settings), Some(model)) = (&law.control.options.slave, &law.model) else {
            return self.reference;
        };
        let position = sample.slave_position[index];
        let seen = slave_loop::Seen {
            desired: self.reference,
            position: (sample.slave_present & (1 << index) != 0 && position.is_finite())
                .then_some(position),
            master: sample.master_position[index],
            peak_speed,
            speed: law.catch_up_speed().abs(),
            elapsed_s,
        };
        let shifted = self.reference.plus(&self.options.slave.step(settings, model, &seen));
        self.within_limits(law, shifted)
    }

    /// The master's reference, kept off its position limits. A handle that lies at a stop cannot
    /// follow further: the loop would wind up the line until the master passes its limit. The
    /// movement itself, without the loop, may go as far as the limits let it.
    fn within_limits(&mut self, law: &AxisLaw, shifted: Motion) -> Motion {
        let (lowest, highest) = law.position_range(self.homed);
        let margin = LIMIT_MARGIN * (highest - lowest);
        let least = (lowest + margin).min(self.reference.position);
        let most = (highest - margin).max(self.reference.position);
        let end = match shifted.position {
            position if position < least => least,
            position if position > most => most,
            _ => return shifted,
        };
        let held = Motion::at_rest(end);
        self.options.slave.hold(held.minus(&self.reference));
        held
    }

    /// Contribution of the disturbance observer (V).
    fn observed(
        &mut self,
        law: &AxisLaw,
        sample: &Sample,
        index: usize,
        friction_v: f64,
        elapsed_s: f64,
    ) -> f64 {
        let options = &law.control.options;
        let (Some(settings), Some(model)) = (&options.observer, &law.model) else {
            return 0.0;
        };
        let compensated_v =
            if options.compensation.kind == CompensationKind::None { 0.0 } else { friction_v };
        let seen = observer::Seen {
            volts: motor_v(sample, index) - compensated_v,
            velocity: self.velocity.velocity(),
            moves: self.reference.velocity.abs() > RESTS * options.compensation.reversal_speed,
            elapsed_s,
        };
        self.options.disturbance.step(settings, model.inertia_v, &seen)
    }
}
