//! A measured record, column by column, as identification and replay use it.
//!
//! Read from a CSV file ([`from_csv`]) or from a recording of farreach's ([`from_recording`]): SI
//! units, one value per sampling instant, uniform in time. Bad data are an error that names file,
//! row and column; a record is never patched silently. What the data alone cannot decide (a channel
//! that never changes, one that stays at its extreme) is a [`Finding`]: the record is usable, and a
//! person should check it.

mod csv_file;
mod findings;
mod grid;
mod mapping;
mod resample;
mod samples;
mod topics;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

pub use csv_file::{from_csv, from_csv_text, write_csv};
pub use findings::{Finding, FindingKind};
pub use mapping::{Mapping, MappingError};
pub use samples::{ColumnNames, SampleColumns, from_mcap, from_recording};
pub use topics::from_topics;

use crate::mcap_read::ReadError;

/// Name of the time column.
pub const TIME: &str = "t_s";

/// A measured record.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// File name, for reports.
    pub name: String,
    /// Sampling instants, uniform within the tolerance requested (s).
    pub time_s: Vec<f64>,
    /// Values by name of the column, each as long as the time; the unit is in the name.
    pub columns: BTreeMap<String, Vec<f64>>,
    /// Mean time between two samples (s).
    pub sampling_s: f64,
    /// What a person should check.
    pub findings: Vec<Finding>,
}

impl Record {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }
    /// Whether it has no samples (a record that was read is never empty).
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }
    /// One column.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.get(name).map(Vec::as_slice)
    }
    /// One column that is required.
    ///
    /// # Errors
    /// [`Problem::MissingColumn`].
    pub fn need(&self, name: &str) -> Result<&[f64], RecordError> {
        self.column(name).ok_or_else(|| {
            let found = self.columns.keys().cloned().collect::<Vec<_>>().join(", ");
            Problem::MissingColumn { column: name.to_owned(), found }.of(Path::new(&self.name))
        })
    }
}

/// What to do where samples are missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Gaps {
    /// Refuse the record.
    #[default]
    Refuse,
    /// Keep the longest run without a gap and report the rest as a finding.
    LongestRun,
}

/// Requirements on a record.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Columns required (the time always is).
    pub required: Vec<String>,
    /// What to do about gaps.
    pub gaps: Gaps,
    /// Largest deviation of a time step from the median one, as a fraction of it.
    pub time_tolerance: f64,
    /// Fewest rows.
    pub rows_min: usize,
    /// Sources of columns that the file names differently (CSV files and [`from_topics`]).
    pub mapping: Vec<Mapping>,
    /// Rate to which the rows are resampled by linear interpolation (Hz); `None` for no resampling.
    pub resample_hz: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            required: Vec::new(),
            gaps: Gaps::Refuse,
            time_tolerance: 0.02,
            rows_min: 10,
            mapping: Vec::new(),
            resample_hz: None,
        }
    }
}

impl Options {
    /// Requires these columns.
    #[must_use]
    pub fn requiring(mut self, columns: &[&str]) -> Self {
        self.required.extend(columns.iter().map(|&name| name.to_owned()));
        self
    }
    /// See [`Gaps`].
    #[must_use]
    pub fn gaps(mut self, gaps: Gaps) -> Self {
        self.gaps = gaps;
        self
    }
}

/// A record that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] ReadError),
    /// What the file holds cannot be used.
    #[error("{file}: {problem}")]
    Unusable {
        /// The file.
        file: PathBuf,
        /// Why.
        problem: Problem,
    },
}

