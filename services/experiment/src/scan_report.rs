//! What the tracker of the scan makes known.

use ipc_types::Volume;

/// What is to be published.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ScanReport {
    /// A volume began.
    Volume(Volume),
    /// The pulse that a wait was for came, this long after the wait began (s).
    Started {
        /// Time since the wait began (s).
        after_s: f64,
    },
    /// Volumes had no pulse.
    Missed {
        /// Number of the first of them.
        first: u64,
        /// How many.
        count: u64,
    },
    /// A pulse belongs to no volume.
    Spurious {
        /// Number of the last volume.
        after: u64,
    },
    /// The scanner was started anew.
    Restarted {
        /// Number of the first volume since.
        first: u64,
    },
}

/// What a wait has come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitState {
    /// The pulse, or the end of the start-up time, has not come.
    Waiting,
    /// The start-up time was over at that time (ns).
    Over(u64),
    /// No pulse came in time.
    TimedOut,
}
