//! What a page may ask for. Nothing here acts: a text becomes a [`Message`] or an error.

use std::collections::BTreeMap;

use ipc_types::{PulseSource, TEXT, Verb};
use serde::{Deserialize, Deserializer};

/// Longest message of a page (bytes).
pub(crate) const LONGEST: usize = 65_536;
/// Longest name of a subject or a file (bytes).
const LONGEST_NAME: usize = 200;
/// Most entries of a setup.
const MOST_ENTRIES: usize = 1000;

/// A message of a page.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Message {
    /// Number that the answer repeats; the page chose it.
    pub(crate) id: u64,
    /// What it asks for.
    pub(crate) request: Request,
}

/// A request. Times of the page are those of its own clock (ms), times of the console those of
/// `CLOCK_MONOTONIC` (ms).
#[derive(Debug, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) enum Request {
    /// Shows the token, which makes a page one that may control the rig.
    Hello {
        /// The token.
        token: String,
    },
    /// Takes control from the page that has it.
    TakeControl,
    /// A verb for the watchdog.
    Verb {
        /// Which.
        verb: Verb,
    },
    /// Asks for the values of a protocol and their limits.
    Describe {
        /// Name of a shipped protocol, or path of a file.
        protocol: String,
    },
    /// Reads and checks a protocol with values, so that it can be started.
    Build(Setup),
    /// Reads the protocol that was interrupted, so that it can be continued.
    Interrupted {
        /// Code of the subject; empty for the one it was begun with.
        #[serde(default)]
        subject: String,
        /// Name of the sessions' MATLAB files; empty for none.
        #[serde(default)]
        files: String,
    },
    /// Plays the protocol that finds the stops.
    Initialise,
    /// Plays the protocol that was built.
    Start {
        /// Its identity, from the answer to `build`.
        build: String,
    },
    /// Ends the running protocol.
    Stop,
    /// The key 5 was pressed: a pulse of the scanner.
    Pulse {
        /// When (ms).
        page_ms: f64,
    },
    /// A note of the operator, for the recording.
    Note {
        /// Its text.
        text: String,
    },
    /// Begins a recording.
    Record {
        /// Absolute path of the file.
        file: String,
    },
    /// Ends the recording.
    EndRecording,
    /// Checks again which processes answer.
    Refresh,
    /// Answers a message of the clock.
    Echo {
        /// When the console sent it (ms).
        server_ms: f64,
        /// When the page had it (ms).
        page_ms: f64,
    },
    /// A bar is on the page's screen.
    Shown {
        /// Instant of what it shows (ms).
        at_ms: f64,
        /// When the frame was drawn (ms).
        page_ms: f64,
    },
    /// A page made a sound for an event.
    Sounded {
        /// Kind of the event, in words.
        event: String,
        /// Instant of the event (ms).
        at_ms: f64,
        /// When the sound began (ms).
        page_ms: f64,
    },
}

/// What is to be played.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Setup {
    /// Name of a shipped protocol, or path of a file.
    pub(crate) protocol: String,
    /// Values that differ from the file's, by key.
    #[serde(default)]
    pub(crate) entries: BTreeMap<String, String>,
    /// Code of the subject; may be empty.
    #[serde(default)]
    pub(crate) subject: String,
    /// Where the scanner's pulses come from: `line`, `key`, or an emulated scanner (`2`).
    #[serde(default, deserialize_with = "pulse_source")]
    pub(crate) scanner: PulseSource,
    /// Name of the sessions' MATLAB files, beside the recording; empty for none.
    #[serde(default)]
    pub(crate) files: String,
}

/// Reads a source of pulses from its text.
fn pulse_source<'de, D: Deserializer<'de>>(text: D) -> Result<PulseSource, D::Error> {
    String::deserialize(text)?.parse().map_err(serde::de::Error::custom)
}

/// What a page needs for a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Level {
    /// Nothing: measurements, the token itself.
    Anyone,
    /// The token: what stops the rig, and taking control.
    Token,
    /// The token and control: one page at a time.
    Control,
}

/// The thread that carries a request out: what takes power or movement away waits for nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Queue {
    /// What takes power away.
    Power,
    /// What ends a movement.
    Stop,
    /// Pulses of the scanner: they lose their worth with time.
    Key,
    /// All else.
    Other,
}

