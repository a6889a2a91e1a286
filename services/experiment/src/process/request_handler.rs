//! The thread that answers requests, reads protocols and keeps the state: everything that allocates
//! or waits. It has a node of its own, since ports stay in the thread that made them.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use ipc_types::{
    EXPERIMENT_COMMANDS, Event, EventKind, ExperimentAnswer, ExperimentRequest, InterruptedRun,
    Process, PulseSource, Severity,
};
use rig::RigFile;
use rig::protocol::Protocol;
use runtime::clock::{ClockPair, SECOND_NS, now_ns};
use runtime::{RigName, ServiceError, Worker};

use crate::interrupted::{Continuation, Interrupted, InterruptedFile};
use crate::player::{Change, Program};
use crate::scan_tracker::ScanState;
use crate::session_state::SessionStep;
use crate::state::PlayerState;

use super::current_protocol::Current;
use super::ilc_worker::find_references;
use super::interrupted_writer::InterruptedWriter;
use super::progress::Progress;
use super::thread_link::{ChangeReport, Order, RequestSide};

/// Longest time for the loop to take an order: it looks at each cycle.
const TAKE_LIMIT: Duration = Duration::from_secs(1);
/// How long a fresh `enable` may take to show in the watchdog's tokens.
const PERMISSION_LIMIT: Duration = Duration::from_millis(300);
/// Without a sample this young, nobody knows where the handle is (ns).
const SAMPLE_LIMIT_NS: u64 = SECOND_NS / 2;
/// A key that was pressed longer ago, or further in the future, is not counted (s).
const KEY_LIMIT_S: f64 = 2.0;
/// Why a protocol that counts volumes cannot be played.
const NO_TRIGGER: &str = "this protocol waits for the scanner or counts its volumes, and the rig \
                          has no trigger line: add a channel of kind \"trigger\" or [scanner] with \
                          `digital` to the rig file, or run with --scanner-key or \
                          --emulate-scanner TR";
/// Keys that are kept for a successor of the process: more than a scanner sends in a segment.
const KEYS_KEPT: usize = 4096;
/// Longest error in an answer (bytes).
const LONGEST_ERROR: usize = 32_768;

/// What the thread works with.
#[derive(Debug)]
pub(super) struct RequestHandler {
    pub(super) rig: RigFile,
    pub(super) session: u64,
    /// The state's file.
    pub(super) file: PathBuf,
    /// Folder of the learnt references.
    pub(super) learnt: PathBuf,
    /// What can be continued after the whole computer has died.
    pub(super) interrupted: InterruptedFile,
    pub(super) writer: InterruptedWriter,
    pub(super) link: RequestSide,
    pub(super) current: Option<Current>,
    /// Programs that the loop may still hold: the last one to let go frees the memory, and that
    /// must not be the loop.
    pub(super) retired: Vec<Arc<Program>>,
    /// Why the protocol ended early, or why its state could not be saved; otherwise empty.
    pub(super) trouble: String,
    pub(super) last_order: u32,
}

impl RequestHandler {
    /// Starts the thread; returns when it serves. Dropping the result saves the last change and
    /// ends the thread.
    pub(super) fn serve(self, rig: &RigName) -> Result<Worker, ServiceError> {
        Worker::serve(rig, EXPERIMENT_COMMANDS, self, Self::save_changes, Self::answer)
    }

    fn answer(&mut self, request: ExperimentRequest) -> ExperimentAnswer {
        let result = match request {
            ExperimentRequest::Check { protocol, name, pulses } => {
                // Why the last protocol ended does not concern this one.
                let error = self.check(&protocol, &name, &pulses).err();
                return ExperimentAnswer { error: cut(error.unwrap_or_default()), ..self.status() };
            }
            ExperimentRequest::Run { protocol, name, client, pulses } => {
                self.play(&protocol, &name, client, &pulses)
            }
            ExperimentRequest::Pulse { client, at_ns } => self.pulse(client, at_ns),
            ExperimentRequest::Interrupted => return self.interrupted_answer(),
            ExperimentRequest::Continue { client, protocol, segment } => {
                self.play_interrupted(client, protocol, segment)
            }
            ExperimentRequest::Renew { client } => self.renew(client),
            ExperimentRequest::Stop { client } => self.stop(client),
            ExperimentRequest::Status => Ok(()),
        };
        let mut answer = self.status();
        if let Err(error) = result {
            answer.error = cut(error);
        }
        answer
    }

