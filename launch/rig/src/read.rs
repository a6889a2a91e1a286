//! Reads TOML with a memory for lines: every getter checks type and range, notes which keys are
//! known, and collects what is wrong, so that a person sees all of a file's problems at once.
//!
//! A getter whose value is wrong notes the problem and returns a harmless stand-in; nobody sees it,
//! because [`Source::finish`] then returns the problems.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Display;

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use crate::error::{FileError, Problem};

/// A file's text, where its keys stand, and what is wrong with it so far.
pub(crate) struct Source<'a> {
    file: &'a str,
    text: &'a str,
    lines: RefCell<BTreeMap<String, usize>>,
    problems: RefCell<Vec<Problem>>,
}

impl<'a> Source<'a> {
    pub(crate) fn new(text: &'a str, file: &'a str) -> Self {
        Self { file, text, lines: RefCell::default(), problems: RefCell::default() }
    }

    /// The text as a table of values with their spans.
    pub(crate) fn parse(&self) -> Result<Spanned<DeTable<'a>>, FileError> {
        DeTable::parse(self.text).map_err(|error| {
            let message = error.message().lines().collect::<Vec<_>>().join(", ");
            FileError::Invalid {
                problems: vec![Problem {
                    file: self.file.to_owned(),
                    line: error.span().map_or(1, |span| self.line(span.start)),
                    key: String::new(),
                    expected: "valid TOML".to_owned(),
                    found: format!("an error: {message}"),
                    advice: "mend the line; comments begin with #, texts stand in quotes"
                        .to_owned(),
                }],
            }
        })
    }

    /// The outermost section.
    pub(crate) fn root<'s>(&'s self, table: &'s DeTable<'a>) -> Section<'s> {
        Section {
            source: self,
            table: Some(table),
            path: String::new(),
            line: 1,
            known: RefCell::default(),
        }
    }

    fn line(&self, at: usize) -> usize {
        1 + self.text.as_bytes().iter().take(at).filter(|byte| **byte == b'\n').count()
    }

    /// Line of a key that was read, or of the nearest section around it that was.
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

    /// Whether that key stands in the file and was read.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.lines.borrow().contains_key(key)
    }

    /// Notes a problem with a key that was read before.
    pub(crate) fn problem(
        &self,
        key: &str,
        expected: impl Display,
        found: impl Display,
        advice: impl Display,
    ) {
        self.problem_on(self.line_of(key), key, expected, found, advice);
    }

    fn problem_on(
        &self,
        line: usize,
        key: &str,
        expected: impl Display,
        found: impl Display,
        advice: impl Display,
    ) {
        self.problems.borrow_mut().push(Problem {
            file: self.file.to_owned(),
            line,
            key: key.to_owned(),
            expected: expected.to_string(),
            found: found.to_string(),
            advice: advice.to_string(),
        });
    }

    /// Whether nothing is wrong so far.
    pub(crate) fn is_clean(&self) -> bool {
        self.problems.borrow().is_empty()
    }

    /// `Err` with everything that is wrong.
    pub(crate) fn finish(self) -> Result<(), FileError> {
        let mut problems = self.problems.into_inner();
        if problems.is_empty() {
            return Ok(());
        }
        problems.sort_by_key(|problem| problem.line);
        Err(FileError::Invalid { problems })
    }
}

/// Bounds of a number, with the words in which to say so.
#[derive(Clone, Copy)]
pub(crate) struct Bounds {
    least: f64,
    pub(crate) most: f64,
    advice: &'static str,
}

/// From `least` to `most`, both allowed; `advice` is what a person reads who is outside.
pub(crate) const fn bounds(least: f64, most: f64, advice: &'static str) -> Bounds {
    Bounds { least, most, advice }
}

/// A table of the file.
pub(crate) struct Section<'s> {
    source: &'s Source<'s>,
    table: Option<&'s DeTable<'s>>,
    path: String,
    line: usize,
    known: RefCell<Vec<String>>,
}

