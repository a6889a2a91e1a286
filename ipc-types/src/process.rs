//! The table of processes: launcher, unit files, priorities, topics, screens and pages follow from
//! it.

use crate::CardKind;
use crate::codes::codes;

/// Takes the processes with their codes and names, and with the entry of each that is a part of the
/// rig: what differs from [`STANDARD`]. `topics: [event 9]` gives each topic its place in the table
/// of topics.
macro_rules! processes {
    ($(
        $(#[doc = $doc:literal])+
        $name:ident = $code:literal, $text:literal $({
            topics: [$($topic:ident $place:literal),*],
            $($entry:tt)+
        })?;
    )+) => {
        codes! {
            /// The processes of a rig.
            Process { $($(#[doc = $doc])+ $name = $code, $text;)+ }
        }

        /// The processes of which a rig consists.
        pub const PROCESSES: &[ProcessEntry] = &[$($(ProcessEntry {
            process: Process::$name,
            $($entry)+
            ..STANDARD
        },)?)+];

        /// The topics that several processes have, with the owner of each.
        pub(crate) const PROCESS_TOPICS: &[(Process, ProcessTopic)] = &[
            $($($((Process::$name, ProcessTopic {
                name: concat!(stringify!($topic), "/", $text),
                kind: ProcessTopicKind::$topic,
                place: $place,
            }),)*)?)+
        ];
    };
}

processes! {
    /// Creates the rig's shared memory, holds it open, cleans up after processes that died.
    Keeper = 0, "keeper" {
        topics: [],
        silence_s: 5,
        stop_s: 5,
        unit: "# Describes the rig to `farreach status`, `run` and the console, and what it was \
               started with to\n# the other units, in the rig's folder below /run, which goes \
               when the rig goes down.\nEnvironment=FARREACH_SYSTEMD=yes\n\
               RuntimeDirectory=farreach/%i\nRuntimeDirectoryPreserve=restart\n\
               # Finds out whether real-time scheduling is granted to the rig; itself it runs \
               without.\nLimitRTPRIO=90\n",
    };
    /// The simulated card with the simulated plant behind it.
    Simulator = 1, "simulator" {
        topics: [event 9, timing 17],
        after: &[Process::Keeper, Process::Logger],
        card: Some(CardKind::Simulated),
        real_time: Some(RealTimeLoop { priority: 75, rate_hz: 2000, phase_us: 0 }),
        oom_score: -500,
    };
    /// Reads the card, publishes samples, writes motor voltages through the gate.
    Acquisition = 2, "acquisition" {
        topics: [event 10, timing 18],
        after: &[Process::Keeper, Process::Logger, Process::Simulator],
        real_time: Some(RealTimeLoop { priority: 80, rate_hz: 2000, phase_us: 80 }),
    };
    /// The control law.
    Control = 3, "control" {
        topics: [event 11, timing 19],
        after: &[Process::Keeper, Process::Logger, Process::Acquisition],
        real_time: Some(RealTimeLoop { priority: 70, rate_hz: 500, phase_us: 200 }),
    };
    /// The interlocks and the motor's enable line. Starts last, and stops first, which removes
    /// motor power.
    Watchdog = 4, "watchdog" {
        topics: [event 12, timing 20],
        after: &[
            Process::Keeper, Process::Logger, Process::Simulator, Process::Acquisition,
            Process::Control, Process::Experiment,
        ],
        real_time: Some(RealTimeLoop { priority: 85, rate_hz: 1000, phase_us: 350 }),
        unit: DOCTOR,
    };
    /// Writes all topics to disk. Starts before the processes that it records and stops after them.
    Logger = 5, "logger" {
        topics: [event 13, heartbeat 15],
        after: &[Process::Keeper],
        silence_s: 5,
        stop_s: 20,
        oom_score: -500,
        unit: DOCTOR,
    };
    /// Plays protocols.
    Experiment = 6, "experiment" {
        topics: [event 14, heartbeat 16, timing 21],
        after: &[Process::Keeper, Process::Logger, Process::Acquisition, Process::Control],
        real_time: Some(RealTimeLoop { priority: 30, rate_hz: 500, phase_us: 420 }),
        silence_s: 5,
        stop_s: 5,
        oom_score: -100,
        unit: "# Learnt references outlast the rig; /etc/farreach/%i/environment may name another \
               folder.\nEnvironment=FARREACH_LEARNT=/var/lib/farreach/%i/learnt\n",
    };
    /// Serves the pages of operator and subject to browsers.
    Console = 9, "console" {
        topics: [event 27, heartbeat 28],
        after: &[Process::Keeper, Process::Logger],
        optional: true,
        silence_s: 5,
        oom_score: 0,
        network: true,
        unit: "# /etc/farreach/%i/environment may name another address.\n\
               Environment=FARREACH_CONSOLE=127.0.0.1:8321\n",
    };
    /// Runs the declared model beside the machine and tells when the machine departs from it.
    Monitor = 10, "monitor" {
        topics: [event 32, heartbeat 33],
        after: &[Process::Keeper, Process::Logger],
        optional: true,
        silence_s: 5,
        oom_score: 0,
    };
    /// Starts and restarts the others on a machine without systemd.
    Launcher = 7, "launcher";
    /// A person's command line.
    Operator = 8, "operator";
}

/// One process of a rig. Its name and what it does are the [`Process`]'s own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessEntry {
    /// Which process.
    pub process: Process,
    /// Processes that start before it and stop after it. All but the keeper wait for the keeper.
    pub after: &'static [Process],
    /// The card that it belongs to; it then runs with that card only.
    pub card: Option<CardKind>,
    /// Whether it runs only where it is asked for. The rig does not depend on it.
    pub optional: bool,
    /// Its real-time loop; `None` for a process without one.
    pub real_time: Option<RealTimeLoop>,
    /// Silence after which it is killed and started again (s).
    pub silence_s: u32,
    /// Time that it has to end in, before it is killed (s).
    pub stop_s: u32,
    /// `oom_score_adj`: the lower, the later the kernel ends it when memory runs out.
    pub oom_score: i32,
    /// Whether it is reached through the network.
    pub network: bool,
    /// Further lines of its unit file's `[Service]` section, for systemd alone.
    pub unit: &'static str,
}

/// Where the watchdog and the logger find the doctor's reports under systemd.
const DOCTOR: &str = "# Reports of `farreach doctor`, which must be told the same folder.\n\
                      Environment=FARREACH_DOCTOR=/var/lib/farreach/%i/doctor\n";

/// An entry without particulars.
const STANDARD: ProcessEntry = ProcessEntry {
    process: Process::Keeper,
    after: &[],
    card: None,
    optional: false,
    real_time: None,
    silence_s: 2,
    stop_s: 3,
    oom_score: -900,
    network: false,
    unit: "",
};

/// A topic that several processes have, each its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ProcessTopic {
    /// Name of the topic, `event/control`.
    pub(crate) name: &'static str,
    /// What its messages are.
    pub(crate) kind: ProcessTopicKind,
    /// Its place in the table of topics; recordings hold it.
    pub(crate) place: usize,
}

/// The topics that several processes have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(non_camel_case_types, reason = "the word is the first part of the topic's name")]
pub(crate) enum ProcessTopicKind {
    /// Events: every process with ports.
    event,
    /// Heartbeats: a slow process.
    heartbeat,
    /// Timing of the loop: a periodic process.
    timing,
}

/// The real-time loop of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RealTimeLoop {
    /// Priority in `SCHED_FIFO`. The watchdog goes before all that it watches; who is read goes
    /// before who reads, but for the simulated card, which catches up; the experiment's setpoints
    /// have a lease of their own.
    pub priority: i32,
    /// Rate, unless the rig file gives another (Hz).
    pub rate_hz: u32,
    /// Start within its period, unless the rig file gives another (µs).
    pub phase_us: u32,
}

impl Process {
    /// Its entry in the table; `None` for launcher and operator.
    pub fn entry(self) -> Option<&'static ProcessEntry> {
        PROCESSES.iter().find(|entry| entry.process == self)
    }

    /// Its real-time loop; `None` for a process without one.
    pub fn real_time(self) -> Option<RealTimeLoop> {
        self.entry().and_then(|entry| entry.real_time)
    }
}

impl ProcessEntry {
    /// Short name of its unit.
    pub const fn name(&self) -> &'static str {
        self.process.text()
    }
}

/// The processes that every rig with a card has: those that belong to another card, and those that
/// run where they are asked for, are left out.
pub fn processes_with(card: CardKind) -> impl Iterator<Item = &'static ProcessEntry> {
    PROCESSES.iter().filter(move |entry| !entry.optional && entry.card.is_none_or(|of| of == card))
}
