//! Topics and their messages, alike for a rig that is up and for a recording.

use ipc_types::{Arrival, Field, Primitive, SequenceTracker, Topic, find_topic};
use recording::schema::LayoutField;
use recording::word;

/// One topic: the layout of its messages, and what has come of it.
#[derive(Clone, Debug)]
pub struct Stream {
    /// Name of the topic.
    pub name: String,
    /// The process that publishes it; empty where a recording does not say.
    pub owner: String,
    /// Name of the message type.
    pub kind: String,
    /// Fields in order; empty where a recording has them in a form that cannot be read.
    pub fields: Vec<LayoutField>,
    /// Bytes of a message.
    pub size: usize,
    /// Messages that a late subscriber still gets; 0 in a recording.
    pub history: usize,
    identity: Option<Identity>,
    tracker: SequenceTracker,
    incarnation: Option<u64>,
    received: u64,
}

/// Where a message says who sent it and when (bytes from its start).
#[derive(Clone, Copy, Debug)]
struct Identity {
    incarnation: usize,
    sequence: usize,
    time: usize,
}

/// What a message says of its sending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sent {
    /// Incarnation of the sender; 0 where the message does not say.
    pub incarnation: u64,
    /// When it was published (ns, CLOCK_MONOTONIC).
    pub time_ns: u64,
    /// `Some` where the messages before it are interrupted: how many are missing; 0 where their
    /// sender was started anew.
    pub gap: Option<u64>,
}

/// By which clock a message came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stamp {
    /// Received by this program (ns, CLOCK_MONOTONIC).
    Received(u64),
    /// Written to the recording (ns since 1970).
    Logged(u64),
}

impl Stamp {
    /// The time (ns), by whichever clock.
    pub const fn ns(self) -> u64 {
        match self {
            Self::Received(ns) | Self::Logged(ns) => ns,
        }
    }
}

/// A message.
#[derive(Clone, Copy, Debug)]
pub struct Arrived<'a> {
    /// Index of its topic in [`Source::streams`].
    pub stream: usize,
    /// Its fields, laid out as [`Stream::fields`] says.
    pub bytes: &'a [u8],
    /// Who sent it, and when.
    pub sent: Sent,
    /// When it came.
    pub stamp: Stamp,
}

/// What a [`Source`] has come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Every message published until then has been handed on (ns, by the clock of [`Stamp`]).
    UpTo(u64),
    /// There will be no more.
    Ended,
}

/// Where messages come from.
pub trait Source {
    /// The topics.
    fn streams(&self) -> &[Stream];

    /// When the probe attached: what was published before is history (ns, CLOCK_MONOTONIC). 0 for a
    /// recording.
    fn since_ns(&self) -> u64;

    /// Hands on the messages that are there; on a running rig, waits for them, at most until
    /// `until_ns` (ns, CLOCK_MONOTONIC).
    ///
    /// # Errors
    /// If the rig has gone down, or the recording cannot be read.
    fn read(
        &mut self,
        until_ns: u64,
        sink: &mut dyn FnMut(&Arrived<'_>),
    ) -> anyhow::Result<Progress>;

    /// Exit code by what was read: data may be missing in a recording.
    fn exit_code(&self) -> i32;
}

impl Stream {
    /// A topic of a running rig.
    pub fn of_topic(topic: &Topic) -> Self {
        let fields = topic.fields.iter().map(|field| Field {
            name: field.name.to_owned(),
            primitive: field.primitive,
            array: field.array,
            offset: field.offset,
            doc: field.doc,
            codes: field.codes,
        });
        Self {
            owner: topic.owner.text().to_owned(),
            kind: topic.ros_name.to_owned(),
            size: topic.size,
            history: topic.history,
            ..Self::new(topic.name, fields.collect())
        }
    }

    /// A topic of a recording, with the fields as they lie in it. A field that this build knows has
    /// its documentation.
    pub(crate) fn of_recording(name: &str, fields: &[LayoutField], size: usize) -> Self {
        let mut fields = fields.to_vec();
        let known = find_topic(name).map_or(&[][..], |topic| topic.fields);
        for field in &mut fields {
            let same =
                |other: &&Field| other.name == field.name && other.primitive == field.primitive;
            if let Some(known) = known.iter().find(same) {
                (field.doc, field.codes) = (known.doc, known.codes);
            }
        }
        Self { size, ..Self::new(name, fields) }
    }

