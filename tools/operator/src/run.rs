//! Runs a protocol: sends it to the experiment process, enables the motor, and follows both until
//! the protocol ends.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ipc_types::{
    EnableToken, ExperimentAnswer, ExperimentRequest, LoggerRequest, ScanProgress, SessionProgress,
    TOKEN, TripCause, Verb, WatchdogState,
};
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use rig::protocol::{Protocol, with_overrides};
use runtime::clock::now_ns;
use runtime::{RequestError, Subscriber};
use serde::Serialize;

use crate::initialise_results::{FoundRange, Ranges};
use crate::status::{active_cause, active_faults, state_of};
use crate::{Error, RigLink, rig_of, verb};

/// Longest silence of the watchdog.
const TOKEN_LIMIT: Duration = Duration::from_secs(1);
/// Longest absence of the experiment process: the launcher restarts it and it resumes.
const ABSENCE_LIMIT: Duration = Duration::from_secs(10);
/// Key of the overrides in a run's metadata.
const OVERRIDES: &str = "protocol_overrides";
/// Polling period of the progress.
const POLL_PERIOD: Duration = Duration::from_millis(100);

/// What to run.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct RunOptions {
    /// Protocol file, or the name of a protocol shipped with farreach
    #[arg(value_name = "FILE|NAME", required_unless_present = "from")]
    pub protocol: Option<PathBuf>,
    /// Repeats the protocol that was played last in a recording, with its values and its subject
    #[arg(long, value_name = "RECORDING", conflicts_with = "protocol")]
    pub from: Option<PathBuf>,
    /// Overrides a value of the protocol before the protocol is checked (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Subject code, stored in the recording
    #[arg(long, value_name = "ID")]
    pub subject: Option<String>,
    /// Plays without a scanner: pulses with this repetition time (s) take the place of the trigger
    /// line, from 1 s after the wait for the scanner began
    #[arg(long, value_name = "TR")]
    pub emulate_scanner: Option<f64>,
    /// Writes a MATLAB file at the end of each session: NAME1.mat, NAME2.mat, …; the rig must be
    /// recording
    #[arg(long, value_name = "NAME")]
    pub mat: Option<PathBuf>,
}

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
    let ChosenProtocol { protocol, subject, emulate_scanner_s, .. } = chosen;
    let emulate_scanner_s = *emulate_scanner_s;
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
    let client = chosen.client;
    let name = match subject {
        Some(subject) => format!("{} (subject {subject})", protocol.name),
        None => protocol.name.clone(),
    };
    let text = protocol.text().to_owned();
    let token = tokens.wait()?;
    if matches!(state_of(&token), WatchdogState::Enabled | WatchdogState::Armed) {
        // Before the motor gets power for a protocol that cannot be played.
        let (protocol, name) = (text.clone(), name.clone());
        let check = ExperimentRequest::Check { protocol, name, emulate_scanner_s };
        accepted(&link.experiment(&check)?)?;
    }
    match state_of(&token) {
        // Nobody who has asked for a stop wants the motor's power.
        _ if stop.load(Ordering::Relaxed) => return Ok(RunOutcome::Stopped { elapsed_s: 0.0 }),
        WatchdogState::Enabled => {}
        WatchdogState::Armed => {
            verb(link, Verb::Enable)?;
        }
        state => {
            let cause = causes(active_cause(&token), &active_faults(token.faults)).join("; ");
            return Err(Error::NotArmed { state, cause });
        }
    }
    record_run(link, chosen)?;
    let found = Ranges::new(link, rig)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(RunOutcome::Stopped { elapsed_s: 0.0 });
    }
    let begun = link
        .experiment(&ExperimentRequest::Run { protocol: text, name, client, emulate_scanner_s })
        .inspect_err(|_| {
            // The request may have arrived although the answer did not.
            let _stopped = link.experiment(&ExperimentRequest::Stop { client: Some(client) });
        })?;
    accepted(&begun)?;
    let mut following = Following { link, client, tokens, found };
    following.until_the_end(stop, progress)
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

