//! The command plane: request and answer between processes, off the real-time path.
//!
//! Payloads are serde types in bincode 2.0.1, the last release that compiles. bincode is
//! unmaintained (RUSTSEC-2025-0141); this module and `files::Format` are its only users, each with
//! one `encode` and one `decode`: postcard would replace it there.

use std::time::{Duration, Instant};

use iceoryx2::port::ReceiveError;
use iceoryx2::port::server::Server as LibraryServer;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::client::ClientCreateError;
use ipc_types::CommandService;
use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

const NODES: usize = 16;
/// Most clients of a service.
const CLIENTS: usize = 8;
/// Answers for which a server's segment has room, as the library reckons it: for each client, a
/// question that it waits for and one that it gave up; for each of these an answer waiting, one
/// borrowed, one being written.
pub(crate) const ANSWERS_IN_SEGMENT: usize = CLIENTS * 2 * 3;
/// Most memory that decoding may claim, whatever the bytes say.
const DECODE_LIMIT: usize = 1 << 20;

/// A request could not be made or answered.
#[derive(Debug, Error)]
pub enum RequestError {
    /// No process answers.
    #[error("{0} does not answer: is the {1} process running? (`farreach status`)")]
    NobodyServes(&'static str, &'static str),
    /// It did not answer in time.
    #[error("{service} did not answer within {limit:?}")]
    TimedOut {
        /// The service.
        service: &'static str,
        /// The limit.
        limit: Duration,
    },
    /// As many programs as the command plane holds are asking already.
    #[error(
        "{service}: {CLIENTS} programs are asking already, and none had its answer within \
         {limit:?}; end one that hangs"
    )]
    Busy {
        /// The service.
        service: &'static str,
        /// How long it was tried.
        limit: Duration,
    },
    /// Too long for the command plane.
    #[error("{service}: a message of {found} bytes; at most {most} fit")]
    TooLong {
        /// The service.
        service: &'static str,
        /// Its length.
        found: usize,
        /// What fits.
        most: usize,
    },
    /// The bytes are not what was expected: another version, most likely.
    #[error("{service}: cannot {action}: {reason}; are all processes of the same version?")]
    Codec {
        /// The service.
        service: &'static str,
        /// Encode or decode.
        action: &'static str,
        /// Why.
        reason: String,
    },
    /// iceoryx2 refused.
    #[error("{service}: {action}: {reason}")]
    Library {
        /// The service.
        service: &'static str,
        /// What was tried.
        action: &'static str,
        /// What the library said.
        reason: String,
    },
}

fn failed<E: std::fmt::Debug>(
    service: &'static str,
    action: &'static str,
) -> impl FnOnce(E) -> RequestError {
    move |error| RequestError::Library { service, action, reason: format!("{error:?}") }
}

/// The bytes of a question or an answer.
///
/// # Errors
/// [`RequestError::Codec`], [`RequestError::TooLong`].
pub fn encode<M: Serialize>(
    service: &CommandService,
    message: &M,
) -> Result<Vec<u8>, RequestError> {
    let bytes =
        bincode::serde::encode_to_vec(message, bincode::config::standard()).map_err(|e| {
            RequestError::Codec { service: service.name, action: "encode", reason: e.to_string() }
        })?;
    if bytes.len() > service.bytes {
        return Err(RequestError::TooLong {
            service: service.name,
            found: bytes.len(),
            most: service.bytes,
        });
    }
    Ok(bytes)
}

/// The question or answer in these bytes; `service` is for messages.
///
/// # Errors
/// [`RequestError::Codec`]: cut off, too long, of another type or version.
pub fn decode<M: DeserializeOwned>(service: &'static str, bytes: &[u8]) -> Result<M, RequestError> {
    let config = bincode::config::standard().with_limit::<DECODE_LIMIT>();
    let (message, used) = bincode::serde::decode_from_slice(bytes, config)
        .map_err(|e| RequestError::Codec { service, action: "decode", reason: e.to_string() })?;
    if used != bytes.len() {
        let reason = format!("{} bytes too many", bytes.len() - used);
        return Err(RequestError::Codec { service, action: "decode", reason });
    }
    Ok(message)
}

type Factory = iceoryx2::service::port_factory::request_response::PortFactory<
    ipc::Service,
    [u8],
    (),
    [u8],
    (),
>;

fn name_of(service: &CommandService) -> Result<ServiceName, RequestError> {
    service.name.try_into().map_err(failed(service.name, "naming the service"))
}

fn open(node: &Node<ipc::Service>, service: &CommandService) -> Result<Factory, RequestError> {
    node.service_builder(&name_of(service)?)
        .request_response::<[u8], [u8]>()
        .open()
        .map_err(failed(service.name, "opening (does the keeper run, and is it of this version?)"))
}

/// Creates a command service, or joins it, and keeps it open for as long as the result lives.
pub(crate) fn hold(
    node: &Node<ipc::Service>,
    service: &CommandService,
) -> Result<Box<dyn std::any::Any>, RequestError> {
    let factory = node
        .service_builder(&name_of(service)?)
        .request_response::<[u8], [u8]>()
        .max_servers(3)
        .max_clients(CLIENTS)
        // One question at a time, one answer to each: with the library's defaults a segment is
        // eight times as large.
        .max_active_requests_per_client(1)
        .max_loaned_requests(1)
        .max_response_buffer_size(1)
        .max_borrowed_responses_per_pending_response(1)
        .max_nodes(NODES)
        .open_or_create()
        .map_err(failed(service.name, "creating"))?;
    Ok(Box::new(factory))
}

