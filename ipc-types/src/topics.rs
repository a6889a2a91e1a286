//! The one table of topics: name, type, sole owner, rate, buffer, history, publishers.

use std::marker::PhantomData;

use crate::process::{PROCESS_TOPICS, ProcessTopic, ProcessTopicKind};
use crate::{
    AXES, CARD_FIFO, CardOutput, CardScan, ClockSync, EmgMaximum, EnableLine, EnableToken, Event,
    Field, Heartbeat, HomeOrder, Innovation, LoopTiming, LossCounters, Message, ModelState,
    MotorCommand, Performance, Process, Sample, ScannerPulse, SessionResult, Setpoint, SyncOrder,
    Volume,
};

/// How often a topic is published.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// Once per cycle of a process's loop.
    Loop(Process),
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

impl<T: Message> TypedTopic<T> {
    /// The topic of this message type that a process owns; `None` where it owns none.
    fn of(process: Process) -> Option<Self> {
        let owned = |topic: &&Topic| topic.owner == process && topic.type_name == T::TYPE_NAME;
        TOPICS.iter().find(owned).map(|topic| Self { topic: *topic, message: PhantomData })
    }
}

/// Most publishers of a topic: one wanted, two that died a moment ago and are not yet cleaned up.
pub const PUBLISHERS: usize = 3;
/// Most subscribers of a topic.
pub const SUBSCRIBERS: usize = 16;

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
            size: size_of::<T>(),
            type_name: T::TYPE_NAME,
            ros_name: T::ROS_NAME,
            fields: T::FIELDS,
            schema: T::schema,
        },
        message: PhantomData,
    }
}

/// Acquisition's samples.
pub const SAMPLE: TypedTopic<Sample> =
    topic("sample", Process::Acquisition, Rate::Loop(Process::Acquisition), 1024, 0);
/// Control's commands; no history, so that a late joiner never sees an old one.
pub const COMMAND: TypedTopic<MotorCommand> =
    topic("command", Process::Control, Rate::Loop(Process::Control), 512, 0);
/// The watchdog's tokens; no history, so that a late joiner never sees an old one.
pub const TOKEN: TypedTopic<EnableToken> =
    topic("token", Process::Watchdog, Rate::Loop(Process::Watchdog), 512, 0);
/// The watchdog's enable line; no history.
pub const ENABLE_LINE: TypedTopic<EnableLine> =
    topic("enable_line", Process::Watchdog, Rate::Loop(Process::Watchdog), 512, 0);
/// The simulated card's FIFO: the history *is* the FIFO, so that it outlives the acquisition that
/// reads it.
pub const CARD_SCAN: TypedTopic<CardScan> =
    topic("card_scan", Process::Simulator, Rate::Loop(Process::Acquisition), 1024, CARD_FIFO);
/// Volts for the simulated card; no history.
pub const CARD_OUTPUT: TypedTopic<CardOutput> =
    topic("card_output", Process::Acquisition, Rate::Loop(Process::Acquisition), 1024, 0);
/// The setpoint.
pub const SETPOINT: TypedTopic<Setpoint> =
    topic("setpoint", Process::Experiment, Rate::Loop(Process::Experiment), 360, 0);
/// Zeros that homing has found; no history, so that an old one never sets a new acquisition's zero.
pub const HOME_ORDER: TypedTopic<HomeOrder> =
    topic("home_order", Process::Experiment, Rate::Sporadic, 16, 0);
/// Sessions that begin, for the pulse on a digital output; no history, so that none has two.
pub const SYNC_ORDER: TypedTopic<SyncOrder> =
    topic("sync_order", Process::Experiment, Rate::Sporadic, 4, 0);
/// What happens on the scanner's trigger line; the history lets an experiment process that is
/// started again count the volumes since the beginning of its segment.
pub const SCANNER: TypedTopic<ScannerPulse> =
    topic("scanner", Process::Acquisition, Rate::Sporadic, 256, 256);
/// Pulses of the scanner that were typed as the key 5; no history, so that none counts twice.
pub const SCANNER_KEY: TypedTopic<ScannerPulse> =
    topic("scanner_key", Process::Experiment, Rate::Sporadic, 8, 0);
/// The volumes that a protocol counts.
pub const VOLUME: TypedTopic<Volume> = topic("volume", Process::Experiment, Rate::Sporadic, 256, 1);
/// Sums of effort and the subject's bar, in a protocol that has sessions.
pub const PERFORMANCE: TypedTopic<Performance> =
    topic("performance", Process::Experiment, Rate::Sporadic, 64, 1);
/// Sessions that have ended.
pub const SESSION: TypedTopic<SessionResult> =
    topic("session", Process::Experiment, Rate::Sporadic, 16, 16);
