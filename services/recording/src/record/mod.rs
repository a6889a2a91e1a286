//! A measured record, column by column, as identification and replay use it.
//!
//! Read from a CSV file ([`from_csv`]) or from a recording of farreach's ([`from_recording`]): SI
//! units, one value per sampling instant, uniform in time. Bad data are an error that names file,
//! row and column; a record is never patched silently. What the data alone cannot decide (a channel
//! that never changes, one that stays at its extreme, an encoder that jumps) is a [`Finding`]: the
//! record is usable, and a person should check it.

mod csv_file;
mod findings;
mod grid;
mod jumps;
mod mapping;
mod resample;
mod samples;
mod stretches;
mod topics;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

pub use csv_file::{from_csv, from_csv_text, write_csv};
pub use findings::{Finding, FindingKind};
pub use jumps::{Jump, jumps};
pub use mapping::{Mapping, MappingError};
pub use samples::{ColumnNames, SampleColumns, from_mcap, from_recording, table_from_recording};
pub use topics::from_topics;

use crate::column::Column;
use crate::mcap_read::ReadError;

/// Name of the time column.
pub const TIME: &str = "t_s";

/// Name of a column in a record of several axes: that of the axis, a dot, and that which the column
/// has in a record of one axis.
pub fn column_of(axis: &str, column: &str) -> String {
    format!("{axis}.{column}")
}

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
    /// [`RecordError::Unusable`] where the record has no such column.
    pub fn need(&self, name: &str) -> Result<&[f64], RecordError> {
        self.column(name).ok_or_else(|| {
            let found = self.columns.keys().cloned().collect::<Vec<_>>().join(", ");
            Problem::missing_column(name, &found).of(Path::new(&self.name))
        })
    }
}

/// A record whose columns may be on disk: what an hour of samples is written from.
#[derive(Debug)]
pub struct Table {
    name: String,
    time_s: Column,
    columns: BTreeMap<String, Column>,
    sampling_s: f64,
    /// What a person should check.
    pub findings: Vec<Finding>,
}

impl Table {
    /// The columns by name: the time first, then the others in the order of their names.
    pub fn columns(&self) -> impl Iterator<Item = (&str, &Column)> {
        let columns = self.columns.iter().map(|(name, values)| (name.as_str(), values));
        std::iter::once((TIME, &self.time_s)).chain(columns)
    }

    /// All of it in memory.
    fn into_record(self) -> Result<Record, Problem> {
        let Self { name, time_s, columns, sampling_s, findings } = self;
        let columns: io::Result<_> =
            columns.into_iter().map(|(name, column)| Ok((name, column.into_vec()?))).collect();
        Ok(Record { name, time_s: time_s.into_vec()?, columns: columns?, sampling_s, findings })
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
    /// Whether rows that are not uniform within [`Options::time_tolerance`] are resampled to their
    /// median step, with a finding, where no more than two rows in a row are missing. Longer gaps
    /// stay an error.
    pub even_out: bool,
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
            even_out: false,
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
        /// Why, with row and column.
        problem: String,
    },
}

/// Why a record cannot be used, in words. Rows are lines of a CSV file (the header is line 1), or
/// samples of a recording, from 1.
#[derive(Debug)]
struct Problem(String);

impl Problem {
    /// The error that names the file.
    fn of(self, file: &Path) -> RecordError {
        RecordError::Unusable { file: file.to_owned(), problem: self.0 }
    }

    fn missing_column(column: &str, found: &str) -> Self {
        Self(format!("column `{column}` is missing; found {found}"))
    }

    fn too_few_rows(expected: usize, found: usize) -> Self {
        Self(format!("expected at least {expected} rows, found {found}"))
    }

    fn cell(row: u64, column: &str, found: &str) -> Self {
        Self(format!("row {row}, column `{column}`: expected a finite number, found {found}"))
    }

    /// Times in s.
    fn time_backwards(row: u64, before: f64, after: f64) -> Self {
        Self(format!(
            "row {row}, column `t_s`: expected a time after {before} s, found {after} s; sort the \
             rows or remove the repeated ones"
        ))
    }
}

impl From<io::Error> for Problem {
    fn from(error: io::Error) -> Self {
        Self(format!("its columns cannot be kept in a temporary file: {error}"))
    }
}

/// Columns as read, not checked yet.
struct Draft {
    time_s: Column,
    /// row of each sample, for messages
    rows: Column,
    columns: BTreeMap<String, Column>,
    findings: Vec<Finding>,
}

impl Draft {
    /// Columns in memory, with the row of each sample.
    fn in_memory(
        time_s: Vec<f64>,
        rows: impl IntoIterator<Item = u64>,
        columns: impl IntoIterator<Item = (String, Vec<f64>)>,
    ) -> Self {
        let rows: Vec<f64> = rows.into_iter().map(|row| row as f64).collect();
        Self {
            time_s: time_s.into(),
            rows: rows.into(),
            columns: columns.into_iter().map(|(name, values)| (name, values.into())).collect(),
            findings: Vec::new(),
        }
    }

    /// The number of a row.
    fn row(&self, at: usize) -> u64 {
        self.rows.cursor().at(at).map_or(0, |row| row as u64)
    }

    /// The first value that is no number: its place, column and value.
    fn not_finite(&self) -> io::Result<Option<(usize, &str, f64)>> {
        let columns = self.columns.iter().map(|(name, values)| (name.as_str(), values));
        for (name, values) in std::iter::once((TIME, &self.time_s)).chain(columns) {
            let mut values = values.cursor();
            for at in 0..values.len() {
                let value = values.at(at)?;
                if !value.is_finite() {
                    return Ok(Some((at, name, value)));
                }
            }
        }
        Ok(None)
    }

    fn checked(mut self, file: &Path, options: &Options) -> Result<Table, Problem> {
        for name in &options.required {
            if !self.columns.contains_key(name) {
                let found = if self.columns.is_empty() {
                    "no other column than the time".to_owned()
                } else {
                    self.columns.keys().cloned().collect::<Vec<_>>().join(", ")
                };
                return Err(Problem::missing_column(name, &found));
            }
        }
        if let Some((at, name, value)) = self.not_finite()? {
            return Err(Problem::cell(self.row(at), name, &value.to_string()));
        }
        let enough = |found| match found < options.rows_min.max(2) {
            true => Err(Problem::too_few_rows(options.rows_min, found)),
            false => Ok(()),
        };
        enough(self.time_s.len())?;
        let (kept, sampling_s, cut) =
            grid::uniform(self.time_s.cursor(), self.rows.cursor(), options)?;
        self.findings.extend(cut);
        enough(kept.len())?;
        let first_row = self.row(kept.start);
        self.time_s.cut(kept.clone());
        for (name, values) in &mut self.columns {
            values.cut(kept.clone());
            let found = findings::dead_or_saturated(name, &mut values.cursor(), first_row)?;
            self.findings.extend(found);
            self.findings.extend(jumps::jumping(name, values.cursor(), first_row)?);
        }
        Ok(Table {
            name: file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned(),
            time_s: self.time_s,
            columns: self.columns,
            sampling_s,
            findings: self.findings,
        })
    }
}
