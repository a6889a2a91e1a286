//! Requests to the processes of a rig, and subscriptions to its topics.

use std::time::Duration;

use iceoryx2::prelude::{Node, ipc};
use ipc_types::{
    EXPERIMENT_COMMANDS, ExperimentAnswer, ExperimentRequest, LOGGER_COMMANDS, LoggerAnswer,
    LoggerRequest, Message, SIMULATOR_COMMANDS, SimulatorAnswer, SimulatorRequest, TypedTopic,
    Verb, VerbAnswer, WATCHDOG_COMMANDS,
};
use runtime::{Domain, RequestError, RigName, Subscriber, call};

use crate::Error;

/// Limit of a verb.
const VERB_LIMIT: Duration = Duration::from_secs(2);
/// Limit of the logger, which answers when all is on disk.
const LOGGER_LIMIT: Duration = Duration::from_secs(15);
/// Limit of the experiment process.
const EXPERIMENT_LIMIT: Duration = Duration::from_secs(2);

/// Connection to a rig that is up: sends requests to its processes and subscribes to its topics.
/// Stays in its thread.
#[derive(Debug)]
pub struct RigLink {
    // Field order is drop order: the node before the domain's lock.
    node: Node<ipc::Service>,
    domain: Domain,
}

impl RigLink {
    /// Joins a rig as an observer.
    ///
    /// # Errors
    /// If no keeper of the rig runs.
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
    /// If the topic has no slot for another subscriber.
    pub fn subscriber<T: Message>(&self, topic: TypedTopic<T>) -> Result<Subscriber<T>, Error> {
        Ok(Subscriber::new(&self.node, topic)?)
    }

    /// Sends a verb to the watchdog. A refusal is an answer, not an error.
    ///
    /// # Errors
    /// If it does not answer.
    pub fn verb(&self, verb: Verb) -> Result<VerbAnswer, Error> {
        self.verb_within(verb, VERB_LIMIT)
    }

    /// The same with another limit.
    ///
    /// # Errors
    /// If it does not answer.
    pub fn verb_within(&self, verb: Verb, limit: Duration) -> Result<VerbAnswer, Error> {
        Ok(call(&self.node, &WATCHDOG_COMMANDS, &verb, limit)?)
    }

    /// Sends a request to the logger.
    ///
    /// # Errors
    /// If it does not answer.
    pub fn logger(&self, request: &LoggerRequest) -> Result<LoggerAnswer, Error> {
        Ok(call(&self.node, &LOGGER_COMMANDS, request, LOGGER_LIMIT)?)
    }

    /// Sends a request to the simulated card.
    ///
    /// # Errors
    /// [`Error::NoSimulatedCard`] on a rig with another card; or if it does not answer in time.
    pub fn simulator(&self, request: &SimulatorRequest) -> Result<SimulatorAnswer, Error> {
        call(&self.node, &SIMULATOR_COMMANDS, request, EXPERIMENT_LIMIT).map_err(
            |error| match error {
                RequestError::NobodyServes(..) => {
                    Error::NoSimulatedCard { rig: self.domain.name().to_string() }
                }
                other => other.into(),
            },
        )
    }

    /// Sends a request to the experiment process.
    ///
    /// # Errors
    /// If it does not answer.
    pub fn experiment(&self, request: &ExperimentRequest) -> Result<ExperimentAnswer, Error> {
        Ok(call(&self.node, &EXPERIMENT_COMMANDS, request, EXPERIMENT_LIMIT)?)
    }
}

/// Sends a verb to the watchdog of a rig; a refusal is an error.
///
/// # Errors
/// [`Error::Refused`] with the reason, or if the watchdog does not answer.
pub fn verb(link: &RigLink, verb: Verb) -> Result<VerbAnswer, Error> {
    let answer = link.verb(verb)?;
    if answer.done {
        Ok(answer)
    } else {
        Err(Error::Refused { verb, reason: answer.reason, state: answer.state })
    }
}
