//! The logger's MCAP writer.
//!
//! One channel per topic of [`ipc_types::TOPICS`]; the payload is the CDR header and the message's
//! bytes, copied. lz4, chunks of about 1 MiB, a flush every [`FLUSH_NS`], `fdatasync` every
//! [`SYNC_NS`], no seeking: whatever kills the process, everything up to the last flush reads back,
//! and a crash of the machine costs what came after the last sync.
//!
//! Times: `log_time` and `publish_time` are the message's `time_ns` plus the realtime offset that
//! was fixed at the start of the file (ns since 1970); the payload keeps the monotonic time.
//!
//! Metadata: first a record [`START_RECORD`] with what the caller gives (git revision, text of the
//! rig file, names and units of the signals, ...; the keys are the constants of [`key`]); a record
//! [`RUN_RECORD`] with name, text and subject of each protocol played; last a record [`END_RECORD`]
//! with the loss counters and `clean_end = true`. Each has a checksum of its own. Rig file and
//! protocol are metadata, not attachments, because every MCAP tool shows metadata and the texts are
//! small.
//!
//! ```
//! use ipc_types::{Message, SAMPLE, Sample};
//! use recording::mcap_write::{Start, Writer, key};
//!
//! let directory = tempfile::tempdir()?;
//! let path = directory.path().join("run.mcap");
//! let start = Start { realtime_offset_ns: 1_700_000_000_000_000_000, ..Start::default() }
//!     .with(key::RIG, "hydrostatic");
//! let mut writer = Writer::create(&path, &start, 0)?;
//! let mut sample = Sample::default();
//! sample.stamp(1, 2, 0, 500_000);
//! writer.write_message(&SAMPLE, &sample)?;
//! writer.tick(600_000)?; // flushes and syncs when it is time
//! let summary = writer.finish(&[])?;
//! assert_eq!(summary.written, 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod metadata_keys;
mod output;

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

use ipc_types::{CDR_HEADER, LossCounters, Message, TOPICS, TypedTopic};
use mcap::records::MessageHeader;
use mcap::write::NoSeek;

use crate::channel::{self, MESSAGE_ENCODING, SCHEMA_ENCODING};
use crate::record_checksum::sealed;
use crate::word;
pub use error::WriteError;
use error::disk_error;
pub(crate) use metadata_keys::parse_continues;
pub use metadata_keys::{
    CONTINUES_RECORD, DAMAGED_RECORD, END_RECORD, Position, Positions, RUN_RECORD, START_RECORD,
    Start, key,
};
pub use output::Output;
use output::Shared;

/// Time since the last flush after which the next one is due (ns).
pub const FLUSH_NS: u64 = 300_000_000;
/// Time since the last sync to the disk after which the next one is due (ns).
pub const SYNC_NS: u64 = 900_000_000;
/// Size at which a chunk is closed even before the flush (bytes, uncompressed).
pub const CHUNK_BYTES: u64 = 1024 * 1024;
/// How farreach writes MCAP files.
pub(crate) fn write_options() -> mcap::WriteOptions {
    mcap::WriteOptions::new()
        .compression(Some(mcap::Compression::Lz4))
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true)
        // Readers decode the topics of this profile as those of a ROS 2 bag.
        .profile("ros2")
        .library(concat!("farreach ", env!("CARGO_PKG_VERSION")))
}

/// What a recording holds at a clean end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Summary {
    /// The file.
    pub path: PathBuf,
    /// Its size (bytes).
    pub bytes: u64,
    /// Messages in it.
    pub written: u64,
    /// Messages of the wrong size or topic that were refused.
    pub refused: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Count {
    written: u64,
    /// since the last flush: lost if the next one fails
    pending: u64,
    refused: u64,
}