/// Maxima of the muscles' activity.
pub const EMG_MAXIMUM: TypedTopic<EmgMaximum> =
    topic("emg_maximum", Process::Experiment, Rate::Sporadic, 8, 8);
/// The model beside the machine.
pub const INNOVATION: TypedTopic<Innovation> =
    topic("innovation", Process::Monitor, Rate::Sporadic, 96, 0);
/// Whether the machine is as the model; the history holds the newest of each axis.
pub const MODEL_STATE: TypedTopic<ModelState> =
    topic("model_state", Process::Monitor, Rate::Sporadic, 16, AXES);
/// The logger's loss counters.
pub const LOSS: TypedTopic<LossCounters> = topic("loss", Process::Logger, Rate::Hertz(1), 256, 0);
/// The logger's measurement of the wall clock.
pub const CLOCK: TypedTopic<ClockSync> = topic("clock", Process::Logger, Rate::Hertz(1), 16, 1);

/// The topics that one process has, with their places in [`TOPICS`]. Recordings hold the places: a
/// new topic takes the next that is free.
const OWN: &[(usize, Topic)] = &[
    (0, SAMPLE.topic),
    (1, COMMAND.topic),
    (2, TOKEN.topic),
    (3, ENABLE_LINE.topic),
    (4, CARD_SCAN.topic),
    (5, CARD_OUTPUT.topic),
    (6, SETPOINT.topic),
    (7, LOSS.topic),
    (8, CLOCK.topic),
    (22, HOME_ORDER.topic),
    (23, SCANNER.topic),
    (24, VOLUME.topic),
    (25, PERFORMANCE.topic),
    (26, SESSION.topic),
    (29, SCANNER_KEY.topic),
    (30, SYNC_ORDER.topic),
    (31, EMG_MAXIMUM.topic),
    (34, INNOVATION.topic),
    (35, MODEL_STATE.topic),
];

/// A topic that several processes have.
const fn process_topic(owner: Process, own: ProcessTopic) -> Topic {
    let name = own.name;
    match own.kind {
        ProcessTopicKind::event => topic::<Event>(name, owner, Rate::Sporadic, 64, 16).topic,
        ProcessTopicKind::heartbeat => {
            topic::<Heartbeat>(name, owner, Rate::Hertz(20), 32, 1).topic
        }
        ProcessTopicKind::timing => topic::<LoopTiming>(name, owner, Rate::Hertz(1), 16, 1).topic,
    }
}

const COUNT: usize = OWN.len() + PROCESS_TOPICS.len();

/// The topics. [`LossCounters::topic`] is an index into this table.
pub const TOPICS: &[Topic] = &{
    let mut table: [Option<Topic>; COUNT] = [None; COUNT];
    let mut at = 0;
    while at < COUNT {
        let (place, topic) = if at < OWN.len() {
            OWN[at]
        } else {
            let (owner, own) = PROCESS_TOPICS[at - OWN.len()];
            (own.place, process_topic(owner, own))
        };
        assert!(table[place].is_none(), "two topics in one place");
        table[place] = Some(topic);
        at += 1;
    }
    let mut topics = [SAMPLE.topic; COUNT];
    at = 0;
    while at < COUNT {
        // No place is free: there are as many topics as places.
        if let Some(topic) = table[at] {
            topics[at] = topic;
        }
        at += 1;
    }
    topics
};

/// Events of one process.
pub fn event_topic(process: Process) -> Option<TypedTopic<Event>> {
    TypedTopic::of(process)
}

/// Heartbeats of one slow process.
pub fn heartbeat_topic(process: Process) -> Option<TypedTopic<Heartbeat>> {
    TypedTopic::of(process)
}

/// Loop timing of one periodic process.
pub fn timing_topic(process: Process) -> Option<TypedTopic<LoopTiming>> {
    TypedTopic::of(process)
}

/// What a process publishes all the time: its heartbeat, or else the first of its topics.
pub fn pulse_topic(process: Process) -> Option<&'static Topic> {
    let own = || TOPICS.iter().filter(|topic| topic.owner == process);
    own().find(|topic| topic.type_name == Heartbeat::TYPE_NAME).or_else(|| own().next())
}

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
/// Faults of the simulated machine.
pub const SIMULATOR_COMMANDS: CommandService =
    CommandService { name: "command/simulator", owner: Process::Simulator, bytes: 2048 };
/// The services that answer requests.
pub const COMMAND_SERVICES: &[CommandService] =
    &[WATCHDOG_COMMANDS, LOGGER_COMMANDS, EXPERIMENT_COMMANDS, SIMULATOR_COMMANDS];
