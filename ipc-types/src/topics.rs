//! The one table of topics: name, type, sole owner, rate, buffer, history, publishers.

use std::marker::PhantomData;

use crate::{
    CardOutput, CardScan, ClockSync, EnableLine, EnableToken, Event, Field, Heartbeat, LoopTiming,
    LossCounters, Message, MotorCommand, Process, Sample, Setpoint,
};

/// How often a topic is published.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// Once per scan of the card (rig file, 2,000 Hz unless said).
    Acquisition,
    /// Once per control cycle (rig file, 500 Hz unless said).
    Control,
    /// Once per cycle of the experiment (rig file, 500 Hz unless said).
    Experiment,
    /// Once per cycle of the watchdog (rig file, 1,000 Hz unless said).
    Watchdog,
    /// A fixed rate (Hz).
    Hertz(u32),
    /// When something happens.
    Sporadic,
}

/// One topic.
#[derive(Clone, Copy, Debug)]
pub struct Topic {
    /// Name, unique within a rig.
    pub name: &'static str,
    /// The only process that may publish it.
    pub owner: Process,
    /// How often.
    pub rate: Rate,
    /// Most messages that a subscriber may buffer.
    pub buffer: usize,
    /// Messages that a late subscriber still gets.
    pub history: usize,
    /// Most publishers: one wanted, two that died a moment ago and are not yet cleaned up.
    pub publishers: usize,
    /// Most subscribers.
    pub subscribers: usize,
    /// Whether the logger records it.
    pub recorded: bool,
    /// Bytes of one message.
    pub size: usize,
    /// Type name in shared memory.
    pub type_name: &'static str,
    /// Type name in recordings.
    pub ros_name: &'static str,
    /// Field table.
    pub fields: &'static [Field],
    /// Generates the schema.
    pub schema: fn() -> String,
}

/// A topic together with its message type.
#[derive(Debug)]
pub struct TypedTopic<T> {
    /// The entry of the table.
    pub topic: Topic,
    message: PhantomData<fn() -> T>,
}

impl<T> Clone for TypedTopic<T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for TypedTopic<T> {}

/// Publishers wanted, and two more for those that died a moment ago.
const PUBLISHERS: usize = 3;
const SUBSCRIBERS: usize = 16;

const fn topic<T: Message>(
    name: &'static str,
    owner: Process,
    rate: Rate,
    buffer: usize,
    history: usize,
) -> TypedTopic<T> {
    TypedTopic {
        topic: Topic {
            name,
            owner,
            rate,
            buffer,
            history,
            publishers: PUBLISHERS,
            subscribers: SUBSCRIBERS,
            recorded: true,
            size: size_of::<T>(),
            type_name: T::TYPE_NAME,
            ros_name: T::ROS_NAME,
            fields: T::FIELDS,
            schema: T::schema,
        },
        message: PhantomData,
    }
}

/// Scans in the simulated card's FIFO.
pub const CARD_FIFO: usize = 512;

/// Acquisition's samples.
pub const SAMPLE: TypedTopic<Sample> =
    topic("sample", Process::Acquisition, Rate::Acquisition, 1024, 0);
/// Control's commands; no history, so that a late joiner never sees an old one.
pub const COMMAND: TypedTopic<MotorCommand> =
    topic("command", Process::Control, Rate::Control, 512, 0);
/// The watchdog's tokens; no history, so that a late joiner never sees an old one.
pub const TOKEN: TypedTopic<EnableToken> =
    topic("token", Process::Watchdog, Rate::Watchdog, 512, 0);
/// The watchdog's enable line; no history.
pub const ENABLE_LINE: TypedTopic<EnableLine> =
    topic("enable_line", Process::Watchdog, Rate::Watchdog, 512, 0);
/// The simulated card's FIFO: the history *is* the FIFO, so that it outlives the acquisition that
/// reads it.
pub const CARD_SCAN: TypedTopic<CardScan> =
    topic("card_scan", Process::Simulator, Rate::Acquisition, 1024, CARD_FIFO);
/// Volts for the simulated card; no history.
pub const CARD_OUTPUT: TypedTopic<CardOutput> =
    topic("card_output", Process::Acquisition, Rate::Acquisition, 1024, 0);
/// The setpoint.
pub const SETPOINT: TypedTopic<Setpoint> =
    topic("setpoint", Process::Experiment, Rate::Experiment, 512, 0);
