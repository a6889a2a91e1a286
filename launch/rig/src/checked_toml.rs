//! Reads TOML with line numbers: every getter checks type and range, remembers the keys that it
//! knows and collects problems, so that all of a file's problems are reported at once.
//!
//! A getter whose value is wrong reports the problem and returns a placeholder, which goes no
//! further: [`Source::finish`] returns the problems.

mod values;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Display;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{FileError, Problem};

/// A file's text, the lines of its keys, and the problems found so far.
pub(crate) struct Source<'a> {
    file: &'a str,
    text: &'a str,
    lines: RefCell<BTreeMap<String, usize>>,
    problems: RefCell<Vec<Problem>>,
    pub(crate) documented: RefCell<Vec<Documented>>,
    #[cfg(test)]
    pub(crate) tables: RefCell<Vec<(&'static str, Keys)>>,
}

impl<'a> Source<'a> {
    pub(crate) fn new(text: &'a str, file: &'a str) -> Self {
        Self {
            file,
            text,
            lines: RefCell::default(),
            problems: RefCell::default(),
            documented: RefCell::default(),
            #[cfg(test)]
            tables: RefCell::default(),
        }
    }

    /// Parses the text into values with their spans.
    pub(crate) fn parse(&self) -> Result<Spanned<DeTable<'a>>, FileError> {
        DeTable::parse(self.text).map_err(|error| {
            let message = error.message().lines().collect::<Vec<_>>().join(", ");
            let line = error.span().map_or(1, |span| self.line(span.start));
            let advice = "correct the line; comments begin with #, texts are in quotes";
            let found = format!("an error: {message}");
            Problem::new(self.file, line, "", "valid TOML", found, advice).into()
        })
    }

    /// The outermost section.
    pub(crate) fn root<'s>(&'s self, table: &'s DeTable<'a>) -> Section<'s> {
        Section::new(self, Some(table), String::new(), 1)
    }

    fn line(&self, at: usize) -> usize {
        1 + self.text.as_bytes().iter().take(at).filter(|byte| **byte == b'\n').count()
    }

    /// Line of a key that was read, or of the innermost section around it that was.
    fn line_of(&self, key: &str) -> usize {
        let lines = self.lines.borrow();
        let mut key = key;
        loop {
            if let Some(line) = lines.get(key) {
                return *line;
            }
            match key.rfind('.') {
                Some(at) => key = &key[..at],
                None => return 1,
            }
        }
    }

    /// Whether that key is in the file and was read.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.lines.borrow().contains_key(key)
    }

    /// Reports a problem with a key that was read before; returns false, for a check to return.
    pub(crate) fn problem(
        &self,
        key: &str,
        expected: impl Display,
        found: impl Display,
        advice: impl Display,
    ) -> bool {
        self.report(Problem::new(self.file, self.line_of(key), key, expected, found, advice));
        false
    }

    fn report(&self, problem: Problem) {
        self.problems.borrow_mut().push(problem);
    }

    /// Whether no problem was reported so far.
    pub(crate) fn is_clean(&self) -> bool {
        self.problems.borrow().is_empty()
    }

    /// Returns every problem reported, in the order of lines.
    pub(crate) fn finish(self) -> Result<(), FileError> {
        let mut problems = self.problems.into_inner();
        if problems.is_empty() {
            return Ok(());
        }
        problems.sort_by_key(|problem| problem.line);
        Err(FileError::Invalid { problems })
    }
}

/// Bounds of a number, with the advice for a value outside.
#[derive(Clone, Copy)]
pub(crate) struct Bounds {
    least: f64,
    pub(crate) most: f64,
    advice: &'static str,
}

/// Bounds from `least` to `most`, both included.
pub(crate) const fn bounds(least: f64, most: f64, advice: &'static str) -> Bounds {
    Bounds { least, most, advice }
}

