//! New recordings from existing ones: recovered, cut, merged. Messages come out in the order of log
//! time.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;

use crate::mcap_read::{RawMessage, ReadError, Recording, Selection, Sorted};
use crate::mcap_write::{CONTINUES_RECORD, key, write_options};
use crate::record_checksum::sealed;

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
    #[error(
        "{first_path} is of {what} {first}, {second_path} of {what} {second}: expected parts of \
         one recording; --force merges them all the same"
    )]
    Unrelated {
        /// What differs: rig, rig name or session.
        what: &'static str,
        /// One file.
        first_path: PathBuf,
        /// Its value.
        first: String,
        /// Another file.
        second_path: PathBuf,
        /// Its value.
        second: String,
    },
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

/// Refuses recordings of different rigs or sessions. Files that do not say (those of other
/// programs) are taken.
///
/// # Errors
/// [`EditError::Unrelated`], naming the first two files that differ.
pub fn check_related(sources: &[&Recording]) -> Result<(), EditError> {
    for (what, key) in [("rig", key::RIG), ("rig name", key::RIG_NAME), ("session", key::SESSION)] {
        let mut known: Option<(&Recording, &str)> = None;
        for source in sources {
            let Some(value) = source.metadata(key) else { continue };
            match known {
                Some((first, expected)) if expected != value => {
                    return Err(EditError::Unrelated {
                        what,
                        first_path: first.path().to_owned(),
                        first: expected.to_owned(),
                        second_path: source.path().to_owned(),
                        second: value.to_owned(),
                    });
                }
                _ => known = known.or(Some((source, value))),
            }
        }
    }
    Ok(())
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
    /// source: between the others, the sequence numbers themselves show the gap.
    fn metadata(&mut self, writer: &mut Output) -> Result<(), EditError> {
        for (index, source) in self.sources.iter().enumerate() {
            self.report.tail_bytes_lost += source.tail.lost;
            self.report.attachments_left_out += source.attachments;
            for (name, metadata) in &source.metadata_records {
                if name == CONTINUES_RECORD && (index > 0 || self.selection.from_ns.is_some()) {
                    continue;
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
        let mut streams: Vec<Sorted<'_>> =
            self.sources.iter().map(|source| source.sorted(self.selection.clone())).collect();
        let mut heads = Vec::new();
        for stream in &mut streams {
            heads.push(next(stream, &mut self.report)?);
        }
        // Messages written with the present log time: what is published once has one log time, so
        // that a repetition is among them.
        let mut present: Vec<(u16, RawMessage)> = Vec::new();
        let oldest = |heads: &[Option<RawMessage>]| {
            let time = |head: &Option<RawMessage>| head.as_ref().map(RawMessage::log_time_ns);
            (0..heads.len()).filter(|&i| heads[i].is_some()).min_by_key(|&i| time(&heads[i]))
        };
        while let Some(source) = oldest(&heads) {
            let following = next(&mut streams[source], &mut self.report)?;
            let Some(message) = std::mem::replace(&mut heads[source], following) else { break };
            let Some(&channel_id) = channels[source].get(&message.channel_id()) else { continue };
            if self.sources.len() > 1 {
                present.retain(|(_, other)| other.log_time_ns() == message.log_time_ns());
                if present
                    .iter()
                    .any(|(id, other)| *id == channel_id && other.data() == message.data())
                {
                    self.report.repeated += 1;
                    continue;
                }
                present.push((channel_id, message.clone()));
            }
            let header = MessageHeader { channel_id, ..message.header() };
            writer.write_to_known_channel(&header, message.data()).map_err(self.failed)?;
            self.report.messages += 1;
        }
        Ok(())
    }
}

fn next(stream: &mut Sorted<'_>, report: &mut EditReport) -> Result<Option<RawMessage>, EditError> {
    loop {
        match stream.next() {
            None => return Ok(None),
            Some(Ok(message)) => return Ok(Some(message)),
            Some(Err(ReadError::Damaged { .. })) => report.damaged_chunks += 1,
            Some(Err(error)) => return Err(error.into()),
        }
    }
}
