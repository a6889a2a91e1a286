//! `hz` and `delay`.

use std::io::Write;

use anyhow::bail;
use runtime::RigName;
use runtime::clock::{MILLISECOND_NS, SECOND_NS, now_ns};
use serde_json::json;

use crate::args::RateArgs;
use crate::attach;
use crate::meter::{Meter, Times};
use crate::source;
use crate::stream::{Progress, Source, Stream};

/// Polling period of `hz`, which reads the publishers' own times (ns).
const HZ_PERIOD_NS: u64 = 10 * MILLISECOND_NS;
/// Polling period of `delay`, and its resolution (ns).
const DELAY_PERIOD_NS: u64 = 100_000;
/// Duration of a measurement on a running rig (s).
const DURATION_S: f64 = 5.0;

/// One topic, measured.
struct Measured {
    topic: String,
    meter: Meter,
    lost: u64,
    /// messages a second; `None` where they are too few to tell
    rate_hz: Option<f64>,
}

/// Measures all topics of a source; returns those with messages, and those named on the command
/// line even if silent.
fn measure(args: &RateArgs, source: &mut dyn Source) -> anyhow::Result<Vec<Measured>> {
    let mut meters = source.streams().iter().map(Meter::new).collect::<Result<Vec<_>, _>>()?;
    let begun_ns = source.since_ns();
    let seconds = match (args.seconds, &args.file) {
        (None, None) => Some(DURATION_S),
        (seconds, _) => seconds,
    };
    let duration_ns = seconds.map(attach::ns);
    // A recording has a time of its own, from its first message on.
    let mut first_ns = None;
    let live = args.file.is_none();
    let end_ns = match duration_ns {
        Some(duration_ns) if live => begun_ns.saturating_add(duration_ns),
        _ => u64::MAX,
    };
    let mut ended = false;
    while !ended && (!live || now_ns() < end_ns) {
        let progress = source.read(end_ns, &mut |message| {
            let at_ns = message.stamp.ns();
            let first_ns = *first_ns.get_or_insert(at_ns);
            let late = |duration_ns| !live && at_ns.saturating_sub(first_ns) >= duration_ns;
            // Messages from before the measurement do not count.
            let early = message.sent.time_ns < begun_ns;
            if let Some(meter) = meters.get_mut(message.stream)
                && !early
                && !duration_ns.is_some_and(late)
            {
                meter.observe(message);
            }
        })?;
        ended = match (progress, duration_ns, first_ns) {
            (Progress::Ended, ..) => true,
            (Progress::UpTo(now_ns), Some(duration_ns), Some(first_ns)) if !live => {
                now_ns.saturating_sub(first_ns) >= duration_ns
            }
            _ => false,
        };
    }
    let measured_s = (now_ns().saturating_sub(begun_ns)) as f64 / SECOND_NS as f64;
    let rate_hz = |meter: &Meter| match live {
        true => Some(meter.count as f64 / measured_s),
        false => meter.rate_hz(),
    };
    let named = !args.topics.is_empty();
    let all = source.streams().iter().zip(meters).map(|(stream, meter)| Measured {
        topic: stream.name.clone(),
        lost: stream.lost(),
        rate_hz: rate_hz(&meter),
        meter,
    });
    Ok(all.filter(|row| row.meter.count > 0 || named).collect())
}

pub(crate) fn hz(args: &RateArgs, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<i32> {
    source::observe(args.file.as_deref(), rig, &args.topics, HZ_PERIOD_NS, |source| {
        let rows = measure(args, source)?;
        match args.json {
            true => rates_json(&rows, out)?,
            false => rates_table(&rows, out)?,
        }
        Ok(source.exit_code())
    })
}

fn rates_json(rows: &[Measured], out: &mut dyn Write) -> anyhow::Result<()> {
    let rows: Vec<_> = rows
        .iter()
        .map(|row| {
            json!({
                "topic": row.topic,
                "rate_hz": row.rate_hz,
                "messages": row.meter.count,
                "lost": row.lost,
                "interval_ms": row.meter.intervals(),
            })
        })
        .collect();
    writeln!(out, "{}", serde_json::Value::from(rows))?;
    Ok(())
}

fn rates_table(rows: &[Measured], out: &mut dyn Write) -> anyhow::Result<()> {
    writeln!(
        out,
        "{:<20} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8} {:>5}",
        "topic", "rate Hz", "mean ms", "min", "max", "std", "messages", "lost"
    )?;
    for row in rows {
        let rate = row.rate_hz.map_or_else(|| "-".to_owned(), |hertz| format!("{hertz:.1}"));
        let intervals = row.meter.intervals().map_or_else(
            || format!("{:>8} {:>8} {:>8} {:>8}", "-", "-", "-", "-"),
            |i| format!("{:>8.3} {:>8.3} {:>8.3} {:>8.3}", i.mean, i.min, i.max, i.std),
        );
        let (topic, messages, lost) = (&row.topic, row.meter.count, row.lost);
        writeln!(out, "{topic:<20} {rate:>7} {intervals} {messages:>8} {lost:>5}")?;
    }
    Ok(())
}

/// A row of `delay`: topic, what was measured, how long it took.
type Delay<'a> = (&'a str, &'static str, &'a Times);

pub(crate) fn delay(args: &RateArgs, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<i32> {
    let (file, topics) = (args.file.as_deref(), args.topics.as_slice());
    source::observe(file, rig, topics, DELAY_PERIOD_NS, |source| {
        if args.file.is_some() {
            check_recorded(source, !topics.is_empty())?;
        }
        let measured = measure(args, source)?;
        let mut rows: Vec<Delay<'_>> = Vec::new();
        for Measured { topic, meter, .. } in &measured {
            if args.file.is_none() {
                rows.push((topic.as_str(), "published to received here", &meter.latency));
            }
            let answer = meter.answer.as_ref();
            if let Some(answer) = answer.filter(|answer| answer.count() > 0) {
                rows.push((topic.as_str(), "scan to published", answer));
            }
        }
        match args.json {
            true => delays_json(&rows, out)?,
            false => delays_table(&rows, args.file.is_none(), out)?,
        }
        Ok(source.exit_code())
    })
}

/// A recording knows the scan that some messages answer, and nobody who received them.
fn check_recorded(source: &dyn Source, named: bool) -> anyhow::Result<()> {
    let answers = |stream: &&Stream| {
        stream.field("scan_time_ns").is_some() || stream.field("sample_time_ns").is_some()
    };
    let unable = source.streams().iter().find(|stream| !answers(stream));
    let any = source.streams().iter().any(|stream| answers(&stream));
    let what = match (named, unable, any) {
        (true, Some(stream), _) => format!("topic {} does not name the scan", stream.name),
        (false, _, false) => "none of its topics names the scan".to_owned(),
        _ => return Ok(()),
    };
    bail!(
        "{what} that it answers: of a recording, only the time from a scan to publishing can be \
         measured (topics with scan_time_ns or sample_time_ns, such as sample and command); when a \
         probe receives a message is measured on a rig that is up"
    )
}

fn delays_json(rows: &[Delay<'_>], out: &mut dyn Write) -> anyhow::Result<()> {
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
    Ok(())
}

fn delays_table(rows: &[Delay<'_>], live: bool, out: &mut dyn Write) -> anyhow::Result<()> {
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
    if live {
        let polled_us = DELAY_PERIOD_NS / 1000;
        writeln!(
            out,
            "to received here: from publishing to this probe, which polls every {polled_us} µs"
        )?;
    }
    writeln!(out, "scan to published: within the rig")?;
    Ok(())
}
