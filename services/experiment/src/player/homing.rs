//! Homing: from the stops that a search has found to the zeros of the encoders.
//!
//! The stops are where the rig file says. With both met, under the same output, the errors of the
//! two ends cancel: the stops yield by as much, and the line winds up by as much, in opposite
//! directions. The player then takes the motor back until the line is slack (let go at once, it
//! would be flung back), asks for 0 V, sends the order to acquisition until samples show the new
//! zeros, and goes on in the new positions.

use ipc_types::{AXES, HomeOrder, Mode, Zeros};
use rig::protocol::trajectory::{Point, min_jerk};

use super::axis_homing::PendingOrder;
use super::reports::Reason;
use super::{Change, Player, Program, seconds};
use crate::range_finder::{Measured, Range};

/// Time in which the motor goes back until the line is slack (s).
const UNWIND_S: f64 = 1.0;
/// Time from then to the order (s): control has gone to 0 V by then.
const RELEASE_S: f64 = 0.1;
/// Longest time from the order to a sample with the new zeros (s).
const ORDER_LIMIT_S: f64 = 1.0;

impl Player {
    /// Tells the zeros of the newest sample before a step; `None` where positions are absolute.
    pub const fn see_zeros(&mut self, zeros: Option<Zeros>) {
        self.zeros = zeros;
    }

    /// The order to send to acquisition, after a step; the same again until samples show it.
    pub fn home_order(&self) -> Option<HomeOrder> {
        let now_ns = self.last_ns?;
        let pending = self.pending_order?;
        let due_s = UNWIND_S + RELEASE_S;
        (seconds(pending.since_ns, now_ns) >= due_s).then_some(pending.order)
    }

    /// Whether an axis has positions of its own from power-up.
    pub(super) fn is_unhomed(&self, axis: usize) -> bool {
        self.zeros.is_some_and(|zeros| !zeros.is_homed(axis))
    }

    /// Range of positions of an axis (rad or m): while it is unhomed, that of the search.
    pub(super) fn position_range(&self, program: &Program, axis: usize) -> (f64, f64) {
        match program.homing.get(axis).copied().flatten() {
            Some(homing) if self.is_unhomed(axis) => homing.search.range(),
            _ => program.limits.get(axis).copied().unwrap_or_default(),
        }
    }

    /// Begins to home an axis whose stops were found; `false` for an axis with absolute encoders.
    ///
    /// # Errors
    /// Why the range cannot be that of the rig file.
    pub(super) fn begin_homing(
        &mut self,
        program: &Program,
        axis: usize,
        range: &Range,
        now_ns: u64,
    ) -> Result<bool, Reason> {
        let (Some(homing), Some(zeros)) = (program.homing[axis], self.zeros) else {
            return Ok(false);
        };
        let zero = homing.zero(range)?;
        let last = if range.windup > 0.0 { range.upper.motor } else { range.lower.motor };
        let unwinds = (last, last - range.windup);
        let moved = |end: Measured| Measured {
            motor: end.motor - zero.motor,
            handle: end.handle - zero.handle,
        };
        let range = Range { lower: moved(range.lower), upper: moved(range.upper), ..*range };
        let order = homing.order(axis, zero, &zeros);
        self.pending_order = Some(PendingOrder { order, since_ns: now_ns, unwinds, range });
        Ok(true)
    }

    /// The references and the mode while the line is unwound, and then while the positions begin to
    /// count from another zero.
    pub(super) fn homing_points(
        &mut self,
        program: &Program,
        pending: &PendingOrder,
        now_ns: u64,
        measured: &[f64; AXES],
    ) -> ([Point; AXES], Mode) {
        let since_s = seconds(pending.since_ns, now_ns);
        if since_s >= UNWIND_S {
            self.find_axes(program, measured);
            return (self.rest.map(Point::at_rest), Mode::Passive);
        }
        let mut points = self.rest.map(Point::at_rest);
        let (from, to) = pending.unwinds;
        points[usize::from(pending.order.axis)] = min_jerk(from, to, since_s, UNWIND_S);
        (points, Mode::Initialise)
    }

    /// Whether samples show the zeros that were ordered: `Ok` with the ends in the new positions,
    /// a change where the protocol ends; `None` while no order is on its way.
    pub(super) fn await_homing(
        &mut self,
        program: &Program,
        segment: usize,
        now_ns: u64,
        measured: &[f64; AXES],
    ) -> Option<Result<(usize, Range), Option<Change>>> {
        let pending = self.pending_order?;
        let axis = usize::from(pending.order.axis);
        let shown = self.zeros.is_some_and(|zeros| {
            zeros.is_homed(axis)
                && zeros.master[axis] == pending.order.master_zero
                && zeros.sequence > pending.order.homing_sequence
        });
        if shown {
            self.pending_order = None;
            return Some(Ok((axis, pending.range)));
        }
        if seconds(pending.since_ns, now_ns) <= UNWIND_S + RELEASE_S + ORDER_LIMIT_S {
            return Some(Err(None));
        }
        self.pending_order = None;
        Some(Err(Some(self.let_go(program, segment, Reason::NotHomed, measured))))
    }
}