    fn new(name: &str, fields: Vec<LayoutField>) -> Self {
        let word_at = |name: &str| {
            let found = fields.iter().find(|field| field.name == name)?;
            (found.primitive == Primitive::U64 && found.array.is_none()).then_some(found.offset)
        };
        let identity = || {
            Some(Identity {
                incarnation: word_at("incarnation")?,
                sequence: word_at("sequence")?,
                time: word_at("time_ns")?,
            })
        };
        Self {
            name: name.to_owned(),
            owner: String::new(),
            kind: String::new(),
            identity: identity(),
            fields,
            size: 0,
            history: 0,
            tracker: SequenceTracker::default(),
            incarnation: None,
            received: 0,
        }
    }

    /// Expects that number next from a sender, as the part before this recording left it.
    pub(crate) fn resume(&mut self, incarnation: u64, next: u64) {
        self.tracker.resume(incarnation, next);
    }

    /// Counts a message, and what is missing before it. `otherwise_ns` is the time of one that does
    /// not say when it was published.
    pub fn see(&mut self, bytes: &[u8], otherwise_ns: u64) -> Sent {
        self.received += 1;
        let Some(at) = self.identity else {
            return Sent { incarnation: 0, time_ns: otherwise_ns, gap: None };
        };
        let incarnation = word(bytes, at.incarnation);
        let arrival = self.tracker.observe(incarnation, word(bytes, at.sequence));
        let before = self.incarnation.replace(incarnation);
        let gap = match arrival {
            Arrival::Gap(missing) => Some(missing),
            Arrival::Next | Arrival::Duplicate => {
                before.filter(|before| *before != incarnation).map(|_| 0)
            }
        };
        Sent { incarnation, time_ns: word(bytes, at.time), gap }
    }

    /// Messages that have come.
    pub(crate) const fn received(&self) -> u64 {
        self.received
    }

    /// Messages missing in the sequence of their senders.
    pub fn lost(&self) -> u64 {
        self.tracker.gaps()
    }

    /// The field of that name.
    pub fn field(&self, name: &str) -> Option<&LayoutField> {
        self.fields.iter().find(|field| field.name == name)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use ipc_types::{COMMAND, Message, MotorCommand};

    use super::*;

    /// A message of a stream, received at a time.
    pub(crate) fn arrived<'a>(
        streams: &mut [Stream],
        stream: usize,
        bytes: &'a [u8],
        received_ns: u64,
    ) -> Arrived<'a> {
        let sent = streams[stream].see(bytes, received_ns);
        Arrived { stream, bytes, sent, stamp: Stamp::Received(received_ns) }
    }

    #[test]
    fn a_gap_is_before_the_message_that_shows_it() {
        let mut stream = Stream::of_topic(&COMMAND.topic);
        let mut see = |incarnation, sequence| {
            let mut command = MotorCommand::default();
            command.stamp(1, incarnation, sequence, 1000 + sequence);
            stream.see(command.as_bytes(), 0)
        };
        assert_eq!(see(7, 40), Sent { incarnation: 7, time_ns: 1040, gap: None });
        assert_eq!(see(7, 41).gap, None);
        assert_eq!(see(7, 44).gap, Some(2));
        // A sender that was started anew interrupts the signal, and nothing is missing.
        assert_eq!(see(8, 0).gap, Some(0));
        assert_eq!(see(9, 3).gap, Some(3));
        assert_eq!((stream.received(), stream.lost()), (5, 5));
    }

    #[test]
    fn a_recorded_layout_without_identity_has_the_recordings_time() {
        let layout = recording::schema::Layout::parse("x", "ros2msg", "float64 y\n").unwrap();
        let mut stream = Stream::of_recording("other", &layout.fields, layout.size);
        let sent = stream.see(&1.5f64.to_le_bytes(), 77);
        assert_eq!(sent, Sent { incarnation: 0, time_ns: 77, gap: None });
        assert_eq!((stream.received(), stream.lost(), stream.size), (1, 0, 8));
    }

    #[test]
    fn a_recorded_field_that_is_known_has_its_documentation() {
        let text = "uint64 session\nfloat64[3] volts\nfloat64 foreign\n";
        let layout = recording::schema::Layout::parse("x", "ros2msg", text).unwrap();
        let stream = Stream::of_recording("command", &layout.fields, layout.size);
        assert_eq!(stream.field("volts").unwrap().doc.trim(), "motor volts (V)");
        assert_eq!(stream.field("foreign").unwrap().doc, "");
    }
}
