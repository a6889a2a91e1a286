//! The channels: signals by the names of the rig file, and fields by path.

use anyhow::{Context, bail};
use ipc_types::{SAMPLE, Sample};
use recorder::Signal;
use recording::schema::{Conversion, Layout};
use recording::word;
use rig::RigFile;

use crate::fields::Element;
use crate::stream::{Arrived, Stamp, Stream};

/// Signals of an axis are named after it, with one of these.
const OF_AXIS: [&str; 4] = ["master", "slave", "torque", "motor"];
/// The fields of a sample that signals are read from.
const OF_SIGNALS: [&str; 11] = [
    "master_position",
    "slave_position",
    "slave_torque",
    "analog_v",
    "motor_v",
    "digital_out",
    "master_present",
    "slave_present",
    "torque_present",
    "motor_present",
    "analog_present",
];

/// A channel as asked for.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// Its name.
    pub name: String,
    /// Topic with its messages.
    pub topic: String,
    what: What,
}

#[derive(Clone, Debug)]
enum What {
    /// A signal of the rig file, in samples.
    Signal(Signal),
    /// A field or an element of one.
    Path(String),
}

/// The channels of these names, each once; the signals of the first axis if none is given. `rig` is
/// the rig file, where one is known.
///
/// # Errors
/// If there is no such channel: with those that there are.
pub fn wanted(names: &[String], rig: Option<&RigFile>) -> anyhow::Result<Vec<Wanted>> {
    let signals = rig.map(recorder::signals).unwrap_or_default();
    let named = |name: &str| signals.iter().find(|signal| signal.name == name);
    let of_axis = |axis: &str| {
        let known = rig.is_some_and(|rig| rig.axes.iter().any(|known| known.name == axis));
        let parts = OF_AXIS.iter().filter(|_| known);
        parts.filter_map(|part| named(&format!("{axis}_{part}"))).cloned().collect::<Vec<_>>()
    };
    let mut found: Vec<Wanted> = Vec::new();
    let mut add = |wanted: Wanted| {
        if !found.iter().any(|known| known.name == wanted.name) {
            found.push(wanted);
        }
    };
    let of_signal = |signal: &Signal| Wanted {
        name: signal.name.clone(),
        topic: SAMPLE.topic.name.to_owned(),
        what: What::Signal(signal.clone()),
    };
    if names.is_empty() {
        let first = rig.and_then(|rig| rig.axes.first());
        let first = first.context(
            "no rig file tells the channels: name some as TOPIC.FIELD[INDEX], such as \
             sample.master_position[0] (farreach probe list TOPIC)",
        )?;
        of_axis(&first.name).iter().map(of_signal).for_each(&mut add);
    }
    for name in names {
        let axis = of_axis(name);
        if let Some(signal) = named(name) {
            add(of_signal(signal));
        } else if !axis.is_empty() {
            axis.iter().map(of_signal).for_each(&mut add);
        } else if let Some((topic, field)) = name.split_once('.') {
            let what = What::Path(field.to_owned());
            add(Wanted { name: name.clone(), topic: topic.to_owned(), what });
        } else {
            let mut known: Vec<_> = signals.iter().map(|signal| signal.name.as_str()).collect();
            if known.is_empty() {
                known.push("(no rig file tells names)");
            }
            bail!(
                "channel {name}: expected one of {}; or TOPIC.FIELD[INDEX], such as \
                 sample.analog_v[0] (farreach probe list TOPIC)",
                known.join(", ")
            );
        }
    }
    Ok(found)
}

/// The topics of channels, each once.
pub(crate) fn topics_of(wanted: &[Wanted]) -> Vec<String> {
    let mut topics: Vec<String> = Vec::new();
    for channel in wanted {
        if !topics.contains(&channel.topic) {
            topics.push(channel.topic.clone());
        }
    }
    topics
}

/// A channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// Empty where nothing tells it.
    pub unit: String,
    /// Its topic (index of the stream, the reader and the ring), and its column there.
    pub place: (usize, usize),
}

/// Reads the channels of one topic from its messages.
#[derive(Debug)]
pub struct Reader {
    /// bytes from the start of a message to the time of its scan; `None` where it has none
    scan_time: Option<usize>,
    /// to samples of this build, where signals are read
    samples: Option<Conversion>,
    columns: Vec<Column>,
}

