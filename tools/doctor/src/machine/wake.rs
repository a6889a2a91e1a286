//! Wake-up latency, idle and under load, and the host's stalls, which explain a part of it.

use std::time::Duration;

use ipc_types::Profile;
use runtime::{BIN_ENDS_US, HostStall, STOLEN_PPM, Timeouts, Verdict, WakeLateness, realtime};
use serde::Serialize;

use super::load::Load;
use crate::bench::Bench;
use crate::outcome::{Outcome, at_most, worse};

/// How long each measurement takes.
const MEASURED_FOR: Duration = Duration::from_secs(2);
/// 99 % of the wakes must be earlier: control's phase comes 120 µs after acquisition's, and control
/// answers an older sample where acquisition is later than that (rig file, `[phases_us]`).
const P99_PASS_NS: u64 = 120_000;
/// Period of acquisition at 2 kHz: later, and scans are taken in bursts.
const P99_WARN_NS: u64 = 500_000;
/// A latest wake within so many times the host's longest stall is the host's, not the scheduler's.
const STALL_FACTOR: u64 = 2;

/// A measurement, for programs.
#[derive(Clone, Debug, Serialize)]
struct Measured<'a> {
    #[serde(flatten)]
    late: &'a WakeLateness,
    bin_ends_us: [u64; BIN_ENDS_US.len()],
    /// Whether idle processors were kept awake meanwhile, as a rig does.
    kept_awake: bool,
}

pub(crate) fn examine_idle(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let awake = realtime::stay_awake();
    let late = WakeLateness::measure(MEASURED_FOR)?;
    let stall = bench.stall();
    let measured = Measured { late: &late, bin_ends_us: BIN_ENDS_US, kept_awake: awake.is_some() };
    Ok(judge(&late, &stall).measured(&measured))
}

pub(crate) fn examine_loaded(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let awake = realtime::stay_awake();
    let load = Load::begin();
    let late = WakeLateness::measure(MEASURED_FOR);
    drop(load);
    let (late, stall) = (late?, bench.stall());
    let measured = Measured { late: &late, bin_ends_us: BIN_ENDS_US, kept_awake: awake.is_some() };
    Ok(judge(&late, &stall).measured(&measured))
}

pub(crate) fn examine_stalls(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let stall = bench.stall();
    Ok(judge_stalls(&stall).measured(&stall))
}

/// Judges percentiles and the latest wake, and tells whether the host or the scheduler was late.
fn judge(late: &WakeLateness, stall: &HostStall) -> Outcome {
    let us = |ns: u64| ns as f64 / 1e3;
    let tolerated_ns = Timeouts::of(Profile::Realtime).stall_ns();
    let text = format!(
        "p50 {:.0}, p99 {:.0}, max {:.0} µs of {} wakes{}",
        us(late.p50_ns),
        us(late.p99_ns),
        us(late.longest_ns),
        late.wakes,
        if late.fifo { "" } else { ", without SCHED_FIFO" }
    );
    let percentile = at_most(late.p99_ns, P99_PASS_NS, P99_WARN_NS);
    let latest = at_most(late.longest_ns, tolerated_ns / 2, tolerated_ns);
    let verdict = worse(percentile, latest);
    if late.wakes == 0 {
        return Outcome::new(Verdict::Fail, "no wake was measured");
    }
    let outcome = Outcome::new(verdict, text);
    if verdict == Verdict::Pass {
        return outcome;
    }
    if !late.fifo {
        return outcome.remedy("grant real-time scheduling (see scheduling), and look again");
    }
    let by_host =
        late.longest_ns <= STALL_FACTOR * stall.longest_ns || stall.exceeds(Profile::Realtime);
    if by_host && percentile == Verdict::Pass {
        return outcome.remedy(format!(
            "not the scheduler: the host itself takes its processors away ({stall}); see stalls"
        ));
    }
    outcome
}

