//! How the rig is wired to a card that Linux's comedi drivers know.

use comedi::{CounterMode, Edges};
use ipc_types::ANALOG;

use crate::checked_toml::{Bounds, Keys, Section, bounds};

/// The wiring of a comedi card: which subdevice and channel is what.
#[derive(Clone, Debug, PartialEq)]
pub struct ComediCard {
    /// Node of the device.
    pub device: String,
    /// Driver that must be attached to it; `None` for any.
    pub driver: Option<String>,
    /// Reference of the analog inputs, as comedi numbers it.
    pub reference: u32,
    /// Time from channel to channel within a scan (ns); 0 for all at once, or as fast as possible.
    pub convert_ns: u32,
    /// Subdevice of the analog inputs; `None` for the first that streams.
    pub input: Option<u32>,
    /// Subdevice of the analog outputs; `None` for the first.
    pub output: Option<u32>,
    /// Corrections of analog inputs.
    pub calibration: Vec<InputCalibration>,
    /// One for each axis of the rig.
    pub axes: Vec<ComediAxis>,
    /// The motor's enable line; required with outputs.
    pub enable_line: Option<DigitalLines>,
    /// Where the card sees that the motor has power; required with outputs.
    pub motor_power: Option<SignalLine>,
    /// Digital inputs of the samples.
    pub digital_inputs: Option<DigitalLines>,
    /// Digital outputs for other instruments.
    pub digital_outputs: Option<DigitalLines>,
}

/// A straight line, from what a converter says in volts to volts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Volts for a volt.
    pub gain: f64,
    /// Volts at 0 V (V).
    pub offset_v: f64,
}

impl Calibration {
    /// Volts at the terminal for what the converter says (V).
    pub fn terminal_v(&self, converter_v: f64) -> f64 {
        self.gain * converter_v + self.offset_v
    }

    /// What the converter says for volts at the terminal (V).
    pub fn converter_v(&self, terminal_v: f64) -> f64 {
        (terminal_v - self.offset_v) / self.gain
    }
}

/// Calibration of an analog input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InputCalibration {
    /// Index of the analog input.
    pub index: usize,
    /// The straight line.
    pub line: Calibration,
}

/// Wiring of an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct ComediAxis {
    /// Output of the motor's voltage; `None` where the axis is measured only.
    pub output: Option<MotorOutput>,
    /// Index of the analog input that reads the motor's voltage back; `None` where there is none.
    pub readback: Option<usize>,
    /// Counter of the encoder at the motor.
    pub master: EncoderCounter,
    /// Counter of the encoder at the handle.
    pub slave: Option<EncoderCounter>,
    /// Where the encoder at the motor, or what is at its cable, reports a fault.
    pub master_fault: Option<SignalLine>,
    /// The same of the encoder at the handle.
    pub slave_fault: Option<SignalLine>,
    /// The same of the torque cell's amplifier.
    pub torque_fault: Option<SignalLine>,
}

/// An analog output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorOutput {
    /// Channel of the output subdevice.
    pub channel: u32,
    /// The range that is chosen holds ± this (V).
    pub range_v: f64,
    /// From the converter's volts to volts at the terminal.
    pub calibration: Calibration,
}

/// A counter that follows an encoder.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct EncoderCounter {
    /// Node of its device; `None` for that of the card.
    pub device: Option<String>,
    /// Its subdevice.
    pub subdevice: u32,
    /// Its channel.
    pub channel: u32,
    /// How it is made to follow the encoder.
    pub mode: CounterMode,
    /// Terminals (PFI) of the encoder's signals A and B, where the card lets them be chosen.
    pub inputs: Option<[u32; 2]>,
}

/// Digital lines side by side.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DigitalLines {
    /// Node of their device; `None` for that of the card.
    pub device: Option<String>,
    /// Their subdevice.
    pub subdevice: u32,
    /// The first of them.
    pub first: u32,
    /// How many.
    pub count: u32,
}

/// An input that says yes or no: whether the motor has power, or a sensor a fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SignalLine {
    /// One line.
    pub line: DigitalLines,
    /// Whether the line is low while it says yes.
    pub active_low: bool,
}

