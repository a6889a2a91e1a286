//! The timing profile that this host can keep. A host that shares its processors may stall for
//! longer than a realtime rig tolerates; such a rig then trips, rightly, in any test.

use std::sync::OnceLock;

use runtime::{HostStall, MEASURED_FOR};

/// The host's stalls, measured once for each test program.
pub fn stall() -> HostStall {
    static STALL: OnceLock<HostStall> = OnceLock::new();
    *STALL.get_or_init(|| HostStall::measure(MEASURED_FOR))
}
