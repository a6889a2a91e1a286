//! A person's end of the command plane.

use std::marker::PhantomData;
use std::time::Duration;

use iceoryx2::prelude::{Node, ipc};
use ipc_types::{
    EXPERIMENT_COMMANDS, ExperimentAnswer, ExperimentRequest, LOGGER_COMMANDS, LoggerAnswer,
    LoggerRequest, Message, TypedTopic, Verb, VerbAnswer, WATCHDOG_COMMANDS,
};
use runtime::{Counters, Domain, PortError, RawSubscriber, RigName, call, open_raw};

use crate::Error;

/// How long a verb may take.
const VERB_LIMIT: Duration = Duration::from_secs(2);
/// How long the logger may take: it answers when everything is on disk.
const LOGGER_LIMIT: Duration = Duration::from_secs(15);
/// How long the experiment runner may take.
const EXPERIMENT_LIMIT: Duration = Duration::from_secs(2);

/// Joined to a rig that is up: asks its processes and reads its topics, publishes nothing. Stays in
/// its thread.
#[derive(Debug)]
pub struct RigLink {
    // Field order is drop order: the node before the domain's lock.
    node: Node<ipc::Service>,
    domain: Domain,
}

impl RigLink {
    /// Joins.
    ///
    /// # Errors
    /// When no keeper of that rig runs.
    pub fn open(name: &RigName) -> Result<Self, Error> {
        let domain = Domain::observe(name)?;
        let node = domain.node("operator")?;
        Ok(Self { node, domain })
    }

    /// The rig's shared memory.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The node, for further ports.
    pub fn node(&self) -> &Node<ipc::Service> {
        &self.node
    }

    /// Subscribes to a topic.
    ///
    /// # Errors
    /// When all places of subscribers are taken.
    pub fn subscriber<T: Message>(&self, topic: TypedTopic<T>) -> Result<Subscriber<T>, Error> {
        Ok(Subscriber { port: open_raw(&self.node, &topic.topic)?, message: PhantomData })
    }

    /// Asks the watchdog. A refusal is an answer, not an error.
    ///
    /// # Errors
    /// When it does not answer.
    pub fn verb(&self, verb: Verb) -> Result<VerbAnswer, Error> {
        self.verb_within(verb, VERB_LIMIT)
    }

    /// The same with another limit.
    ///
    /// # Errors
    /// When it does not answer.
    pub fn verb_within(&self, verb: Verb, limit: Duration) -> Result<VerbAnswer, Error> {
        Ok(call(&self.node, &WATCHDOG_COMMANDS, &verb, limit)?)
    }

    /// Asks the logger.
    ///
    /// # Errors
    /// When it does not answer.
    pub fn logger(&self, request: &LoggerRequest) -> Result<LoggerAnswer, Error> {
        Ok(call(&self.node, &LOGGER_COMMANDS, request, LOGGER_LIMIT)?)
    }

    /// Asks the experiment runner.
    ///
    /// # Errors
    /// When it does not answer.
    pub fn experiment(&self, request: &ExperimentRequest) -> Result<ExperimentAnswer, Error> {
        Ok(call(&self.node, &EXPERIMENT_COMMANDS, request, EXPERIMENT_LIMIT)?)
    }
}

/// Reads one topic without blocking.
pub struct Subscriber<T> {
    port: Box<dyn RawSubscriber>,
    message: PhantomData<fn() -> T>,
}

impl<T: Message> Subscriber<T> {
    /// The next message, oldest first; `None` when there is none.
    ///
    /// # Errors
    /// When the port does not work any more.
    pub fn take(&mut self) -> Result<Option<T>, PortError> {
        let mut message = None;
        // the topic's table vouches for type and size
        self.port.take(&mut |bytes| message = T::from_bytes(bytes))?;
        Ok(message)
    }

    /// The newest message that came since the last call; `None` when none came.
    ///
    /// # Errors
    /// When the port does not work any more.
    pub fn latest(&mut self) -> Result<Option<T>, PortError> {
        let mut newest = None;
        while let Some(message) = self.take()? {
            newest = Some(message);
        }
        Ok(newest)
    }

    /// What was received and what is missing.
    pub fn counters(&self) -> Counters {
        self.port.counters()
    }
}

/// Asks the watchdog of a rig, and takes a refusal for an error.
///
/// # Errors
/// [`Error::Refused`] with the reason; or when there is no rig, or no watchdog that answers.
pub fn verb(link: &RigLink, verb: Verb) -> Result<VerbAnswer, Error> {
    let answer = link.verb(verb)?;
    if answer.done {
        Ok(answer)
    } else {
        Err(Error::Refused { verb, reason: answer.reason, state: answer.state })
    }
}
