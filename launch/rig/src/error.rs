//! Errors in a file: where, what was expected, what was found, what to do.

use std::fmt;
use std::path::PathBuf;

/// A rig file or a protocol that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The file could not be read at all.
    #[error(
        "{path}: cannot be read: {source}; give the path of a file that exists and that you may \
         read"
    )]
    Unreadable {
        /// Path as it was given.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// No shipped file has this name.
    #[error(
        "no {kind} \"{found}\" comes with farreach; expected one of {}, or the path of a file \
         (with its .toml)",
        known.join(", ")
    )]
    NotShipped {
        /// `rig` or `protocol`.
        kind: &'static str,
        /// Name that was asked for.
        found: String,
        /// Names of the shipped files.
        known: Vec<&'static str>,
    },
    /// The file was read, but is not valid: every problem found, in the order of lines.
    #[error("{}", Lines(problems))]
    Invalid {
        /// At least one.
        problems: Vec<Problem>,
    },
}

impl FileError {
    /// A model that lacks what the caller needs: of another kind, or with a value out of range.
    pub(crate) fn wrong_model(file: &str, key: &str, expected: String, found: String) -> Self {
        Problem::new(file, 1, key, expected, found, "use a rig file with that model").into()
    }

    /// The problems; empty where the file could not be read.
    pub fn problems(&self) -> &[Problem] {
        match self {
            Self::Unreadable { .. } | Self::NotShipped { .. } => &[],
            Self::Invalid { problems } => problems,
        }
    }
}

/// A rig file that cannot be used.
pub type RigError = FileError;

/// A protocol that cannot be used.
pub type ProtocolError = FileError;

struct Lines<'a>(&'a [Problem]);

impl fmt::Display for Lines<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, problem) in self.0.iter().enumerate() {
            if index > 0 {
                f.write_str("\n")?;
            }
            problem.fmt(f)?;
        }
        Ok(())
    }
}

impl From<Problem> for FileError {
    fn from(problem: Problem) -> Self {
        Self::Invalid { problems: vec![problem] }
    }
}

/// One problem in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Name of the file, as it was given.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Key with its path (`axes.0.limits.volts_max`); empty where the text is not valid TOML.
    pub key: String,
    /// What was expected.
    pub expected: String,
    /// What was found.
    pub found: String,
    /// What to do; may be empty.
    pub advice: String,
}

impl Problem {
    pub(crate) fn new(
        file: &str,
        line: usize,
        key: &str,
        expected: impl fmt::Display,
        found: impl fmt::Display,
        advice: impl fmt::Display,
    ) -> Self {
        Self {
            file: file.to_owned(),
            line,
            key: key.to_owned(),
            expected: expected.to_string(),
            found: found.to_string(),
            advice: advice.to_string(),
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: ", self.file, self.line)?;
        if !self.key.is_empty() {
            write!(f, "{}: ", self.key)?;
        }
        write!(f, "expected {}, found {}", self.expected, self.found)?;
        if !self.advice.is_empty() {
            write!(f, "; {}", self.advice)?;
        }
        Ok(())
    }
}
