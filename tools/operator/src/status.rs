//! State of a rig: the launcher's view of its processes, and what these publish. Read only.

mod model;
mod observe;
mod percentiles;
mod protocol;
mod scanner;
mod table;

use std::collections::BTreeMap;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use ipc_types::{
    AXES, CardKind, EnableToken, ExperimentRequest, GateCause, GateState, InjectedFault,
    LoggerRequest, ModelStatus, Process, Profile, RingStatus, ScanProgress, SimulatorRequest,
    TOPICS, TripCause, WatchdogState,
};
use launch::{RigState, Supervision, UnitState};
use runtime::{DomainError, HostStall, Losses, RigName};
use serde::Serialize;

use self::observe::Observer;
use crate::{Error, RigLink};
pub use percentiles::Percentiles;
pub use protocol::ProtocolStatus;
pub use scanner::ScannerStatus;
pub use table::table;

/// A rig, as `status --json` prints it. Keys are stable; new ones may be added.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RigStatus {
    /// Name of the rig.
    pub rig_name: String,
    /// Whether any process of it runs.
    pub up: bool,
    /// State of the whole rig; `null` if nobody supervises it.
    pub state: Option<RigState>,
    /// Who supervises it; `null` if that is not known.
    pub supervision: Option<Supervision>,
    /// Why the rig is stopping or its start was aborted, or why systemd cannot be asked.
    pub cause: Option<String>,
    /// farreach's launcher; `null` without it.
    pub launcher: Option<LauncherStatus>,
    /// Why the topics could not be read; `null` if they could.
    pub unread: Option<String>,
    /// Session, as 16 hexadecimal digits.
    pub session: Option<String>,
    /// Timing profile of the rig.
    pub profile: Option<Profile>,
    /// Measured stalls of the host, by which the profile was chosen; `null` if a person chose it.
    pub host_stall: Option<HostStall>,
    /// Processor of each loop, by the name of its process; empty where the loops are not placed.
    pub placement: BTreeMap<String, usize>,
    /// The card that acquisition reads.
    pub backend: Option<CardKind>,
    /// The interlocks.
    pub watchdog: Option<WatchdogStatus>,
    /// The gate, and the card's counters.
    pub gate: Option<GateStatus>,
    /// Number of axes.
    pub axes: usize,
    /// Axes that are not homed, from 0.
    pub unhomed: Vec<usize>,
    /// Axes whose range of motion is not in force: unhomed, or searching for the stops.
    pub range_not_in_force: Vec<usize>,
    /// The scanner; `null` if nothing was seen of it.
    pub scanner: Option<ScannerStatus>,
    /// The model beside each axis; empty without the monitor.
    pub model: Vec<ModelStatus>,
    /// Faults in force in the simulated card and machine.
    pub injected_faults: Vec<InjectedFault>,
    /// The running protocol; `null` if none runs.
    pub protocol: Option<ProtocolStatus>,
    /// The processes.
    pub processes: Vec<ProcessStatus>,
    /// The logger.
    pub recording: Option<RecordingStatus>,
    /// Topics with messages lost before they reached the disk, since the logger started.
    pub losses: Vec<TopicLoss>,
}

/// The launcher.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LauncherStatus {
    /// Process id.
    pub pid: i32,
    /// Whether it is alive.
    pub alive: bool,
    /// When it started (ms since 1970, UTC).
    pub since_unix_ms: u64,
}

/// The interlocks.
#[derive(Clone, Debug, Serialize)]
pub struct WatchdogStatus {
    /// State.
    pub state: WatchdogState,
    /// Why power is latched off: `none` unless the state is faulted or tripped.
    pub cause: TripCause,
    /// Active faults.
    pub faults: Vec<TripCause>,
    /// Enable epoch.
    pub epoch: u64,
    /// Whether the motor may be powered.
    pub enabled: bool,
    /// The last fault or trip since the watchdog started; `null` if there was none.
    pub last_trip: Option<LastTrip>,
}

/// A fault or trip that is over, or the present one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct LastTrip {
    /// Its cause.
    pub cause: TripCause,
    /// When it happened (ms since 1970, UTC); `null` if its event was not received.
    pub unix_ms: Option<u64>,
}

impl WatchdogStatus {
    /// From a token, and the time of the last trip if its event was received.
    fn new(token: &EnableToken, tripped_unix_ms: Option<u64>) -> Self {
        let last = TripCause::from_code(token.cause).unwrap_or(TripCause::None);
        let was_trip = !matches!(last, TripCause::None | TripCause::Started);
        Self {
            state: state_of(token),
            cause: active_cause(token),
            faults: active_faults(token.faults),
            epoch: token.epoch,
            enabled: token.enabled != 0,
            last_trip: was_trip.then_some(LastTrip { cause: last, unix_ms: tripped_unix_ms }),
        }
    }
}

