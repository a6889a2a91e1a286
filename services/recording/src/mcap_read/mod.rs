//! Reads recordings, whole or torn, also those of older builds.
//!
//! [`Recording::open`] finds the chunks by the summary at the end of the file, or walks through the
//! records where no summary is confirmed by its checksum; it decompresses nothing, so that hours
//! of recording open quickly. The messages are then read chunk by chunk, so that memory does not
//! grow with the file. A file whose logger was killed ends within a record: everything up
//! to the last complete chunk is read, and [`Recording::tail`] says what was lost. A chunk whose
//! checksum is wrong costs that chunk only; a summary whose checksum is wrong costs no message.
//!
//! Messages are decoded by the schema in the file ([`crate::schema`]), never by this build's
//! structs alone.
//!
//! ```
//! # use ipc_types::{Message, SAMPLE, Sample};
//! # use recording::mcap_write::{Start, Writer};
//! # let directory = tempfile::tempdir()?;
//! # let path = directory.path().join("run.mcap");
//! # let mut writer = Writer::create(&path, &Start::default(), 0)?;
//! # let mut sample = Sample::default();
//! # sample.stamp(1, 2, 0, 500_000);
//! # writer.write_message(&SAMPLE, &sample)?;
//! # writer.finish(&[])?;
//! let recording = recording::mcap_read::Recording::open(&path)?;
//! for sample in recording.messages::<Sample>("sample")? {
//!     assert_eq!(sample?.message.time_ns, 500_000);
//! }
//! assert!(recording.ended_cleanly());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod block;
mod check;
mod contents;
mod filled_in;
mod in_order;
mod iterate;
mod scan;
mod sequence_positions;
mod sorted;
mod summary;
mod watch;
mod zstd;

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

pub use block::RawMessage;
pub use check::{Check, Ticks, TopicCheck};
pub use contents::{Contents, TopicContents};
pub use filled_in::FilledIn;
pub use in_order::threads;
pub use iterate::{Messages, RawMessages, Recorded, Selection};
pub use sorted::{Sorted, in_order_of_time};

use crate::mcap_write::{END_RECORD, RUN_RECORD, START_RECORD, key};
use crate::schema::{Layout, SchemaError};

/// Why a recording cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("{path}: cannot read: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file holds nothing.
    #[error(
        "{path}: the file is empty: expected an MCAP recording; a logger that could not write \
         anything leaves such a file"
    )]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Not an MCAP file.
    #[error(
        "{path}: not an MCAP file: expected it to begin with 89 4d 43 41 50 30 0d 0a, found \
         {found}"
    )]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// Its first bytes.
        found: String,
    },
    /// One chunk is damaged; the others can still be read.
    #[error(
        "{path}: damaged at byte {offset}: {source}; the messages of this chunk are lost, \
         `farreach rec recover` keeps the others"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where the chunk begins.
        offset: u64,
        /// The library's error.
        source: Box<mcap::McapError>,
    },
    /// A metadata record is damaged, in which rig file or protocol stand.
    #[error(
        "{path}: metadata record {} at byte {}: expected checksum {}, found {}: rig file or \
         protocol in it may not be those that were recorded; take another copy of the file, or \
         keep the rest with `farreach rec recover` and name the rig file yourself",
        .damaged.record, .damaged.offset, .damaged.expected, .damaged.found
    )]
    Metadata {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        damaged: DamagedMetadata,
    },
    /// No such topic in this file.
    #[error("{path}: no topic `{topic}`; it has {available}")]
    NoTopic {
        /// The file.
        path: PathBuf,
        /// What was asked for.
        topic: String,
        /// What was found.
        available: String,
    },
    /// A message cannot be decoded.
    #[error("{path}: topic {topic}: {source}")]
    Schema {
        /// The file.
        path: PathBuf,
        /// Topic.
        topic: String,
        /// What is wrong.
        source: SchemaError,
    },
}

