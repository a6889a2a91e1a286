//! The threads that carry out what pages ask for: one for what may take its time, one for what must
//! not wait.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender};
use std::time::Duration;

use ipc_types::{EventKind, ExperimentRequest, LoggerAnswer, LoggerRequest, Severity, Split, Verb};
use operator::status::RigStatus;
use operator::{ChosenProtocol, Error, RigLink, RunOptions, SessionFiles};
use rig::protocol::entries;
use rig::{FileError, RigFile};
use runtime::{RigName, random_u64};
use serde::Serialize;
use serde_json::{Value, json};
use tokio::sync::oneshot;

use crate::desk::{Built, Shared};
use crate::request::{Level, Request, Setup};
use crate::runner::{Order, Ordered};

/// A protocol begins within this time, or its start has failed.
const BEGIN_LIMIT: Duration = Duration::from_secs(15);

/// A request of a page that may make it.
pub(crate) struct Command {
    /// Number of the page.
    pub(crate) page: u64,
    pub(crate) request: Request,
    /// When the page asked for it (ns, CLOCK_MONOTONIC).
    pub(crate) at_ns: u64,
    pub(crate) answer: oneshot::Sender<Answer>,
}

/// What a page is answered.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Answer {
    /// Whether it was done.
    pub(crate) ok: bool,
    /// What was done, or why not.
    pub(crate) text: String,
    /// Problems with values of the setup.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) problems: Vec<EntryProblem>,
    /// What was asked for.
    #[serde(skip_serializing_if = "Value::is_null")]
    pub(crate) data: Value,
}

/// A problem with one value.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct EntryProblem {
    /// Its key (`matching.session_s`).
    pub(crate) key: String,
    /// What was expected and found, and what to do.
    pub(crate) text: String,
}

impl Answer {
    pub(crate) fn done(text: impl Into<String>) -> Self {
        Self { ok: true, text: text.into(), ..Self::default() }
    }

    pub(crate) fn refused(text: impl Into<String>) -> Self {
        Self { text: text.into(), ..Self::default() }
    }
}

/// The problems that an error names.
fn problems_of(error: &FileError) -> Vec<EntryProblem> {
    let problem = |problem: &rig::Problem| {
        let mut text = format!("expected {}, found {}", problem.expected, problem.found);
        if !problem.advice.is_empty() {
            text += &format!("; {}", problem.advice);
        }
        EntryProblem { key: problem.key.clone(), text }
    };
    error.problems().iter().map(problem).collect()
}

/// A setup that was refused: the problems and, in words, the first.
fn refused_setup(error: &Error) -> Answer {
    let problems = match error {
        Error::File(error) => problems_of(error),
        _ => Vec::new(),
    };
    let text = match problems.as_slice() {
        [] => error.to_string(),
        [first] => format!("refused: {}: {}", first.key, first.text),
        [first, rest @ ..] => {
            format!("refused: {}: {} (and {} more)", first.key, first.text, rest.len())
        }
    };
    Answer { text, problems, ..Answer::default() }
}

/// A thread that carries out commands.
pub(crate) struct Commander {
    pub(crate) name: RigName,
    pub(crate) rig: Arc<RigFile>,
    pub(crate) shared: Arc<Shared>,
    pub(crate) runner: Sender<Ordered>,
}

/// The same in its thread, with a link that stays there.
struct CommandThread {
    commander: Commander,
    /// Made when first needed.
    link: Option<RigLink>,
}

impl Commander {
    /// Carries out commands until nobody can send any.
    pub(crate) fn serve(self, commands: &Receiver<Command>) {
        let mut thread = CommandThread { commander: self, link: None };
        // The first command shall find the link made; where that fails, it tries again.
        let _linked = thread.link().is_ok();
        while let Ok(Command { page, request, at_ns, answer }) = commands.recv() {
            // The page may have lost control, or be gone, while its command waited. What stops the
            // rig was allowed when it came, and is done although its page has gone.
            let may = match request.level() {
                Level::Control => thread.commander.shared.access().check(page, Level::Control),
                Level::Anyone | Level::Token => Ok(()),
            };
            let answered = match may {
                Ok(()) => thread.perform(&request, at_ns).unwrap_or_else(|error| {
                    // The next command tries with a new link.
                    thread.link = None;
                    Answer::refused(format!("{error:#}"))
                }),
                Err(reason) => Answer::refused(reason),
            };
            // The page may be gone.
            let _sent = answer.send(answered);
        }
    }
}