/// Why a record cannot be used. Rows are lines of a CSV file (the header is line 1), or samples of
/// a recording, from 1.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The file cannot be read.
    #[error("cannot read: {0}")]
    Io(#[from] io::Error),
    /// Not a table.
    #[error("row {row}: not a CSV table: {what}")]
    Table {
        /// Row.
        row: u64,
        /// The reader's error.
        what: String,
    },
    /// The first line is not a header.
    #[error(
        "row 1: expected a header with the columns' names, found {found}; put a line such as \
         `t_s,motor_v,master_rad` first"
    )]
    NoHeader {
        /// What was found.
        found: String,
    },
    /// Two columns have one name.
    #[error(
        "row 1: column `{column}` occurs twice (columns {first} and {second}); rename or remove \
         one"
    )]
    DuplicateColumn {
        /// Its name.
        column: String,
        /// First place, from 1.
        first: usize,
        /// Second place, from 1.
        second: usize,
    },
    /// A required column is missing.
    #[error("column `{column}` is missing; found {found}")]
    MissingColumn {
        /// Its name.
        column: String,
        /// What was found.
        found: String,
    },
    /// A cell that is not a finite number.
    #[error("row {row}, column `{column}`: expected a finite number, found {found}")]
    Cell {
        /// Row.
        row: u64,
        /// Column.
        column: String,
        /// What was found.
        found: String,
    },
    /// Time does not increase.
    #[error(
        "row {row}, column `t_s`: expected a time after {before} s, found {after} s; sort the rows \
         or remove the repeated ones"
    )]
    TimeBackwards {
        /// Row.
        row: u64,
        /// Time in the row before (s).
        before: f64,
        /// Time in this row (s).
        after: f64,
    },
    /// Samples are missing.
    #[error(
        "row {row}, column `t_s`: {missing} samples are missing between {before} s and {after} s \
         (sampling {sampling_s} s; {gaps} such gaps); cut the record there, or resample it where \
         holes are short"
    )]
    Gap {
        /// Row after the first gap.
        row: u64,
        /// Time before it (s).
        before: f64,
        /// Time after it (s).
        after: f64,
        /// Samples missing there.
        missing: u64,
        /// Sampling time (s).
        sampling_s: f64,
        /// Number of gaps in the record.
        gaps: usize,
    },
    /// Sampling is not uniform.
    #[error(
        "row {row}, column `t_s`: expected steps of {expected_s} s within {tolerance_percent} %, \
         found {found_s} s; resample the record uniformly"
    )]
    NotUniform {
        /// Row.
        row: u64,
        /// Median step (s).
        expected_s: f64,
        /// Step found (s).
        found_s: f64,
        /// Tolerance (%).
        tolerance_percent: f64,
    },
    /// A mapped column cannot be read from its source.
    #[error("column mapped by {mapping}: {what}")]
    Mapping {
        /// The mapping as given.
        mapping: String,
        /// What is wrong.
        what: String,
    },
    /// Resampling to a rate that would invent rows, or drop most of them.
    #[error(
        "expected a rate between {least:.3} and {most:.3} Hz (rows come at {own:.3} Hz), found \
         {found} Hz"
    )]
    Rate {
        /// Rate requested (Hz).
        found: f64,
        /// Least (Hz).
        least: f64,
        /// Greatest (Hz).
        most: f64,
        /// Rate of the rows themselves (Hz).
        own: f64,
    },
    /// Not enough rows.
    #[error("expected at least {expected} rows, found {found}")]
    TooFewRows {
        /// Fewest.
        expected: usize,
        /// What was found.
        found: usize,
    },
    /// The recording has no such axis, or none of its channels.
    #[error("axis {axis}: {what}")]
    Axis {
        /// Axis, from 0.
        axis: usize,
        /// What is wrong.
        what: String,
    },
}

impl Problem {
    /// The error that names the file.
    fn of(self, file: &Path) -> RecordError {
        RecordError::Unusable { file: file.to_owned(), problem: self }
    }
}

/// Columns as read, not checked yet.
struct Draft {
    time_s: Vec<f64>,
    /// row of each sample, for messages
    rows: Vec<u64>,
    columns: BTreeMap<String, Vec<f64>>,
    findings: Vec<Finding>,
}

impl Draft {
    fn checked(mut self, file: &Path, options: &Options) -> Result<Record, Problem> {
        for name in &options.required {
            if !self.columns.contains_key(name) {
                let found = if self.columns.is_empty() {
                    "no other column than the time".to_owned()
                } else {
                    self.columns.keys().cloned().collect::<Vec<_>>().join(", ")
                };
                return Err(Problem::MissingColumn { column: name.clone(), found });
            }
        }
        for (name, values) in std::iter::once((TIME, &self.time_s))
            .chain(self.columns.iter().map(|(n, v)| (n.as_str(), v)))
        {
            if let Some(at) = values.iter().position(|value| !value.is_finite()) {
                return Err(Problem::Cell {
                    row: self.rows.get(at).copied().unwrap_or(0),
                    column: name.to_owned(),
                    found: values[at].to_string(),
                });
            }
        }
        let enough = |found| match found < options.rows_min.max(2) {
            true => Err(Problem::TooFewRows { expected: options.rows_min, found }),
            false => Ok(()),
        };
        enough(self.time_s.len())?;
        let (kept, sampling_s, cut) = grid::uniform(&self.time_s, &self.rows, options)?;
        self.findings.extend(cut);
        enough(kept.len())?;
        let first_row = self.rows.get(kept.start).copied().unwrap_or(0);
        let cut = |values: Vec<f64>| {
            if kept.len() == values.len() { values } else { values[kept.clone()].to_vec() }
        };
        let time_s = cut(self.time_s);
        let columns: BTreeMap<String, Vec<f64>> =
            self.columns.into_iter().map(|(name, values)| (name, cut(values))).collect();
        for (name, values) in &columns {
            self.findings.extend(findings::dead_or_saturated(name, values, first_row));
        }
        Ok(Record {
            name: file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned(),
            time_s,
            columns,
            sampling_s,
            findings: self.findings,
        })
    }
}