    fn status(&self) -> ExperimentAnswer {
        let reading = self.link.progress.read();
        let program = self.current.as_ref().map(|current| &current.program);
        ExperimentAnswer {
            running: reading.running,
            name: program.map_or_else(String::new, |program| program.name().to_owned()),
            segment: reading.segment,
            label: program
                .map_or_else(String::new, |program| program.label(reading.segment as usize).into()),
            segments: program.map_or(0, |program| program.segments() as u32),
            elapsed_s: reading.elapsed_s,
            duration_s: program.map_or(0.0, |program| program.duration_s()),
            completed: reading.completed,
            permission_lost: reading.permission_lost,
            scan: reading.scan,
            sessions: self.current.as_ref().and_then(|c| c.progress(reading.completed)),
            interrupted: None,
            error: self.trouble.clone(),
        }
    }

    fn play(
        &mut self,
        text: &str,
        name: &str,
        client: u64,
        pulses: &PulseSource,
    ) -> Result<(), String> {
        let program = self.check(text, name, pulses)?;
        self.begin(program, client)
    }

    /// Has the loop play a program that was checked.
    fn begin(&mut self, program: Program, client: u64) -> Result<(), String> {
        let program = Arc::new(program);
        if !self.link.progress.read().enabled {
            // The token that shows a fresh `enable` may still be on its way.
            self.wait_until(PERMISSION_LIMIT, |link| link.progress.read().enabled)
                .map_err(|_| "the motor is not enabled: farreach reset, arm, enable".to_owned())?;
        }
        if let Err(reason) = find_references(&program, &self.learnt) {
            // In the recording, too: nothing is played, and why.
            self.publish(EventKind::ProtocolStopped, Severity::Error, &reason);
            return Err(reason);
        }
        self.save_changes();
        let order = self.next_order();
        self.retired.retain(|program| Arc::strong_count(program) > 1);
        self.retired.push(Arc::clone(&program));
        let current = Current::new(order, client, Arc::clone(&program));
        if let Some(event) = current.lost_session(program.first_segment()) {
            self.link.publish(event);
        }
        self.current = Some(current);
        self.trouble.clear();
        // Half of the time that the request waits: the loop has the other half to say that it has
        // taken the order, before the client is told that it has not.
        let take_ns = TAKE_LIMIT.as_nanos() as u64 / 2;
        let deadline_ns = now_ns().saturating_add(take_ns);
        self.order(order, Order::Play { number: order, program, deadline_ns })
    }

    /// The program of a protocol that could be played now, but for the motor's power: nobody shall
    /// power a rig for a protocol that it cannot play.
    fn check(&self, text: &str, name: &str, pulses: &PulseSource) -> Result<Program, String> {
        self.check_from(text, name, pulses, None)
    }

    /// A protocol that was interrupted, checked as [`Self::check`] does, to begin there.
    fn check_interrupted(&self, interrupted: &Interrupted) -> Result<Program, String> {
        let from = interrupted.continuation(&ClockPair::measure());
        let PlayerState { text, name, pulses, .. } = &interrupted.state;
        self.check_from(text, name, pulses, Some(from))
    }

    /// The protocol that was interrupted.
    fn read_interrupted(&self) -> Result<Interrupted, String> {
        let none = || "no protocol with sessions was interrupted".to_owned();
        self.interrupted.read()?.ok_or_else(none)
    }

    /// Plays the protocol that was interrupted, if it is the one that the client was told of.
    fn play_interrupted(&mut self, client: u64, protocol: u64, segment: u32) -> Result<(), String> {
        let interrupted = self.read_interrupted()?;
        let program = self.check_interrupted(&interrupted)?;
        let state = &interrupted.state;
        if (state.protocol, state.segment) != (protocol, segment) {
            let name = &state.name;
            return Err(format!("{name} was interrupted since: ask again what is to be continued"));
        }
        self.begin(program, client)
    }

    fn interrupted_answer(&self) -> ExperimentAnswer {
        let (interrupted, error) = match self.read_interrupted() {
            Ok(interrupted) => {
                let error = self.check_interrupted(&interrupted).err().unwrap_or_default();
                let state = interrupted.state;
                let run = InterruptedRun {
                    name: state.name,
                    protocol: state.text,
                    segment: state.segment,
                    sessions_over: state.sessions.over,
                    pulses: state.pulses,
                };
                (Some(run), error)
            }
            Err(error) => (None, error),
        };
        ExperimentAnswer { interrupted, error: cut(error), ..self.status() }
    }

