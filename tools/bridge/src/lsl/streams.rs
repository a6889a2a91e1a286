//! Which streams there are, with their channels.

use anyhow::bail;
use ipc_types::{Event, EventKind, Message, Process, Rate, SAMPLE, TOPICS, Topic};
use probe::Stream;
use probe::channel::{Channel, Reader, bind, wanted};
use rig::RigFile;

use super::clock_offset::ClockOffset;
use super::liblsl::{ChannelInfo, Format, StreamInfo};

/// Fields that every message has and that tell a receiver nothing, and those without a meaning.
const LEFT_OUT: [&str; 4] = ["session", "incarnation", "time_ns", "reserved"];

/// Whether the messages of a topic are events, which become markers.
pub(crate) fn has_events(topic: &Topic) -> bool {
    topic.type_name == Event::TYPE_NAME
}

/// The topics whose messages become markers.
pub(crate) fn event_topics() -> impl Iterator<Item = &'static Topic> {
    TOPICS.iter().filter(|topic| has_events(topic))
}

/// The topics of these names; that of the samples if none is given.
///
/// # Errors
/// If there is no such topic, or it has events.
pub(crate) fn numeric_topics(names: &[String]) -> anyhow::Result<Vec<&'static Topic>> {
    let samples = [SAMPLE.topic.name.to_owned()];
    let topics = probe::topics(if names.is_empty() { &samples } else { names })?;
    if let Some(topic) = topics.iter().find(|topic| has_events(topic)) {
        bail!("topic {}: it holds events, all of which are in the stream of markers", topic.name);
    }
    Ok(topics)
}

/// Names of the channels of a topic: of the samples the signals of the rig file and the number of
/// the scan; of any other topic all its numbers, with the sequence number.
fn names_of(topic: &Topic, rig: &RigFile) -> Vec<String> {
    let name = topic.name;
    if name == SAMPLE.topic.name {
        let signals = recorder::signals(rig).into_iter().map(|signal| signal.name);
        return signals.chain([format!("{name}.tick")]).collect();
    }
    let fields = topic.fields.iter().filter(|field| !LEFT_OUT.contains(&field.name));
    let elements = fields.flat_map(|field| match field.array {
        None => vec![format!("{name}.{}", field.name)],
        Some(count) => (0..count).map(|at| format!("{name}.{}[{at}]", field.name)).collect(),
    });
    elements.collect()
}

/// Rate of a topic (Hz); 0 where it has none.
fn rate_hz(topic: &Topic, rig: &RigFile) -> f64 {
    let rates = &rig.rates;
    match topic.rate {
        Rate::Hertz(hertz) => f64::from(hertz),
        Rate::Sporadic => 0.0,
        Rate::Loop(Process::Acquisition | Process::Simulator) => f64::from(rates.acquisition_hz),
        Rate::Loop(Process::Control) => f64::from(rates.control_hz),
        Rate::Loop(Process::Watchdog) => f64::from(rates.watchdog_hz),
        Rate::Loop(Process::Experiment) => f64::from(rates.experiment_hz),
        Rate::Loop(_) => 0.0,
    }
}

/// The streams of a rig, on a computer.
pub(crate) struct Named<'a> {
    /// Name of the rig as it runs.
    pub(crate) rig_name: &'a str,
    pub(crate) rig: &'a RigFile,
    pub(crate) computer: &'a str,
    pub(crate) clock: ClockOffset,
}

impl Named<'_> {
    /// The streams of these topics, which are the first of `streams`, and what reads their values.
    ///
    /// # Errors
    /// If a topic lacks a field.
    pub(crate) fn numeric(
        &self,
        topics: &[&'static Topic],
        streams: &[Stream],
    ) -> anyhow::Result<Vec<(StreamInfo, Reader)>> {
        let names: Vec<String> =
            topics.iter().flat_map(|topic| names_of(topic, self.rig)).collect();
        let wanted = wanted(&names, Some(self.rig))?;
        let (channels, readers) = bind(&wanted, streams)?;
        let info = |(at, topic): (usize, &&'static Topic)| {
            let of_topic = channels.iter().filter(|channel| channel.place.0 == at);
            let kind = topic.ros_name.rsplit('/').next().unwrap_or(topic.ros_name);
            let channels = of_topic.map(|channel| channel_info(channel, topic.name)).collect();
            let rate_hz = rate_hz(topic, self.rig);
            self.info(topic.name, kind, rate_hz, Format::Double, channels)
        };
        Ok(topics.iter().enumerate().map(info).zip(readers).collect())
    }

    /// The stream of markers.
    pub(crate) fn markers(&self) -> StreamInfo {
        let channel = ChannelInfo { label: "marker".to_owned(), unit: String::new() };
        self.info("markers", "Markers", 0.0, Format::Text, vec![channel])
    }

    fn info(
        &self,
        what: &str,
        kind: &str,
        rate_hz: f64,
        format: Format,
        channels: Vec<ChannelInfo>,
    ) -> StreamInfo {
        StreamInfo {
            name: format!("{}.{what}", self.rig_name),
            kind: kind.to_owned(),
            source_id: format!("farreach/{}/{}/{what}", self.computer, self.rig_name),
            rate_hz,
            format,
            channels,
            about: vec![
                ("manufacturer", "farreach".to_owned()),
                ("farreach_version", env!("CARGO_PKG_VERSION").to_owned()),
                ("rig", self.rig.name.clone()),
                ("clock_offset_s", format!("{:.9}", self.clock.offset_s)),
                ("clock_uncertainty_s", format!("{:.9}", self.clock.uncertainty_s)),
            ],
        }
    }
}

