//! Messages that nobody of the rig has sent, by a process of the same user: with an identity of its
//! own, as a second process would have, or with that of the rightful sender.

use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::service::ipc;
use ipc_types::{
    COMMAND, COMMAND_SERVICES, ENABLE_LINE, EnableLine, EnableToken, Message, Mode, MotorCommand,
    Process, SAMPLE, SETPOINT, Sample, Setpoint, TOKEN, TypedTopic,
};
use runtime::clock::now_ns;

use crate::common::monitor::{STRANGER, Seen};
use crate::expected::{Expected, ONE_MESSAGE};

/// What is forged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Forgery {
    CommandOfSecondControl,
    CommandNotFinite,
    CommandBeyondLimit,
    CommandOfAnotherSession,
    CommandBackwards,
    TokenOfSecondWatchdog,
    TokenOfLaterEpoch,
    SampleOfSecondAcquisition,
    SampleOfAnotherSession,
    EnableLineOfSecondWatchdog,
    SetpointNotFinite,
    SetpointBeyondLimits,
    SetpointOfAnotherOwner,
    RequestsOfAnyBytes,
}

/// What a forged epoch is later by; tokens of it are not the watchdog's.
pub const LATER: u64 = 1_000_000;

impl Forgery {
    pub const ALL: [Self; 14] = [
        Self::CommandOfSecondControl,
        Self::CommandNotFinite,
        Self::CommandBeyondLimit,
        Self::CommandOfAnotherSession,
        Self::CommandBackwards,
        Self::TokenOfSecondWatchdog,
        Self::TokenOfLaterEpoch,
        Self::SampleOfSecondAcquisition,
        Self::SampleOfAnotherSession,
        Self::EnableLineOfSecondWatchdog,
        Self::SetpointNotFinite,
        Self::SetpointBeyondLimits,
        Self::SetpointOfAnotherOwner,
        Self::RequestsOfAnyBytes,
    ];

    pub const fn name(self) -> &'static str {
        match self {
            Self::CommandOfSecondControl => "message of a second control",
            Self::CommandNotFinite => "message of control, not finite",
            Self::CommandBeyondLimit => "message of control, beyond the limit of volts",
            Self::CommandOfAnotherSession => "message of control, of another session",
            Self::CommandBackwards => "message of control, backwards in sequence",
            Self::TokenOfSecondWatchdog => "message of a second watchdog",
            Self::TokenOfLaterEpoch => "message of the watchdog, of a later epoch",
            Self::SampleOfSecondAcquisition => "message of a second acquisition",
            Self::SampleOfAnotherSession => "message of acquisition, of another session",
            Self::EnableLineOfSecondWatchdog => "edge of the enable line by a second watchdog",
            Self::SetpointNotFinite => "setpoint that is not finite",
            Self::SetpointBeyondLimits => "setpoint beyond the limits of position",
            Self::SetpointOfAnotherOwner => "setpoint of another owner",
            Self::RequestsOfAnyBytes => "requests of any bytes to every process",
        }
    }

    /// What must become of the motor.
    pub const fn expected(self) -> Expected {
        if self.is_refused() { Expected::Stays } else { ONE_MESSAGE }
    }

    /// Whether it is refused without any effect on the motor.
    const fn is_refused(self) -> bool {
        matches!(
            self,
            Self::EnableLineOfSecondWatchdog
                | Self::SetpointNotFinite
                | Self::SetpointBeyondLimits
                | Self::SetpointOfAnotherOwner
                | Self::RequestsOfAnyBytes
        )
    }

    /// Sends it once. What is returned must live until it has been received; and when it was sent.
    pub fn send(self, node: &Node<ipc::Service>, newest: &dyn Fn() -> Newest) -> Sent {
        match self {
            Self::CommandOfSecondControl => {
                publish(node, COMMAND, |now| second(newest().command, now))
            }
            Self::CommandNotFinite => publish(node, COMMAND, |now| {
                next(MotorCommand { volts: [f64::NAN; 3], ..newest().command }, now)
            }),
            Self::CommandBeyondLimit => publish(node, COMMAND, |now| {
                next(MotorCommand { volts: [100.0, 0.0, 0.0], ..newest().command }, now)
            }),
            Self::CommandOfAnotherSession => {
                publish(node, COMMAND, |now| elsewhere(newest().command, now))
            }
            Self::CommandBackwards => publish(node, COMMAND, |now| {
                let mut forged = newest().command;
                let sequence = forged.sequence.saturating_sub(1000);
                forged.stamp(forged.session, forged.incarnation, sequence, now);
                forged
            }),
            Self::TokenOfSecondWatchdog => publish(node, TOKEN, |now| {
                let forged = of_later_epoch(newest().token, now);
                second(EnableToken { watchdog_incarnation: STRANGER, ..forged }, now)
            }),
            Self::TokenOfLaterEpoch => {
                publish(node, TOKEN, |now| next(of_later_epoch(newest().token, now), now))
            }
            Self::SampleOfSecondAcquisition => {
                publish(node, SAMPLE, |now| second(newest().sample, now))
            }
            Self::SampleOfAnotherSession => {
                publish(node, SAMPLE, |now| elsewhere(newest().sample, now))
            }
            Self::EnableLineOfSecondWatchdog => publish(node, ENABLE_LINE, |now| {
                let token = newest().token;
                let mut edge =
                    EnableLine { epoch: token.epoch, toggles: 1, ..EnableLine::zeroed() };
                edge.stamp(token.session, STRANGER, 0, now);
                edge
            }),
            Self::SetpointNotFinite => publish(node, SETPOINT, |now| {
                next(Setpoint { position: [f64::NAN; 3], ..newest().setpoint }, now)
            }),
            Self::SetpointBeyondLimits => publish(node, SETPOINT, |now| {
                next(Setpoint { position: [100.0, 0.0, 0.0], ..newest().setpoint }, now)
            }),
            Self::SetpointOfAnotherOwner => publish(node, SETPOINT, |now| {
                let owner = Process::Experiment.code();
                let mode = Mode::Passive.code();
                second(Setpoint { owner, mode, ..newest().setpoint }, now)
            }),
            Self::RequestsOfAnyBytes => request_any_bytes(node),
        }
    }
}