/// The gate in acquisition.
#[derive(Clone, Debug, Serialize)]
pub struct GateStatus {
    /// State.
    pub state: GateState,
    /// Why it closed and ended the last epoch.
    pub cause: GateCause,
    /// The last epoch that it saw.
    pub epoch: u64,
    /// Whether the card reports motor power.
    pub motor_power: bool,
    /// Scans that the card dropped since acquisition started.
    pub scans_missed: u64,
    /// Cycles that acquisition skipped since it started.
    pub cycles_missed: u64,
}

/// One process. Counters and percentiles are since its start.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ProcessStatus {
    /// Name.
    pub name: String,
    /// State; `null` if nobody supervises it.
    pub state: Option<UnitState>,
    /// Process id.
    pub pid: Option<i32>,
    /// When it entered this state (ms since 1970, UTC).
    pub since_unix_ms: Option<u64>,
    /// Starts after the first.
    pub restarts: u32,
    /// How its predecessor ended.
    pub last_exit: Option<String>,
    /// The program of others that runs in its place; `null` for farreach's own.
    pub replaced_by: Option<String>,
    /// Messages published per second, measured (fast loops).
    pub rate_hz: Option<f64>,
    /// Rate of its loop (Hz).
    pub grid_hz: Option<f64>,
    /// Cycles.
    pub cycles: Option<u64>,
    /// Periods skipped because it woke late.
    pub missed_periods: Option<u64>,
    /// Wake-up lateness (µs).
    pub wake_late_us: Option<Percentiles>,
    /// Execution time of a cycle (µs).
    pub execution_us: Option<Percentiles>,
    /// Timing profile that it was granted.
    pub profile: Option<Profile>,
    /// Processors on which its main thread, the loop, may run.
    pub processors: Vec<usize>,
    /// Age of its last message (ms).
    pub heartbeat_age_ms: Option<f64>,
    /// Messages lost before they reached it (slow processes).
    pub lost: Option<u64>,
    /// Messages in its own queue (slow processes).
    pub queued: Option<u64>,
    /// Messages that it missed, refused or could not deliver (periodic processes).
    pub losses: Option<Losses>,
    /// Its log file; `null` under systemd, where the journal has it.
    pub log: Option<String>,
}

/// The logger.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingStatus {
    /// The file; `null` if nothing is recorded.
    pub file: Option<String>,
    /// Messages written to it.
    pub written: u64,
    /// Messages lost.
    pub lost: u64,
    /// Its parts, if it is a ring; `null` otherwise.
    pub ring: Option<RingStatus>,
    /// The logger's error; empty if there is none.
    pub error: String,
}

/// Messages of one topic that are not on disk.
#[derive(Clone, Debug, Serialize)]
pub struct TopicLoss {
    /// The topic.
    pub topic: String,
    /// Messages that never reached the logger.
    pub gaps: u64,
    /// Messages dropped because the logger's queue was full.
    pub dropped: u64,
    /// Messages that could not be written.
    pub refused: u64,
}

/// Observes a rig repeatedly.
#[derive(Default)]
pub struct Watcher {
    joined: Option<(RigLink, Observer)>,
}

impl Watcher {
    /// Returns the state of a rig, attaching to its current session if necessary. Takes 0.3 s to
    /// 1.2 s.
    ///
    /// # Errors
    /// If the launcher's files cannot be read. A rig that is down is not an error.
    pub fn status(&mut self, name: &RigName) -> Result<RigStatus, Error> {
        let mut unasked = None;
        let launched = match launch::status(&name.run_directory()) {
            Ok(status) => Some(status),
            Err(launch::Error::NotUp { .. }) => None,
            // What the processes publish tells the rest.
            Err(error @ launch::Error::Systemctl { .. }) => {
                unasked = Some(error.to_string());
                None
            }
            Err(error) => return Err(error.into()),
        };
        let mut status = RigStatus::of(name, launched.as_ref());
        status.cause = status.cause.or(unasked);
        match self.observe(name, &mut status) {
            Ok(()) => status.up = true,
            Err(Error::Domain(DomainError::NoKeeper(_))) if launched.is_none() => {}
            Err(error) => {
                self.joined = None;
                status.unread = Some(error.to_string());
            }
        }
        Ok(status)
    }

