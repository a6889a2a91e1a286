//! Computes the setpoint for an instant.

use ipc_types::{AXES, Mode, Process, Setpoint};
use rig::protocol::Movement;
use rig::protocol::trajectory::{Point, stopping};

use super::{LEASE_NS, Phase, Player, Program, STOP_FADE_NS, is_given_away, seconds};
use crate::field_setpoint::put;

impl Player {
    /// Sets the rest positions to the measured ones, within the limits; a position that is not
    /// finite changes nothing.
    pub(super) fn find_axes(&mut self, program: &Program, measured: &[f64; AXES]) {
        for (axis, measured) in measured.iter().enumerate() {
            let (least, most) = self.position_range(program, axis);
            if measured.is_finite() {
                self.rest[axis] = measured.max(least).min(most);
            }
        }
    }

    /// References of all axes at time `t` into a segment.
    pub(super) fn points(&self, program: &Program, segment: usize, t: f64) -> [Point; AXES] {
        let mut points = self.rest.map(Point::at_rest);
        if let Some(step) = program.steps.get(segment) {
            for (axis, track) in step.tracks() {
                points[axis] = track.at(self.rest[axis], t);
            }
            match (&step.track.movement, &self.finder, &self.ilc) {
                (Movement::Initialise(_), Some(finder), _) => points[step.axis] = finder.point(),
                (_, _, Some(ilc)) => points[step.axis] = ilc.at(self.last_ns.unwrap_or_default()),
                _ => {}
            }
        }
        points
    }

    pub(super) fn setpoint(
        &mut self,
        program: &Program,
        now_ns: u64,
        measured: &[f64; AXES],
    ) -> Setpoint {
        let (segment, points, mode) = match (self.phase, self.pending_order) {
            (Phase::Playing { segment, .. }, Some(pending)) => {
                let (points, mode) = self.homing_points(program, &pending, now_ns, measured);
                (segment, points, mode)
            }
            (Phase::Idle, _) => {
                self.find_axes(program, measured);
                (self.segment as usize, self.rest.map(Point::at_rest), Mode::Passive)
            }
            (Phase::Entering { segment, .. }, _) => {
                (segment, self.rest.map(Point::at_rest), Mode::Passive)
            }
            (Phase::Playing { segment, begun_ns }, _) => {
                let t = seconds(begun_ns, now_ns);
                self.elapsed_s = program
                    .steps
                    .get(segment)
                    .map_or(0.0, |step| step.begins_s + t.min(step.track.duration_s()))
                    - self.early_s;
                let mode = program
                    .steps
                    .get(segment)
                    .map_or(Mode::Passive, |step| step.track.movement.mode(t));
                if is_given_away(program, segment) && mode != Mode::Initialise {
                    self.find_axes(program, measured);
                }
                (segment, self.points(program, segment, t), mode)
            }
            (Phase::Stopping { segment, begun_ns, stopped_ns }, _) => {
                let moving = self.points(program, segment, seconds(begun_ns, now_ns));
                let (since, fade) = (seconds(stopped_ns, now_ns), seconds(0, STOP_FADE_NS));
                let mut points = moving;
                for (point, hold) in points.iter_mut().zip(self.hold) {
                    *point = stopping(*point, hold, since, fade);
                }
                let mode = if self.ilc.is_some() { Mode::Learning } else { Mode::Position };
                (segment, points, mode)
            }
            (Phase::Holding { segment, .. }, _) => {
                (segment, self.rest.map(Point::at_rest), Mode::Hold)
            }
        };
        self.segment = segment as u32;
        let mut setpoint = Setpoint {
            at_ns: now_ns,
            lease_until_ns: now_ns + LEASE_NS,
            protocol: program.identity,
            homing_sequence: self.zeros.map_or(0, |zeros| zeros.sequence),
            position: points.map(|point| point.position),
            velocity: points.map(|point| point.velocity),
            acceleration: points.map(|point| point.acceleration),
            peak_speed: points.map(|point| point.peak_speed),
            segment: segment as u32,
            segments: program.steps.len() as u32,
            mode: mode.code(),
            owner: Process::Experiment.code(),
            axes: program.axes as u8,
            ..Setpoint::default()
        };
        if mode.is_force_controlled()
            && let Some(step) = program.steps.get(segment)
        {
            for (axis, track) in step.tracks() {
                if let Some(field) = track.movement.field() {
                    put(&mut setpoint, axis, field);
                }
            }
        }
        if let Some(step) = program.steps.get(segment).filter(|_| mode == Mode::Initialise)
            && let Some(limit_v) = step.track.movement.output_limit_v()
        {
            setpoint.output_limit_v[step.axis] = limit_v;
        }
        setpoint
    }
}
