//! Validates setpoints before control follows them. Pure: the time is an argument.
//!
//! A refused setpoint changes nothing: control continues with the previous one, and comes to rest
//! when its lease lapses. A refusal is reported at most once per second for each reason, with the
//! number of refusals so far.

use ipc_types::{AXES, Event, EventKind, Mode, Process, Setpoint, Severity};
use rig::RigFile;

/// Shortest interval between two reports of one reason (ns).
pub const REPORT_INTERVAL_NS: u64 = 1_000_000_000;
/// Rounding of a position or speed that lies just at its limit, as a share of the limit's
/// magnitude.
const ROUNDING: f64 = 1e-6;

/// Why a setpoint is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Of another session of the rig.
    Session,
    /// A mode or an owner that does not exist.
    Unknown,
    /// For another number of axes.
    Axes,
    /// A number that is needed is none.
    NotFinite,
    /// A position beyond the limits of the rig file.
    Position,
    /// A speed beyond the limit of the rig file.
    Speed,
    /// Its sequence does not follow the one before, or its sender was replaced.
    Sequence,
    /// It is meant for an earlier instant than the one before.
    Backwards,
    /// Another owner, while the lease of the first holds.
    Owner,
}

impl Refusal {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Session,
        Self::Unknown,
        Self::Axes,
        Self::NotFinite,
        Self::Position,
        Self::Speed,
        Self::Sequence,
        Self::Backwards,
        Self::Owner,
    ];

    /// In words: expected, found, what to do.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Session => "expected this session, found another; start the sender anew",
            Self::Unknown => "expected a known mode and owner; mend the sender",
            Self::Axes => "expected as many axes as the rig has; mend the sender",
            Self::NotFinite => "expected finite numbers; mend the sender",
            Self::Position => "position beyond the rig's limits; move less, or elsewhere",
            Self::Speed => "speed beyond the rig's limit; move slower",
            Self::Sequence => {
                "sequence went backwards, or its sender was replaced; end the old one"
            }
            Self::Backwards => "meant for an earlier instant than the last; mend the sender",
            Self::Owner => "another owner's lease holds; wait, or stop the other",
        }
    }
}

/// Limits of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisLimits {
    /// Lowest position (rad or m).
    pub position_min: f64,
    /// Highest position (rad or m).
    pub position_max: f64,
    /// Highest speed (rad/s or m/s).
    pub speed_max: f64,
}

/// What a refused setpoint is told as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Notice {
    /// Why.
    pub refusal: Refusal,
    /// The setpoint's sequence.
    pub sequence: u64,
    /// How many were refused for this reason since control started.
    pub count: u64,
}

impl Notice {
    /// As an event: `a` the sequence, `b` the count.
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

/// What is remembered of the setpoint that is followed.
#[derive(Clone, Copy, Debug)]
struct Followed {
    incarnation: u64,
    sequence: u64,
    at_ns: u64,
    lease_until_ns: u64,
    owner: u8,
    mode: u8,
}

/// Whether it is refused to an owner who asked for nothing: the experiment at rest says passive for
/// ever, whoever leads.
fn is_idle(refusal: Refusal, setpoint: &Setpoint) -> bool {
    refusal == Refusal::Owner && setpoint.mode == Mode::Passive.code()
}

/// Decides over setpoints one by one.
#[derive(Clone, Debug)]
pub struct SetpointValidation {
    session: u64,
    axes: usize,
    limits: [AxisLimits; AXES],
    followed: Option<Followed>,
    /// The sender that the present one took the place of, with the same owner.
    replaced: Option<u64>,
    refused: [u64; Refusal::ALL.len()],
    /// of these, those of another owner who asked for nothing
    idle: u64,
    told_ns: [Option<u64>; Refusal::ALL.len()],
}

impl SetpointValidation {
    /// For a session of a rig with these axes, at most [`AXES`].
    pub fn new(session: u64, axes: &[AxisLimits]) -> Self {
        let mut limits =
            [AxisLimits { position_min: 0.0, position_max: 0.0, speed_max: 0.0 }; AXES];
        for (limit, axis) in limits.iter_mut().zip(axes) {
            *limit = *axis;
        }
        Self {
            session,
            axes: axes.len().min(AXES),
            limits,
            followed: None,
            replaced: None,
            refused: [0; Refusal::ALL.len()],
            idle: 0,
            told_ns: [None; Refusal::ALL.len()],
        }
    }

