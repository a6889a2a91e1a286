//! Validates setpoints before control follows them. Pure: the time is an argument.
//!
//! A refused setpoint changes nothing: control follows the previous one until its lease expires,
//! then brings the axes to rest. Each reason is reported at most once per second, with the number
//! of refusals so far.

use ipc_types::{AXES, Event, EventKind, Mode, Process, Sample, Setpoint, Severity};
use rig::{Limits, RigFile};

/// Shortest interval between two reports of one reason (ns).
pub const REPORT_INTERVAL_NS: u64 = 1_000_000_000;
/// Tolerance for rounding errors at a limit, as a share of the limit's magnitude.
const ROUNDING: f64 = 1e-6;

/// Why a setpoint is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// It belongs to another session of the rig.
    Session,
    /// Its mode or its owner does not exist.
    Unknown,
    /// Its number of axes is not the rig's.
    Axes,
    /// A number that its mode requires is not finite.
    NotFinite,
    /// A position is beyond the limits of the rig file.
    Position,
    /// A speed is beyond the limit of the rig file.
    Speed,
    /// Its sequence number does not increase, or another sender has replaced its own.
    Sequence,
    /// Its time is before that of the previous setpoint.
    Backwards,
    /// The lease of another owner is still valid.
    Owner,
    /// Its positions count from a zero that has changed since.
    Zero,
    /// It moves an axis that is unhomed.
    Unhomed,
}

impl Refusal {
    /// All reasons.
    pub const ALL: [Self; 11] = [
        Self::Session,
        Self::Unknown,
        Self::Axes,
        Self::NotFinite,
        Self::Position,
        Self::Speed,
        Self::Sequence,
        Self::Backwards,
        Self::Owner,
        Self::Zero,
        Self::Unhomed,
    ];

    /// Expected and found, and what to do.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Session => "expected this session, found another; restart the sender",
            Self::Unknown => "unknown mode or owner; correct the sender",
            Self::Axes => "expected as many axes as the rig has; correct the sender",
            Self::NotFinite => "expected finite numbers; correct the sender",
            Self::Position => "position beyond the rig's limits; reduce the movement or shift it",
            Self::Speed => "speed beyond the rig's limit; slow the movement down",
            Self::Sequence => {
                "sequence did not increase, or the sender was replaced; end the old one"
            }
            Self::Backwards => "time is before the previous setpoint's; correct the sender",
            Self::Owner => "another owner's lease is valid; wait, or stop the other owner",
            Self::Zero => "positions of an earlier zero; send the newest sample's homing_sequence",
            Self::Unhomed => "an axis is not homed; run `initialise` first",
        }
    }
}

/// The report of a refused setpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Notice {
    /// The reason.
    pub refusal: Refusal,
    /// The setpoint's sequence.
    pub sequence: u64,
    /// Number of refusals for this reason since control started.
    pub count: u64,
}

impl Notice {
    /// The report as an event: `a` is the sequence, `b` the count.
    pub fn event(&self) -> Event {
        let event = Event::new(
            Process::Control,
            EventKind::SetpointRefused,
            Severity::Warning,
            self.refusal.text(),
        );
        Event { a: self.sequence as f64, b: self.count as f64, ..event }
    }
}

/// Whether a refusal needs no report: the idle experiment keeps sending passive setpoints while
/// another owner has control.
fn is_idle(refusal: Refusal, setpoint: &Setpoint) -> bool {
    refusal == Refusal::Owner && setpoint.mode == Mode::Passive.code()
}

/// Whether a force field leaves an axis alone.
fn is_field_free(setpoint: &Setpoint, axis: usize) -> bool {
    let row = axis * AXES..(axis + 1) * AXES;
    let matrices = [&setpoint.stiffness, &setpoint.damping, &setpoint.inertia];
    matrices.iter().all(|matrix| matrix[row.clone()].iter().all(|&value| value == 0.0))
        && setpoint.wall_stiffness[axis] == 0.0
        && setpoint.table_position_max[axis] <= setpoint.table_position_min[axis]
        && setpoint.table_speed[axis] <= 0.0
}

