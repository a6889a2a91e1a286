//! The messages of a recording that the analysis needs, in the order of the file.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::bail;
use ipc_types::{
    AXES, CardScan, EnableToken, Event, LoopTiming, Message, MotorCommand, Sample, TOPICS,
};
use recording::mcap_read::{Channel, Check, ReadError, Recording, Selection};
use recording::mcap_write::key;

/// The messages and metadata of one recording.
#[derive(Debug, Default)]
pub struct Trace {
    /// Samples of acquisition.
    pub samples: Vec<Sample>,
    /// Commands of control.
    pub commands: Vec<MotorCommand>,
    /// Scans of the card: the evidence of which volts reached the motor.
    pub scans: Vec<CardScan>,
    /// Tokens of the watchdog.
    pub tokens: Vec<EnableToken>,
    /// Timing of every loop, once a second.
    pub timings: Vec<LoopTiming>,
    /// Events of all processes, in the order of time.
    pub events: Vec<Event>,
    /// Counts, gaps, damage.
    pub check: Check,
    /// The logger's counters at the end, by topic: gaps, dropped, refused.
    pub counted: Vec<(String, u64)>,
    /// Size of the file (bytes).
    pub bytes: u64,
    /// Time of the first scan (ns, CLOCK_MONOTONIC).
    pub begin_ns: u64,
    /// Git revision of the build that recorded, where the recording says so.
    pub revision: Option<String>,
}

impl Trace {
    /// Reads a recording; damaged chunks are skipped and listed in [`Trace::check`].
    ///
    /// # Errors
    /// Where it cannot be read or holds no samples.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let recording = Recording::open(path)?;
        let mut trace = Self::default();
        let wanted = recording.channels.iter();
        let decoders: BTreeMap<u16, Decoder<'_>> =
            wanted.filter_map(|(id, channel)| Some((*id, decoder(channel)?))).collect();
        let channels = Some(decoders.keys().copied().collect());
        for message in recording.raw(Selection { channels, ..Selection::default() }) {
            match message {
                Ok(message) => {
                    if let Some(decode_into) = decoders.get(&message.channel_id()) {
                        decode_into(&mut trace, message.data());
                    }
                }
                // Counted in the check; what follows is read.
                Err(ReadError::Damaged { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        if trace.samples.is_empty() {
            bail!(
                "{}: expected samples of acquisition, found none; was the recording started after \
                    the rig went down?",
                path.display()
            );
        }
        trace.begin_ns = trace.samples.iter().map(|sample| sample.scan_time_ns).min().unwrap_or(0);
        trace.events.sort_by_key(|event| event.time_ns);
        if let Some(end) = recording.end_record() {
            let of = |name: &str, counter: &str| {
                end.get(&format!("{name}.{counter}"))
                    .and_then(|text| text.parse::<u64>().ok())
                    .unwrap_or(0)
            };
            let lost = |name| of(name, "gaps") + of(name, "dropped") + of(name, "refused");
            trace.counted =
                TOPICS.iter().map(|topic| (topic.name.to_owned(), lost(topic.name))).collect();
        }
        trace.check = recording.check()?;
        trace.bytes = recording.bytes;
        trace.revision = recording.metadata(key::REVISION).map(str::to_owned);
        Ok(trace)
    }

    /// Seconds since the first scan; negative before it.
    pub fn seconds(&self, time_ns: u64) -> f64 {
        (time_ns as i128 - i128::from(self.begin_ns)) as f64 * 1e-9
    }
}

/// Decodes a payload and adds the message to those of its type. One that cannot be decoded is left
/// out; the check counts it.
type Decoder<'a> = Box<dyn Fn(&mut Trace, &[u8]) + 'a>;

/// The decoder of a channel's messages; `None` where the analysis does not need them.
fn decoder(channel: &Channel) -> Option<Decoder<'_>> {
    match channel.schema_name.as_str() {
        Sample::ROS_NAME => decode_to(channel, |trace| &mut trace.samples),
        MotorCommand::ROS_NAME => decode_to(channel, |trace| &mut trace.commands),
        CardScan::ROS_NAME => decode_to(channel, |trace| &mut trace.scans),
        EnableToken::ROS_NAME => decode_to(channel, |trace| &mut trace.tokens),
        LoopTiming::ROS_NAME => decode_to(channel, |trace| &mut trace.timings),
        Event::ROS_NAME => decode_to(channel, |trace| &mut trace.events),
        _ => None,
    }
}

fn decode_to<T: Message>(
    channel: &Channel,
    messages: fn(&mut Trace) -> &mut Vec<T>,
) -> Option<Decoder<'_>> {
    let layout = channel.layout.as_ref().ok()?;
    let conversion = layout.conversion::<T>();
    Some(Box::new(move |trace, payload| {
        let message: Option<T> = layout.body(payload).ok().and_then(|body| conversion.apply(body));
        messages(trace).extend(message);
    }))
}

/// The samples by tick, each tick once: a restarted acquisition may publish a scan again that its
/// predecessor published last.
pub(crate) fn by_tick(samples: &[Sample]) -> Vec<&Sample> {
    let mut rows: Vec<&Sample> = samples.iter().collect();
    rows.sort_by_key(|row| row.tick);
    rows.dedup_by_key(|row| row.tick);
    rows
}

/// Master position of axis 0 (rad or m); NaN where it has no encoder.
pub(crate) fn master(sample: &Sample) -> f64 {
    present(sample.master_present, sample.master_position)
}

/// Slave position of axis 0 (rad or m); NaN where it has no encoder.
pub(crate) fn slave(sample: &Sample) -> f64 {
    present(sample.slave_present, sample.slave_position)
}

/// Torque of the hand on axis 0 (N·m or N); NaN where it has no torque cell.
pub(crate) fn torque(sample: &Sample) -> f64 {
    present(sample.torque_present, sample.slave_torque)
}

fn present(bits: u8, [first, ..]: [f64; AXES]) -> f64 {
    if bits & 1 == 1 { first } else { f64::NAN }
}