/// The keys of a section with their descriptions, from which the reference pages are generated.
/// `{deg,m}` in a key stands for either.
pub(crate) type Keys = &'static [(&'static str, &'static str)];

/// Whether `key` is one of the keys that a name in [`Keys`] stands for.
pub(crate) fn stands_for(name: &str, key: &str) -> bool {
    match name.split_once('{').and_then(|(head, tail)| Some((head, tail.split_once('}')?))) {
        Some((head, (units, tail))) => {
            units.split(',').any(|unit| key == format!("{head}{unit}{tail}"))
        }
        None => name == key,
    }
}

/// A documented key as the reader accepts it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Documented {
    pub(crate) section: &'static str,
    pub(crate) key: String,
    /// The key with its path within the file.
    pub(crate) path: String,
    /// What the key means.
    pub(crate) about: &'static str,
    /// Type and range.
    pub(crate) accepts: String,
    /// `required`, `optional` or the default.
    pub(crate) default: String,
}

/// A table of the file.
pub(crate) struct Section<'s> {
    source: &'s Source<'s>,
    table: Option<&'s DeTable<'s>>,
    path: String,
    line: usize,
    known: RefCell<Vec<String>>,
    tables: RefCell<Vec<(&'static str, Keys)>>,
}

impl<'s> Section<'s> {
    fn new(
        source: &'s Source<'s>,
        table: Option<&'s DeTable<'s>>,
        path: String,
        line: usize,
    ) -> Self {
        Self { source, table, path, line, known: RefCell::default(), tables: RefCell::default() }
    }

    /// Declares the keys of the section. Afterwards only these can be read.
    pub(crate) fn document(&self, section: &'static str, keys: Keys) {
        self.tables.borrow_mut().push((section, keys));
        #[cfg(test)]
        self.source.tables.borrow_mut().push((section, keys));
    }

    /// Name of the documented section that has the key, and what the key means.
    fn documented_in(&self, key: &str) -> Option<(&'static str, &'static str)> {
        let tables = self.tables.borrow();
        tables.iter().rev().find_map(|(section, keys)| {
            let (_, about) = keys.iter().find(|(name, _)| stands_for(name, key))?;
            Some((*section, *about))
        })
    }

    /// Records what the reader accepts under a key, for the generated pages and for entry forms.
    fn note(&self, key: &str, accepts: impl Display, default: impl Display) {
        if let Some((section, about)) = self.documented_in(key) {
            self.source.documented.borrow_mut().push(Documented {
                section,
                key: key.to_owned(),
                path: self.path(key),
                about,
                accepts: accepts.to_string(),
                default: default.to_string(),
            });
        }
    }

    /// The path of `key` within the file.
    pub(crate) fn path(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Whether the section is in the file.
    pub(crate) fn exists(&self) -> bool {
        self.table.is_some()
    }

    /// Whether the key is in the section.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.table.is_some_and(|table| table.contains_key(key))
    }

    /// All keys in the section, in the order of their lines.
    pub(crate) fn keys(&self) -> Vec<String> {
        let Some(table) = self.table else { return Vec::new() };
        let mut keys: Vec<_> =
            table.iter().map(|(key, _)| (key.span().start, key.get_ref().to_string())).collect();
        keys.sort();
        keys.into_iter().map(|(_, key)| key).collect()
    }

    fn value(&self, key: &str) -> Option<&'s Spanned<DeValue<'s>>> {
        debug_assert!(
            self.tables.borrow().is_empty() || self.documented_in(key).is_some(),
            "undocumented key {}: add it to the section's KEYS",
            self.path(key)
        );
        self.known.borrow_mut().push(key.to_owned());
        let (name, value) = self.table?.get_key_value(key)?;
        self.source.lines.borrow_mut().insert(self.path(key), self.source.line(name.span().start));
        Some(value)
    }

    fn required(&self, key: &str, expected: &str) -> Option<&'s Spanned<DeValue<'s>>> {
        let value = self.value(key);
        if value.is_none() {
            self.problem(key, expected, "nothing", "add the key");
        }
        value
    }