impl<'s> Section<'s> {
    /// The path of `key` within the file.
    pub(crate) fn path(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Whether the section stands in the file.
    pub(crate) fn exists(&self) -> bool {
        self.table.is_some()
    }

    /// Whether the key stands in the section.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.table.is_some_and(|table| table.contains_key(key))
    }

    /// All keys that stand in the section, in the order of their lines.
    pub(crate) fn keys(&self) -> Vec<String> {
        let Some(table) = self.table else { return Vec::new() };
        let mut keys: Vec<_> =
            table.iter().map(|(key, _)| (key.span().start, key.get_ref().to_string())).collect();
        keys.sort();
        keys.into_iter().map(|(_, key)| key).collect()
    }

    fn value(&self, key: &str) -> Option<&'s Spanned<DeValue<'s>>> {
        self.known.borrow_mut().push(key.to_owned());
        let (name, value) = self.table?.get_key_value(key)?;
        self.source.lines.borrow_mut().insert(self.path(key), self.source.line(name.span().start));
        Some(value)
    }

    fn required(&self, key: &str, expected: &str) -> Option<&'s Spanned<DeValue<'s>>> {
        let value = self.value(key);
        if value.is_none() {
            self.source.problem_on(self.line, &self.path(key), expected, "nothing", "add the key");
        }
        value
    }

    /// Notes a problem with one of the section's keys.
    pub(crate) fn problem(
        &self,
        key: &str,
        expected: impl Display,
        found: impl Display,
        advice: impl Display,
    ) {
        let name = self.table.and_then(|table| table.get_key_value(key)).map(|(name, _)| name);
        let line = name.map_or(self.line, |name| self.source.line(name.span().start));
        self.source.problem_on(line, &self.path(key), expected, found, advice);
    }

