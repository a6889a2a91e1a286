//! Checks that time is uniform, and finds gaps.

use std::ops::Range;

use super::{Finding, FindingKind, Gaps, Options, Problem};

/// A step of at least this multiple of the median is a gap; a smaller one is jitter.
const GAP: f64 = 1.5;

/// Returns the rows to keep, their mean sampling time (s), and a finding where rows were left out.
pub(super) fn uniform(
    time_s: &[f64],
    rows: &[u64],
    options: &Options,
) -> Result<(Range<usize>, f64, Option<Finding>), Problem> {
    let row = |index: usize| rows.get(index).copied().unwrap_or(index as u64 + 1);
    let steps: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if let Some(at) = steps.iter().position(|&step| step <= 0.0) {
        return Err(Problem::TimeBackwards {
            row: row(at + 1),
            before: time_s[at],
            after: time_s[at + 1],
        });
    }
    let mut sorted = steps.clone();
    let middle = sorted.len() / 2;
    let (_, &mut median, _) = sorted.select_nth_unstable_by(middle, f64::total_cmp);
    let gaps: Vec<usize> = (0..steps.len()).filter(|&i| steps[i] >= GAP * median).collect();
    let missing = |at: usize| (steps[at] / median).round() as u64 - 1;
    if let (Some(&at), Gaps::Refuse) = (gaps.first(), options.gaps) {
        return Err(Problem::Gap {
            row: row(at + 1),
            before: time_s[at],
            after: time_s[at + 1],
            missing: missing(at),
            sampling_s: median,
            gaps: gaps.len(),
        });
    }
    let (mut kept, mut start) = (0..0, 0);
    for end in gaps.iter().map(|&at| at + 1).chain([time_s.len()]) {
        if end - start > kept.len() {
            kept = start..end;
        }
        start = end;
    }
    let kept_steps = steps.iter().enumerate().take(kept.end.saturating_sub(1)).skip(kept.start);
    for (at, &step) in kept_steps {
        if (step - median).abs() > options.time_tolerance * median {
            return Err(Problem::NotUniform {
                row: row(at + 1),
                expected_s: median,
                found_s: step,
                tolerance_percent: options.time_tolerance * 100.0,
            });
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
            gaps.iter().map(|&at| missing(at)).sum::<u64>(),
            row(kept.start),
            row(kept.end - 1),
            time_s.len() - kept.len(),
            time_s.len(),
        ),
    });
    Ok((kept, sampling_s, finding))
}