/// What was sent.
pub struct Sent {
    /// Its ports, which must live until it has been received.
    pub kept: Box<dyn std::any::Any>,
    /// When (ns).
    pub sent_ns: u64,
}

/// The newest message of each sender.
#[derive(Clone, Copy, Debug)]
pub struct Newest {
    command: MotorCommand,
    sample: Sample,
    token: EnableToken,
    setpoint: Setpoint,
}

impl Newest {
    /// `None` where one of them has not spoken yet.
    pub fn of(seen: &Seen) -> Option<Self> {
        Some(Self {
            command: seen.command?,
            sample: seen.sample?,
            token: seen.token_message?,
            setpoint: seen.setpoint?,
        })
    }
}

fn of_later_epoch(token: EnableToken, now: u64) -> EnableToken {
    let valid_until_ns = now + (token.valid_until_ns - token.issued_ns);
    EnableToken { epoch: token.epoch + LATER, issued_ns: now, valid_until_ns, ..token }
}

/// As the same sender's next message.
fn next<T: Message>(mut message: T, now: u64) -> T {
    message.stamp(message.session(), message.incarnation(), message.sequence() + 1, now);
    message
}

/// As the message of another sender.
fn second<T: Message>(mut message: T, now: u64) -> T {
    message.stamp(message.session(), STRANGER, message.sequence() + 1, now);
    message
}

/// As the next message, of another session.
fn elsewhere<T: Message>(mut message: T, now: u64) -> T {
    message.stamp(!message.session(), message.incarnation(), message.sequence() + 1, now);
    message
}

/// With the library itself: the project's own publisher would stamp it with its own identity. The
/// message is made once the ports are ready, which takes some milliseconds.
fn publish<T: Message>(
    node: &Node<ipc::Service>,
    topic: TypedTopic<T>,
    message: impl FnOnce(u64) -> T,
) -> Sent {
    let name = topic.topic.name.try_into().unwrap();
    let service = node.service_builder(&name).publish_subscribe::<T>().open().unwrap();
    let publisher: Publisher<ipc::Service, T, ()> =
        service.publisher_builder().max_loaned_samples(1).create().unwrap();
    let sent_ns = now_ns();
    publisher.loan_uninit().unwrap().write_payload(message(sent_ns)).send().unwrap();
    Sent { kept: Box::new(publisher), sent_ns }
}

/// Bytes that are no request of any kind, to every server of the command plane.
fn request_any_bytes(node: &Node<ipc::Service>) -> Sent {
    let sent_ns = now_ns();
    let mut kept: Vec<Box<dyn std::any::Any>> = Vec::new();
    for service in COMMAND_SERVICES {
        let name = service.name.try_into().unwrap();
        let opened = node.service_builder(&name).request_response::<[u8], [u8]>().open().unwrap();
        let client = opened.client_builder().initial_max_slice_len(256).create().unwrap();
        // A request begins with the number of its variant: none has as many as that.
        let bytes: Vec<u8> = (0..200).map(|at| 0x80 | (sent_ns >> (at % 56)) as u8).collect();
        let loaned = client.loan_slice_uninit(bytes.len()).unwrap();
        let pending = loaned.write_from_slice(&bytes).send().unwrap();
        kept.push(Box::new((client, pending)));
    }
    Sent { kept: Box::new(kept), sent_ns }
}