#[derive(Debug)]
enum Column {
    Signal(Signal),
    Element(Element),
}

/// Finds the channels in the topics: those channels, in the order in which they were asked for, and
/// a reader for each topic.
///
/// # Errors
/// If a topic does not have a field, or not all of the fields that a signal needs.
pub fn bind(wanted: &[Wanted], streams: &[Stream]) -> anyhow::Result<(Vec<Channel>, Vec<Reader>)> {
    let mut readers: Vec<Reader> = streams.iter().map(Reader::new).collect();
    let mut channels = Vec::with_capacity(wanted.len());
    for channel in wanted {
        let all = streams.iter().zip(&mut readers).enumerate();
        let mut of_topic = all.filter(|(_, (stream, _))| stream.name == channel.topic);
        let (Some((at, (stream, reader))), None) = (of_topic.next(), of_topic.next()) else {
            bail!(
                "channel {}: topic {} changes its fields within the recording: look at its parts \
                 one by one",
                channel.name,
                channel.topic
            );
        };
        let column = reader.columns.len();
        let unit = reader.add(channel, stream)?;
        channels.push(Channel { name: channel.name.clone(), unit, place: (at, column) });
    }
    Ok((channels, readers))
}

impl Reader {
    fn new(stream: &Stream) -> Self {
        let scan_time = stream.field("scan_time_ns").map(|field| field.offset);
        Self { scan_time, samples: None, columns: Vec::new() }
    }

    /// Adds a channel; its unit.
    fn add(&mut self, channel: &Wanted, stream: &Stream) -> anyhow::Result<String> {
        match &channel.what {
            What::Path(path) => {
                let element = Element::new(stream, path)
                    .with_context(|| format!("channel {}", channel.name))?;
                let unit = element.unit().to_owned();
                self.columns.push(Column::Element(element));
                Ok(unit)
            }
            What::Signal(signal) => {
                let layout = Layout {
                    name: stream.kind.clone(),
                    fields: stream.fields.clone(),
                    size: stream.size,
                };
                let samples = layout.conversion::<Sample>();
                let lacking = samples.missing.iter().find(|field| OF_SIGNALS.contains(field));
                if let Some(field) = lacking {
                    bail!(
                        "channel {}: the samples of this recording have no {field}: expected those \
                         of this version; name channels as sample.FIELD[INDEX] instead",
                        channel.name
                    );
                }
                self.samples = Some(samples);
                self.columns.push(Column::Signal(signal.clone()));
                Ok(signal.unit.clone())
            }
        }
    }

    /// Channels.
    pub(crate) fn width(&self) -> usize {
        self.columns.len()
    }

    /// When a message belongs on the axis of time: the time of its scan, or else of its publishing
    /// (ns, by the clock of its stamp).
    pub fn time_ns(&self, message: &Arrived<'_>) -> u64 {
        let scan_ns = self.scan_time.map(|at| word(message.bytes, at)).filter(|ns| *ns > 0);
        let time_ns = scan_ns.unwrap_or(message.sent.time_ns);
        match message.stamp {
            Stamp::Received(_) => time_ns,
            // A recording has a clock of its own.
            Stamp::Logged(logged_ns) => {
                logged_ns.wrapping_sub(message.sent.time_ns).wrapping_add(time_ns)
            }
        }
    }

