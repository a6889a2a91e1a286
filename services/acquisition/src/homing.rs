//! The zeros of the encoders. Pure: scans and orders are arguments.
//!
//! ```text
//!             power-up of the card, a count that jumps, an absent encoder
//!            +--------------------------------------------------------------+
//!            v                                                              |
//!        unhomed ---- order of the experiment (both stops were found) ---> homed
//! ```
//!
//! While an axis is unhomed its positions count from where it was at power-up. Every change of a
//! zero raises the sequence that samples carry ([`ipc_types::Sample::homing_sequence`]): whoever
//! holds positions of an earlier sequence knows that they mean something else now.
//!
//! The state outlasts this process ([`HomingState`], which the process keeps in a file), but not a
//! power-up of the card: its counts then begin anew.

use ipc_types::{AXES, HomeOrder, Zeros};
use rig::{Axis, Homing as Declared, Limits, RigFile};
use runtime::daq::Scan;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// What is kept over a restart of acquisition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HomingState {
    /// Session of the rig.
    pub session: u64,
    /// The card's power-up that the zeros belong to.
    pub power_up: u64,
    /// The zeros.
    pub zeros: Zeros,
}

/// Why an axis lost its zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lost {
    /// The card was powered up anew.
    PowerUp,
    /// A count changed by more than the machine can move in the time.
    Jump,
    /// The encoder is absent.
    Absent,
}

impl Lost {
    /// What happened, and what to do.
    pub const fn text(self) -> &'static str {
        match self {
            Self::PowerUp => "the card was powered up: run `initialise`",
            Self::Jump => "its encoder's count jumped: check the encoder, then run `initialise`",
            Self::Absent => "its encoder is absent: connect it, then run `initialise`",
        }
    }
}

/// Why an order is not carried out. Carries no text of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum OrderRefusal {
    /// The rig has no such axis, or its encoders are absolute.
    #[error("no axis that is homed has this index")]
    Axis,
    /// It was computed from samples with other zeros: an earlier order was carried out already, or
    /// the axis lost its zero since.
    #[error("the zeros have changed since")]
    Sequence,
    /// No scan has come yet.
    #[error("the card has taken no scan yet")]
    NoScan,
}

/// What a scan or an order has changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// Axes that were homed.
    pub homed: u8,
    /// Axes that lost their zero, each with the reason.
    pub lost: [Option<Lost>; AXES],
    /// Whether anything that is kept over a restart has changed.
    pub kept: bool,
}

/// Rules of one axis.
#[derive(Clone, Copy, Debug, Default)]
struct Rules {
    /// Its encoders are incremental.
    incremental: bool,
    has_slave: bool,
    limits: Limits,
}

/// The counts of the scan before.
#[derive(Clone, Copy, Debug)]
struct Before {
    tick: u64,
    master: [i64; AXES],
    slave: [i64; AXES],
    /// Presence of the masters and of the slaves.
    present: (u8, u8),
}

/// Follows the zeros of a rig's encoders.
#[derive(Clone, Debug)]
pub struct Homing {
    session: u64,
    rules: [Rules; AXES],
    power_up: Option<u64>,
    before: Option<Before>,
    zeros: Zeros,
}

impl Homing {
    /// Every position is absolute: for records, and for cards without outputs.
    pub fn absolute(rig: &RigFile) -> Self {
        Self {
            session: 0,
            rules: [Rules::default(); AXES],
            power_up: None,
            before: None,
            zeros: Zeros { homed: rig.axis_bits(|_| true), ..Zeros::default() },
        }
    }

    /// The axes as the rig file declares them; those with incremental encoders are unhomed, unless
    /// the state `kept` by an earlier process belongs to this session and, as the first scan will
    /// show, to this power-up of the card.
    pub fn new(rig: &RigFile, session: u64, kept: Option<&HomingState>) -> Self {
        let mut rules = [Rules::default(); AXES];
        for (rules, axis) in rules.iter_mut().zip(&rig.axes) {
            *rules = Rules {
                incremental: is_incremental(axis),
                has_slave: axis.slave.is_some(),
                limits: axis.limits,
            };
        }
        let kept = kept.filter(|kept| kept.session == session);
        let homed = rig.axis_bits(|axis| !is_incremental(axis));
        Self {
            session,
            rules,
            power_up: kept.map(|kept| kept.power_up),
            before: None,
            zeros: kept.map_or(Zeros { homed, ..Zeros::default() }, |kept| kept.zeros),
        }
    }

