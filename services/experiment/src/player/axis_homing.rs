//! How an axis is homed: from the ends of its travel to the counts at position 0.

use ipc_types::{HomeOrder, Zeros};
use rig::{Axis, Encoder, StopSearch};

use super::reports::Reason;
use crate::range_finder::{Measured, Range, Stops};

/// How an axis with incremental encoders is homed.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxisHoming {
    pub(super) search: StopSearch,
    master: Encoder,
    slave: Option<Encoder>,
    /// Gain of position control (V/rad or V/m).
    position_gain: f64,
}

impl AxisHoming {
    /// `None` for an axis with absolute encoders.
    pub(super) fn of(axis: &Axis) -> Option<Self> {
        let search = *axis.stop_search()?;
        let position_gain = axis.control.position_gain;
        Some(Self { search, master: axis.master, slave: axis.slave, position_gain })
    }

    /// What the search knows of the stops, with an output of at most `volts`.
    pub(super) fn stops(&self, volts: f64) -> Stops {
        let lead = volts / self.position_gain;
        Stops { travel: self.search.travel(), lead: if lead.is_finite() { lead } else { 0.0 } }
    }

    /// Position 0, in the positions of the search, by both encoders.
    ///
    /// # Errors
    /// A stop was not met, or the travel is not that of the rig file.
    pub(super) fn zero(&self, range: &Range) -> Result<Measured, Reason> {
        if range.met != (true, true) {
            return Err(Reason::StopNotMet);
        }
        let found = range.upper.handle - range.lower.handle;
        if (found - self.search.travel()).abs() > self.search.tolerance {
            return Err(Reason::OtherTravel);
        }
        let middle = |of: fn(&Measured) -> f64| 0.5 * (of(&range.lower) + of(&range.upper));
        let centre = 0.5 * (self.search.lower + self.search.upper);
        // Without a slave encoder the handle's positions are the motor's, and the ratio is 1.
        let ratio = range.ratio.unwrap_or(1.0);
        Ok(Measured {
            motor: middle(|end| end.motor) - ratio * centre,
            handle: middle(|end| end.handle) - centre,
        })
    }

    /// The order that makes `zero` position 0 of the axis.
    pub(super) fn order(&self, axis: usize, zero: Measured, old: &Zeros) -> HomeOrder {
        let counts = |encoder: &Encoder, position| encoder.counts(position).round() as i64;
        let slave = self.slave.map_or(0, |slave| counts(&slave, zero.handle));
        HomeOrder {
            homing_sequence: old.sequence,
            master_zero: old.master[axis].wrapping_add(counts(&self.master, zero.motor)),
            slave_zero: old.slave[axis].wrapping_add(slave),
            axis: axis as u8,
            ..HomeOrder::default()
        }
    }
}

/// An order on its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct PendingOrder {
    pub(super) order: HomeOrder,
    /// When the motor began to go back (ns).
    pub(super) since_ns: u64,
    /// From where, and where the line is slack (rad or m).
    pub(super) unwinds: (f64, f64),
    /// The ends that were met, in the new positions.
    pub(super) range: Range,
}
