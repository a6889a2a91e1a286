//! Segments that depend on measurements: the search for the ends of travel, and the beat of a
//! rhythm.

use ipc_types::AXES;
use rig::protocol::Movement;

use super::reports::{Notice, Reason};
use super::{Change, Phase, Player, Program, seconds};
use crate::range_finder::{FinderState, Measured, Range, RangeFinder};

impl Player {
    /// Sets the positions of the handles' own encoders (rad or m) before a step; NaN where there is
    /// none.
    pub fn see_handles(&mut self, handles: [f64; AXES]) {
        self.handles = handles;
    }

    /// Takes the report of the last step, if there is one.
    pub fn take_notice(&mut self) -> Option<Notice> {
        self.notice.take()
    }

    /// Advances the search for the ends of travel, if that is the segment's kind: `Ok` with the
    /// segment's end (ns) once they are found, a change where the protocol ends.
    pub(super) fn find_range(
        &mut self,
        program: &Program,
        segment: usize,
        begun_ns: u64,
        now_ns: u64,
        measured: &[f64; AXES],
    ) -> Option<Result<u64, Option<Change>>> {
        let step = program.steps.get(segment)?;
        let (Movement::Initialise(how), axis) = (&step.track.movement, step.axis) else {
            return None;
        };
        if let Some(homed) = self.await_homing(program, segment, now_ns, measured) {
            return Some(homed.and_then(|(axis, range)| {
                self.end_search(program, segment, (begun_ns, now_ns), axis, &range, measured)
            }));
        }
        let range = self.position_range(program, axis);
        // Positions that are absolute need no zero: an end is where the handle stops.
        let stops = self.zeros.and(program.homing[axis]).map(|homing| homing.stops(how.volts));
        if self.finder.is_none() {
            self.find_axes(program, measured);
            self.finder = Some(RangeFinder::new(*how, self.rest[axis], range, stops));
        }
        let finder = self.finder.as_mut()?;
        let handle =
            if self.handles[axis].is_finite() { self.handles[axis] } else { measured[axis] };
        let reason = match finder
            .step(seconds(begun_ns, now_ns), Measured { motor: measured[axis], handle })
        {
            FinderState::Going => return Some(Err(None)),
            FinderState::TimedOut => Reason::NotFound,
            FinderState::Stuck => Reason::Stuck,
            FinderState::Found(range) => match self.begin_homing(program, axis, &range, now_ns) {
                Ok(true) => return Some(Err(None)),
                Ok(false) => {
                    let times = (begun_ns, now_ns);
                    return Some(self.end_search(program, segment, times, axis, &range, measured));
                }
                Err(reason) => {
                    self.notice = Some(Notice::Range { axis, range, narrower: false });
                    reason
                }
            },
        };
        Some(Err(Some(self.let_go(program, segment, reason, measured))))
    }

    /// Reports the range, and ends the segment where the rest of the protocol stays within it.
    fn end_search(
        &mut self,
        program: &Program,
        segment: usize,
        (begun_ns, now_ns): (u64, u64),
        axis: usize,
        range: &Range,
        measured: &[f64; AXES],
    ) -> Result<u64, Option<Change>> {
        let Some(Movement::Initialise(how)) =
            program.steps.get(segment).map(|step| &step.track.movement)
        else {
            return Err(None);
        };
        let limits = program.limits[axis];
        let (lower, upper) = (range.lower.motor, range.upper.motor);
        let narrower = lower > limits.0 + how.tolerance || upper < limits.1 - how.tolerance;
        self.notice = Some(Notice::Range { axis, range: *range, narrower });
        // If an end was not met, the rig's own limit applies.
        let free = (
            if range.met.0 { lower } else { limits.0 },
            if range.met.1 { upper } else { limits.1 },
        );
        if program.fits(segment + 1, axis, free) {
            self.early_s += how.duration_s - seconds(begun_ns, now_ns);
            return Ok(now_ns);
        }
        Err(Some(self.let_go(program, segment, Reason::OutOfRange, measured)))
    }

    /// Ends the protocol; control ramps the output down from its present value.
    pub(super) fn let_go(
        &mut self,
        program: &Program,
        segment: usize,
        reason: Reason,
        measured: &[f64; AXES],
    ) -> Change {
        self.find_axes(program, measured);
        self.phase = Phase::Idle;
        Change::Aborted(segment as u32, reason)
    }

    /// Reports the beat of a rhythm when it is due.
    pub(super) fn announce_beat(
        &mut self,
        program: &Program,
        segment: usize,
        begun_ns: u64,
        now_ns: u64,
    ) {
        let Some(Movement::Rhythm(rhythm)) =
            program.steps.get(segment).map(|step| &step.track.movement)
        else {
            return;
        };
        let told = if self.beat.0 == begun_ns { self.beat.1 } else { 0 };
        if let Some((number, position)) = rhythm.beat(seconds(begun_ns, now_ns))
            && number > told
        {
            self.beat = (begun_ns, number);
            self.notice = Some(Notice::Beat { position, number });
        }
    }
}
