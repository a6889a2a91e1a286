//! A page's WebSocket: what it is told, what it asks for, its rights and its limits.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::{Duration, Instant};

use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt as _, StreamExt as _};
use ipc_types::{EventKind, Severity};
use runtime::clock::now_ns;
use serde_json::json;
use tokio::sync::{broadcast, mpsc, oneshot};
use tokio::time::{interval, timeout};

use crate::access::WRONG_TOKENS;
use crate::board::{Audience, Slot};
use crate::commands::{Answer, Command};
use crate::desk::Shared;
use crate::page_clock::PageClock;
use crate::request::{self, Level, Queue, Request};
use crate::rig_view::SOUNDS;

/// Messages a second that a page may send, over the long run.
const RATE: f64 = 50.0;
/// Messages that it may send at once.
const BURST: f64 = 200.0;
/// Requests of a page that may wait for their answers.
const WAITING: usize = 16;
/// A page that does not take a message within this time is gone.
const SEND_LIMIT: Duration = Duration::from_secs(5);
/// Period of the exchanges of time.
const CLOCK_PERIOD: Duration = Duration::from_secs(1);
/// How often the page's clock and the delay of its frames are recorded.
const RECORDED_EVERY: Duration = Duration::from_secs(10);
/// A page that says nothing for so long is gone.
const SILENCE_LIMIT: Duration = Duration::from_secs(15);
/// How long the rest of what a page sent is read where it can no longer be written to. It is there
/// already.
const REST_LIMIT: Duration = Duration::from_millis(200);

/// Which page it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The operator's.
    Operator,
    /// The subject's.
    Subject,
}

impl Kind {
    const fn text(self) -> &'static str {
        match self {
            Self::Operator => "operator",
            Self::Subject => "subject",
        }
    }

    const fn slots(self) -> &'static [Slot] {
        match self {
            Self::Operator => &[Slot::State, Slot::Bar, Slot::Plan, Slot::Status, Slot::Sessions],
            Self::Subject => &[Slot::Bar],
        }
    }

    fn hears(self, audience: Audience) -> bool {
        audience == Audience::All || self == Self::Operator
    }
}

/// What every page's task has.
#[derive(Clone)]
pub(crate) struct Pages {
    pub(crate) shared: Arc<Shared>,
    /// The first message to a page: what does not change.
    pub(crate) welcome: Utf8Bytes,
    /// Queues of the threads that carry commands out.
    pub(crate) power: SyncSender<Command>,
    pub(crate) stop: SyncSender<Command>,
    pub(crate) key: SyncSender<Command>,
    pub(crate) other: SyncSender<Command>,
    /// Numbers of the pages.
    pub(crate) numbers: Arc<AtomicU64>,
    /// Pages that are open.
    pub(crate) open: Arc<AtomicU64>,
}

/// What a page asks for, and its limits.
struct Page {
    number: u64,
    kind: Kind,
    pages: Pages,
    clock: PageClock,
    /// The time that was sent and not answered yet (ms, as bits); 0 for none.
    asked_ms: Arc<AtomicU64>,
    /// Messages that it may send yet.
    allowance: f64,
    counted: Instant,
    wrong_tokens: u32,
    answers: mpsc::Sender<Utf8Bytes>,
    recorded: Instant,
}

/// Serves a page until it closes, breaks a rule, or does not listen. Reading never waits for
/// writing: a page whose line is full can stop the rig.
pub(crate) async fn serve(socket: WebSocket, kind: Kind, from: String, pages: Pages) {
    let number = pages.numbers.fetch_add(1, Ordering::Relaxed) + 1;
    let shared = Arc::clone(&pages.shared);
    let values = [number as f64, 0.0, 0.0];
    let text = format!("{} page from {from}", kind.text());
    shared.event(EventKind::PageOpened, Severity::Info, values, &text);
    let subject_pages = u64::from(kind == Kind::Subject);
    shared.subject_pages.fetch_add(subject_pages, Ordering::Relaxed);
    let (answers, mut answered) = mpsc::channel(WAITING);
    let asked_ms = Arc::new(AtomicU64::new(0));
    let mut page = Page {
        number,
        kind,
        pages,
        clock: PageClock::default(),
        asked_ms: Arc::clone(&asked_ms),
        allowance: BURST,
        counted: Instant::now(),
        wrong_tokens: 0,
        answers,
        recorded: Instant::now(),
    };
    let (mut writing, mut reading) = socket.split();
    let first = [page.pages.welcome.clone(), page.greeting()];
    let end = tokio::select! {
        end = page.listen(&mut reading) => end,
        end = talk(&mut writing, kind, &shared, first, &mut answered, &asked_ms) => {
            // A page that went may have sent an emergency stop before: it is carried out, although
            // writing to the page fails first.
            let _ended = timeout(REST_LIMIT, page.listen(&mut reading)).await;
            end
        }
    };
    if let Err(reason) = end {
        // It is told why before it is cut off.
        while let Ok(answer) = answered.try_recv() {
            let _sent = send(&mut writing, answer).await;
        }
        let reason = Utf8Bytes::from(reason);
        let close = Message::Close(Some(CloseFrame { code: close_code::POLICY, reason }));
        let _sent = timeout(SEND_LIMIT, writing.send(close)).await;
    }
    shared.subject_pages.fetch_sub(subject_pages, Ordering::Relaxed);
    let had_control = shared.access().leave(number);
    let text = if had_control { "it had control" } else { "" };
    shared.event(EventKind::PageClosed, Severity::Info, values, text);
    page.pages.open.fetch_sub(1, Ordering::Relaxed);
}

