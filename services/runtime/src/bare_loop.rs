//! Bare loops, one on each processor, that do nothing but wake: how late they are is the machine's
//! own lateness, without any work of a rig.

use std::time::Duration;

use ipc_types::Profile;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::clock::now_ns;
use crate::grid::{Grid, Wake};
use crate::realtime::{request_fifo, request_short_slices};

/// Rate of the loops (Hz).
const LOOP_HZ: u32 = 1000;

/// Processors on which this process may run.
pub fn own_processors() -> Vec<usize> {
    sched_getaffinity(None).map_or_else(
        |_| Vec::new(),
        |set| (0..CpuSet::MAX_CPU).filter(|&processor| set.is_set(processor)).collect(),
    )
}

/// Runs a loop on every processor that this process may run on, at this priority in `SCHED_FIFO`,
/// or in short slices where that is not granted. Returns what each has recorded in a value of its
/// own, and whether it ran in `SCHED_FIFO`. A loop that panicked is left out.
pub(crate) fn on_every_processor<T: Send + 'static>(
    duration: Duration,
    priority: i32,
    new: impl Fn() -> T,
    record: fn(&mut T, &Wake),
) -> Vec<(T, bool)> {
    let loops: Vec<_> = own_processors()
        .into_iter()
        .map(|processor| {
            let mut recorded = new();
            std::thread::spawn(move || {
                bind(processor);
                let fifo = request_fifo(priority) == Profile::Realtime;
                if !fifo {
                    request_short_slices();
                }
                let mut grid = Grid::of_rate(LOOP_HZ, 0);
                let end_ns = now_ns() + duration.as_nanos() as u64;
                while now_ns() < end_ns {
                    if let Some(wake) = grid.wait() {
                        record(&mut recorded, &wake);
                    }
                }
                (recorded, fifo)
            })
        })
        .collect();
    loops.into_iter().filter_map(|bare| bare.join().ok()).collect()
}

/// Binds the calling thread to one processor, and with it the threads that it starts from now on.
/// Returns where it could run before; `None` where it was refused and runs as before.
pub fn bind(processor: usize) -> Option<CpuSet> {
    if processor >= CpuSet::MAX_CPU {
        return None;
    }
    let before = sched_getaffinity(None).ok()?;
    let mut only = CpuSet::new();
    only.set(processor);
    sched_setaffinity(None, &only).ok()?;
    Some(before)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_is_bound_and_says_where_it_was() {
        let all = own_processors();
        let last = *all.last().unwrap();
        let found = std::thread::spawn(move || {
            let before = bind(last).unwrap();
            (before, own_processors(), bind(CpuSet::MAX_CPU))
        });
        let (before, now, refused) = found.join().unwrap();
        assert_eq!((now, before.count() as usize), (vec![last], all.len()));
        assert!(refused.is_none());
    }
}