impl Request {
    /// What a page needs for it. Whoever has the token may stop the rig.
    pub(crate) const fn level(&self) -> Level {
        match self {
            Self::Hello { .. } | Self::Echo { .. } | Self::Shown { .. } | Self::Sounded { .. } => {
                Level::Anyone
            }
            Self::TakeControl
            | Self::Stop
            | Self::Describe { .. }
            | Self::Refresh
            | Self::Verb { verb: Verb::Estop | Verb::Disarm } => Level::Token,
            _ => Level::Control,
        }
    }

    /// Which thread carries it out.
    pub(crate) const fn queue(&self) -> Queue {
        match self {
            Self::Verb { verb: Verb::Estop | Verb::Disarm } => Queue::Power,
            Self::Stop => Queue::Stop,
            Self::Pulse { .. } => Queue::Key,
            _ => Queue::Other,
        }
    }
}

/// Reads a message.
///
/// # Errors
/// Its number, 0 where it has none, and what is wrong with it, in words.
pub(crate) fn parse(text: &str) -> Result<Message, (u64, String)> {
    if text.len() > LONGEST {
        let error = format!("a message of {} bytes; at most {LONGEST} are read", text.len());
        return Err((0, error));
    }
    let message: Message = serde_json::from_str(text).map_err(|error| {
        // The page waits for an answer to its number, whatever else it got wrong.
        let value = serde_json::from_str::<serde_json::Value>(text).ok();
        let id = value.and_then(|value| value.get("id")?.as_u64()).unwrap_or(0);
        (id, format!("no message of a page: {error}"))
    })?;
    check(&message.request).map_err(|error| (message.id, error))?;
    Ok(message)
}

/// Bounds of what JSON alone does not bound.
fn check(request: &Request) -> Result<(), String> {
    match request {
        Request::Note { text } => note(text),
        Request::Record { file } => name("file", file),
        Request::Describe { protocol } => name("protocol", protocol),
        Request::Interrupted { subject, files } => {
            name("subject", subject)?;
            name("files", files)
        }
        Request::Build(setup) => {
            name("protocol", &setup.protocol)?;
            name("subject", &setup.subject)?;
            name("files", &setup.files)?;
            if setup.entries.len() > MOST_ENTRIES {
                let found = setup.entries.len();
                return Err(format!("expected at most {MOST_ENTRIES} entries, found {found}"));
            }
            Ok(())
        }
        _ => Ok(()),
    }
}

fn name(what: &str, text: &str) -> Result<(), String> {
    if text.len() > LONGEST_NAME {
        let found = text.len();
        return Err(format!("{what}: expected at most {LONGEST_NAME} bytes, found {found}"));
    }
    if text.chars().any(char::is_control) {
        return Err(format!("{what}: expected a line of text, found a control character"));
    }
    Ok(())
}