fn channel_info(channel: &Channel, topic: &str) -> ChannelInfo {
    let name = channel.name.strip_prefix(topic).and_then(|rest| rest.strip_prefix('.'));
    ChannelInfo { label: name.unwrap_or(&channel.name).to_owned(), unit: channel.unit.clone() }
}

/// An event as a marker: `PROCESS: KIND`, and `: TEXT` where it has one.
pub(crate) fn marker(event: &Event) -> String {
    let process = Process::from_code(event.source).map_or("?", Process::text);
    let kind = EventKind::from_code(event.kind).map_or("?", EventKind::text);
    let text = event.text();
    let separator = if text.is_empty() { "" } else { ": " };
    format!("{process}: {kind}{separator}{text}")
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use ipc_types::{COMMAND, Severity};

    use super::*;

    fn with<T>(does: impl FnOnce(&Named<'_>) -> T) -> T {
        let rig = rig::load_rig(std::path::Path::new("hydrostatic")).unwrap();
        let clock = ClockOffset { offset_s: 0.5, uncertainty_s: 1e-7 };
        does(&Named { rig_name: "bench", rig: &rig, computer: "pc", clock })
    }

    fn streams(topics: &[&'static Topic]) -> Vec<StreamInfo> {
        let layouts: Vec<Stream> = topics.iter().map(|topic| Stream::of_topic(topic)).collect();
        let made = with(|named| named.numeric(topics, &layouts).unwrap());
        made.into_iter().map(|(info, _)| info).collect()
    }

    #[test]
    fn samples_have_the_signals_of_the_rig_file_and_other_topics_their_numbers() {
        let made = streams(&[&SAMPLE.topic, &COMMAND.topic]);
        let channel = |label: &str, unit: &str| ChannelInfo {
            label: label.to_owned(),
            unit: unit.to_owned(),
        };
        let (samples, commands) = (&made[0], &made[1]);
        assert_eq!((samples.name.as_str(), samples.kind.as_str()), ("bench.sample", "Sample"));
        assert_eq!(samples.source_id, "farreach/pc/bench/sample");
        assert_eq!((samples.rate_hz, commands.rate_hz), (2000.0, 500.0));
        assert_eq!(samples.channels[0], channel("handle_master", "rad"));
        assert_eq!(samples.channels.last(), Some(&channel("tick", "")));
        assert!(samples.about.contains(&("clock_offset_s", "0.500000000".to_owned())));
        assert!(commands.channels.contains(&channel("volts[0]", "V")));
        assert!(commands.channels.contains(&channel("sequence", "")));
        assert!(!commands.channels.iter().any(|channel| channel.label == "incarnation"));
    }

    #[test]
    fn events_are_markers_and_no_stream_of_numbers() {
        let event = Event::new(
            Process::Experiment,
            EventKind::ProcessStarted,
            Severity::Info,
            "rest 2 of 5",
        );
        assert_eq!(marker(&event), "experiment: process started: rest 2 of 5");
        let event = Event::new(Process::Watchdog, EventKind::ProcessStarted, Severity::Info, "");
        assert_eq!(marker(&event), "watchdog: process started");
        let name = event_topics().next().unwrap().name.to_owned();
        let error = numeric_topics(std::slice::from_ref(&name)).unwrap_err().to_string();
        assert!(error.contains(&name) && error.contains("markers"), "{error}");
        let names: Vec<_> = numeric_topics(&[]).unwrap().iter().map(|topic| topic.name).collect();
        assert_eq!(names, ["sample"]);
        assert_eq!(with(|named| named.markers()).channels.len(), 1);
    }
}
