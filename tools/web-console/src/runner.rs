//! The thread that plays protocols: as a client of the experiment process, whose lease it renews.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Receiver;

use ipc_types::{EventKind, ExperimentRequest, PulseSource, SessionProgress, Severity};
use operator::{
    ChosenProtocol, Progress, RigLink, RunOptions, RunOutcome, SessionFiles, resume_protocol,
    run_protocol, sessions_of,
};
use rig::protocol::Protocol;
use runtime::RigName;
use tokio::sync::oneshot;

use crate::desk::{Built, Playing, Shared, planned};
use crate::run_state::{Files, RunState, RunStateFile};
use crate::session_list::ReportRequest;

/// A protocol to play.
pub(crate) enum Order {
    /// The one that finds the stops.
    Home,
    /// The one that was built.
    Experiment(Arc<Built>),
}

/// Whose a protocol is that the console plays.
#[derive(Clone, Copy, Debug)]
struct Of<'a> {
    /// Number of the client.
    client: u64,
    /// Whether the key 5 is a pulse of the scanner.
    takes_keys: bool,
    /// Code of the subject; may be empty.
    subject: &'a str,
}

impl<'a> Of<'a> {
    fn new(chosen: &ChosenProtocol, subject: &'a str) -> Self {
        let takes_keys = *chosen.pulses() == PulseSource::Key;
        Self { client: chosen.client(), takes_keys, subject }
    }
}

/// What is told when it has begun, or why it has not.
pub(crate) type Begun = oneshot::Sender<Result<(), String>>;

/// An order as it waits for the thread.
pub(crate) struct Ordered {
    pub(crate) order: Order,
    pub(crate) begun: Begun,
    /// Stops that were asked for when it was given.
    pub(crate) stops: u64,
}

/// The thread.
pub(crate) struct Runner {
    pub(crate) rig: RigName,
    pub(crate) shared: Arc<Shared>,
    pub(crate) state: RunStateFile,
    pub(crate) reports: std::sync::mpsc::Sender<ReportRequest>,
}

impl Runner {
    /// Goes on with the protocol that a console before played, then plays those that are ordered.
    pub(crate) fn serve(self, orders: &Receiver<Ordered>) {
        self.resume();
        while let Ok(Ordered { order, begun, stops }) = orders.recv() {
            // Nobody waits for it any more, or somebody asked for a stop since.
            if begun.is_closed() || self.shared.desk().stops != stops {
                let _told = begun.send(Err("it was stopped before it began".to_owned()));
                continue;
            }
            let mut begun = Some(begun);
            let result = match order {
                Order::Home => self.home(stops, &mut begun),
                Order::Experiment(built) => self.play(&built, stops, &mut begun),
            };
            if let Err(error) = result {
                self.end();
                let text = format!("{error:#}");
                match begun.take() {
                    Some(begun) => drop(begun.send(Err(text))),
                    None => self.over(false, &text),
                }
            }
        }
    }

    fn home(&self, stops: u64, begun: &mut Option<Begun>) -> anyhow::Result<()> {
        let link = RigLink::open(&self.rig)?;
        let axes = operator::rig_of(&self.rig)?.axes.len();
        let protocol = Some(rig::home_protocol(axes).into());
        let options = RunOptions { protocol, ..RunOptions::default() };
        let chosen = ChosenProtocol::new(&options)?;
        let stop = self.begin(chosen.protocol(), Of::new(&chosen, ""), stops);
        let outcome = run_protocol(&link, &chosen, &stop, &mut |progress| {
            tell(begun);
            self.follow(progress);
        });
        self.end();
        let outcome = outcome?;
        tell(begun);
        let mut found = outcome_text(&outcome);
        if found.0 {
            found.1 = "the stops were found, and the handle is at the centre".to_owned();
        }
        self.over(found.0, &found.1);
        Ok(())
    }

