//! The recordings of a folder, in the order in which they were made.

use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use recording::mcap_read::{Recording, Selection};
use recording::record::TIME;
use serde::Serialize;

use crate::error::{IdentifyError, Result};
use crate::input::Series;

/// Times outside are no calendar times (s since 1970): from 2000-01-01 to before 3000-01-01, so
/// that milliseconds since 1970 are none.
const CALENDAR_S: std::ops::Range<f64> = 946_684_800.0..32_503_680_000.0;
const SECONDS_PER_DAY: f64 = 86_400.0;

/// A recording that takes no part, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// File.
    pub file: String,
    /// Why.
    pub reason: String,
}

/// The recordings (`*.mcap`, `*.csv`) of a folder, not of folders within it, by name; numbers in
/// names count as numbers.
///
/// # Errors
/// If the folder cannot be read or has none.
pub fn recordings(folder: &Path) -> Result<Vec<PathBuf>> {
    let shown = folder.display();
    let unusable = |what: String| IdentifyError::Unusable(format!("--trend: {shown}: {what}"));
    let entries = std::fs::read_dir(folder).map_err(|error| {
        unusable(format!("expected a folder with recordings, cannot read it: {error}"))
    })?;
    let mut found: Vec<PathBuf> = entries
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<std::io::Result<_>>()
        .map_err(|error| unusable(format!("cannot be read: {error}")))?;
    found.retain(|path| {
        let is = |wanted: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted));
        (is("mcap") || is("csv")) && path.is_file()
    });
    if found.is_empty() {
        return Err(unusable(
            "expected recordings (*.mcap, *.csv), found none; folders within it are not searched"
                .to_owned(),
        ));
    }
    found.sort_by_cached_key(|path| natural(&path.to_string_lossy()));
    Ok(found)
}

/// A key by which `run-2` comes before `run-10`.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut pieces: Vec<(String, u64)> = vec![Default::default()];
    let mut digits = false;
    for letter in name.chars() {
        let digit = letter.to_digit(10).map(u64::from);
        if digits && digit.is_none() {
            pieces.push(Default::default());
        }
        digits = digit.is_some();
        if let Some(last) = pieces.last_mut() {
            match digit {
                Some(digit) => last.1 = last.1.saturating_mul(10).saturating_add(digit),
                None => last.0.push(letter),
            }
        }
    }
    pieces
}

/// When a recording began (s since 1970, UTC). A recording of farreach's says so; of another
/// program's, the time at which the first message was written counts, of a CSV file that of the
/// first row. `None` where these are no calendar times.
pub fn began_s(path: &Path, series: &Series) -> Option<f64> {
    let calendar = |seconds: f64| Some(seconds).filter(|seconds| CALENDAR_S.contains(seconds));
    let in_rows = || series.column(TIME).and_then(|time| calendar(*time.first()?));
    let Ok(recording) = Recording::open(path) else { return in_rows() };
    let first_message = || {
        let first = recording.raw(Selection::default()).find_map(std::result::Result::ok)?;
        Some(first.log_time_ns())
    };
    let began_ns = recording.began_ns().or_else(first_message);
    began_ns.and_then(|ns| calendar(ns as f64 * 1e-9)).or_else(in_rows)
}

/// A calendar time as date and time of day (UTC).
pub fn date_and_time(seconds: f64) -> String {
    let time = UNIX_EPOCH.checked_add(Duration::try_from_secs_f64(seconds).unwrap_or_default());
    let time = time.unwrap_or(UNIX_EPOCH);
    humantime::format_rfc3339_seconds(time).to_string().replace('T', " ").replace('Z', "")
}

/// A calendar time as date (UTC).
pub fn date(seconds: f64) -> String {
    let both = date_and_time(seconds);
    both.split(' ').next().unwrap_or_default().to_owned()
}

/// Puts dated recordings into their order and leaves out those without a date; where none has one,
/// all stay in the order of their names.
pub fn in_order<T>(
    mut all: Vec<T>,
    began_s: impl Fn(&T) -> Option<f64>,
    file: impl Fn(&T) -> String,
) -> (Vec<T>, Vec<LeftOut>) {
    if all.iter().all(|own| began_s(own).is_none()) {
        return (all, Vec::new());
    }
    let undated = all.iter().filter(|own| began_s(own).is_none()).map(|own| LeftOut {
        file: file(own),
        reason: "it has no calendar time, which others have: its place among them is not known"
            .to_owned(),
    });
    let undated = undated.collect();
    all.retain(|own| began_s(own).is_some());
    all.sort_by(|a, b| began_s(a).unwrap_or(0.0).total_cmp(&began_s(b).unwrap_or(0.0)));
    (all, undated)
}

/// Days between two times (s).
pub fn days(from_s: f64, to_s: f64) -> f64 {
    (to_s - from_s) / SECONDS_PER_DAY
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use recording::mcap_write::{Start, Writer};

    use super::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["run-10.csv", "run-9.MCAP", "notes.txt", "run-9.part2.mcap", "a1b2.csv"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        std::fs::create_dir(folder.path().join("run-1.csv")).unwrap();
        let found = recordings(folder.path()).unwrap();
        let names: Vec<_> =
            found.iter().map(|p| p.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["a1b2.csv", "run-9.MCAP", "run-9.part2.mcap", "run-10.csv"]);
    }

    #[test]
    fn the_start_of_a_recording_is_a_calendar_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let offset = 1_772_530_200_000_000_000;
        let start = Start { realtime_offset_ns: offset, ..Start::default() };
        Writer::create(&path, &start, 5_000_000_000).unwrap().finish(&[]).unwrap();
        let began = began_s(&path, &Series::default()).unwrap();
        assert_eq!(date_and_time(began), "2026-03-03 09:30:05");
        assert_eq!(date(began), "2026-03-03");
        // A row's time is one where it is no time since the start.
        let rows = |first: f64| Series {
            columns: vec![(TIME.to_owned(), vec![first, first + 1.0])],
            ..Series::default()
        };
        let csv = Path::new("run.csv");
        assert_eq!(began_s(csv, &rows(1.7e9)), Some(1.7e9));
        assert_eq!(began_s(csv, &rows(12.0)), None);
        // In milliseconds, it would be a year that no calendar shows.
        assert_eq!(began_s(csv, &rows(1.7e12)), None);
    }

    #[test]
    fn dated_recordings_are_sorted_and_undated_ones_left_out_beside_them() {
        let order = |times: &[Option<f64>]| {
            let all: Vec<(usize, Option<f64>)> = times.iter().copied().enumerate().collect();
            let (kept, left) = in_order(all, |own| own.1, |own| own.0.to_string());
            let kept: Vec<usize> = kept.into_iter().map(|own| own.0).collect();
            (kept, left.into_iter().map(|own| own.file).collect::<Vec<_>>())
        };
        assert_eq!(order(&[None, None]), (vec![0, 1], vec![]));
        let mixed = order(&[Some(3.0), None, Some(1.0)]);
        assert_eq!(mixed, (vec![2, 0], vec!["1".to_owned()]));
    }
}
