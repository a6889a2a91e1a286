//! New recordings out of old ones: recovered, cut, merged.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;

use crate::mcap_read::{RawMessage, RawMessages, ReadError, Recording, Selection};
use crate::mcap_write::CHUNK_BYTES;

/// Name of the metadata record that says how a file came about.
pub const EDIT_RECORD: &str = "farreach.edit";

/// Why no new recording could be made.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// A source cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The output cannot be made.
    #[error("{}: cannot create: {source}; recordings are never overwritten", path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The output cannot be written. What was written of it is removed.
    #[error("{}: cannot write: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the library said.
        source: Box<mcap::McapError>,
    },
}

/// What became of it.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct EditReport {
    /// Messages copied.
    pub messages: u64,
    /// Damaged chunks left out.
    pub damaged_chunks: u64,
    /// Bytes behind the readable part of the sources.
    pub tail_bytes_lost: u64,
    /// Attachments of the sources; they are not copied (farreach writes none).
    pub attachments_left_out: u64,
}

/// Copies what can be read of `sources`, in the order of log time across files, into a new file.
/// `from_ns` and `until_ns` limit the log time; `how` is noted in the file.
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
    let file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(output)
        .map_err(|source| EditError::Create { path: output.to_owned(), source })?;
    let failed = |source| EditError::Write { path: output.to_owned(), source: Box::new(source) };
    let mut copy = Copy { sources, report: EditReport::default() };
    let selection = Selection { channels: None, from_ns, until_ns };
    let result = copy.run(BufWriter::new(file), &selection, how, failed);
    match result {
        Ok(()) => Ok(copy.report),
        Err(error) => {
            // Half a copy helps nobody, and the sources are still there. If this fails the error
            // below tells enough.
            let _ = std::fs::remove_file(output);
            Err(error)
        }
    }
}

struct Copy<'a> {
    sources: &'a [&'a Recording],
    report: EditReport,
}

impl Copy<'_> {
    fn run(
        &mut self,
        output: BufWriter<std::fs::File>,
        selection: &Selection,
        how: &BTreeMap<String, String>,
        failed: impl Fn(mcap::McapError) -> EditError,
    ) -> Result<(), EditError> {
        let mut writer = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Lz4))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .profile("ros2")
            .library(concat!("farreach ", env!("CARGO_PKG_VERSION")))
            .create(NoSeek::new(output))
            .map_err(&failed)?;
        let mut channels: Vec<BTreeMap<u16, u16>> = Vec::new();
        for source in self.sources {
            self.report.tail_bytes_lost += source.tail().lost;
            self.report.attachments_left_out += source.attachments();
            for (name, metadata) in source.metadata_records() {
                let record = Metadata { name: name.clone(), metadata: metadata.clone() };
                writer.write_metadata(&record).map_err(&failed)?;
            }
            let mut map = BTreeMap::new();
            for (&id, channel) in source.channels() {
                let schema = if channel.schema_name.is_empty() && channel.schema.is_empty() {
                    0
                } else {
                    writer
                        .add_schema(
                            &channel.schema_name,
                            &channel.schema_encoding,
                            channel.schema.as_bytes(),
                        )
                        .map_err(&failed)?
                };
                let new = writer
                    .add_channel(
                        schema,
                        &channel.topic,
                        &channel.message_encoding,
                        &channel.metadata,
                    )
                    .map_err(&failed)?;
                map.insert(id, new);
            }
            channels.push(map);
        }
        let mut streams: Vec<RawMessages<'_>> =
            self.sources.iter().map(|source| source.raw(selection.clone())).collect();
        let mut heads: Vec<Option<RawMessage>> = Vec::new();
        for stream in &mut streams {
            heads.push(next(stream, &mut self.report)?);
        }
        // few files: the oldest head is found by looking at all
        while let Some(oldest) = (0..heads.len())
            .filter_map(|i| heads[i].as_ref().map(|message| (message.log_time_ns(), i)))
            .min()
            .map(|(_, index)| index)
        {
            let following = next(&mut streams[oldest], &mut self.report)?;
            let Some(message) = std::mem::replace(&mut heads[oldest], following) else { break };
            let Some(&channel_id) = channels[oldest].get(&message.channel_id()) else { continue };
            let header = MessageHeader {
                channel_id,
                sequence: message.sequence(),
                log_time: message.log_time_ns(),
                publish_time: message.publish_time_ns(),
            };
            writer.write_to_known_channel(&header, message.data()).map_err(&failed)?;
            self.report.messages += 1;
        }
        let mut metadata = how.clone();
        metadata.insert("messages".to_owned(), self.report.messages.to_string());
        metadata.insert("damaged_chunks".to_owned(), self.report.damaged_chunks.to_string());
        metadata.insert("tail_bytes_lost".to_owned(), self.report.tail_bytes_lost.to_string());
        writer
            .write_metadata(&Metadata { name: EDIT_RECORD.to_owned(), metadata })
            .map_err(&failed)?;
        writer.finish().map_err(&failed)?;
        let io = |source: io::Error| failed(mcap::McapError::Io(source));
        let mut output = writer.into_inner().into_inner();
        output.flush().map_err(io)?;
        output.get_ref().sync_data().map_err(io)
    }
}

fn next(
    stream: &mut RawMessages<'_>,
    report: &mut EditReport,
) -> Result<Option<RawMessage>, EditError> {
    loop {
        match stream.next() {
            None => return Ok(None),
            Some(Ok(message)) => return Ok(Some(message)),
            Some(Err(ReadError::Damaged { .. })) => report.damaged_chunks += 1,
            Some(Err(error)) => return Err(error.into()),
        }
    }
}