    fn play(&self, built: &Built, stops: u64, begun: &mut Option<Begun>) -> anyhow::Result<()> {
        let protocol = built.chosen.protocol();
        let of = Of::new(&built.chosen, &built.subject);
        let stop = self.begin(protocol, of, stops);
        let link = RigLink::open(&self.rig)?;
        let files = built.files.as_deref();
        let mut files =
            files.map(|name| SessionFiles::new(&link, &built.chosen, name)).transpose()?;
        let mut state = RunState {
            client: of.client,
            takes_keys: of.takes_keys,
            protocol: protocol.text().to_owned(),
            subject: built.subject.clone(),
            over_before: built.chosen.continues().unwrap_or(0),
            files: files.as_ref().zip(built.files.clone()).map(|(files, name)| Files {
                name,
                recording: files.recording().to_owned(),
                since_ns: files.since_ns(),
            }),
            completed: None,
        };
        self.state.save(&state)?;
        let mut over = state.over_before;
        let outcome = run_protocol(&link, &built.chosen, &stop, &mut |progress| {
            tell(begun);
            self.session_over(progress.sessions.as_ref(), &mut over);
            if let Some(files) = &mut files {
                files.see(progress.sessions.as_ref());
            }
            self.follow(progress);
        });
        if outcome.is_ok() {
            // It may have ended before its first progress.
            tell(begun);
        }
        self.finish(&mut state, outcome, files, begun.is_none())
    }

    /// Goes on with what the console before this one played.
    fn resume(&self) {
        let state = match self.state.load() {
            Ok(Some(state)) => state,
            Ok(None) => return,
            Err(error) => {
                self.state.remove();
                return self.over(false, &format!("{error:#}"));
            }
        };
        if let Err(error) = self.resume_with(state) {
            self.state.remove();
            self.end();
            self.over(false, &format!("the protocol was not resumed: {error:#}"));
        }
    }

    fn resume_with(&self, mut state: RunState) -> anyhow::Result<()> {
        let protocol = Protocol::parse(&state.protocol, "protocol")?;
        let link = RigLink::open(&self.rig)?;
        let sessions = sessions_of(&protocol);
        let mut files = state.files.as_ref().map(|Files { name, recording, since_ns }| {
            SessionFiles::resume(recording, state.over_before..sessions, name, *since_ns)
        });
        if let (Some(files), Some(Files { name, .. })) = (&files, &state.files) {
            self.add_files(files.earlier(state.over_before, name).map(Ok).collect());
        }
        if let Some(completed) = state.completed {
            // It has ended. A stop that did not arrive is asked for again; the lease is not
            // renewed.
            if !completed {
                let request = ExperimentRequest::Stop { client: Some(state.client) };
                let _stopped = link.experiment(&request);
            }
            self.write_files(files, completed);
            self.state.remove();
            return Ok(());
        }
        // A statement of its own: `begin` locks it again.
        let stops = self.shared.desk().stops;
        let RunState { client, takes_keys, subject, .. } = &state;
        let of = Of { client: *client, takes_keys: *takes_keys, subject };
        let stop = self.begin(&protocol, of, stops);
        let text = "the console goes on with the protocol that it played before";
        let mut told = false;
        let mut over = state.over_before;
        let outcome = resume_protocol(&link, state.client, &stop, &mut |progress| {
            if !std::mem::replace(&mut told, true) {
                self.shared.event(EventKind::ProtocolResumed, Severity::Warning, [0.0; 3], text);
            }
            self.session_over(progress.sessions.as_ref(), &mut over);
            if let Some(files) = &mut files {
                files.see(progress.sessions.as_ref());
            }
            self.follow(progress);
        });
        self.finish(&mut state, outcome, files, true)
    }

