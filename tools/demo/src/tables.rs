//! The page's tables of timing and losses, and the list of events.

use ipc_types::{EventKind, Process, TripCause};
use report::{Page, Table};

use crate::Summary;
use crate::analysis::{Analysis, Percentiles, Trace};

/// Milliseconds for a table cell; a dash where there is no value.
fn ms(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |ms| format!("{ms:.1}"))
}

/// The recorded events, one per line.
pub(crate) fn events(trace: &Trace) -> String {
    let line = |event: &ipc_types::Event| {
        let source = Process::from_code(event.source).map_or("unknown", Process::text);
        let kind = EventKind::from_code(event.kind).map_or("unknown", EventKind::text);
        format!("{:9.3} s  {source:<12} {kind:<20} {}", trace.seconds(event.time_ns), event.text())
    };
    trace.events.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// The sections on timing and on the recording.
pub(crate) fn tables(page: Page, analysis: &Analysis, summary: &Summary) -> Page {
    let head = "killed | V before | 0 V / ms | tripped / ms | back / ms | enabled / ms | \
        voltage again / ms";
    let kills = Table::new(head.split(" | ")).rows(analysis.outages.iter().map(|outage| {
        [
            outage.kill.process.to_string(),
            format!("{:.2}", outage.volts_before),
            ms(outage.trip_ms),
            ms(outage.tripped_ms),
            ms(outage.restart_ms),
            ms(outage.enabled_ms),
            ms(outage.powered_ms),
        ]
    }));
    let trips = Table::new(["time / s", "cause"]).rows(analysis.unprovoked.iter().map(|trip| {
        let cause = TripCause::from_code(trip.cause).unwrap_or(TripCause::None);
        [format!("{:.3}", analysis.trace.seconds(trip.time_ns)), cause.to_string()]
    }));
    let row = |name: String, p: &Percentiles, missed: Option<u64>| {
        let us = |value: f64| format!("{value:.0}");
        let missed = missed.map_or("–".to_owned(), |count| count.to_string());
        [name, us(p.p50), us(p.p99), us(p.p99_9), us(p.max), missed]
    };
    let loops = summary.wake_late_us.by_process.iter().map(|(process, late)| {
        let missed = summary.missed_periods.get(process).copied();
        row(format!("{process}: wake-up latency"), late, missed)
    });
    let head = " | p50 / µs | p99 / µs | p99.9 / µs | max / µs | missed periods";
    let timing = Table::new(head.split(" | ")).rows(loops).row(row(
        "sample to command".to_owned(),
        &summary.sample_to_command_us,
        None,
    ));
    let rates = analysis.timing.command_rates.iter().enumerate().map(|(index, rate)| {
        [format!("{} ({:016x})", index + 1, rate.incarnation), format!("{:.3}", rate.hz)]
    });
    let rates = Table::new(["incarnation of control", "commands / Hz"]).rows(rates);
    let topics = analysis.losses.topics.iter();
    let disk = Table::new(["topic", "on disk", "lost"])
        .rows(topics.map(|of| [of.topic.clone(), of.written.to_string(), of.lost.to_string()]));
    let mut page = page.heading("Timing").table(
        kills,
        "Times after each kill in ms, from the card's scans, the watchdog's tokens and the topic \
            of the killed process.",
    );
    if !analysis.unprovoked.is_empty() {
        page = page.table(trips, "Trips that no kill explains.");
    }
    page.table(
        timing,
        "Wake-up latency of each loop since its start (the worse of two runs), and the time from a \
            scan of the card to the first command computed from it.",
    )
    .table(rates, "Rate of the control loop by incarnation, without downtime.")
    .heading("Recording")
    .paragraph(&format!(
        "{} samples, {} lost before they were written, {} ticks never acquired; {:.1} MB. While \
            acquisition was dead, the card's FIFO kept the scans for the restarted process.",
        summary.samples,
        summary.samples_lost,
        summary.samples_missed,
        summary.recording_bytes as f64 * 1e-6
    ))
    .table(disk, "Messages by topic.")
}
