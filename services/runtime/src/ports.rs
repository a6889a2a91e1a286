//! Publishers that stamp identity and sequence, subscribers that count what is missing.

use iceoryx2::port::publisher::Publisher as LibraryPublisher;
use iceoryx2::port::subscriber::Subscriber as LibrarySubscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{ReceiveError, SendError};
use iceoryx2::prelude::*;
use ipc_types::{
    Message, PUBLISHERS, SUBSCRIBERS, SequenceTracker, Topic, TypeVisitor, TypedTopic, visit_type,
};
use thiserror::Error;

use crate::clock::now_ns;
use crate::identity::Identity;

/// Most nodes on a topic: processes, probes, and those that died a moment ago.
const NODES: usize = 32;
/// Messages that a subscriber may hold at a time.
const BORROWED: usize = 2;

/// A port could not be made, or does not work any more.
#[derive(Debug, Error)]
#[error("topic {topic}: {action}: {reason}")]
pub struct PortError {
    topic: &'static str,
    action: &'static str,
    reason: String,
}

fn failed<E: std::fmt::Debug>(
    topic: &'static str,
    action: &'static str,
) -> impl FnOnce(E) -> PortError {
    move |error| PortError { topic, action, reason: format!("{error:?}") }
}

type Service<T> =
    iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, T, ()>;

fn service_name(topic: &Topic) -> Result<ServiceName, PortError> {
    topic.name.try_into().map_err(failed(topic.name, "naming the service"))
}

fn open<T: Message>(node: &Node<ipc::Service>, topic: &Topic) -> Result<Service<T>, PortError> {
    node.service_builder(&service_name(topic)?)
        .publish_subscribe::<T>()
        .open()
        .map_err(failed(topic.name, "opening (does the keeper run, and is it of this version?)"))
}

/// Messages for which a publisher's segment has room, as the library reckons it.
pub(crate) const fn messages_in_segment(topic: &Topic) -> usize {
    SUBSCRIBERS * (topic.buffer + BORROWED) + topic.history + 1
}

/// Does something with the message type of a topic.
fn visit<T, V>(topic: &Topic, visitor: V) -> Result<T, PortError>
where
    V: TypeVisitor<Output = Result<T, PortError>>,
{
    visit_type(topic.type_name, visitor).unwrap_or_else(|| {
        Err(PortError {
            topic: topic.name,
            action: "looking up the type",
            reason: topic.type_name.to_owned(),
        })
    })
}

/// Creates a topic's service, or joins it, and keeps it open for as long as the result lives.
pub(crate) fn hold(
    node: &Node<ipc::Service>,
    topic: &Topic,
) -> Result<Box<dyn std::any::Any>, PortError> {
    visit(topic, Hold { node, topic })
}

struct Hold<'a> {
    node: &'a Node<ipc::Service>,
    topic: &'a Topic,
}

impl TypeVisitor for Hold<'_> {
    type Output = Result<Box<dyn std::any::Any>, PortError>;

    fn visit<T: Message>(self) -> Self::Output {
        let topic = self.topic;
        let service = self
            .node
            .service_builder(&service_name(topic)?)
            .publish_subscribe::<T>()
            .max_publishers(PUBLISHERS)
            .max_subscribers(SUBSCRIBERS)
            .max_nodes(NODES)
            .subscriber_max_buffer_size(topic.buffer)
            .subscriber_max_borrowed_samples(BORROWED)
            .history_size(topic.history)
            .enable_safe_overflow(true)
            .open_or_create()
            .map_err(failed(topic.name, "creating"))?;
        Ok(Box::new(service))
    }
}

/// How often a port tries again when a connection could not be made. The library reports a peer
/// that died while it was being connected once, and leaves the other connections in order.
const ATTEMPTS: usize = 4;

/// Publishes one topic: stamps session, incarnation, sequence and time.
#[derive(Debug)]
pub struct Publisher<T: Message> {
    port: LibraryPublisher<ipc::Service, T, ()>,
    identity: Identity,
    sequence: u64,
    topic: &'static str,
    undelivered: u64,
}

impl<T: Message> Publisher<T> {
    pub(crate) fn new(
        node: &Node<ipc::Service>,
        topic: TypedTopic<T>,
        identity: Identity,
    ) -> Result<Self, PortError> {
        let port = open::<T>(node, &topic.topic)?
            .publisher_builder()
            // The default would block the publisher on a full buffer.
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .max_loaned_samples(1)
            .create()
            .map_err(failed(topic.topic.name, "making a publisher"))?;
        Ok(Self { port, identity, sequence: 0, topic: topic.topic.name, undelivered: 0 })
    }

