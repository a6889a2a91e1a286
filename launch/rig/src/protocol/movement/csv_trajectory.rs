//! `file`: a trajectory from a CSV file beside the protocol, embedded in the protocol's text when
//! it is loaded.
//!
//! The first row names the columns: `t_s`, and positions whose names end in `_deg` or `_m`. The
//! experiment plays and records the text with the numbers embedded, and the identity is of that
//! text: a later change of the CSV file changes nothing.

use std::path::Path;
use std::sync::Arc;

use csv::StringRecord;
use toml_edit::{Array, DocumentMut, Item, Table, Value};

use crate::checked_toml::{Keys, Section, bounds};
use crate::error::{Problem, ProtocolError};
use crate::protocol::segment_kind::SegmentKind;
use crate::protocol::spline::Spline;
use crate::protocol::trajectory::{Point, min_jerk, min_jerk_peak_speed};
use crate::protocol::unit_keys::{FADE, POSITION_DEG, POSITION_M, UnitKeys};

/// Most rows of a table.
const ROWS: usize = 20_000;
/// Longest table (s).
const LONGEST_S: f64 = 36_000.0;

/// A smooth trajectory through the points of a table, from rest to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct CsvTrajectory {
    /// The trajectory (rad or m).
    pub spline: Arc<Spline>,
    /// Time of the movement from the start position to the first point (s).
    pub rise_s: f64,
}