    /// Reports a problem with one of the section's keys.
    pub(crate) fn problem(
        &self,
        key: &str,
        expected: impl Display,
        found: impl Display,
        advice: impl Display,
    ) {
        let name = self.table.and_then(|table| table.get_key_value(key)).map(|(name, _)| name);
        let line = name.map_or(self.line, |name| self.source.line(name.span().start));
        let (file, key) = (self.source.file, self.path(key));
        self.source.report(Problem::new(file, line, &key, expected, found, advice));
    }

    /// As [`Self::problem`]; returns `None`, for a reader to return.
    pub(crate) fn refuse<T>(
        &self,
        key: &str,
        expected: impl Display,
        found: impl Display,
        advice: impl Display,
    ) -> Option<T> {
        self.problem(key, expected, found, advice);
        None
    }

    /// A section within this one; empty where it is not in the file.
    pub(crate) fn section(&self, key: &str) -> Section<'s> {
        self.note(key, "section", "");
        let value = self.value(key);
        self.section_of(key, value)
    }

    fn section_of(&self, key: &str, value: Option<&'s Spanned<DeValue<'s>>>) -> Section<'s> {
        let path = self.path(key);
        let line = value.map_or(self.line, |value| self.source.line(value.span().start));
        let table = value.and_then(|value| value.get_ref().as_table());
        if let (Some(value), None) = (value, table) {
            let advice = "write it as [section] or { key = value }";
            self.problem(key, "a table of keys", describe(value.get_ref()), advice);
        }
        self.source.lines.borrow_mut().entry(path.clone()).or_insert(line);
        Section::new(self.source, table, path, line)
    }

    /// The sections of a list (`[[key]]`).
    pub(crate) fn sections(&self, key: &str) -> Vec<Section<'s>> {
        self.note(key, "list of sections", "");
        let Some(value) = self.value(key) else { return Vec::new() };
        let Some(list) = value.get_ref().as_array() else {
            let advice = format!("write each as [[{key}]]");
            self.problem(key, "a list of tables", describe(value.get_ref()), advice);
            return Vec::new();
        };
        list.iter()
            .enumerate()
            .map(|(index, item)| self.section_of(&format!("{key}.{index}"), Some(item)))
            .collect()
    }

    /// Marks every key as known, where the right ones cannot be told.
    pub(crate) fn know_all(&self) {
        self.known.borrow_mut().extend(self.keys());
    }

    /// Reports a key that does not belong here, if it is present.
    pub(crate) fn misplaced(&self, key: &str, expected: &str, advice: &str) {
        if self.value(key).is_some() {
            self.problem(key, expected, "this key", advice);
        }
    }
}

/// Reports the unknown keys: a section goes out of scope when all its keys were read.
impl Drop for Section<'_> {
    fn drop(&mut self) {
        let mut known = self.known.take();
        known.sort_unstable();
        known.dedup();
        for key in self.keys().iter().filter(|key| !known.contains(key)) {
            let advice = match nearest(key, known.iter().map(String::as_str)) {
                Some(name) => format!("did you mean `{name}`?"),
                None => "take it out".to_owned(),
            };
            self.problem(key, format!("one of {}", known.join(", ")), "an unknown key", advice);
        }
    }
}

/// The known name that is most similar, if one is.
pub(crate) fn nearest<'n>(wrong: &str, names: impl Iterator<Item = &'n str>) -> Option<&'n str> {
    names
        .map(|name| (strsim::jaro_winkler(wrong, name), name))
        .filter(|(likeness, _)| *likeness > 0.8)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, name)| name)
}

fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text \"{text}\""),
        DeValue::Integer(integer) => integer.to_string(),
        DeValue::Float(float) => float.to_string(),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(time) => format!("the date {time}"),
        DeValue::Array(list) if list.is_empty() => "an empty list".to_owned(),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}
