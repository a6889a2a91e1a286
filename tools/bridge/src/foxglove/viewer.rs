//! One viewer: what it subscribed to, what waits for it, and what it did not get.

use std::fmt::Write as _;
use std::sync::Mutex;

use axum::body::Bytes;
use axum::extract::ws::Utf8Bytes;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::mpsc::{Receiver, Sender, channel};

use super::protocol::{self, Level, Request};
use crate::lock;

/// Most messages that wait for a viewer: two seconds of the fastest topic.
const WAITING: usize = 4096;
/// Most texts that wait for it.
const TEXTS: usize = 8;
/// Requests that may be refused before it is disconnected.
const REFUSED: u64 = 100;

/// A message that is sent to those who subscribed to its topic.
#[derive(Clone, Debug)]
pub(crate) struct Outgoing {
    /// When it was published (ns since 1970).
    pub(crate) wall_time_ns: u64,
    /// The message, encoded.
    pub(crate) payload: Vec<u8>,
}

/// What a viewer gets of a topic.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    /// Number of the subscription.
    id: Option<u32>,
    /// It has had nothing of it yet.
    fresh: bool,
    counts: Counts,
}

/// What became of the messages of a topic, or of all, while a viewer was subscribed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Handed on.
    pub(crate) sent: u64,
    /// Published, but not received by the bridge.
    pub(crate) lost: u64,
    /// Dropped, because too many were waiting for the viewer.
    pub(crate) dropped: u64,
}

impl Counts {
    /// Sums of both.
    #[must_use]
    pub(crate) const fn and(self, other: Self) -> Self {
        Self {
            sent: self.sent + other.sent,
            lost: self.lost + other.lost,
            dropped: self.dropped + other.dropped,
        }
    }
}

impl std::fmt::Display for Counts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { sent, lost, dropped } = self;
        write!(f, "{sent} messages sent, {lost} lost before the bridge, {dropped} dropped")
    }
}

#[derive(Debug)]
struct State {
    /// by index of the topic
    shares: Vec<Share>,
    refused: u64,
    /// what it was told of its losses
    told: String,
}

/// The side of a viewer that the rig's messages come to. It never waits.
#[derive(Debug)]
pub(crate) struct Viewer {
    pub(crate) number: u64,
    /// Address and port.
    pub(crate) from: String,
    messages: Sender<Bytes>,
    texts: Sender<Utf8Bytes>,
    state: Mutex<State>,
}

/// The other side: what waits for it.
pub(crate) struct Outbox {
    /// Frames of messages.
    pub(crate) messages: Receiver<Bytes>,
    /// Texts, which overtake them.
    pub(crate) texts: Receiver<Utf8Bytes>,
}

impl Viewer {
    /// A viewer of so many topics.
    pub(crate) fn new(number: u64, from: String, topics: usize) -> (Self, Outbox) {
        let (messages, to_send) = channel(WAITING);
        let (texts, to_tell) = channel(TEXTS);
        let shares = vec![Share::default(); topics];
        let state = Mutex::new(State { shares, refused: 0, told: String::new() });
        let outbox = Outbox { messages: to_send, texts: to_tell };
        (Self { number, from, messages, texts, state }, outbox)
    }

    /// A request came.
    ///
    /// # Errors
    /// Why the connection is to be closed.
    pub(crate) fn request(&self, text: Result<&str, &'static str>) -> Result<(), &'static str> {
        let request = text.map_err(str::to_owned).and_then(protocol::parse);
        let mut state = lock(&self.state);
        let mut errors: Vec<String> = Vec::new();
        match request {
            Ok(Request::Subscribe { subscriptions }) => {
                errors.extend(subscriptions.iter().filter_map(|wish| state.subscribe(wish).err()));
            }
            Ok(Request::Unsubscribe { subscription_ids }) => state.unsubscribe(&subscription_ids),
            Err(error) => errors.push(error),
        }
        if !errors.is_empty() {
            state.refused += 1;
            // Where many wait already, it has been told.
            let _told = self.tell(Level::Error, "refused", &errors.join("; "));
            if state.refused > REFUSED {
                return Err("too many requests that cannot be fulfilled");
            }
        }
        Ok(())
    }

    /// Hands on a message of a topic, after those of its `history` where it has had nothing yet.
    /// `missing` were lost just before it.
    pub(crate) fn offer<'a>(
        &self,
        topic: usize,
        history: impl Iterator<Item = &'a Outgoing>,
        message: &Outgoing,
        missing: u64,
    ) {
        let mut state = lock(&self.state);
        let Some(share) = state.shares.get_mut(topic) else { return };
        if !share.fresh {
            share.count_lost(missing);
        }
        self.greet_with(share, history);
        self.push(share, message);
    }