/// Answers requests. Lives in a thread of its own, with a node of its own, never in a real-time
/// loop.
#[derive(Debug)]
pub struct Server {
    port: LibraryServer<ipc::Service, [u8], (), [u8], ()>,
    service: CommandService,
}

impl Server {
    /// Begins to serve.
    pub fn new(node: &Node<ipc::Service>, service: &CommandService) -> Result<Self, RequestError> {
        let port = open(node, service)?
            .server_builder()
            .initial_max_slice_len(service.bytes)
            .max_loaned_responses_per_request(1)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(failed(service.name, "making a server"))?;
        Ok(Self { port, service: *service })
    }

    /// Answers the request that has waited longest; returns whether there was one. Whoever serves
    /// looks at everything else between two requests. One that cannot be decoded is dropped and
    /// reported to `broken`.
    pub fn poll<Q: DeserializeOwned, A: Serialize>(
        &self,
        answer: impl FnOnce(Q) -> A,
        mut broken: impl FnMut(RequestError),
    ) -> Result<bool, RequestError> {
        let request = match self.port.receive() {
            Ok(Some(request)) => request,
            Ok(None) => return Ok(false),
            // A client that died while it was being connected; reported once, the others are in
            // order.
            Err(ReceiveError::ConnectionFailure(error)) => {
                broken(failed(self.service.name, "connecting a client")(error));
                return Ok(false);
            }
            Err(error) => return Err(failed(self.service.name, "receiving")(error)),
        };
        let done = decode::<Q>(self.service.name, request.payload()).and_then(|question| {
            let bytes = encode(&self.service, &answer(question))?;
            let loaned = request
                .loan_slice_uninit(bytes.len())
                .map_err(failed(self.service.name, "loaning an answer"))?;
            loaned.write_from_slice(&bytes).send().map_err(failed(self.service.name, "answering"))
        });
        if let Err(error) = done {
            broken(error);
        }
        Ok(true)
    }
}

/// Asks and waits for the answer, at most `limit`.
pub fn call<Q: Serialize, A: DeserializeOwned>(
    node: &Node<ipc::Service>,
    service: &CommandService,
    question: &Q,
    limit: Duration,
) -> Result<A, RequestError> {
    let bytes = encode(service, question)?;
    let factory = open(node, service)?;
    let started = Instant::now();
    let client = loop {
        let client = factory
            .client_builder()
            .initial_max_slice_len(service.bytes)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create();
        match client {
            // Each client lives for one question, so another has its turn soon.
            Err(ClientCreateError::ExceedsMaxSupportedClients) if started.elapsed() < limit => {
                std::thread::sleep(Duration::from_millis(1));
            }
            Err(ClientCreateError::ExceedsMaxSupportedClients) => {
                return Err(RequestError::Busy { service: service.name, limit });
            }
            other => break other.map_err(failed(service.name, "making a client"))?,
        }
    };
    let loaned =
        client.loan_slice_uninit(bytes.len()).map_err(failed(service.name, "loaning a request"))?;
    let pending = loaned.write_from_slice(&bytes).send().map_err(failed(service.name, "asking"))?;
    // Without a server the library calls this a success.
    if pending.number_of_server_connections() == 0 {
        return Err(RequestError::NobodyServes(service.name, service.owner.text()));
    }
    loop {
        // Asked before the answer is looked for: a server ends the connection right after its
        // answer, which may come between the two.
        let connected = pending.is_connected();
        if let Some(response) =
            pending.receive().map_err(failed(service.name, "waiting for the answer"))?
        {
            return decode(service.name, response.payload());
        }
        if !connected {
            return Err(RequestError::NobodyServes(service.name, service.owner.text()));
        }
        if started.elapsed() > limit {
            return Err(RequestError::TimedOut { service: service.name, limit });
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::{LOGGER_COMMANDS, LoggerRequest, Split, Verb, WATCHDOG_COMMANDS};
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn too_long_is_refused_before_it_is_sent() {
        let path = "x".repeat(LOGGER_COMMANDS.bytes);
        let request = LoggerRequest::Start { path, metadata: Vec::new(), split: Split::default() };
        assert!(matches!(encode(&LOGGER_COMMANDS, &request), Err(RequestError::TooLong { .. })));
    }

    #[test]
    fn surplus_bytes_are_an_error() {
        let mut bytes = encode(&WATCHDOG_COMMANDS, &Verb::Arm).unwrap();
        assert_eq!(decode::<Verb>("test", &bytes).unwrap(), Verb::Arm);
        bytes.push(0);
        assert!(matches!(decode::<Verb>("test", &bytes), Err(RequestError::Codec { .. })));
    }

    proptest! {
        #[test]
        fn round_trip(
            path in ".{0,40}",
            metadata in prop::collection::vec((".{0,9}", ".{0,99}"), 0..4),
            every_ns in any::<Option<u64>>(),
            every_bytes in any::<Option<u64>>(),
        ) {
            let split = Split { every_ns, every_bytes, keep_ns: None };
            let request = LoggerRequest::Start { path, metadata, split };
            let bytes = encode(&LOGGER_COMMANDS, &request).unwrap();
            prop_assert_eq!(decode::<LoggerRequest>("test", &bytes).unwrap(), request);
        }

        #[test]
        fn any_bytes_decode_or_fail_but_never_panic(
            bytes in prop::collection::vec(any::<u8>(), 0..200),
        ) {
            let _result = decode::<LoggerRequest>("test", &bytes);
        }
    }
}
