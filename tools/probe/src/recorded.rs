//! A recording as a source of messages.

use std::collections::BTreeMap;

use recorder::{DATA_LOST, exit_code_of_tail};
use recording::mcap_read::{ReadError, Recording, Selection, Sorted};

use crate::stream::{Arrived, Progress, Source, Stamp, Stream};

/// Topics of a recording, read in the order of time.
pub(crate) struct Recorded<'a> {
    recording: &'a Recording,
    messages: Sorted<'a>,
    streams: Vec<Stream>,
    /// index of the stream by channel
    by_channel: BTreeMap<u16, usize>,
    damaged: bool,
}

impl<'a> Recorded<'a> {
    /// Reads these topics; all if none is given.
    ///
    /// # Errors
    /// If the recording does not have one of them.
    pub(crate) fn new(recording: &'a Recording, topics: &[String]) -> anyhow::Result<Self> {
        let mut channels: Vec<u16> = Vec::new();
        for topic in topics {
            let of_topic = recording.channels_of(topic)?;
            let new: Vec<u16> = of_topic.into_iter().filter(|id| !channels.contains(id)).collect();
            channels.extend(new);
        }
        if topics.is_empty() {
            channels.extend(recording.channels.keys());
        }
        let mut streams: Vec<Stream> = Vec::new();
        let mut by_channel = BTreeMap::new();
        for &id in &channels {
            let Some(channel) = recording.channels.get(&id) else { continue };
            let (fields, size) = match &channel.layout {
                Ok(layout) => (layout.fields.as_slice(), layout.size),
                Err(_) => (&[][..], 0),
            };
            let mut stream = Stream::of_recording(&channel.topic, fields, size);
            stream.owner = channel.metadata.get("owner").cloned().unwrap_or_default();
            stream.kind.clone_from(&channel.schema_name);
            // A recording that was merged has a topic once for each part.
            let same = |other: &Stream| {
                (&other.name, &other.kind, &other.fields)
                    == (&stream.name, &stream.kind, &stream.fields)
            };
            let at = streams.iter().position(same).unwrap_or(streams.len());
            if at == streams.len() {
                streams.push(stream);
            }
            by_channel.insert(id, at);
        }
        for (topic, position) in recording.continues() {
            for stream in streams.iter_mut().filter(|stream| stream.name == topic) {
                stream.resume(position.incarnation, position.next);
            }
        }
        let channels = (!topics.is_empty()).then_some(channels);
        let selection = Selection { channels, ..Selection::default() };
        let messages = recording.sorted(selection);
        Ok(Self { recording, messages, streams, by_channel, damaged: false })
    }
}

impl Source for Recorded<'_> {
    fn streams(&self) -> &[Stream] {
        &self.streams
    }

    fn since_ns(&self) -> u64 {
        0
    }

    /// One message, so that a probe can stop after any.
    fn read(
        &mut self,
        _until_ns: u64,
        sink: &mut dyn FnMut(&Arrived<'_>),
    ) -> anyhow::Result<Progress> {
        let message = loop {
            match self.messages.next() {
                None => return Ok(Progress::Ended),
                Some(Ok(message)) => break message,
                Some(Err(error @ ReadError::Damaged { .. })) => {
                    eprintln!("{error}");
                    self.damaged = true;
                }
                Some(Err(error)) => return Err(error.into()),
            }
        };
        let logged_ns = message.log_time_ns();
        let channel = self.recording.channel(&message);
        let stream = self.by_channel.get(&message.channel_id()).copied();
        let (Some(channel), Some(stream)) = (channel, stream) else {
            return Ok(Progress::UpTo(logged_ns));
        };
        let bytes = match &channel.layout {
            Ok(_) => self.recording.decode(&message)?.1,
            // Counted, not decoded.
            Err(_) => message.data(),
        };
        if let Some(known) = self.streams.get_mut(stream) {
            let sent = known.see(bytes, logged_ns);
            sink(&Arrived { stream, bytes, sent, stamp: Stamp::Logged(logged_ns) });
        }
        Ok(Progress::UpTo(logged_ns))
    }

    fn exit_code(&self) -> i32 {
        let damaged = self.damaged || !self.recording.damage.is_empty();
        if damaged { DATA_LOST } else { exit_code_of_tail(self.recording) }
    }
}
