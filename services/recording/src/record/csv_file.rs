//! Records from and to CSV files.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;

use super::{Draft, Mapping, Options, Problem, Record, RecordError, TIME, Table};
use crate::column::Cursor;

/// Reads a CSV file with a header; units by the columns' names, time in `t_s`.
///
/// # Errors
/// [`RecordError`]: the first problem, with row and column.
pub fn from_csv(path: &Path, options: &Options) -> Result<Record, RecordError> {
    let file =
        File::open(path).map_err(|error| Problem(format!("cannot read: {error}")).of(path))?;
    from_csv_text(path, file, options)
}

/// As [`from_csv`], from any reader; `path` is for messages.
///
/// # Errors
/// As [`from_csv`].
pub fn from_csv_text(
    path: &Path,
    text: impl Read,
    options: &Options,
) -> Result<Record, RecordError> {
    let draft = draft(text, &options.mapping).map_err(|problem| problem.of(path))?;
    draft.finish(path, options)
}

fn draft(text: impl Read, mapping: &[Mapping]) -> Result<Draft, Problem> {
    let mut reader =
        csv::ReaderBuilder::new().has_headers(false).trim(csv::Trim::All).from_reader(text);
    let mut row = csv::StringRecord::new();
    let no_header = |found: String| {
        Problem(format!(
            "row 1: expected a header with the columns' names, found {found}; put a line such as \
             `t_s,motor_v,master_rad` first"
        ))
    };
    if !reader.read_record(&mut row)? {
        return Err(no_header("an empty file".to_owned()));
    }
    let mut names: Vec<String> =
        row.iter().map(|name| name.trim_start_matches('\u{feff}').to_owned()).collect();
    if let Some(number) = names.iter().find(|name| name.parse::<f64>().is_ok()) {
        return Err(no_header(format!("the number {number}")));
    }
    for (second, name) in names.iter().enumerate() {
        if name.is_empty() {
            return Err(no_header(format!("no name for column {}", second + 1)));
        }
        if let Some(first) = names[..second].iter().position(|earlier| earlier == name) {
            let (first, second) = (first + 1, second + 1);
            return Err(Problem(format!(
                "row 1: column `{name}` occurs twice (columns {first} and {second}); rename or \
                 remove one"
            )));
        }
    }
    let factors = mapped(&mut names, mapping)?;
    let Some(time) = names.iter().position(|name| name == TIME) else {
        return Err(Problem::missing_column(TIME, &names.join(", ")));
    };
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    let mut rows = Vec::new();
    while reader.read_record(&mut row)? {
        let line = row.position().map_or(rows.len() as u64 + 2, csv::Position::line);
        for (index, cell) in row.iter().enumerate() {
            let value = cell.parse::<f64>().ok().filter(|value| value.is_finite());
            let Some(value) = value else {
                let found =
                    if cell.is_empty() { "an empty cell".to_owned() } else { format!("`{cell}`") };
                return Err(Problem::cell(line, &names[index], &found));
            };
            values[index].push(factors[index] * value);
        }
        rows.push(line);
    }
    let time_s = std::mem::take(&mut values[time]);
    let columns = names.into_iter().zip(values).filter(|(name, _)| name != TIME);
    Ok(Draft::in_memory(time_s, rows, columns))
}

/// Renames the mapped columns; returns the factor of each column.
fn mapped(names: &mut [String], mapping: &[Mapping]) -> Result<Vec<f64>, Problem> {
    let mut factors = vec![1.0; names.len()];
    let mut places = Vec::new();
    for one in mapping {
        let Some(at) = names.iter().position(|name| *name == one.source) else {
            return Err(Problem::missing_column(&one.source, &names.join(", ")));
        };
        places.push((at, one));
    }
    for (at, one) in places {
        if let Some(other) =
            names.iter().enumerate().position(|(index, name)| index != at && *name == one.column)
        {
            return Err(one.problem(format!("column {} already has that name", other + 1)));
        }
        names[at].clone_from(&one.column);
        factors[at] = one.factor;
    }
    Ok(factors)
}

impl From<csv::Error> for Problem {
    fn from(error: csv::Error) -> Self {
        let row = error.position().map_or(1, csv::Position::line);
        let what = match error.into_kind() {
            csv::ErrorKind::Io(source) => return Self(format!("cannot read: {source}")),
            csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                format!("expected {expected_len} cells as in the header, found {len}")
            }
            csv::ErrorKind::Utf8 { .. } => "text that is not UTF-8".to_owned(),
            _ => "cannot be read".to_owned(),
        };
        Self(format!("row {row}: not a CSV table: {what}"))
    }
}

/// Writes a record; reading it back gives the same bits.
///
/// # Errors
/// Those of the output.
pub fn write_csv(record: &Record, output: impl Write) -> io::Result<()> {
    let columns = record.columns.iter().map(|(name, values)| (name.as_str(), Cursor::of(values)));
    write_columns(Cursor::of(&record.time_s), columns, output)
}

impl Table {
    /// As [`write_csv`].
    ///
    /// # Errors
    /// Those of the output, and of the columns' files.
    pub fn write_csv(&self, output: impl Write) -> io::Result<()> {
        let columns = self.columns.iter().map(|(name, values)| (name.as_str(), values.cursor()));
        write_columns(self.time_s.cursor(), columns, output)
    }
}

fn write_columns<'a>(
    time_s: Cursor<'a>,
    columns: impl Iterator<Item = (&'a str, Cursor<'a>)>,
    output: impl Write,
) -> io::Result<()> {
    let mut writer = csv::Writer::from_writer(output);
    let to_io = |error: csv::Error| match error.into_kind() {
        csv::ErrorKind::Io(error) => error, // keeps its kind: a closed pipe is no failure
        other => io::Error::other(format!("{other:?}")),
    };
    let rows = time_s.len();
    let (names, mut columns): (Vec<&str>, Vec<Cursor<'_>>) =
        std::iter::once((TIME, time_s)).chain(columns).unzip();
    writer.write_record(names).map_err(to_io)?;
    let mut cell = String::new();
    for row in 0..rows {
        for column in &mut columns {
            cell.clear();
            // The shortest text that parses to the same number.
            write!(cell, "{}", column.at(row)?).map_err(io::Error::other)?;
            writer.write_field(&cell).map_err(to_io)?;
        }
        writer.write_record(None::<&[u8]>).map_err(to_io)?;
    }
    writer.flush()
}
