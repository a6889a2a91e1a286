//! Where the player is in its protocol.

use super::{Phase, Player};

impl Player {
    /// Plays a segment from `begun_ns` on. The search of an earlier one says nothing of it.
    pub(super) const fn play(&mut self, segment: usize, begun_ns: u64) {
        self.phase = Phase::Playing { segment, begun_ns };
        self.finder = None;
    }

    /// The segment that is played, and when it began (ns, CLOCK_MONOTONIC); `None` between
    /// protocols, and once a protocol ends.
    pub const fn playing(&self) -> Option<(usize, u64)> {
        match self.phase {
            Phase::Playing { segment, begun_ns } => Some((segment, begun_ns)),
            _ => None,
        }
    }

    /// When the last segment ended that ran to its end (ns, CLOCK_MONOTONIC); 0 before the first.
    pub const fn last_edge_ns(&self) -> u64 {
        self.last_edge_ns
    }

    /// Since when the player supervises the run of its protocol (ns, CLOCK_MONOTONIC); 0 before it
    /// does.
    pub fn supervised_since_ns(&self) -> u64 {
        self.supervision.since_ns()
    }
}
