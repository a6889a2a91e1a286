//! Where the pulses of the scanner come from in one run of a protocol.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Most volumes without a pulse, and most spurious pulses, of an emulated scanner.
pub const EMULATED_FAULTS: usize = 100;
/// What the text of an emulated scanner looks like.
const FORM: &str = "TR in s, then what is wrong with its pulses, each with a comma before it: \
                    jitter=S, missing=VOLUME, spurious=S, seed=N";

/// Where the pulses of the scanner come from in one run of a protocol.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum PulseSource {
    /// The rig's trigger line.
    #[default]
    Line,
    /// The key 5, as many scanners' trigger boxes type it: each is sent with
    /// [`crate::ExperimentRequest::Pulse`].
    Key,
    /// An emulated scanner.
    Emulated(EmulatedScanner),
}

/// A scanner that the experiment process emulates: its first pulse comes 1 s after the protocol
/// began to wait for it. In text `2`, or with faults `2,jitter=0.001,missing=3,spurious=4.5`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EmulatedScanner {
    /// Repetition time TR (s).
    pub repetition_s: f64,
    /// Standard deviation of the start of a pulse (s); it stays within three of them.
    pub jitter_s: f64,
    /// Volumes without a pulse, from 0.
    pub missing: Vec<u64>,
    /// Starts of pulses that belong to no volume, from the first pulse (s).
    pub spurious_s: Vec<f64>,
    /// Seed of the jitter: the same seed gives the same.
    pub seed: u64,
}

/// A text that names no source of pulses.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("expected {expected}, found \"{found}\"")]
pub struct PulseSourceError {
    /// What was expected.
    pub expected: String,
    /// What was found.
    pub found: String,
}

impl PulseSourceError {
    fn new(expected: impl Into<String>, found: &str) -> Self {
        Self { expected: expected.into(), found: found.to_owned() }
    }
}

impl FromStr for EmulatedScanner {
    type Err = PulseSourceError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut parts = text.split(',').map(str::trim);
        let first = parts.next().unwrap_or("");
        let repetition_s = seconds(first).ok_or_else(|| PulseSourceError::new(FORM, text))?;
        let mut scanner = Self { repetition_s, ..Self::default() };
        for part in parts {
            let (key, value) =
                part.split_once('=').ok_or_else(|| PulseSourceError::new(FORM, part))?;
            let whole = || value.parse::<u64>().ok();
            let wrong = |expected: &str| PulseSourceError::new(format!("{key}={expected}"), part);
            match key {
                "jitter" => {
                    let jitter_s = seconds(value).ok_or_else(|| wrong("a time in s"))?;
                    scanner.jitter_s = jitter_s;
                }
                "missing" => {
                    let volume = whole().ok_or_else(|| wrong("the number of a volume, from 0"))?;
                    scanner.missing.push(volume);
                }
                "spurious" => {
                    let after_s =
                        seconds(value).ok_or_else(|| wrong("a time in s, from the first pulse"))?;
                    scanner.spurious_s.push(after_s);
                }
                "seed" => scanner.seed = whole().ok_or_else(|| wrong("a whole number"))?,
                _ => return Err(PulseSourceError::new(FORM, part)),
            }
        }
        for (what, found) in
            [("missing", scanner.missing.len()), ("spurious", scanner.spurious_s.len())]
        {
            if found > EMULATED_FAULTS {
                let expected = format!("{what}= at most {EMULATED_FAULTS} times");
                return Err(PulseSourceError::new(expected, &found.to_string()));
            }
        }
        Ok(scanner)
    }
}

/// A time that is finite and not negative (s).
fn seconds(text: &str) -> Option<f64> {
    text.parse::<f64>().ok().filter(|time_s| time_s.is_finite() && *time_s >= 0.0)
}

impl fmt::Display for EmulatedScanner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.repetition_s)?;
        if self.jitter_s != 0.0 {
            write!(f, ",jitter={}", self.jitter_s)?;
        }
        for volume in &self.missing {
            write!(f, ",missing={volume}")?;
        }
        for after_s in &self.spurious_s {
            write!(f, ",spurious={after_s}")?;
        }
        if self.seed != 0 {
            write!(f, ",seed={}", self.seed)?;
        }
        Ok(())
    }
}

impl FromStr for PulseSource {
    type Err = PulseSourceError;

    /// `line`, `key`, or an emulated scanner.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.trim() {
            "line" => Ok(Self::Line),
            "key" => Ok(Self::Key),
            other => other.parse().map(Self::Emulated),
        }
    }
}

impl fmt::Display for PulseSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line => f.write_str("line"),
            Self::Key => f.write_str("key"),
            Self::Emulated(scanner) => scanner.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn a_source_is_read_back_as_written() {
        for text in ["line", "key", "2", "0.8,jitter=0.001,missing=3,missing=7,spurious=4.5,seed=9"]
        {
            let source: PulseSource = text.parse().unwrap();
            assert_eq!(source.to_string(), text);
        }
        let source: PulseSource = " 2 , missing=1 ".parse().unwrap();
        let expected =
            EmulatedScanner { repetition_s: 2.0, missing: vec![1], ..EmulatedScanner::default() };
        assert_eq!(source, PulseSource::Emulated(expected));
    }

    #[test]
    fn what_is_wrong_is_told() {
        for (text, part) in [
            ("", "TR in s"),
            ("keys", "TR in s"),
            ("-1", "TR in s"),
            ("inf", "TR in s"),
            ("2,jitter", "jitter=S"),
            ("2,jitter=fast", "jitter=a time in s"),
            ("2,missing=1.5", "missing=the number of a volume"),
            ("2,spurious=NaN", "spurious=a time"),
            ("2,delay=1", "found \"delay=1\""),
        ] {
            let error = text.parse::<PulseSource>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        let many = format!("2{}", ",missing=1".repeat(EMULATED_FAULTS + 1));
        let error = many.parse::<PulseSource>().unwrap_err().to_string();
        assert!(error.contains("at most 100 times"), "{error}");
    }
}