    fn observe(&mut self, name: &RigName, status: &mut RigStatus) -> Result<(), Error> {
        let joined = match self.joined.take().filter(|(link, _)| link.domain().is_current()) {
            Some(joined) => joined,
            None => {
                let link = RigLink::open(name)?;
                let observer = Observer::new(&link)?;
                (link, observer)
            }
        };
        let (link, observer) = self.joined.insert(joined);
        observer.observe()?;
        let domain = link.domain();
        status.session = Some(format!("{:016x}", domain.session()));
        status.profile = Some(domain.profile());
        status.host_stall = domain.host_stall();
        status.placement.clone_from(domain.placement());
        // A logger that does not answer is visible in its process's row.
        let recording = link.logger(&LoggerRequest::Status).ok();
        status.recording = recording.map(|answer| RecordingStatus {
            file: answer.recording,
            written: answer.written,
            lost: answer.lost,
            ring: answer.ring,
            error: answer.error,
        });
        // The volumes of a protocol that has ended are in the recording.
        let experiment = link.experiment(&ExperimentRequest::Status).ok();
        let experiment = experiment.filter(|answer| answer.running);
        status.add(observer, experiment.as_ref().and_then(|answer| answer.scan));
        status.protocol = experiment.map(ProtocolStatus::from);
        if status.backend == Some(CardKind::Simulated) {
            // A card that does not answer is visible in its process's row.
            let answer = link.simulator(&SimulatorRequest::Status).ok();
            status.injected_faults = answer.map_or_else(Vec::new, |answer| answer.faults);
        }
        Ok(())
    }
}

/// Returns the state of a rig, once.
///
/// # Errors
/// As [`Watcher::status`].
pub fn status(name: &RigName) -> Result<RigStatus, Error> {
    Watcher::default().status(name)
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
                    replaced_by: unit.replaced_by.clone(),
                    log: Some(unit.log.display().to_string()).filter(|log| !log.is_empty()),
                    processors: unit
                        .scheduling
                        .as_ref()
                        .map_or_else(Vec::new, |of| of.cores.clone()),
                    name: unit.name.clone(),
                    ..ProcessStatus::default()
                })
                .collect()
        });
        let by_launcher = launched.filter(|status| status.supervision == Supervision::Launcher);
        Self {
            rig_name: name.to_string(),
            up: launched.is_some(),
            state: launched.map(|status| status.state),
            cause: launched.and_then(|status| status.cause.clone()),
            supervision: launched.map(|status| status.supervision),
            launcher: by_launcher.map(|status| LauncherStatus {
                pid: status.launcher.pid,
                alive: status.launcher.is_alive(),
                since_unix_ms: status.since_unix_ms,
            }),
            processes,
            ..Self::default()
        }
    }

    fn add(&mut self, seen: &Observer, scan: Option<ScanProgress>) {
        if let Some(token) = &seen.tokens.newest {
            let tripped = seen.tripped_ns.and_then(|time_ns| {
                let age = Duration::from_nanos(seen.now_ns.saturating_sub(time_ns));
                let since = (SystemTime::now() - age).duration_since(UNIX_EPOCH).ok()?;
                u64::try_from(since.as_millis()).ok()
            });
            self.watchdog = Some(WatchdogStatus::new(token, tripped));
            let unheld = token.range_given & !token.range_supervised;
            self.range_not_in_force = (0..AXES).filter(|axis| unheld & 1 << axis != 0).collect();
        }
        if let Some(sample) = &seen.samples.newest {
            self.backend = CardKind::from_code(sample.backend);
            self.axes = usize::from(sample.axes).min(AXES);
            self.unhomed = (0..self.axes).filter(|axis| sample.homed & 1 << axis == 0).collect();
            self.gate = Some(GateStatus {
                state: GateState::from_code(sample.gate_state).unwrap_or(GateState::Closed),
                cause: GateCause::from_code(sample.gate_cause).unwrap_or(GateCause::None),
                epoch: sample.epoch,
                motor_power: sample.motor_power != 0,
                scans_missed: sample.scans_missed,
                cycles_missed: sample.cycles_missed,
            });
        }
        self.model = seen.model.status(seen.samples.rate_hz(), seen.now_ns);
        self.scanner = ScannerStatus::new(seen.pulses.newest.as_ref(), scan, seen.now_ns);
        for (process, rate_hz, _) in seen.fast() {
            if rate_hz.is_some() {
                self.row(process.text()).rate_hz = rate_hz;
            }
        }
        for timing in seen.timings() {
            let Some(process) = Process::from_code(timing.source) else { continue };
            let row = self.row(process.text());
            // The last message of a process that has died says nothing about its successor.
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
            row.losses = Some(Losses::told_by(&timing));
        }
        for beat in seen.heartbeats() {
            let Some(process) = Process::from_code(beat.source) else { continue };
            let row = self.row(process.text());
            row.pid = row.pid.or(i32::try_from(beat.pid).ok());
            row.profile = row.profile.or(Profile::from_code(beat.profile));
            row.heartbeat_age_ms = Some(seen.age_ms(beat.time_ns));
            row.lost = Some(beat.lost);
            row.queued = Some(beat.queued);
        }
        for (process, _, time_ns) in seen.fast() {
            if let Some(time_ns) = time_ns {
                self.row(process.text()).heartbeat_age_ms = Some(seen.age_ms(time_ns));
            }
        }
        let lost = seen.loss.iter().filter(|loss| loss.gaps + loss.dropped + loss.refused > 0);
        self.losses.extend(lost.map(|loss| {
            let topic = usize::try_from(loss.topic).ok().and_then(|index| TOPICS.get(index));
            TopicLoss {
                topic: topic
                    .map_or_else(|| format!("topic {}", loss.topic), |of| of.name.to_owned()),
                gaps: loss.gaps,
                dropped: loss.dropped,
                refused: loss.refused,
            }
        }));
    }

    /// The row of a process; a new one if the launcher does not list it (under systemd).
    fn row(&mut self, name: &str) -> &mut ProcessStatus {
        let index = match self.processes.iter().position(|process| process.name == name) {
            Some(index) => index,
            None => {
                self.processes
                    .push(ProcessStatus { name: name.to_owned(), ..ProcessStatus::default() });
                self.processes.len() - 1
            }
        };
        &mut self.processes[index]
    }
}

