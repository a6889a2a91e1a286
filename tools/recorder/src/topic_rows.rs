//! The messages of a topic as rows of a table: the log time first, then every field, an array
//! spread over columns, a text in one.

use anyhow::bail;
use recording::mcap_read::{RawMessage, ReadError, Recording, Selection};
use recording::schema::{Layout, LayoutField};

use ipc_types::Value;

/// Name of the first column.
pub(crate) const LOG_TIME: &str = "log_time_ns";

/// A column of such a table.
#[derive(Clone, Debug)]
pub(crate) struct TopicColumn<'a> {
    pub(crate) name: String,
    pub(crate) content: Content<'a>,
}

/// What a column has of each message.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Content<'a> {
    /// When it was logged (ns since 1970).
    LogTime,
    /// A number: this element of a field.
    Element(&'a LayoutField, usize),
    /// The text of an event.
    Text(&'a LayoutField),
}

/// What stands in a row of a column.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Cell {
    LogTime(u64),
    Number(Value),
    Text(String),
}

/// The columns of messages of this layout.
pub(crate) fn columns_of(layout: &Layout) -> Vec<TopicColumn<'_>> {
    let mut columns = vec![TopicColumn { name: LOG_TIME.to_owned(), content: Content::LogTime }];
    for field in &layout.fields {
        let name = field.name.clone();
        match field.array {
            Some(_) if field.text_length(&layout.fields).is_some() => {
                columns.push(TopicColumn { name, content: Content::Text(field) });
            }
            Some(count) => columns.extend((0..count).map(|index| TopicColumn {
                name: format!("{name}_{index}"),
                content: Content::Element(field, index),
            })),
            None => columns.push(TopicColumn { name, content: Content::Element(field, 0) }),
        }
    }
    columns
}

impl TopicColumn<'_> {
    /// Its cell in the row of a message with this layout and body; `None` where the body is too
    /// short.
    pub(crate) fn cell(&self, message: &RawMessage, layout: &Layout, body: &[u8]) -> Option<Cell> {
        match self.content {
            Content::LogTime => Some(Cell::LogTime(message.log_time_ns())),
            Content::Element(field, index) => field.read(body, index).map(Cell::Number),
            Content::Text(field) => field.event_text(&layout.fields, body).map(Cell::Text),
        }
    }
}

/// Reads a topic: `rows` makes something of messages of one layout, on all processors, and `take`
/// gets the results in the order of the file, up to its first error. Returns the layout; `None`
/// where the topic has no messages and its schema cannot be read.
///
/// # Errors
/// Those of reading, of `rows` and of `take`, and where the fields change within the file.
pub(crate) fn each_part<'a, T: Send>(
    recording: &'a Recording,
    topic: &str,
    selection: &Selection,
    rows: impl Fn(&[TopicColumn<'_>], &[RawMessage]) -> anyhow::Result<T> + Sync,
    mut take: impl FnMut(&'a Layout, T) -> anyhow::Result<()>,
) -> anyhow::Result<Option<&'a Layout>> {
    let layout_of = |id: &u16| recording.channels.get(id)?.layout.as_ref().ok();
    let work = |messages: Result<Vec<RawMessage>, ReadError>| {
        let messages = messages?;
        let mut parts = Vec::new();
        for messages in messages.chunk_by(|a, b| a.channel_id() == b.channel_id()) {
            let Some(first) = messages.first() else { continue };
            let (layout, _) = recording.decode(first)?;
            parts.push((first.channel_id(), rows(&columns_of(layout), messages)?));
        }
        anyhow::Ok(parts)
    };
    let mut found: Option<&Layout> = None;
    recording.in_order(selection, work, |parts| {
        for (channel_id, part) in parts? {
            let Some(layout) = layout_of(&channel_id) else { continue };
            if found.is_some_and(|found| found != layout) {
                bail!(
                    "{}: topic {topic} changes its fields within the file: export the parts one \
                     by one",
                    recording.path().display()
                );
            }
            found = Some(layout);
            take(layout, part)?;
        }
        Ok(())
    })?;
    let first = selection.channels.as_ref().and_then(|channels| channels.first());
    Ok(found.or_else(|| first.and_then(layout_of)))
}
