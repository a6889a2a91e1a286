//! Runs a protocol: sends it to the experiment process, enables the motor, and follows both until
//! the protocol ends.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ipc_types::{
    EnableToken, ExperimentAnswer, ExperimentRequest, LoggerRequest, ScanProgress, SessionProgress,
    TOKEN, TripCause, Verb, WatchdogState,
};
use runtime::{RequestError, Subscriber};
use serde::Serialize;

use crate::chosen_protocol::ChosenProtocol;
use crate::initialise_results::{FoundRange, Ranges};
use crate::status::{active_cause, active_faults, state_of};
use crate::{Error, RigLink, rig_of, verb};

/// Longest silence of the watchdog.
const TOKEN_LIMIT: Duration = Duration::from_secs(1);
/// Longest absence of the experiment process: the launcher restarts it and it resumes.
const ABSENCE_LIMIT: Duration = Duration::from_secs(10);
/// Polling period of the progress.
const POLL_PERIOD: Duration = Duration::from_millis(100);

/// Progress of a protocol; zeros before the first answer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Time played (s).
    pub elapsed_s: f64,
    /// Total duration (s).
    pub duration_s: f64,
    /// Segment, from 1.
    pub segment: u32,
    /// Number of segments.
    pub segments: u32,
    /// Label of the segment.
    pub label: String,
    /// Whether the experiment process is not answering.
    pub absent: bool,
    /// The ranges of travel found so far.
    pub ranges: Vec<FoundRange>,
    /// The volumes of the scan; `None` for a protocol that counts none.
    pub scan: Option<ScanProgress>,
    /// The sessions so far; `None` for a protocol without.
    pub sessions: Option<SessionProgress>,
}

/// How a protocol ended, as `run --json` prints it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "outcome", rename_all = "lowercase")]
pub enum RunOutcome {
    /// It ran to its end.
    Completed {
        /// Time played (s).
        elapsed_s: f64,
    },
    /// It was stopped early: the handle comes to rest, is held briefly, then the voltage goes to 0.
    Stopped {
        /// Time played (s).
        elapsed_s: f64,
    },
    /// The watchdog removed power (a trip, an e-stop or a disarm), which ends the protocol.
    Tripped {
        /// State of the watchdog.
        state: WatchdogState,
        /// Why power is latched off; [`TripCause::None`] after a disarm.
        cause: TripCause,
        /// Active faults.
        faults: Vec<TripCause>,
    },
}

/// Runs a protocol on a rig that is up, and enables the motor if a person has armed it. Calls
/// `progress` ten times per second; setting `stop` ends the protocol early.
///
/// # Errors
/// If the protocol is invalid or does not fit the rig, the rig is not armed, or a process does not
/// answer. No protocol runs after an error.
pub fn run_protocol(
    link: &RigLink,
    chosen: &ChosenProtocol,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(&Progress),
) -> Result<RunOutcome, Error> {
    let (protocol, pulses, client) = (chosen.protocol(), chosen.pulses(), chosen.client());
    let rig = rig_of(link.domain().name())?;
    protocol.check_against(&rig)?;
    let mut tokens = Tokens::new(link)?;
    let before = link.experiment(&ExperimentRequest::Status)?;
    if before.running {
        return Err(Error::Busy {
            name: before.name,
            segment: before.segment + 1,
            segments: before.segments,
        });
    }
    let name = chosen.name();
    let text = protocol.text().to_owned();
    let token = tokens.wait()?;
    if matches!(state_of(&token), WatchdogState::Enabled | WatchdogState::Armed) {
        // Before the motor gets power for a protocol that cannot be played.
        let (protocol, name, pulses) = (text.clone(), name.clone(), pulses.clone());
        let check = match chosen.continues() {
            Some(_) => ExperimentRequest::Interrupted,
            None => ExperimentRequest::Check { protocol, name, pulses },
        };
        accepted(&link.experiment(&check)?)?;
    }
    match state_of(&token) {
        // Nobody who has asked for a stop wants the motor's power.
        _ if stop.load(Ordering::Relaxed) => return Ok(RunOutcome::Stopped { elapsed_s: 0.0 }),
        WatchdogState::Enabled => {}
        WatchdogState::Armed => {
            verb(link, Verb::Enable)?;
        }
        _ => return Err(not_armed(&token)),
    }
    link.logger(&LoggerRequest::Run { metadata: chosen.metadata() })?;
    let found = Ranges::new(link, rig)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(RunOutcome::Stopped { elapsed_s: 0.0 });
    }
    let request = match chosen.continues() {
        Some(_) => ExperimentRequest::Continue {
            client,
            protocol: protocol.identity(),
            segment: chosen.segment(),
        },
        None => ExperimentRequest::Run { protocol: text, name, client, pulses: pulses.clone() },
    };
    let begun = link.experiment(&request).inspect_err(|_| {
        // The request may have arrived although the answer did not.
        let _stopped = link.experiment(&ExperimentRequest::Stop { client: Some(client) });
    })?;
    accepted(&begun)?;
    let mut following = Following { link, client, tokens, found };
    following.until_the_end(stop, progress)
}

