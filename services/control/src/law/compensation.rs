//! Friction compensation from the declared model, as an alternative to the printed triangle of fig.
//! 4.3A.
//!
//! The printed feed-forward has one friction term, which changes sign where the reference does. The
//! declared model separates two: friction at the motor acts on it directly and has the sign of the
//! reference's velocity (smoothed around zero); friction beyond the line reaches the motor only as
//! the line winds up in the other direction. The second is modelled as a Jenkins element, a spring
//! in series with a friction slider: it follows the reference with the line's stiffness and
//! saturates at the friction level of the present speed (§ 3.2.1: friction falls and rises with
//! speed).

use ipc_types::AXES;
use rig::CompensationKind;

use super::feedforward::friction;
use super::observer::OBSERVER_SLEW_S;
use super::position_options::Windup;
use super::saturation::{soft_sign, within};
use super::transition::Motion;
use super::{AxisLaw, Controller, FRICTION_SLEW_S};

impl AxisLaw {
    /// The compensation that a controller uses: a search has no other than the printed one.
    pub(super) fn compensation_of(&self, controller: Controller) -> CompensationKind {
        match (controller, self.control.options.compensation.kind) {
            (Controller::Search, CompensationKind::Identified) => CompensationKind::Printed,
            (_, kind) => kind,
        }
    }

    /// Highest friction compensation of a kind (V).
    pub(super) fn friction_peak(&self, kind: CompensationKind) -> f64 {
        let compensation = &self.control.options.compensation;
        match (kind, &self.model) {
            (CompensationKind::Printed, _) => self.control.feedforward.friction_peak_v,
            (CompensationKind::Identified, Some(model)) => {
                let peak_v = compensation.share
                    * (model.master_friction.peak_v() + model.slave_friction.peak_v());
                // `min` alone would turn NaN into the limit.
                if peak_v >= 0.0 { peak_v.min(self.control.output_limit_v) } else { 0.0 }
            }
            _ => 0.0,
        }
    }

    /// Largest change of the output in one step that is due to the options, beyond that of the law
    /// with the printed feed-forward (V).
    pub(super) fn options_step_v(&self, period_s: f64) -> f64 {
        let observer_v = self.control.options.observer.map_or(0.0, |observer| observer.limit_v);
        let peak_v = [Controller::Position, Controller::Search]
            .map(|controller| self.friction_peak(self.compensation_of(controller)))
            .into_iter()
            .fold(0.0, f64::max);
        period_s * (peak_v / FRICTION_SLEW_S + observer_v / OBSERVER_SLEW_S)
    }

    /// Inertia of the feed-forward, in volts per acceleration (V·s²/rad or V·s²/m).
    pub(super) fn inertia(&self, kind: CompensationKind) -> f64 {
        match (kind, &self.model) {
            (CompensationKind::Printed, _) => self.control.feedforward.inertia_v,
            (CompensationKind::Identified, Some(model)) => model.inertia_v,
            _ => 0.0,
        }
    }

    /// Friction compensation before slew limiting (V), for a reference and the peak speed of its
    /// movement (rad/s or m/s).
    pub(super) fn friction_wanted(
        &self,
        kind: CompensationKind,
        windup: &mut Windup,
        reference: &Motion,
        peak_speed: f64,
    ) -> f64 {
        let compensation = &self.control.options.compensation;
        match (kind, &self.model) {
            (CompensationKind::Printed, _) => friction(
                reference.velocity,
                peak_speed,
                self.control.feedforward.friction_peak_v,
                self.control.feedforward.friction_floor_v,
            ),
            (CompensationKind::Identified, Some(model)) => {
                let near = model.master_friction.level_v(reference.velocity);
                let sign = soft_sign(reference.velocity, compensation.reversal_speed);
                let peak = self.friction_peak(kind);
                let wanted = compensation.share * (near * sign + windup.follow(model, reference));
                if wanted.is_finite() { within(wanted, peak) } else { wanted }
            }
            _ => 0.0,
        }
    }
}

/// Voltage at the motor when the card took a sample (V): measured if the card measures it,
/// otherwise the written one.
pub(super) fn motor_v(sample: &ipc_types::Sample, axis: usize) -> f64 {
    debug_assert!(axis < AXES);
    let volts = if sample.motor_present & (1 << axis) != 0 {
        sample.motor_v[axis]
    } else {
        sample.output_v[axis]
    };
    if volts.is_finite() { volts } else { 0.0 }
}
