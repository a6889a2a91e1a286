//! Friction compensation from the identified model, in place of the printed triangle of fig. 4.3A.
//!
//! The printed feed-forward has one friction, that of the motor with all that it moves, and turns
//! its sign where the reference turns. The declared model knows more: friction falls and rises with
//! speed (§ 3.2.1), and what rubs beyond the line is felt only as the line is wound up the other
//! way. So what rubs at the motor has the sign of the reference's velocity, smooth through zero;
//! and what rubs beyond the line is an elastic part that slips (Jenkins's element): it follows the
//! reference's way with the line's stiffness, and stays within the friction at that speed.

use ipc_types::AXES;
use rig::CompensationKind;

use super::blend::Motion;
use super::bounds::{soft_sign, within};
use super::feedforward::friction;
use super::observer::OBSERVER_SLEW_S;
use super::options::Windup;
use super::{AxisLaw, FRICTION_SLEW_S};

impl AxisLaw {
    /// Highest friction compensation (V).
    pub(super) fn friction_peak(&self) -> f64 {
        let compensation = &self.control.options.compensation;
        match (compensation.kind, &self.model) {
            (CompensationKind::Printed, _) => self.control.feedforward.friction_peak_v,
            (CompensationKind::Identified, Some(model)) => {
                let peak_v = compensation.share
                    * (model.master_friction.peak_v() + model.slave_friction.peak_v());
                // A minimum would make a number of what is none.
                if peak_v >= 0.0 { peak_v.min(self.control.output_limit_v) } else { 0.0 }
            }
            _ => 0.0,
        }
    }

    /// Most that the options make the output change in a step, on top of a law with the printed
    /// feed-forward (V).
    pub(super) fn options_step_v(&self, period_s: f64) -> f64 {
        let observer_v = self.control.options.observer.map_or(0.0, |observer| observer.limit_v);
        period_s * (self.friction_peak() / FRICTION_SLEW_S + observer_v / OBSERVER_SLEW_S)
    }

    /// Volts per acceleration of the feed-forward (V·s²/rad or V·s²/m).
    pub(super) fn inertia(&self) -> f64 {
        match (self.control.options.compensation.kind, &self.model) {
            (CompensationKind::Printed, _) => self.control.feedforward.inertia_v,
            (CompensationKind::Identified, Some(model)) => model.inertia_v,
            _ => 0.0,
        }
    }

    /// What the friction compensation asks for (V), for a reference and its movement's peak speed
    /// (rad/s or m/s).
    pub(super) fn friction_wanted(
        &self,
        windup: &mut Windup,
        reference: &Motion,
        peak_speed: f64,
    ) -> f64 {
        let compensation = &self.control.options.compensation;
        match (compensation.kind, &self.model) {
            (CompensationKind::Printed, _) => friction(
                reference.velocity,
                peak_speed,
                self.control.feedforward.friction_peak_v,
                self.control.feedforward.friction_floor_v,
            ),
            (CompensationKind::Identified, Some(model)) => {
                let near = model.master_friction.level_v(reference.velocity);
                let sign = soft_sign(reference.velocity, compensation.reversal_speed);
                let peak = self.friction_peak();
                let wanted = compensation.share * (near * sign + windup.follow(model, reference));
                if wanted.is_finite() { within(wanted, peak) } else { wanted }
            }
            _ => 0.0,
        }
    }
}

/// Volts that were at the motor when the card took a sample (V), as far as it says so.
pub(super) fn written_v(sample: &ipc_types::Sample, axis: usize) -> f64 {
    debug_assert!(axis < AXES);
    let volts = if sample.motor_present & (1 << axis) != 0 {
        sample.motor_v[axis]
    } else {
        sample.output_v[axis]
    };
    if volts.is_finite() { volts } else { 0.0 }
}
