//! Whether this machine can run a rig in real time at all: one that shares its processors may lose them for longer than a life,
//! and then every rig of the real-time profile trips, rightly, whatever a test does.

use std::sync::OnceLock;
use std::time::Duration;

/// What the watchdog of a real-time rig bears of its peers before the enable line pauses (SR-24), with a little to spare.
const BORNE: Duration = Duration::from_micros(2500);
/// How long is looked.
const LOOKED_AT: Duration = Duration::from_secs(3);
const PERIOD_NS: i64 = 1_000_000;

/// The longest delay of a bare loop in the real-time class, once for each test program; `None` where that class is not granted.
pub fn longest_delay() -> Option<Duration> {
    static LONGEST: OnceLock<Option<Duration>> = OnceLock::new();
    *LONGEST.get_or_init(|| {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let loops: Vec<_> = (0..cores).map(|core| std::thread::spawn(move || bare_loop(core))).collect();
        loops
            .into_iter()
            .map(|bare| bare.join().ok().flatten())
            .try_fold(Duration::ZERO, |most, one| Some(most.max(one?)))
    })
}

/// Whether the machine takes processors away for longer than a real-time rig bears.
pub fn stalls() -> bool {
    longest_delay().is_some_and(|longest| longest > BORNE)
}

/// Wakes every millisecond on one core, above everything that has no real-time class; how late at most.
fn bare_loop(core: usize) -> Option<Duration> {
    // SAFETY: plain calls on this thread, with structures that live through them.
    unsafe {
        let mut cores: libc::cpu_set_t = std::mem::zeroed();
        libc::CPU_SET(core, &mut cores);
        // A core that may not be chosen is left to the scheduler.
        let _pinned = libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &raw const cores);
        let priority = libc::sched_param { sched_priority: 80 };
        if libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const priority) != 0 {
            return None;
        }
        let now = || {
            let mut now: libc::timespec = std::mem::zeroed();
            libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut now);
            now.tv_sec * 1_000_000_000 + now.tv_nsec
        };
        let (begin, mut most) = (now(), 0);
        let mut next = begin;
        while next - begin < LOOKED_AT.as_nanos() as i64 {
            next += PERIOD_NS;
            let at = libc::timespec { tv_sec: next / 1_000_000_000, tv_nsec: next % 1_000_000_000 };
            libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &raw const at, std::ptr::null_mut());
            let late = now() - next;
            most = most.max(late);
            next += late / PERIOD_NS * PERIOD_NS;
        }
        Some(Duration::from_nanos(most as u64))
    }
}