/// Checks that a person has armed the rig, or that it is enabled already.
///
/// # Errors
/// [`Error::NotArmed`] with the cause, or if the watchdog is silent.
pub fn check_armed(link: &RigLink) -> Result<(), Error> {
    let token = Tokens::new(link)?.wait()?;
    match state_of(&token) {
        WatchdogState::Armed | WatchdogState::Enabled => Ok(()),
        _ => Err(not_armed(&token)),
    }
}

pub(crate) fn not_armed(token: &EnableToken) -> Error {
    let cause = causes(active_cause(token), &active_faults(token.faults)).join("; ");
    Error::NotArmed { state: state_of(token), cause }
}

/// Goes on with a protocol that was begun by a client that has ended since, a console that was
/// killed, as the same client, before its lease is over. Of a protocol that has ended meanwhile it
/// returns the outcome.
///
/// # Errors
/// If another protocol was begun meanwhile, or as [`run_protocol`].
pub fn resume_protocol(
    link: &RigLink,
    client: u64,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(&Progress),
) -> Result<RunOutcome, Error> {
    let rig = rig_of(link.domain().name())?;
    let tokens = Tokens::new(link)?;
    let found = Ranges::new(link, rig)?;
    Following { link, client, tokens, found }.until_the_end(stop, progress)
}

/// Whether an answer reports no error.
fn accepted(answer: &ExperimentAnswer) -> Result<(), Error> {
    if answer.error.is_empty() { Ok(()) } else { Err(Error::Experiment(answer.error.clone())) }
}

/// Follows a protocol as its client.
struct Following<'l> {
    link: &'l RigLink,
    client: u64,
    tokens: Tokens,
    found: Ranges,
}