/// One channel of a recording.
#[derive(Clone, Debug)]
pub struct Channel {
    /// Topic.
    pub topic: String,
    /// Name of the message type.
    pub schema_name: String,
    /// Language of the schema.
    pub schema_encoding: String,
    /// The schema.
    pub schema: String,
    /// Encoding of the messages.
    pub message_encoding: String,
    /// Metadata of the channel.
    pub metadata: BTreeMap<String, String>,
    /// The layout of the messages, or why there is none.
    pub layout: Result<Layout, SchemaError>,
}

/// How the file ends.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tail {
    /// Whether footer and end magic are in place.
    pub complete: bool,
    /// Bytes up to the end of the last complete record.
    pub readable: u64,
    /// Bytes after it that cannot be read.
    pub lost: u64,
    /// What was found instead of an end; empty where complete.
    pub reason: String,
    /// Whether a logger still writes it: the end is yet to come, and nothing is lost.
    pub being_written: bool,
}

/// Something in the file that cannot be read, while what follows can.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Damage {
    /// Where (bytes).
    pub offset: u64,
    /// What.
    pub what: String,
}

/// A metadata record that is not as it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedMetadata {
    /// Where it begins (bytes).
    pub offset: u64,
    /// Its name.
    pub record: String,
    /// The checksum that stands in it.
    pub expected: String,
    /// The checksum of its content.
    pub found: String,
}

/// An open recording.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    file: File,
    /// Size of the file (bytes).
    pub bytes: u64,
    /// The program that wrote it.
    pub library: String,
    blocks: Vec<block::Block>,
    /// Messages of each channel by the summary; `None` where nothing confirms that they are all.
    counts: Option<BTreeMap<u16, u64>>,
    /// The channels, by number.
    pub channels: BTreeMap<u16, Channel>,
    /// All metadata records in order: name and content.
    pub metadata_records: Vec<(String, BTreeMap<String, String>)>,
    /// Attachments; farreach writes none.
    pub attachments: u64,
    /// Records that were found unreadable when the file was opened (chunks are looked into later).
    pub damage: Vec<Damage>,
    damaged_metadata: Option<DamagedMetadata>,
    data_end: Option<summary::DataEnd>,
    watch: watch::Watch,
    /// How the file ends.
    pub tail: Tail,
}

