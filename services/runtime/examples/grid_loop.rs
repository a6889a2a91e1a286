//! A bare loop on the grid that every periodic process of a rig wakes on: it does nothing but wake,
//! and says how late. For comparison with other loops of its kind, such as cyclictest.
//!
//! ```text
//! $ cargo build --release -p runtime --example grid_loop
//! $ target/release/examples/grid_loop RATE_HZ PRIORITY PROCESSOR SECONDS
//! {"fifo":true,"late_ns":[P50,P99,P99_9,MAX],"skipped":PERIODS,"wakes":NUMBER}
//! ```
//!
//! It asks for what a rig's loop asks for: `SCHED_FIFO`, locked memory, processors that stay awake,
//! timers that are not rounded. SIGTERM ends it early.

use std::process::ExitCode;
use std::sync::atomic::Ordering;

use hdrhistogram::Histogram;
use ipc_types::Profile;
use runtime::clock::{SECOND_NS, now_ns};
use runtime::{Grid, bind, realtime, stop_flag};

/// Longest lateness that is told apart (ns).
const LONGEST_NS: u64 = 10 * SECOND_NS;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let numbers: Result<Vec<u32>, _> = words.iter().map(|word| word.parse()).collect();
    let Ok(&[rate_hz, priority, processor, seconds]) = numbers.as_deref() else {
        eprintln!(
            "usage: grid_loop RATE_HZ PRIORITY PROCESSOR SECONDS: expected four whole numbers, \
             found: {}",
            words.join(" ")
        );
        return ExitCode::from(2);
    };
    match run(rate_hz, priority, processor, seconds) {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("grid_loop: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(
    rate_hz: u32,
    priority: u32,
    processor: u32,
    seconds: u32,
) -> Result<serde_json::Value, Box<dyn std::error::Error>> {
    let stop = stop_flag()?;
    let mut late = Histogram::<u64>::new_with_bounds(1, LONGEST_NS, 3)?;
    realtime::lock_memory();
    let _awake = realtime::stay_awake();
    bind(processor as usize).ok_or_else(|| format!("processor {processor}: cannot run there"))?;
    let fifo = realtime::request_fifo(i32::try_from(priority)?) == Profile::Realtime;
    realtime::tighten_timer_slack();
    realtime::prefault_stack();
    let mut grid = Grid::of_rate(rate_hz, 0);
    let end_ns = now_ns() + u64::from(seconds) * SECOND_NS;
    while !stop.load(Ordering::Relaxed) {
        let Some(wake) = grid.wait() else { continue };
        if wake.woke_ns >= end_ns {
            break;
        }
        late.saturating_record(wake.late_ns());
    }
    let quantiles = [0.5, 0.99, 0.999].map(|quantile| late.value_at_quantile(quantile));
    let [p50, p99, p99_9] = quantiles;
    Ok(serde_json::json!({
        "fifo": fifo,
        "late_ns": [p50, p99, p99_9, late.max()],
        "skipped": grid.missed(),
        "wakes": late.len(),
    }))
}
