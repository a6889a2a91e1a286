//! A protocol made ready for one machine.

use std::path::Path;
use std::sync::Arc;

use emg::Group;
use ipc_types::{AXES, PulseSource, Sound};
use rig::protocol::{Field, Movement, MuscleMaxima, Protocol, Segment};
use rig::{ProtocolError, RigFile};
use scanner::LineKind;

use crate::contraction::{self, Maxima};
use crate::ilc_update::Plan;
use crate::interrupted::Continuation;
use crate::matching_bar::Matched;
use crate::prepared_movement::PreparedMovement;
use crate::scan_plan::{Pulses, ScanPlan};
use crate::scan_tracker::ScanState;
use crate::session_state::SessionState;
use crate::session_tracker::{PlayedSegment, SessionPlan};
use crate::state::PlayerState;

use super::axis_homing::AxisHoming;

/// A protocol made ready for one machine.
#[derive(Debug)]
pub struct Program {
    pub(super) name: String,
    /// The name under which it was asked for.
    asked: String,
    pub(super) text: String,
    pub(super) identity: u64,
    pub(super) axes: usize,
    /// Position limits of each axis (rad or m).
    pub(super) limits: [(f64, f64); AXES],
    /// Axes that have a range of motion, one bit each.
    with_range: u8,
    /// How each axis with incremental encoders is homed.
    pub(super) homing: [Option<AxisHoming>; AXES],
    pub(super) steps: Vec<Step>,
    /// What it says of the scanner.
    pub(super) scan: ScanPlan,
    /// Where the scanner's pulses come from, as it was asked for.
    source: PulseSource,
    /// Its sessions.
    sessions: SessionPlan,
    /// Names under which maxima of the muscles' activity are saved and loaded.
    names: MuscleMaxima,
    /// The maxima of which the activity of muscles is a share.
    maxima: Option<Maxima>,
    /// Where it begins, if not at its beginning.
    continues: Option<Continuation>,
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
    /// What the subject is told at its beginning.
    instruction: Option<String>,
    sound: Option<Sound>,
    /// Inputs of the card whose maximum it measures, one bit each.
    contraction: u16,
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
                instruction: segment.instruction.clone(),
                sound: segment.sound,
                contraction: segment.contraction.map_or(0, |group| inputs_of(rig, group)),
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
            asked: protocol.file_name().to_owned(),
            text: protocol.text().to_owned(),
            identity: protocol.identity(),
            axes: rig.axes.len(),
            limits,
            with_range: rig.axis_bits(|axis| axis.range_of_motion.is_some()),
            homing,
            steps,
            scan: ScanPlan {
                scan: protocol.scan,
                waits: segments.iter().any(Segment::waits_for_scanner),
                gate_width_s: rig
                    .scanner
                    .filter(|line| line.line.kind == LineKind::Gate)
                    .map(|line| line.line.minimum_width_s),
                pulses: Pulses::default(),
            },
            source: PulseSource::default(),
            sessions: SessionPlan {
                sessions,
                matched: protocol
                    .matching
                    .map(|matching| Matched { signal: matching.signal, axis: matching.axis }),
            },
            names: protocol.maxima.clone(),
            maxima: None,
            continues: None,
            resumes: protocol.resumes,
            duration_s: begins_s,
        })
    }

    /// The same, with the scanner's pulses from another source than the trigger line.
    ///
    /// # Errors
    /// As [`Pulses::of`].
    pub fn with_pulses(mut self, source: &PulseSource) -> Result<Self, String> {
        self.scan.pulses = Pulses::of(source)?;
        self.source = source.clone();
        Ok(self)
    }

    /// The same, with the maxima that it uses from this folder.
    ///
    /// # Errors
    /// Those of [`contraction::load`].
    pub fn with_maxima(mut self, folder: &Path, rig: &RigFile) -> Result<Self, String> {
        let load = |name: &String| contraction::load(folder, name, rig);
        self.maxima = self.names.load.as_ref().map(load).transpose()?;
        Ok(self)
    }

    /// The maxima of which the activity of muscles is a share; `None` where it is in the units of
    /// the channels.
    pub const fn maxima(&self) -> Option<&Maxima> {
        self.maxima.as_ref()
    }

    /// Name under which the maxima that it measures are saved.
    pub fn saves_maxima(&self) -> Option<&str> {
        self.names.save.as_deref()
    }

    /// The same, to begin where it was interrupted.
    ///
    /// # Errors
    /// In words, where it has no such segment.
    pub fn continuing(mut self, from: Continuation) -> Result<Self, String> {
        let (found, segments) = (from.segment, self.steps.len());
        if found as usize >= segments {
            return Err(format!(
                "it was interrupted in segment {found}, and the protocol has {segments}"
            ));
        }
        self.continues = Some(from);
        Ok(self)
    }

    /// Where it begins, if not at its beginning.
    pub const fn continues(&self) -> Option<&Continuation> {
        self.continues.as_ref()
    }

    /// Index of the segment that it begins with.
    pub fn first_segment(&self) -> u32 {
        self.continues.as_ref().map_or(0, |from| from.segment)
    }

    /// Whether the process that plays it keeps it for `farreach run --continue`.
    pub const fn can_be_continued(&self) -> bool {
        self.resumes && self.sessions.sessions > 0
    }

    /// Whether it needs the scanner's trigger line.
    pub fn needs_trigger(&self) -> bool {
        (self.scan.waits || self.scan.scan.is_some()) && self.source == PulseSource::Line
    }

    /// Whether its setpoints depend on the scanner: it waits for a pulse, or its segments keep in
    /// step with the volumes.
    pub fn keeps_to_scanner(&self) -> bool {
        self.scan.waits || self.scan.scan.is_some_and(|scan| scan.in_step)
    }

    /// Whether it takes its pulses from the key 5.
    pub fn takes_keys(&self) -> bool {
        self.source == PulseSource::Key
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
            name: self.asked.clone(),
            text: self.text.clone(),
            protocol: self.identity,
            segment: 0,
            running: false,
            epoch,
            client,
            pulses: self.source.clone(),
            keys: Vec::new(),
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
            contraction: step.contraction,
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

    /// What the subject is told at the beginning of a segment.
    pub fn instruction(&self, segment: usize) -> Option<&str> {
        self.steps.get(segment)?.instruction.as_deref()
    }

    /// The sound for the subject at the beginning of a segment.
    pub fn sound(&self, segment: usize) -> Option<Sound> {
        self.steps.get(segment)?.sound
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

    /// Whether it searches for the stops of an axis.
    pub fn searches(&self) -> bool {
        self.steps.iter().any(|step| matches!(step.track.movement, Movement::Initialise(_)))
    }

    /// The first segment that needs an axis homed which is not, with that axis; `homed` has a bit
    /// for each axis that is at the beginning. Searches for the stops, rests, and free movement
    /// without a force field need none; the last does where the rig file gives the axis a range of
    /// motion, which nothing supervises without a zero.
    pub fn first_unhomed(&self, mut homed: u8) -> Option<(usize, usize)> {
        let first = self.first_segment() as usize;
        for (at, step) in self.steps.iter().enumerate().skip(first) {
            let movement = &step.track.movement;
            if matches!(movement, Movement::Initialise(_)) {
                homed |= 1 << step.axis;
                continue;
            }
            let rests = matches!(movement, Movement::Rest(_) | Movement::WaitForScanner(_));
            let supervised = self.with_range & !homed == 0;
            let free = step.tracks().all(|(_, track)| {
                track.movement.field().is_some_and(|field| *field == Field::default())
            });
            if rests || free && supervised {
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

/// Inputs of the electrodes over a group of muscles, one bit each.
fn inputs_of(rig: &RigFile, group: Group) -> u16 {
    let electrodes = rig.electrodes();
    let of_group = electrodes.iter().filter(|electrode| electrode.group == group);
    of_group.fold(0, |inputs, electrode| inputs | 1 << electrode.input)
}