    /// A section within this one; empty where it does not stand in the file.
    pub(crate) fn section(&self, key: &str) -> Section<'s> {
        let value = self.value(key);
        self.section_of(key, value)
    }

    fn section_of(&self, key: &str, value: Option<&'s Spanned<DeValue<'s>>>) -> Section<'s> {
        let path = self.path(key);
        let line = value.map_or(self.line, |value| self.source.line(value.span().start));
        let table = value.and_then(|value| value.get_ref().as_table());
        if let (Some(value), None) = (value, table) {
            self.problem(
                key,
                "a table of keys",
                describe(value.get_ref()),
                "write it as [section] or { key = value }",
            );
        }
        self.source.lines.borrow_mut().entry(path.clone()).or_insert(line);
        Section { source: self.source, table, path, line, known: RefCell::default() }
    }

    /// The sections of a list (`[[key]]`).
    pub(crate) fn sections(&self, key: &str) -> Vec<Section<'s>> {
        let Some(value) = self.value(key) else { return Vec::new() };
        let Some(list) = value.get_ref().as_array() else {
            self.problem(
                key,
                "a list of tables",
                describe(value.get_ref()),
                format!("write each as [[{key}]]"),
            );
            return Vec::new();
        };
        list.iter()
            .enumerate()
            .map(|(index, item)| self.section_of(&format!("{key}.{index}"), Some(item)))
            .collect()
    }

    /// A number that must be there.
    pub(crate) fn number(&self, key: &str, bounds: Bounds) -> f64 {
        match self.required(key, "a number") {
            Some(value) => self.as_number(key, value.get_ref(), bounds).unwrap_or(bounds.least),
            None => bounds.least,
        }
    }

    /// A number that may be left out.
    pub(crate) fn number_or_none(&self, key: &str, bounds: Bounds) -> Option<f64> {
        self.value(key).and_then(|value| self.as_number(key, value.get_ref(), bounds))
    }

    /// A number with a default.
    pub(crate) fn number_or(&self, key: &str, default: f64, bounds: Bounds) -> f64 {
        self.number_or_none(key, bounds).unwrap_or(default)
    }

    /// A list of numbers, at least one.
    pub(crate) fn numbers(&self, key: &str, bounds: Bounds) -> Vec<f64> {
        let Some(value) = self.required(key, "a list of numbers") else { return Vec::new() };
        match value.get_ref().as_array() {
            Some(list) if !list.is_empty() => list
                .iter()
                .map(|item| self.as_number(key, item.get_ref(), bounds).unwrap_or(bounds.least))
                .collect(),
            _ => {
                self.problem(
                    key,
                    "a list of numbers, at least one",
                    describe(value.get_ref()),
                    "write it as [1.0, 2.0]",
                );
                Vec::new()
            }
        }
    }

    /// A list of lists of numbers that may be left out; `expected` says what they are.
    pub(crate) fn rows_or_none(
        &self,
        key: &str,
        expected: &str,
        bounds: Bounds,
    ) -> Option<Vec<Vec<f64>>> {
        let value = self.value(key)?;
        let lists =
            value.get_ref().as_array().map(|rows| rows.iter().map(|row| row.get_ref().as_array()));
        let Some(rows) =
            lists.and_then(|rows| rows.collect::<Option<Vec<_>>>()).filter(|rows| !rows.is_empty())
        else {
            self.problem(
                key,
                expected,
                describe(value.get_ref()),
                "write it as [[1.0, 2.0], [3.0, 4.0]]",
            );
            return None;
        };
        let numbers = |row: &&DeArray<'_>| -> Option<Vec<f64>> {
            row.iter().map(|item| self.as_number(key, item.get_ref(), bounds)).collect()
        };
        rows.iter().map(numbers).collect()
    }

    /// An entry that is either a bare number or a table of keys.
    pub(crate) fn number_or_section(&self, key: &str, bounds: Bounds) -> NumberOrSection<'s> {
        match self.value(key) {
            Some(value) if !value.get_ref().is_table() => NumberOrSection::Number(
                self.as_number(key, value.get_ref(), bounds).unwrap_or(bounds.least),
            ),
            value => NumberOrSection::Section(self.section_of(key, value)),
        }
    }

    fn as_number(&self, key: &str, value: &DeValue<'_>, bounds: Bounds) -> Option<f64> {
        let number = match value {
            DeValue::Float(float) => float.as_str().parse::<f64>().ok(),
            DeValue::Integer(integer) => {
                i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|i| i as f64)
            }
            _ => None,
        };
        let Some(number) = number else {
            self.problem(
                key,
                "a number",
                describe(value),
                "write it without quotes, in the unit that the key's name ends in",
            );
            return None;
        };
        if !number.is_finite() {
            self.problem(
                key,
                "a finite number",
                describe(value),
                "not-a-number and infinity have no meaning here",
            );
            return None;
        }
        if number < bounds.least || number > bounds.most {
            let expected = format!("a number from {} to {}", bounds.least, bounds.most);
            self.problem(key, expected, number, bounds.advice);
            return None;
        }
        Some(number)
    }

    /// A whole number that may be left out.
    pub(crate) fn whole_or_none(
        &self,
        key: &str,
        least: u64,
        most: u64,
        advice: &str,
    ) -> Option<u64> {
        let value = self.value(key)?.get_ref();
        let whole =
            value.as_integer().and_then(|i| i64::from_str_radix(i.as_str(), i.radix()).ok());
        match whole.and_then(|whole| u64::try_from(whole).ok()) {
            Some(whole) if (least..=most).contains(&whole) => Some(whole),
            _ => {
                let expected = format!("a whole number from {least} to {most}");
                self.problem(key, expected, describe(value), advice);
                None
            }
        }
    }

    /// A whole number with a default.
    pub(crate) fn whole_or(
        &self,
        key: &str,
        default: u64,
        least: u64,
        most: u64,
        advice: &str,
    ) -> u64 {
        self.whole_or_none(key, least, most, advice).unwrap_or(default)
    }

    /// A whole number that must be there.
    pub(crate) fn whole(&self, key: &str, least: u64, most: u64, advice: &str) -> u64 {
        if !self.has(key) {
            self.required(key, &format!("a whole number from {least} to {most}"));
        }
        self.whole_or(key, least, least, most, advice)
    }

    /// A text that must be there and not be empty.
    pub(crate) fn text(&self, key: &str) -> String {
        if !self.has(key) {
            self.required(key, "a text");
        }
        self.text_or_none(key).unwrap_or_default()
    }

    /// A text that may be left out, but not be empty.
    pub(crate) fn text_or_none(&self, key: &str) -> Option<String> {
        let value = self.value(key)?.get_ref();
        match value.as_str() {
            Some(text) if !text.trim().is_empty() => Some(text.to_owned()),
            _ => {
                self.problem(key, "a text", describe(value), "write it in quotes");
                None
            }
        }
    }

    /// One of a few words; `None` where it is left out or wrong.
    pub(crate) fn word_or_none<T: Copy>(&self, key: &str, words: &[(&str, T)]) -> Option<T> {
        let value = self.value(key)?.get_ref();
        let found = value.as_str().and_then(|text| words.iter().find(|(word, _)| *word == text));
        if found.is_none() {
            let names: Vec<_> = words.iter().map(|(word, _)| *word).collect();
            let advice = value.as_str().and_then(|text| nearest(text, names.iter().copied()));
            let advice = advice.map(|word| format!("did you mean \"{word}\"?")).unwrap_or_default();
            let names: Vec<_> = names.iter().map(|name| format!("\"{name}\"")).collect();
            self.problem(key, format!("one of {}", names.join(", ")), describe(value), advice);
        }
        found.map(|(_, value)| *value)
    }

    /// One of a few words that must be there; `None` where it is missing or wrong, which is noted.
    pub(crate) fn word<T: Copy>(&self, key: &str, words: &[(&str, T)]) -> Option<T> {
        if !self.has(key) {
            let names: Vec<_> = words.iter().map(|(word, _)| format!("\"{word}\"")).collect();
            self.required(key, &format!("one of {}", names.join(", ")));
        }
        self.word_or_none(key, words)
    }

    /// Takes a key for known that is read only where it stands.
    pub(crate) fn known(&self, key: &str) {
        self.known.borrow_mut().push(key.to_owned());
    }

    /// Takes every key for known, where nobody can say which are.
    pub(crate) fn know_all(&self) {
        self.known.borrow_mut().extend(self.keys());
    }

    /// True or false, with a default.
    pub(crate) fn flag_or(&self, key: &str, default: bool) -> bool {
        let Some(value) = self.value(key) else { return default };
        value.get_ref().as_bool().unwrap_or_else(|| {
            self.problem(
                key,
                "true or false",
                describe(value.get_ref()),
                "write it without quotes",
            );
            default
        })
    }

    /// Notes a key that belongs to the other unit: `instead` is what to write.
    pub(crate) fn misplaced(&self, key: &str, expected: &str, advice: &str) {
        if self.value(key).is_some() {
            self.problem(key, expected, "this key", advice);
        }
    }

    /// Says which keys nobody asked for. To be called when all keys were read.
    pub(crate) fn finish(self) {
        let known = self.known.borrow();
        for key in self.keys() {
            if known.contains(&key) {
                continue;
            }
            let span = self
                .table
                .and_then(|table| table.get_key_value(key.as_str()))
                .map(|(name, _)| name.span());
            let line = span.map_or(self.line, |span| self.source.line(span.start));
            let mut names: Vec<_> = known.iter().map(String::as_str).collect();
            names.sort_unstable();
            names.dedup();
            let advice = match nearest(&key, names.iter().copied()) {
                Some(name) => format!("did you mean `{name}`?"),
                None => "take it out".to_owned(),
            };
            let expected = format!("one of {}", names.join(", "));
            self.source.problem_on(line, &self.path(&key), expected, "an unknown key", advice);
        }
    }
}

/// A bare number, or a table of keys.
pub(crate) enum NumberOrSection<'s> {
    Number(f64),
    Section(Section<'s>),
}

/// The name that a person may have meant.
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
