//! The status as text.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use ipc_types::{GateCause, ModelStatus, RingStatus, TripCause};
use launch::{RigState, Supervision};

use super::{LastTrip, ProcessStatus, ProtocolStatus, RigStatus, ScannerStatus, WatchdogStatus};

/// Returns the status as aligned text of at most `width` columns. The table of processes is 79
/// columns wide as long as no counter outgrows its column; longer sentences are wrapped.
pub fn table(status: &RigStatus, now: SystemTime, width: usize) -> String {
    if !status.up {
        return format!("rig {} is not up (farreach up)\n", status.rig_name);
    }
    let mut lines = vec![headline(status, now)];
    if let Some(profile) = status.profile {
        let backend = status.backend.map_or("unknown", |backend| backend.text());
        let session = status.session.as_deref().unwrap_or("unknown");
        lines.push(format!("profile   {profile}, card {backend}, session {session}"));
    }
    if let Some(stall) = &status.host_stall {
        lines.push(format!("stalls    {stall}, measured when the rig came up"));
    }
    lines.extend(placement_line(status));
    if let Some(unread) = &status.unread {
        lines.push(format!("topics    cannot be read: {unread}"));
    }
    match &status.watchdog {
        Some(watchdog) => lines.push(watchdog_line(watchdog, now)),
        None if status.unread.is_none() => lines.push("watchdog  SILENT".to_owned()),
        None => {}
    }
    if let Some(gate) = &status.gate {
        let cause = match gate.cause {
            GateCause::None => String::new(),
            cause => format!(", last closed by: {cause}"),
        };
        let power = if gate.motor_power { "ON" } else { "off" };
        lines.push(format!(
            "gate      {}, epoch {}{cause}, motor power {power}",
            gate.state, gate.epoch
        ));
        if gate.scans_missed > 0 {
            lines.push(format!(
                "card      {} scans MISSED since acquisition started",
                gate.scans_missed
            ));
        }
    }
    lines.extend(unhomed_line(&status.unhomed, rig::home_protocol(status.axes)));
    lines.extend(status.range_not_in_force.iter().map(|axis| range_line(*axis, &status.unhomed)));
    lines.extend(status.protocol.iter().flat_map(ProtocolStatus::lines));
    lines.extend(status.scanner.as_ref().map(ScannerStatus::line));
    lines.extend(status.model.iter().map(model_line));
    lines.extend(status.injected_faults.iter().map(|fault| format!("fault     INJECTED: {fault}")));
    if let Some(recording) = &status.recording {
        lines.push(match &recording.file {
            Some(file) => {
                format!("recording {file}, {} messages, {} lost", recording.written, recording.lost)
            }
            None => "recording off".to_owned(),
        });
        lines.extend(recording.ring.as_ref().map(ring_line));
        if !recording.error.is_empty() {
            lines.push(format!("          FAILED: {}", recording.error));
        }
    }
    for loss in &status.losses {
        lines.push(format!(
            "lost      {}: {} before the logger, {} in its full queue, {} on the disk",
            loss.topic, loss.gaps, loss.dropped, loss.refused
        ));
    }
    // The rows of the table are never wrapped.
    let head = "process|state|pid|up for|restarts|rate Hz|missed|p99 µs|age ms";
    let mut rows = row(head.split('|'));
    for process in &status.processes {
        rows += &row(cells(process, now).iter().map(String::as_str));
    }
    let mut remarks: Vec<String> = status.processes.iter().flat_map(remarks_on).collect();
    remarks.push(
        "missed: periods skipped; p99 µs: wake-up lateness; age: since the last message".to_owned(),
    );
    let options = textwrap::Options::new(width).subsequent_indent("          ").break_words(false);
    let wrap = |lines: &[String]| {
        lines.iter().map(|line| textwrap::fill(line, &options) + "\n").collect::<String>()
    };
    format!("{}\n{rows}{}", wrap(&lines), wrap(&remarks))
}

