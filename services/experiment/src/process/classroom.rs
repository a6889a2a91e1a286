//! The thread that teaches: everything about a lesson that takes time, allocates, or touches the
//! disk. The loop and it pass each other boxes through rings of one writer and one reader; neither
//! waits.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

use ipc_types::{Event, EventKind, Process, Severity};
use learning::store::LearntReference;
use rtrb::{Consumer, Producer, RingBuffer};
use runtime::Worker;

use crate::lesson::{Lecture, Spent, Take};
use crate::player::{Homework, Program};
use crate::teacher::{Kept, LessonError, Teacher};

use super::link::{Dropped, EVENTS};
use super::whole_file;

/// How often it looks for homework: short against the settling cycle of a block.
const NAP: Duration = Duration::from_millis(2);
/// Pieces of homework under way: a block brings two or three.
const HOMEWORK: usize = 64;
/// Answers under way: one for each record.
const LECTURES: usize = 16;

/// The loop's end.
#[derive(Debug)]
pub(super) struct Classroom {
    homework: Producer<Homework>,
    lectures: Consumer<Lecture>,
    events: Consumer<Event>,
    worker: Worker,
}

impl Classroom {
    /// Starts the thread. `file` is for what a restart needs, `learnt` the folder of learnt
    /// references.
    pub(super) fn open(
        session: u64,
        file: PathBuf,
        learnt: PathBuf,
        fifo: bool,
        dropped: Dropped,
    ) -> io::Result<Self> {
        let (homework, homework_out) = RingBuffer::new(HOMEWORK);
        let (lecture_in, lectures) = RingBuffer::new(LECTURES);
        let (event_in, events) = RingBuffer::new(EVENTS);
        let mut room = Room {
            session,
            file,
            learnt,
            homework: homework_out,
            lectures: lecture_in,
            events: event_in,
            dropped,
            lesson: None,
            unkept: None,
        };
        let worker = Worker::spawn("experiment-learn", move |ending| {
            runtime::realtime::request_helper(fifo);
            while !ending.load(Ordering::Relaxed) {
                room.work();
                std::thread::sleep(NAP);
            }
            room.work();
        })?;
        Ok(Self { homework, lectures, events, worker })
    }

    /// Hands over; returns it where the thread is far behind.
    pub(super) fn give(&mut self, homework: Homework) -> Option<Homework> {
        self.homework.push(homework).err().map(|rtrb::PushError::Full(homework)| homework)
    }

    /// The next answer.
    pub(super) fn lecture(&mut self) -> Option<Lecture> {
        self.lectures.pop().ok()
    }

    /// The next thing to be told to all.
    pub(super) fn event(&mut self) -> Option<Event> {
        self.events.pop().ok()
    }

    /// Whether the thread is gone, which it should not be.
    pub(super) fn is_closed(&self) -> bool {
        self.worker.is_closed()
    }
}

/// The lesson that is being taught.
#[derive(Debug)]
struct Class {
    ticket: u32,
    protocol: u64,
    teacher: Teacher,
    saved: bool,
}

#[derive(Debug)]
struct Room {
    session: u64,
    file: PathBuf,
    learnt: PathBuf,
    homework: Consumer<Homework>,
    lectures: Producer<Lecture>,
    events: Producer<Event>,
    dropped: Dropped,
    lesson: Option<Class>,
    /// What is to be kept for a restart.
    unkept: Option<Kept>,
}

impl Room {
    fn work(&mut self) {
        while let Ok(homework) = self.homework.pop() {
            match homework {
                Homework::Begin { ticket, program, segment, resumed } => {
                    self.begin(ticket, &program, segment, resumed)
                }
                Homework::Spent(Spent::Take(take)) => self.mark(take),
                Homework::Spent(Spent::Reference(reference)) => drop(reference),
                Homework::End(lesson) => self.end(lesson.ticket()),
            }
        }
        self.keep();
    }