    /// The values of its channels in a message; NaN where it does not have one.
    pub fn read(&self, bytes: &[u8], values: &mut Vec<f64>) {
        let sample = self.samples.as_ref().and_then(|samples| samples.apply::<Sample>(bytes));
        values.clear();
        values.extend(self.columns.iter().map(|column| match column {
            Column::Element(element) => element.value(bytes),
            Column::Signal(signal) => {
                sample.as_ref().map_or(f64::NAN, |sample| signal.value(sample))
            }
        }));
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::{COMMAND, Message, MotorCommand};

    use super::*;
    use crate::stream::tests::arrived;

    fn rig() -> RigFile {
        rig::load_rig(std::path::Path::new("hydrostatic")).unwrap()
    }

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    fn found(asked: &[&str]) -> Vec<String> {
        let found = wanted(&names(asked), Some(&rig())).unwrap();
        found.into_iter().map(|channel| channel.name).collect()
    }

    #[test]
    fn channels_have_the_names_of_the_rig_file_and_paths() {
        let axis = ["handle_master", "handle_slave", "handle_torque", "handle_motor"];
        assert_eq!(found(&[]), axis);
        assert_eq!(found(&["handle"]), axis);
        let asked = ["emg_3", "command.volts[0]", "handle_torque", "emg_3"];
        assert_eq!(found(&asked), ["emg_3", "command.volts[0]", "handle_torque"]);
        let asked = wanted(&names(&asked), Some(&rig())).unwrap();
        assert_eq!(topics_of(&asked), ["sample", "command"]);
    }

    #[test]
    fn an_unknown_channel_names_those_that_are_known() {
        let error = wanted(&names(&["handel"]), Some(&rig())).unwrap_err().to_string();
        assert!(error.contains("channel handel: expected one of handle_master, "), "{error}");
        assert!(
            error.contains("scanner_trigger") && error.contains("sample.analog_v[0]"),
            "{error}"
        );
        let error = wanted(&[], None).unwrap_err().to_string();
        assert!(error.contains("sample.master_position[0]"), "{error}");
        let streams = [Stream::of_topic(&COMMAND.topic)];
        let path = wanted(&names(&["command.volts"]), None).unwrap();
        let error = format!("{:#}", bind(&path, &streams).unwrap_err());
        assert!(error.contains("channel command.volts: ") && error.contains("volts[0]"), "{error}");
    }

    #[test]
    fn values_units_and_times_come_from_the_messages() {
        let asked = names(&["command.volts[1]", "handle_torque", "emg_1", "command.mode"]);
        let asked = wanted(&asked, Some(&rig())).unwrap();
        let mut streams = [Stream::of_topic(&SAMPLE.topic), Stream::of_topic(&COMMAND.topic)];
        let (channels, readers) = bind(&asked, &streams).unwrap();
        let units: Vec<_> = channels.iter().map(|channel| channel.unit.as_str()).collect();
        assert_eq!(units, ["V", "N·m", "mV", ""]);
        let places: Vec<_> = channels.iter().map(|channel| channel.place).collect();
        assert_eq!(places, [(1, 0), (0, 0), (0, 1), (1, 1)]);
        let mut sample = Sample { torque_present: 1, scan_time_ns: 900, ..Sample::default() };
        sample.slave_torque[0] = -0.5;
        sample.stamp(1, 2, 3, 1000);
        let mut values = Vec::new();
        readers[0].read(sample.as_bytes(), &mut values);
        assert_eq!(values[0], -0.5);
        assert!(values[1].is_nan(), "the channel is not present");
        let live = arrived(&mut streams, 0, sample.as_bytes(), 1100);
        assert_eq!(readers[0].time_ns(&live), 900);
        let recorded = Arrived { stamp: Stamp::Logged(7_000_001_000), ..live };
        assert_eq!(readers[0].time_ns(&recorded), 7_000_000_900);
        let mut command =
            MotorCommand { volts: [0.0, 1.5, 0.0], mode: 2, ..MotorCommand::default() };
        command.stamp(1, 2, 3, 2000);
        readers[1].read(command.as_bytes(), &mut values);
        assert_eq!(values, [1.5, 2.0]);
        let live = arrived(&mut streams, 1, command.as_bytes(), 2100);
        assert_eq!(readers[1].time_ns(&live), 2000);
    }

    #[test]
    fn a_recording_without_the_fields_of_a_signal_is_refused() {
        let text = "uint64 session\nfloat64[3] master_position\n";
        let layout = Layout::parse("farreach/msg/Sample", "ros2msg", text).unwrap();
        let streams = [Stream::of_recording("sample", &layout.fields, layout.size)];
        let asked = wanted(&names(&["handle_master"]), Some(&rig())).unwrap();
        let error = bind(&asked, &streams).unwrap_err().to_string();
        assert!(error.contains("no slave_position"), "{error}");
        let asked = wanted(&names(&["sample.master_position[0]"]), None).unwrap();
        assert_eq!(bind(&asked, &streams).unwrap().0[0].unit, "rad or m");
    }
}
