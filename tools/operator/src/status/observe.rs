//! Subscribes to the topics that show the state of a rig and collects their newest messages.

use std::time::{Duration, Instant};

use ipc_types::{
    COMMAND, EnableToken, Event, EventKind, Heartbeat, LOSS, LoopTiming, LossCounters, Message,
    MotorCommand, Process, Profile, SAMPLE, Sample, TOKEN, WatchdogState, event_topic,
    heartbeat_topic, timing_topic,
};
use runtime::{Domain, HostStall, PortError, Subscriber, clock::now_ns};

use crate::{Error, RigLink};

/// Shortest observation: rates are measured over it.
const SHORTEST: Duration = Duration::from_millis(300);
/// Longest observation: every topic of 1 Hz has published by then.
const LONGEST: Duration = Duration::from_millis(1200);
/// Polling period; the subscribers' buffers hold more messages than arrive within it.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// The newest messages of a rig.
#[derive(Clone, Debug)]
pub struct Observation {
    /// When it ended (ns, `CLOCK_MONOTONIC`).
    pub now_ns: u64,
    /// Session of the rig.
    pub session: u64,
    /// Profile of the rig.
    pub profile: Profile,
    /// Measured stalls of the host.
    pub host_stall: Option<HostStall>,
    /// Newest sample.
    pub sample: Option<Sample>,
    /// Newest token.
    pub token: Option<EnableToken>,
    /// When the watchdog last tripped or faulted (ns, `CLOCK_MONOTONIC`).
    pub tripped_ns: Option<u64>,
    /// Messages per second, of the processes with a fast topic.
    pub rates: Vec<(Process, f64)>,
    /// When each process with a fast topic published last (ns, `CLOCK_MONOTONIC`).
    pub last_messages: Vec<(Process, u64)>,
    /// Newest timing of each periodic process.
    pub timings: Vec<LoopTiming>,
    /// Newest heartbeat of each slow process.
    pub heartbeats: Vec<Heartbeat>,
    /// Newest counters of each topic.
    pub losses: Vec<LossCounters>,
}

impl Observation {
    /// Age of a message that was published at `time_ns` (ms).
    pub fn age_ms(&self, time_ns: u64) -> f64 {
        self.now_ns.saturating_sub(time_ns) as f64 / 1e6
    }
}

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
struct Latest<T: Message> {
    reader: Subscriber<T>,
    newest: Option<T>,
    span: Span,
}

impl<T: Message> Latest<T> {
    fn new(reader: Subscriber<T>) -> Self {
        Self { reader, newest: None, span: Span::default() }
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

/// Subscriptions to all that [`Observation`] holds.
pub struct Observer {
    samples: Latest<Sample>,
    commands: Latest<MotorCommand>,
    tokens: Latest<EnableToken>,
    timings: Vec<Latest<LoopTiming>>,
    heartbeats: Vec<Latest<Heartbeat>>,
    losses: Subscriber<LossCounters>,
    loss: Vec<LossCounters>,
    events: Option<Subscriber<Event>>,
    tripped_ns: Option<u64>,
}

impl Observer {
    /// Subscribes.
    ///
    /// # Errors
    /// If a topic has no slot for another subscriber.
    pub fn new(link: &RigLink) -> Result<Self, Error> {
        let timings = Process::ALL.iter().filter_map(|process| timing_topic(*process));
        let heartbeats = Process::ALL.iter().filter_map(|process| heartbeat_topic(*process));
        Ok(Self {
            samples: Latest::new(link.subscriber(SAMPLE)?),
            commands: Latest::new(link.subscriber(COMMAND)?),
            tokens: Latest::new(link.subscriber(TOKEN)?),
            timings: timings
                .map(|topic| Ok(Latest::new(link.subscriber(topic)?)))
                .collect::<Result<_, Error>>()?,
            heartbeats: heartbeats
                .map(|topic| Ok(Latest::new(link.subscriber(topic)?)))
                .collect::<Result<_, Error>>()?,
            losses: link.subscriber(LOSS)?,
            loss: Vec::new(),
            events: event_topic(Process::Watchdog)
                .map(|topic| link.subscriber(topic))
                .transpose()?,
            tripped_ns: None,
        })
    }

    /// Collects for 0.3 s, and up to 1.2 s until every topic of 1 Hz has published.
    ///
    /// # Errors
    /// If a subscription fails.
    pub fn observe(&mut self, domain: &Domain) -> Result<Observation, Error> {
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
        let fast = [
            (Process::Acquisition, self.samples.span),
            (Process::Control, self.commands.span),
            (Process::Watchdog, self.tokens.span),
        ];
        Ok(Observation {
            now_ns: now_ns(),
            session: domain.session(),
            profile: domain.profile(),
            host_stall: domain.host_stall(),
            sample: self.samples.newest,
            token: self.tokens.newest,
            tripped_ns: self.tripped_ns,
            rates: fast
                .iter()
                .filter_map(|(process, span)| Some((*process, span.rate_hz()?)))
                .collect(),
            last_messages: fast
                .iter()
                .filter(|(_, span)| span.last.1 > 0)
                .map(|(p, span)| (*p, span.last.1))
                .collect(),
            timings: self.timings.iter().filter_map(|latest| latest.newest).collect(),
            heartbeats: self.heartbeats.iter().filter_map(|latest| latest.newest).collect(),
            losses: self.loss.clone(),
        })
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
            && self.heartbeats.iter().all(|latest| latest.newest.is_some())
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
