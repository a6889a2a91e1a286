//! The line on which the scanner's trigger comes in.

use scanner::{Line, LineKind};

use crate::channel::{Channel, ChannelKind};
use crate::checked_toml::{Keys, Section, Source, bounds};

/// The line on which the scanner's trigger comes in, and how it is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScannerLine {
    /// Where the line is connected.
    pub input: ScannerInput,
    /// How its level is read.
    pub line: Line,
}

/// Where the trigger line is connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScannerInput {
    /// An analog input of the card, from 0.
    Analog(usize),
    /// A digital input of the card, from 0: 1 V stands for a high level, 0 V for a low one.
    Digital(u32),
}

/// Number of digital inputs of a card.
const DIGITAL: u64 = 32;
/// Placeholder for an input that is not there; a checked file has none.
const NOWHERE: ScannerInput = ScannerInput::Analog(usize::MAX);

const KEYS: Keys = &[
    ("channel", "Name of the analog channel; the first of kind `trigger`, if left out."),
    ("digital", "Digital input of the card, from 0; instead of `channel`."),
    ("kind", "What a volume is: a pulse, a change of the level, or a part of a long gate."),
    ("active", "Whether the line is active below or above the threshold."),
    ("threshold_v", "Level between idle and active."),
    ("hysteresis_v", "Width of the band about the threshold in which the line keeps its state."),
    ("minimum_width_s", "A level that lasts for a shorter time is a glitch, and is counted so."),
];

impl ScannerLine {
    /// Reads `[scanner]`. Without the section, the first channel of kind `trigger` is read as the
    /// thesis does: active below 2 V.
    pub(crate) fn read(section: Section<'_>, channels: &[Channel]) -> Option<Self> {
        section.document("[scanner]", KEYS);
        let first = channels.iter().find(|channel| channel.kind == ChannelKind::Trigger);
        let usual = Line::default();
        let kinds =
            &[("pulse", LineKind::Pulse), ("toggle", LineKind::Toggle), ("gate", LineKind::Gate)];
        let levels = bounds(-10.0, 10.0, "in V, within the channel's range");
        let band = bounds(0.0, 10.0, "in V; more than the noise of the line");
        let width = bounds(0.0, 10.0, "in s; shorter than a pulse, longer than a disturbance");
        let digital = section.whole_or_none("digital", 0, DIGITAL - 1, "inputs count from 0");
        let name = section.text_or_none("channel");
        let named = |name: &String| channels.iter().find(|channel| channel.name == *name);
        let input = match (digital, &name) {
            (Some(input), _) => ScannerInput::Digital(input as u32),
            (None, Some(name)) => {
                named(name).map_or(NOWHERE, |found| ScannerInput::Analog(found.index))
            }
            (None, None) => first.map_or(NOWHERE, |found| ScannerInput::Analog(found.index)),
        };
        let (threshold_v, hysteresis_v) = match digital {
            None => (
                section.number_or("threshold_v", usual.threshold_v, levels),
                section.number_or("hysteresis_v", usual.hysteresis_v, band),
            ),
            Some(_) => {
                for key in ["channel", "threshold_v", "hysteresis_v"] {
                    section.misplaced(key, "nothing beside `digital`", "take one of the two out");
                }
                (0.5, 0.2)
            }
        };
        let active_low =
            section.word_or("active", &[("low", true), ("high", false)], usual.active_low);
        let line = Line {
            kind: section.word_or("kind", kinds, usual.kind),
            active_low,
            threshold_v,
            hysteresis_v,
            minimum_width_s: section.number_or("minimum_width_s", usual.minimum_width_s, width),
        };
        (section.exists() || first.is_some()).then_some(Self { input, line })
    }

    /// Checks that the line is connected to a channel that can carry its levels.
    pub(crate) fn check(line: Option<&Self>, channels: &[Channel], source: &Source<'_>) {
        let Some(Self { input: ScannerInput::Analog(index), line }) = line else { return };
        // An input that two channels have is told elsewhere.
        let mut of_input = channels.iter().filter(|channel| channel.index == *index);
        let trigger = of_input.clone().find(|channel| channel.kind == ChannelKind::Trigger);
        let Some(channel) = trigger.or_else(|| of_input.next()) else {
            let names: Vec<_> = channels
                .iter()
                .filter(|channel| channel.kind == ChannelKind::Trigger)
                .map(|channel| format!("\"{}\"", channel.name))
                .collect();
            let expected = match names.is_empty() {
                true => "a [[channels]] entry of kind \"trigger\", or `digital`".to_owned(),
                false => format!("the name of a channel: {}", names.join(", ")),
            };
            let advice = "add the channel, or say `digital = N`";
            source.problem("scanner.channel", expected, "no such channel", advice);
            return;
        };
        if channel.kind != ChannelKind::Trigger {
            let expected = "a channel of kind \"trigger\"";
            let advice = "change the channel's kind, or name another";
            source.problem("scanner.channel", expected, &channel.name, advice);
        }
        let reach = line.threshold_v.abs() + 0.5 * line.hysteresis_v;
        if reach >= channel.range_v {
            let range = channel.range_v;
            let expected = format!("levels within the ±{range} V of \"{}\"", channel.name);
            let advice = "lower threshold_v or hysteresis_v, or widen the channel's range_v";
            source.problem("scanner.threshold_v", expected, format!("{reach} V"), advice);
        }
    }

    /// Voltage of the line in a scan (V); `None` where the input is not among those read.
    pub fn volts(&self, analog_v: &[f64], digital_in: u32) -> Option<f64> {
        match self.input {
            ScannerInput::Analog(index) => analog_v.get(index).copied(),
            ScannerInput::Digital(bit) => Some(f64::from(digital_in >> bit & 1)),
        }
    }
}
