//! New recordings from existing ones: recovered, cut, merged. Messages come out in the order of log
//! time.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;

use crate::mcap_read::{RawMessage, ReadError, Recording, Selection, in_order_of_time};
use crate::mcap_write::{CONTINUES_RECORD, RUN_RECORD, write_options};
use crate::record_checksum::sealed;
pub use crate::related::{check_one_session, check_related};

/// Name of the metadata record that says how a file was made.
pub const EDIT_RECORD: &str = "farreach.edit";

/// Why no new recording could be made.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// A source cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The output cannot be created.
    #[error("{path}: cannot create: {source}; recordings are never overwritten")]
    Create {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The output cannot be written. The incomplete file is removed.
    #[error("{path}: cannot write: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// The library's error.
        source: Box<mcap::McapError>,
    },
    /// Recordings that do not belong together.
    #[error(transparent)]
    Unrelated(Box<Unrelated>),
    /// Recordings of the same time.
    #[error(
        "{second_path}: it holds messages of {second_s} since 1970, {first_path} of {first_s}: \
         expected parts that follow each other, found two recordings of the same time; merge \
         those of each on their own, or all of them with --force"
    )]
    Overlapping {
        /// The one that begins first.
        first_path: PathBuf,
        /// From when to when (s since 1970).
        first_s: String,
        /// The other one.
        second_path: PathBuf,
        /// From when to when (s since 1970).
        second_s: String,
    },
}

/// An entry of the metadata in which recordings differ that are to become one.
#[derive(Debug, thiserror::Error)]
#[error(
    "{second_path}: {what} (`{key}` in the metadata): expected {first} as in {first_path}, found \
     {second}: they are not parts of one recording; merge those of each session on their own, or \
     all of them with --force"
)]
pub struct Unrelated {
    /// What differs: rig, rig name, session, rig file or clock offset.
    pub what: &'static str,
    /// Its key in the metadata.
    pub key: &'static str,
    /// One file.
    pub first_path: PathBuf,
    /// Its value.
    pub first: String,
    /// Another file.
    pub second_path: PathBuf,
    /// Its value.
    pub second: String,
}

/// What was copied and what was not.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct EditReport {
    /// Messages copied.
    pub messages: u64,
    /// Messages left out because another source holds them too.
    pub repeated: u64,
    /// Damaged chunks left out.
    pub damaged_chunks: u64,
    /// Bytes after the readable part of the sources.
    pub tail_bytes_lost: u64,
    /// Attachments of the sources; they are not copied (farreach writes none).
    pub attachments_left_out: u64,
}

/// Copies what can be read of `sources` into a new file, in the order of log time. `from_ns` and
/// `until_ns` limit the log time; `how` is noted in the file. A message that several sources hold
/// is written once.
///
/// # Errors
/// [`EditError`]. A damaged chunk or torn tail is no error: see the report.
pub fn rewrite(
    sources: &[&Recording],
    from_ns: Option<u64>,
    until_ns: Option<u64>,
    how: &BTreeMap<String, String>,
    output: &Path,
) -> Result<EditReport, EditError> {
    let file = std::fs::File::create_new(output)
        .map_err(|source| EditError::Create { path: output.to_owned(), source })?;
    let mut sources = sources.to_vec();
    sources.sort_by_key(|source| source.began_ns());
    let selection = Selection { channels: None, from_ns, until_ns };
    let mut copy = Copy {
        sources: &sources,
        selection: &selection,
        report: EditReport::default(),
        failed: &|source| EditError::Write { path: output.to_owned(), source: Box::new(source) },
    };
    match copy.run(BufWriter::new(file), how) {
        Ok(()) => Ok(copy.report),
        Err(error) => {
            // The sources still exist; an incomplete copy would only confuse.
            let _ = std::fs::remove_file(output);
            Err(error)
        }
    }
}

struct Copy<'a> {
    /// the earliest recording first
    sources: &'a [&'a Recording],
    selection: &'a Selection,
    report: EditReport,
    failed: &'a dyn Fn(mcap::McapError) -> EditError,
}

type Output = mcap::Writer<NoSeek<BufWriter<std::fs::File>>>;

