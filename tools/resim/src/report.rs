//! What running a core again has shown.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::difference::FieldDifference;

/// Why a message was not compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NotCompared {
    /// The recording begins in the midst of the process's life, and what it had in mind then does
    /// not follow from the messages yet.
    BeganBefore,
    /// Messages of the process are missing before it, and what it has in mind does not follow from
    /// the messages again yet.
    MessagesMissing,
    /// A message that the step used is not in the recording.
    InputMissing,
    /// The gate ran cycles before it of which no sample tells, and their times are not known well
    /// enough.
    CyclesWithoutSample,
    /// A program of somebody else's ran in place of the process.
    Replaced,
    /// The setpoint does not say from what it was computed: an older build sent it, or a program of
    /// somebody else's.
    NotNamed,
    /// The protocol that was played is not in the recording's metadata, or is none for its rig
    /// file.
    ProtocolMissing,
    /// The protocol went on after an interruption, and keeps to the scanner: how far that was
    /// followed before is in no recording.
    ScannerFollowedBefore,
    /// The reference was learnt before the run, or before it was interrupted, and comes from a file
    /// that is in no recording.
    LearntBefore,
}

impl NotCompared {
    /// In words.
    pub const fn text(self) -> &'static str {
        match self {
            Self::BeganBefore => "the process began before the recording",
            Self::MessagesMissing => "messages of the process are missing before it",
            Self::InputMissing => "a message that the step used is not in the recording",
            Self::CyclesWithoutSample => "after cycles of the gate that no sample tells of",
            Self::Replaced => "a program of somebody else's ran in its place",
            Self::NotNamed => {
                "it does not say from what it was computed: of an older build, or of a program of \
                 somebody else's"
            }
            Self::ProtocolMissing => {
                "the protocol that was played is not in the recording, or is none for its rig file"
            }
            Self::ScannerFollowedBefore => {
                "how far the scanner was followed before the interruption is in no recording"
            }
            Self::LearntBefore => "the reference was learnt before, and is in no recording",
        }
    }
}

/// A message that a step used, in words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Used {
    /// Topic.
    pub topic: &'static str,
    /// Incarnation of its sender.
    pub incarnation: u64,
    /// Its sequence number.
    pub sequence: u64,
    /// What it held.
    pub text: String,
}

impl Used {
    /// `sample 1234: tick 77, ...`.
    pub fn line(&self) -> String {
        format!("{} {}: {}", self.topic, self.sequence, self.text)
    }
}

/// The first message of a core that differs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Topic of the message.
    pub topic: &'static str,
    /// Incarnation of the process.
    pub incarnation: u64,
    /// Sequence number of the message.
    pub sequence: u64,
    /// Tick of the sample that it belongs to.
    pub tick: u64,
    /// Time since the recording began (s).
    pub at_s: f64,
    /// The field.
    #[serde(flatten)]
    pub field: FieldDifference,
    /// What the step used.
    pub inputs: Vec<Used>,
}

/// From when on the messages of a process were compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Begin {
    /// Time since the recording began (s).
    pub at_s: f64,
    /// Incarnation of the process.
    pub incarnation: u64,
    /// From what its state was known.
    pub from: &'static str,
}

/// One core, run again.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CoreReport {
    /// The core.
    pub core: &'static str,
    /// Topic of the messages that were compared.
    pub topic: &'static str,
    /// Messages in the recording.
    pub messages: u64,
    /// Messages that were compared.
    pub compared: u64,
    /// Messages of them that differ.
    pub differing: u64,
    /// Messages that were not compared, by reason.
    pub not_compared: BTreeMap<NotCompared, u64>,
    /// From when on it was compared.
    pub begins: Vec<Begin>,
    /// The first message that differs.
    pub first_difference: Option<Difference>,
}

impl CoreReport {
    pub(crate) fn new(core: &'static str, topic: &'static str) -> Self {
        Self {
            core,
            topic,
            messages: 0,
            compared: 0,
            differing: 0,
            not_compared: BTreeMap::new(),
            begins: Vec::new(),
            first_difference: None,
        }
    }

    /// Counts a message that was not compared.
    pub(crate) fn skip(&mut self, why: NotCompared) {
        *self.not_compared.entry(why).or_default() += 1;
    }

    /// Counts a message that was compared; `difference` is asked for where it is the first.
    pub(crate) fn compare(
        &mut self,
        field: Option<FieldDifference>,
        difference: impl FnOnce(FieldDifference) -> Difference,
    ) {
        self.compared += 1;
        let Some(field) = field else { return };
        self.differing += 1;
        if self.first_difference.is_none() {
            self.first_difference = Some(difference(field));
        }
    }
}

/// A trip or fault of the watchdog.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trip {
    /// Time since the recording began (s).
    pub at_s: f64,
    /// Incarnation of the watchdog.
    pub incarnation: u64,
    /// Sequence number of its token.
    pub sequence: u64,
    /// State that it went into.
    pub state: &'static str,
    /// Cause in the recording.
    pub recorded: String,
    /// Cause as computed again; `null` where the watchdog could not be run again.
    pub recomputed: Option<String>,
    /// All faults that were active, as computed again, the most specific first; as recorded where
    /// the watchdog could not be run again.
    pub faults: Vec<String>,
    /// What the step used: the newest sample and command, and their ages.
    pub inputs: Vec<Used>,
}

/// An axis's volts with the gains of another rig file, on the recorded inputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct VoltsDifference {
    /// Axis, from 0.
    pub axis: usize,
    /// Root mean square of the difference (V).
    pub rms_v: f64,
    /// Largest difference, by magnitude: other less recorded (V).
    pub largest_v: f64,
    /// When that was, since the recording began (s).
    pub largest_at_s: f64,
}

/// What another rig file's gains would have answered to the recorded inputs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OtherGains {
    /// Commands that were compared.
    pub commands: u64,
    /// Commands of them under power.
    pub powered: u64,
    /// The difference of the volts of the commands under power, by axis.
    pub volts: Vec<VoltsDifference>,
}

/// All that was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The cores.
    pub cores: Vec<CoreReport>,
    /// Trips and faults of the watchdog.
    pub trips: Vec<Trip>,
    /// With another rig file's gains.
    pub other_gains: Option<OtherGains>,
}

impl Report {
    /// Whether every message that was compared is the same.
    pub fn agrees(&self) -> bool {
        self.cores.iter().all(|core| core.differing == 0)
    }
}
