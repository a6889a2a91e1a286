//! The worker thread of iterative learning, for everything that takes time, allocates or accesses
//! the disk. It exchanges boxes with the loop through single-producer, single-consumer rings;
//! neither waits for the other.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

use ipc_types::{Event, EventKind, Process, Severity};
use learning::store::LearntReference;
use rtrb::{Consumer, Producer, RingBuffer};
use runtime::Worker;

use crate::ilc_trial::{IlcResult, Returned};
use crate::ilc_update::{IlcError, IlcState, IlcUpdater};
use crate::player::{IlcJob, Program};
use crate::trial_record::TrialRecord;

use super::thread_link::{Dropped, EVENT_CAPACITY};

/// Polling period: short against the settling cycle of a block.
const POLL_PERIOD: Duration = Duration::from_millis(10);
/// Capacity for jobs; a block causes two or three.
const JOBS: usize = 64;
/// Capacity for results; one for each record.
const RESULTS: usize = 16;

/// The loop's end.
#[derive(Debug)]
pub(super) struct IlcWorker {
    pub(super) jobs: Producer<IlcJob>,
    pub(super) results: Consumer<IlcResult>,
    /// Events to publish.
    pub(super) events: Consumer<Event>,
    worker: Worker,
}

impl IlcWorker {
    /// Starts the thread. `file` holds the state for a restart, `learnt` is the folder of learnt
    /// references.
    pub(super) fn open(
        session: u64,
        file: PathBuf,
        learnt: PathBuf,
        fifo: bool,
        dropped: Dropped,
    ) -> io::Result<Self> {
        let (jobs, job_out) = RingBuffer::new(JOBS);
        let (result_in, results) = RingBuffer::new(RESULTS);
        let (event_in, events) = RingBuffer::new(EVENT_CAPACITY);
        let mut state = WorkerState {
            session,
            file,
            learnt,
            jobs: job_out,
            results: result_in,
            events: event_in,
            dropped,
            ilc: None,
            unsaved: None,
        };
        let worker = Worker::spawn("experiment-learn", move |ending| {
            runtime::realtime::request_helper(fifo);
            while !ending.load(Ordering::Relaxed) {
                state.work();
                std::thread::sleep(POLL_PERIOD);
            }
            state.work();
        })?;
        Ok(Self { jobs, results, events, worker })
    }

    /// Whether the thread is gone, which it should not be.
    pub(super) fn is_closed(&self) -> bool {
        self.worker.is_closed()
    }
}

/// The learning run in progress.
#[derive(Debug)]
struct ActiveIlc {
    run_id: u32,
    protocol: u64,
    updater: IlcUpdater,
    saved: bool,
}

#[derive(Debug)]
struct WorkerState {
    session: u64,
    file: PathBuf,
    learnt: PathBuf,
    jobs: Consumer<IlcJob>,
    results: Producer<IlcResult>,
    events: Producer<Event>,
    dropped: Dropped,
    ilc: Option<ActiveIlc>,
    /// State to be saved for a restart.
    unsaved: Option<IlcState>,
}

impl WorkerState {
    fn work(&mut self) {
        while let Ok(job) = self.jobs.pop() {
            match job {
                IlcJob::Begin { run_id, program, segment, resumed } => {
                    self.begin(run_id, &program, segment, resumed)
                }
                IlcJob::Returned(Returned::Record(record)) => self.update(record),
                IlcJob::Returned(Returned::Reference(reference)) => drop(reference),
                IlcJob::End(ilc) => self.end(ilc.run_id()),
            }
        }
        self.save_state();
    }

    /// Saves the state of the learning run once the loop has published all its events: a block that
    /// is saved is never reported again.
    fn save_state(&mut self) {
        if self.events.slots() < EVENT_CAPACITY {
            return;
        }
        if let Some(kept) = self.unsaved.take()
            && let Err(reason) = write(&self.file, &kept)
        {
            let text = format!("{}: {reason}; a restart would learn anew", self.file.display());
            self.report(EventKind::DataLost, Severity::Warning, kept.segment, &text);
        }
    }

    fn begin(&mut self, run_id: u32, program: &Program, segment: u32, resumed: bool) {
        (self.ilc, self.unsaved) = (None, None);
        let kept = if resumed { self.restore(program.identity(), segment) } else { None };
        if kept.is_none() {
            // The state of an earlier run must not be restored into this one.
            let _none = fs::remove_file(&self.file);
        }
        let begun = match program.plan(segment as usize) {
            Some(plan) => load(plan, &self.learnt)
                .and_then(|loaded| IlcUpdater::new(plan.as_ref().clone(), segment, loaded, kept)),
            None => return,
        };
        match begun {
            Ok(updater) => {
                let result = updater.ready(run_id);
                self.ilc =
                    Some(ActiveIlc { run_id, protocol: program.identity(), updater, saved: false });
                self.send_result(result);
            }
            Err(error) => {
                self.report(
                    EventKind::ProtocolStopped,
                    Severity::Error,
                    segment,
                    &error.to_string(),
                );
                self.send_result(IlcResult::failed(run_id));
            }
        }
    }