impl CommandThread {
    fn link(&mut self) -> anyhow::Result<&RigLink> {
        let link = match self.link.take().filter(|link| link.domain().is_current()) {
            Some(link) => link,
            None => RigLink::open(&self.commander.name)?,
        };
        Ok(self.link.insert(link))
    }

    fn perform(&mut self, request: &Request, at_ns: u64) -> anyhow::Result<Answer> {
        Ok(match request {
            Request::Verb { verb } => self.verb(*verb)?,
            Request::Stop => self.stop()?,
            Request::Pulse { .. } => self.pulse(at_ns)?,
            Request::Describe { protocol } => describe(protocol),
            Request::Build(setup) => self.build(setup)?,
            Request::Interrupted { subject, files } => self.build_interrupted(subject, files)?,
            Request::Initialise => self.order(Order::Home, "the machine looks for its stops"),
            Request::Start { build } => self.start(build),
            Request::Note { text } => {
                self.commander.shared.event(EventKind::Note, Severity::Info, [0.0; 3], text);
                Answer::done("noted")
            }
            Request::Record { file } => self.record(file)?,
            Request::EndRecording => self.end_recording()?,
            Request::Refresh => refresh(&operator::status::status(&self.commander.name)?),
            Request::Hello { .. }
            | Request::TakeControl
            | Request::Echo { .. }
            | Request::Shown { .. }
            | Request::Sounded { .. } => Answer::refused("this is answered elsewhere"),
        })
    }

    fn verb(&mut self, verb: Verb) -> anyhow::Result<Answer> {
        let answer = self.link()?.verb(verb)?;
        Ok(match answer.done {
            true => Answer::done(format!("the rig is {}", answer.state)),
            false => {
                let state = answer.state;
                Answer::refused(format!("{} refused: {}; the rig is {state}", verb, answer.reason))
            }
        })
    }

    /// Ends whatever is played, whoever began it: the handle comes to rest, then 0 V.
    fn stop(&mut self) -> anyhow::Result<Answer> {
        {
            let mut desk = self.commander.shared.desk();
            desk.stops += 1;
            if let Some(playing) = &desk.playing {
                playing.stop.store(true, Ordering::Relaxed);
            }
        }
        let stopped = operator::stop_protocol(self.link()?)?;
        Ok(match stopped {
            Some(answer) => Answer::done(format!("{} is being stopped", answer.name)),
            None => Answer::done("no protocol is running"),
        })
    }

    /// A pulse of the scanner for the protocol that the console plays.
    fn pulse(&mut self, at_ns: u64) -> anyhow::Result<Answer> {
        let client = self.commander.shared.desk().playing.as_ref().map(|playing| playing.client);
        let Some(client) = client else {
            return Ok(Answer::refused("the key 5 was not counted: no protocol is running"));
        };
        let answer = self.link()?.experiment(&ExperimentRequest::Pulse { client, at_ns })?;
        Ok(match answer.error {
            error if error.is_empty() => Answer::done("a pulse of the scanner, by the key 5"),
            error => Answer::refused(error),
        })
    }

    fn build(&mut self, setup: &Setup) -> anyhow::Result<Answer> {
        if self.is_running() {
            return Ok(Answer::refused("a protocol is running; wait for its end, or stop it"));
        }
        // What was built before is not started by mistake.
        self.commander.shared.desk().built = None;
        let chosen = match self.choose(setup) {
            Ok(chosen) => chosen,
            Err(error) => return Ok(refused_setup(&error)),
        };
        self.built(chosen, &setup.files)
    }

    /// Builds the protocol that was interrupted, so that it can be continued.
    fn build_interrupted(&mut self, subject: &str, files: &str) -> anyhow::Result<Answer> {
        if self.is_running() {
            return Ok(Answer::refused("a protocol is running; wait for its end, or stop it"));
        }
        self.commander.shared.desk().built = None;
        let subject = Some(subject.to_owned()).filter(|subject| !subject.is_empty());
        let options = RunOptions { subject, ..RunOptions::default() };
        let chosen = ChosenProtocol::interrupted(self.link()?, &options)?;
        self.built(chosen, files)
    }

