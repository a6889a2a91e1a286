//! Checks that time is uniform, and finds gaps.

use std::io;
use std::ops::Range;

use super::{Finding, FindingKind, Gaps, Options, Problem};
use crate::column::{Cursor, nth};

/// A step of at least this multiple of the median is a gap; a smaller one is jitter.
const GAP: f64 = 1.5;

/// The steps of a time that increases from row to row.
pub(super) struct Steps<'a> {
    time_s: Cursor<'a>,
    rows: Cursor<'a>,
    /// The median step (s).
    pub(super) median: f64,
}

impl<'a> Steps<'a> {
    /// `rows` are the numbers of the rows, for messages.
    pub(super) fn new(time_s: Cursor<'a>, rows: Cursor<'a>) -> Result<Self, Problem> {
        let mut steps = Self { time_s, rows, median: f64::NAN };
        steps.median = nth(steps.count() / 2, |take| {
            (0..steps.count()).try_for_each(|at| steps.step(at).map(&mut *take))
        })?;
        for at in 0..steps.count() {
            let step = steps.step(at)?;
            if step.is_nan() || step <= 0.0 {
                let [before, after] = [steps.time_s.at(at)?, steps.time_s.at(at + 1)?];
                return Err(Problem::time_backwards(steps.row(at + 1), before, after));
            }
        }
        Ok(steps)
    }

    fn count(&self) -> usize {
        self.time_s.len().saturating_sub(1)
    }

    fn step(&mut self, at: usize) -> io::Result<f64> {
        Ok(self.time_s.at(at + 1)? - self.time_s.at(at)?)
    }

    fn row(&mut self, index: usize) -> u64 {
        self.rows.at(index).map_or(index as u64 + 1, |row| row as u64)
    }

    /// The steps that are gaps: `is_gap` takes a step and the median one.
    pub(super) fn gaps(&mut self, is_gap: impl Fn(f64, f64) -> bool) -> io::Result<Vec<usize>> {
        let mut gaps = Vec::new();
        for at in 0..self.count() {
            if is_gap(self.step(at)?, self.median) {
                gaps.push(at);
            }
        }
        Ok(gaps)
    }

    /// Whether a step differs from the median by more than this share of it.
    pub(super) fn is_uneven(&mut self, tolerance: f64) -> io::Result<bool> {
        let median = self.median;
        Ok(!self.gaps(|step, _| (step - median).abs() > tolerance * median)?.is_empty())
    }

    /// How uneven the steps are, and how many are missing, in words.
    pub(super) fn unevenness(&mut self, tolerance: f64) -> io::Result<String> {
        let (mut uneven, mut missing) = (0, 0);
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        for at in 0..self.count() {
            let step = self.step(at)?;
            uneven += usize::from((step - self.median).abs() > tolerance * self.median);
            (least, most) = (least.min(step), most.max(step));
            missing += self.missing(at)?;
        }
        Ok(format!(
            "{uneven} of {} steps differ from the median of {:.6} s by more than {} % \
             ({least:.6} to {most:.6} s; {missing} rows are missing)",
            self.count(),
            self.median,
            100.0 * tolerance,
        ))
    }

    fn missing(&mut self, at: usize) -> io::Result<u64> {
        Ok(((self.step(at)? / self.median).round() as u64).saturating_sub(1))
    }

    /// Refuses gaps.
    pub(super) fn refuse(&mut self, gaps: &[usize]) -> Result<(), Problem> {
        let Some(&at) = gaps.first() else { return Ok(()) };
        Err(Problem(format!(
            "row {}, column `t_s`: {} samples are missing between {} s and {} s (sampling {} s; \
             {} such gaps); cut the record there, or resample it where holes are short",
            self.row(at + 1),
            self.missing(at)?,
            self.time_s.at(at)?,
            self.time_s.at(at + 1)?,
            self.median,
            gaps.len(),
        )))
    }
}

/// Returns the rows to keep, their mean sampling time (s), and a finding where rows were left out.
pub(super) fn uniform(
    time_s: Cursor<'_>,
    rows: Cursor<'_>,
    options: &Options,
) -> Result<(Range<usize>, f64, Option<Finding>), Problem> {
    let all = time_s.len();
    let mut steps = Steps::new(time_s, rows)?;
    let gaps = steps.gaps(|step, median| step >= GAP * median)?;
    if options.gaps == Gaps::Refuse {
        steps.refuse(&gaps)?;
    }
    let median = steps.median;
    let (mut kept, mut start) = (0..0, 0);
    for end in gaps.iter().map(|&at| at + 1).chain([all]) {
        if end - start > kept.len() {
            kept = start..end;
        }
        start = end;
    }
    for at in kept.start..kept.end.saturating_sub(1) {
        let step = steps.step(at)?;
        if (step - median).abs() > options.time_tolerance * median {
            return Err(Problem(format!(
                "row {}, column `t_s`: expected steps of {median} s within {} %, found {step} s; \
                 resample the record uniformly",
                steps.row(at + 1),
                options.time_tolerance * 100.0,
            )));
        }
    }
    let span = steps.time_s.at(kept.end - 1)? - steps.time_s.at(kept.start)?;
    let sampling_s = if kept.len() > 1 { span / (kept.len() - 1) as f64 } else { median };
    if gaps.is_empty() {
        return Ok((kept, sampling_s, None));
    }
    let mut missing = 0;
    for at in &gaps {
        missing += steps.missing(*at)?;
    }
    let [first, last] = [steps.row(kept.start), steps.row(kept.end - 1)];
    let left_out = all - kept.len();
    let finding = Finding {
        column: super::TIME.to_owned(),
        kind: FindingKind::Masked,
        first_row: first,
        rows: left_out as u64,
        text: format!(
            "{} gaps, {missing} samples missing: kept rows {first} to {last}, left out {left_out} \
             of {all}",
            gaps.len(),
        ),
    };
    Ok((kept, sampling_s, Some(finding)))
}