/// What is to be said of a process beside its row.
fn remarks_on(process: &ProcessStatus) -> Vec<String> {
    let mut remarks = Vec::new();
    if let (true, Some(exit)) = (process.restarts > 0, &process.last_exit) {
        remarks.push(format!("{}: its predecessor ended with {exit}", process.name));
    }
    if let Some(program) = &process.replaced_by {
        remarks.push(format!("{}: REPLACED by {program}", process.name));
    }
    if let Some(losses) = process.losses.filter(|losses| !losses.is_empty()) {
        remarks.push(format!("{}: since its start {losses}", process.name));
    }
    remarks
}

fn headline(status: &RigStatus, now: SystemTime) -> String {
    let mut line = format!("rig {}", status.rig_name);
    line += &match status.state {
        Some(state) => format!(" is {}", rig_state(state)),
        None => " is up, without farreach's launcher".to_owned(),
    };
    if status.supervision == Some(Supervision::Systemd) {
        line += ", under systemd";
    }
    if let Some(cause) = &status.cause {
        line += &format!(" ({cause})");
    }
    if let Some(launcher) = &status.launcher {
        let (pid, age) = (launcher.pid, age(launcher.since_unix_ms, now));
        line += &match launcher.alive {
            true => format!(", launcher {pid} for {age}"),
            false => format!(", launcher {pid} is DEAD: a process that ends is not restarted"),
        };
    }
    line
}

/// Tells which axes are not homed, and what to do.
fn unhomed_line(axes: &[usize], protocol: &str) -> Option<String> {
    let names: Vec<String> = axes.iter().map(usize::to_string).collect();
    let which = match &names[..] {
        [] => return None,
        [one] => format!("axis {one} is"),
        several => format!("axes {} are", several.join(", ")),
    };
    Some(format!(
        "homing    {which} NOT HOMED: positions count from power-up (farreach run {protocol})"
    ))
}

/// Tells that nothing holds the handle of an axis to its range of motion, and why.
fn range_line(axis: usize, unhomed: &[usize]) -> String {
    let why = if unhomed.contains(&axis) { "not homed" } else { "search for the stops" };
    format!("handle    range of motion not in force on axis {axis} ({why})")
}

/// Where the loops run, and which of them were refused their processor.
fn placement_line(status: &RigStatus) -> Option<String> {
    let of = |name: &str| status.processes.iter().find(|process| process.name == name);
    let words = status.placement.iter().map(|(name, number)| {
        let elsewhere = of(name).is_some_and(|process| {
            !process.processors.is_empty() && process.processors != [*number]
        });
        format!("{name} {number}{}", if elsewhere { " REFUSED" } else { "" })
    });
    let words: Vec<String> = words.collect();
    (!words.is_empty()).then(|| format!("placement processor of each loop: {}", words.join(", ")))
}

fn ring_line(ring: &RingStatus) -> String {
    let keep = Duration::from_nanos(ring.keep_ns);
    let (parts, bytes, removed) = (ring.parts.len(), ring.bytes, ring.removed);
    let mut line = format!("ring      {keep:?} in {parts} parts, {bytes} bytes, {removed} removed");
    if ring.not_removed > 0 {
        line += &format!(", {} COULD NOT BE REMOVED", ring.not_removed);
    }
    line
}

fn model_line(model: &ModelStatus) -> String {
    format!("model     {}", model.sentence())
}

fn watchdog_line(watchdog: &WatchdogStatus, now: SystemTime) -> String {
    let mut line = format!("watchdog  {}", watchdog.state);
    if watchdog.cause != TripCause::None {
        line += &format!(": {}", watchdog.cause);
    }
    line += &format!(", epoch {}", watchdog.epoch);
    let faults: Vec<_> = watchdog.faults.iter().map(|fault| fault.text()).collect();
    line += &match faults.is_empty() {
        true => ", no active fault".to_owned(),
        false => format!(", active faults: {}", faults.join(", ")),
    };
    if let Some(LastTrip { cause, unix_ms }) = watchdog.last_trip {
        line += &format!(", last trip: {cause}");
        if let Some(unix_ms) = unix_ms {
            let at = UNIX_EPOCH + Duration::from_millis(unix_ms);
            let at = humantime::format_rfc3339_seconds(at);
            line += &format!(", at {at} ({} ago)", age(unix_ms, now));
        }
    }
    line
}