    /// Keeps a protocol that was read, for a start.
    fn built(&mut self, chosen: ChosenProtocol, files: &str) -> anyhow::Result<Answer> {
        let files = match files.trim() {
            "" => None,
            name => Some(self.files(&chosen, name)?),
        };
        // What hinders a start now may be gone by then: an axis that is not homed.
        let before = self.hindrance(&chosen)?;
        let before =
            before.map_or_else(String::new, |reason| format!("; before it starts: {reason}"));
        let id = format!("{:016x}", random_u64());
        let protocol = chosen.protocol();
        let (name, duration_s) = (protocol.name.clone(), protocol.duration_s());
        let from = match chosen.continues() {
            None => String::new(),
            Some(0) => ", and begins with its first session again".to_owned(),
            Some(over) => format!(", and goes on after session {over}"),
        };
        let subject = chosen.subject().unwrap_or("").to_owned();
        let built = Built { id: id.clone(), chosen, subject, files };
        let mut desk = self.commander.shared.desk();
        desk.built = Some(Arc::new(built));
        self.commander.shared.show(&desk);
        Ok(Answer {
            data: json!({ "build": id }),
            ..Answer::done(format!("{name} is ready, {duration_s:.0} s at most{from}{before}"))
        })
    }

    /// Reads and checks a protocol with the page's values.
    fn choose(&self, setup: &Setup) -> Result<ChosenProtocol, Error> {
        let subject = Some(setup.subject.clone()).filter(|subject| !subject.is_empty());
        let overrides = setup.entries.iter().map(|(key, value)| format!("{key}={value}"));
        let options = RunOptions {
            protocol: Some(PathBuf::from(&setup.protocol)),
            overrides: overrides.collect(),
            subject,
            ..RunOptions::default()
        }
        .with_pulses(setup.scanner.clone());
        let chosen = ChosenProtocol::new(&options)?;
        chosen.protocol().check_against(&self.commander.rig)?;
        Ok(chosen)
    }

    /// Why the protocol could not be played now.
    fn hindrance(&mut self, chosen: &ChosenProtocol) -> anyhow::Result<Option<String>> {
        let protocol = chosen.protocol();
        if chosen.continues().is_some() {
            let answer = self.link()?.experiment(&ExperimentRequest::Interrupted)?;
            return Ok(Some(answer.error).filter(|error| !error.is_empty()));
        }
        let answer = self.link()?.experiment(&ExperimentRequest::Check {
            protocol: protocol.text().to_owned(),
            name: protocol.name.clone(),
            pulses: chosen.pulses().clone(),
        })?;
        Ok(Some(answer.error).filter(|error| !error.is_empty()))
    }

    /// Name of the sessions' files: one without a folder goes beside the recording.
    fn files(&mut self, chosen: &ChosenProtocol, name: &str) -> anyhow::Result<PathBuf> {
        let link = self.link()?;
        let recording = link.logger(&LoggerRequest::Status)?.recording.map(PathBuf::from);
        let beside = recording.as_deref().and_then(Path::parent).unwrap_or(Path::new("/"));
        // An absolute name stands for itself.
        let name = beside.join(name);
        SessionFiles::check(link, chosen, &name)?;
        Ok(name)
    }

    fn start(&self, build: &str) -> Answer {
        let built = self.commander.shared.desk().built.clone();
        match built.filter(|built| built.id == build) {
            Some(built) => {
                let text = format!("{} has begun", built.chosen.protocol().name);
                let answer = self.order(Order::Experiment(built), &text);
                if answer.ok {
                    // Each start needs a build of its own: what it names is then the newest.
                    self.commander.shared.desk().built = None;
                }
                answer
            }
            None => Answer::refused("what this page built is not the newest any more; build again"),
        }
    }

    fn is_running(&self) -> bool {
        self.commander.shared.desk().situation(None).running
    }

    /// Hands a protocol to the thread that plays it, and waits until it has begun.
    fn order(&self, order: Order, text: &str) -> Answer {
        if self.is_running() {
            return Answer::refused("a protocol is running; wait for its end, or stop it");
        }
        let (begun, begins) = oneshot::channel();
        let stops = self.commander.shared.desk().stops;
        if self.commander.runner.send(Ordered { order, begun, stops }).is_err() {
            return Answer::refused(
                "the thread that plays protocols has ended; restart the console",
            );
        }
        match wait(begins, BEGIN_LIMIT) {
            Some(Ok(())) => Answer::done(text),
            Some(Err(error)) => Answer::refused(error),
            None => Answer::refused("it has not begun in time, and will not begin any more"),
        }
    }

