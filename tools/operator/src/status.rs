//! What a rig is doing: the launcher's word on its processes, and what these say on their topics.
//! Read only.

mod observe;
mod table;

use ipc_types::{
    Backend, GateCause, GateState, LoggerRequest, Profile, TOPICS, TripCause, WatchdogState,
};
use launch::{RigState, UnitState};
use runtime::{DomainError, Losses, RigName};
use serde::Serialize;

use crate::{Error, RigLink};
pub use observe::{Observation, Observer};
pub use table::table;

/// A rig, as `status --json` prints it. Keys stay; new ones may come.
#[derive(Clone, Debug, Serialize)]
pub struct RigStatus {
    /// Its name.
    pub rig_name: String,
    /// Whether anything of it runs.
    pub up: bool,
    /// State of the whole; `null` where no launcher of ours looks after it.
    pub state: Option<RigState>,
    /// Why it is stopping or broken off.
    pub cause: Option<String>,
    /// The launcher.
    pub launcher: Option<LauncherStatus>,
    /// Why the topics could not be read; `null` if they could.
    pub unread: Option<String>,
    /// Session, as 16 hexadecimal digits.
    pub session: Option<String>,
    /// Timing that the machine grants.
    pub profile: Option<Profile>,
    /// What stands behind acquisition.
    pub backend: Option<Backend>,
    /// Interlocks.
    pub watchdog: Option<WatchdogStatus>,
    /// The gate, and what the card counts.
    pub gate: Option<GateStatus>,
    /// One for each process.
    pub processes: Vec<ProcessStatus>,
    /// The logger.
    pub recording: Option<RecordingStatus>,
    /// Topics of which messages were lost on the way to the disk since the logger started; empty is
    /// good.
    pub losses: Vec<TopicLoss>,
}

/// The launcher.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LauncherStatus {
    /// Its process.
    pub pid: i32,
    /// Whether it lives.
    pub alive: bool,
    /// When it started (ms since 1970, UTC).
    pub since_unix_ms: u64,
}

/// Interlocks.
#[derive(Clone, Debug, Serialize)]
pub struct WatchdogStatus {
    /// State.
    pub state: WatchdogState,
    /// Cause of the last fault or trip.
    pub cause: TripCause,
    /// Faults that stand now.
    pub faults: Vec<TripCause>,
    /// Enable epoch.
    pub epoch: u64,
    /// Whether the motor may be powered.
    pub enabled: bool,
}

/// The gate.
#[derive(Clone, Debug, Serialize)]
pub struct GateStatus {
    /// State.
    pub state: GateState,
    /// Why it burnt the last epoch.
    pub cause: GateCause,
    /// The epoch that it last saw.
    pub epoch: u64,
    /// Whether the card reports motor power.
    pub motor_power: bool,
    /// Scans that the card dropped since acquisition started.
    pub scans_missed: u64,
    /// Cycles that acquisition skipped since it started.
    pub cycles_missed: u64,
}

/// One process.
#[derive(Clone, Debug, Serialize)]
pub struct ProcessStatus {
    /// Name.
    pub name: String,
    /// State; `null` where no launcher of ours looks after it.
    pub state: Option<UnitState>,
    /// Process id.
    pub pid: Option<i32>,
    /// When it came into this state (ms since 1970, UTC).
    pub since_unix_ms: Option<u64>,
    /// Starts after the first.
    pub restarts: u32,
    /// How the process before this one ended.
    pub last_exit: Option<String>,
    /// Messages that it published a second, measured (fast loops).
    pub rate_hz: Option<f64>,
    /// Rate of its grid (Hz).
    pub grid_hz: Option<f64>,
    /// Cycles since its start.
    pub cycles: Option<u64>,
    /// Periods skipped since its start because it woke late.
    pub missed_periods: Option<u64>,
    /// How late it woke since its start (µs).
    pub wake_late_us: Option<Percentiles>,
    /// How long a cycle took since its start (µs).
    pub execution_us: Option<Percentiles>,
    /// Timing that it was granted.
    pub profile: Option<Profile>,
    /// Age of its last sign of life (ms).
    pub heartbeat_age_ms: Option<f64>,
    /// Messages lost on the way to it (slow processes).
    pub lost: Option<u64>,
    /// Messages waiting in its own queue (slow processes).
    pub queued: Option<u64>,
    /// What it missed, refused or could not hand on since its start (periodic processes).
    pub losses: Option<Losses>,
    /// Its log file.
    pub log: Option<String>,
}

/// Percentiles (µs).
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Percentiles {
    pub p50: f64,
    pub p99: f64,
    pub p99_9: f64,
    pub max: f64,
}

