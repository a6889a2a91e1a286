//! The profile that this host can keep: one that shares its processors may lose them for longer than
//! a realtime rig tolerates, and every rig of that profile then trips, rightly, whatever a test
//! does.

use std::sync::OnceLock;

use runtime::{HostStall, MEASURED_FOR};

/// The host's stalls, measured once for each test program.
pub fn stall() -> HostStall {
    static STALL: OnceLock<HostStall> = OnceLock::new();
    *STALL.get_or_init(|| HostStall::measure(MEASURED_FOR))
}
