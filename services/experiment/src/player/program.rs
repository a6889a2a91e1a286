//! A protocol made ready for one machine.

use std::sync::Arc;

use ipc_types::AXES;
use rig::protocol::{Field, Movement, Protocol, Segment};
use rig::{ProtocolError, RigFile};
use scanner::LineKind;

use crate::ilc_update::Plan;
use crate::matching_bar::Matched;
use crate::prepared_movement::PreparedMovement;
use crate::scan_tracker::{ScanPlan, ScanState};
use crate::session_state::SessionState;
use crate::session_tracker::{PlayedSegment, SessionPlan};
use crate::state::PlayerState;

use super::axis_homing::AxisHoming;

/// A protocol made ready for one machine.
#[derive(Debug)]
pub struct Program {
    pub(super) name: String,
    pub(super) text: String,
    pub(super) identity: u64,
    pub(super) axes: usize,
    /// Position limits of each axis (rad or m).
    pub(super) limits: [(f64, f64); AXES],
    /// How each axis with incremental encoders is homed.
    pub(super) homing: [Option<AxisHoming>; AXES],
    pub(super) steps: Vec<Step>,
    /// What it says of the scanner.
    pub(super) scan: ScanPlan,
    /// Its sessions.
    sessions: SessionPlan,
    /// Whether it goes on after a restart of the process.
    pub(super) resumes: bool,
    pub(super) duration_s: f64,
}

/// One played segment; repeats are written out.
#[derive(Debug)]
pub(super) struct Step {
    pub(super) label: String,
    pub(super) axis: usize,
    pub(super) track: PreparedMovement,
    /// Movements of other axes in the same segment.
    pub(super) others: Vec<(usize, PreparedMovement)>,
    /// Time of its beginning, from the start of the protocol (s).
    pub(super) begins_s: f64,
    /// The learning run, if the segment is one.
    pub(super) plan: Option<Arc<Plan>>,
    /// Number of the session that it is, from 1; `None` where it is none.
    session: Option<u32>,
}

impl Step {
    /// Every axis that moves, with its movement.
    pub(super) fn tracks(&self) -> impl Iterator<Item = (usize, &PreparedMovement)> {
        std::iter::once((self.axis, &self.track))
            .chain(self.others.iter().map(|(axis, track)| (*axis, track)))
    }
}

impl Program {
    /// Checks a protocol against a rig and prepares it for playing.
    ///
    /// # Errors
    /// The errors of [`Protocol::check_against`].
    pub fn new(protocol: &Protocol, rig: &RigFile) -> Result<Self, ProtocolError> {
        protocol.check_against(rig)?;
        let segments = protocol.segments_on(rig);
        let tracks: Vec<_> = segments
            .iter()
            .map(|segment| PreparedMovement::new(segment.movement.clone()))
            .collect();
        let plans: Vec<_> = segments
            .iter()
            .map(|segment| match &segment.movement {
                Movement::Learn(learn) => Plan::new(learn, segment.axis, rig).map(Arc::new),
                _ => None,
            })
            .collect();
        let (mut begins_s, mut sessions) = (0.0, 0);
        let mut steps = Vec::with_capacity(protocol.count());
        for (index, segment) in protocol.sequence_of(&segments) {
            let track = tracks[index].clone();
            let others = segment
                .companions
                .iter()
                .map(|other| (other.axis, PreparedMovement::new(other.movement.clone())));
            let others = others.collect();
            let duration_s = track.duration_s();
            let plan = plans[index].clone();
            sessions += u32::from(segment.session);
            steps.push(Step {
                label: segment.label.clone(),
                axis: segment.axis,
                track,
                others,
                begins_s,
                plan,
                session: segment.session.then_some(sessions),
            });
            begins_s += duration_s;
        }
        let mut limits = [(0.0, 0.0); AXES];
        let mut homing = [None; AXES];
        for ((limit, homing), axis) in limits.iter_mut().zip(&mut homing).zip(&rig.axes) {
            *limit = (axis.limits.position_min, axis.limits.position_max);
            *homing = AxisHoming::of(axis);
        }
        Ok(Self {
            name: protocol.name.clone(),
            text: protocol.text().to_owned(),
            identity: protocol.identity(),
            axes: rig.axes.len(),
            limits,
            homing,
            steps,
            scan: ScanPlan {
                scan: protocol.scan,
                waits: segments.iter().any(Segment::waits_for_scanner),
                gate_width_s: rig
                    .scanner
                    .filter(|line| line.line.kind == LineKind::Gate)
                    .map(|line| line.line.minimum_width_s),
                emulated_s: None,
            },
            sessions: SessionPlan {
                sessions,
                matched: protocol
                    .matching
                    .map(|matching| Matched { signal: matching.signal, axis: matching.axis }),
            },
            resumes: protocol.resumes,
            duration_s: begins_s,
        })
    }

