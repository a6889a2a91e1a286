//! The timeouts of a rig, which gate, watchdog and card agree on, and all that follows from them.

use crate::Profile;

const MILLISECOND_NS: u64 = 1_000_000;

/// The timeouts of a timing profile: what the gate, the watchdog and the card agree on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeouts {
    /// Lifetime of a token, and of a command; also the longest time between two cycles of the gate,
    /// and of the watchdog (ns).
    pub token_ns: u64,
    /// A peer that was silent for this long is lost (ns).
    pub peer_lost_ns: u64,
    /// The card drops the motor this long after the enable line's last toggle (ns).
    pub enable_line_ns: u64,
    /// The watchdog stops toggling the enable line when the newest sample is older than this (ns).
    pub enable_line_pause_ns: u64,
}

impl Timeouts {
    /// The timeouts of a profile. A real card arms in the realtime profile only: the longer ones
    /// never apply to it.
    pub const fn of(profile: Profile) -> Self {
        match profile {
            Profile::Realtime => Self {
                token_ns: 5 * MILLISECOND_NS,
                peer_lost_ns: 8 * MILLISECOND_NS,
                enable_line_ns: 5 * MILLISECOND_NS,
                enable_line_pause_ns: 3 * MILLISECOND_NS,
            },
            Profile::BestEffort => Self {
                token_ns: 40 * MILLISECOND_NS,
                peer_lost_ns: 60 * MILLISECOND_NS,
                enable_line_ns: 40 * MILLISECOND_NS,
                enable_line_pause_ns: 15 * MILLISECOND_NS,
            },
        }
    }

    /// Oldest sample that a command may answer when the gate passes it, counted from its scan (ns).
    pub const fn answered_sample_ns(&self) -> u64 {
        2 * self.token_ns
    }

    /// Oldest token that a sample or a command may echo, and oldest sample that a command may
    /// answer, when the watchdog looks (ns).
    pub const fn echo_lost_ns(&self) -> u64 {
        self.token_ns + self.peer_lost_ns
    }

    /// Time that the gate has to open after `enable` (ns).
    pub const fn gate_open_ns(&self) -> u64 {
        self.peer_lost_ns * 5 / 2
    }

    /// A pause of the enable line that lasts this long is a trip (ns): less than the card's
    /// timeout, so that the motor never loses power without a trip and gets it back by itself.
    pub const fn enable_line_gap_ns(&self) -> u64 {
        self.enable_line_ns - 1_500_000
    }

    /// Longest stall of one processor that a rig tolerates (ns). The watchdog's own stall must stay
    /// below [`Self::enable_line_gap_ns`]; 1 ms of it goes to the period of its loop.
    pub const fn stall_ns(&self) -> u64 {
        self.enable_line_gap_ns() - MILLISECOND_NS
    }
}
