//! Resampling to one uniform grid by linear interpolation.

use std::path::Path;

use super::grid::Steps;
use super::{Draft, Finding, FindingKind, Options, Problem, Record, RecordError, TIME, Table};
use crate::column::Cursor;

/// A time step beyond this multiple of the median is a gap, which is not interpolated: two rows may
/// be missing, beside jitter.
const GAP: f64 = 3.5;
/// Least and greatest rate, as multiples of the rows' own.
const RATES: (f64, f64) = (0.5, 2.0);

/// Columns with common sampling instants.
#[derive(Debug, Default)]
pub(super) struct Track {
    /// Row or message of each, for messages.
    pub rows: Vec<u64>,
    /// Times (s).
    pub time_s: Vec<f64>,
    /// Columns with their names.
    pub columns: Vec<(String, Vec<f64>)>,
}

impl Track {
    /// Checks that time increases from row to row and has no gap.
    fn check(&self) -> Result<(), Problem> {
        if self.time_s.len() < 3 {
            return Err(Problem::too_few_rows(3, self.time_s.len()));
        }
        let rows: Vec<f64> = self.rows.iter().map(|row| *row as f64).collect();
        let mut steps = Steps::new(Cursor::of(&self.time_s), Cursor::of(&rows))?;
        let gaps = steps.gaps(|step, median| step > GAP * median)?;
        steps.refuse(&gaps)
    }

    /// Mean rate (Hz).
    fn rate_hz(&self) -> f64 {
        match (self.time_s.first(), self.time_s.last()) {
            (Some(first), Some(last)) => (self.time_s.len() - 1) as f64 / (last - first),
            _ => f64::NAN,
        }
    }

    /// A column at increasing times within the track's own, interpolated linearly.
    fn at(&self, values: &[f64], times: &[f64]) -> Vec<f64> {
        let mut row = 0;
        let one = |time: &f64| {
            while row + 2 < self.time_s.len() && self.time_s[row + 1] < *time {
                row += 1;
            }
            let part = (time - self.time_s[row]) / (self.time_s[row + 1] - self.time_s[row]);
            values[row] + part.clamp(0.0, 1.0) * (values[row + 1] - values[row])
        };
        times.iter().map(one).collect()
    }
}

/// All tracks on one grid, over the interval that all of them cover: at `hz`, or at the mean rate
/// of the fastest.
///
/// # Errors
/// Too few rows, times that do not increase, gaps, a rate that would invent rows or drop most.
pub(super) fn on_one_grid(tracks: &[Track], hz: Option<f64>) -> Result<Draft, Problem> {
    for track in tracks {
        track.check()?;
    }
    let own_hz = tracks.iter().map(Track::rate_hz).fold(0.0, f64::max);
    let hz = hz.unwrap_or(own_hz);
    if !(RATES.0 * own_hz..=RATES.1 * own_hz).contains(&hz) {
        let (least, most) = (RATES.0 * own_hz, RATES.1 * own_hz);
        return Err(Problem(format!(
            "expected a rate between {least:.3} and {most:.3} Hz (rows come at {own_hz:.3} Hz), \
             found {hz} Hz"
        )));
    }
    let start = tracks
        .iter()
        .filter_map(|track| track.time_s.first())
        .fold(f64::NEG_INFINITY, |a, b| a.max(*b));
    let end =
        tracks.iter().filter_map(|track| track.time_s.last()).fold(f64::INFINITY, |a, b| a.min(*b));
    // A last row that is missed only by rounding counts.
    let count = ((end - start) * hz + 1e-6).floor() + 1.0;
    if count.is_nan() || count < 3.0 {
        return Err(Problem::too_few_rows(3, count.max(0.0) as usize));
    }
    let time_s: Vec<f64> = (0..count as usize).map(|row| start + row as f64 / hz).collect();
    let columns: Vec<(String, Vec<f64>)> = tracks
        .iter()
        .flat_map(|track| {
            track.columns.iter().map(|(name, values)| (name.clone(), track.at(values, &time_s)))
        })
        .collect();
    let most = tracks.iter().map(|track| track.time_s.len()).max().unwrap_or(0);
    let finding = Finding {
        column: TIME.to_owned(),
        kind: FindingKind::Resampled,
        first_row: 1,
        rows: time_s.len() as u64,
        text: format!(
            "resampled by linear interpolation to {hz:.6} Hz: {} rows of {most}",
            time_s.len()
        ),
    };
    let rows = 1..=time_s.len() as u64;
    Ok(Draft { findings: vec![finding], ..Draft::in_memory(time_s, rows, columns) })
}

impl Draft {
    /// The checked record, resampled where the options ask for it; `file` is for messages.
    pub(super) fn finish(self, file: &Path, options: &Options) -> Result<Record, RecordError> {
        let table = self.finish_table(file, options)?;
        table.into_record().map_err(|problem| problem.of(file))
    }