/// Accepts or refuses setpoints one by one.
#[derive(Clone, Debug)]
pub struct SetpointValidation {
    session: u64,
    axes: usize,
    limits: [Limits; AXES],
    /// The newest sample's zeros, and its homed axes.
    homing_sequence: u64,
    homed: u8,
    /// The setpoint that control follows.
    followed: Option<Setpoint>,
    /// The sender that the current one, of the same owner, has replaced.
    replaced: Option<u64>,
    refused: [u64; Refusal::ALL.len()],
    /// of these, passive setpoints of another owner ([`is_idle`])
    idle: u64,
    told_ns: [Option<u64>; Refusal::ALL.len()],
}

impl SetpointValidation {
    /// Validation for a session of a rig with these limits, of at most [`AXES`] axes.
    pub fn new(session: u64, axes: impl ExactSizeIterator<Item = Limits>) -> Self {
        let count = axes.len().min(AXES);
        let mut limits = [Limits::default(); AXES];
        for (limit, axis) in limits.iter_mut().zip(axes) {
            *limit = axis;
        }
        Self {
            session,
            axes: count,
            limits,
            homing_sequence: 0,
            homed: u8::MAX,
            followed: None,
            replaced: None,
            refused: [0; Refusal::ALL.len()],
            idle: 0,
            told_ns: [None; Refusal::ALL.len()],
        }
    }

    /// Validation for a session of a rig, with the limits of its file.
    pub fn of_rig(session: u64, rig: &RigFile) -> Self {
        Self::new(session, rig.axes.iter().map(|axis| axis.limits))
    }

    /// Takes the newest sample: which axes are homed, and from which zeros positions count.
    pub const fn see(&mut self, sample: &Sample) {
        (self.homed, self.homing_sequence) = (sample.homed, sample.homing_sequence);
    }

    /// Accepts or refuses a setpoint that has just arrived. Later setpoints are compared with the
    /// last one accepted.
    ///
    /// # Errors
    /// The reason for a refusal.
    pub fn validate(&mut self, now_ns: u64, setpoint: &Setpoint) -> Result<(), Refusal> {
        let verdict = self.check(now_ns, setpoint);
        match verdict {
            Ok(()) => {
                if let Some(before) = self.followed
                    && before.incarnation != setpoint.incarnation
                    && before.owner == setpoint.owner
                {
                    self.replaced = Some(before.incarnation);
                }
                self.followed = Some(*setpoint);
            }
            Err(refusal) => {
                self.refused[refusal as usize] += 1;
                self.idle += u64::from(is_idle(refusal, setpoint));
            }
        }
        verdict
    }

    /// Returns the report to publish for a refused setpoint. `None` if the same reason was reported
    /// within [`REPORT_INTERVAL_NS`], or if the setpoint is passive and of another owner.
    pub fn notice(&mut self, now_ns: u64, refusal: Refusal, setpoint: &Setpoint) -> Option<Notice> {
        if is_idle(refusal, setpoint) {
            return None;
        }
        let told = &mut self.told_ns[refusal as usize];
        if told.is_some_and(|told| now_ns.saturating_sub(told) < REPORT_INTERVAL_NS) {
            return None;
        }
        *told = Some(now_ns);
        Some(Notice { refusal, sequence: setpoint.sequence, count: self.refused[refusal as usize] })
    }

    /// Number of refused setpoints, without passive ones of another owner.
    pub fn refused_in_all(&self) -> u64 {
        self.refused.iter().sum::<u64>() - self.idle
    }

    /// Number of setpoints refused for a reason.
    pub fn refused(&self, refusal: Refusal) -> u64 {
        self.refused[refusal as usize]
    }

