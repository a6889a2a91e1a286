//! Measures for how long this host takes its processors away ("stalls"), and chooses the timing
//! profile by it: permission to use `SCHED_FIFO` says nothing about a host that is itself a guest.

use std::time::Duration;

use ipc_types::{Profile, Timeouts};
use serde::{Deserialize, Serialize};

use crate::bare_loop::on_every_processor;
use crate::grid::Wake;

/// How long the keeper measures at the start of a session.
pub const MEASURED_FOR: Duration = Duration::from_secs(2);
/// Above every loop of a rig.
const PRIORITY: i32 = 90;
/// A short measurement misses the longest stalls, so that half of what a profile tolerates counts
/// as too much.
const MARGIN: u64 = 2;
/// A hypervisor that has given more than this share of the processors to other guests since boot
/// (parts per million) stalls this one for 6 ms a minute.
pub const STOLEN_PPM: u64 = 100;

/// What was measured: the wake lateness of bare 1 kHz loops, one on each processor at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostStall {
    /// Latest wake (ns).
    pub longest_ns: u64,
    /// Wakes later than the realtime profile tolerates ([`Timeouts::stall_ns`]).
    pub stalls: u64,
    /// Wakes measured, periods that were skipped for lateness included.
    pub wakes: u64,
    /// Processors measured.
    pub processors: u32,
    /// Share of the processors' time that the hypervisor has given to other guests since boot
    /// (`steal` of `/proc/stat`, parts per million).
    pub stolen_ppm: u64,
    /// Whether the loops ran in `SCHED_FIFO`; without it ordinary load counts as well.
    pub fifo: bool,
}

impl HostStall {
    /// Measures for `duration` on every processor that this process may run on.
    pub fn measure(duration: Duration) -> Self {
        let bare = || Self { processors: 1, ..Self::default() };
        let record = |found: &mut Self, wake: &Wake| found.record(wake.late_ns(), wake.skipped);
        let loops = on_every_processor(duration, PRIORITY, bare, record);
        let mut all = loops
            .into_iter()
            .map(|(found, fifo)| Self { fifo, ..found })
            .reduce(Self::merged)
            .unwrap_or_default();
        let stat = std::fs::read_to_string("/proc/stat").unwrap_or_default();
        all.stolen_ppm = stolen_ppm(&stat).unwrap_or(0);
        all
    }

    /// The measurement of two sets of processors.
    fn merged(self, other: Self) -> Self {
        Self {
            longest_ns: self.longest_ns.max(other.longest_ns),
            stalls: self.stalls + other.stalls,
            wakes: self.wakes + other.wakes,
            processors: self.processors + other.processors,
            stolen_ppm: self.stolen_ppm.max(other.stolen_ppm),
            fifo: self.fifo && other.fifo,
        }
    }

    /// Adds one wake that was late by `late_ns` and skipped so many periods.
    fn record(&mut self, late_ns: u64, skipped: u64) {
        self.longest_ns = self.longest_ns.max(late_ns);
        self.stalls += u64::from(late_ns > Timeouts::of(Profile::Realtime).stall_ns());
        self.wakes += 1 + skipped;
    }

    /// Whether a rig of this profile is likely to trip on this host for want of processor time.
    pub fn exceeds(&self, profile: Profile) -> bool {
        let tolerated_ns = Timeouts::of(profile).stall_ns();
        let stolen = profile == Profile::Realtime && self.stolen_ppm > STOLEN_PPM;
        stolen || self.longest_ns > tolerated_ns / MARGIN
    }

    /// The profile that this host can keep.
    pub fn profile(&self) -> Profile {
        if self.fifo && !self.exceeds(Profile::Realtime) {
            Profile::Realtime
        } else {
            Profile::BestEffort
        }
    }
}

impl std::fmt::Display for HostStall {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let milliseconds = self.longest_ns as f64 * 1e-6;
        write!(f, "{milliseconds:.2} ms at most on {} processors", self.processors)?;
        if self.stolen_ppm > 0 {
            write!(f, ", {} ppm of their time stolen since boot", self.stolen_ppm)?;
        }
        Ok(())
    }
}

/// Stolen share of all processor time since boot (ppm), from the text of `/proc/stat`; `None` where
/// the kernel does not count it.
fn stolen_ppm(stat: &str) -> Option<u64> {
    let line = stat.lines().next()?.strip_prefix("cpu ")?;
    let times: Vec<u64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>().ok()?;
    // user, nice, system, idle, iowait, irq, softirq, steal; guest time is counted in user already.
    let all: u64 = times.iter().take(8).sum();
    (times.get(7)? * 1_000_000).checked_div(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: HostStall = HostStall {
        longest_ns: 80_000,
        stalls: 0,
        wakes: 4000,
        processors: 2,
        stolen_ppm: 0,
        fifo: true,
    };

    #[test]
    fn permission_without_capability_gives_best_effort() {
        assert_eq!(QUIET.profile(), Profile::Realtime);
        assert_eq!(HostStall { fifo: false, ..QUIET }.profile(), Profile::BestEffort);
        // The stalls that tripped every realtime rig of a virtual machine.
        for longest_ns in [5_000_000, 28_000_000] {
            assert_eq!(HostStall { longest_ns, ..QUIET }.profile(), Profile::BestEffort);
        }
        // Too rare for two seconds, but seen since boot.
        assert_eq!(HostStall { stolen_ppm: 800, ..QUIET }.profile(), Profile::BestEffort);
    }

    #[test]
    fn the_thresholds_follow_from_the_timeouts() {
        let tolerated = |profile| Timeouts::of(profile).stall_ns();
        assert_eq!(tolerated(Profile::Realtime), 2_500_000);
        assert_eq!(tolerated(Profile::BestEffort), 37_500_000);
        let stalled = |longest_ns| HostStall { longest_ns, ..QUIET };
        assert!(!stalled(1_250_000).exceeds(Profile::Realtime));
        assert!(stalled(1_250_001).exceeds(Profile::Realtime));
        assert!(!stalled(18_750_000).exceeds(Profile::BestEffort));
        assert!(stalled(18_750_001).exceeds(Profile::BestEffort));
    }

    #[test]
    fn wakes_are_counted_and_merged() {
        let mut one = HostStall { processors: 1, fifo: true, ..HostStall::default() };
        one.record(2_500_000, 2);
        one.record(2_500_001, 0);
        assert_eq!((one.longest_ns, one.stalls, one.wakes), (2_500_001, 1, 4));
        let both = one.merged(QUIET);
        assert_eq!((both.longest_ns, both.wakes, both.processors), (2_500_001, 4004, 3));
        assert!(!both.merged(HostStall { fifo: false, ..QUIET }).fifo);
    }

    #[test]
    fn stolen_time_is_read_from_proc_stat() {
        let stat = "cpu  130243 7317 13007 64286 553 0 88 176 0 0\ncpu0 65443 3276 6066\n";
        assert_eq!(stolen_ppm(stat), Some(816));
        assert_eq!(stolen_ppm("cpu  1 2 3 4\n"), None);
        assert_eq!(stolen_ppm(""), None);
    }

    #[test]
    fn a_short_measurement_sees_every_processor() {
        let found = HostStall::measure(Duration::from_millis(50));
        assert!(found.processors >= 1 && found.wakes >= 20, "{found:?}");
    }
}