/// State of the watchdog in a token; an unknown code counts as faulted.
pub(crate) fn state_of(token: &EnableToken) -> WatchdogState {
    WatchdogState::from_code(token.state).unwrap_or(WatchdogState::Faulted)
}

/// Why power is latched off; [`TripCause::None`] unless the watchdog is faulted or tripped. A token
/// keeps the cause of the last trip after `reset`, when it explains nothing any more.
pub(crate) fn active_cause(token: &EnableToken) -> TripCause {
    match state_of(token) {
        WatchdogState::Faulted | WatchdogState::Tripped => {
            TripCause::from_code(token.cause).unwrap_or(TripCause::None)
        }
        _ => TripCause::None,
    }
}

/// The causes in a token's `faults`: one bit per code.
pub(crate) fn active_faults(faults: u64) -> Vec<TripCause> {
    TripCause::ALL.iter().copied().filter(|cause| faults & (1 << cause.code()) != 0).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn fault_bits_of_a_token_are_decoded() {
        let bits = 1 << TripCause::ControlLost.code() | 1 << TripCause::SpeedLimit.code();
        assert_eq!(active_faults(bits), [TripCause::ControlLost, TripCause::SpeedLimit]);
        assert!(active_faults(0).is_empty());
    }

    #[test]
    fn the_cause_of_an_earlier_trip_is_not_the_present_one() {
        let token = |state: WatchdogState| EnableToken {
            state: state.code(),
            cause: TripCause::AcquisitionLost.code(),
            ..EnableToken::default()
        };
        for state in [WatchdogState::Disarmed, WatchdogState::Armed, WatchdogState::Enabled] {
            let watchdog = WatchdogStatus::new(&token(state), Some(7));
            assert_eq!(watchdog.cause, TripCause::None, "{state}");
            let last = LastTrip { cause: TripCause::AcquisitionLost, unix_ms: Some(7) };
            assert_eq!(watchdog.last_trip, Some(last), "{state}");
        }
        for state in [WatchdogState::Faulted, WatchdogState::Tripped] {
            assert_eq!(WatchdogStatus::new(&token(state), None).cause, TripCause::AcquisitionLost);
        }
        let started =
            EnableToken { cause: TripCause::Started.code(), ..token(WatchdogState::Faulted) };
        assert_eq!(WatchdogStatus::new(&started, None).last_trip, None);
    }

    #[test]
    fn a_rig_that_was_never_up_is_down() {
        let name: RigName = format!("none-{}", std::process::id()).parse().unwrap();
        let status = status(&name).unwrap();
        assert!(!status.up && status.processes.is_empty() && status.unread.is_none());
    }
}