impl From<[u64; 4]> for Percentiles {
    fn from(ns: [u64; 4]) -> Self {
        let [p50, p99, p99_9, max] = ns.map(|ns| ns as f64 / 1e3);
        Self { p50, p99, p99_9, max }
    }
}

/// The logger.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingStatus {
    /// The file; `null` where nothing is recorded.
    pub file: Option<String>,
    /// Messages written to it.
    pub written: u64,
    /// Messages lost on the way.
    pub lost: u64,
    /// What went wrong; empty if nothing.
    pub error: String,
}

/// What was lost of one topic.
#[derive(Clone, Debug, Serialize)]
pub struct TopicLoss {
    /// The topic.
    pub topic: String,
    /// Messages that never reached the logger.
    pub gaps: u64,
    /// Messages dropped because the logger's queue was full.
    pub dropped: u64,
    /// Messages that the disk refused.
    pub refused: u64,
}

/// Looks at a rig again and again.
#[derive(Default)]
pub struct Watcher {
    joined: Option<(RigLink, Observer)>,
}

impl Watcher {
    /// Looks at a rig, joining it where that was not done yet or where it began a new session.
    /// Takes 0.3 s to 1.2 s.
    ///
    /// # Errors
    /// When the launcher's files cannot be read. A rig that is down is no error.
    pub fn look(&mut self, name: &RigName) -> Result<RigStatus, Error> {
        let launched = match launch::status(&name.run_directory()) {
            Ok(status) => Some(status),
            Err(launch::Error::NotUp { .. }) => None,
            Err(error) => return Err(error.into()),
        };
        let mut status = RigStatus::of(name, launched.as_ref());
        match self.observe(name) {
            Ok((observation, recording)) => {
                status.up = true;
                status.add(&observation, recording);
            }
            Err(Error::Domain(DomainError::NoKeeper(_))) if launched.is_none() => {}
            Err(error) => {
                self.joined = None;
                status.unread = Some(error.to_string());
            }
        }
        Ok(status)
    }

    fn observe(&mut self, name: &RigName) -> Result<(Observation, Option<RecordingStatus>), Error> {
        if self.joined.as_ref().is_some_and(|(link, _)| !link.domain().keeper_lives()) {
            self.joined = None;
        }
        if self.joined.is_none() {
            let link = RigLink::open(name)?;
            let observer = Observer::new(&link)?;
            self.joined = Some((link, observer));
        }
        let Some((link, observer)) = &mut self.joined else {
            return Err(Error::NotUp(name.to_string()));
        };
        let observation = observer.observe(link.domain())?;
        // A logger that does not answer shows in the row of its process.
        let recording = link.logger(&LoggerRequest::Status).ok().map(|answer| RecordingStatus {
            file: answer.recording,
            written: answer.written,
            lost: answer.lost,
            error: answer.error,
        });
        Ok((observation, recording))
    }
}

/// Looks at a rig once.
///
/// # Errors
/// As [`Watcher::look`].
pub fn status(name: &RigName) -> Result<RigStatus, Error> {
    Watcher::default().look(name)
}

impl RigStatus {
    fn of(name: &RigName, launched: Option<&launch::Status>) -> Self {
        let processes = launched.map_or_else(Vec::new, |status| {
            status
                .units
                .iter()
                .map(|unit| ProcessStatus {
                    state: Some(unit.state),
                    pid: unit.process.map(|process| process.pid),
                    since_unix_ms: Some(unit.since_unix_ms),
                    restarts: unit.restarts,
                    last_exit: unit.last_exit.clone(),
                    log: Some(unit.log.display().to_string()),
                    ..ProcessStatus::named(&unit.name)
                })
                .collect()
        });
        Self {
            rig_name: name.to_string(),
            up: launched.is_some(),
            state: launched.map(|status| status.state),
            cause: launched.and_then(|status| status.cause.clone()),
            launcher: launched.map(|status| LauncherStatus {
                pid: status.launcher.pid,
                alive: status.launcher.is_alive(),
                since_unix_ms: status.since_unix_ms,
            }),
            unread: None,
            session: None,
            profile: None,
            backend: None,
            watchdog: None,
            gate: None,
            processes,
            recording: None,
            losses: Vec::new(),
        }
    }

