//! Typed getters of a section.

use toml::de::{DeArray, DeValue};

use super::{Bounds, Section, describe, nearest};

/// A number with its bounds, as the pages have it.
fn range(bounds: Bounds) -> String {
    if bounds.most == f64::MAX && bounds.least == f64::MIN {
        return "number".to_owned();
    }
    if bounds.most == f64::MAX {
        return format!("number, at least {}", bounds.least);
    }
    format!("number, {} to {}", bounds.least, bounds.most)
}

fn choices<T>(words: &[(&str, T)]) -> String {
    words.iter().map(|(word, _)| format!("`\"{word}\"`")).collect::<Vec<_>>().join(", ")
}

/// The words in quotes, for messages.
fn quoted<T>(words: &[(&str, T)]) -> String {
    words.iter().map(|(word, _)| format!("\"{word}\"")).collect::<Vec<_>>().join(", ")
}

impl Section<'_> {
    /// A number that must be there.
    pub(crate) fn number(&self, key: &str, bounds: Bounds) -> f64 {
        self.note(key, range(bounds), "required");
        match self.required(key, "a number") {
            Some(value) => self.as_number(key, value.get_ref(), bounds).unwrap_or(bounds.least),
            None => bounds.least,
        }
    }

    /// A number that may be left out.
    pub(crate) fn number_or_none(&self, key: &str, bounds: Bounds) -> Option<f64> {
        self.note(key, range(bounds), "optional");
        self.value(key).and_then(|value| self.as_number(key, value.get_ref(), bounds))
    }

    /// A number with a default.
    pub(crate) fn number_or(&self, key: &str, default: f64, bounds: Bounds) -> f64 {
        self.note(key, range(bounds), default);
        self.number_or_none(key, bounds).unwrap_or(default)
    }

    /// A list of numbers, at least one.
    pub(crate) fn numbers(&self, key: &str, bounds: Bounds) -> Vec<f64> {
        self.note(key, format_args!("list, each a {}", range(bounds)), "required");
        self.required(key, "a list of numbers");
        self.numbers_or_none(key, bounds).unwrap_or_default()
    }

    /// A list of numbers, at least one, that may be left out.
    pub(crate) fn numbers_or_none(&self, key: &str, bounds: Bounds) -> Option<Vec<f64>> {
        self.note(key, format_args!("list, each a {}", range(bounds)), "optional");
        let value = self.value(key)?;
        let numbers = match value.get_ref().as_array() {
            Some(list) if !list.is_empty() => list
                .iter()
                .map(|item| self.as_number(key, item.get_ref(), bounds).unwrap_or(bounds.least))
                .collect(),
            _ => {
                let found = describe(value.get_ref());
                let advice = "write it as [1.0, 2.0]";
                self.problem(key, "a list of numbers, at least one", found, advice);
                Vec::new()
            }
        };
        Some(numbers)
    }

    /// A list of lists of numbers that may be left out; `expected` says what they are.
    pub(crate) fn rows_or_none(
        &self,
        key: &str,
        expected: &str,
        bounds: Bounds,
    ) -> Option<Vec<Vec<f64>>> {
        self.note(key, format_args!("list of rows, each a {}", range(bounds)), "optional");
        let value = self.value(key)?;
        let lists =
            value.get_ref().as_array().map(|rows| rows.iter().map(|row| row.get_ref().as_array()));
        let Some(rows) =
            lists.and_then(|rows| rows.collect::<Option<Vec<_>>>()).filter(|rows| !rows.is_empty())
        else {
            let advice = "write it as [[1.0, 2.0], [3.0, 4.0]]";
            return self.refuse(key, expected, describe(value.get_ref()), advice);
        };
        let numbers = |row: &&DeArray<'_>| -> Option<Vec<f64>> {
            row.iter().map(|item| self.as_number(key, item.get_ref(), bounds)).collect()
        };
        rows.iter().map(numbers).collect()
    }

    /// Whether the key holds a table of keys.
    pub(crate) fn holds_section(&self, key: &str) -> bool {
        self.value(key).is_some_and(|value| value.get_ref().is_table())
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
            let advice = "write it without quotes, in the unit that the key's name ends in";
            return self.refuse(key, "a number", describe(value), advice);
        };
        if !number.is_finite() {
            let advice = "not-a-number and infinity have no meaning here";
            return self.refuse(key, "a finite number", describe(value), advice);
        }
        if number < bounds.least || number > bounds.most {
            let expected = format!("a number from {} to {}", bounds.least, bounds.most);
            return self.refuse(key, expected, number, bounds.advice);
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
        self.note(key, format_args!("whole number, {least} to {most}"), "optional");
        let value = self.value(key)?.get_ref();
        let whole =
            value.as_integer().and_then(|i| i64::from_str_radix(i.as_str(), i.radix()).ok());
        match whole.and_then(|whole| u64::try_from(whole).ok()) {
            Some(whole) if (least..=most).contains(&whole) => Some(whole),
            _ => {
                let expected = format!("a whole number from {least} to {most}");
                self.refuse(key, expected, describe(value), advice)
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
        self.note(key, format_args!("whole number, {least} to {most}"), default);
        self.whole_or_none(key, least, most, advice).unwrap_or(default)
    }

    /// A whole number that must be there.
    pub(crate) fn whole(&self, key: &str, least: u64, most: u64, advice: &str) -> u64 {
        self.note(key, format_args!("whole number, {least} to {most}"), "required");
        self.required(key, &format!("a whole number from {least} to {most}"));
        self.whole_or_none(key, least, most, advice).unwrap_or(least)
    }

    /// A text that must be there and not be empty.
    pub(crate) fn text(&self, key: &str) -> String {
        self.note(key, "text", "required");
        self.required(key, "a text");
        self.text_or_none(key).unwrap_or_default()
    }

    /// A name that is safe as that of a file, and may be left out.
    pub(crate) fn file_name_or_none(&self, key: &str) -> Option<String> {
        let name = self.text_or_none(key)?;
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
        if name.len() <= 64 && name.chars().all(allowed) {
            return Some(name);
        }
        let advice =
            "it names a file in the folder of what was learnt, without folder and extension";
        self.refuse(key, "1 to 64 of a-z, 0-9, - and _", format!("\"{name}\""), advice)
    }

    /// A text that may be left out, but not be empty.
    pub(crate) fn text_or_none(&self, key: &str) -> Option<String> {
        self.note(key, "text", "optional");
        let value = self.value(key)?.get_ref();
        match value.as_str() {
            Some(text) if !text.trim().is_empty() => Some(text.to_owned()),
            _ => self.refuse(key, "a text", describe(value), "write it in quotes"),
        }
    }

    /// One of a few words; `None` where it is left out or wrong.
    pub(crate) fn word_or_none<T: Copy>(&self, key: &str, words: &[(&str, T)]) -> Option<T> {
        self.note(key, choices(words), "optional");
        let value = self.value(key)?.get_ref();
        let found = value.as_str().and_then(|text| words.iter().find(|(word, _)| *word == text));
        if found.is_none() {
            let names = words.iter().map(|(word, _)| *word);
            let advice = value.as_str().and_then(|text| nearest(text, names));
            let advice = advice.map(|word| format!("did you mean \"{word}\"?")).unwrap_or_default();
            self.problem(key, format!("one of {}", quoted(words)), describe(value), advice);
        }
        found.map(|(_, value)| *value)
    }

    /// One of a few words, with a default.
    pub(crate) fn word_or<T: Copy + PartialEq>(
        &self,
        key: &str,
        words: &[(&str, T)],
        default: T,
    ) -> T {
        let name = words.iter().find(|(_, value)| *value == default).map_or("", |(word, _)| word);
        self.note(key, choices(words), format_args!("`\"{name}\"`"));
        self.word_or_none(key, words).unwrap_or(default)
    }

    /// One of a few words that must be there; `None` where it is missing or wrong, which is
    /// reported.
    pub(crate) fn word<T: Copy>(&self, key: &str, words: &[(&str, T)]) -> Option<T> {
        self.note(key, choices(words), "required");
        self.required(key, &format!("one of {}", quoted(words)));
        self.word_or_none(key, words)
    }

    /// True or false, with a default.
    pub(crate) fn flag_or(&self, key: &str, default: bool) -> bool {
        self.note(key, "true or false", default);
        let Some(value) = self.value(key) else { return default };
        value.get_ref().as_bool().unwrap_or_else(|| {
            let advice = "write it without quotes";
            self.problem(key, "true or false", describe(value.get_ref()), advice);
            default
        })
    }
}