    /// For a session of a rig, with the limits of its file.
    pub fn of_rig(session: u64, rig: &RigFile) -> Self {
        let limits = rig.axes.iter().map(|axis| AxisLimits {
            position_min: axis.limits.position_min,
            position_max: axis.limits.position_max,
            speed_max: axis.limits.speed_max,
        });
        Self::new(session, &limits.collect::<Vec<_>>())
    }

    /// Whether control is to follow a setpoint that has just come. One that is followed is the one
    /// that later ones are held against.
    ///
    /// # Errors
    /// Why not.
    pub fn validate(&mut self, now_ns: u64, setpoint: &Setpoint) -> Result<(), Refusal> {
        let verdict = self.look(now_ns, setpoint);
        match verdict {
            Ok(()) => {
                if let Some(before) = self.followed
                    && before.incarnation != setpoint.incarnation
                    && before.owner == setpoint.owner
                {
                    self.replaced = Some(before.incarnation);
                }
                self.followed = Some(Followed {
                    incarnation: setpoint.incarnation,
                    sequence: setpoint.sequence,
                    at_ns: setpoint.at_ns,
                    lease_until_ns: setpoint.lease_until_ns,
                    owner: setpoint.owner,
                    mode: setpoint.mode,
                });
            }
            Err(refusal) => {
                self.refused[refusal as usize] += 1;
                self.idle += u64::from(is_idle(refusal, setpoint));
            }
        }
        verdict
    }

    /// Returns the notice to publish for a refused setpoint. `None` if the same reason was reported
    /// within [`REPORT_INTERVAL_NS`], or if the setpoint of another owner is passive, as the idle
    /// experiment's always is.
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

    /// How many setpoints were refused, but for those of another owner who asked for nothing.
    pub fn refused_in_all(&self) -> u64 {
        self.refused.iter().sum::<u64>() - self.idle
    }

    /// How many setpoints were refused for a reason.
    pub fn refused(&self, refusal: Refusal) -> u64 {
        self.refused[refusal as usize]
    }

    fn look(&self, now_ns: u64, setpoint: &Setpoint) -> Result<(), Refusal> {
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
        self.order(now_ns, setpoint)?;
        (0..self.axes).try_for_each(|axis| self.range(axis, mode, setpoint))
    }

    /// Sequence, time and owner against the setpoint that is followed.
    fn order(&self, now_ns: u64, setpoint: &Setpoint) -> Result<(), Refusal> {
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
        // Who has let go of the motor keeps nobody waiting.
        let holds = now_ns <= before.lease_until_ns && before.mode != Mode::Passive.code();
        if before.owner != setpoint.owner && holds { Err(Refusal::Owner) } else { Ok(()) }
    }

    /// The numbers that the mode needs of one axis.
    fn range(&self, axis: usize, mode: Mode, setpoint: &Setpoint) -> Result<(), Refusal> {
        let limits = &self.limits[axis];
        let (position, velocity) = (setpoint.position[axis], setpoint.velocity[axis]);
        match mode {
            Mode::Passive => return Ok(()),
            // Where a field is centred is the field's affair; the law looks at the rest of its
            // numbers.
            _ if mode.yields() => {
                return if position.is_finite() { Ok(()) } else { Err(Refusal::NotFinite) };
            }
            // Without a position it holds where it is.
            Mode::Hold if position.is_nan() => return Ok(()),
            _ => {}
        }
        let moves = mode.moves();
        if !position.is_finite()
            || (moves && !(velocity.is_finite() && setpoint.acceleration[axis].is_finite()))
        {
            return Err(Refusal::NotFinite);
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