/// One row; a cell that outgrows its column shifts the rest and never touches its neighbour.
fn row<'a>(cells: impl Iterator<Item = &'a str>) -> String {
    const WIDTHS: [usize; 9] = [11, 12, 7, 8, 8, 7, 6, 6, 6];
    let aligned = cells.zip(WIDTHS).enumerate().map(|(index, (cell, width))| match index {
        0 | 1 => format!("{cell:<width$}"),
        _ => format!("{cell:>width$}"),
    });
    aligned.collect::<Vec<_>>().join(" ") + "\n"
}

fn cells(process: &ProcessStatus, now: SystemTime) -> [String; 9] {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let count =
        |value: Option<u64>| value.map_or_else(|| "-".to_owned(), |value| value.to_string());
    [
        process.name.clone(),
        process.state.map_or("", unit_state).to_owned(),
        process.pid.map_or_else(|| "-".to_owned(), |pid| pid.to_string()),
        process.since_unix_ms.map_or_else(|| "-".to_owned(), |since| age(since, now)),
        process.restarts.to_string(),
        number(process.rate_hz.or(process.grid_hz), 1),
        count(process.missed_periods),
        number(process.wake_late_us.map(|late| late.p99), 0),
        number(process.heartbeat_age_ms, 0),
    ]
}

/// Time since then in its two largest units.
fn age(since_unix_ms: u64, now: SystemTime) -> String {
    let since = UNIX_EPOCH + Duration::from_millis(since_unix_ms);
    let seconds = now.duration_since(since).unwrap_or_default().as_secs();
    match seconds {
        0..60 => format!("{seconds} s"),
        60..3600 => format!("{}m {:02}s", seconds / 60, seconds % 60),
        3600..86400 => format!("{}h {:02}m", seconds / 3600, seconds % 3600 / 60),
        _ => format!("{}d {:02}h", seconds / 86400, seconds % 86400 / 3600),
    }
}

fn rig_state(state: RigState) -> &'static str {
    match state {
        RigState::Starting => "starting",
        RigState::Up => "up",
        RigState::Stopping => "stopping",
        RigState::Down => "down",
        RigState::Abandoned => "ABANDONED",
    }
}