    fn check_from(
        &self,
        text: &str,
        name: &str,
        pulses: &PulseSource,
        from: Option<Continuation>,
    ) -> Result<Program, String> {
        let protocol = Protocol::parse(text, name).map_err(|error| error.to_string())?;
        let program = Program::new(&protocol, &self.rig).map_err(|error| error.to_string())?;
        let program = program.with_pulses(pulses)?.with_maxima(&self.learnt, &self.rig)?;
        let program = match from {
            Some(from) => program.continuing(from)?,
            None => program,
        };
        if program.needs_trigger() && self.rig.scanner.is_none() {
            return Err(NO_TRIGGER.to_owned());
        }
        let reading = self.link.progress.read();
        if reading.running {
            return Err(self.busy());
        }
        if now_ns().saturating_sub(reading.sample_ns) > SAMPLE_LIMIT_NS {
            return Err(
                "no samples arrive, so the handle's position is unknown: is acquisition running? \
                        (`farreach status`)"
                    .to_owned(),
            );
        }
        self.check_homed(&program)?;
        self.check_handles(&program)?;
        Ok(program)
    }

    /// Refuses a protocol that moves an axis which is not homed.
    fn check_homed(&self, program: &Program) -> Result<(), String> {
        let Some((segment, axis)) = program.first_unhomed(self.link.progress.read().homed) else {
            return Ok(());
        };
        let name = self.rig.axes.get(axis).map_or("", |axis| &axis.name);
        Err(format!(
            "axis {axis} (\"{name}\") is not homed, and segment {segment} (\"{}\") needs it: run \
             `farreach run {}` first, or begin the protocol with an `initialise` segment of the \
             axis",
            program.label(segment),
            rig::home_protocol(self.rig.axes.len())
        ))
    }

    /// Refuses all but a search for the stops while a handle is beyond its range of motion: the
    /// watchdog would cut the power with the first volts.
    fn check_handles(&self, program: &Program) -> Result<(), String> {
        let beyond = self.link.progress.read().beyond_range;
        let first = self.rig.axes.iter().enumerate().find(|(at, _)| beyond & 1 << at != 0);
        let Some((at, axis)) = first.filter(|_| !program.searches()) else { return Ok(()) };
        // Without stops to be found, `home` does nothing for the axis.
        let or_home = axis.stop_search().map_or_else(String::new, |_| {
            format!(", or run `farreach run {}`", rig::home_protocol(self.rig.axes.len()))
        });
        Err(format!(
            "the handle of axis {at} (\"{}\") is beyond its range of motion \
             (axes.{at}.range_of_motion of the rig file): with nobody at the handle bring it back \
             at the motor{or_home}",
            axis.name
        ))
    }

    fn busy(&self) -> String {
        let name = self.current.as_ref().map_or("a protocol", |current| current.program.name());
        format!("{name} is running: wait for its end, or stop it with `farreach stop`")
    }

    fn belongs_to(&self, client: u64) -> bool {
        self.current.as_ref().is_some_and(|current| current.client == client)
    }

    fn renew(&mut self, client: u64) -> Result<(), String> {
        if self.belongs_to(client) {
            self.link.progress.renew(now_ns());
            return Ok(());
        }
        if self.link.progress.read().running {
            return Err(format!("this protocol has ended, and {}", self.busy()));
        }
        Err("this protocol has ended".to_owned())
    }

    /// Hands a pulse that was typed as the key 5 to the loop.
    fn pulse(&mut self, client: u64, at_ns: u64) -> Result<(), String> {
        let running = self.link.progress.read().running;
        let Some(current) = self.current.as_mut().filter(|_| running) else {
            return Err("the key 5 was not counted: no protocol is running".to_owned());
        };
        if current.client != client {
            return Err("the key 5 was not counted: the protocol belongs to another client".into());
        }
        if !current.program.takes_keys() {
            return Err(
                "the key 5 was not counted: this protocol takes its pulses from elsewhere \
                        (run it with --scanner-key)"
                    .to_owned(),
            );
        }
        let now_ns = now_ns();
        // The clock of a page is known to half a round trip: a little ahead is now.
        let off_s = (at_ns as f64 - now_ns as f64) * 1e-9;
        if !(-KEY_LIMIT_S..=KEY_LIMIT_S).contains(&off_s) {
            return Err(format!(
                "the key 5 was not counted: it was pressed {:.1} s {} by the clock of the page",
                off_s.abs(),
                if off_s > 0.0 { "in the future" } else { "ago" },
            ));
        }
        let at_ns = at_ns.min(now_ns);
        self.link.keys.push(at_ns).map_err(|_| {
            self.link.dropped.count();
            "the key 5 was not counted: too many wait".to_owned()
        })?;
        if current.keys.len() < KEYS_KEPT {
            current.keys.push(at_ns);
        }
        // At the latest here: a successor counts it, whenever this process dies.
        current.keys_saved = false;
        self.save_changes();
        Ok(())
    }

    fn stop(&mut self, client: Option<u64>) -> Result<(), String> {
        if !self.link.progress.read().running {
            return Err("no protocol is running".to_owned());
        }
        if client.is_some_and(|client| !self.belongs_to(client)) {
            return Err("the running protocol belongs to another client".to_owned());
        }
        let order = self.next_order();
        self.order(order, Order::Stop { number: order })?;
        // The loop stops with the cycle that follows.
        self.wait_until(TAKE_LIMIT, |link| !link.progress.read().running)
    }

