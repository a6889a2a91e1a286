//! The enable line: whether the card drops the motor when it stops toggling.

use std::time::{Duration, Instant};

use ipc_types::{ENABLE_LINE, EnableLine, SAMPLE, Sample, Verb};
use operator::{reset_and_arm, verb};
use runtime::{Subscriber, Timeouts, Verdict};
use serde::Serialize;

use super::connection::RunningRig;
use crate::bench::Bench;
use crate::outcome::{Outcome, at_most};

/// How long power may take to come after `enable`, and to go after `disarm`.
const POWER_LIMIT: Duration = Duration::from_secs(1);
/// How long the motor is powered; control holds the position meanwhile.
const POWERED_FOR: Duration = Duration::from_millis(200);
const POLL_PERIOD: Duration = Duration::from_millis(1);
/// The card sees an edge up to a period of the watchdog's loop late, and reports up to a period of
/// acquisition's later (ns).
const MARGIN_NS: u64 = 2_000_000;

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Line {
    /// Whether the card reported motor power after `enable`.
    powered: bool,
    /// From the line's last edge to the first scan without power (ns); `None` where power stayed.
    dropped_ns: Option<u64>,
    /// After so long the card must drop the motor (ns).
    timeout_ns: u64,
    /// Motor voltage while it was powered, largest magnitude (V): control holds the position.
    volts: f64,
}

pub(crate) fn examine(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let stop = bench.stop;
    let rig = bench.rig()?;
    if let Err(error) = reset_and_arm(&rig.link, stop, &mut |_| {}) {
        let text = format!("the rig could not be armed: {error}");
        return Ok(Outcome::new(Verdict::Fail, text).remedy("see `farreach status`"));
    }
    let found = powered_and_dropped(rig);
    // Whatever came of it: no motor stays under power.
    let disarmed = verb(&rig.link, Verb::Disarm);
    let found = found?;
    disarmed?;
    Ok(judge(&found).measured(&found))
}

/// Enables the motor for a moment, disarms, and watches line and card.
fn powered_and_dropped(rig: &RunningRig) -> anyhow::Result<Line> {
    let mut lines = rig.link.subscriber(ENABLE_LINE)?;
    let mut samples = rig.link.subscriber(SAMPLE)?;
    let timeouts = Timeouts::of(rig.link.domain().profile());
    let mut found = Line { timeout_ns: timeouts.enable_line_ns, ..Line::default() };
    let mut seen = Seen::default();
    verb(&rig.link, Verb::Enable)?;
    let begun = Instant::now();
    while begun.elapsed() < POWER_LIMIT && !found.powered {
        seen.read(&mut lines, &mut samples)?;
        found.powered = seen.newest.motor_power == 1;
        std::thread::sleep(POLL_PERIOD);
    }
    let powered = Instant::now();
    while found.powered && powered.elapsed() < POWERED_FOR {
        seen.read(&mut lines, &mut samples)?;
        let volts = seen.newest.motor_v.iter().map(|volts| volts.abs()).fold(0.0, f64::max);
        found.volts = found.volts.max(volts);
        std::thread::sleep(POLL_PERIOD);
    }
    verb(&rig.link, Verb::Disarm)?;
    let disarmed = Instant::now();
    while found.powered && disarmed.elapsed() < POWER_LIMIT && seen.dropped_ns.is_none() {
        seen.read(&mut lines, &mut samples)?;
        std::thread::sleep(POLL_PERIOD);
    }
    found.dropped_ns = seen.dropped_ns.map(|dropped_ns| dropped_ns.saturating_sub(seen.edge_ns));
    Ok(found)
}

/// The last edge of the line, and what the card reports.
#[derive(Default)]
struct Seen {
    toggles: u64,
    /// When the line last changed [ns, CLOCK_MONOTONIC].
    edge_ns: u64,
    newest: Sample,
    /// When the card took the first scan without power after one with it.
    dropped_ns: Option<u64>,
}

impl Seen {
    fn read(
        &mut self,
        lines: &mut Subscriber<EnableLine>,
        samples: &mut Subscriber<Sample>,
    ) -> anyhow::Result<()> {
        while let Some(line) = lines.take()? {
            if line.toggles != self.toggles {
                (self.toggles, self.edge_ns) = (line.toggles, line.time_ns);
            }
        }
        while let Some(sample) = samples.take()? {
            self.scan(sample);
        }
        Ok(())
    }

    fn scan(&mut self, sample: Sample) {
        if self.newest.motor_power == 1 && sample.motor_power == 0 {
            self.dropped_ns.get_or_insert(sample.scan_time_ns);
        }
        self.newest = sample;
    }
}

fn judge(found: &Line) -> Outcome {
    let Line { powered, dropped_ns, timeout_ns, volts } = found;
    let milliseconds = |ns: u64| ns as f64 * 1e-6;
    if !powered {
        let text = "the card reports no motor power after `enable`";
        return Outcome::new(Verdict::Fail, text)
            .remedy("release the emergency stop; check the enable line's wire, relay and contact");
    }
    let Some(dropped_ns) = dropped_ns else {
        let text = "power stayed on for 1 s after the line had stopped";
        return Outcome::new(Verdict::Fail, text).remedy(
            "switch the motor's supply off by hand: the relay or its timer is stuck, and only one \
             way to 0 V is left",
        );
    };
    let limit_ns = timeout_ns + MARGIN_NS;
    // What drops later is no second way to 0 V: there is nothing in between.
    let verdict = at_most(*dropped_ns, limit_ns, limit_ns);
    let text = format!(
        "power dropped {:.1} ms after the line's last edge, at most {} ms allowed; {volts:.2} V \
         meanwhile",
        milliseconds(*dropped_ns),
        milliseconds(limit_ns)
    );
    Outcome::new(verdict, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_must_come_and_go_in_time() {
        let timeout_ns = 5_000_000;
        let verdict = |powered, dropped_ns| {
            judge(&Line { powered, dropped_ns, timeout_ns, volts: 0.0 }).verdict
        };
        assert_eq!(verdict(true, Some(7_000_000)), Verdict::Pass);
        assert_eq!(verdict(true, Some(7_000_001)), Verdict::Fail);
        assert_eq!(verdict(true, None), Verdict::Fail);
        assert_eq!(verdict(false, Some(1)), Verdict::Fail);
    }

    #[test]
    fn the_first_scan_without_power_counts() {
        let mut seen = Seen::default();
        let scan =
            |at: u64, motor_power| Sample { scan_time_ns: at, motor_power, ..Sample::default() };
        for (at, power) in [(1, 0), (2, 1), (3, 1)] {
            seen.scan(scan(at, power));
            assert_eq!(seen.dropped_ns, None);
        }
        for (at, power) in [(4, 0), (5, 0), (6, 1), (7, 0)] {
            seen.scan(scan(at, power));
        }
        assert_eq!(seen.dropped_ns, Some(4));
    }
}