    /// Publishes; returns the sequence number that it got.
    pub fn send(&mut self, mut message: T) -> Result<u64, PortError> {
        let sequence = self.sequence;
        message.stamp(self.identity.session, self.identity.incarnation, sequence, now_ns());
        let mut attempt = 1;
        loop {
            let loaned = self.port.loan_uninit().map_err(failed(self.topic, "loaning"))?;
            match loaned.write_payload(message).send() {
                Ok(_) => break,
                // Nobody got it: a subscriber died while it was being connected. The others are in
                // order.
                Err(SendError::ConnectionError(_)) if attempt < ATTEMPTS => attempt += 1,
                // All got it but one, whose connection is broken: its gap in the sequence tells it.
                Err(SendError::ConnectionCorrupted | SendError::UnableToDeliver) => {
                    self.undelivered += 1;
                    break;
                }
                Err(error) => return Err(failed(self.topic, "sending")(error)),
            }
        }
        self.sequence += 1;
        Ok(sequence)
    }

    /// Messages that at least one subscriber did not get because its connection is broken.
    pub fn undelivered(&self) -> u64 {
        self.undelivered
    }

    /// Connects those that joined since the last message: a late subscriber gets its history only
    /// when the publisher calls this, or sends; and what a dead one left is let go of only then.
    /// For slow topics.
    pub fn refresh(&self) {
        // A subscriber that died while it was being connected. It is reported once, and the others
        // are in order.
        let _failed = self.port.update_connections();
    }
}

/// What a subscriber received, and what is missing by [`SequenceTracker`]'s rule.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Messages received.
    pub received: u64,
    /// Messages missing in the sequence.
    pub lost: u64,
    /// Messages whose sequence number went backwards or repeated within an incarnation.
    pub backwards: u64,
    /// Publishers that died while they were being connected.
    pub connections_failed: u64,
}

/// Subscribes to one topic; reads without blocking.
#[derive(Debug)]
pub struct Subscriber<T: Message> {
    port: LibrarySubscriber<ipc::Service, T, ()>,
    tracker: SequenceTracker,
    connections_failed: u64,
    topic: &'static str,
}

impl<T: Message> Subscriber<T> {
    /// Subscribes with a node of the calling thread.
    pub fn new(node: &Node<ipc::Service>, topic: TypedTopic<T>) -> Result<Self, PortError> {
        Self::from_table(node, &topic.topic)
    }

    fn from_table(node: &Node<ipc::Service>, topic: &Topic) -> Result<Self, PortError> {
        let port = open::<T>(node, topic)?
            .subscriber_builder()
            .buffer_size(topic.buffer)
            .create()
            .map_err(failed(topic.name, "making a subscriber"))?;
        Ok(Self {
            port,
            tracker: SequenceTracker::default(),
            connections_failed: 0,
            topic: topic.name,
        })
    }

    /// The next message, oldest first; `None` when there is none.
    pub fn take(&mut self) -> Result<Option<T>, PortError> {
        self.take_with(|message| *message)
    }

    fn take_with<R>(&mut self, mut look: impl FnMut(&T) -> R) -> Result<Option<R>, PortError> {
        for _ in 1..ATTEMPTS {
            match self.port.receive() {
                Ok(None) => return Ok(None),
                Ok(Some(sample)) => {
                    let message = sample.payload();
                    self.tracker.observe(message.incarnation(), message.sequence());
                    return Ok(Some(look(message)));
                }
                Err(ReceiveError::ConnectionFailure(_)) => self.connections_failed += 1,
                Err(error) => return Err(failed(self.topic, "receiving")(error)),
            }
        }
        // Silence: whoever needs this topic finds it stale.
        Ok(None)
    }

    /// The newest message that came since the last call; `None` when none came.
    pub fn latest(&mut self) -> Result<Option<T>, PortError> {
        let mut newest = None;
        while let Some(message) = self.take()? {
            newest = Some(message);
        }
        Ok(newest)
    }

    /// What was received and what is missing.
    pub fn counters(&self) -> Counters {
        Counters {
            received: self.tracker.received(),
            lost: self.tracker.gaps(),
            backwards: self.tracker.duplicates(),
            connections_failed: self.connections_failed,
        }
    }
}

/// A subscriber to a topic whose type is known from the table only: hands out bytes (logger,
/// probes).
pub trait RawSubscriber {
    /// Hands the bytes of the next message to `sink`; `false` when there is none.
    fn take(&mut self, sink: &mut dyn FnMut(&[u8])) -> Result<bool, PortError>;
    /// What was received and what is missing.
    fn counters(&self) -> Counters;
}

impl<T: Message> RawSubscriber for Subscriber<T> {
    fn take(&mut self, sink: &mut dyn FnMut(&[u8])) -> Result<bool, PortError> {
        Ok(self.take_with(|message| sink(message.as_bytes()))?.is_some())
    }

    fn counters(&self) -> Counters {
        Subscriber::counters(self)
    }
}

/// Subscribes to a topic of the table by its entry.
pub fn open_raw(
    node: &Node<ipc::Service>,
    topic: &Topic,
) -> Result<Box<dyn RawSubscriber>, PortError> {
    visit(topic, OpenRaw { node, topic })
}

struct OpenRaw<'a> {
    node: &'a Node<ipc::Service>,
    topic: &'a Topic,
}

impl TypeVisitor for OpenRaw<'_> {
    type Output = Result<Box<dyn RawSubscriber>, PortError>;

    fn visit<T: Message>(self) -> Self::Output {
        Ok(Box::new(Subscriber::<T>::from_table(self.node, self.topic)?))
    }
}
