//! Changes of the player's state.

use super::reports::Reason;

/// A change of state; at most one in a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// The protocol began, and with it segment 0.
    Started,
    /// A protocol that was interrupted began again, with this segment.
    Continued(u32),
    /// The next segment began.
    Segment(u32),
    /// The segment was started again, after a restart or a pause.
    Resumed(u32),
    /// The last segment ended.
    Done,
    /// Playing was stopped in this segment.
    Stopped(u32),
    /// The protocol was aborted in this segment.
    Aborted(u32, Reason),
}

impl Change {
    /// Whether the protocol ends with it.
    pub const fn ends(self) -> bool {
        matches!(self, Self::Done | Self::Stopped(_) | Self::Aborted(..))
    }
}

/// Why a protocol ends early.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum End {
    Stop,
    ClientGone,
    PermissionLost,
    Restarted,
}

impl End {
    pub(super) const fn change(self, segment: u32) -> Change {
        match self {
            Self::Stop => Change::Stopped(segment),
            Self::ClientGone => Change::Aborted(segment, Reason::ClientGone),
            Self::PermissionLost => Change::Aborted(segment, Reason::PermissionLost),
            Self::Restarted => Change::Aborted(segment, Reason::Restarted),
        }
    }
}
