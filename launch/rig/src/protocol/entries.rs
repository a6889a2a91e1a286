//! The values of a protocol's file that a person may change, for entry forms.

use toml_edit::DocumentMut;

use super::Protocol;
use super::overrides::descend;
use crate::checked_toml::Source;
use crate::error::ProtocolError;

/// A key of a protocol's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// The key with its path, as [`super::with_overrides`] takes it (`matching.session_s`).
    pub path: String,
    /// Its value as the file has it; `None` where the key is not in the file.
    pub value: Option<String>,
    /// Type and range, in words (`number, 5 to 600`).
    pub accepts: String,
    /// `required`, `optional` or the default.
    pub default: String,
    /// What it means.
    pub about: &'static str,
}

/// The keys that a protocol's file has or may have, in the order in which they are read. Problems
/// with their values are not looked at: [`Protocol::parse`] does that.
///
/// # Errors
/// [`ProtocolError::Invalid`] where the text is no TOML.
pub fn entries(text: &str, file_name: &str) -> Result<Vec<Entry>, ProtocolError> {
    let source = Source::new(text, file_name);
    let table = source.parse()?;
    Protocol::read(source.root(table.get_ref()), text, file_name);
    let mut document: Option<DocumentMut> = text.parse().ok();
    let mut entries: Vec<Entry> = Vec::new();
    for key in source.documented.borrow().iter() {
        let is_section = key.accepts.ends_with("section") || key.accepts.ends_with("sections");
        // A getter that calls another records a key twice: the first time is right.
        if is_section || entries.iter().any(|known| known.path == key.path) {
            continue;
        }
        entries.push(Entry {
            path: key.path.clone(),
            value: document.as_mut().and_then(|document| value_at(document, &key.path)),
            accepts: key.accepts.clone(),
            default: key.default.clone(),
            about: key.about,
        });
    }
    Ok(entries)
}

/// The value under a path, as the file has it.
fn value_at(document: &mut DocumentMut, path: &str) -> Option<String> {
    let mut item = document.as_item_mut();
    for step in path.split('.') {
        item = descend(item, step).ok()?;
    }
    let mut value = item.as_value()?.clone();
    // Without the comment behind it.
    value.decor_mut().clear();
    Some(value.to_string())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;
    use crate::PROTOCOLS;
    use crate::protocol::with_overrides;

    fn of<'e>(entries: &'e [Entry], path: &str) -> &'e Entry {
        entries.iter().find(|entry| entry.path == path).expect(path)
    }

    #[test]
    fn an_entry_has_the_value_its_limits_and_what_it_means() {
        let shipped = PROTOCOLS.iter().find(|file| file.name == "force-matching").unwrap();
        let entries = entries(shipped.text, shipped.name).unwrap();
        let session = of(&entries, "matching.session_s");
        assert_eq!(session.value.as_deref(), Some("30.0"));
        assert_eq!(session.accepts, "number, 5 to 600");
        assert_eq!(session.about, "Duration of a session.");
        let timeout = of(&entries, "matching.timeout_s");
        assert_eq!((timeout.value.as_deref(), timeout.default.as_str()), (None, "300"));
        assert_eq!(of(&entries, "matching.signal").value.as_deref(), Some("\"torque\""));
    }

    #[test]
    fn every_entry_with_a_value_can_be_set_to_that_value() {
        for file in PROTOCOLS {
            let entries = entries(file.text, file.name).unwrap();
            let present = entries.iter().filter(|entry| entry.value.is_some());
            let same: Vec<String> = present
                .map(|entry| format!("{}={}", entry.path, entry.value.as_deref().unwrap()))
                .collect();
            assert!(same.len() > 2, "{}", file.name);
            assert_eq!(with_overrides(file.text, file.name, &same).unwrap(), file.text);
        }
    }

    #[test]
    fn wrong_values_are_entries_like_others_and_no_toml_is_an_error() {
        let text = "[protocol]\nname = \"x\"\nrepeat = -3\n";
        let entries = entries(text, "x").unwrap();
        assert_eq!(of(&entries, "protocol.repeat").value.as_deref(), Some("-3"));
        assert!(super::entries("= 3", "x").is_err());
    }
}