impl Copy<'_> {
    fn run(
        &mut self,
        output: BufWriter<std::fs::File>,
        how: &BTreeMap<String, String>,
    ) -> Result<(), EditError> {
        let failed = self.failed;
        let mut writer = write_options().create(NoSeek::new(output)).map_err(failed)?;
        self.metadata(&mut writer)?;
        let channels = self.channels(&mut writer)?;
        self.messages(&channels, &mut writer)?;
        let mut metadata = how.clone();
        for (name, count) in [
            ("messages", self.report.messages),
            ("damaged_chunks", self.report.damaged_chunks),
            ("tail_bytes_lost", self.report.tail_bytes_lost),
        ] {
            metadata.insert(name.to_owned(), count.to_string());
        }
        writer.write_metadata(&sealed(EDIT_RECORD, metadata)).map_err(failed)?;
        writer.finish().map_err(failed)?;
        let io = |source: io::Error| failed(mcap::McapError::Io(source));
        let mut output = writer.into_inner().into_inner();
        output.flush().map_err(io)?;
        output.get_ref().sync_data().map_err(io)
    }

    /// Copies the metadata. Where the part before ended holds only for the beginning of the first
    /// source: between the others, the sequence numbers themselves show the gap. A protocol that
    /// went on in the next part is told once.
    fn metadata(&mut self, writer: &mut Output) -> Result<(), EditError> {
        let mut runs = Vec::new();
        for (index, source) in self.sources.iter().enumerate() {
            self.report.tail_bytes_lost += source.tail.lost;
            self.report.attachments_left_out += source.attachments;
            for (name, metadata) in &source.metadata_records {
                if name == CONTINUES_RECORD && (index > 0 || self.selection.from_ns.is_some()) {
                    continue;
                }
                if name == RUN_RECORD {
                    if runs.contains(&metadata) {
                        continue;
                    }
                    runs.push(metadata);
                }
                let record = Metadata { name: name.clone(), metadata: metadata.clone() };
                writer.write_metadata(&record).map_err(self.failed)?;
            }
        }
        Ok(())
    }

    /// Copies schemas and channels; the new number of each source's channels.
    fn channels(&self, writer: &mut Output) -> Result<Vec<BTreeMap<u16, u16>>, EditError> {
        let mut channels = Vec::new();
        for source in self.sources {
            let mut map = BTreeMap::new();
            for (&id, channel) in &source.channels {
                let schema = if channel.schema_name.is_empty() && channel.schema.is_empty() {
                    0
                } else {
                    let (name, encoding) = (&channel.schema_name, &channel.schema_encoding);
                    writer
                        .add_schema(name, encoding, channel.schema.as_bytes())
                        .map_err(self.failed)?
                };
                let (topic, encoding) = (&channel.topic, &channel.message_encoding);
                let new = writer
                    .add_channel(schema, topic, encoding, &channel.metadata)
                    .map_err(self.failed)?;
                map.insert(id, new);
            }
            channels.push(map);
        }
        Ok(channels)
    }

    fn messages(
        &mut self,
        channels: &[BTreeMap<u16, u16>],
        writer: &mut Output,
    ) -> Result<(), EditError> {
        let (failed, several) = (self.failed, self.sources.len() > 1);
        let report = &mut self.report;
        // Messages written with the present log time: what is published once has one log time, so
        // that a repetition is among them.
        let mut present: Vec<(u16, RawMessage)> = Vec::new();
        in_order_of_time(self.sources, self.selection, |source, message| {
            let message = match message {
                Ok(message) => message,
                Err(ReadError::Damaged { .. }) => {
                    report.damaged_chunks += 1;
                    return Ok(());
                }
                Err(error) => return Err(error.into()),
            };
            let new = channels.get(source).and_then(|map| map.get(&message.channel_id()));
            let Some(&channel_id) = new else { return Ok(()) };
            if several {
                present.retain(|(_, other)| other.log_time_ns() == message.log_time_ns());
                if present
                    .iter()
                    .any(|(id, other)| *id == channel_id && other.data() == message.data())
                {
                    report.repeated += 1;
                    return Ok(());
                }
                present.push((channel_id, message.clone()));
            }
            let header = MessageHeader { channel_id, ..message.header() };
            writer.write_to_known_channel(&header, message.data()).map_err(failed)?;
            report.messages += 1;
            Ok(())
        })
    }
}