    /// The present zeros.
    pub const fn zeros(&self) -> &Zeros {
        &self.zeros
    }

    /// What a successor needs; `None` before the first scan.
    pub fn state(&self) -> Option<HomingState> {
        let power_up = self.power_up?;
        Some(HomingState { session: self.session, power_up, zeros: self.zeros })
    }

    /// Follows a scan, before it is converted.
    pub fn observe(&mut self, scan: &Scan) -> Changes {
        let mut changes = Changes::default();
        let incremental = self.incremental();
        if incremental == 0 {
            return changes;
        }
        let before = self.before.replace(Before {
            tick: scan.tick,
            master: scan.master_counts,
            slave: scan.slave_counts,
            present: (scan.present.master, scan.present.slave),
        });
        if self.power_up != Some(scan.power_up) {
            self.power_up = Some(scan.power_up);
            for axis in (0..AXES).filter(|&axis| incremental & 1 << axis != 0) {
                // A first scan takes nothing away.
                changes.lost[axis] = self.zeros.is_homed(axis).then_some(Lost::PowerUp);
                self.unhome(axis, scan);
            }
            // Above every sequence of an earlier power-up.
            self.zeros.sequence = (self.zeros.sequence + 1).max(scan.time_ns);
            changes.kept = true;
            return changes;
        }
        let homed = self.zeros;
        for axis in (0..AXES).filter(|&axis| homed.is_homed(axis)) {
            if let Some(lost) = self.rules[axis].lost(axis, before.as_ref(), scan) {
                self.unhome(axis, scan);
                self.zeros.sequence += 1;
                changes.lost[axis] = Some(lost);
                changes.kept = true;
            }
        }
        changes
    }

    /// Carries out the order of a search that has found an axis's stops.
    ///
    /// # Errors
    /// [`OrderRefusal`]; nothing has changed then.
    pub fn order(&mut self, order: &HomeOrder) -> Result<Changes, OrderRefusal> {
        let axis = usize::from(order.axis);
        if !self.rules.get(axis).is_some_and(|rules| rules.incremental) {
            return Err(OrderRefusal::Axis);
        }
        if self.before.is_none() {
            return Err(OrderRefusal::NoScan);
        }
        if order.homing_sequence != self.zeros.sequence {
            return Err(OrderRefusal::Sequence);
        }
        self.zeros.master[axis] = order.master_zero;
        if self.rules[axis].has_slave {
            self.zeros.slave[axis] = order.slave_zero;
        }
        self.zeros.homed |= 1 << axis;
        self.zeros.sequence += 1;
        Ok(Changes { homed: 1 << axis, kept: true, ..Changes::default() })
    }

    /// From this scan on the positions of an axis count from where it is.
    fn unhome(&mut self, axis: usize, scan: &Scan) {
        self.zeros.homed &= !(1 << axis);
        self.zeros.master[axis] = scan.master_counts[axis];
        self.zeros.slave[axis] = scan.slave_counts[axis];
    }

    fn incremental(&self) -> u8 {
        (0..AXES).fold(0, |bits, axis| bits | u8::from(self.rules[axis].incremental) << axis)
    }
}

impl Rules {
    /// Whether a homed axis has lost its zero between two scans.
    fn lost(&self, axis: usize, before: Option<&Before>, scan: &Scan) -> Option<Lost> {
        let bit = 1 << axis;
        if !self.incremental {
            return None;
        }
        if scan.present.master & bit == 0 || (self.has_slave && scan.present.slave & bit == 0) {
            return Some(Lost::Absent);
        }
        let before = before?;
        let ticks = scan.tick.saturating_sub(before.tick).max(1);
        let jumped = |before: i64, now: i64, present: u8| {
            present & bit != 0 && self.limits.is_jump(before, now, ticks)
        };
        let jump = jumped(before.master[axis], scan.master_counts[axis], before.present.0)
            || (self.has_slave
                && jumped(before.slave[axis], scan.slave_counts[axis], before.present.1));
        jump.then_some(Lost::Jump)
    }
}

/// Whether an axis must be homed; one whose file does not say never is.
fn is_incremental(axis: &Axis) -> bool {
    !matches!(axis.homing, Some(Declared::Absolute))
}
