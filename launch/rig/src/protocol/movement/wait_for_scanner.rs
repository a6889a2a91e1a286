//! `wait_for_scanner`: no output until the scanner's pulse, and for the start-up time after it.

use ipc_types::Mode;

use crate::checked_toml::{Keys, Section, bounds};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::trajectory::Point;
use crate::protocol::unit_keys::UnitKeys;

/// Waits for a pulse of the scanner, and then for the start-up time, which counts from the pulse.
///
/// The next segment begins at the end of the start-up time, not at the control cycle that follows
/// the pulse. The motor gets 0 V; the handle stays or is moved by hand. A wait without a pulse ends
/// the protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaitForScanner {
    /// The protocol ends if that pulse has not come by then (s).
    pub timeout_s: f64,
    /// Number of the pulse that is waited for, from 1: those before are of dummy volumes.
    pub pulse: u64,
    /// Time from that pulse to the next segment (s).
    pub start_up_s: f64,
}

pub(super) const KEYS: Keys = &[
    ("timeout_s", "The protocol ends if the pulse has not come by then."),
    ("pulse", "Number of the pulse that is waited for; those before are of dummy volumes."),
    ("start_up_s", "Time from that pulse to the next segment."),
];

pub(super) fn read(section: &Section<'_>, _keys: &mut UnitKeys<'_, '_>) -> WaitForScanner {
    let timeout = bounds(1.0, 3600.0, "in s; long enough for the operator to start the scanner");
    let start_up = bounds(0.0, 600.0, "in s; the appendix asks for 10 s at least");
    WaitForScanner {
        timeout_s: section.number("timeout_s", timeout),
        pulse: section.whole_or("pulse", 1, 1, 1000, "1 is the first that comes"),
        start_up_s: section.number_or("start_up_s", 0.0, start_up),
    }
}

impl SegmentKind for WaitForScanner {
    /// The longest that it can be: it ends when the start-up time has passed.
    fn duration_s(&self) -> f64 {
        self.timeout_s + self.start_up_s
    }

    fn end_is_unknown(&self) -> bool {
        true
    }

    fn mode(&self, _time_s: f64) -> Mode {
        Mode::Passive
    }

    fn at(&self, start: f64, _time_s: f64, _peak_speed: f64) -> Point {
        Point::at_rest(start)
    }
}
