//! The limit on the output, and what it holds back.
//!
//! A setpoint may ask for less than the rig's own limit ([`Setpoint::output_limit_v`]). A change of
//! the limit takes [`AUTHORITY_S`] from nothing to the rig's limit, so that the output is never
//! cut.
//!
//! **Anti-windup.** In [`Mode::Initialise`](ipc_types::Mode::Initialise) the handle is driven
//! against its ends. There the reference stays within `limit / P` of the measured position: as far
//! as the limited output can hold it by its proportional part alone. A reference that ran on would
//! have to come all the way back before the output left its limit, and would leap when the limit
//! went.

use ipc_types::Setpoint;

use super::{AUTHORITY_S, Axis, AxisLaw, Motion};

/// The limit that holds for an axis (V): the setpoint's where it is a positive number below the
/// rig's.
fn wanted_v(law: &AxisLaw, setpoint: Option<&Setpoint>, axis: usize) -> f64 {
    let asked_v = setpoint.map_or(0.0, |setpoint| setpoint.output_limit_v[axis]);
    if asked_v > 0.0 { asked_v.min(law.control.output_limit_v) } else { law.control.output_limit_v }
}

impl Axis {
    /// Moves the limit on the output towards what the setpoint asks for; `begins`: there is no
    /// output yet, so it holds at once.
    pub(super) fn limit_output(
        &mut self,
        law: &AxisLaw,
        live: Option<&Setpoint>,
        index: usize,
        begins: bool,
        elapsed_s: f64,
    ) {
        let wanted_v = wanted_v(law, live, index);
        let largest = law.control.output_limit_v * elapsed_s / AUTHORITY_S;
        self.limit_v = if begins {
            wanted_v
        } else {
            self.limit_v + (wanted_v - self.limit_v).clamp(-largest, largest)
        };
    }

    /// Where the reference is: that of the last step where it was held back, else along target and
    /// blend.
    pub(super) fn present_reference(&self, time_ns: u64) -> Motion {
        if self.held_back { self.reference } else { self.reference_at(time_ns) }
    }

    /// Holds the reference within what the limited output can hold against `position`; at rest
    /// where it is held. A reference that is further off when this begins is drawn near as fast as
    /// the limit may change.
    pub(super) fn hold_back(
        &mut self,
        law: &AxisLaw,
        position: f64,
        initialises: bool,
        elapsed_s: f64,
    ) {
        let gain = law.control.position_gain.abs();
        let wanted = self.limit_v / gain;
        // Without a gain the output holds nothing, and there is nothing to wind up.
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

    /// Nothing holds the reference back.
    pub(super) const fn release(&mut self) {
        self.lead = f64::INFINITY;
        self.held_back = false;
    }
}