/// A note is an event: its text must fit there whole.
fn note(text: &str) -> Result<(), String> {
    name("note", text)?;
    if text.trim().is_empty() || text.len() > TEXT {
        let found = text.len();
        return Err(format!("note: expected a text of at most {TEXT} bytes, found {found}"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use proptest::prelude::*;

    use super::*;

    fn request(text: &str) -> Request {
        parse(&format!("{{\"id\": 7, \"request\": {text}}}")).unwrap().request
    }

    #[test]
    fn requests_are_read() {
        assert_eq!(request(r#"{"do": "verb", "verb": "arm"}"#), Request::Verb { verb: Verb::Arm });
        assert_eq!(request(r#"{"do": "stop"}"#), Request::Stop);
        let Request::Build(setup) = request(
            r#"{"do": "build", "protocol": "force-matching", "subject": "Jörg Ångström",
                "entries": {"matching.sets": "1"}, "scanner": "2,missing=3", "files": "S1_"}"#,
        ) else {
            panic!("no setup")
        };
        assert_eq!(setup.subject, "Jörg Ångström");
        assert_eq!(setup.entries["matching.sets"], "1");
        assert_eq!(setup.scanner.to_string(), "2,missing=3");
        assert_eq!(request(r#"{"do": "pulse", "page_ms": 1.5}"#), Request::Pulse { page_ms: 1.5 });
    }

    #[test]
    fn what_is_wrong_is_told() {
        for (text, part) in [
            ("", "no message"),
            ("{\"id\": 1}", "request"),
            (r#"{"id": 1, "request": {"do": "fly"}}"#, "fly"),
            (r#"{"id": 1, "request": {"do": "verb", "verb": "enable!"}}"#, "enable!"),
            (r#"{"id": 1, "request": {"do": "stop"}, "x": 1}"#, "x"),
            (r#"{"id": 1, "request": {"do": "note", "text": " "}}"#, "note"),
            (
                r#"{"id": 1, "request": {"do": "build", "protocol": "a", "scanner": "2,x=1"}}"#,
                "jitter=S",
            ),
            (r#"{"id": 1, "request": {"do": "record", "file": "a\u0000b"}}"#, "control character"),
        ] {
            let (_, error) = parse(text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
        let wrong = r#"{"id": 9, "request": {"do": "build", "protocol": "a", "scanner": ""}}"#;
        assert_eq!(parse(wrong).unwrap_err().0, 9, "the page gets its answer");
        let long = "x".repeat(TEXT + 1);
        let note = format!(r#"{{"id": 1, "request": {{"do": "note", "text": "{long}"}}}}"#);
        let (id, error) = parse(&note).unwrap_err();
        assert!(id == 1 && error.contains(&format!("at most {TEXT}")), "{id}: {error}");
        assert!(parse(&"[".repeat(LONGEST + 1)).unwrap_err().1.contains("bytes"));
        // Deeper than the parser goes.
        assert!(parse(&"[".repeat(LONGEST)).is_err());
    }

    #[test]
    fn whoever_has_the_token_may_stop_the_rig_and_nobody_else_may_power_it() {
        let level = |text| request(text).level();
        assert_eq!(level(r#"{"do": "stop"}"#), Level::Token);
        assert_eq!(level(r#"{"do": "verb", "verb": "estop"}"#), Level::Token);
        for control in [
            r#"{"do": "verb", "verb": "reset"}"#,
            r#"{"do": "verb", "verb": "arm"}"#,
            r#"{"do": "verb", "verb": "enable"}"#,
            r#"{"do": "initialise"}"#,
            r#"{"do": "pulse", "page_ms": 0}"#,
            r#"{"do": "start", "build": "1"}"#,
            r#"{"do": "end-recording"}"#,
        ] {
            assert_eq!(level(control), Level::Control, "{control}");
        }
    }

    /// Texts that are nearly messages, so that more than the first byte is read.
    fn nearly() -> impl Strategy<Value = String> {
        let word = prop::sample::select(vec![
            "id", "request", "do", "verb", "arm", "enable", "start", "build", "hello", "token",
            "note", "text", "entries", "protocol", "echo", "pulse", "page_ms", "1e999", "-1",
            "null", "{", "}", "[", "]", ":", ",", "\"", "\\u0000", "0.5", "stop",
        ]);
        let quoted = prop::bool::ANY;
        prop::collection::vec((word, quoted), 0..40).prop_map(|words| {
            let part = |(word, quoted): (&str, bool)| match quoted {
                true => format!("\"{word}\""),
                false => word.to_owned(),
            };
            words.into_iter().map(part).collect()
        })
    }

    /// A message with one character changed.
    fn damaged() -> impl Strategy<Value = String> {
        let message = prop::sample::select(vec![
            r#"{"id": 1, "request": {"do": "verb", "verb": "enable"}}"#,
            r#"{"id": 1, "request": {"do": "start", "build": "00"}}"#,
            r#"{"id": 1, "request": {"do": "hello", "token": "0123456789abcdef"}}"#,
            r#"{"id": 1, "request": {"do": "build", "protocol": "steps", "entries": {"a": "1"}}}"#,
        ]);
        (message, any::<prop::sample::Index>(), any::<char>()).prop_map(|(text, at, new)| {
            let mut characters: Vec<char> = text.chars().collect();
            let at = at.index(characters.len());
            characters[at] = new;
            characters.into_iter().collect()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]

        #[test]
        fn any_text_is_a_message_or_an_error(
            text in prop_oneof![".{0,200}", nearly(), damaged()],
        ) {
            let _read = parse(&text);
        }
    }
}
