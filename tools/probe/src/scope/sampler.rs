//! Reads the samples of the channels out of messages, and hands them to the capture.

use crate::scope::capture::Capturer;
use crate::scope::channel::Reader;
use crate::stream::Arrived;

/// Takes messages.
#[derive(Debug)]
pub(crate) struct Sampler {
    /// The rig or the recording, in words.
    pub(crate) place: String,
    pub(crate) capturer: Capturer,
    readers: Vec<Reader>,
    /// what was published before is history, and triggers nothing (ns, CLOCK_MONOTONIC)
    since_ns: u64,
    values: Vec<f64>,
}

impl Sampler {
    /// A reader for each topic, in their order; messages from before `since_ns` are left out.
    pub(crate) const fn new(
        place: String,
        readers: Vec<Reader>,
        capturer: Capturer,
        since_ns: u64,
    ) -> Self {
        Self { place, capturer, readers, since_ns, values: Vec::new() }
    }

    /// Takes a message; its place on the axis of time (ns).
    pub(crate) fn take(&mut self, message: &Arrived<'_>) -> u64 {
        let Some(reader) = self.readers.get(message.stream) else { return message.stamp.ns() };
        let time_ns = reader.time_ns(message);
        if message.sent.time_ns < self.since_ns {
            return time_ns;
        }
        reader.read(message.bytes, &mut self.values);
        self.capturer.take(message.stream, time_ns, message.sent.gap, &self.values);
        time_ns
    }
}
