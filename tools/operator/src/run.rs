//! Running a protocol: send it to the experiment process, see that the motor has leave, watch both
//! to the end.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ipc_types::{
    EnableToken, ExperimentAnswer, ExperimentRequest, TOKEN, TripCause, Verb, WatchdogState,
};
use rig::protocol::Protocol;
use runtime::RequestError;

use crate::link::Subscriber;
use crate::status::standing;
use crate::{Error, RigLink, rig_of, verb};

/// How long the watchdog may be silent.
const TOKEN_LIMIT: Duration = Duration::from_secs(1);
/// How long the experiment process may be away: it is started again and goes on where it was.
const AWAY_LIMIT: Duration = Duration::from_secs(10);
/// How often it is asked how far it is.
const EVERY: Duration = Duration::from_millis(100);

/// What to run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Protocol: a path, or the name of a shipped one.
    pub protocol: PathBuf,
    /// `KEY=VALUE`, applied before it is checked.
    pub overrides: Vec<String>,
    /// Whom it is run with; goes into the recording with the protocol's name.
    pub subject: Option<String>,
}

/// How far it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Time played (s).
    pub elapsed_s: f64,
    /// Whole duration (s).
    pub duration_s: f64,
    /// Segment, from 1.
    pub segment: u32,
    /// Number of segments.
    pub segments: u32,
    /// Label of the segment; empty before the first answer.
    pub label: String,
    /// The experiment process does not answer at present.
    pub away: bool,
}

/// How it ended.
#[derive(Clone, Debug, PartialEq)]
pub enum RunOutcome {
    /// To its end; the time that it took by the player's clock (s).
    Completed {
        /// Time played (s).
        elapsed_s: f64,
    },
    /// The caller asked for it: the handle comes to rest, is held for a moment, and the volts go to
    /// 0.
    Stopped {
        /// Time played (s).
        elapsed_s: f64,
    },
    /// The watchdog took the power away; the protocol was stopped.
    Tripped {
        /// Its state.
        state: WatchdogState,
        /// The cause.
        cause: TripCause,
        /// Faults that stand.
        faults: Vec<TripCause>,
    },
}

/// Runs a protocol on a rig that is up, enabling the motor where a person armed it. `progress` is
/// told ten times a second; `stop`, once set, ends it early.
///
/// # Errors
/// What is wrong with the protocol, or does not fit the rig; that the rig is not armed; that a
/// process does not answer. After an error nothing plays on.
pub fn run_protocol(
    link: &RigLink,
    options: &RunOptions,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(&Progress),
) -> Result<RunOutcome, Error> {
    let protocol = rig::load_protocol(&options.protocol, &options.overrides)?;
    protocol.check_against(&rig_of(link.domain().name())?)?;
    let mut tokens = Tokens::new(link)?;
    let before = link.experiment(&ExperimentRequest::Status)?;
    if before.running {
        return Err(Error::Busy { segment: before.segment + 1, segments: before.segments });
    }
    let token = tokens.wait()?;
    match state_of(&token) {
        WatchdogState::Enabled => {}
        WatchdogState::Armed => {
            verb(link, Verb::Enable)?;
        }
        state => return Err(Error::NotArmed { state, cause: in_words(&token) }),
    }
    let name = match &options.subject {
        Some(subject) => format!("{} (subject {subject})", protocol.name),
        None => protocol.name.clone(),
    };
    let begun = link
        .experiment(&ExperimentRequest::Run { protocol: protocol.text().to_owned(), name })
        .inspect_err(|_| {
            // It may have heard, and play.
            let _stopped = link.experiment(&ExperimentRequest::Stop);
        })?;
    if !begun.error.is_empty() {
        return Err(Error::Experiment(begun.error));
    }
    let outcome = follow(link, &protocol, &mut tokens, stop, progress);
    if !matches!(outcome, Ok(RunOutcome::Completed { .. })) {
        // Where it does not answer there is nothing to stop: control holds when the setpoint's
        // lease lapses.
        let _stopped = link.experiment(&ExperimentRequest::Stop);
    }
    outcome
}

