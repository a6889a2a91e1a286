//! Subscribes to the topics that show the state of a rig and collects their newest messages.

use std::time::{Duration, Instant};

use ipc_types::{
    COMMAND, EnableToken, Event, EventKind, Heartbeat, LOSS, LoopTiming, LossCounters, Message,
    MotorCommand, Process, SAMPLE, SCANNER, Sample, ScannerPulse, TOKEN, WatchdogState,
    event_topic, heartbeat_topic, timing_topic,
};
use runtime::{PortError, Subscriber, clock::now_ns};

use super::model::ModelReader;
use crate::{Error, RigLink};

/// Shortest observation: rates are measured over it.
const SHORTEST: Duration = Duration::from_millis(300);
/// Longest observation: every topic of 1 Hz has published by then.
const LONGEST: Duration = Duration::from_millis(1200);
/// Polling period; the subscribers' buffers hold more messages than arrive within it.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// Sequence and time of the first and the last message of one incarnation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Span {
    incarnation: u64,
    first: (u64, u64),
    last: (u64, u64),
}

impl Span {
    fn observe(&mut self, incarnation: u64, sequence: u64, time_ns: u64) {
        if self.incarnation != incarnation {
            *self = Self { incarnation, first: (sequence, time_ns), last: (sequence, time_ns) };
        }
        self.last = (sequence, time_ns);
    }

    /// Messages per second (Hz); `None` unless there were two.
    fn rate_hz(&self) -> Option<f64> {
        let messages = self.last.0.saturating_sub(self.first.0);
        let time_ns = self.last.1.saturating_sub(self.first.1);
        (messages > 0 && time_ns > 0).then(|| messages as f64 * 1e9 / time_ns as f64)
    }
}

/// Newest message and rate of one topic.
pub(super) struct Latest<T: Message> {
    reader: Subscriber<T>,
    pub(super) newest: Option<T>,
    span: Span,
}

impl<T: Message> Latest<T> {
    fn new(reader: Subscriber<T>) -> Self {
        Self { reader, newest: None, span: Span::default() }
    }

    /// Messages per second (Hz); `None` unless there were two.
    pub(super) fn rate_hz(&self) -> Option<f64> {
        self.span.rate_hz()
    }

    fn begin(&mut self) {
        self.span = Span::default();
        self.newest = None;
    }

    fn read(&mut self) -> Result<(), PortError> {
        while let Some(message) = self.reader.take()? {
            self.span.observe(message.incarnation(), message.sequence(), message.time_ns());
            self.newest = Some(message);
        }
        Ok(())
    }
}

/// Subscriptions to a rig's topics, and their newest messages.
pub(super) struct Observer {
    pub(super) samples: Latest<Sample>,
    commands: Latest<MotorCommand>,
    pub(super) tokens: Latest<EnableToken>,
    pub(super) pulses: Latest<ScannerPulse>,
    pub(super) model: ModelReader,
    timings: Vec<Latest<LoopTiming>>,
    heartbeats: Vec<Latest<Heartbeat>>,
    /// Of them those that every rig has.
    expected: usize,
    losses: Subscriber<LossCounters>,
    events: Option<Subscriber<Event>>,
    /// Newest counters of each topic.
    pub(super) loss: Vec<LossCounters>,
    /// When the watchdog last tripped or faulted (ns, `CLOCK_MONOTONIC`).
    pub(super) tripped_ns: Option<u64>,
    /// When the last observation ended (ns, `CLOCK_MONOTONIC`).
    pub(super) now_ns: u64,
}

impl Observer {
    /// Subscribes.
    ///
    /// # Errors
    /// If a topic has no slot for another subscriber.
    pub(super) fn new(link: &RigLink) -> Result<Self, Error> {
        let timings = Process::ALL.iter().filter_map(|process| timing_topic(*process));
        let optional = |process: &Process| process.entry().is_some_and(|entry| entry.optional);
        let (may, must): (Vec<Process>, Vec<Process>) =
            Process::ALL.iter().partition(|it| optional(it));
        let heartbeats = |of: Vec<Process>| of.into_iter().filter_map(heartbeat_topic);
        let must: Vec<_> = heartbeats(must).collect();
        Ok(Self {
            samples: Latest::new(link.subscriber(SAMPLE)?),
            commands: Latest::new(link.subscriber(COMMAND)?),
            tokens: Latest::new(link.subscriber(TOKEN)?),
            pulses: Latest::new(link.subscriber(SCANNER)?),
            model: ModelReader::new(link)?,
            timings: timings
                .map(|topic| Ok(Latest::new(link.subscriber(topic)?)))
                .collect::<Result<_, Error>>()?,
            expected: must.len(),
            heartbeats: must
                .into_iter()
                .chain(heartbeats(may))
                .map(|topic| Ok(Latest::new(link.subscriber(topic)?)))
                .collect::<Result<_, Error>>()?,
            losses: link.subscriber(LOSS)?,
            loss: Vec::new(),
            events: event_topic(Process::Watchdog)
                .map(|topic| link.subscriber(topic))
                .transpose()?,
            tripped_ns: None,
            now_ns: 0,
        })
    }

