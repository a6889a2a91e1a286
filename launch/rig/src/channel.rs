//! Analog inputs.

use emg::Group;
use ipc_types::ANALOG;

use crate::checked_toml::{Keys, Section, Source, bounds};

/// One analog input of the card.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Input of the card, from 0, and index in `Sample::analog_v`.
    pub index: usize,
    /// Name on screens and in exports.
    pub name: String,
    /// Kind of the measured quantity.
    pub kind: ChannelKind,
    /// Unit of the measured quantity (`V`, `mV`, `N·m`).
    pub unit: String,
    /// The measured quantity, in its unit, for a volt at the input.
    pub per_v: f64,
    /// Muscle under the electrodes; empty where the file does not say.
    pub muscle: String,
    /// The group of that muscle.
    pub group: Option<Group>,
    /// The input's range is ± this (V).
    pub range_v: f64,
}

/// What an analog input measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelKind {
    /// Torque or force at the handle.
    Torque,
    /// Electromyogram.
    Emg,
    /// Volume pulses of the MRI scanner.
    Trigger,
    /// Anything else.
    Other,
}

impl ChannelKind {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("torque", Self::Torque),
        ("emg", Self::Emg),
        ("trigger", Self::Trigger),
        ("other", Self::Other),
    ];
}

const KEYS: Keys = &[
    ("index", "Input of the card, from 0."),
    ("name", "Name on screens and in exports."),
    ("kind", "What the input measures."),
    ("unit", "Unit of the measured quantity; V, if left out."),
    ("per_v", "The measured quantity, in its unit, for a volt at the input (not of kind torque)."),
    ("muscle", "Muscle under the electrodes (kind emg)."),
    ("group", "Whether that muscle moves the handle in the positive direction (kind emg)."),
    ("range_v", "The input's range is ± this."),
];

impl Channel {
    pub(crate) fn read(section: Section<'_>) -> Self {
        section.document("[[channels]]", KEYS);
        let inputs = "the card has 16 inputs, counted from 0";
        let range = bounds(0.05, 10.0, "the card measures ±0.05 V to ±10 V");
        let kind = section.word("kind", ChannelKind::WORDS).unwrap_or(ChannelKind::Other);
        let scale = bounds(-1e9, 1e9, "an amplifier of 1000 gives 1 mV for a volt");
        let per_v = section.number_or("per_v", 1.0, scale);
        if per_v == 0.0 {
            section.problem("per_v", "a number other than 0", 0, "see the amplifier's gain");
        }
        let groups = &Group::ALL.map(|group| (group.word(), group));
        let (muscle, group) =
            (section.text_or_none("muscle"), section.word_or_none("group", groups));
        if kind != ChannelKind::Emg {
            for key in ["muscle", "group"] {
                section.misplaced(key, "nothing: the channel's kind is not emg", "take it out");
            }
        }
        if kind == ChannelKind::Torque {
            let expected = "nothing: [axes.torque] has the sensitivity";
            section.misplaced("per_v", expected, "take it out");
        }
        Self {
            index: section.whole("index", 0, ANALOG as u64 - 1, inputs) as usize,
            name: section.text("name"),
            kind,
            unit: section.text_or_none("unit").unwrap_or_else(|| "V".to_owned()),
            per_v,
            muscle: muscle.unwrap_or_default(),
            group,
            range_v: section.number_or("range_v", 10.0, range),
        }
    }

    /// Checks that inputs and names are unique.
    pub(crate) fn check_all(channels: &[Self], source: &Source<'_>) {
        for (at, channel) in channels.iter().enumerate() {
            for (before, other) in channels[..at].iter().enumerate() {
                if other.index == channel.index {
                    let expected = format!(
                        "an input of its own (channels.{before} has {} already)",
                        other.index
                    );
                    let advice = "each input appears once";
                    let found = channel.index;
                    source.problem(&format!("channels.{at}.index"), expected, found, advice);
                }
                if other.name == channel.name {
                    let expected = format!("a name of its own (channels.{before} has it already)");
                    let found = format!("the text \"{}\"", channel.name);
                    let advice = "names tell channels apart in exports";
                    source.problem(&format!("channels.{at}.name"), expected, found, advice);
                }
            }
        }
    }
}
