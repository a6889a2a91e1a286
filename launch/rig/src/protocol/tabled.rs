//! Trajectories from a table: a CSV file beside the protocol, taken into the protocol's text when
//! it is loaded.
//!
//! The first row names the columns: `t_s`, then positions whose names end in `_deg` or `_m`. The
//! text that an experiment plays, that is recorded and that has the identity is the one with the
//! numbers in it: a table that is edited later changes nothing.

use std::path::Path;
use std::sync::Arc;

use toml_edit::{Array, DocumentMut, Item, Table, Value};

use super::lengths::{FADE, Lengths, POSITION_DEG, POSITION_M};
use super::spline::Spline;
use crate::error::{Problem, ProtocolError};
use crate::read::{Section, bounds};

/// Most rows of a table.
const ROWS: usize = 20_000;
/// Longest table (s).
const LONGEST_S: f64 = 36_000.0;

/// Along the points of a table, smoothly, from rest to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Tabled {
    /// The way (rad or m).
    pub spline: Arc<Spline>,
    /// Time from the position at the start to the first point (s).
    pub rise_s: f64,
}

impl Tabled {
    pub(super) fn read(section: &Section<'_>, lengths: &mut Lengths<'_, '_>) -> Self {
        let rise_s = section.number_or("rise_s", 1.0, FADE);
        section.text_or_none("path");
        section.text_or_none("column");
        let stand_in = || Self { spline: Arc::new(Spline::rest()), rise_s };
        if section.has("path") && !section.has("times_s") {
            let advice = "load the protocol from its file, so that its folder is known; or give times_s and positions_deg";
            section.problem(
                "path",
                "a table that was taken in when the protocol was loaded",
                "its name alone",
                advice,
            );
            section.know_all();
            return stand_in();
        }
        let times = section.numbers("times_s", bounds(0.0, LONGEST_S, "in seconds"));
        let positions = lengths.list("positions", POSITION_DEG, POSITION_M);
        if let Some(row) = times.windows(2).position(|pair| pair[1] <= pair[0]) {
            let expected = format!("increasing times; entry {} is after {} s", row + 2, times[row]);
            section.problem(
                "times_s",
                expected,
                format!("{} s", times[row + 1]),
                "put the points in order of time",
            );
        } else if times.len() < 2 || times.len() != positions.len() {
            let expected = "at least two times, and as many positions";
            let found = format!("{} and {}", times.len(), positions.len());
            section.problem("times_s", expected, found, "give each point a time and a position");
        }
        match Spline::through(times, positions) {
            Some(spline) => Self { spline: Arc::new(spline), rise_s },
            None => stand_in(),
        }
    }

    /// Whole duration (s).
    pub fn duration_s(&self) -> f64 {
        self.rise_s + self.spline.duration_s()
    }
}

/// The protocol's text with the tables that its segments name taken in; `folder` is that of the
/// protocol. Lines after the segment move on by the two that are added to it.
pub(super) fn take_in(text: &str, folder: &Path) -> Result<String, ProtocolError> {
    // What is no TOML is told of by the reader, with its line.
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

fn read_csv(path: &Path, column: Option<&str>) -> Result<Columns, ProtocolError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| ProtocolError::Unreadable { path: path.to_owned(), source })?;
    let file = path.display().to_string();
    let mut problems = Vec::new();
    let mut problem = |line: usize, key: &str, expected: String, found: String, advice: &str| {
        let (file, key, advice) = (file.clone(), key.to_owned(), advice.to_owned());
        problems.push(Problem { file, line, key, expected, found, advice });
    };
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
        let expected =
            format!("columns t_s and {}", column.unwrap_or("one whose name ends in _deg or _m"));
        problem(
            1,
            "",
            expected,
            format!("\"{}\"", names.join(",")),
            "name the columns in the first row",
        );
        return Err(ProtocolError::Invalid { problems });
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
                problem(
                    line,
                    "",
                    format!("{} columns", names.len()),
                    error.to_string(),
                    "mend the row",
                );
                continue;
            }
        };
        let line = row.position().map_or(index + 2, |at| at.line() as usize);
        let mut number = |column: usize| {
            let text = row.get(column).unwrap_or_default();
            let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
            if value.is_none() {
                problem(
                    line,
                    &names[column],
                    "a finite number".to_owned(),
                    format!("\"{text}\""),
                    "mend the row",
                );
            }
            value
        };
        let (t, position) = (number(time), number(place));
        if let Some(t) = t {
            if !(0.0..=LONGEST_S).contains(&t) || before.is_some_and(|before| t <= before) {
                let least =
                    before.map_or_else(|| "from 0".to_owned(), |before| format!("after {before}"));
                let expected = format!("increasing times {least} to {LONGEST_S} s");
                problem(line, "t_s", expected, format!("{t}"), "put the rows in order of time");
            }
            before = Some(t);
        }
        let (Some(t), Some(position)) = (t, position) else { continue };
        if position.abs() > most {
            problem(
                line,
                &names[place],
                format!("positions within ±{most}"),
                format!("{position}"),
                "move less",
            );
        }
        columns.times_s.push(t);
        columns.positions.push(position);
    }
    let count = columns.times_s.len();
    if problems.is_empty() && !(2..=ROWS).contains(&count) {
        let (expected, found) = (format!("2 to {ROWS} rows"), count.to_string());
        let (key, advice) = (String::new(), "give a point a row; thin out a long table".to_owned());
        problems.push(Problem { file, line: 1, key, expected, found, advice });
    }
    if problems.is_empty() { Ok(columns) } else { Err(ProtocolError::Invalid { problems }) }
}