    /// Collects for 0.3 s, and up to 1.2 s until every topic of 1 Hz has published.
    ///
    /// # Errors
    /// If a subscription fails.
    pub(super) fn observe(&mut self) -> Result<(), Error> {
        let started = Instant::now();
        self.begin();
        loop {
            self.read()?;
            let listened = started.elapsed();
            if listened >= LONGEST || (listened >= SHORTEST && self.has_all()) {
                break;
            }
            std::thread::sleep(POLL_PERIOD);
        }
        self.now_ns = now_ns();
        Ok(())
    }

    /// Newest timing of each periodic process.
    pub(super) fn timings(&self) -> impl Iterator<Item = LoopTiming> {
        self.timings.iter().filter_map(|latest| latest.newest)
    }

    /// Newest heartbeat of each slow process.
    pub(super) fn heartbeats(&self) -> impl Iterator<Item = Heartbeat> {
        self.heartbeats.iter().filter_map(|latest| latest.newest)
    }

    /// The processes with a fast topic: messages per second (Hz), and when the last was published
    /// (ns, `CLOCK_MONOTONIC`).
    pub(super) fn fast(&self) -> [(Process, Option<f64>, Option<u64>); 3] {
        [
            (Process::Acquisition, self.samples.span),
            (Process::Control, self.commands.span),
            (Process::Watchdog, self.tokens.span),
        ]
        .map(|(process, span)| {
            (process, span.rate_hz(), Some(span.last.1).filter(|time_ns| *time_ns > 0))
        })
    }

    /// Age of a message that was published at `time_ns` (ms).
    pub(super) fn age_ms(&self, time_ns: u64) -> f64 {
        self.now_ns.saturating_sub(time_ns) as f64 / 1e6
    }

    fn begin(&mut self) {
        self.samples.begin();
        self.commands.begin();
        self.tokens.begin();
    }

    fn read(&mut self) -> Result<(), PortError> {
        self.samples.read()?;
        self.commands.read()?;
        self.tokens.read()?;
        self.timings.iter_mut().try_for_each(Latest::read)?;
        self.heartbeats.iter_mut().try_for_each(Latest::read)?;
        self.pulses.read()?;
        self.model.read()?;
        while let Some(loss) = self.losses.take()? {
            match self.loss.iter_mut().find(|known| known.topic == loss.topic) {
                Some(known) => *known = loss,
                None => self.loss.push(loss),
            }
        }
        while let Some(events) = &mut self.events
            && let Some(event) = events.take()?
        {
            if is_trip(&event) {
                self.tripped_ns = Some(event.time_ns);
            }
        }
        Ok(())
    }

    fn has_all(&self) -> bool {
        self.samples.newest.is_some()
            && self.tokens.newest.is_some()
            && self.timings.iter().all(|latest| latest.newest.is_some())
            && self.heartbeats[..self.expected].iter().all(|latest| latest.newest.is_some())
            && !self.loss.is_empty()
    }
}

/// Whether the watchdog latched power off.
fn is_trip(event: &Event) -> bool {
    let to = [WatchdogState::Tripped, WatchdogState::Faulted].map(|state| f64::from(state.code()));
    event.kind == EventKind::StateChanged.code() && to.contains(&event.b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_measured_within_one_incarnation() {
        let mut span = Span::default();
        assert_eq!(span.rate_hz(), None);
        span.observe(1, 9_000, 1_000_000_000);
        assert_eq!(span.rate_hz(), None);
        span.observe(2, 0, 2_000_000_000);
        span.observe(2, 100, 2_050_000_000);
        assert_eq!(span.rate_hz(), Some(2000.0));
    }
}