const SUBDEVICES: u64 = 255;
const CHANNELS: u64 = 65_535;
const LINES: u64 = 32;
const CONVERT_US: Bounds = bounds(0.0, 500.0, "in µs; 0 for the fastest");
const RANGE_V: Bounds = bounds(0.1, 10.0, "in V; the card's narrowest range that holds ± this");
const GAIN: Bounds = bounds(-100.0, 100.0, "near 1 for a card alone; see docs/comedi.md");
const OFFSET_V: Bounds = bounds(-100.0, 100.0, "in V; see docs/comedi.md");
const REFERENCES: &[(&str, u32)] =
    &[("ground", 0), ("common", 1), ("differential", 2), ("other", 3)];
const MODES: &[(&str, CounterMode)] = &[
    ("none", CounterMode::Counting),
    ("quadrature-x1", CounterMode::Quadrature(Edges::One)),
    ("quadrature-x2", CounterMode::Quadrature(Edges::Two)),
    ("quadrature-x4", CounterMode::Quadrature(Edges::Four)),
    ("s626", CounterMode::S626),
];

const KEYS: Keys = &[
    ("device", "Node of the device; `/dev/comedi0`, if left out."),
    ("driver", "Its driver; another one is refused. Any, if left out."),
    ("reference", "Reference of the analog inputs."),
    ("convert_us", "Time from channel to channel within a scan, in µs; 0 for the fastest."),
    ("input", "Subdevice of the analog inputs; the first that streams, if left out."),
    ("output", "Subdevice of the analog outputs; the first, if left out."),
    ("calibration", "Corrections of analog inputs."),
    ("axes", "One for each of [[axes]], in their order."),
    ("enable_line", "The motor's enable line; required where an axis has an output."),
    ("motor_power", "Sees that the motor has power; required where an axis has an output."),
    ("digital", "Digital inputs of the samples, and outputs for other instruments."),
];

impl ComediCard {
    /// Reads `[comedi]`; `None` where there is no such section.
    pub(crate) fn read(section: Section<'_>) -> Option<Self> {
        section.document("[comedi]", KEYS);
        if !section.exists() {
            return None;
        }
        let digital = section.section("digital");
        digital.document("[comedi.digital]", DIGITAL_KEYS);
        let subdevice = "subdevices count from 0; `/proc/comedi` and the driver's manual list them";
        let number = |key| section.whole_or_none(key, 0, SUBDEVICES, subdevice).map(|n| n as u32);
        let calibrations = section.sections("calibration");
        Some(Self {
            device: section.text_or_none("device").unwrap_or_else(|| "/dev/comedi0".to_owned()),
            driver: section.text_or_none("driver"),
            reference: section.word_or("reference", REFERENCES, 0),
            convert_ns: (section.number_or("convert_us", 0.0, CONVERT_US) * 1e3).round() as u32,
            input: number("input"),
            output: number("output"),
            calibration: calibrations.into_iter().map(InputCalibration::read).collect(),
            axes: section.sections("axes").into_iter().map(ComediAxis::read).collect(),
            enable_line: DigitalLines::read_one(
                &section.section("enable_line"),
                "[comedi.enable_line]",
                LINE_KEYS,
            ),
            motor_power: SignalLine::read(
                section.section("motor_power"),
                "[comedi.motor_power]",
                POWER_KEYS,
            ),
            digital_inputs: DigitalLines::read_several(digital.section("inputs")),
            digital_outputs: DigitalLines::read_several(digital.section("outputs")),
        })
    }

    /// Whether the motors are driven by this card. A checked file has outputs for all axes or for
    /// none.
    pub fn has_outputs(&self) -> bool {
        self.axes.iter().any(|axis| axis.output.is_some())
    }

    /// Whether the card sees if the motor that it drives has power.
    pub fn reports_power(&self) -> bool {
        self.has_outputs() && self.motor_power.is_some()
    }

    /// The inputs that say yes or no, each with its key: motor power, and faults of sensors.
    pub fn signals(&self) -> Vec<(String, &SignalLine)> {
        let power = self.motor_power.iter().map(|line| ("comedi.motor_power".to_owned(), line));
        let faults = self.axes.iter().enumerate().flat_map(|(at, axis)| {
            let lines = axis.fault_lines().into_iter();
            lines.filter_map(move |(name, line)| Some((format!("comedi.axes.{at}.{name}"), line?)))
        });
        power.chain(faults).collect()
    }