    /// The state that an earlier process, or this one before a pause, saved.
    fn restore(&mut self, protocol: u64, segment: u32) -> Option<IlcState> {
        let found = match fs::read(&self.file) {
            Ok(bytes) => IlcState::decode(&bytes).map_err(|error| error.to_string()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err("no block was done when it was interrupted".to_owned())
            }
            Err(error) => Err(error.to_string()),
        };
        let found = found.and_then(|kept| {
            let run = (kept.session, kept.protocol, kept.segment);
            let other = || "the saved state belongs to another learning run".to_owned();
            (run == (self.session, protocol, segment)).then_some(kept).ok_or_else(other)
        });
        let (severity, text) = match &found {
            Ok(kept) => (Severity::Info, format!("learning goes on after block {}", kept.done)),
            Err(reason) => (Severity::Warning, format!("learning begins anew: {reason}")),
        };
        self.report(EventKind::ProtocolResumed, severity, segment, &text);
        found.ok()
    }

    fn update(&mut self, record: Box<TrialRecord>) {
        let Some(active) = self.ilc.as_mut().filter(|active| active.run_id == record.run_id) else {
            return;
        };
        let updated = active.updater.update(&record);
        let run_id = active.run_id;
        let kept = active.updater.state(self.session, active.protocol);
        // The reference first: the loop waits for it alone.
        self.send_result(IlcResult::updated(record, updated.reference));
        if updated.failed {
            self.send_result(IlcResult::failed(run_id));
        }
        self.publish(updated.event);
        self.unsaved = kept;
        if updated.ended.is_some() {
            self.publish(updated.ended);
            self.save();
        }
    }

    fn end(&mut self, run_id: u32) {
        let Some(active) = self.ilc.as_mut().filter(|active| active.run_id == run_id) else {
            return;
        };
        let event = active.updater.stop();
        let stopped = event.is_some();
        self.publish(event);
        if stopped && self.has_better() {
            let segment = self.ilc.as_ref().map_or(0, |active| active.updater.segment());
            self.report(
                EventKind::LearningEnded,
                Severity::Info,
                segment,
                "the reference saved before is better, and stays",
            );
        } else {
            self.save();
        }
        (self.ilc, self.unsaved) = (None, None);
        let _none = fs::remove_file(&self.file);
    }

    /// Whether the file of that name holds a reference for the same machine and movement with a
    /// smaller error: half a learning run must not replace a whole one.
    fn has_better(&self) -> bool {
        let Some(active) = &self.ilc else { return false };
        let plan = active.updater.plan();
        let (Some(name), Some(Ok(best))) = (&plan.learn().save, active.updater.best()) else {
            return false;
        };
        LearntReference::load(path_of(&self.learnt, name), &plan.scope)
            .is_ok_and(|kept| kept.error < best.error)
    }

    /// Saves the best reference under the protocol's name for it, once.
    fn save(&mut self) {
        let Some(active) = self.ilc.as_mut().filter(|active| !active.saved) else { return };
        let learn = active.updater.plan().learn();
        let Some(name) = learn.save.clone() else { return };
        let segment = active.updater.segment();
        active.saved = true;
        let Some(best) = active.updater.best() else { return };
        let path = path_of(&self.learnt, &name);
        let done = fs::create_dir_all(&self.learnt)
            .map_err(|error| format!("{}: {error}", self.learnt.display()))
            .and_then(|()| {
                best.and_then(|best| best.save(&path)).map_err(|error| error.to_string())
            });
        let (severity, text) = match done {
            Ok(()) => (Severity::Info, format!("reference kept as \"{name}\"")),
            Err(reason) => (Severity::Error, format!("reference \"{name}\" not kept: {reason}")),
        };
        self.report(EventKind::LearningEnded, severity, segment, &text);
    }

    fn report(&mut self, kind: EventKind, severity: Severity, segment: u32, text: &str) {
        let event = Event::new(Process::Experiment, kind, severity, text);
        self.publish(Some(Event {
            a: f64::from(segment),
            b: f64::NAN,
            c: f64::NAN,
            segment,
            ..event
        }));
    }

    fn publish(&mut self, event: Option<Event>) {
        if let Some(event) = event
            && self.events.push(event).is_err()
        {
            self.dropped.count();
            eprintln!("farreach experiment: event lost: {}", event.text());
        }
    }

    fn send_result(&mut self, result: IlcResult) {
        if self.results.push(result).is_err() {
            self.dropped.count();
            eprintln!("farreach experiment: the loop does not take the results of learning");
        }
    }
}

/// Where a learnt reference is.
fn path_of(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.learnt"))
}

fn load(
    plan: &crate::ilc_update::Plan,
    folder: &Path,
) -> Result<Option<LearntReference>, IlcError> {
    let Some(name) = &plan.learn().load else { return Ok(None) };
    let refused = |source| IlcError::Load { name: name.clone(), source };
    LearntReference::load(path_of(folder, name), &plan.scope).map(Some).map_err(refused)
}

/// Checks that every reference a program loads exists, except those that an earlier segment saves.
pub(super) fn find_references(program: &Program, folder: &Path) -> Result<(), String> {
    let mut saved = Vec::new();
    for segment in 0..program.segments() {
        let Some(plan) = program.plan(segment) else { continue };
        let learn = plan.learn();
        if learn.load.as_ref().is_some_and(|name| !saved.contains(&name)) {
            load(plan, folder).map_err(|error| format!("segment {segment}: {error}"))?;
        }
        saved.extend(&learn.save);
    }
    Ok(())
}

fn write(path: &Path, state: &IlcState) -> Result<(), String> {
    let bytes = state.encode().map_err(|error| error.to_string())?;
    files::replace(path, bytes).map_err(|error| error.to_string())
}
