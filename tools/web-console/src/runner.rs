//! The thread that plays protocols: as a client of the experiment process, whose lease it renews.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Receiver;

use ipc_types::{EventKind, LoggerRequest, SessionProgress, Severity};
use operator::{
    ChosenProtocol, Progress, RigLink, RunOptions, RunOutcome, SessionFiles, resume_protocol,
    run_protocol,
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

/// What is told when it has begun, or why it has not.
pub(crate) type Begun = oneshot::Sender<Result<(), String>>;

/// The thread.
pub(crate) struct Runner {
    pub(crate) rig: RigName,
    pub(crate) shared: Arc<Shared>,
    pub(crate) state: RunStateFile,
    pub(crate) reports: std::sync::mpsc::Sender<ReportRequest>,
}

impl Runner {
    /// Goes on with the protocol that a console before played, then plays those that are ordered.
    pub(crate) fn serve(self, orders: &Receiver<(Order, Begun)>) {
        self.resume();
        while let Ok((order, begun)) = orders.recv() {
            let mut begun = Some(begun);
            let result = match order {
                Order::Home => self.home(&mut begun),
                Order::Experiment(built) => self.play(&built, &mut begun),
            };
            if let Err(error) = result {
                let text = format!("{error:#}");
                match begun.take() {
                    Some(begun) => drop(begun.send(Err(text))),
                    None => self.over(false, &text),
                }
            }
        }
    }

    fn home(&self, begun: &mut Option<Begun>) -> anyhow::Result<()> {
        let link = RigLink::open(&self.rig)?;
        let axes = operator::rig_of(&self.rig)?.axes.len();
        let protocol = Some(rig::home_protocol(axes).into());
        let options = RunOptions { protocol, ..RunOptions::default() };
        let chosen = ChosenProtocol::new(&options)?;
        let stop = self.begin(chosen.protocol(), "");
        let outcome = run_protocol(&link, &chosen, &stop, &mut |progress| {
            tell(begun);
            self.follow(progress);
        });
        self.end();
        let mut found = outcome_text(&outcome?);
        if found.0 {
            found.1 = "the stops were found, and the handle is at the centre".to_owned();
        }
        self.over(found.0, &found.1);
        Ok(())
    }

    fn play(&self, built: &Built, begun: &mut Option<Begun>) -> anyhow::Result<()> {
        let link = RigLink::open(&self.rig)?;
        let protocol = built.chosen.protocol();
        let files = built.files.as_deref();
        let mut files = files.map(|name| SessionFiles::new(&link, protocol, name)).transpose()?;
        self.state.save(&RunState {
            client: built.chosen.client(),
            protocol: protocol.text().to_owned(),
            subject: built.subject.clone(),
            files: files.as_ref().zip(built.files.clone()).map(|(files, name)| Files {
                name,
                recording: files.recording().to_owned(),
                since_ns: files.since_ns(),
            }),
        })?;
        let stop = self.begin(protocol, &built.subject);
        let mut over = 0;
        let outcome = run_protocol(&link, &built.chosen, &stop, &mut |progress| {
            tell(begun);
            self.session_over(&link, progress.sessions.as_ref(), &mut over);
            if let Some(files) = &mut files {
                files.see(progress.sessions.as_ref());
            }
            self.follow(progress);
        });
        self.finish(&link, outcome, files, begun.is_none())
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
        if let Err(error) = self.resume_with(&state) {
            self.state.remove();
            self.end();
            self.over(false, &format!("the protocol was not resumed: {error:#}"));
        }
    }

    fn resume_with(&self, state: &RunState) -> anyhow::Result<()> {
        let protocol = Protocol::parse(&state.protocol, "protocol")?;
        let stop = self.begin(&protocol, &state.subject);
        // First of all the lease.
        let link = RigLink::open(&self.rig)?;
        let sessions = protocol.sequence().filter(|(_, segment)| segment.session).count() as u32;
        let mut files = state.files.as_ref().map(|Files { name, recording, since_ns }| {
            SessionFiles::resume(recording, sessions, name, *since_ns)
        });
        if let (Some(files), Some(Files { name, .. })) = (&files, &state.files) {
            self.add_files(files.earlier(name).into_iter().map(Ok).collect());
        }
        let text = "the console goes on with the protocol that it played before";
        let mut told = false;
        let mut over = 0;
        let outcome = resume_protocol(&link, state.client, &stop, &mut |progress| {
            if !std::mem::replace(&mut told, true) {
                self.shared.event(EventKind::ProtocolResumed, Severity::Warning, [0.0; 3], text);
            }
            self.session_over(&link, progress.sessions.as_ref(), &mut over);
            if let Some(files) = &mut files {
                files.see(progress.sessions.as_ref());
            }
            self.follow(progress);
        });
        self.finish(&link, outcome, files, true)
    }

    /// Shows that a protocol is being played; the flag that ends it.
    fn begin(&self, protocol: &Protocol, subject: &str) -> Arc<AtomicBool> {
        let stop = Arc::new(AtomicBool::new(false));
        let mut desk = self.shared.desk();
        desk.playing = Some(Playing {
            name: protocol.name.clone(),
            subject: subject.to_owned(),
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

    /// Has the list of sessions made anew when one is over.
    fn session_over(&self, link: &RigLink, sessions: Option<&SessionProgress>, over: &mut u32) {
        let now = sessions.map_or(0, |sessions| sessions.over);
        if now > *over {
            *over = now;
            self.ask_for_reports(link);
        }
    }

    fn ask_for_reports(&self, link: &RigLink) {
        let recording = link.logger(&LoggerRequest::Status).ok().and_then(|it| it.recording);
        if let Some(recording) = recording {
            // The thread ends with the process.
            let _asked = self.reports.send(ReportRequest { recording: recording.into() });
        }
    }

    /// The protocol has ended: what remains are the files.
    fn finish(
        &self,
        link: &RigLink,
        outcome: Result<RunOutcome, operator::Error>,
        files: Option<SessionFiles>,
        begun: bool,
    ) -> anyhow::Result<()> {
        self.end();
        let completed = matches!(outcome, Ok(RunOutcome::Completed { .. }));
        if begun {
            self.ask_for_reports(link);
            let (well, text) = match &outcome {
                Ok(outcome) => outcome_text(outcome),
                Err(error) => (false, error.to_string()),
            };
            self.over(well, &text);
            if let Some(files) = files {
                self.add_files(files.finish(completed));
            }
            self.ask_for_reports(link);
        }
        self.state.remove();
        if begun { Ok(()) } else { outcome.map(|_| ()).map_err(Into::into) }
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
