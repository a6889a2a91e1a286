//! Checks that time is uniform, and finds gaps.

use std::ops::Range;

use super::{Finding, FindingKind, Gaps, Options, Problem};

/// A step of at least this multiple of the median is a gap; a smaller one is jitter.
const GAP: f64 = 1.5;

/// The steps of a time that increases from row to row.
pub(super) struct Steps<'a> {
    time_s: &'a [f64],
    rows: &'a [u64],
    steps: Vec<f64>,
    /// The median step (s).
    pub(super) median: f64,
}

impl<'a> Steps<'a> {
    /// `rows` are the numbers of the rows, for messages.
    pub(super) fn new(time_s: &'a [f64], rows: &'a [u64]) -> Result<Self, Problem> {
        let steps: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let mut sorted = steps.clone();
        let (_, &mut median, _) = sorted.select_nth_unstable_by(steps.len() / 2, f64::total_cmp);
        let steps = Self { time_s, rows, steps, median };
        match steps.steps.iter().position(|step| step.is_nan() || *step <= 0.0) {
            None => Ok(steps),
            Some(at) => Err(Problem::time_backwards(steps.row(at + 1), time_s[at], time_s[at + 1])),
        }
    }

    fn row(&self, index: usize) -> u64 {
        self.rows.get(index).copied().unwrap_or(index as u64 + 1)
    }

    /// The steps that are gaps: `is_gap` takes a step and the median one.
    pub(super) fn gaps(&self, is_gap: impl Fn(f64, f64) -> bool) -> Vec<usize> {
        (0..self.steps.len()).filter(|&at| is_gap(self.steps[at], self.median)).collect()
    }

    /// Whether a step differs from the median by more than this share of it.
    pub(super) fn is_uneven(&self, tolerance: f64) -> bool {
        self.steps.iter().any(|step| (step - self.median).abs() > tolerance * self.median)
    }

    /// How uneven the steps are, and how many are missing, in words.
    pub(super) fn unevenness(&self, tolerance: f64) -> String {
        let off = |step: &&f64| (**step - self.median).abs() > tolerance * self.median;
        let uneven = self.steps.iter().filter(off).count();
        let least = self.steps.iter().copied().fold(f64::INFINITY, f64::min);
        let most = self.steps.iter().copied().fold(0.0, f64::max);
        let missing: u64 = (0..self.steps.len()).map(|at| self.missing(at)).sum();
        format!(
            "{uneven} of {} steps differ from the median of {:.6} s by more than {} % \
             ({least:.6} to {most:.6} s; {missing} rows are missing)",
            self.steps.len(),
            self.median,
            100.0 * tolerance,
        )
    }

    fn missing(&self, at: usize) -> u64 {
        ((self.steps[at] / self.median).round() as u64).saturating_sub(1)
    }

    /// Refuses gaps.
    pub(super) fn refuse(&self, gaps: &[usize]) -> Result<(), Problem> {
        let Some(&at) = gaps.first() else { return Ok(()) };
        Err(Problem(format!(
            "row {}, column `t_s`: {} samples are missing between {} s and {} s (sampling {} s; \
             {} such gaps); cut the record there, or resample it where holes are short",
            self.row(at + 1),
            self.missing(at),
            self.time_s[at],
            self.time_s[at + 1],
            self.median,
            gaps.len(),
        )))
    }
}

/// Returns the rows to keep, their mean sampling time (s), and a finding where rows were left out.
pub(super) fn uniform(
    time_s: &[f64],
    rows: &[u64],
    options: &Options,
) -> Result<(Range<usize>, f64, Option<Finding>), Problem> {
    let steps = Steps::new(time_s, rows)?;
    let gaps = steps.gaps(|step, median| step >= GAP * median);
    if options.gaps == Gaps::Refuse {
        steps.refuse(&gaps)?;
    }
    let (row, median) = (|index| steps.row(index), steps.median);
    let (mut kept, mut start) = (0..0, 0);
    for end in gaps.iter().map(|&at| at + 1).chain([time_s.len()]) {
        if end - start > kept.len() {
            kept = start..end;
        }
        start = end;
    }
    let kept_steps =
        steps.steps.iter().enumerate().take(kept.end.saturating_sub(1)).skip(kept.start);
    for (at, &step) in kept_steps {
        if (step - median).abs() > options.time_tolerance * median {
            return Err(Problem(format!(
                "row {}, column `t_s`: expected steps of {median} s within {} %, found {step} s; \
                 resample the record uniformly",
                row(at + 1),
                options.time_tolerance * 100.0,
            )));
        }
    }
    let span = time_s[kept.end - 1] - time_s[kept.start];
    let sampling_s = if kept.len() > 1 { span / (kept.len() - 1) as f64 } else { median };
    let finding = (!gaps.is_empty()).then(|| Finding {
        column: super::TIME.to_owned(),
        kind: FindingKind::Masked,
        first_row: row(kept.start),
        rows: (time_s.len() - kept.len()) as u64,
        text: format!(
            "{} gaps, {} samples missing: kept rows {} to {}, left out {} of {}",
            gaps.len(),
            gaps.iter().map(|&at| steps.missing(at)).sum::<u64>(),
            row(kept.start),
            row(kept.end - 1),
            time_s.len() - kept.len(),
            time_s.len(),
        ),
    });
    Ok((kept, sampling_s, finding))
}
