//! The status for people.

use std::fmt::Write;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use ipc_types::GateCause;
use launch::RigState;

use super::{ProcessStatus, RigStatus};

/// The status as aligned text, at this time.
pub fn table(status: &RigStatus, now: SystemTime) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _written = write(&mut text, status, now);
    text
}

fn write(out: &mut String, status: &RigStatus, now: SystemTime) -> std::fmt::Result {
    if !status.up {
        return writeln!(out, "rig {} is not up (farreach up)", status.rig_name);
    }
    write!(out, "rig {}", status.rig_name)?;
    match status.state {
        Some(state) => write!(out, " is {}", rig_state(state))?,
        None => write!(out, " is up, without a launcher of farreach's")?,
    }
    if let Some(cause) = &status.cause {
        write!(out, " ({cause})")?;
    }
    if let Some(launcher) = &status.launcher {
        let since = age(launcher.since_unix_ms, now);
        match launcher.alive {
            true => write!(out, ", launcher {} for {since}", launcher.pid)?,
            false => {
                write!(out, ", launcher {} is DEAD: what dies is not started again", launcher.pid)?
            }
        }
    }
    writeln!(out)?;
    if let Some(profile) = status.profile {
        let backend = status.backend.map_or("no card heard", |backend| backend.text());
        writeln!(
            out,
            "profile   {profile}, card {backend}, session {}",
            status.session.as_deref().unwrap_or("?")
        )?;
    }
    if let Some(unread) = &status.unread {
        writeln!(out, "topics    cannot be read: {unread}")?;
    }
    match &status.watchdog {
        Some(watchdog) => {
            write!(
                out,
                "watchdog  {}, epoch {}, cause {}",
                watchdog.state, watchdog.epoch, watchdog.cause
            )?;
            let faults: Vec<_> = watchdog.faults.iter().map(|fault| fault.text()).collect();
            match faults.is_empty() {
                true => writeln!(out, ", no fault stands")?,
                false => writeln!(out, ", standing: {}", faults.join(", "))?,
            }
        }
        None if status.unread.is_none() => writeln!(out, "watchdog  says NOTHING")?,
        None => {}
    }
    if let Some(gate) = &status.gate {
        write!(out, "gate      {}, epoch {}", gate.state, gate.epoch)?;
        if gate.cause != GateCause::None {
            write!(out, ", last burnt by: {}", gate.cause)?;
        }
        writeln!(out, ", motor power {}", if gate.motor_power { "ON" } else { "off" })?;
        if gate.scans_missed > 0 {
            writeln!(
                out,
                "card      {} scans MISSED since acquisition started",
                gate.scans_missed
            )?;
        }
    }
    if let Some(recording) = &status.recording {
        match &recording.file {
            Some(file) => {
                writeln!(
                    out,
                    "recording {file}, {} messages, {} lost",
                    recording.written, recording.lost
                )?;
            }
            None => writeln!(out, "recording off")?,
        }
        if !recording.error.is_empty() {
            writeln!(out, "          FAILED: {}", recording.error)?;
        }
    }
    for loss in &status.losses {
        writeln!(
            out,
            "lost      {}: {} on the way, {} for a full queue, {} refused by the disk",
            loss.topic, loss.gaps, loss.dropped, loss.refused
        )?;
    }
    writeln!(
        out,
        "\n{:<12}{:<13}{:>8}{:>10}{:>9}{:>10}{:>9}{:>13}{:>12}",
        "process", "state", "pid", "for", "restarts", "rate Hz", "late", "late p99 µs", "heard ms"
    )?;
    for process in &status.processes {
        row(out, process, now)?;
    }
    for process in &status.processes {
        if let (true, Some(exit)) = (process.restarts > 0, &process.last_exit) {
            writeln!(out, "{}: the one before ended with {exit}", process.name)?;
        }
    }
    for process in &status.processes {
        if let Some(losses) = process.losses.filter(|losses| !losses.is_empty()) {
            writeln!(out, "{}: since its start {losses}", process.name)?;
        }
    }
    Ok(())
}

fn row(out: &mut String, process: &ProcessStatus, now: SystemTime) -> std::fmt::Result {
    let absent = || "-".to_owned();
    let number =
        |value: Option<f64>, digits| value.map_or_else(absent, |value| format!("{value:.digits$}"));
    writeln!(
        out,
        "{:<12}{:<13}{:>8}{:>10}{:>9}{:>10}{:>9}{:>13}{:>12}",
        process.name,
        process.state.map_or("", |state| unit_state(state)),
        process.pid.map_or_else(absent, |pid| pid.to_string()),
        process.since_unix_ms.map_or_else(absent, |since| age(since, now)),
        process.restarts,
        number(process.rate_hz.or(process.grid_hz), 1),
        process.missed_periods.map_or_else(absent, |missed| missed.to_string()),
        number(process.wake_late_us.map(|late| late.p99), 1),
        number(process.heartbeat_age_ms, 1),
    )
}

fn age(since_unix_ms: u64, now: SystemTime) -> String {
    let since = UNIX_EPOCH + Duration::from_millis(since_unix_ms);
    let seconds = now.duration_since(since).unwrap_or_default().as_secs();
    match seconds {
        0..60 => format!("{seconds} s"),
        60..3600 => format!("{} min {} s", seconds / 60, seconds % 60),
        3600..86400 => format!("{} h {} min", seconds / 3600, seconds % 3600 / 60),
        _ => format!("{} d {} h", seconds / 86400, seconds % 86400 / 3600),
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
    use super::*;

    #[test]
    fn ages_read_well() {
        let now = UNIX_EPOCH + Duration::from_secs(1_000_000);
        let of = |seconds: u64| age((1_000_000 - seconds) * 1000, now);
        assert_eq!(
            [of(0), of(59), of(61), of(7260), of(90_000)],
            ["0 s", "59 s", "1 min 1 s", "2 h 1 min", "1 d 1 h"]
        );
        assert_eq!(age(u64::MAX / 2_000_000, now), "0 s");
    }
}
