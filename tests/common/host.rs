//! Whether this machine can run a rig in real time at all: one that shares its processors may lose
//! them for longer than a life, and then every rig of the real-time profile trips, rightly,
//! whatever a test does.

use std::sync::OnceLock;
use std::time::Duration;

use ipc_types::Profile;
use runtime::Grid;
use runtime::clock::now_ns;
use runtime::realtime::request_fifo;
use rustix::thread::{CpuSet, sched_setaffinity};

/// What the watchdog of a real-time rig bears of its peers before the enable line pauses (SR-24),
/// with a little to spare.
const BORNE: Duration = Duration::from_micros(2500);
/// How long is looked.
const LOOKED_AT: Duration = Duration::from_secs(3);
const LOOPS_HZ: u32 = 1000;
/// Above every loop of a rig.
const PRIORITY: i32 = 90;

/// The longest delay of a bare loop in the real-time class, once for each test program; `None`
/// where that class is not granted.
pub fn longest_delay() -> Option<Duration> {
    static LONGEST: OnceLock<Option<Duration>> = OnceLock::new();
    *LONGEST.get_or_init(|| {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let loops: Vec<_> =
            (0..cores).map(|core| std::thread::spawn(move || bare_loop(core))).collect();
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

/// Wakes every millisecond on one core, above everything that has no real-time class; how late at
/// most.
fn bare_loop(core: usize) -> Option<Duration> {
    let mut cores = CpuSet::new();
    cores.set(core);
    // A core that may not be chosen is left to the scheduler.
    let _pinned = sched_setaffinity(None, &cores);
    if request_fifo(PRIORITY) != Profile::Realtime {
        return None;
    }
    let mut grid = Grid::of_rate(LOOPS_HZ, 0);
    let (end, mut most) = (now_ns() + LOOKED_AT.as_nanos() as u64, 0);
    while now_ns() < end {
        if let Some(wake) = grid.wait() {
            most = most.max(wake.late_ns());
        }
    }
    Some(Duration::from_nanos(most))
}
