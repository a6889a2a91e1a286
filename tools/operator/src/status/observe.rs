//! Listening for a moment to what the processes say.

use std::time::{Duration, Instant};

use ipc_types::{
    COMMAND, EnableToken, Heartbeat, LOSS, LoopTiming, LossCounters, Message, MotorCommand,
    Process, Profile, SAMPLE, Sample, TOKEN, heartbeat_topic, timing_topic,
};
use runtime::{Domain, PortError, clock::now_ns};

use crate::link::Subscriber;
use crate::{Error, RigLink};

/// Least time of listening: rates are measured over it.
const LEAST: Duration = Duration::from_millis(300);
/// Most time: what is published once a second has come by then.
const MOST: Duration = Duration::from_millis(1200);
/// The fast topics' buffers hold more than comes in between.
const EVERY: Duration = Duration::from_millis(20);

/// One look.
#[derive(Clone, Debug)]
pub struct Observation {
    /// When it ended (ns, `CLOCK_MONOTONIC`).
    pub now_ns: u64,
    /// Session of the rig.
    pub session: u64,
    /// Profile of the rig.
    pub profile: Profile,
    /// Newest sample.
    pub sample: Option<Sample>,
    /// Newest token.
    pub token: Option<EnableToken>,
    /// Messages a second, of the processes with a fast topic.
    pub rates: Vec<(Process, f64)>,
    /// When each process with a fast topic published last.
    pub last_words: Vec<(Process, u64)>,
    /// Newest timing of each periodic process.
    pub timings: Vec<LoopTiming>,
    /// Newest heartbeat of each slow process.
    pub heartbeats: Vec<Heartbeat>,
    /// Newest counters of each topic.
    pub losses: Vec<LossCounters>,
}

impl Observation {
    /// Age of something that was published at that time (ms).
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

    /// Messages a second (Hz); `None` where there were not two.
    fn rate_hz(&self) -> Option<f64> {
        let messages = self.last.0.saturating_sub(self.first.0);
        let time_ns = self.last.1.saturating_sub(self.first.1);
        (messages > 0 && time_ns > 0).then(|| messages as f64 * 1e9 / time_ns as f64)
    }
}

/// Reads one topic for its newest message and its rate.
struct Follower<T> {
    reader: Subscriber<T>,
    newest: Option<T>,
    span: Span,
}

impl<T: Message> Follower<T> {
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

/// Subscribed to what tells how a rig is.
pub struct Observer {
    samples: Follower<Sample>,
    commands: Follower<MotorCommand>,
    tokens: Follower<EnableToken>,
    timings: Vec<Follower<LoopTiming>>,
    heartbeats: Vec<Follower<Heartbeat>>,
    losses: Subscriber<LossCounters>,
    loss: Vec<LossCounters>,
}

impl Observer {
    /// Subscribes.
    ///
    /// # Errors
    /// When all places of subscribers are taken.
    pub fn new(link: &RigLink) -> Result<Self, Error> {
        let timings = Process::ALL.iter().filter_map(|process| timing_topic(*process));
        let heartbeats = Process::ALL.iter().filter_map(|process| heartbeat_topic(*process));
        Ok(Self {
            samples: Follower::new(link.subscriber(SAMPLE)?),
            commands: Follower::new(link.subscriber(COMMAND)?),
            tokens: Follower::new(link.subscriber(TOKEN)?),
            timings: timings
                .map(|topic| Ok(Follower::new(link.subscriber(topic)?)))
                .collect::<Result<_, Error>>()?,
            heartbeats: heartbeats
                .map(|topic| Ok(Follower::new(link.subscriber(topic)?)))
                .collect::<Result<_, Error>>()?,
            losses: link.subscriber(LOSS)?,
            loss: Vec::new(),
        })
    }

    /// Listens for 0.3 s, and up to 1.2 s for what is published once a second.
    ///
    /// # Errors
    /// When a port does not work any more.
    pub fn observe(&mut self, domain: &Domain) -> Result<Observation, Error> {
        let started = Instant::now();
        self.begin();
        loop {
            self.read()?;
            let listened = started.elapsed();
            if listened >= MOST || (listened >= LEAST && self.has_all()) {
                break;
            }
            std::thread::sleep(EVERY);
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
            sample: self.samples.newest,
            token: self.tokens.newest,
            rates: fast
                .iter()
                .filter_map(|(process, span)| Some((*process, span.rate_hz()?)))
                .collect(),
            last_words: fast
                .iter()
                .filter(|(_, span)| span.last.1 > 0)
                .map(|(p, span)| (*p, span.last.1))
                .collect(),
            timings: self.timings.iter().filter_map(|follower| follower.newest).collect(),
            heartbeats: self.heartbeats.iter().filter_map(|follower| follower.newest).collect(),
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
        self.timings.iter_mut().try_for_each(Follower::read)?;
        self.heartbeats.iter_mut().try_for_each(Follower::read)?;
        while let Some(loss) = self.losses.take()? {
            match self.loss.iter_mut().find(|known| known.topic == loss.topic) {
                Some(known) => *known = loss,
                None => self.loss.push(loss),
            }
        }
        Ok(())
    }

    fn has_all(&self) -> bool {
        self.samples.newest.is_some()
            && self.tokens.newest.is_some()
            && self.timings.iter().all(|follower| follower.newest.is_some())
            && self.heartbeats.iter().all(|follower| follower.newest.is_some())
            && !self.loss.is_empty()
    }
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
