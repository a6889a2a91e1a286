//! Progress of a protocol, from the experiment's loop to its request thread.
#![cfg(loom)]

use interleavings::explore;
use ipc_types::{ExperimentAnswer, ScanProgress};
use loom::sync::Arc;
use loom::thread;
use progress::{AxisBits, Progress, ProgressSnapshot};

mod sync {
    pub(crate) use loom::sync::atomic::{AtomicU64, Ordering};
}

#[allow(dead_code)]
#[path = "../../../services/experiment/src/process/progress.rs"]
mod progress;

/// Time of the newest sample in the cycle of that number (ns).
const fn sample_ns(cycle: u32) -> u64 {
    1000 * cycle as u64
}

/// What the loop publishes in the cycle of that number, with the order of the same number.
fn publish(progress: &Progress, cycle: u32) {
    let scan = ScanProgress {
        volumes: u64::from(cycle),
        expected: u64::from(cycle) + 7,
        ..ScanProgress::default()
    };
    let status = ExperimentAnswer {
        running: true,
        segment: cycle,
        elapsed_s: f64::from(cycle),
        scan: Some(scan),
        ..ExperimentAnswer::default()
    };
    let axes = AxisBits { homed: 1, beyond_range: 0 };
    progress.update(cycle, &status, sample_ns(cycle), true, axes);
}

/// Whoever sees an order taken sees what was published with it, or something newer, never older.
fn check(seen: &ProgressSnapshot, newest: u32) {
    let order = seen.order;
    assert_eq!((seen.running, seen.enabled, seen.segment), (order > 0, order > 0, order));
    assert!((sample_ns(order)..=sample_ns(newest)).contains(&seen.sample_ns), "{seen:?}");
    assert!((f64::from(order)..=f64::from(newest)).contains(&seen.elapsed_s), "{seen:?}");
    if let Some(scan) = seen.scan {
        // Both halves of a word are of one cycle.
        assert_eq!(scan.expected, scan.volumes + 7);
        assert!((u64::from(order)..=u64::from(newest)).contains(&scan.volumes), "{seen:?}");
    }
}

#[test]
fn who_sees_an_order_taken_sees_nothing_older() {
    explore("progress, two cycles, one look", Some(4), || {
        let progress = Arc::new(Progress::default());
        let other = Arc::clone(&progress);
        let thread = thread::spawn(move || (1..=2).for_each(|cycle| publish(&other, cycle)));
        check(&progress.read(), 2);
        thread.join().unwrap();
        let last = progress.read();
        check(&last, 2);
        assert_eq!((last.order, last.sample_ns), (2, sample_ns(2)));
    });
}

#[test]
fn two_looks_never_go_back() {
    explore("progress, one cycle, two looks", Some(4), || {
        let progress = Arc::new(Progress::default());
        let other = Arc::clone(&progress);
        let thread = thread::spawn(move || publish(&other, 1));
        let (first, second) = (progress.read(), progress.read());
        check(&first, 1);
        check(&second, 1);
        assert!(second.order >= first.order && second.sample_ns >= first.sample_ns);
        thread.join().unwrap();
    });
}

/// Two threads renew the lease: the loop where a protocol begins, the request thread when its
/// client says so. The lease is one of both, and the later one once the threads know of each other.
#[test]
fn a_renewed_lease_is_one_of_those_that_were_written() {
    explore("lease, two writers", None, || {
        let progress = Arc::new(Progress::default());
        let other = Arc::clone(&progress);
        let thread = thread::spawn(move || {
            other.renew(1);
            other.renewed_ns()
        });
        progress.renew(2);
        let (mine, its) = (progress.renewed_ns(), thread.join().unwrap());
        assert!((mine == 1 || mine == 2) && (its == 1 || its == 2), "{mine} {its}");
        progress.renew(3);
        assert_eq!(progress.renewed_ns(), 3);
    });
}
