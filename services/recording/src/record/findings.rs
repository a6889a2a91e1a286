//! Detection of dead and saturated channels.

use std::io;

use crate::column::{Cursor, nth};

/// What a person should check.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Finding {
    /// Column.
    pub column: String,
    /// What it is.
    pub kind: FindingKind,
    /// First row concerned.
    pub first_row: u64,
    /// How many rows.
    pub rows: u64,
    /// In words.
    pub text: String,
}

/// Kinds of [`Finding`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingKind {
    /// The channel never changes.
    Dead,
    /// The channel stays at its extreme.
    Saturated,
    /// The position jumps from a row to the next.
    Jumping,
    /// Rows were left out because samples are missing.
    Masked,
    /// The record was replayed more than once; one pass was kept.
    Looped,
    /// Samples occur twice; the repetitions were left out.
    Repeated,
    /// The channel was present in a part of the record only; it was left out.
    Partial,
    /// The recording is truncated (its logger was killed, the disk was full): what came after is
    /// missing.
    Torn,
    /// Positions began to count from another zero; one stretch was kept.
    Rezeroed,
    /// Rows were resampled to another grid.
    Resampled,
}

/// Shortest run at the extreme that counts (samples).
const STAY: usize = 5;
/// Fewest samples at the extreme, over all runs.
const SAMPLES: usize = 20;
/// A clipped signal reaches its limit at speed; one that comes to rest there slows down first. The
/// step into the run must be at least this fraction of the median step ...
const SPEED: f64 = 0.3;
/// ... and this many times the smallest step (the resolution of an encoder or converter).
const RESOLUTION: f64 = 3.0;

pub(super) fn dead_or_saturated(
    column: &str,
    values: &mut Cursor<'_>,
    first_row: u64,
) -> io::Result<Vec<Finding>> {
    if values.is_empty() {
        return Ok(Vec::new());
    }
    let first = values.at(0)?;
    let (mut low, mut high, mut before) = (first, first, first);
    let (mut moving, mut smallest) = (0, f64::INFINITY);
    values.each(|value| {
        (low, high) = (low.min(value), high.max(value));
        let step = (value - before).abs();
        before = value;
        if step > 0.0 {
            smallest = smallest.min(step);
            moving += 1;
        }
    })?;
    if moving == 0 {
        return Ok(vec![Finding {
            column: column.to_owned(),
            kind: FindingKind::Dead,
            first_row,
            rows: values.len() as u64,
            text: format!(
                "never changes: {first} throughout; a dead channel, or one that was at rest"
            ),
        }]);
    }
    let median = nth(moving / 2, |take| {
        let mut before = first;
        values.each(|value| {
            let step = (value - before).abs();
            before = value;
            if step > 0.0 {
                take(step);
            }
        })
    })?;
    let fast = (SPEED * median).max(RESOLUTION * smallest);
    let mut found = Vec::new();
    for (extreme, name) in [(low, "lowest"), (high, "highest")] {
        let Stays { rows, longest, first_at } = stays_at(extreme, fast, values)?;
        if let Some(start) = first_at.filter(|_| rows >= SAMPLES) {
            found.push(Finding {
                column: column.to_owned(),
                kind: FindingKind::Saturated,
                first_row: first_row + start as u64,
                rows: rows as u64,
                text: format!(
                    "stays at its {name} value, {extreme}, in {rows} of {} samples, up to \
                        {longest} in a row, and reaches it at speed: saturated",
                    values.len()
                ),
            });
        }
    }
    Ok(found)
}

/// The runs at an extreme that count.
#[derive(Default)]
struct Stays {
    rows: usize,
    longest: usize,
    first_at: Option<usize>,
}

/// Finds the runs at an extreme into or out of which a step is at least `fast`.
fn stays_at(extreme: f64, fast: f64, values: &mut Cursor<'_>) -> io::Result<Stays> {
    let mut stays = Stays::default();
    let mut at = 0;
    while at < values.len() {
        if values.at(at)? != extreme {
            at += 1;
            continue;
        }
        let start = at;
        let into = if start > 0 { (extreme - values.at(start - 1)?).abs() } else { 0.0 };
        while at < values.len() && values.at(at)? == extreme {
            at += 1;
        }
        let out = if at < values.len() { (values.at(at)? - extreme).abs() } else { 0.0 };
        if at - start >= STAY && into.max(out) >= fast {
            stays.rows += at - start;
            stays.longest = stays.longest.max(at - start);
            stays.first_at = stays.first_at.or(Some(start));
        }
    }
    Ok(stays)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dead_or_saturated(column: &str, values: &[f64], first_row: u64) -> Vec<Finding> {
        super::dead_or_saturated(column, &mut Cursor::of(values), first_row).unwrap()
    }

    fn wave(n: usize) -> Vec<f64> {
        (0..n).map(|i| (i as f64 * 0.01).sin()).collect()
    }

    #[test]
    fn a_clipped_sine_is_saturated_and_an_unclipped_one_is_not() {
        assert_eq!(dead_or_saturated("x", &wave(5000), 2), vec![]);
        let clipped: Vec<f64> = wave(5000).iter().map(|v| v.min(0.8)).collect();
        let found = dead_or_saturated("x", &clipped, 2);
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].kind, found[0].first_row), (FindingKind::Saturated, 2 + 93));
    }

    #[test]
    fn a_movement_that_comes_to_rest_at_its_end_is_not_saturated() {
        // minimum jerk up, rest, and down, read by an encoder
        let shape = |s: f64| s * s * s * (10.0 + s * (6.0 * s - 15.0));
        let values: Vec<f64> = (0..4000)
            .map(|i| match i {
                0..1000 => shape(i as f64 / 1000.0),
                1000..3000 => 1.0,
                _ => shape((4000 - i) as f64 / 1000.0),
            })
            .map(|v| (v * 2000.0).round() / 2000.0)
            .collect();
        assert_eq!(dead_or_saturated("x", &values, 2), vec![]);
    }

    #[test]
    fn a_constant_is_dead() {
        assert_eq!(dead_or_saturated("x", &[0.25; 50], 2)[0].kind, FindingKind::Dead);
    }
}
