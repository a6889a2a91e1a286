//! Real-time scheduling: whether it is granted, and whether it has an effect.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use ipc_types::Profile;
use runtime::clock::SECOND_NS;
use runtime::realtime::{HELPER_PRIORITY, request_fifo, request_normal};
use runtime::{Verdict, bind, own_processors};
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

use crate::bench::Bench;
use crate::outcome::Outcome;

/// Above a process that starts, below every loop of a rig that may be up.
const PRIORITY: i32 = HELPER_PRIORITY + 10;
/// How long the two threads compete for one processor.
const COMPETED_FOR: Duration = Duration::from_millis(100);
/// Least share of the processor that a thread in `SCHED_FIFO` gets beside an ordinary one. With
/// equal rights it gets half.
const EFFECTIVE_SHARE: f64 = 0.9;
/// Least share of time that the kernel must leave to all real-time threads together: the loops of a
/// rig of three axes with card and plant take less than a quarter of one processor.
const RUNTIME_SHARE: f64 = 0.5;

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Scheduling {
    /// Whether the kernel says `SCHED_FIFO` of the thread that asked for it.
    granted: bool,
    /// Its share of a processor that an ordinary thread wants, too (1).
    share: f64,
    /// Share of time that the kernel leaves to real-time threads; 1 where it sets no limit.
    runtime_share: f64,
}

pub(crate) fn examine(_bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let found = measure()?;
    Ok(judge(&found).measured(&found))
}

fn measure() -> anyhow::Result<Scheduling> {
    let processor = *own_processors().last().ok_or_else(|| anyhow!("no processor is allowed"))?;
    let stop = Arc::new(AtomicBool::new(false));
    // Processor time of the ordinary thread so far (ns).
    let others_ns = Arc::new(AtomicU64::new(0));
    let ordinary = {
        let (stop, others_ns) = (Arc::clone(&stop), Arc::clone(&others_ns));
        std::thread::spawn(move || {
            bind(processor);
            request_normal();
            while !stop.load(Ordering::Relaxed) {
                others_ns.store(own_time_ns(), Ordering::Relaxed);
            }
        })
    };
    let realtime = std::thread::spawn(move || {
        bind(processor);
        let asked = request_fifo(PRIORITY) == Profile::Realtime;
        let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap_or_default();
        let both = || (own_time_ns(), others_ns.load(Ordering::Relaxed));
        let (begun, before) = (Instant::now(), both());
        while begun.elapsed() < COMPETED_FOR {
            std::hint::spin_loop();
        }
        let after = both();
        let (own, others) = (after.0 - before.0, after.1.saturating_sub(before.1));
        (asked && is_fifo(&stat), own as f64 / (own + others).max(1) as f64)
    });
    let joined = realtime.join();
    stop.store(true, Ordering::Relaxed);
    let panicked = || anyhow!("a thread panicked");
    ordinary.join().map_err(|_| panicked())?;
    let (granted, share) = joined.map_err(|_| panicked())?;
    let kernel = |file: &str| {
        let text = std::fs::read_to_string(format!("/proc/sys/kernel/{file}")).ok()?;
        text.trim().parse::<f64>().ok()
    };
    let limit = kernel("sched_rt_runtime_us").zip(kernel("sched_rt_period_us"));
    Ok(Scheduling { granted, share, runtime_share: runtime_share(limit) })
}

/// Processor time of the calling thread (ns).
fn own_time_ns() -> u64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as u64 * SECOND_NS + time.tv_nsec as u64
}

/// Whether `/proc/PID/stat` shows the class `SCHED_FIFO` (field 41 is 1).
fn is_fifo(stat: &str) -> bool {
    let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    // The first field after the name is the third.
    after_name.split_whitespace().nth(41 - 3) == Some("1")
}

fn runtime_share(limit: Option<(f64, f64)>) -> f64 {
    match limit {
        Some((runtime_us, period_us)) if runtime_us >= 0.0 && period_us > 0.0 => {
            runtime_us / period_us
        }
        _ => 1.0,
    }
}

fn judge(found: &Scheduling) -> Outcome {
    let Scheduling { granted, share, runtime_share } = found;
    let limit = format!("the kernel leaves {:.0} % of time to all", runtime_share * 100.0);
    if !granted {
        return Outcome::new(Verdict::Fail, "SCHED_FIFO is refused to this user");
    }
    let percent = share * 100.0;
    let text = format!("SCHED_FIFO granted, {percent:.0} % of a contended processor; {limit}");
    if *share < EFFECTIVE_SHARE {
        let remedy = "the kernel grants SCHED_FIFO without effect, as a sandbox or a container's \
                      quota does: run farreach outside of it, or with CPU quota off (cpu.max)";
        return Outcome::new(Verdict::Fail, text).remedy(remedy);
    }
    if *runtime_share < RUNTIME_SHARE {
        let remedy = "sysctl kernel.sched_rt_runtime_us=950000";
        return Outcome::new(Verdict::Warn, text).remedy(remedy);
    }
    Outcome::new(Verdict::Pass, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn granted_is_not_enough() {
        let found = |granted, share, runtime_share| {
            judge(&Scheduling { granted, share, runtime_share }).verdict
        };
        assert_eq!(found(true, 0.9, 0.95), Verdict::Pass);
        assert_eq!(found(true, 0.89, 0.95), Verdict::Fail);
        assert_eq!(found(false, 1.0, 1.0), Verdict::Fail);
        assert_eq!(found(true, 1.0, 0.5), Verdict::Pass);
        assert_eq!(found(true, 1.0, 0.49), Verdict::Warn);
    }

    #[test]
    fn class_and_limit_as_the_kernel_writes_them() {
        let fields = |policy| {
            let zeros = vec!["0"; 37].join(" ");
            format!("12 (a b) c) S {zeros} {policy} 0 0")
        };
        assert!(is_fifo(&fields("1")));
        assert!(!is_fifo(&fields("0")));
        assert!(!is_fifo(""));
        assert_eq!(runtime_share(Some((950_000.0, 1_000_000.0))), 0.95);
        assert_eq!(runtime_share(Some((-1.0, 1_000_000.0))), 1.0);
        assert_eq!(runtime_share(None), 1.0);
    }

    #[test]
    fn shares_are_shares() {
        let found = measure().unwrap();
        assert!((0.0..=1.0).contains(&found.share), "{found:?}");
    }
}