/// Tells a page what it is to know.
///
/// # Errors
/// Why the connection is closed from here.
async fn talk(
    writing: &mut SplitSink<WebSocket, Message>,
    kind: Kind,
    shared: &Shared,
    first: [Utf8Bytes; 2],
    answered: &mut mpsc::Receiver<Utf8Bytes>,
    asked_ms: &AtomicU64,
) -> Result<(), &'static str> {
    let mut reader = shared.board.reader();
    for message in first {
        send(writing, message).await?;
    }
    let mut clock = interval(CLOCK_PERIOD);
    loop {
        for change in shared.board.changes(&mut reader, kind.slots()) {
            send(writing, change).await?;
        }
        tokio::select! {
            changed = reader.changed.changed() => {
                // The board lives as long as the process.
                if changed.is_err() { return Ok(()) }
            }
            told = reader.feed.recv() => match told {
                Ok((audience, text)) if kind.hears(audience) => send(writing, text).await?,
                Ok(_) => {}
                Err(broadcast::error::RecvError::Lagged(count)) => shared.lose(count),
                Err(broadcast::error::RecvError::Closed) => return Ok(()),
            },
            Some(answer) = answered.recv() => send(writing, answer).await?,
            _ = clock.tick() => {
                let server_ms = now_ms();
                asked_ms.store(server_ms.to_bits(), Ordering::Relaxed);
                let message = json!({ "type": "clock", "server_ms": server_ms });
                send(writing, message.to_string().into()).await?;
            }
        }
    }
}

impl Page {
    /// # Errors
    /// Why the connection is closed from here.
    async fn listen(&mut self, reading: &mut SplitStream<WebSocket>) -> Result<(), &'static str> {
        loop {
            // A page answers the clock once a second.
            let Ok(received) = timeout(SILENCE_LIMIT, reading.next()).await else {
                return Err("the page is silent");
            };
            match received {
                Some(Ok(Message::Text(text))) => self.take(text.as_str())?,
                Some(Ok(Message::Binary(_))) => {
                    self.pages.shared.lose(1);
                    return Err("expected text");
                }
                Some(Ok(Message::Close(_))) | None => return Ok(()),
                // It is gone, or its message was too long.
                Some(Err(_)) => {
                    self.pages.shared.lose(1);
                    return Ok(());
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => self.count()?,
            }
        }
    }

    /// What this page is, and may.
    fn greeting(&self) -> Utf8Bytes {
        let access = self.pages.shared.access();
        let token = access.check(self.number, Level::Token).is_ok();
        json!({ "type": "access", "page": self.number, "token": token }).to_string().into()
    }