    fn record(&mut self, file: &str) -> anyhow::Result<Answer> {
        if !Path::new(file).is_absolute() {
            return Ok(Answer::refused(format!(
                "expected an absolute path (/data/S07.mcap), found \"{file}\""
            )));
        }
        let request = LoggerRequest::Start {
            path: file.to_owned(),
            metadata: Vec::new(),
            split: Split::default(),
        };
        let LoggerAnswer { error, .. } = self.link()?.logger(&request)?;
        if !error.is_empty() {
            return Ok(Answer::refused(error));
        }
        let mut desk = self.commander.shared.desk();
        (desk.files, desk.reports) = (Vec::new(), Vec::new());
        self.commander.shared.show(&desk);
        Ok(Answer::done(format!("recording {file}")))
    }

    fn end_recording(&mut self) -> anyhow::Result<Answer> {
        let LoggerAnswer { written, lost, error, .. } =
            self.link()?.logger(&LoggerRequest::Stop)?;
        Ok(match (error.is_empty(), lost) {
            (false, _) => Answer::refused(error),
            (true, 0) => Answer::done(format!("{written} messages are on disk, none lost")),
            (true, _) => Answer::refused(format!("{written} messages on disk, {lost} LOST")),
        })
    }
}

/// Waits for an answer.
fn wait<T>(mut answer: oneshot::Receiver<T>, limit: Duration) -> Option<T> {
    let began = std::time::Instant::now();
    loop {
        match answer.try_recv() {
            Ok(answer) => return Some(answer),
            Err(oneshot::error::TryRecvError::Closed) => return None,
            Err(oneshot::error::TryRecvError::Empty) if began.elapsed() > limit => return None,
            Err(oneshot::error::TryRecvError::Empty) => {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
    }
}

/// The values of a protocol and their limits.
fn describe(asked: &str) -> Answer {
    let protocol = match rig::load_protocol(Path::new(asked), &[]) {
        Ok(protocol) => protocol,
        Err(error) => return refused_setup(&error.into()),
    };
    match entries(protocol.text(), protocol.file_name()) {
        Ok(entries) => {
            let entry = |entry: &rig::protocol::Entry| {
                json!({
                    "path": entry.path,
                    "value": entry.value,
                    "accepts": entry.accepts,
                    "default": entry.default,
                    "about": entry.about,
                })
            };
            let data = json!({
                "description": protocol.description,
                "entries": entries.iter().map(entry).collect::<Vec<_>>(),
            });
            Answer { data, ..Answer::done(protocol.name) }
        }
        Err(error) => refused_setup(&error.into()),
    }
}

/// Which processes answer.
fn refresh(status: &RigStatus) -> Answer {
    let silent: Vec<&str> = status
        .processes
        .iter()
        .filter(|process| process.heartbeat_age_ms.is_none_or(|age_ms| age_ms > 1500.0))
        .map(|process| process.name.as_str())
        // It has the shared memory only, and publishes nothing.
        .filter(|name| *name != "keeper")
        .collect();
    let count = status.processes.len();
    match (silent.as_slice(), &status.unread) {
        (_, Some(reason)) => Answer::refused(format!("nothing can be read: {reason}")),
        ([], None) => Answer::done(format!("all {count} processes answer")),
        (silent, None) => {
            Answer::refused(format!("silent: {} (of {count} processes)", silent.join(", ")))
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn a_description_has_limits_and_an_unknown_protocol_is_named() {
        let answer = describe("force-matching");
        assert!(answer.ok, "{answer:?}");
        let entries = answer.data["entries"].as_array().unwrap();
        let sets = entries.iter().find(|entry| entry["path"] == "matching.sets").unwrap();
        assert_eq!(sets["value"], "2");
        assert_eq!(sets["accepts"], "whole number, 1 to 100");
        let answer = describe("forced-matching");
        assert!(!answer.ok && answer.text.contains("forced-matching"), "{answer:?}");
    }

    #[test]
    fn a_refused_value_is_named_by_its_key() {
        let overrides = ["matching.frequency_hz=9", "matching.session_s=1"];
        let error = rig::load_protocol(Path::new("force-matching"), &overrides.map(str::to_owned));
        let answer = refused_setup(&error.unwrap_err().into());
        let keys: Vec<_> = answer.problems.iter().map(|problem| problem.key.as_str()).collect();
        assert!(keys.contains(&"matching.frequency_hz") && keys.contains(&"matching.session_s"));
        assert!(answer.text.contains("0.2 to 3") || answer.text.contains("5 to 600"), "{answer:?}");
    }
}