    /// Shows that a protocol is being played; the flag that ends it, raised already if a stop was
    /// asked for since there were so many `stops`.
    fn begin(&self, protocol: &Protocol, of: Of<'_>, stops: u64) -> Arc<AtomicBool> {
        let mut desk = self.shared.desk();
        let stop = Arc::new(AtomicBool::new(desk.stops != stops));
        desk.playing = Some(Playing {
            name: protocol.name.clone(),
            subject: of.subject.to_owned(),
            client: of.client,
            takes_keys: of.takes_keys,
            segments: planned(protocol),
            progress: Progress::default(),
            stop: Arc::clone(&stop),
        });
        desk.last = None;
        self.shared.show(&desk);
        stop
    }

    fn follow(&self, progress: &Progress) {
        if let Some(playing) = &mut self.shared.desk().playing {
            playing.progress = progress.clone();
        }
    }

    /// Has the list of sessions made anew when one is over. This thread renews a lease and must not
    /// wait for the logger: another one does.
    fn session_over(&self, sessions: Option<&SessionProgress>, over: &mut u32) {
        let now = sessions.map_or(0, |sessions| sessions.over);
        if now > *over {
            *over = now;
            // The thread ends with the process.
            let _asked = self.reports.send(ReportRequest);
        }
    }

    /// The protocol has ended: what remains are the files.
    fn finish(
        &self,
        state: &mut RunState,
        outcome: Result<RunOutcome, operator::Error>,
        files: Option<SessionFiles>,
        begun: bool,
    ) -> anyhow::Result<()> {
        let completed = matches!(outcome, Ok(RunOutcome::Completed { .. }));
        // Before anything else: a console that is killed now must not go on with it.
        state.completed = Some(completed);
        let saved = self.state.save(state);
        self.end();
        if begun {
            let (well, text) = match &outcome {
                Ok(outcome) => outcome_text(outcome),
                Err(error) => (false, error.to_string()),
            };
            self.over(well, &text);
            self.write_files(files, completed);
        }
        self.state.remove();
        saved?;
        if begun { Ok(()) } else { outcome.map(|_| ()).map_err(Into::into) }
    }

    /// Waits for the files that are still being written. Nothing is started meanwhile.
    fn write_files(&self, files: Option<SessionFiles>, completed: bool) {
        let _asked = self.reports.send(ReportRequest);
        if let Some(files) = files {
            self.shared.desk().finishing = true;
            self.add_files(files.finish(completed));
            self.shared.desk().finishing = false;
        }
        let _asked = self.reports.send(ReportRequest);
    }

    fn add_files(&self, written: Vec<operator::Written>) {
        let mut desk = self.shared.desk();
        for file in written {
            if let Err(error) = &file {
                let text = format!("{error:#}");
                self.shared.event(EventKind::DataLost, Severity::Error, [1.0, 0.0, 0.0], &text);
            }
            desk.files.push(
                file.map(|path| path.display().to_string()).map_err(|error| format!("{error:#}")),
            );
        }
        self.shared.show(&desk);
    }

    fn end(&self) {
        let mut desk = self.shared.desk();
        desk.playing = None;
        desk.running = None;
        self.shared.show(&desk);
    }

    fn over(&self, well: bool, text: &str) {
        self.shared.desk().last = Some((well, text.to_owned()));
    }
}

/// Tells, once, that the protocol has begun.
fn tell(begun: &mut Option<Begun>) {
    if let Some(begun) = begun.take() {
        // The page that asked may be gone.
        let _told = begun.send(Ok(()));
    }
}

/// How a protocol ended, and whether that was well.
fn outcome_text(outcome: &RunOutcome) -> (bool, String) {
    match outcome {
        RunOutcome::Completed { elapsed_s } => {
            (true, format!("the protocol ran to its end, {elapsed_s:.1} s"))
        }
        RunOutcome::Stopped { elapsed_s } => {
            (false, format!("the protocol was stopped after {elapsed_s:.1} s"))
        }
        RunOutcome::Tripped { state, cause, faults } => {
            let mut text = format!("the protocol ended: the rig is {state}, cause: {cause}");
            for fault in faults {
                text += &format!(", active: {fault}");
            }
            (false, text)
        }
    }
}