impl Following<'_> {
    /// Renews the lease until the protocol ends, or ends it.
    fn until_the_end(
        &mut self,
        stop: &AtomicBool,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<RunOutcome, Error> {
        let outcome = self.follow(stop, progress);
        if !matches!(outcome, Ok(RunOutcome::Completed { .. })) {
            // A process that does not answer needs no stop: control holds once the setpoint's lease
            // expires.
            let request = ExperimentRequest::Stop { client: Some(self.client) };
            let _stopped = self.link.experiment(&request);
        }
        outcome
    }

    fn follow(
        &mut self,
        stop: &AtomicBool,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<RunOutcome, Error> {
        let mut shown = Progress::default();
        let mut answered = Instant::now();
        loop {
            if stop.load(Ordering::Relaxed) {
                return Ok(RunOutcome::Stopped { elapsed_s: shown.elapsed_s });
            }
            let token = self.tokens.wait()?;
            if state_of(&token) != WatchdogState::Enabled {
                return Ok(tripped(&token));
            }
            match self.link.experiment(&ExperimentRequest::Renew { client: self.client }) {
                Ok(answer) => {
                    answered = Instant::now();
                    shown.take(&answer);
                    self.found.read(&mut shown.ranges)?;
                    if answer.permission_lost {
                        return Ok(tripped(&self.tokens.wait()?));
                    }
                    if let Some(outcome) = ending(&answer)? {
                        progress(&shown);
                        return Ok(outcome);
                    }
                }
                Err(Error::Request(
                    RequestError::NobodyServes(..)
                    | RequestError::TimedOut { .. }
                    | RequestError::Busy { .. },
                )) if answered.elapsed() < ABSENCE_LIMIT => {
                    shown.absent = true;
                }
                Err(error) => return Err(error),
            }
            progress(&shown);
            std::thread::sleep(POLL_PERIOD);
        }
    }
}

impl Progress {
    fn take(&mut self, answer: &ExperimentAnswer) {
        self.absent = false;
        self.elapsed_s = answer.elapsed_s;
        self.duration_s = answer.duration_s;
        self.segment = answer.segment + 1;
        self.segments = answer.segments;
        self.label.clone_from(&answer.label);
        self.scan = answer.scan;
        self.sessions.clone_from(&answer.sessions);
    }
}

fn tripped(token: &EnableToken) -> RunOutcome {
    RunOutcome::Tripped {
        state: state_of(token),
        cause: active_cause(token),
        faults: active_faults(token.faults),
    }
}

/// Stops the running protocol, whoever started it: the handle comes to rest, the motor stays
/// enabled at 0 V. Returns the status of the protocol; `None` where none was running.
///
/// # Errors
/// When the experiment process does not answer, or does not stop.
pub fn stop_protocol(link: &RigLink) -> Result<Option<ExperimentAnswer>, Error> {
    let before = link.experiment(&ExperimentRequest::Status)?;
    if !before.running {
        return Ok(None);
    }
    let after = link.experiment(&ExperimentRequest::Stop { client: None })?;
    // It may have ended by itself in between.
    if after.running { Err(Error::Experiment(after.error)) } else { Ok(Some(after)) }
}

/// The outcome in an answer; `None` while the protocol runs.
fn ending(answer: &ExperimentAnswer) -> Result<Option<RunOutcome>, Error> {
    accepted(answer)?;
    Ok(match (answer.running, answer.completed) {
        (true, _) => None,
        (false, true) => Some(RunOutcome::Completed { elapsed_s: answer.elapsed_s }),
        (false, false) => Some(RunOutcome::Stopped { elapsed_s: answer.elapsed_s }),
    })
}

/// Why power is latched off, and the active faults; empty if there are none.
pub(crate) fn causes(cause: TripCause, faults: &[TripCause]) -> Vec<String> {
    let faults = faults.iter().map(|fault| fault.text()).collect::<Vec<_>>().join(", ");
    let cause = (cause != TripCause::None).then(|| format!("cause: {cause}"));
    cause
        .into_iter()
        .chain((!faults.is_empty()).then(|| format!("active faults: {faults}")))
        .collect()
}

/// The watchdog's tokens, which carry its state 1000 times per second.
struct Tokens {
    reader: Subscriber<EnableToken>,
}

impl Tokens {
    fn new(link: &RigLink) -> Result<Self, Error> {
        Ok(Self { reader: link.subscriber(TOKEN)? })
    }

    /// Waits for a token and returns the newest.
    fn wait(&mut self) -> Result<EnableToken, Error> {
        let started = Instant::now();
        loop {
            if let Some(token) = self.reader.latest()? {
                return Ok(token);
            }
            if started.elapsed() > TOKEN_LIMIT {
                return Err(Error::NoWatchdog(TOKEN_LIMIT.as_millis() as u64));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    fn answer(running: bool, completed: bool, error: &str) -> ExperimentAnswer {
        ExperimentAnswer {
            running,
            segments: 1,
            elapsed_s: 2.5,
            duration_s: 3.0,
            completed,
            error: error.to_owned(),
            ..ExperimentAnswer::default()
        }
    }

    #[test]
    fn completion_stop_and_failure_are_distinguished() {
        assert_eq!(ending(&answer(true, false, "")).unwrap(), None);
        assert_eq!(
            ending(&answer(false, true, "")).unwrap(),
            Some(RunOutcome::Completed { elapsed_s: 2.5 })
        );
        assert_eq!(
            ending(&answer(false, false, "")).unwrap(),
            Some(RunOutcome::Stopped { elapsed_s: 2.5 })
        );
        assert!(matches!(ending(&answer(true, false, "no rig")), Err(Error::Experiment(_))));
    }

    #[test]
    fn a_cause_is_described_only_while_power_is_latched_off() {
        let tripped = EnableToken {
            state: WatchdogState::Tripped.code(),
            cause: TripCause::SpeedLimit.code(),
            faults: 1 << TripCause::ControlLost.code(),
            ..Default::default()
        };
        let describe = |token: &EnableToken| {
            causes(active_cause(token), &active_faults(token.faults)).join("; ")
        };
        assert_eq!(describe(&tripped), "cause: speed limit; active faults: control lost");
        let disarmed = EnableToken { state: WatchdogState::Disarmed.code(), faults: 0, ..tripped };
        assert_eq!(describe(&disarmed), "");
    }
}
