//! `--set KEY=VALUE`: changes values of a protocol's text before it is read.

use toml_edit::{DocumentMut, Item, Value};

use crate::checked_toml::nearest;
use crate::error::{Problem, ProtocolError};

/// The text with values changed: `segments.0.amplitude_deg=20` sets that key of the first segment.
/// The section must exist, the key need not; what the key may hold is checked when the text is
/// parsed. Lines stay where they are, but for keys that are added.
///
/// # Errors
/// [`ProtocolError::Invalid`] where an override is no `KEY=VALUE` or names a section that does not
/// exist; the problem's file is `--set` and its line the number of the override. Where the text is
/// no TOML, the problem is in `file_name`.
pub fn with_overrides<S: AsRef<str>>(
    text: &str,
    file_name: &str,
    overrides: &[S],
) -> Result<String, ProtocolError> {
    if overrides.is_empty() {
        return Ok(text.to_owned());
    }
    // The plain reader reports invalid TOML with its line.
    crate::checked_toml::Source::new(text, file_name).parse()?;
    let mut document: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| {
        problem(0, "", "valid TOML", error.message(), "correct the protocol")
    })?;
    for (index, assignment) in overrides.iter().enumerate() {
        set(&mut document, index + 1, assignment.as_ref())?;
    }
    Ok(document.to_string())
}

fn problem(line: usize, key: &str, expected: &str, found: &str, advice: &str) -> ProtocolError {
    Problem::new("--set", line, key, expected, found, advice).into()
}

fn set(document: &mut DocumentMut, line: usize, assignment: &str) -> Result<(), ProtocolError> {
    let advice = "write it as segments.0.amplitude_deg=20";
    let Some((path, value)) = assignment.split_once('=') else {
        return Err(problem(line, "", "KEY=VALUE", &format!("\"{assignment}\""), advice));
    };
    let (path, value) = (path.trim(), value.trim());
    let (section, key) = path.rsplit_once('.').unwrap_or(("", path));
    if key.is_empty() || path.split('.').any(str::is_empty) {
        return Err(problem(line, path, "a key with its section", "an empty name", advice));
    }
    let mut item = document.as_item_mut();
    for step in section.split('.').filter(|step| !step.is_empty()) {
        item = descend(item, step).map_err(|expected| {
            let found = format!("\"{step}\"");
            problem(line, path, &expected, &found, "name a section that the protocol has")
        })?;
    }
    let Some(table) = item.as_table_like_mut() else {
        return Err(problem(line, path, "a section that holds keys", "a single value", advice));
    };
    let mut value = parse_value(value).ok_or_else(|| {
        let (expected, found) = ("a number, true, false, a list or a text", format!("\"{value}\""));
        problem(line, path, expected, &found, "put a text in quotes")
    })?;
    match table.get_mut(key) {
        Some(Item::Value(old)) => {
            *value.decor_mut() = old.decor().clone();
            *old = value;
        }
        Some(_) => return Err(problem(line, path, "a single value", "a section", advice)),
        None => {
            table.insert(key, Item::Value(value));
        }
    }
    Ok(())
}

/// One step of the path: a key, or an index from 0. `Err` says what would have been there.
pub(super) fn descend<'i>(item: &'i mut Item, step: &str) -> Result<&'i mut Item, String> {
    let among = match &*item {
        Item::ArrayOfTables(list) => format!("an index from 0 to {}", list.len().saturating_sub(1)),
        _ => {
            let names: Vec<_> = item
                .as_table_like()
                .map(|table| table.iter().map(|(key, _)| key.to_owned()).collect())
                .unwrap_or_default();
            match nearest(step, names.iter().map(String::as_str)) {
                Some(name) => format!("one of {} (did you mean `{name}`?)", names.join(", ")),
                None => format!("one of {}", names.join(", ")),
            }
        }
    };
    match step.parse::<usize>() {
        Ok(index) => item.get_mut(index),
        Err(_) => item.get_mut(step),
    }
    .filter(|item| !item.is_none())
    .ok_or(among)
}

/// A TOML value; a bare word is a text, because shells remove quotes.
fn parse_value(text: &str) -> Option<Value> {
    if let Ok(value) = text.parse::<Value>() {
        return Some(value);
    }
    let word = !text.is_empty() && text.starts_with(char::is_alphabetic);
    let plain = text.chars().all(|c| c.is_alphanumeric() || matches!(c, ' ' | '_' | '-'));
    (word && plain).then(|| Value::from(text))
}
