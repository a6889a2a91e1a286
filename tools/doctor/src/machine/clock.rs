//! The clock that all processes share: its source, what reading it costs, whether it goes back.

use std::time::Instant;

use runtime::Verdict;
use runtime::clock::now_ns;
use rustix::time::{ClockId, clock_getres};
use serde::Serialize;

use crate::bench::Bench;
use crate::outcome::{Outcome, at_most, worse};

/// Readings in a row.
const READINGS: u32 = 200_000;
/// Sources that a processor reads from its own counter.
const OWN_COUNTERS: [&str; 3] = ["tsc", "kvm-clock", "arch_sys_counter"];
/// A reading without a system call takes some ten ns; with one, several hundred (ns).
const COST_PASS_NS: f64 = 200.0;
/// A loop reads the clock some ten times a period: this costs a hundredth of a period of 500 µs
/// (ns).
const COST_WARN_NS: f64 = 2000.0;
/// A coarser clock cannot tell the phases of a period apart (ns).
const RESOLUTION_NS: u64 = 1000;

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Clock {
    /// The kernel's clock source; empty where it does not say.
    source: String,
    /// What a reading costs (ns).
    cost_ns: f64,
    /// Resolution (ns).
    resolution_ns: u64,
    /// Readings that were earlier than the one before.
    backwards: u32,
}

pub(crate) fn examine(_bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let source =
        std::fs::read_to_string("/sys/devices/system/clocksource/clocksource0/current_clocksource")
            .unwrap_or_default();
    let begun = Instant::now();
    let (mut before, mut backwards) = (now_ns(), 0);
    for _ in 0..READINGS {
        let now = now_ns();
        backwards += u32::from(now < before);
        before = now;
    }
    let cost_ns = begun.elapsed().as_secs_f64() * 1e9 / f64::from(READINGS);
    let resolution = clock_getres(ClockId::Monotonic);
    let found = Clock {
        source: source.trim().to_owned(),
        cost_ns,
        resolution_ns: resolution.tv_sec as u64 * 1_000_000_000 + resolution.tv_nsec as u64,
        backwards,
    };
    Ok(judge(&found).measured(&found))
}

fn judge(found: &Clock) -> Outcome {
    let Clock { source, cost_ns, resolution_ns, backwards } = found;
    let name = if source.is_empty() { "unknown source" } else { source };
    let text = format!("{name}, {cost_ns:.0} ns a reading, resolution {resolution_ns} ns");
    if *backwards > 0 {
        let text = format!("{text}; went back {backwards} times");
        return Outcome::new(Verdict::Fail, text);
    }
    let own = OWN_COUNTERS.contains(&source.as_str());
    let by_source = if own { Verdict::Pass } else { Verdict::Warn };
    let by_cost = at_most(*cost_ns, COST_PASS_NS, COST_WARN_NS);
    let by_resolution = if *resolution_ns > RESOLUTION_NS { Verdict::Fail } else { Verdict::Pass };
    Outcome::new(worse(worse(by_source, by_cost), by_resolution), text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_of_the_processor_that_is_cheap_and_rises_passes() {
        let sound =
            Clock { source: "tsc".to_owned(), cost_ns: 200.0, resolution_ns: 1, backwards: 0 };
        let verdict = |clock: Clock| judge(&clock).verdict;
        assert_eq!(verdict(sound.clone()), Verdict::Pass);
        assert_eq!(verdict(Clock { cost_ns: 201.0, ..sound.clone() }), Verdict::Warn);
        assert_eq!(verdict(Clock { cost_ns: 2001.0, ..sound.clone() }), Verdict::Fail);
        assert_eq!(verdict(Clock { source: "hpet".to_owned(), ..sound.clone() }), Verdict::Warn);
        assert_eq!(verdict(Clock { resolution_ns: 1000, ..sound.clone() }), Verdict::Pass);
        assert_eq!(verdict(Clock { resolution_ns: 1001, ..sound.clone() }), Verdict::Fail);
        assert_eq!(verdict(Clock { backwards: 1, ..sound }), Verdict::Fail);
    }
}