    /// The same, with an emulated scanner of this repetition time (s) in place of the trigger line.
    #[must_use]
    pub fn with_emulated_scanner(mut self, repetition_s: f64) -> Self {
        self.scan.emulated_s = Some(repetition_s);
        self
    }

    /// Whether it needs the scanner's trigger line.
    pub fn needs_trigger(&self) -> bool {
        let ScanPlan { scan, waits, emulated_s, .. } = self.scan;
        (waits || scan.is_some()) && emulated_s.is_none()
    }

    /// Name of the protocol.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Identity of its text.
    pub fn identity(&self) -> u64 {
        self.identity
    }

    /// The state in `session` of the rig before the first segment, for the client that started it
    /// in the enable `epoch`; see [`PlayerState`].
    pub fn state(&self, session: u64, epoch: u64, client: u64) -> PlayerState {
        PlayerState {
            session,
            name: self.name.clone(),
            text: self.text.clone(),
            protocol: self.identity,
            segment: 0,
            running: false,
            epoch,
            client,
            scan: ScanState::default(),
            sessions: SessionState::default(),
        }
    }

    /// Its sessions.
    pub const fn sessions(&self) -> SessionPlan {
        self.sessions
    }

    /// A segment that began at `begun_ns` (CLOCK_MONOTONIC); `None` where there is none.
    pub fn played(&self, segment: usize, begun_ns: u64) -> Option<PlayedSegment> {
        self.steps.get(segment).map(|step| PlayedSegment {
            segment: segment as u32,
            begun_ns,
            planned_s: step.track.duration_s(),
            session: step.session,
            rest: matches!(step.track.movement, Movement::Rest(_)),
        })
    }

    /// The sessions that are over where this segment begins.
    pub fn sessions_before(&self, segment: usize) -> u32 {
        self.steps.iter().take(segment).filter_map(|step| step.session).max().unwrap_or(0)
    }

    /// Number of segments, repeats counted.
    pub fn segments(&self) -> usize {
        self.steps.len()
    }

    /// Name of a segment; empty where there is none.
    pub fn label(&self, segment: usize) -> &str {
        self.steps.get(segment).map_or("", |step| &step.label)
    }

    /// Total duration (s).
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Whether the segments from `from` on keep an axis within a range (rad or m).
    pub(super) fn fits(&self, from: usize, axis: usize, (lower, upper): (f64, f64)) -> bool {
        let tracks = self
            .steps
            .iter()
            .skip(from)
            .flat_map(Step::tracks)
            .filter(|(moving, _)| *moving == axis);
        tracks
            .filter_map(|(_, track)| track.movement.range())
            .all(|(least, most)| least >= lower && most <= upper)
    }

    /// The first segment that needs an axis homed which is not, with that axis; `homed` has a bit
    /// for each axis that is at the beginning. Searches for the stops, rests, and free movement
    /// without a force field need none.
    pub fn first_unhomed(&self, mut homed: u8) -> Option<(usize, usize)> {
        for (at, step) in self.steps.iter().enumerate() {
            let movement = &step.track.movement;
            if matches!(movement, Movement::Initialise(_)) {
                homed |= 1 << step.axis;
                continue;
            }
            let rests = matches!(movement, Movement::Rest(_) | Movement::WaitForScanner(_));
            let free = step.tracks().all(|(_, track)| {
                track.movement.field().is_some_and(|field| *field == Field::default())
            });
            if rests || free {
                continue;
            }
            let unhomed = (0..self.axes).find(|axis| homed & 1 << axis == 0);
            if let Some(axis) = unhomed {
                return Some((at, axis));
            }
        }
        None
    }

    /// The learning run of a segment; `None` if it is none.
    pub fn plan(&self, segment: usize) -> Option<&Arc<Plan>> {
        self.steps.get(segment)?.plan.as_ref()
    }
}
