//! The limit on the output, and anti-windup.
//!
//! A setpoint may lower the rig's own limit ([`Setpoint::output_limit_v`]). The limit changes
//! gradually, by its full range in [`AUTHORITY_S`], so that the output never steps.
//!
//! **Anti-windup.** In [`Mode::Initialise`](ipc_types::Mode::Initialise) the handle is driven
//! against its end stops. There the reference stays within `limit / P` of the measured position,
//! which is as far as the proportional feedback can hold it with the limited output. A reference
//! that ran on would have to return all the way before the output left its limit, and the handle
//! would jump when the limit was raised.

use ipc_types::Setpoint;

use super::{AUTHORITY_S, Axis, AxisLaw, Motion};

/// The limit requested for an axis (V): the setpoint's if it is positive and below the rig's,
/// otherwise the rig's, which is that of homing while the axis is unhomed.
fn wanted_v(law: &AxisLaw, setpoint: Option<&Setpoint>, axis: usize, homed: bool) -> f64 {
    let asked_v = setpoint.map_or(0.0, |setpoint| setpoint.output_limit_v[axis]);
    let own_v = law.output_limit_v(homed);
    if asked_v > 0.0 { asked_v.min(own_v) } else { own_v }
}

impl Axis {
    /// Moves the limit on the output towards the requested one. `begins`: there is no output yet,
    /// so it applies at once.
    pub(super) fn limit_output(
        &mut self,
        law: &AxisLaw,
        live: Option<&Setpoint>,
        index: usize,
        begins: bool,
        elapsed_s: f64,
    ) {
        let wanted_v = wanted_v(law, live, index, self.homed);
        let largest = law.control.output_limit_v * elapsed_s / AUTHORITY_S;
        self.limit_v = if begins {
            wanted_v
        } else {
            self.limit_v + (wanted_v - self.limit_v).clamp(-largest, largest)
        };
    }

    /// The present reference: that of the last step if anti-windup held it back, otherwise that of
    /// target and transition.
    pub(super) fn present_reference(&self, time_ns: u64) -> Motion {
        if self.held_back { self.reference } else { self.reference_at(time_ns) }
    }

    /// Anti-windup: limits the distance of the reference from the measured `position` to what the
    /// limited output can hold. A reference that is farther away at first is drawn in at the rate
    /// at which the limit may change.
    pub(super) fn hold_back(
        &mut self,
        law: &AxisLaw,
        position: f64,
        initialises: bool,
        elapsed_s: f64,
    ) {
        let gain = law.control.position_gain.abs();
        let wanted = self.limit_v / gain;
        // Without a gain there is no feedback to wind up.
        if !initialises || !wanted.is_finite() || !self.reference.is_finite() {
            self.release();
            return;
        }
        let offset = self.reference.position - position;
        let largest = law.control.output_limit_v * elapsed_s / AUTHORITY_S / gain;
        self.lead = wanted.max(self.lead.min(offset.abs()) - largest);
        self.held_back = offset.abs() > self.lead;
        if self.held_back {
            self.reference = Motion::at_rest(position + self.lead.copysign(offset));
        }
    }

    /// Ends anti-windup: the reference is free.
    pub(super) const fn release(&mut self) {
        self.lead = f64::INFINITY;
        self.held_back = false;
    }
}
