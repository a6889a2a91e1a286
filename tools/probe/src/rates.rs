//! `hz` and `delay`.

use std::io::Write;

use runtime::RigName;
use runtime::clock::{MILLISECOND_NS, now_ns};
use serde_json::json;

use crate::args::RateArgs;
use crate::attach::{self, Attached};
use crate::echo::time_of;
use crate::meter::{Meter, Times};

/// Polling period of `hz`, which reads the publishers' own times (ns).
const HZ_PERIOD_NS: u64 = 10 * MILLISECOND_NS;
/// Polling period of `delay`, and its resolution (ns).
const DELAY_PERIOD_NS: u64 = 100_000;

struct Measured {
    rig: Attached,
    meters: Vec<Meter>,
    seconds: f64,
}

impl Measured {
    fn new(args: &RateArgs, rig: &RigName, period_ns: u64) -> anyhow::Result<Self> {
        let topics = attach::topics(&args.topics)?;
        let mut rig = Attached::new(rig, &topics, period_ns)?;
        let mut meters =
            topics.iter().map(|topic| Meter::new(topic)).collect::<Result<Vec<_>, _>>()?;
        let (begun, end) = (rig.since_ns, rig.since_ns + attach::ns(args.seconds));
        while now_ns() < end && !rig.stopping() {
            rig.wait(end)?;
            rig.drain(|index, bytes, received_ns| {
                // Messages from before the measurement do not count.
                if time_of(bytes) >= begun {
                    meters[index].observe(bytes, received_ns);
                }
            })?;
        }
        Ok(Self { rig, meters, seconds: (now_ns() - begun) as f64 * 1e-9 })
    }

    /// Topics with messages; those named on the command line even if silent.
    fn rows<'a>(
        &'a self,
        args: &'a RateArgs,
    ) -> impl Iterator<Item = (&'static str, &'a Meter, u64)> {
        let all = self.rig.feeds.iter().zip(&self.meters);
        all.filter(|(_, meter)| meter.count > 0 || !args.topics.is_empty())
            .map(|(feed, meter)| (feed.topic.name, meter, feed.subscriber.counters().lost))
    }
}

pub(crate) fn hz(args: &RateArgs, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<()> {
    let measured = Measured::new(args, rig, HZ_PERIOD_NS)?;
    if args.json {
        let rows: Vec<_> = measured
            .rows(args)
            .map(|(topic, meter, lost)| {
                json!({
                    "topic": topic,
                    "rate_hz": meter.count as f64 / measured.seconds,
                    "messages": meter.count,
                    "lost": lost,
                    "interval_ms": meter.intervals(),
                })
            })
            .collect();
        writeln!(out, "{}", serde_json::Value::from(rows))?;
        return Ok(());
    }
    writeln!(
        out,
        "{:<20} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8} {:>5}",
        "topic", "rate Hz", "mean ms", "min", "max", "std", "messages", "lost"
    )?;
    for (topic, meter, lost) in measured.rows(args) {
        let rate = meter.count as f64 / measured.seconds;
        let intervals = meter.intervals().map_or_else(
            || format!("{:>8} {:>8} {:>8} {:>8}", "-", "-", "-", "-"),
            |i| format!("{:>8.3} {:>8.3} {:>8.3} {:>8.3}", i.mean, i.min, i.max, i.std),
        );
        writeln!(out, "{topic:<20} {rate:>7.1} {intervals} {:>8} {lost:>5}", meter.count)?;
    }
    Ok(())
}

pub(crate) fn delay(args: &RateArgs, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<()> {
    let measured = Measured::new(args, rig, DELAY_PERIOD_NS)?;
    let mut rows: Vec<(&str, &str, &Times)> = Vec::new();
    for (topic, meter, _) in measured.rows(args) {
        rows.push((topic, "published to received here", &meter.latency));
        if let Some(answer) = meter.answer.as_ref().filter(|answer| answer.count() > 0) {
            rows.push((topic, "scan to published", answer));
        }
    }
    if args.json {
        let rows: Vec<_> = rows
            .iter()
            .map(|(topic, what, times)| {
                let [p50, p99, p99_9, max] = times.microseconds();
                let us = json!({"p50": p50, "p99": p99, "p99_9": p99_9, "max": max});
                json!({
                    "topic": topic,
                    "what": what,
                    "messages": times.count(),
                    "us": (times.count() > 0).then_some(us),
                })
            })
            .collect();
        writeln!(out, "{}", serde_json::Value::from(rows))?;
        return Ok(());
    }
    writeln!(
        out,
        "{:<20} {:<17} {:>8} {:>7} {:>7} {:>7} {:>7}",
        "topic", "latency µs", "messages", "p50", "p99", "p99.9", "max"
    )?;
    for (topic, what, times) in rows {
        let what = if what.starts_with("scan") { what } else { "to received here" };
        write!(out, "{topic:<20} {what:<17} {:>8}", times.count())?;
        if times.count() == 0 {
            writeln!(out, " {:>7} {:>7} {:>7} {:>7}", "-", "-", "-", "-")?;
            continue;
        }
        let [p50, p99, p99_9, max] = times.microseconds();
        writeln!(out, " {p50:>7.0} {p99:>7.0} {p99_9:>7.0} {max:>7.0}")?;
    }
    writeln!(
        out,
        "to received here: from publishing to this probe, which polls every {} µs\n\
         scan to published: within the rig",
        DELAY_PERIOD_NS / 1000
    )?;
    Ok(())
}