    /// The node of a device that a part of the wiring may name.
    pub fn node<'a>(&'a self, device: &'a Option<String>) -> &'a str {
        device.as_deref().unwrap_or(&self.device)
    }
}

const CALIBRATION_KEYS: Keys = &[
    ("index", "Input of the card, as in [[channels]]."),
    ("gain", "Volts for a volt of the nominal range."),
    ("offset_v", "Volts where the nominal range says 0 V."),
];

impl InputCalibration {
    fn read(section: Section<'_>) -> Self {
        section.document("[[comedi.calibration]]", CALIBRATION_KEYS);
        let inputs = "the index of one of [[channels]]";
        Self {
            index: section.whole("index", 0, ANALOG as u64 - 1, inputs) as usize,
            line: Calibration::read(&section, ["gain", "offset_v"]),
        }
    }
}

impl Calibration {
    fn read(section: &Section<'_>, [gain, offset]: [&str; 2]) -> Self {
        let factor = section.number_or(gain, 1.0, GAIN);
        if factor == 0.0 {
            section.problem(gain, "a number other than 0", 0, "1 for no correction");
        }
        Self { gain: factor, offset_v: section.number_or(offset, 0.0, OFFSET_V) }
    }
}

const AXIS_KEYS: Keys = &[
    ("output_channel", "Channel of the motor's voltage; required where the rig has outputs."),
    ("output_range_v", "The output's range holds ± this."),
    ("output_gain", "Volts at the terminal for a volt of the nominal range."),
    ("output_offset_v", "Volts at the terminal where the nominal range says 0 V."),
    ("readback", "Index of the analog input that reads the motor's voltage back."),
    ("master", "Counter of the encoder at the motor; required."),
    ("slave", "Counter of the encoder at the handle; required with [axes.slave]."),
    ("master_fault", "Sees a fault of the encoder at the motor, which is then absent."),
    ("slave_fault", "Sees a fault of the encoder at the handle."),
    ("torque_fault", "Sees a fault of the torque cell's amplifier, whose input is then absent."),
];

impl ComediAxis {
    fn read(section: Section<'_>) -> Self {
        section.document("[[comedi.axes]]", AXIS_KEYS);
        let channel = section.whole_or_none("output_channel", 0, CHANNELS, "channels count from 0");
        let output = MotorOutput {
            channel: channel.unwrap_or_default() as u32,
            range_v: section.number_or("output_range_v", 10.0, RANGE_V),
            calibration: Calibration::read(&section, ["output_gain", "output_offset_v"]),
        };
        let inputs = "the index of one of [[channels]]";
        let readback = section.whole_or_none("readback", 0, ANALOG as u64 - 1, inputs);
        if !section.has("master") {
            let advice = "control needs the master's position";
            section.problem("master", "the counter of the master's encoder", "nothing", advice);
        }
        let slave = section.section("slave");
        let fault = |key| SignalLine::read(section.section(key), FAULT_SECTIONS, FAULT_KEYS);
        Self {
            output: channel.map(|_| output),
            readback: readback.map(|index| index as usize),
            master: EncoderCounter::read(section.section("master")),
            slave: slave.exists().then(|| EncoderCounter::read(slave)),
            master_fault: fault("master_fault"),
            slave_fault: fault("slave_fault"),
            torque_fault: fault("torque_fault"),
        }
    }

