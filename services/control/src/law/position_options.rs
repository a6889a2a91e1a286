//! The options of the position law and their state.

use plant::reflected_dynamics::ReflectedDynamics;
use rig::ControlOptions;

use super::observer::Disturbance;
use super::saturation::within;
use super::slave_loop::SlaveOffset;
use super::transition::Motion;

/// Replaces negative and non-finite limits and shares by 0.
pub(super) fn sanitised(mut options: ControlOptions) -> ControlOptions {
    let bounded = |value: f64| if value.is_finite() { value.max(0.0) } else { 0.0 };
    if let Some(observer) = &mut options.observer {
        observer.limit_v = bounded(observer.limit_v);
        observer.share = bounded(observer.share).min(1.0);
    }
    if let Some(slave) = &mut options.slave {
        slave.limit = bounded(slave.limit);
    }
    options.compensation.share = bounded(options.compensation.share).min(1.0);
    options
}

/// Friction beyond the line as it reaches the motor along the reference (V): a Jenkins element.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Windup {
    volts: f64,
    position: Option<f64>,
}

impl Windup {
    pub(super) fn follow(&mut self, model: &ReflectedDynamics, reference: &Motion) -> f64 {
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

/// The state of the options from step to step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct OptionState {
    pub(super) windup: Windup,
    pub(super) disturbance: Disturbance,
    pub(super) slave: SlaveOffset,
}

impl OptionState {
    /// Resets the state, when the output is released.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use plant::reflected_dynamics::FrictionCurve;

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
    fn friction_beyond_the_line_reverses_over_twice_its_windup() {
        let (model, mut windup) = (model(), Windup::default());
        let mut at = |position: f64| windup.follow(&model, &Motion::at_rest(position));
        assert_eq!(at(0.3), 0.0, "windup starts at the first position");
        assert!((at(0.35) - 0.4).abs() < 1e-12 && (at(0.6) - 1.0).abs() < 1e-12);
        assert!((at(0.6 - 0.125)).abs() < 1e-12, "half-way through the reversal");
        assert!((at(0.6 - 0.25) + 1.0).abs() < 1e-12 && (at(0.1) + 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_level_falls_with_speed_and_nan_stays_nan() {
        let (model, mut windup) = (model(), Windup::default());
        let fast = |position| Motion { position, velocity: 4.0, acceleration: 0.0 };
        windup.follow(&model, &fast(0.0));
        assert!((windup.follow(&model, &fast(1.0)) - 0.8).abs() < 1e-12);
        assert!(windup.follow(&model, &fast(f64::INFINITY)).is_nan());
    }
}