fn unit_state(state: launch::UnitState) -> &'static str {
    use launch::UnitState as State;
    match state {
        State::Inactive => "inactive",
        State::Starting => "starting",
        State::Ready => "ready",
        State::Killing => "killing",
        State::BackOff => "back-off",
        State::Gated => "waiting",
        State::Stopping => "stopping",
        State::Failed => "FAILED",
        State::Unsupervised => "unsupervised",
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use ipc_types::{GateCause, GateState, WatchdogState};

    use super::super::GateStatus;
    use super::*;

    const NOW_MS: u64 = 1_000_000_000_000;

    fn now() -> SystemTime {
        UNIX_EPOCH + Duration::from_millis(NOW_MS)
    }

    #[test]
    fn ages_are_short() {
        let of = |seconds: u64| age(NOW_MS - seconds * 1000, now());
        assert_eq!(
            [of(0), of(59), of(61), of(7260), of(90_000)],
            ["0 s", "59 s", "1m 01s", "2h 01m", "1d 01h"]
        );
        assert_eq!(age(u64::MAX / 2_000_000, now()), "0 s");
    }

    fn status() -> RigStatus {
        let process = |name: &str, minutes: u64| ProcessStatus {
            name: name.to_owned(),
            state: Some(launch::UnitState::Unsupervised),
            pid: Some(4_194_304),
            since_unix_ms: Some(NOW_MS - minutes * 60_000 - 59_000),
            restarts: 17,
            rate_hz: Some(2000.0),
            missed_periods: Some(123_456),
            wake_late_us: Some([8_765_400; 4].into()),
            heartbeat_age_ms: Some(1234.5),
            ..ProcessStatus::default()
        };
        RigStatus {
            rig_name: "bench".to_owned(),
            up: true,
            state: Some(RigState::Up),
            watchdog: Some(WatchdogStatus {
                state: WatchdogState::Armed,
                cause: TripCause::None,
                faults: vec![],
                epoch: 3,
                enabled: false,
                last_trip: Some(LastTrip {
                    cause: TripCause::AcquisitionLost,
                    unix_ms: Some(NOW_MS - 61_000),
                }),
            }),
            processes: vec![process("acquisition", 59), process("experiment", 12 * 60)],
            ..RigStatus::default()
        }
    }

    #[test]
    fn a_gate_that_latched_keeps_its_name_in_json() {
        let mut status = status();
        let gate = GateStatus {
            state: GateState::LatchedClosed,
            cause: GateCause::TokenStale,
            epoch: 3,
            motor_power: false,
            scans_missed: 0,
            cycles_missed: 0,
        };
        status.gate = Some(gate);
        if let Some(watchdog) = &mut status.watchdog {
            watchdog.cause = TripCause::GateLatched;
        }
        let json = serde_json::to_value(&status).unwrap();
        assert_eq!(json["gate"]["state"], "burnt");
        assert_eq!(json["watchdog"]["cause"], "gate_burnt");
    }

    #[test]
    fn columns_stay_apart_and_fit_80_columns_after_hours() {
        let text = table(&status(), now(), 80);
        assert_eq!(text.lines().find(|line| line.chars().count() > 80), None, "{text}");
        let row = |name| text.lines().find(|line| line.starts_with(name)).unwrap();
        let age =
            ["acquisition unsupervised 4194304", " 59m 59s", "17", "2000.0", "123456", "8765"];
        for part in age {
            assert!(row("acquisition").contains(part), "{part}: {text}");
        }
        let cells: Vec<_> = row("experiment").split_whitespace().collect();
        assert_eq!(cells[2..5], ["4194304", "12h", "00m"], "{text}");
        // Every column ends where its heading ends.
        let ends = |line: &str| line.trim_end().chars().count();
        assert_eq!(ends(row("process")), ends(row("acquisition")), "{text}");
    }

    #[test]
    fn the_placement_is_shown_and_what_was_refused() {
        let mut status = status();
        assert!(!table(&status, now(), usize::MAX).contains("placement"));
        status.placement = [("acquisition".to_owned(), 1), ("control".to_owned(), 0)].into();
        status.processes[0].processors = vec![0, 1];
        let text = table(&status, now(), usize::MAX);
        let line = "placement processor of each loop: acquisition 1 REFUSED, control 0\n";
        assert!(text.contains(line), "{text}");
        status.processes[0].processors = vec![1];
        assert!(!table(&status, now(), usize::MAX).contains("REFUSED"));
    }

    #[test]
    fn a_range_of_motion_that_is_not_in_force_is_shown_with_the_reason() {
        let mut status = status();
        assert!(!table(&status, now(), usize::MAX).contains("range of motion"));
        (status.axes, status.unhomed, status.range_not_in_force) = (2, vec![1], vec![0, 1]);
        let text = table(&status, now(), 80);
        for line in [
            "handle    range of motion not in force on axis 0 (search for the stops)\n",
            "handle    range of motion not in force on axis 1 (not homed)\n",
        ] {
            assert!(text.contains(line), "{text}");
        }
    }

    #[test]
    fn an_earlier_trip_is_shown_as_the_last_one_with_its_time() {
        let text = table(&status(), now(), usize::MAX);
        let expected = "watchdog  armed, epoch 3, no active fault, last trip: acquisition lost, at \
                        2001-09-09T01:45:39Z (1m 01s ago)\n";
        assert!(text.contains(expected), "{text}");
    }
}