/// A protocol that was chosen and read, with what its recording is to say of it.
pub struct ChosenProtocol {
    protocol: Protocol,
    /// Number of the client that runs it.
    client: u64,
    subject: Option<String>,
    emulate_scanner_s: Option<f64>,
    /// All overrides that made its text, in their order.
    overrides: Vec<String>,
    /// Identity of the text without the overrides of the options, where these changed it.
    original: Option<u64>,
}

impl ChosenProtocol {
    /// The protocol.
    pub const fn protocol(&self) -> &Protocol {
        &self.protocol
    }

    /// Number of the client that runs it.
    pub const fn client(&self) -> u64 {
        self.client
    }

    /// Reads the protocol that the options name.
    ///
    /// # Errors
    /// If the file or the recording cannot be read, or the protocol is invalid.
    pub fn new(options: &RunOptions) -> Result<Self, Error> {
        let asked = options.protocol.as_deref().unwrap_or(Path::new(""));
        let mut chosen = match &options.from {
            Some(path) => Self::recorded(path, &options.overrides)?,
            None => Self::of(rig::load_protocol(asked, &options.overrides)?),
        };
        // Without its overrides a protocol may be incomplete: then there is no identity to name.
        if !options.overrides.is_empty() && options.from.is_none() {
            chosen.original = rig::load_protocol(asked, &[]).ok().map(|text| text.identity());
        }
        chosen.overrides.extend(options.overrides.iter().cloned());
        chosen.subject = options.subject.clone().or(chosen.subject);
        chosen.emulate_scanner_s = options.emulate_scanner;
        Ok(chosen)
    }

    fn of(protocol: Protocol) -> Self {
        Self {
            protocol,
            client: client_number(),
            subject: None,
            emulate_scanner_s: None,
            overrides: Vec::new(),
            original: None,
        }
    }

    /// The protocol that was played last in a recording, with further overrides.
    fn recorded(path: &Path, overrides: &[String]) -> Result<Self, Error> {
        let recording = Recording::open(path)?;
        let played = recording.runs().filter_map(|run| Some((run, run.get(key::PROTOCOL_FILE)?)));
        let Some((run, text)) = played.last() else {
            return Err(Error::NothingPlayed(path.to_owned()));
        };
        let name = run.get(key::PROTOCOL).map_or("the protocol", String::as_str);
        let name = format!("{} ({name})", path.display());
        let text = with_overrides(text, &name, overrides)?;
        Ok(Self {
            subject: run.get(key::SUBJECT).cloned(),
            overrides: run.get(OVERRIDES).cloned().into_iter().collect(),
            ..Self::of(Protocol::parse(&text, &name)?)
        })
    }
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
                    RequestError::NobodyServes(..) | RequestError::TimedOut { .. },
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

/// Tells the logger what is about to run, so that the recording stands alone: the protocol's text
/// with the overrides applied, the overrides, the identity of the text without them, the subject,
/// the emulated scanner.
fn record_run(link: &RigLink, chosen: &ChosenProtocol) -> Result<(), Error> {
    let ChosenProtocol { protocol, subject, emulate_scanner_s, overrides, original, .. } = chosen;
    let all = (!overrides.is_empty()).then(|| overrides.join("\n"));
    let entries = [
        (key::PROTOCOL, Some(protocol.name.clone())),
        (key::PROTOCOL_FILE, Some(protocol.text().to_owned())),
        (OVERRIDES, all),
        ("protocol_identity", original.map(|identity| format!("{identity:016x}"))),
        (key::SUBJECT, subject.clone()),
        ("emulate_scanner_s", emulate_scanner_s.map(|repetition_s| repetition_s.to_string())),
    ];
    let metadata =
        entries.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?))).collect();
    link.logger(&LoggerRequest::Run { metadata })?;
    Ok(())
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

/// A number that no other client of the rig has: the process and the time.
pub fn client_number() -> u64 {
    u64::from(std::process::id()) << 40 ^ now_ns()
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
