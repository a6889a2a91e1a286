//! What a recording says of processes in whose place programs of others run: an entry of the
//! metadata for when it begins, and events for what changes later.

use std::collections::BTreeMap;

use ipc_types::TEXT;

/// What the entry begins with where it is not known.
const NOT_KNOWN: &str = "not known: ";
/// Ends a text that was too long.
const MORE: &str = "…";

/// The entry [`crate::mcap_write::key::REPLACED`] of the metadata.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Replaced {
    /// Program and arguments by process; empty where every process runs farreach's own program.
    Known(BTreeMap<String, Vec<String>>),
    /// Nobody could say; the reason.
    Unknown(String),
}

impl Replaced {
    /// As it stands in the metadata: JSON, `{"control":["/usr/bin/python3","control.py"]}`, or `not
    /// known: ` and the reason.
    pub fn to_text(&self) -> String {
        match self {
            Self::Known(commands) => serde_json::json!(commands).to_string(),
            Self::Unknown(reason) => format!("{NOT_KNOWN}{reason}"),
        }
    }

    /// Reads it back. A text in no known form is taken for a reason.
    pub fn of_text(text: &str) -> Self {
        match serde_json::from_str(text) {
            Ok(commands) => Self::Known(commands),
            Err(_) => Self::Unknown(text.strip_prefix(NOT_KNOWN).unwrap_or(text).to_owned()),
        }
    }
}

/// Program and arguments in one line.
pub fn in_words(command: &[String]) -> String {
    command.join(" ").replace(|letter: char| letter.is_control(), " ")
}

/// The text of the event *process replaced*: `control: /usr/bin/python3 control.py`. A longer one
/// than an event holds ends with `…`.
pub fn event_text(process: &str, command: &str) -> String {
    let mut text = format!("{process}: {command}");
    if text.len() > TEXT {
        let mut end = TEXT - MORE.len();
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        text.truncate(end);
        text.push_str(MORE);
    }
    text
}

#[cfg(test)]
mod tests {
    use ipc_types::{Event, EventKind, Process, Severity};

    use super::*;

    #[test]
    fn the_entry_reads_back_as_it_was_written() {
        let command = ["/usr/bin/python3", "my control.py", "--say", "\"a\"\nb"].map(str::to_owned);
        let known = BTreeMap::from([("control".to_owned(), command.to_vec())]);
        for entry in [
            Replaced::Known(BTreeMap::new()),
            Replaced::Known(known),
            Replaced::Unknown("no launcher".to_owned()),
        ] {
            assert_eq!(Replaced::of_text(&entry.to_text()), entry);
        }
        assert_eq!(Replaced::Known(BTreeMap::new()).to_text(), "{}");
        assert_eq!(Replaced::of_text("[1]"), Replaced::Unknown("[1]".to_owned()));
    }

    #[test]
    fn an_event_holds_its_text_whole_or_shows_that_there_is_more() {
        assert_eq!(in_words(&["a".to_owned(), "b\nc".to_owned()]), "a b c");
        assert_eq!(event_text("control", "/bin/true -x"), "control: /bin/true -x");
        for letter in ["a", "ü", "…"] {
            for count in 30..130 {
                let text = event_text("control", &letter.repeat(count));
                let (kind, severity) = (EventKind::ProcessReplaced, Severity::Warning);
                let event = Event::new(Process::Logger, kind, severity, &text);
                assert_eq!(event.text(), text);
                let whole = text == format!("control: {}", letter.repeat(count));
                assert!(whole || text.len() > TEXT - 6 && text.ends_with(MORE), "{text}");
                // Shortened once, it stays as it is.
                let command = text.strip_prefix("control: ").unwrap();
                assert_eq!(event_text("control", command), text);
            }
        }
    }
}
