//! Friction compensation from the identified model, in place of the printed triangle of fig. 4.3A.
//!
//! The printed feed-forward has one friction, that of the motor with all that it moves, and turns
//! its sign where the reference turns. The declared model knows more: friction falls and rises with
//! speed (§ 3.2.1), and what rubs beyond the line is felt only as the line is wound up the other
//! way. So what rubs at the motor has the sign of the reference's velocity, smooth through zero;
//! and what rubs beyond the line is an elastic part that slips (Jenkins's element): it follows the
//! reference's way with the line's stiffness, and stays within the friction at that speed.

use ipc_types::AXES;
use plant::reflected::ReflectedDynamics;
use rig::{CompensationKind, ControlOptions};

use super::blend::Motion;
use super::bounds::{soft_sign, within};
use super::feedforward::friction;
use super::observer::{Disturbance, OBSERVER_SLEW_S};
use super::slave::SlaveOffset;
use super::{AxisLaw, FRICTION_SLEW_S};

/// Options of the position law, and the model that they go by.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LawOptions {
    /// Which compensation, observer and loop on the slave.
    pub control: ControlOptions,
    /// What the declared model says of the axis; without it, what would go by it is silent.
    pub model: Option<ReflectedDynamics>,
}

impl LawOptions {
    /// Limits that are none, or no numbers, count as 0.
    pub(super) fn sanitised(mut self) -> Self {
        let bounded = |value: f64| if value.is_finite() { value.max(0.0) } else { 0.0 };
        if let Some(observer) = &mut self.control.observer {
            observer.limit_v = bounded(observer.limit_v);
            observer.share = bounded(observer.share).min(1.0);
        }
        if let Some(slave) = &mut self.control.slave {
            slave.limit = bounded(slave.limit);
        }
        self.control.compensation.share = bounded(self.control.compensation.share).min(1.0);
        self
    }
}

impl AxisLaw {
    /// Highest friction compensation (V).
    pub(super) fn friction_peak(&self) -> f64 {
        let compensation = &self.options.control.compensation;
        match (compensation.kind, &self.options.model) {
            (CompensationKind::Printed, _) => self.friction_peak_v,
            (CompensationKind::Identified, Some(model)) => {
                let peak_v = compensation.share
                    * (model.master_friction.peak_v() + model.slave_friction.peak_v());
                // A minimum would make a number of what is none.
                if peak_v >= 0.0 { peak_v.min(self.output_limit_v) } else { 0.0 }
            }
            _ => 0.0,
        }
    }

    /// Most that the options make the output change in a step, on top of a law with the printed
    /// feed-forward (V).
    pub(super) fn options_step_v(&self, period_s: f64) -> f64 {
        let observer_v = self.options.control.observer.map_or(0.0, |observer| observer.limit_v);
        period_s * (self.friction_peak() / FRICTION_SLEW_S + observer_v / OBSERVER_SLEW_S)
    }

    /// Volts per acceleration of the feed-forward (V·s²/rad or V·s²/m).
    pub(super) fn inertia(&self) -> f64 {
        match (self.options.control.compensation.kind, &self.options.model) {
            (CompensationKind::Printed, _) => self.inertia_v,
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
        let compensation = &self.options.control.compensation;
        match (compensation.kind, &self.options.model) {
            (CompensationKind::Printed, _) => friction(
                reference.velocity,
                peak_speed,
                self.friction_peak_v,
                self.friction_floor_v,
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

/// Friction beyond the line, as the motor feels it along the reference (V).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Windup {
    volts: f64,
    position: Option<f64>,
}

impl Windup {
    fn follow(&mut self, model: &ReflectedDynamics, reference: &Motion) -> f64 {
        let moved = reference.position - self.position.unwrap_or(reference.position);
        self.position = Some(reference.position);
        let wound = self.volts + model.line_v * moved;
        if !wound.is_finite() {
            return f64::NAN;
        }
        self.volts = within(wound, model.slave_friction.level_v(reference.velocity));
        self.volts
    }
}

/// What the options remember from step to step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OptionState {
    pub(super) windup: Windup,
    pub(super) disturbance: Disturbance,
    pub(super) slave: SlaveOffset,
}

impl OptionState {
    /// Forgets all: there is no output to go on from.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
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

#[cfg(test)]
mod tests {
    use plant::reflected::FrictionCurve;

    use super::*;

    fn model() -> ReflectedDynamics {
        ReflectedDynamics {
            inertia_v: 8e-3,
            master_friction: FrictionCurve::new(10.0, |_| 0.5),
            slave_friction: FrictionCurve::new(10.0, |speed| 1.0 - 0.05 * speed),
            windup: FrictionCurve::new(10.0, |speed| 1.0 - 0.05 * speed),
            line_v: 8.0,
            ratio: 0.85,
        }
    }

    #[test]
    fn what_rubs_beyond_the_line_turns_round_over_twice_its_windup() {
        let (model, mut windup) = (model(), Windup::default());
        let mut at = |position: f64| windup.follow(&model, &Motion::at_rest(position));
        assert_eq!(at(0.3), 0.0, "the first position is where the way begins");
        assert!((at(0.35) - 0.4).abs() < 1e-12 && (at(0.6) - 1.0).abs() < 1e-12);
        assert!((at(0.6 - 0.125)).abs() < 1e-12, "half-way back");
        assert!((at(0.6 - 0.25) + 1.0).abs() < 1e-12 && (at(0.1) + 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_level_falls_with_speed_and_nonsense_stays_nonsense() {
        let (model, mut windup) = (model(), Windup::default());
        let fast = |position| Motion { position, velocity: 4.0, acceleration: 0.0 };
        windup.follow(&model, &fast(0.0));
        assert!((windup.follow(&model, &fast(1.0)) - 0.8).abs() < 1e-12);
        assert!(windup.follow(&model, &fast(f64::INFINITY)).is_nan());
    }
}
