//! The one clock: `CLOCK_MONOTONIC`, in nanoseconds.

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

/// Nanoseconds in a second.
pub const SECOND_NS: u64 = 1_000_000_000;
/// Nanoseconds in a millisecond.
pub const MILLISECOND_NS: u64 = 1_000_000;

fn nanoseconds(time: Timespec) -> u64 {
    time.tv_sec as u64 * SECOND_NS + time.tv_nsec as u64
}

/// Now, in ns of `CLOCK_MONOTONIC`.
pub fn now_ns() -> u64 {
    nanoseconds(clock_gettime(ClockId::Monotonic))
}

/// Now, in ns since 1970 (`CLOCK_REALTIME`).
pub fn realtime_ns() -> u64 {
    nanoseconds(clock_gettime(ClockId::Realtime))
}

/// A reading of both clocks at the same instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockPair {
    /// `CLOCK_MONOTONIC` (ns)
    pub monotonic_ns: u64,
    /// `CLOCK_REALTIME` (ns since 1970)
    pub realtime_ns: u64,
    /// Half the time between the two monotonic readings around the other one (ns)
    pub uncertainty_ns: u64,
}

impl ClockPair {
    /// Realtime minus monotonic (ns).
    pub fn offset_ns(&self) -> i64 {
        self.realtime_ns.wrapping_sub(self.monotonic_ns) as i64
    }

    /// Reads both; the best of five attempts, so that one preemption does not spoil it.
    pub fn measure() -> Self {
        let mut best = Self { monotonic_ns: 0, realtime_ns: 0, uncertainty_ns: u64::MAX };
        for _ in 0..5 {
            let before = now_ns();
            let realtime = realtime_ns();
            let uncertainty_ns = (now_ns() - before) / 2;
            if uncertainty_ns < best.uncertainty_ns {
                best = Self {
                    monotonic_ns: before + uncertainty_ns,
                    realtime_ns: realtime,
                    uncertainty_ns,
                };
            }
        }
        best
    }
}

/// Sleeps until an absolute time of `CLOCK_MONOTONIC`. Returns early when a signal arrives.
pub fn sleep_until(time_ns: u64) {
    let (tv_sec, tv_nsec) = ((time_ns / SECOND_NS) as i64, (time_ns % SECOND_NS) as i64);
    // The only error that a valid time can have is the signal's.
    let _woken = clock_nanosleep_absolute(ClockId::Monotonic, &Timespec { tv_sec, tv_nsec });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pair_agrees_with_the_clocks() {
        let pair = ClockPair::measure();
        assert!(pair.monotonic_ns <= now_ns());
        assert!(pair.realtime_ns > 1_600_000_000 * SECOND_NS);
        assert_eq!(pair.offset_ns() + pair.monotonic_ns as i64, pair.realtime_ns as i64);
    }

    #[test]
    fn never_wakes_before_the_time() {
        let until = now_ns() + 2 * MILLISECOND_NS;
        sleep_until(until);
        assert!(now_ns() >= until);
    }
}