    /// As [`Self::finish`], with the columns where they are, unless they are resampled.
    pub(super) fn finish_table(self, file: &Path, options: &Options) -> Result<Table, RecordError> {
        let table = self.resampled(options).and_then(|draft| draft.checked(file, options));
        table.map_err(|problem| problem.of(file))
    }

    fn resampled(self, options: &Options) -> Result<Self, Problem> {
        let even = options.even_out && options.resample_hz.is_none();
        if !even && options.resample_hz.is_none() {
            return Ok(self);
        }
        let usable = self.time_s.len() > 2 && self.not_finite()?.is_none();
        if even && !usable {
            return Ok(self);
        }
        let uneven = |draft: &Self| -> Result<Option<(f64, String)>, Problem> {
            let mut steps = Steps::new(draft.time_s.cursor(), draft.rows.cursor())?;
            if !steps.is_uneven(options.time_tolerance)? {
                return Ok(None);
            }
            let told = format!("; {}", steps.unevenness(options.time_tolerance)?);
            Ok(Some((1.0 / steps.median, told)))
        };
        let (mut hz, mut told) = (options.resample_hz, String::new());
        if even {
            match uneven(&self)? {
                None => return Ok(self),
                Some((even_hz, how)) => (hz, told) = (Some(even_hz), how),
            }
        }
        let Self { rows, time_s, columns, findings } = self;
        let rows = rows.into_vec()?.into_iter().map(|row| row as u64).collect();
        let columns: std::io::Result<_> =
            columns.into_iter().map(|(name, column)| Ok((name, column.into_vec()?))).collect();
        let track = Track { rows, time_s: time_s.into_vec()?, columns: columns? };
        let mut draft = on_one_grid(&[track], hz)?;
        draft.findings.iter_mut().for_each(|finding| finding.text += &told);
        draft.findings.splice(0..0, findings);
        Ok(draft)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(time_s: Vec<f64>, name: &str, of: impl Fn(f64) -> f64) -> Track {
        let values = time_s.iter().map(|time| of(*time)).collect();
        Track {
            rows: (1..=time_s.len() as u64).collect(),
            time_s,
            columns: vec![(name.to_owned(), values)],
        }
    }

    #[test]
    fn linear_signals_are_preserved_at_any_sampling() {
        let jittered =
            (0..500).map(|row| f64::from(row) * 2e-3 + 4e-4 * f64::from(row * 7 % 5)).collect();
        let slow = (0..110).map(|row| 0.01 * f64::from(row) - 0.013).collect();
        let tracks = [track(jittered, "a", |t| 3.0 * t), track(slow, "b", |t| 1.0 - t)];
        let draft = on_one_grid(&tracks, Some(400.0)).unwrap();
        let time_s = draft.time_s.in_memory();
        assert!((time_s[1] - time_s[0] - 2.5e-3).abs() < 1e-12);
        assert!(time_s[0] >= 0.0 && *time_s.last().unwrap() <= 1.0);
        for (row, time) in time_s.iter().enumerate() {
            assert!((draft.columns["a"].in_memory()[row] - 3.0 * time).abs() < 1e-9);
            assert!((draft.columns["b"].in_memory()[row] - (1.0 - time)).abs() < 1e-9);
        }
        assert!(draft.findings[0].text.contains("400"));
    }

    #[test]
    fn a_uniform_track_is_unchanged() {
        let times: Vec<f64> = (0..100).map(|row| 5.0 + f64::from(row) * 1e-3).collect();
        let draft = on_one_grid(&[track(times.clone(), "a", f64::sin)], None).unwrap();
        assert_eq!(draft.time_s.len(), 100);
        assert!(
            draft.columns["a"]
                .in_memory()
                .iter()
                .zip(&times)
                .all(|(value, time)| (value - time.sin()).abs() < 1e-9)
        );
    }

    #[test]
    fn gaps_and_rates_that_would_invent_rows_are_refused() {
        let refuse = |time_s: Vec<f64>, hz| {
            on_one_grid(&[track(time_s, "a", f64::sin)], hz).err().unwrap().0
        };
        let even = |row: i32| f64::from(row) * 1e-3;
        let gap = (0..50).map(|row| even(if row < 30 { row } else { row + 4 })).collect();
        let said = refuse(gap, None);
        assert!(said.contains("row 31") && said.contains("4 samples"), "{said}");
        let back = (0..50).map(|row| even(if row == 20 { 5 } else { row })).collect();
        assert!(refuse(back, None).contains("row 21"));
        let said = refuse((0..50).map(even).collect(), Some(5000.0));
        assert!(said.contains("5000") && said.contains("2000"), "{said}");
        assert!(refuse(vec![0.0, 1.0], None).contains("found 2"));
    }
}