    /// Messages of a topic were lost, and the one that told it is not handed on.
    pub(crate) fn lost(&self, topic: usize, missing: u64) {
        if let Some(share) = lock(&self.state).shares.get_mut(topic) {
            share.count_lost(missing);
        }
    }

    /// Hands on the history of a topic, if it has just subscribed to it.
    pub(crate) fn greet<'a>(&self, topic: usize, history: impl Iterator<Item = &'a Outgoing>) {
        if let Some(share) = lock(&self.state).shares.get_mut(topic) {
            self.greet_with(share, history);
        }
    }

    fn greet_with<'a>(&self, share: &mut Share, history: impl Iterator<Item = &'a Outgoing>) {
        if std::mem::take(&mut share.fresh) {
            history.for_each(|message| self.push(share, message));
        }
    }

    fn push(&self, share: &mut Share, message: &Outgoing) {
        let Some(id) = share.id else { return };
        let frame = protocol::frame(id, message.wall_time_ns, &message.payload);
        match self.messages.try_send(frame.into()) {
            Ok(()) => share.counts.sent += 1,
            Err(TrySendError::Full(_)) => share.counts.dropped += 1,
            // It has left.
            Err(TrySendError::Closed(_)) => {}
        }
    }

    /// Tells it what it did not get, if that has changed; `name` names a topic by its index.
    pub(crate) fn tell_losses<'a>(&self, name: impl Fn(usize) -> &'a str) {
        let mut state = lock(&self.state);
        let mut text = String::new();
        for (topic, share) in state.shares.iter().enumerate() {
            let Counts { lost, dropped, .. } = share.counts;
            if lost + dropped > 0 {
                let separator = if text.is_empty() { "Not shown" } else { ";" };
                let _written = write!(
                    text,
                    "{separator} {}: {lost} lost before the bridge, {dropped} dropped because \
                     this viewer is slow",
                    name(topic)
                );
            }
        }
        if text != state.told && self.tell(Level::Warning, "losses", &text) {
            state.told = text;
        }
    }

    /// Whether there was room for it.
    fn tell(&self, level: Level, id: &str, text: &str) -> bool {
        self.texts.try_send(protocol::status(level, id, text).into()).is_ok()
    }

    /// Over all topics.
    pub(crate) fn counts(&self) -> Counts {
        let state = lock(&self.state);
        state.shares.iter().fold(Counts::default(), |sum, share| sum.and(share.counts))
    }
}

impl Share {
    const fn count_lost(&mut self, missing: u64) {
        if self.id.is_some() {
            self.counts.lost += missing;
        }
    }
}

impl State {
    fn subscribe(&mut self, wish: &protocol::Subscription) -> Result<(), String> {
        let protocol::Subscription { id, channel_id } = *wish;
        let count = self.shares.len();
        let Some(topic) = protocol::index_of(channel_id, count) else {
            return Err(format!("channel {channel_id}: expected one from 1 to {count}"));
        };
        if self.shares.iter().any(|share| share.id == Some(id)) {
            return Err(format!("subscription {id} is there already"));
        }
        let share = &mut self.shares[topic];
        if share.id.is_some() {
            return Err(format!("channel {channel_id} is subscribed to already"));
        }
        (share.id, share.fresh) = (Some(id), true);
        Ok(())
    }

    fn unsubscribe(&mut self, ids: &[u32]) {
        let of = |share: &&mut Share| share.id.is_some_and(|id| ids.contains(&id));
        for share in self.shares.iter_mut().filter(of) {
            (share.id, share.fresh) = (None, false);
        }
    }
}

#[cfg(test)]
#[path = "viewer/tests.rs"]
mod tests;