    /// Keeps what the lesson knows, once the loop has told all of it: a block that is kept is never
    /// told again.
    fn keep(&mut self) {
        if self.events.slots() < EVENTS {
            return;
        }
        if let Some(kept) = self.unkept.take()
            && let Err(reason) = keep(&self.file, &kept)
        {
            let text = format!("{}: {reason}; a restart would learn anew", self.file.display());
            self.tell(EventKind::DataLost, Severity::Warning, kept.segment, &text);
        }
    }

    fn begin(&mut self, ticket: u32, program: &Program, segment: u32, resumed: bool) {
        (self.lesson, self.unkept) = (None, None);
        let kept = if resumed { self.take_up(program.identity(), segment) } else { None };
        if kept.is_none() {
            // Of an earlier run: it must not come back with this one's number.
            let _none = fs::remove_file(&self.file);
        }
        let begun = match program.plan(segment as usize) {
            Some(plan) => load(plan, &self.learnt)
                .and_then(|loaded| Teacher::new(plan.as_ref().clone(), segment, loaded, kept)),
            None => return,
        };
        match begun {
            Ok(teacher) => {
                let lecture = teacher.ready(ticket);
                self.lesson =
                    Some(Class { ticket, protocol: program.identity(), teacher, saved: false });
                self.say(lecture);
            }
            Err(error) => {
                self.tell(EventKind::ProtocolStopped, Severity::Error, segment, &error.to_string());
                self.say(Lecture::Failed { ticket });
            }
        }
    }

    /// What an earlier process, or this one before a pause, knew of the lesson.
    fn take_up(&mut self, protocol: u64, segment: u32) -> Option<Kept> {
        let found = match fs::read(&self.file) {
            Ok(bytes) => decode(&bytes),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err("no block was done when it was interrupted".to_owned())
            }
            Err(error) => Err(error.to_string()),
        };
        let found = found.and_then(|kept| {
            let same =
                (kept.session, kept.protocol, kept.segment) == (self.session, protocol, segment);
            if same { Ok(kept) } else { Err("what was kept is of another lesson".to_owned()) }
        });
        match found {
            Ok(kept) => {
                let text = format!("learning goes on after block {}", kept.done);
                self.tell(EventKind::ProtocolResumed, Severity::Info, segment, &text);
                Some(kept)
            }
            Err(reason) => {
                let text = format!("learning begins anew: {reason}");
                self.tell(EventKind::ProtocolResumed, Severity::Warning, segment, &text);
                None
            }
        }
    }

    fn mark(&mut self, mut take: Box<Take>) {
        let Some(class) = self.lesson.as_mut().filter(|class| class.ticket == take.ticket) else {
            return;
        };
        let marked = class.teacher.mark(&take);
        let ticket = class.ticket;
        // The reference first: the loop waits for nothing else.
        take.clear();
        let lecture = Lecture::Marked { ticket, take, reference: marked.reference };
        let kept = class.teacher.keep(self.session, class.protocol);
        self.say(lecture);
        if marked.failed {
            self.say(Lecture::Failed { ticket });
        }
        self.publish(marked.event);
        self.unkept = kept;
        if marked.ended.is_some() {
            self.publish(marked.ended);
            self.save();
        }
    }

    fn end(&mut self, ticket: u32) {
        let Some(class) = self.lesson.as_mut().filter(|class| class.ticket == ticket) else {
            return;
        };
        let event = class.teacher.stop();
        let stopped = event.is_some();
        self.publish(event);
        if stopped && self.has_better() {
            let segment = self.lesson.as_ref().map_or(0, |class| class.teacher.segment());
            self.tell(
                EventKind::LearningEnded,
                Severity::Info,
                segment,
                "the reference kept before is better, and stays",
            );
        } else {
            self.save();
        }
        (self.lesson, self.unkept) = (None, None);
        let _none = fs::remove_file(&self.file);
    }

    /// Whether the file under the lesson's name holds a reference for the same machine and movement
    /// with a smaller error: half a lesson shall not replace a whole one.
    fn has_better(&self) -> bool {
        let Some(class) = &self.lesson else { return false };
        let plan = class.teacher.plan();
        let (Some(name), Some(Ok(best))) = (&plan.learn().save, class.teacher.best()) else {
            return false;
        };
        LearntReference::load(path_of(&self.learnt, name), &plan.belongs)
            .is_ok_and(|kept| kept.error < best.error)
    }

    /// Keeps the best reference under the name that the protocol gives, once.
    fn save(&mut self) {
        let Some(class) = self.lesson.as_mut().filter(|class| !class.saved) else { return };
        let learn = class.teacher.plan().learn();
        let Some(name) = learn.save.clone() else { return };
        let segment = class.teacher.segment();
        class.saved = true;
        let Some(best) = class.teacher.best() else { return };
        let path = path_of(&self.learnt, &name);
        let done = fs::create_dir_all(&self.learnt)
            .map_err(|error| format!("{}: {error}", self.learnt.display()))
            .and_then(|()| {
                best.and_then(|best| best.save(&path)).map_err(|error| error.to_string())
            });
        match done {
            Ok(()) => {
                self.tell(
                    EventKind::LearningEnded,
                    Severity::Info,
                    segment,
                    &format!("reference kept as \"{name}\""),
                );
            }
            Err(reason) => {
                let text = format!("reference \"{name}\" not kept: {reason}");
                self.tell(EventKind::LearningEnded, Severity::Error, segment, &text);
            }
        }
    }

    fn tell(&mut self, kind: EventKind, severity: Severity, segment: u32, text: &str) {
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

    fn say(&mut self, lecture: Lecture) {
        if self.lectures.push(lecture).is_err() {
            self.dropped.count();
            eprintln!("farreach experiment: the loop does not listen to the lesson");
        }
    }
}