    /// The lines that report faults of master, slave and torque cell, each with its key.
    pub const fn fault_lines(&self) -> [(&'static str, Option<&SignalLine>); 3] {
        [
            ("master_fault", self.master_fault.as_ref()),
            ("slave_fault", self.slave_fault.as_ref()),
            ("torque_fault", self.torque_fault.as_ref()),
        ]
    }
}

const COUNTER_KEYS: Keys = &[
    ("device", "Node of its device, where it is on another one."),
    ("subdevice", "Subdevice of the counter."),
    ("channel", "Channel of the counter."),
    ("mode", "How it is made to follow the encoder; `none` for a counter that counts already."),
    ("a", "Terminal (PFI) of the encoder's A; M series only."),
    ("b", "Terminal (PFI) of the encoder's B; M series only."),
];

impl EncoderCounter {
    fn read(section: Section<'_>) -> Self {
        section.document("[comedi.axes.master] and [comedi.axes.slave]", COUNTER_KEYS);
        let subdevices = "`/proc/comedi` and the driver's manual list the subdevices";
        let mode = section.word("mode", MODES).unwrap_or(CounterMode::Counting);
        let terminals = "PFI 0 to 15 of the card's connector";
        let [a, b] = ["a", "b"]
            .map(|key| section.whole_or_none(key, 0, 15, terminals).map(|pfi| pfi as u32));
        let inputs = a.zip(b).map(|(a, b)| [a, b]);
        if a.is_some() != b.is_some() {
            let missing = if a.is_some() { "b" } else { "a" };
            section.problem(missing, "both terminals, or none", "one", "add the other");
        } else if inputs.is_some() && !matches!(mode, CounterMode::Quadrature(_)) {
            let expected = "nothing: the mode is not a quadrature";
            section.problem("a", expected, "terminals", "take `a` and `b` out");
        }
        Self {
            device: section.text_or_none("device"),
            subdevice: section.whole("subdevice", 0, SUBDEVICES, subdevices) as u32,
            channel: section.whole_or("channel", 0, 0, CHANNELS, "channels count from 0") as u32,
            mode,
            inputs,
        }
    }
}

const LINE_KEYS: Keys = &[
    ("device", "Node of its device, where it is on another one."),
    ("subdevice", "Subdevice of the line."),
    ("channel", "Channel of the line."),
];
const POWER_KEYS: Keys = &[
    ("device", "Node of its device, where it is on another one."),
    ("subdevice", "Subdevice of the line."),
    ("channel", "Channel of the line."),
    ("active", "Whether the line is high or low while the motor has power."),
];
const FAULT_SECTIONS: &str =
    "[comedi.axes.master_fault], [comedi.axes.slave_fault] and [comedi.axes.torque_fault]";
const FAULT_KEYS: Keys = &[
    ("device", "Node of its device, where it is on another one."),
    ("subdevice", "Subdevice of the line."),
    ("channel", "Channel of the line."),
    ("active", "Whether the line is high or low while there is a fault."),
];
const LINES_KEYS: Keys = &[
    ("device", "Node of their device, where they are on another one."),
    ("subdevice", "Subdevice of the lines."),
    ("first", "The channel of bit 0."),
    ("count", "Number of the lines."),
];
const DIGITAL_KEYS: Keys = &[
    ("inputs", "Digital inputs of the samples, from bit 0."),
    ("outputs", "Digital outputs for other instruments, from bit 0."),
];

impl DigitalLines {
    fn read_one(section: &Section<'_>, name: &'static str, keys: Keys) -> Option<Self> {
        section.document(name, keys);
        section.exists().then(|| Self {
            device: section.text_or_none("device"),
            subdevice: section.whole("subdevice", 0, SUBDEVICES, "subdevices count from 0") as u32,
            first: section.whole("channel", 0, LINES - 1, "lines count from 0") as u32,
            count: 1,
        })
    }

    fn read_several(section: Section<'_>) -> Option<Self> {
        section.document("[comedi.digital.inputs] and [comedi.digital.outputs]", LINES_KEYS);
        section.exists().then(|| Self {
            device: section.text_or_none("device"),
            subdevice: section.whole("subdevice", 0, SUBDEVICES, "subdevices count from 0") as u32,
            first: section.whole_or("first", 0, 0, LINES - 1, "lines count from 0") as u32,
            count: section.whole("count", 1, LINES, "lines side by side") as u32,
        })
    }

    /// The lines, one bit each by their channel.
    pub fn mask(&self) -> u32 {
        (0..32).filter(|line| self.contains(*line)).fold(0, |mask, line| mask | 1 << line)
    }

    /// Whether a channel of their subdevice is one of them.
    pub fn contains(&self, channel: u32) -> bool {
        (self.first..self.first + self.count).contains(&channel)
    }
}

impl SignalLine {
    fn read(section: Section<'_>, name: &'static str, keys: Keys) -> Option<Self> {
        let line = DigitalLines::read_one(&section, name, keys)?;
        let active_low = section.word_or("active", &[("high", false), ("low", true)], false);
        Some(Self { line, active_low })
    }

    /// Whether the line says yes at a level.
    pub const fn is_active(&self, high: bool) -> bool {
        high != self.active_low
    }
}