    fn add(&mut self, seen: &Observation, recording: Option<RecordingStatus>) {
        self.session = Some(format!("{:016x}", seen.session));
        self.profile = Some(seen.profile);
        self.recording = recording;
        if let Some(token) = &seen.token {
            self.watchdog = Some(WatchdogStatus {
                state: WatchdogState::from_code(token.state).unwrap_or(WatchdogState::Faulted),
                cause: TripCause::from_code(token.cause).unwrap_or(TripCause::None),
                faults: standing(token.faults),
                epoch: token.epoch,
                enabled: token.enabled != 0,
            });
        }
        if let Some(sample) = &seen.sample {
            self.backend = Backend::from_code(sample.backend);
            self.gate = Some(GateStatus {
                state: GateState::from_code(sample.gate_state).unwrap_or(GateState::Closed),
                cause: GateCause::from_code(sample.gate_cause).unwrap_or(GateCause::None),
                epoch: sample.epoch,
                motor_power: sample.motor_power != 0,
                scans_missed: sample.scans_missed,
                cycles_missed: sample.cycles_missed,
            });
        }
        for (process, rate_hz) in &seen.rates {
            self.row(process.text()).rate_hz = Some(*rate_hz);
        }
        for timing in &seen.timings {
            let Some(process) = ipc_types::Process::from_code(timing.source) else { continue };
            let row = self.row(process.text());
            // The last word of a process that died meanwhile is not the word of the one that
            // replaced it.
            if row.pid.is_some_and(|pid| i64::from(pid) != i64::from(timing.pid)) {
                continue;
            }
            row.pid = i32::try_from(timing.pid).ok();
            row.grid_hz = (timing.period_ns > 0).then(|| 1e9 / timing.period_ns as f64);
            row.cycles = Some(timing.cycles);
            row.missed_periods = Some(timing.missed_periods);
            row.wake_late_us = Some(timing.total_wake_late_ns.into());
            row.execution_us = Some(timing.total_execution_ns.into());
            row.profile = Profile::from_code(timing.profile);
            row.heartbeat_age_ms = Some(seen.age_ms(timing.time_ns));
            row.losses = Some(Losses::told_by(timing));
        }
        for beat in &seen.heartbeats {
            let Some(process) = ipc_types::Process::from_code(beat.source) else { continue };
            let row = self.row(process.text());
            row.pid = row.pid.or(i32::try_from(beat.pid).ok());
            row.profile = row.profile.or(Profile::from_code(beat.profile));
            row.heartbeat_age_ms = Some(seen.age_ms(beat.time_ns));
            row.lost = Some(beat.lost);
            row.queued = Some(beat.queued);
        }
        for (process, time_ns) in &seen.last_words {
            let age = seen.age_ms(*time_ns);
            self.row(process.text()).heartbeat_age_ms = Some(age);
        }
        for loss in &seen.losses {
            if loss.gaps + loss.dropped + loss.refused > 0 {
                let topic = usize::try_from(loss.topic).ok().and_then(|index| TOPICS.get(index));
                self.losses.push(TopicLoss {
                    topic: topic.map_or_else(
                        || format!("topic {}", loss.topic),
                        |topic| topic.name.to_owned(),
                    ),
                    gaps: loss.gaps,
                    dropped: loss.dropped,
                    refused: loss.refused,
                });
            }
        }
    }

    /// The row of a process; a new one where the launcher knows none (systemd has its own).
    fn row(&mut self, name: &str) -> &mut ProcessStatus {
        let index = match self.processes.iter().position(|process| process.name == name) {
            Some(index) => index,
            None => {
                self.processes.push(ProcessStatus::named(name));
                self.processes.len() - 1
            }
        };
        &mut self.processes[index]
    }
}

impl ProcessStatus {
    fn named(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            state: None,
            pid: None,
            since_unix_ms: None,
            restarts: 0,
            last_exit: None,
            rate_hz: None,
            grid_hz: None,
            cycles: None,
            missed_periods: None,
            wake_late_us: None,
            execution_us: None,
            profile: None,
            heartbeat_age_ms: None,
            lost: None,
            queued: None,
            losses: None,
            log: None,
        }
    }
}

/// The causes in a token's `faults`: one bit for each code.
pub(crate) fn standing(faults: u64) -> Vec<TripCause> {
    TripCause::ALL.iter().copied().filter(|cause| faults & (1 << cause.code()) != 0).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn the_bits_of_a_token_are_causes() {
        let bits = 1 << TripCause::ControlLost.code() | 1 << TripCause::SpeedLimit.code();
        assert_eq!(standing(bits), [TripCause::ControlLost, TripCause::SpeedLimit]);
        assert!(standing(0).is_empty());
    }

    #[test]
    fn a_rig_that_never_was_is_down() {
        let name: RigName = format!("none-{}", std::process::id()).parse().unwrap();
        let status = status(&name).unwrap();
        assert!(!status.up && status.processes.is_empty() && status.unread.is_none());
    }
}
