//! Loop and writer thread of the logger, stepped in every order. What they share is linearizable
//! (rtrb's queue, channels, counters of one word), so that an interleaving of whole steps is
//! what two threads can do; a step is a call of the loop, or a turn of the writer thread.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::cell::Cell;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use ipc_types::{Event, Message, Process, event_topic};
use recording::mcap_write::{Output, Start, WriteError, Writer};

use crate::recorder_front_end::{Outcome, RecorderFrontEnd, StartRequest};
use crate::writer_queue::HEADER_BYTES;
use crate::writer_thread::{Disk, Opener, Turn};

/// A disk that keeps nothing.
struct Nowhere;

impl Write for Nowhere {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        Ok(data.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Output for Nowhere {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[derive(Clone, Copy, Debug)]
enum Step {
    /// A message comes.
    Push,
    /// A recording is asked for.
    Start,
    /// The next part is asked for.
    Split,
    /// Its end is asked for.
    Stop,
    /// The loop looks for a report.
    Poll,
    /// The writer thread turns once.
    Turn,
}

const STEPS: [Step; 6] = [Step::Push, Step::Start, Step::Split, Step::Stop, Step::Poll, Step::Turn];
/// Steps after the first start, before which nothing is recorded, unless `FARREACH_DEPTH` says
/// another number.
const LENGTH: u32 = 5;
/// Room for one message on its way.
const QUEUE_BYTES: usize = HEADER_BYTES + size_of::<Event>();

/// What the interleavings have tried.
#[derive(Debug, Default)]
struct Tried {
    written: u64,
    dropped: u64,
    not_started: u64,
    stopped: u64,
    split: u64,
    not_split: u64,
}

/// The loop's side, and what it knows of the recording in progress.
struct Run {
    front: RecorderFrontEnd,
    topic: usize,
    messages: u64,
    /// Messages since the recording was asked for.
    offered: u64,
    /// Messages in its parts that have ended.
    in_parts: u64,
}

impl Run {
    /// Asks for a recording; whether that was not refused.
    fn start(&mut self) -> bool {
        let path = Path::new("/data/run.mcap").to_owned();
        let begun = self.front.start(StartRequest { path, ..StartRequest::default() }).is_ok();
        if begun {
            self.offered = 0;
            self.in_parts = 0;
        }
        begun
    }

    fn push(&mut self) {
        let mut event = Event::default();
        event.stamp(1, 2, self.messages, 1_000 + self.messages);
        self.messages += 1;
        self.front.push(self.topic, event.as_bytes());
        self.offered += u64::from(self.front.recording());
    }

    /// No more is accounted for than was offered, whatever the writer thread does meanwhile.
    fn account(&self) {
        let losses = self.front.losses(self.topic);
        let told = losses.written + losses.refused + losses.dropped;
        assert!(told <= losses.received, "{losses:?}");
    }

    fn poll(&mut self, tried: &mut Tried) -> bool {
        let before = self.front.losses(self.topic);
        let Some(outcome) = self.front.poll() else { return false };
        match outcome {
            Outcome::Started { .. } => assert!(self.front.recording()),
            Outcome::NotStarted { .. } => tried.not_started += 1,
            Outcome::NextPart { ended, .. } => {
                let ended = ended.unwrap();
                assert_eq!(ended.refused, 0);
                self.in_parts += ended.written;
                tried.split += 1;
            }
            Outcome::NotSplit { .. } => tried.not_split += 1,
            Outcome::Stopped(summary) => {
                // Everything that was pushed before the stop is in the file, or was dropped.
                assert_eq!(summary.refused, 0);
                assert_eq!(self.in_parts + summary.written, before.written);
                tried.stopped += 1;
                tried.written += summary.written;
                tried.dropped += before.dropped;
            }
            other => panic!("{other:?}"),
        }
        true
    }
}

/// One interleaving; `fails` says which of the files cannot be created.
fn run(length: u32, mut steps: usize, fails: u32, tried: &mut Tried) {
    let (front, mut end) = RecorderFrontEnd::unattended(QUEUE_BYTES);
    let asked = Cell::new(0);
    let opener: Opener = Box::new(move |path: &Path, start: &Start, now_ns| {
        let number = asked.replace(asked.get() + 1);
        match fails >> number & 1 {
            0 => Writer::to_output(Box::new(Nowhere), path, start, now_ns),
            _ => {
                let source = io::ErrorKind::PermissionDenied.into();
                Err(WriteError::Create { path: path.to_owned(), source })
            }
        }
    });
    let mut disk = Disk::new(&mut end, None, &opener);
    let event = event_topic(Process::Control).unwrap();
    let topic = ipc_types::TOPICS.iter().position(|of| of.name == event.topic.name).unwrap();
    let mut run = Run { front, topic, messages: 0, offered: 0, in_parts: 0 };
    let mut pushed_before_stop = None;
    run.start();
    for _ in 0..length {
        match STEPS[steps % STEPS.len()] {
            Step::Push => run.push(),
            Step::Start => {
                if run.start() {
                    pushed_before_stop = None;
                }
            }
            Step::Split => {
                let _refused = run.front.split(BTreeMap::new());
            }
            Step::Stop => {
                if run.front.stop().is_ok() {
                    pushed_before_stop = Some(run.offered);
                }
            }
            Step::Poll => {
                let _found = run.poll(tried);
            }
            Step::Turn => assert_ne!(disk.turn(), Turn::Ended),
        }
        run.account();
        steps /= STEPS.len();
    }
    // Both go on until nothing is left to do.
    while disk.turn() == Turn::Worked {
        run.account();
    }
    while run.poll(tried) {}
    run.account();
    assert_eq!(run.front.queued(), 0);
    let losses = run.front.losses(topic);
    if let Some(pushed) = pushed_before_stop.filter(|_| !run.front.recording()) {
        // Stopped, or never started: then nothing is written.
        let told = losses.written + losses.dropped + losses.refused;
        assert!(told == pushed, "{pushed} pushed: {losses:?}");
    }
}

fn has_split(length: u32, steps: usize) -> bool {
    let count = STEPS.len();
    (0..length).any(|at| matches!(STEPS[steps / count.pow(at) % count], Step::Split))
}

#[test]
fn in_every_interleaving_each_message_is_written_or_counted_once() {
    let mut tried = Tried::default();
    let depth = std::env::var("FARREACH_DEPTH").ok().and_then(|text| text.parse().ok());
    let length = depth.unwrap_or(LENGTH);
    let mut interleavings = 0;
    // Those with a split are a step shorter: there are three times as many. The first file can be
    // created, or not; so can the second, where one is asked for.
    for (length, split, fails) in
        [(length, false, &[0b0, 0b1][..]), (length.saturating_sub(1), true, &[0b0, 0b1, 0b10][..])]
    {
        for steps in (0..STEPS.len().pow(length)).filter(|of| has_split(length, *of) == split) {
            for fails in fails {
                run(length, steps, *fails, &mut tried);
                interleavings += 1;
            }
        }
    }
    println!("{interleavings} interleavings: {tried:?}");
    let Tried { written, dropped, not_started, stopped, split, not_split } = tried;
    let all = [written, dropped, not_started, stopped, split, not_split];
    assert!(all.iter().all(|count| *count > 10));
}