/// Where a learnt reference is.
fn path_of(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.learnt"))
}

fn load(
    plan: &crate::teacher::Plan,
    folder: &Path,
) -> Result<Option<LearntReference>, LessonError> {
    let Some(name) = &plan.learn().load else { return Ok(None) };
    let refused = |source| LessonError::Load { name: name.clone(), source };
    LearntReference::load(path_of(folder, name), &plan.belongs).map(Some).map_err(refused)
}

/// Whether all references are there that a program begins with, but for those that an earlier
/// segment of it learns.
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

/// Mark of the file with what a lesson knows, and its version. bincode is unmaintained; the version
/// lets another encoding take its place.
const MARK: [u8; 6] = *b"FRLS\x01\x00";
/// No lesson's memory is longer (bytes).
const LONGEST: usize = 16 << 20;

/// Writes it whole or not at all.
fn keep(path: &Path, kept: &Kept) -> Result<(), String> {
    let body = bincode::serde::encode_to_vec(kept, bincode::config::standard())
        .map_err(|error| error.to_string())?;
    let bytes = [&MARK[..], &rig::identity_of_bytes(&body).to_le_bytes(), &body].concat();
    whole_file::replace(path, &path.with_extension("lesson.new"), &bytes)
        .map_err(|error| error.to_string())
}

fn decode(bytes: &[u8]) -> Result<Kept, String> {
    let damaged = || "what was kept is damaged".to_owned();
    let body = bytes.strip_prefix(&MARK[..]).ok_or_else(damaged)?;
    let (checksum, body) = body.split_first_chunk::<8>().ok_or_else(damaged)?;
    if u64::from_le_bytes(*checksum) != rig::identity_of_bytes(body) {
        return Err(damaged());
    }
    let config = bincode::config::standard().with_limit::<LONGEST>();
    let (kept, _read) =
        bincode::serde::decode_from_slice(body, config).map_err(|error| error.to_string())?;
    Ok(kept)
}
