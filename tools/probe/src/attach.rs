//! A running rig as a source of messages.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, anyhow};
use ipc_types::{TOPICS, Topic};
use runtime::clock::{MILLISECOND_NS, SECOND_NS, now_ns, sleep_until};
use runtime::{Domain, RawSubscriber, RigName, open_raw, realtime, stop_on};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::stream::{Arrived, Progress, Source, Stamp, Stream};

/// A keeper that is absent for longer was not merely restarted (ns).
const KEEPER_GONE_NS: u64 = 3 * SECOND_NS;
/// How often the probe checks that its rig is still up (ns).
const CHECK_PERIOD_NS: u64 = 100 * MILLISECOND_NS;

/// The topic of this name.
pub(crate) fn topic(name: &str) -> anyhow::Result<&'static Topic> {
    ipc_types::find_topic(name).with_context(|| {
        let names: Vec<_> = TOPICS.iter().map(|topic| topic.name).collect();
        format!("topic {name}: expected one of {}", names.join(", "))
    })
}

/// The topics of these names, each once; all if none is given.
///
/// # Errors
/// If there is no topic of one of the names.
pub fn topics(names: &[String]) -> anyhow::Result<Vec<&'static Topic>> {
    if names.is_empty() {
        return Ok(TOPICS.iter().collect());
    }
    let mut found: Vec<&'static Topic> = Vec::new();
    for name in names {
        let topic = topic(name)?;
        if !found.iter().any(|known| known.name == topic.name) {
            found.push(topic);
        }
    }
    Ok(found)
}

/// Subscription to one topic.
struct Feed {
    /// Most messages that wait for this probe.
    buffer: usize,
    subscriber: Box<dyn RawSubscriber>,
}

/// A rig to whose topics this probe subscribes, until a signal arrives or the rig goes down.
pub struct Attached {
    feeds: Vec<Feed>,
    streams: Vec<Stream>,
    since_ns: u64,
    stop: Arc<AtomicBool>,
    period_ns: u64,
    next_ns: u64,
    check_ns: u64,
    keeper_seen_ns: u64,
    domain: Domain,
}

impl Attached {
    /// Subscribes to topics, to be polled every `period_ns`.
    ///
    /// # Errors
    /// If there is no rig of that name, or a topic cannot be subscribed to.
    pub fn new(rig: &RigName, topics: &[&'static Topic], period_ns: u64) -> anyhow::Result<Self> {
        // SIGHUP: the terminal was closed.
        let stop = stop_on(&[SIGINT, SIGTERM, SIGHUP])?;
        let domain = Domain::observe(rig)?;
        let node = domain.node("probe")?;
        let mut feeds = Vec::with_capacity(topics.len());
        for &topic in topics {
            feeds.push(Feed { buffer: topic.buffer, subscriber: open_raw(&node, topic)? });
        }
        realtime::tighten_timer_slack();
        let now = now_ns();
        Ok(Self {
            feeds,
            streams: topics.iter().map(|topic| Stream::of_topic(topic)).collect(),
            since_ns: now,
            stop,
            period_ns,
            next_ns: now,
            check_ns: now,
            keeper_seen_ns: now,
            domain,
        })
    }

    /// Whether a signal requested the end.
    fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Sleeps until the next poll, at most until `until_ns`; returns the time.
    ///
    /// # Errors
    /// If the rig has gone down: nothing more will be published in its session.
    fn wait(&mut self, until_ns: u64) -> anyhow::Result<u64> {
        self.next_ns = (self.next_ns + self.period_ns).max(now_ns()).min(until_ns);
        sleep_until(self.next_ns);
        let now = now_ns();
        if now >= self.check_ns {
            self.check_ns = now + CHECK_PERIOD_NS;
            if self.domain.keeper_lives() {
                self.keeper_seen_ns = now;
            }
            if now - self.keeper_seen_ns > KEEPER_GONE_NS {
                return Err(self.went_down());
            }
            self.check_session()?;
        }
        Ok(now)
    }

    fn check_session(&self) -> anyhow::Result<()> {
        if self.domain.is_current() { Ok(()) } else { Err(self.went_down()) }
    }

    fn went_down(&self) -> anyhow::Error {
        anyhow!("rig {} went down; what observes it ends with it", self.domain.name())
    }

    fn take_all(&mut self, sink: &mut dyn FnMut(&Arrived<'_>)) -> anyhow::Result<()> {
        for (index, (feed, stream)) in self.feeds.iter_mut().zip(&mut self.streams).enumerate() {
            for _ in 0..feed.buffer {
                let mut take = |bytes: &[u8]| {
                    let received_ns = now_ns();
                    let sent = stream.see(bytes, received_ns);
                    let stamp = Stamp::Received(received_ns);
                    sink(&Arrived { stream: index, bytes, sent, stamp });
                };
                if !feed.subscriber.take(&mut take)? {
                    break;
                }
            }
        }
        Ok(())
    }
}

impl Source for Attached {
    fn streams(&self) -> &[Stream] {
        &self.streams
    }

    fn since_ns(&self) -> u64 {
        self.since_ns
    }

    fn read(
        &mut self,
        until_ns: u64,
        sink: &mut dyn FnMut(&Arrived<'_>),
    ) -> anyhow::Result<Progress> {
        if self.stopping() {
            return Ok(Progress::Ended);
        }
        let now = self.wait(until_ns)?;
        // A session that has just ended breaks its ports: that it ended is the news.
        self.take_all(sink).or_else(|error| self.check_session().and(Err(error)))?;
        Ok(Progress::UpTo(now))
    }

    /// What is lost on a running rig is told, and is no failure of the probe.
    fn exit_code(&self) -> i32 {
        recorder::DONE
    }
}

/// Seconds as ns.
pub fn ns(seconds: f64) -> u64 {
    Duration::from_secs_f64(seconds).as_nanos() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_topic_names_those_that_are_known() {
        let error = topic("sampel").unwrap_err().to_string();
        assert!(error.contains("sampel") && error.contains("sample, command"), "{error}");
        let names = ["command".to_owned(), "sample".to_owned(), "command".to_owned()];
        let found: Vec<_> = topics(&names).unwrap().iter().map(|topic| topic.name).collect();
        assert_eq!(found, ["command", "sample"]);
        assert_eq!(topics(&[]).unwrap().len(), TOPICS.len());
    }
}