fn follow(
    link: &RigLink,
    protocol: &Protocol,
    tokens: &mut Tokens,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(&Progress),
) -> Result<RunOutcome, Error> {
    let labels: Vec<&str> =
        protocol.sequence().map(|(_, segment)| segment.label.as_str()).collect();
    let mut shown = Progress {
        elapsed_s: 0.0,
        duration_s: protocol.duration_s(),
        segment: 1,
        segments: u32::try_from(labels.len()).unwrap_or(u32::MAX),
        label: String::new(),
        away: false,
    };
    let mut answered = Instant::now();
    loop {
        if stop.load(Ordering::Relaxed) {
            return Ok(RunOutcome::Stopped { elapsed_s: shown.elapsed_s });
        }
        let token = tokens.wait()?;
        if state_of(&token) != WatchdogState::Enabled {
            return Ok(RunOutcome::Tripped {
                state: state_of(&token),
                cause: TripCause::from_code(token.cause).unwrap_or(TripCause::None),
                faults: standing(token.faults),
            });
        }
        match link.experiment(&ExperimentRequest::Status) {
            Ok(answer) => {
                answered = Instant::now();
                shown.away = false;
                shown.elapsed_s = answer.elapsed_s;
                shown.segment = answer.segment + 1;
                shown.label = labels
                    .get(answer.segment as usize)
                    .map_or_else(String::new, |label| (*label).to_owned());
                if let Some(outcome) = ending(&answer)? {
                    progress(&shown);
                    return Ok(outcome);
                }
            }
            Err(Error::Request(RequestError::NobodyServes(..) | RequestError::TimedOut { .. }))
                if answered.elapsed() < AWAY_LIMIT =>
            {
                shown.away = true;
            }
            Err(error) => return Err(error),
        }
        progress(&shown);
        std::thread::sleep(EVERY);
    }
}

/// Whether that answer is the last.
fn ending(answer: &ExperimentAnswer) -> Result<Option<RunOutcome>, Error> {
    if !answer.error.is_empty() {
        return Err(Error::Experiment(answer.error.clone()));
    }
    Ok(match (answer.running, answer.completed) {
        (true, _) => None,
        (false, true) => Some(RunOutcome::Completed { elapsed_s: answer.elapsed_s }),
        (false, false) => Some(RunOutcome::Stopped { elapsed_s: answer.elapsed_s }),
    })
}

fn state_of(token: &EnableToken) -> WatchdogState {
    WatchdogState::from_code(token.state).unwrap_or(WatchdogState::Faulted)
}

fn in_words(token: &EnableToken) -> String {
    let cause = TripCause::from_code(token.cause).filter(|cause| *cause != TripCause::None);
    let mut words: Vec<_> = cause.map(|cause| format!("cause: {cause}")).into_iter().collect();
    let faults: Vec<_> = standing(token.faults).iter().map(|fault| fault.text()).collect();
    if !faults.is_empty() {
        words.push(format!("standing: {}", faults.join(", ")));
    }
    words.join("; ")
}

/// The watchdog's tokens bear its state, a thousand times a second.
struct Tokens {
    reader: Subscriber<EnableToken>,
}

impl Tokens {
    fn new(link: &RigLink) -> Result<Self, Error> {
        Ok(Self { reader: link.subscriber(TOKEN)? })
    }

    /// The newest token; waits for one.
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
        let error = error.to_owned();
        ExperimentAnswer {
            running,
            segment: 0,
            segments: 1,
            elapsed_s: 2.5,
            duration_s: 3.0,
            completed,
            error,
        }
    }

    #[test]
    fn an_end_is_told_from_a_stop_and_from_a_failure() {
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
    fn a_fault_is_told_in_words() {
        let token = EnableToken {
            cause: TripCause::SpeedLimit.code(),
            faults: 1 << TripCause::ControlLost.code(),
            ..Default::default()
        };
        assert_eq!(in_words(&token), "cause: speed limit; standing: control lost");
        assert_eq!(in_words(&EnableToken::default()), "");
    }
}