/// Judges by the choice of profile ([`HostStall::exceeds`]).
fn judge_stalls(stall: &HostStall) -> Outcome {
    let text = stall.to_string();
    if !stall.fifo {
        let verdict = if stall.exceeds(Profile::Realtime) { Verdict::Warn } else { Verdict::Pass };
        let text = format!("{text}; without SCHED_FIFO other programs count as well");
        let outcome = Outcome::new(verdict, text);
        return match verdict {
            Verdict::Pass => outcome,
            _ => outcome.remedy("grant real-time scheduling (see scheduling), and look again"),
        };
    }
    let verdict = if stall.exceeds(Profile::Realtime) { Verdict::Fail } else { Verdict::Pass };
    let tolerated_ns = Timeouts::of(Profile::Realtime).stall_ns();
    let why = if stall.longest_ns > tolerated_ns / 2 {
        format!("; a rig in real time trips at {} ms", tolerated_ns as f64 * 1e-6)
    } else if verdict == Verdict::Fail {
        format!("; more than {STOLEN_PPM} ppm: longer stalls than this one happen")
    } else {
        String::new()
    };
    Outcome::new(verdict, text + &why)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn late(p99_ns: u64, longest_ns: u64) -> WakeLateness {
        WakeLateness {
            p50_ns: 5000,
            p99_ns,
            longest_ns,
            wakes: 4000,
            fifo: true,
            ..WakeLateness::default()
        }
    }

    fn stalled(longest_ns: u64) -> HostStall {
        HostStall { longest_ns, wakes: 4000, processors: 2, fifo: true, ..HostStall::default() }
    }

    #[test]
    fn the_limits_are_phase_period_and_tolerated_stall() {
        let verdict = |p99, longest| judge(&late(p99, longest), &stalled(100_000)).verdict;
        assert_eq!(verdict(120_000, 1_250_000), Verdict::Pass);
        assert_eq!(verdict(120_001, 1_250_000), Verdict::Warn);
        assert_eq!(verdict(500_000, 1_250_000), Verdict::Warn);
        assert_eq!(verdict(500_001, 1_250_000), Verdict::Fail);
        assert_eq!(verdict(50_000, 1_250_001), Verdict::Warn);
        assert_eq!(verdict(50_000, 2_500_000), Verdict::Warn);
        assert_eq!(verdict(50_000, 2_500_001), Verdict::Fail);
        assert_eq!(judge(&WakeLateness::default(), &stalled(0)).verdict, Verdict::Fail);
    }

    #[test]
    fn the_host_is_told_from_the_scheduler() {
        let remedy = |late: &WakeLateness, stall| judge(late, &stall).remedy.unwrap_or_default();
        assert!(remedy(&late(50_000, 5_000_000), stalled(4_000_000)).contains("not the scheduler"));
        assert_eq!(remedy(&late(50_000, 5_000_000), stalled(100_000)), "");
        // Late in many wakes: no host's stall, which is rare.
        assert_eq!(remedy(&late(900_000, 5_000_000), stalled(4_000_000)), "");
        let ordinary = WakeLateness { fifo: false, ..late(900_000, 5_000_000) };
        assert!(remedy(&ordinary, stalled(4_000_000)).contains("scheduling"));
    }

    #[test]
    fn stalls_fail_where_the_keeper_would_not_choose_realtime() {
        let verdict = |stall| judge_stalls(&stall).verdict;
        assert_eq!(verdict(stalled(1_250_000)), Verdict::Pass);
        assert_eq!(verdict(stalled(1_250_001)), Verdict::Fail);
        assert_eq!(verdict(HostStall { stolen_ppm: 100, ..stalled(0) }), Verdict::Pass);
        assert_eq!(verdict(HostStall { stolen_ppm: 101, ..stalled(0) }), Verdict::Fail);
        let stolen = judge_stalls(&HostStall { stolen_ppm: 101, ..stalled(0) }).value;
        assert!(stolen.ends_with("; more than 100 ppm: longer stalls than this one happen"));
        assert!(judge_stalls(&stalled(1_250_001)).value.ends_with("trips at 2.5 ms"));
        assert_eq!(verdict(HostStall { fifo: false, ..stalled(9_000_000) }), Verdict::Warn);
        assert_eq!(verdict(HostStall { fifo: false, ..stalled(9_000) }), Verdict::Pass);
    }
}