/// The logger's loss counters.
pub const LOSS: TypedTopic<LossCounters> = topic("loss", Process::Logger, Rate::Hertz(1), 256, 0);
/// The logger's measurement of the wall clock.
pub const CLOCK: TypedTopic<ClockSync> = topic("clock", Process::Logger, Rate::Hertz(1), 16, 1);

macro_rules! per_process {
    (
        $(#[doc = $doc:literal])+
        $name:ident, $type:ty, $prefix:literal, $rate:expr, $buffer:literal, $history:literal,
        [$($process:ident $text:literal),+ $(,)?]
    ) => {
        $(#[doc = $doc])+
        pub const fn $name(process: Process) -> Option<TypedTopic<$type>> {
            match process {
                $(Process::$process => Some(topic::<$type>(
                    concat!($prefix, "/", $text),
                    Process::$process,
                    $rate,
                    $buffer,
                    $history,
                )),)+
                _ => None,
            }
        }
    };
}

per_process! {
    /// Events of one process.
    event_topic, Event, "event", Rate::Sporadic, 64, 16,
    [
        Simulator "simulator", Acquisition "acquisition", Control "control", Watchdog "watchdog",
        Logger "logger", Experiment "experiment",
    ]
}
per_process! {
    /// Heartbeats of one slow process.
    heartbeat_topic, Heartbeat, "heartbeat", Rate::Hertz(20), 64, 1,
    [Logger "logger", Experiment "experiment"]
}
per_process! {
    /// Loop timing of one periodic process.
    timing_topic, LoopTiming, "timing", Rate::Hertz(1), 16, 1,
    [
        Simulator "simulator", Acquisition "acquisition", Control "control", Watchdog "watchdog",
        Experiment "experiment",
    ]
}

const fn event(process: Process) -> Topic {
    match event_topic(process) {
        Some(typed) => typed.topic,
        None => panic!("no event topic"),
    }
}
const fn heartbeat(process: Process) -> Topic {
    match heartbeat_topic(process) {
        Some(typed) => typed.topic,
        None => panic!("no heartbeat topic"),
    }
}
const fn timing(process: Process) -> Topic {
    match timing_topic(process) {
        Some(typed) => typed.topic,
        None => panic!("no timing topic"),
    }
}

/// The table. [`LossCounters::topic`](crate::LossCounters) is an index into it.
pub const TOPICS: &[Topic] = &[
    SAMPLE.topic,
    COMMAND.topic,
    TOKEN.topic,
    ENABLE_LINE.topic,
    CARD_SCAN.topic,
    CARD_OUTPUT.topic,
    SETPOINT.topic,
    LOSS.topic,
    CLOCK.topic,
    event(Process::Simulator),
    event(Process::Acquisition),
    event(Process::Control),
    event(Process::Watchdog),
    event(Process::Logger),
    event(Process::Experiment),
    heartbeat(Process::Logger),
    heartbeat(Process::Experiment),
    timing(Process::Simulator),
    timing(Process::Acquisition),
    timing(Process::Control),
    timing(Process::Watchdog),
    timing(Process::Experiment),
];

/// A topic by name.
pub fn find_topic(name: &str) -> Option<&'static Topic> {
    TOPICS.iter().find(|topic| topic.name == name)
}

/// One request-response service of the command plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandService {
    /// Name, unique within a rig.
    pub name: &'static str,
    /// The process that answers.
    pub owner: Process,
    /// Longest request or answer (bytes). Kept small where the server shares its process with a
    /// real-time loop: every client's segment is mapped there.
    pub bytes: usize,
}

/// Operator's verbs to the watchdog.
pub const WATCHDOG_COMMANDS: CommandService =
    CommandService { name: "command/watchdog", owner: Process::Watchdog, bytes: 1024 };
/// Recording on and off.
pub const LOGGER_COMMANDS: CommandService =
    CommandService { name: "command/logger", owner: Process::Logger, bytes: 131_072 };
/// Protocols.
pub const EXPERIMENT_COMMANDS: CommandService =
    CommandService { name: "command/experiment", owner: Process::Experiment, bytes: 65_536 };
/// All of them.
pub const COMMAND_SERVICES: &[CommandService] =
    &[WATCHDOG_COMMANDS, LOGGER_COMMANDS, EXPERIMENT_COMMANDS];
