//! The two loops, on the grid and with the phases of acquisition and control.

use std::sync::atomic::Ordering;

use hdrhistogram::Histogram;
use ipc_types::{Message as _, Sample};
use runtime::clock::{SECOND_NS, now_ns};
use runtime::{Grid, realtime, stop_flag};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};

use crate::{Failure, Publish, Read};

const RATE_HZ: u32 = 2000;
const PERIOD_NS: u64 = SECOND_NS / RATE_HZ as u64;
const PUBLISH_PHASE_NS: u64 = 80_000;
const READ_PHASE_NS: u64 = 200_000;
/// Cycles that do not count: peers find each other, memory is touched for the first time.
const WARM_UP: u64 = 2000;

/// Publishes for so many seconds.
pub(crate) fn publish(seconds: u64, mut publish: Publish) -> Result<Value, Failure> {
    let _awake = realtime::stay_awake();
    let mut took = durations()?;
    let mut grid = Grid::of_rate(RATE_HZ, PUBLISH_PHASE_NS);
    let cycles = WARM_UP + seconds * u64::from(RATE_HZ);
    let mut used_ns = processor_ns();
    let mut number = 0;
    while number < cycles {
        let Some(wake) = grid.wait() else { continue };
        let sample = Sample { tick: wake.tick, scan_time_ns: wake.woke_ns, ..Sample::default() };
        let began_ns = now_ns();
        publish(sample)?;
        let ended_ns = now_ns();
        number += 1;
        if number == WARM_UP {
            used_ns = processor_ns();
        } else if number > WARM_UP {
            took.saturating_record(ended_ns - began_ns);
        }
    }
    Ok(found("publish", &took, (processor_ns() - used_ns) / took.len().max(1)))
}

/// Reads until SIGTERM: the newest message in each period.
pub(crate) fn read(mut read: Read) -> Result<Value, Failure> {
    let _awake = realtime::stay_awake();
    let stop = stop_flag()?;
    let (mut took, mut ages) = (durations()?, durations()?);
    let mut grid = Grid::of_rate(RATE_HZ, READ_PHASE_NS);
    let (mut number, mut used_ns) = (0, 0);
    let (mut empty, mut empty_since, mut old) = (0_u64, 0_u64, 0_u64);
    while !stop.load(Ordering::Relaxed) {
        if grid.wait().is_none() {
            continue;
        }
        let began_ns = now_ns();
        let newest = read()?;
        let ended_ns = now_ns();
        let Some(sample) = newest else {
            empty_since += 1;
            continue;
        };
        number += 1;
        if number == WARM_UP {
            used_ns = processor_ns();
        } else if number > WARM_UP {
            // Those after the last message are not known to be any.
            empty += empty_since;
            let age_ns = began_ns.saturating_sub(sample.time_ns());
            took.saturating_record(ended_ns - began_ns);
            ages.saturating_record(age_ns);
            old += u64::from(age_ns > PERIOD_NS);
        }
        empty_since = 0;
    }
    if took.is_empty() {
        return Err("no message came".into());
    }
    let used_ns = (processor_ns() - used_ns) / (took.len() + empty);
    let mut found = found("read", &took, used_ns);
    found["age_ns"] = json!(quantiles(&ages));
    // Reads that found nothing, and those that found one of an earlier period.
    found["empty"] = json!(empty);
    found["old"] = json!(old);
    Ok(found)
}

fn durations() -> Result<Histogram<u64>, hdrhistogram::CreationError> {
    Histogram::new_with_bounds(1, 10 * SECOND_NS, 3)
}

fn quantiles(of: &Histogram<u64>) -> [u64; 4] {
    let at = |quantile| of.value_at_quantile(quantile);
    [at(0.5), at(0.99), at(0.999), of.max()]
}

fn found(role: &str, took: &Histogram<u64>, processor_ns: u64) -> Value {
    json!({
        "role": role,
        "messages": took.len(),
        "took_ns": quantiles(took),
        // of the whole process, the library's threads included, for each message
        "processor_ns": processor_ns,
        "clock_ns": clock_ns(),
    })
}

/// Processor time that this process has used (ns).
fn processor_ns() -> u64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as u64 * SECOND_NS + time.tv_nsec as u64
}

/// What it takes to read the clock, which every duration has in it once (ns).
fn clock_ns() -> u64 {
    const READINGS: u64 = 10_000;
    let began_ns = now_ns();
    for _ in 1..READINGS {
        std::hint::black_box(now_ns());
    }
    (now_ns() - began_ns) / READINGS
}