/// Writes one recording.
pub struct Writer {
    path: PathBuf,
    shared: Shared,
    mcap: mcap::Writer<NoSeek<Shared>>,
    /// channel by index of the topic
    channels: Vec<u16>,
    counts: Vec<Count>,
    payload: Vec<u8>,
    realtime_offset_ns: i64,
    flushed_ns: u64,
    synced_ns: u64,
    poisoned: Option<String>,
    refused_elsewhere: u64,
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer")
            .field("path", &self.path)
            .field("poisoned", &self.poisoned)
            .finish_non_exhaustive()
    }
}

impl Writer {
    /// Begins a recording in a file that does not exist yet. `now_ns` is `CLOCK_MONOTONIC`. Where
    /// nothing can be written into the file, it is removed.
    ///
    /// # Errors
    /// [`WriteError::Exists`], [`WriteError::Create`], or those of the first write.
    pub fn create(path: &Path, start: &Start, now_ns: u64) -> Result<Self, WriteError> {
        let file =
            OpenOptions::new().write(true).create_new(true).open(path).map_err(|source| {
                if source.kind() == io::ErrorKind::AlreadyExists {
                    WriteError::Exists { path: path.to_owned() }
                } else {
                    WriteError::Create { path: path.to_owned(), source }
                }
            })?;
        // Tells readers that this file is still growing; a file system without locks cannot.
        let _ = file.try_lock();
        let writer = Self::in_new_file(Box::new(file), path, start, now_ns)?;
        // The directory entry must survive a crash too, where the file system can sync a directory.
        if let Some(directory) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            let _ = File::open(directory).and_then(|d| d.sync_all());
        }
        Ok(writer)
    }

    /// As [`Self::to_output`], where `path` is a file that was made for it.
    fn in_new_file(
        output: Box<dyn Output>,
        path: &Path,
        start: &Start,
        now_ns: u64,
    ) -> Result<Self, WriteError> {
        Self::to_output(output, path, start, now_ns).inspect_err(|_| {
            // Nothing is in it, and it would stand in the way of the next attempt.
            let _ = std::fs::remove_file(path);
        })
    }

    /// Begins a recording on any output; `path` is for messages only.
    ///
    /// # Errors
    /// Those of the first write.
    pub fn to_output(
        output: Box<dyn Output>,
        path: &Path,
        start: &Start,
        now_ns: u64,
    ) -> Result<Self, WriteError> {
        let shared = Shared::new(output);
        let begin = || -> mcap::McapResult<_> {
            let mut mcap = write_options().create(NoSeek::new(shared.clone()))?;
            let mut metadata = start.metadata.clone();
            metadata.insert(key::FORMAT.to_owned(), "2".to_owned());
            metadata
                .insert(key::REALTIME_OFFSET_NS.to_owned(), start.realtime_offset_ns.to_string());
            metadata.insert(key::STARTED_NS.to_owned(), now_ns.to_string());
            metadata.entry(key::PART.to_owned()).or_insert_with(|| "1".to_owned());
            let continues = metadata_keys::continues_record(&start.continues);
            let records = [
                (START_RECORD, metadata),
                (CONTINUES_RECORD, continues),
                (RUN_RECORD, start.run.clone()),
            ];
            for (name, metadata) in records.into_iter().filter(|(_, content)| !content.is_empty()) {
                mcap.write_metadata(&sealed(name, metadata))?;
            }
            let mut channels = Vec::with_capacity(TOPICS.len());
            for topic in TOPICS {
                let text = (topic.schema)();
                let schema = mcap.add_schema(topic.ros_name, SCHEMA_ENCODING, text.as_bytes())?;
                let about = channel::about(topic);
                channels.push(mcap.add_channel(schema, topic.name, MESSAGE_ENCODING, &about)?);
            }
            // Without the schemas, a truncated file could not be read.
            mcap.flush()?;
            Ok((mcap, channels))
        };
        let (mcap, channels) = begin().map_err(|source| {
            shared.cut();
            disk_error(path, source, 0)
        })?;
        let longest = TOPICS.iter().map(|topic| topic.size).max().unwrap_or(0);
        Ok(Self {
            path: path.to_owned(),
            shared,
            mcap,
            channels,
            counts: vec![Count::default(); TOPICS.len()],
            payload: Vec::with_capacity(CDR_HEADER.len() + longest),
            realtime_offset_ns: start.realtime_offset_ns,
            flushed_ns: now_ns,
            synced_ns: now_ns,
            poisoned: None,
            refused_elsewhere: 0,
        })
    }

    /// Writes one message of the topic with that index in [`ipc_types::TOPICS`], given as its
    /// bytes.
    ///
    /// # Errors
    /// [`WriteError::Topic`] and [`WriteError::Length`] refuse this message only; any other error
    /// ends the recording.
    pub fn write(&mut self, topic: usize, bytes: &[u8]) -> Result<(), WriteError> {
        let (Some(entry), Some(&channel)) = (TOPICS.get(topic), self.channels.get(topic)) else {
            self.refused_elsewhere += 1;
            return Err(WriteError::Topic { topic: topic.to_string() });
        };
        if bytes.len() != entry.size {
            self.counts[topic].refused += 1;
            return Err(WriteError::Length {
                topic: entry.name,
                expected: entry.size,
                found: bytes.len(),
            });
        }
        if self.poisoned.is_some() {
            self.counts[topic].refused += 1;
            return self.sound();
        }
        let log_time = self.log_time(word(bytes, 24));
        self.payload.clear();
        channel::put_payload(bytes, &mut self.payload);
        let header = MessageHeader {
            channel_id: channel,
            sequence: word(bytes, 16) as u32,
            log_time,
            publish_time: log_time,
        };
        self.counts[topic].pending += 1;
        let written = self.mcap.write_to_known_channel(&header, &self.payload);
        written.map_err(|source| self.poison(source))
    }

    /// Writes one typed message.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn write_message<T: Message>(
        &mut self,
        topic: &TypedTopic<T>,
        message: &T,
    ) -> Result<(), WriteError> {
        let index = TOPICS.iter().position(|entry| entry.name == topic.topic.name);
        match index {
            Some(index) => self.write(index, message.as_bytes()),
            None => {
                self.refused_elsewhere += 1;
                Err(WriteError::Topic { topic: topic.topic.name.to_owned() })
            }
        }
    }

    /// Writes the record of a protocol that begins to be played.
    ///
    /// # Errors
    /// Those of the disk; they end the recording.
    pub fn write_run(&mut self, run: &BTreeMap<String, String>) -> Result<(), WriteError> {
        let record = sealed(RUN_RECORD, run.clone());
        self.mcap.write_metadata(&record).map_err(|source| self.poison(source))?;
        // On the disk at once: it may be all that says which subject this is.
        self.flush()
    }

    /// Flushes and syncs when due. Call it every few tens of milliseconds.
    ///
    /// # Errors
    /// Those of the disk; they end the recording. Once it has ended so, this does nothing.
    pub fn tick(&mut self, now_ns: u64) -> Result<(), WriteError> {
        if self.poisoned.is_some() {
            return Ok(());
        }
        if now_ns.saturating_sub(self.synced_ns) >= SYNC_NS {
            self.flush()?;
            self.flushed_ns = now_ns;
            self.synced_ns = now_ns;
            if let Err(source) = self.shared.sync() {
                return Err(self.poison(mcap::McapError::Io(source)));
            }
        } else if now_ns.saturating_sub(self.flushed_ns) >= FLUSH_NS {
            self.flush()?;
            self.flushed_ns = now_ns;
        }
        Ok(())
    }

    /// Closes the present chunk and writes everything to the operating system.
    ///
    /// # Errors
    /// Those of the disk; they end the recording.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        if self.poisoned.is_some() {
            return Ok(());
        }
        self.mcap.flush().map_err(|source| self.poison(source))?;
        for count in &mut self.counts {
            count.written += std::mem::take(&mut count.pending);
        }
        Ok(())
    }

    /// Ends the recording cleanly: end record, index, footer, sync. `losses` are the counters
    /// of the topics.
    ///
    /// # Errors
    /// Those of the disk, and [`WriteError::Poisoned`] when the recording had ended with an error
    /// before. The prefix on the disk stays readable.
    pub fn finish(mut self, losses: &[LossCounters]) -> Result<Summary, WriteError> {
        self.flush()?;
        self.sound()?;
        let mut metadata = BTreeMap::from([(key::CLEAN_END.to_owned(), "true".to_owned())]);
        for (topic, count) in TOPICS.iter().zip(&self.counts) {
            metadata.insert(format!("{}.written", topic.name), count.written.to_string());
        }
        for loss in losses {
            let Some(topic) = TOPICS.get(loss.topic as usize) else { continue };
            for (name, value) in [
                ("received", loss.received),
                ("gaps", loss.gaps),
                ("dropped", loss.dropped),
                ("refused", loss.refused),
            ] {
                metadata.insert(format!("{}.{name}", topic.name), value.to_string());
            }
        }
        let end = sealed(END_RECORD, metadata);
        let ended = self.mcap.write_metadata(&end).and_then(|()| self.mcap.finish().map(|_| ()));
        if let Err(source) = ended.and_then(|()| self.shared.sync().map_err(mcap::McapError::Io)) {
            return Err(self.poison(source));
        }
        Ok(Summary {
            path: self.path.clone(),
            bytes: self.bytes(),
            written: self.written(),
            refused: self.refused(),
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// Bytes written so far (the open chunk excluded).
    pub fn bytes(&self) -> u64 {
        self.shared.lock().bytes
    }
    /// Messages taken so far; those since the last flush are among them as long as no error came.
    pub fn written(&self) -> u64 {
        self.counts.iter().map(|count| count.written + count.pending).sum()
    }
    /// Messages that were offered but are not in the file.
    pub fn refused(&self) -> u64 {
        self.refused_elsewhere + self.counts.iter().map(|count| count.refused).sum::<u64>()
    }
    /// Messages of one topic taken so far.
    pub fn written_of(&self, topic: usize) -> u64 {
        self.counts.get(topic).map_or(0, |count| count.written + count.pending)
    }
    /// Messages of one topic that were refused.
    pub fn refused_of(&self, topic: usize) -> u64 {
        self.counts.get(topic).map_or(0, |count| count.refused)
    }
    /// The error that ended the recording.
    pub fn error(&self) -> Option<&str> {
        self.poisoned.as_deref()
    }

    /// The error of an earlier call that ended the recording.
    fn sound(&self) -> Result<(), WriteError> {
        let Some(cause) = self.poisoned.clone() else { return Ok(()) };
        Err(WriteError::Poisoned { path: self.path.clone(), cause, refused: self.refused() })
    }

    fn log_time(&self, time_ns: u64) -> u64 {
        channel::wall_time_ns(time_ns, self.realtime_offset_ns)
    }

    fn poison(&mut self, source: mcap::McapError) -> WriteError {
        // What was not flushed counts as refused, although part of it may have reached the disk.
        for count in &mut self.counts {
            count.refused += std::mem::take(&mut count.pending);
        }
        self.shared.cut();
        let error = disk_error(&self.path, source, self.refused());
        self.poisoned = Some(match &error {
            WriteError::DiskFull { .. } => "the disk is full".to_owned(),
            WriteError::Disk { source, .. } => source.to_string(),
            other => other.to_string(),
        });
        error
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use std::io::Write;

    use super::*;

    /// A disk that is full.
    struct Full;

    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(io::ErrorKind::StorageFull.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Output for Full {
        fn sync(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_file_into_which_nothing_can_be_written_is_removed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("run.mcap");
        File::create_new(&path).unwrap();
        let error = Writer::in_new_file(Box::new(Full), &path, &Start::default(), 0).unwrap_err();
        assert!(matches!(error, WriteError::DiskFull { refused: 0, .. }), "{error}");
        assert!(!path.exists());
        // Once there is room, the name is free.
        Writer::create(&path, &Start::default(), 0).unwrap().finish(&[]).unwrap();
        assert!(path.exists());
    }
}