    fn next_order(&mut self) -> u32 {
        self.last_order =
            if self.last_order == Progress::ORDER_MAX { 1 } else { self.last_order + 1 };
        self.last_order
    }

    fn order(&mut self, number: u32, order: Order) -> Result<(), String> {
        let late =
            || "the experiment's loop does not take orders: is the machine overloaded?".to_owned();
        self.link.orders.push(order).map_err(|_| late())?;
        self.wait_until(TAKE_LIMIT, |link| link.progress.read().order == number)
    }

    fn wait_until(
        &self,
        limit: Duration,
        done: impl Fn(&RequestSide) -> bool,
    ) -> Result<(), String> {
        let begun = Instant::now();
        while !done(&self.link) {
            if begun.elapsed() > limit {
                return Err(
                    "the experiment's loop did not react in time: see `farreach status`".to_owned()
                );
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }

    /// Saves the newest change that the loop has reported, and the end of a session.
    fn save_changes(&mut self) {
        let mut newest = None;
        while let Ok(note) = self.link.changes.pop() {
            newest = Some(note);
        }
        let mut session_over = false;
        while let Ok((order, step)) = self.link.steps.pop() {
            if let Some(current) = self.current.as_mut().filter(|current| current.order == order) {
                current.sessions.take(step);
                session_over |= matches!(step, SessionStep::Over(..));
            }
        }
        let Some(current) = &mut self.current else { return };
        let changed = newest.filter(|report| report.order == current.order);
        current.newest = changed.or(current.newest);
        if !current.maxima_saved && current.is_over() {
            current.maxima_saved = true;
            if let Some(event) = current.save_maxima(&self.learnt, &self.rig) {
                self.link.publish(event);
            }
        }
        let kept = changed.is_some() || session_over;
        let Some(ChangeReport { change, epoch, scan, .. }) =
            current.newest.filter(|_| kept || !current.keys_saved)
        else {
            return;
        };
        // What ends before its first step has not followed the scanner yet.
        let before = current.program.continues().map_or(scan, |from| from.scan);
        let scan = if scan == ScanState::default() { before } else { scan };
        current.keys.retain(|at_ns| *at_ns > scan.newest_ns());
        current.keys_saved = true;
        let (segment, running) = match change {
            Change::Started => (0, true),
            Change::Continued(segment) | Change::Segment(segment) | Change::Resumed(segment) => {
                (segment, true)
            }
            Change::Stopped(segment) | Change::Aborted(segment, _) => (segment, false),
            Change::Done => (current.program.segments().saturating_sub(1) as u32, false),
        };
        let client = current.client;
        let sessions = current.sessions.clone();
        let begun = current.program.state(self.session, epoch, client);
        let keys = current.keys.clone();
        let state = PlayerState { segment, running, scan, keys, sessions, ..begun };
        if kept {
            keep(&self.writer, &current.program, change, &state);
        }
        self.trouble = match save(&self.file, &state) {
            Ok(()) => match change {
                Change::Aborted(_, reason) => reason.text().to_owned(),
                _ => String::new(),
            },
            Err(reason) => {
                format!(
                    "{}: {reason}; the protocol would not go on after a restart",
                    self.file.display()
                )
            }
        };
        while let Some(reason) = self.writer.failure() {
            let text = "it could not be kept for `farreach run --continue`: ";
            self.publish(EventKind::DataLost, Severity::Warning, &format!("{text}{reason}"));
        }
    }

    /// Has the loop publish an event.
    fn publish(&mut self, kind: EventKind, severity: Severity, text: &str) {
        self.link.publish(Event::new(Process::Experiment, kind, severity, text));
    }
}

/// Keeps a protocol with sessions until it has run to its end.
fn keep(writer: &InterruptedWriter, program: &Program, change: Change, state: &PlayerState) {
    match change {
        _ if !program.can_be_continued() => {}
        Change::Done => writer.remove(),
        // What ends a protocol early leaves it where it was.
        _ => writer.keep(Interrupted::new(state.clone(), &ClockPair::measure())),
    }
}

/// An error that fits into an answer.
fn cut(mut error: String) -> String {
    if error.len() > LONGEST_ERROR {
        let mut end = LONGEST_ERROR;
        while !error.is_char_boundary(end) {
            end -= 1;
        }
        error.truncate(end);
    }
    error
}

/// Writes the state whole or not at all.
fn save(path: &Path, state: &PlayerState) -> Result<(), String> {
    let bytes = state.encode().map_err(|error| error.to_string())?;
    files::replace(path, bytes).map_err(|error| error.to_string())
}