    fn check(&self, now_ns: u64, setpoint: &Setpoint) -> Result<(), Refusal> {
        if setpoint.session != self.session {
            return Err(Refusal::Session);
        }
        let mode = Mode::from_code(setpoint.mode).ok_or(Refusal::Unknown)?;
        if ![Process::Experiment.code(), Process::Operator.code()].contains(&setpoint.owner) {
            return Err(Refusal::Unknown);
        }
        if usize::from(setpoint.axes) != self.axes {
            return Err(Refusal::Axes);
        }
        self.check_order(now_ns, setpoint)?;
        self.check_homing(mode, setpoint)?;
        (0..self.axes).try_for_each(|axis| self.check_range(axis, mode, setpoint))
    }

    /// Compares sequence, time and owner with those of the setpoint that control follows.
    fn check_order(&self, now_ns: u64, setpoint: &Setpoint) -> Result<(), Refusal> {
        if self.replaced == Some(setpoint.incarnation) {
            return Err(Refusal::Sequence);
        }
        let Some(before) = &self.followed else { return Ok(()) };
        if before.incarnation == setpoint.incarnation {
            if setpoint.sequence <= before.sequence {
                return Err(Refusal::Sequence);
            }
            if setpoint.at_ns < before.at_ns {
                return Err(Refusal::Backwards);
            }
        }
        // An owner that has gone passive blocks nobody.
        let holds = now_ns <= before.lease_until_ns && before.mode != Mode::Passive.code();
        if before.owner != setpoint.owner && holds { Err(Refusal::Owner) } else { Ok(()) }
    }

    /// Compares the zeros with those of the newest sample; on an unhomed axis nothing moves but the
    /// search for its stops, and the hand without a force field. A setpoint of newer zeros than our
    /// sample's passes: the law follows it once a sample has them.
    fn check_homing(&self, mode: Mode, setpoint: &Setpoint) -> Result<(), Refusal> {
        if mode == Mode::Passive {
            return Ok(());
        }
        if setpoint.homing_sequence < self.homing_sequence {
            return Err(Refusal::Zero);
        }
        let mut unhomed = (0..self.axes).filter(|&axis| self.homed & 1 << axis == 0);
        let allowed = |axis: usize| match mode {
            Mode::Initialise => true,
            Mode::Hold => setpoint.position[axis].is_nan(),
            _ => mode.is_force_controlled() && is_field_free(setpoint, axis),
        };
        if unhomed.all(allowed) { Ok(()) } else { Err(Refusal::Unhomed) }
    }

    /// Checks the numbers that the mode requires of one axis.
    fn check_range(&self, axis: usize, mode: Mode, setpoint: &Setpoint) -> Result<(), Refusal> {
        let limits = &self.limits[axis];
        let (position, velocity) = (setpoint.position[axis], setpoint.velocity[axis]);
        match mode {
            Mode::Passive => return Ok(()),
            // A field's centre may lie anywhere; the law checks the other numbers of the field.
            _ if mode.is_force_controlled() => {
                return if position.is_finite() { Ok(()) } else { Err(Refusal::NotFinite) };
            }
            // A hold without a position holds the present one.
            Mode::Hold if position.is_nan() => return Ok(()),
            _ => {}
        }
        let moves = mode.moves();
        if !position.is_finite()
            || (moves && !(velocity.is_finite() && setpoint.acceleration[axis].is_finite()))
        {
            return Err(Refusal::NotFinite);
        }
        if self.homed & 1 << axis == 0 {
            // Positions count from power-up: law and watchdog have the limits of the search.
            return Ok(());
        }
        let slack = ROUNDING * limits.position_min.abs().max(limits.position_max.abs());
        if position < limits.position_min - slack || position > limits.position_max + slack {
            return Err(Refusal::Position);
        }
        if moves && velocity.abs() > limits.speed_max * (1.0 + ROUNDING) {
            return Err(Refusal::Speed);
        }
        Ok(())
    }
}