impl Recording {
    /// Opens a recording and finds its records.
    ///
    /// # Errors
    /// [`ReadError::Io`], [`ReadError::Empty`], [`ReadError::NotMcap`], and
    /// [`ReadError::Metadata`] where rig file or protocol may be damaged. A torn file and damaged
    /// messages are no error: see [`Self::tail`] and [`Self::damage`].
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let recording = Self::open_damaged(path)?;
        match recording.damaged_metadata {
            Some(damaged) => Err(ReadError::Metadata { path: recording.path, damaged }),
            None => Ok(recording),
        }
    }

    /// As [`Self::open`], also with damaged metadata, for what inspects or mends a recording: they
    /// are in [`Self::damage`], and stand in records named [`crate::mcap_write::DAMAGED_RECORD`].
    ///
    /// # Errors
    /// [`ReadError::Io`], [`ReadError::Empty`], [`ReadError::NotMcap`].
    pub fn open_damaged(path: &Path) -> Result<Self, ReadError> {
        scan::open(path)
    }

    /// Whether the start record has a checksum of its own, as those of older builds have not: only
    /// [`Self::check`] notices there that a bit of the rig file has changed. `true` for files of
    /// other programs.
    pub fn start_is_guarded(&self) -> bool {
        self.records(START_RECORD).all(|start| start.contains_key(key::CHECKSUM))
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// The channel of a message.
    pub fn channel(&self, message: &RawMessage) -> Option<&Channel> {
        self.channels.get(&message.channel_id())
    }
    /// The metadata written at the start; `None` for files that farreach did not write.
    pub fn start_record(&self) -> Option<&BTreeMap<String, String>> {
        self.record(START_RECORD)
    }
    /// The metadata written at a clean end, loss counters among them.
    pub fn end_record(&self) -> Option<&BTreeMap<String, String>> {
        self.record(END_RECORD)
    }
    /// The protocols that were played, in order: name, text, subject, see [`key`].
    pub fn runs(&self) -> impl Iterator<Item = &BTreeMap<String, String>> {
        self.records(RUN_RECORD)
    }
    /// One value of the start record, see [`key`].
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.start_record()?.get(key).map(String::as_str)
    }
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC` as fixed for this file (ns).
    pub fn realtime_offset_ns(&self) -> Option<i64> {
        self.metadata(key::REALTIME_OFFSET_NS)?.parse().ok()
    }
    /// When the recording began, by its wall clock (ns since 1970): of several parts the first.
    /// `None` for files that farreach did not write.
    pub fn began_ns(&self) -> Option<u64> {
        let began = |start: &BTreeMap<String, String>| {
            let offset: i64 = start.get(key::REALTIME_OFFSET_NS)?.parse().ok()?;
            start.get(key::STARTED_NS)?.parse::<u64>().ok()?.checked_add_signed(offset)
        };
        self.records(START_RECORD).filter_map(began).min()
    }
    /// [`Recording::began_ns`] in the time of the messages (ns, CLOCK_MONOTONIC); 0 for files that
    /// farreach did not write.
    pub fn began_monotonic_ns(&self) -> u64 {
        let offset_ns = self.realtime_offset_ns().unwrap_or(0);
        self.began_ns().and_then(|began| began.checked_sub_signed(offset_ns)).unwrap_or(0)
    }
    /// Whether it ended cleanly; of several parts in one file, whether each did.
    pub fn ended_cleanly(&self) -> bool {
        let clean = |end: &&BTreeMap<String, String>| {
            end.get(key::CLEAN_END).is_some_and(|value| value == "true")
        };
        let ends = self.records(END_RECORD).filter(clean).count();
        self.tail.complete && ends > 0 && ends >= self.records(START_RECORD).count()
    }
    /// [`Self::ended_cleanly`] for recordings of farreach's; `true` for files of other programs.
    pub fn ended_as_expected(&self) -> bool {
        self.start_record().is_none() || self.ended_cleanly()
    }
    /// Chunks, and runs of messages outside chunks.
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }

    fn record(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.records(name).next()
    }

    fn records(&self, name: &str) -> impl Iterator<Item = &BTreeMap<String, String>> {
        self.metadata_records
            .iter()
            .filter(move |(found, _)| found == name)
            .map(|(_, content)| content)
    }

    /// The channels of a topic (a merged file may have several).
    ///
    /// # Errors
    /// [`ReadError::NoTopic`].
    pub fn channels_of(&self, topic: &str) -> Result<Vec<u16>, ReadError> {
        let ids: Vec<u16> =
            self.channels.iter().filter(|(_, c)| c.topic == topic).map(|(&id, _)| id).collect();
        if ids.is_empty() {
            let mut names: Vec<_> = self.channels.values().map(|c| c.topic.as_str()).collect();
            names.sort_unstable();
            names.dedup();
            let available =
                if names.is_empty() { "no topics at all".to_owned() } else { names.join(", ") };
            return Err(ReadError::NoTopic {
                path: self.path.clone(),
                topic: topic.to_owned(),
                available,
            });
        }
        Ok(ids)
    }

    /// The body and field table of a message.
    ///
    /// # Errors
    /// [`ReadError::Schema`] where its schema or payload cannot be read.
    pub fn decode<'a>(
        &'a self,
        message: &'a RawMessage,
    ) -> Result<(&'a Layout, &'a [u8]), ReadError> {
        let Some(channel) = self.channel(message) else {
            return Err(ReadError::NoTopic {
                path: self.path.clone(),
                topic: format!("of channel {}", message.channel_id()),
                available: format!("{} channels", self.channels.len()),
            });
        };
        let layout = self.layout_of(channel)?;
        let body = layout.body(message.data()).map_err(|source| self.wrong_schema(channel, source));
        Ok((layout, body?))
    }

    fn layout_of<'a>(&self, channel: &'a Channel) -> Result<&'a Layout, ReadError> {
        channel.layout.as_ref().map_err(|source| self.wrong_schema(channel, source.clone()))
    }

    fn wrong_schema(&self, channel: &Channel, source: SchemaError) -> ReadError {
        ReadError::Schema { path: self.path.clone(), topic: channel.topic.clone(), source }
    }
}
