//! The signals of a recording, with the names and units of its rig file.

use anyhow::Context;
use ipc_types::{ANALOG, AXES, Sample};
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use rig::{AxisUnit, ChannelKind, RigFile, SyncOutput};

/// One signal of every sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// Name: that of the channel, or the axis's with what is measured.
    pub name: String,
    /// Unit of its values.
    pub unit: String,
    pub(crate) source: Source,
}

/// Where in a sample a signal is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Source {
    /// Position of the motor of an axis.
    Master(usize),
    /// Position of the handle of an axis.
    Slave(usize),
    /// Torque or force of the hand on an axis.
    Torque(usize),
    /// Volts at the motor of an axis.
    MotorVolts(usize),
    /// An input of the card, with the measured quantity for a volt.
    Analog(usize, f64),
    /// The digital output for sessions: 1 during its pulse.
    Sync(SyncOutput),
}

impl Signal {
    /// Its value in a sample; NaN where the sample does not have it.
    pub fn value(&self, sample: &Sample) -> f64 {
        let present = |bits: u8, axis: usize| bits & 1 << axis != 0;
        let value = match self.source {
            Source::Master(axis) => {
                (present(sample.master_present, axis), sample.master_position[axis])
            }
            Source::Slave(axis) => {
                (present(sample.slave_present, axis), sample.slave_position[axis])
            }
            Source::Torque(axis) => {
                (present(sample.torque_present, axis), sample.slave_torque[axis])
            }
            Source::MotorVolts(axis) => (present(sample.motor_present, axis), sample.motor_v[axis]),
            Source::Analog(input, per_v) => {
                (sample.analog_present & 1 << input != 0, per_v * sample.analog_v[input])
            }
            Source::Sync(output) => {
                let level = sample.digital_out & 1 << output.output;
                (true, f64::from(level == output.levels(true)))
            }
        };
        if value.0 { value.1 } else { f64::NAN }
    }
}

/// The rig file of a recording.
///
/// # Errors
/// Where the recording has none, or one that this version does not accept.
pub fn rig_file(recording: &Recording) -> anyhow::Result<RigFile> {
    let name = recording.path().display();
    let text = recording
        .metadata(key::RIG_FILE)
        .with_context(|| format!("{name}: it holds no rig file, and so no names and units"))?;
    RigFile::parse(text, "rig file")
        .with_context(|| format!("{name}: its rig file is not one of this version"))
}

/// The signals of a rig: positions, torque and motor voltage of each axis, then the inputs of the
/// card, and the output for sessions. A torque cell's input is left out, as its torque is there.
pub fn signals(rig: &RigFile) -> Vec<Signal> {
    let mut signals = Vec::new();
    for (at, axis) in rig.axes.iter().enumerate().take(AXES) {
        let (position, force) = match axis.unit {
            AxisUnit::Radian => ("rad", "N·m"),
            AxisUnit::Metre => ("m", "N"),
        };
        let mut add = |what: &str, unit: &str, source| {
            let name = format!("{}_{what}", axis.name);
            signals.push(Signal { name, unit: unit.to_owned(), source });
        };
        add("master", position, Source::Master(at));
        if axis.slave.is_some() {
            add("slave", position, Source::Slave(at));
        }
        if axis.torque.is_some() {
            add("torque", force, Source::Torque(at));
        }
        add("motor", "V", Source::MotorVolts(at));
    }
    let inputs = rig.channels.iter().filter(|channel| channel.index < ANALOG);
    signals.extend(inputs.filter(|channel| channel.kind != ChannelKind::Torque).map(|channel| {
        let source = Source::Analog(channel.index, channel.per_v);
        Signal { name: channel.name.clone(), unit: channel.unit.clone(), source }
    }));
    signals.extend(rig.sync.map(|output| {
        let (name, unit) = ("sync_output".to_owned(), "1".to_owned());
        Signal { name, unit, source: Source::Sync(output) }
    }));
    signals
}