pub(super) const KEYS: Keys = &[
    ("path", "CSV file, relative to the protocol's folder; the first row names the columns."),
    ("column", "Column of the positions; by default the first that ends in `_deg` or `_m`."),
    ("times_s", "Times of the points, where the table is in the protocol itself."),
    ("positions_{deg,m}", "Positions of the points, as many as times."),
    ("rise_s", "Time of the movement from the start position to the first point."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> CsvTrajectory {
    let rise_s = section.number_or("rise_s", 1.0, FADE);
    section.text_or_none("path");
    section.text_or_none("column");
    let placeholder = || CsvTrajectory { spline: Arc::new(Spline::rest()), rise_s };
    if section.has("path") && !section.has("times_s") {
        let expected = "a table that was read when the protocol was loaded";
        let advice = "load the protocol from its file, so that its folder is known; \
                      or give times_s and positions_deg";
        section.problem("path", expected, "its name alone", advice);
        section.know_all();
        return placeholder();
    }
    let times = section.numbers("times_s", bounds(0.0, LONGEST_S, "in seconds"));
    let positions = keys.list("positions", POSITION_DEG, POSITION_M);
    if let Some(row) = times.windows(2).position(|pair| pair[1] <= pair[0]) {
        let expected = format!("increasing times; entry {} is after {} s", row + 2, times[row]);
        let advice = "put the points in order of time";
        section.problem("times_s", expected, format!("{} s", times[row + 1]), advice);
    } else if times.len() < 2 || times.len() != positions.len() {
        let expected = "at least two times, and as many positions";
        let found = format!("{} and {}", times.len(), positions.len());
        section.problem("times_s", expected, found, "give each point a time and a position");
    }
    match Spline::through(times, positions) {
        Some(spline) => CsvTrajectory { spline: Arc::new(spline), rise_s },
        None => placeholder(),
    }
}

impl SegmentKind for CsvTrajectory {
    fn duration_s(&self) -> f64 {
        self.rise_s + self.spline.duration_s()
    }

    fn range(&self) -> Option<(f64, f64)> {
        Some(self.spline.range())
    }

    fn end(&self, _start: Option<f64>) -> Option<f64> {
        Some(self.spline.end())
    }

    fn peak_speed_from(&self, start: f64) -> f64 {
        let approach = min_jerk_peak_speed(start, self.spline.begin(), self.rise_s);
        self.spline.peak_speed().max(approach)
    }

    fn feedforward_speed(&self) -> f64 {
        self.spline.peak_speed()
    }

    fn at(&self, start: f64, time_s: f64, peak_speed: f64) -> Point {
        if time_s < self.rise_s {
            return min_jerk(start, self.spline.begin(), time_s, self.rise_s);
        }
        let (position, velocity, acceleration) = self.spline.at(time_s - self.rise_s);
        Point { position, velocity, acceleration, peak_speed }
    }

    fn single_axis(&self) -> bool {
        true
    }
}

/// Embeds the tables that the segments name in the protocol's text; `folder` is the protocol's.
/// Adds two lines to each such segment.
pub(in crate::protocol) fn embed_tables(
    text: &str,
    folder: &Path,
) -> Result<String, ProtocolError> {
    // The reader reports invalid TOML, with its line.
    let Ok(mut document) = text.parse::<DocumentMut>() else { return Ok(text.to_owned()) };
    let Some(segments) = document.get_mut("segments").and_then(Item::as_array_of_tables_mut) else {
        return Ok(text.to_owned());
    };
    let mut changed = false;
    for segment in segments.iter_mut() {
        let word = |key: &str| segment.get(key).and_then(Item::as_str).map(str::to_owned);
        let (Some("file"), Some(path)) = (word("kind").as_deref(), word("path")) else { continue };
        if segment.contains_key("times_s") {
            continue;
        }
        let table = read_csv(&folder.join(&path), word("column").as_deref())?;
        put(segment, &table);
        changed = true;
    }
    Ok(if changed { document.to_string() } else { text.to_owned() })
}

/// Columns of a table, in the unit of the file.
struct Columns {
    times_s: Vec<f64>,
    positions: Vec<f64>,
    metres: bool,
}

fn put(segment: &mut Table, table: &Columns) {
    let list =
        |values: &[f64]| Item::Value(Value::Array(values.iter().copied().collect::<Array>()));
    segment.insert("times_s", list(&table.times_s));
    segment
        .insert(if table.metres { "positions_m" } else { "positions_deg" }, list(&table.positions));
}

/// Problems found in a CSV file.
struct Problems {
    file: String,
    list: Vec<Problem>,
}

impl Problems {
    fn add(&mut self, line: usize, key: &str, expected: String, found: String, advice: &str) {
        self.list.push(Problem::new(&self.file, line, key, expected, found, advice));
    }

    /// Reads the number in a column of a row.
    fn number(&mut self, line: usize, row: &StringRecord, column: (usize, &str)) -> Option<f64> {
        let (index, name) = column;
        let text = row.get(index).unwrap_or_default();
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        if value.is_none() {
            let expected = "a finite number".to_owned();
            self.add(line, name, expected, format!("\"{text}\""), "correct the row");
        }
        value
    }

    fn check_time(&mut self, line: usize, t: f64, before: Option<f64>) {
        if !(0.0..=LONGEST_S).contains(&t) || before.is_some_and(|before| t <= before) {
            let least = before.map_or("from 0".to_owned(), |before| format!("after {before}"));
            let expected = format!("increasing times {least} to {LONGEST_S} s");
            self.add(line, "t_s", expected, format!("{t}"), "put the rows in order of time");
        }
    }
}

fn read_csv(path: &Path, column: Option<&str>) -> Result<Columns, ProtocolError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| ProtocolError::Unreadable { path: path.to_owned(), source })?;
    let mut problems = Problems { file: path.display().to_string(), list: Vec::new() };
    let mut rows = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let names: Vec<String> =
        rows.headers().map(|names| names.iter().map(str::to_owned).collect()).unwrap_or_default();
    let time = names.iter().position(|name| name == "t_s");
    let place = names.iter().position(|name| match column {
        Some(column) => name == column,
        None => name.ends_with("_deg") || name.ends_with("_m"),
    });
    let (Some(time), Some(place)) = (time, place) else {
        let name = column.unwrap_or("one whose name ends in _deg or _m");
        let (expected, found) = (format!("columns t_s and {name}"), names.join(","));
        problems.add(1, "", expected, format!("\"{found}\""), "name the columns in the first row");
        return Err(ProtocolError::Invalid { problems: problems.list });
    };
    let metres = names[place].ends_with("_m");
    let most = if metres { POSITION_M.most } else { POSITION_DEG.most };
    let mut columns = Columns { times_s: Vec::new(), positions: Vec::new(), metres };
    let mut before: Option<f64> = None;
    for (index, row) in rows.records().enumerate() {
        let row = match row {
            Ok(row) => row,
            Err(error) => {
                let line = error.position().map_or(index + 2, |at| at.line() as usize);
                let expected = format!("{} columns", names.len());
                problems.add(line, "", expected, error.to_string(), "correct the row");
                continue;
            }
        };
        let line = row.position().map_or(index + 2, |at| at.line() as usize);
        let t = problems.number(line, &row, (time, &names[time]));
        let position = problems.number(line, &row, (place, &names[place]));
        if let Some(t) = t {
            problems.check_time(line, t, before);
            before = Some(t);
        }
        let (Some(t), Some(position)) = (t, position) else { continue };
        if position.abs() > most {
            let expected = format!("positions within ±{most}");
            problems.add(line, &names[place], expected, format!("{position}"), "move less");
        }
        columns.times_s.push(t);
        columns.positions.push(position);
    }
    let count = columns.times_s.len();
    if problems.list.is_empty() && !(2..=ROWS).contains(&count) {
        let expected = format!("2 to {ROWS} rows");
        let advice = "give each point a row; thin out a long table";
        problems.add(1, "", expected, count.to_string(), advice);
    }
    match problems.list.is_empty() {
        true => Ok(columns),
        false => Err(ProtocolError::Invalid { problems: problems.list }),
    }
}