    /// Counts a message.
    fn count(&mut self) -> Result<(), &'static str> {
        let passed_s = self.counted.elapsed().as_secs_f64();
        self.counted = Instant::now();
        self.allowance = (self.allowance + passed_s * RATE).min(BURST) - 1.0;
        if self.allowance < 0.0 {
            self.pages.shared.lose(1);
            return Err("too many messages");
        }
        Ok(())
    }

    fn take(&mut self, text: &str) -> Result<(), &'static str> {
        self.count()?;
        let message = match request::parse(text) {
            Ok(message) => message,
            Err((id, error)) => {
                self.pages.shared.lose(1);
                self.answer(id, &Answer::refused(error));
                return Ok(());
            }
        };
        let (id, request) = (message.id, message.request);
        match &request {
            Request::Echo { server_ms, page_ms } => {
                // Once, and only what was sent: the rest is no measurement.
                if self.asked_ms.swap(0, Ordering::Relaxed) == server_ms.to_bits() {
                    self.clock.exchange(*server_ms, *page_ms, now_ms());
                    self.record_clock();
                }
            }
            Request::Shown { at_ms, page_ms } => self.clock.shown(*at_ms, *page_ms),
            Request::Sounded { event, at_ms, page_ms } => self.sounded(event, *at_ms, *page_ms),
            Request::Hello { token } => {
                let shown = self.pages.shared.access().hello(self.number, token);
                if shown.is_err() {
                    self.wrong_tokens += 1;
                }
                self.answer(
                    id,
                    &match shown {
                        Ok(()) => Answer::done("this page may control the rig"),
                        Err(error) => Answer::refused(error),
                    },
                );
                let greeting = self.greeting();
                self.put(greeting);
                if self.wrong_tokens >= WRONG_TOKENS {
                    return Err("too many wrong tokens");
                }
            }
            _ => self.command(id, request),
        }
        Ok(())
    }

    /// Records that the subject's page made a sound, as far as that can have been.
    fn sounded(&self, event: &str, at_ms: f64, page_ms: f64) {
        let kind = SOUNDS.into_iter().find(|kind| kind.text() == event);
        let delay_ms = self.clock.delay_ms(at_ms, page_ms);
        let (Kind::Subject, Some(kind), Some(delay_ms)) = (self.kind, kind, delay_ms) else {
            return self.pages.shared.lose(1);
        };
        let values = [self.number as f64, delay_ms / 1e3, 0.0];
        self.pages.shared.event(EventKind::SoundPlayed, Severity::Info, values, kind.text());
    }

    /// Has a command carried out, if the page may give it.
    fn command(&self, id: u64, request: Request) {
        let allowed = self.pages.shared.access().check(self.number, request.level());
        if let Err(reason) = allowed {
            return self.answer(id, &Answer::refused(reason));
        }
        if request == Request::TakeControl {
            let before = self.pages.shared.access().take_control(self.number);
            let values = [self.number as f64, 0.0, 0.0];
            let text = before.map_or_else(String::new, |page| format!("from page {page}"));
            self.pages.shared.event(EventKind::ControlTaken, Severity::Info, values, &text);
            return self.answer(id, &Answer::done("this page has control"));
        }
        let at_ns = match &request {
            Request::Pulse { page_ms } => match self.clock.monotonic_ns(*page_ms) {
                Some(at_ns) => at_ns,
                None => {
                    let text = "the key 5 was not counted: the page's clock is not known yet";
                    return self.answer(id, &Answer::refused(text));
                }
            },
            _ => now_ns(),
        };
        let queue = match request.queue() {
            Queue::Power => &self.pages.power,
            Queue::Stop => &self.pages.stop,
            Queue::Key => &self.pages.key,
            Queue::Other => &self.pages.other,
        };
        let (answer, answered) = oneshot::channel();
        match queue.try_send(Command { page: self.number, request, at_ns, answer }) {
            Ok(()) => {
                let answers = self.answers.clone();
                tokio::spawn(async move {
                    let answer = answered.await.unwrap_or_else(|_| {
                        Answer::refused("the console ended before it was done")
                    });
                    let _sent = answers.send(as_message(id, &answer)).await;
                });
            }
            Err(TrySendError::Full(_)) => {
                self.pages.shared.lose(1);
                self.answer(id, &Answer::refused("too many requests are waiting; try again"));
            }
            Err(TrySendError::Disconnected(_)) => {
                self.answer(id, &Answer::refused("the console is ending"));
            }
        }
    }

    fn answer(&self, id: u64, answer: &Answer) {
        self.put(as_message(id, answer));
    }

    /// Puts a message in front of the page.
    fn put(&self, message: Utf8Bytes) {
        // A page that asks faster than it listens misses answers.
        if self.answers.try_send(message).is_err() {
            self.pages.shared.lose(1);
        }
    }

    /// Records the page's clock now and then, and tells the operators the delay of the frames.
    fn record_clock(&mut self) {
        if self.recorded.elapsed() < RECORDED_EVERY {
            return;
        }
        self.recorded = Instant::now();
        let shared = &self.pages.shared;
        let Some(estimate) = self.clock.estimate() else { return };
        let number = self.number as f64;
        let values = [number, estimate.offset_ms / 1e3, estimate.round_trip_ms / 1e3];
        shared.event(EventKind::ClockMeasured, Severity::Info, values, self.kind.text());
        let delay = self.clock.delay();
        if let Some(delay) = delay {
            let values = [number, delay.median_ms / 1e3, delay.longest_ms / 1e3];
            let text = format!("{} page, {} frames", self.kind.text(), delay.frames);
            shared.event(EventKind::FrameDelay, Severity::Info, values, &text);
        }
        let message = json!({
            "type": "page-clock",
            "page": self.number,
            "kind": self.kind.text(),
            "offset_ms": estimate.offset_ms,
            "round_trip_ms": estimate.round_trip_ms,
            "delay_ms": delay.map(|delay| delay.median_ms),
            "longest_ms": delay.map(|delay| delay.longest_ms),
            "frames": delay.map(|delay| delay.frames),
        });
        shared.board.tell(Audience::Operators, &message);
    }
}

fn as_message(id: u64, answer: &Answer) -> Utf8Bytes {
    json!({ "type": "answer", "id": id, "answer": answer }).to_string().into()
}

async fn send(
    writing: &mut SplitSink<WebSocket, Message>,
    text: Utf8Bytes,
) -> Result<(), &'static str> {
    match timeout(SEND_LIMIT, writing.send(Message::Text(text))).await {
        Ok(Ok(())) => Ok(()),
        // It is gone, or does not listen any more.
        Ok(Err(_)) | Err(_) => Err("the page does not listen"),
    }
}

/// `CLOCK_MONOTONIC` (ms).
pub(crate) fn now_ms() -> f64 {
    now_ns() as f64 / 1e6
}
