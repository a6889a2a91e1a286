//! Reduces samples to the columns of a screen: of each column the least and the largest value, so
//! that no spike is lost in drawing. A gap in the samples stays one.

use crate::scope::ring::Point;

/// Samples within one column, without interruption.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Run {
    /// From 0.
    pub(crate) column: usize,
    /// Least and largest value.
    pub(crate) low: f64,
    pub(crate) high: f64,
    /// First and last value.
    pub(crate) first: f64,
    pub(crate) last: f64,
    /// Whether it continues the run before.
    pub(crate) joined: bool,
    /// Messages that are missing before it; 0 where its sender was started anew.
    pub(crate) gap: Option<u64>,
}

/// The samples of a window of time (ns, both ends included), in that many columns. Several runs of
/// one column are separated by gaps.
pub(crate) fn runs(
    points: impl Iterator<Item = Point>,
    begin_ns: u64,
    end_ns: u64,
    columns: usize,
) -> Vec<Run> {
    let span = u128::from(end_ns.saturating_sub(begin_ns).max(1));
    let last_column = columns.max(1) - 1;
    let mut runs: Vec<Run> = Vec::new();
    let mut interrupted = true;
    let mut gap = None;
    for point in points.filter(|point| (begin_ns..=end_ns).contains(&point.time_ns)) {
        if let Some(missing) = point.gap {
            interrupted = true;
            gap = Some(gap.unwrap_or(0) + missing);
        }
        if !point.value.is_finite() {
            interrupted = true;
            continue;
        }
        let into = u128::from(point.time_ns - begin_ns);
        let column = ((into * columns as u128 / span) as usize).min(last_column);
        let value = point.value;
        match runs.last_mut().filter(|run| run.column == column && !interrupted) {
            Some(run) => {
                (run.low, run.high) = (run.low.min(value), run.high.max(value));
                run.last = value;
            }
            None => runs.push(Run {
                column,
                low: value,
                high: value,
                first: value,
                last: value,
                joined: !interrupted,
                gap: gap.take(),
            }),
        }
        interrupted = false;
    }
    runs
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point(time_ns: u64, value: f64) -> Point {
        Point { time_ns, value, gap: None }
    }

    #[test]
    fn a_spike_of_one_sample_is_in_its_column() {
        let points = (0..1000).map(|at| point(at, if at == 437 { 9.0 } else { 0.0 }));
        let runs = runs(points, 0, 1000, 10);
        assert_eq!(runs.len(), 10);
        let highest: Vec<_> = runs.iter().map(|run| run.high).collect();
        assert_eq!(highest, [0.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(!runs[0].joined && runs[1..].iter().all(|run| run.joined && run.gap.is_none()));
    }

    #[test]
    fn a_gap_within_a_column_parts_it() {
        let after = Point { gap: Some(4), ..point(16, 5.0) };
        let points = [point(10, 1.0), point(11, 2.0), after, point(17, 6.0)];
        let runs = runs(points.into_iter(), 0, 100, 5);
        assert_eq!(runs.len(), 2);
        assert_eq!((runs[0].low, runs[0].high, runs[0].gap), (1.0, 2.0, None));
        assert_eq!((runs[1].low, runs[1].high, runs[1].gap), (5.0, 6.0, Some(4)));
        assert!(!runs[1].joined && runs[1].column == 0);
    }

    #[test]
    fn what_is_not_finite_is_not_drawn_across() {
        let points = [point(0, 1.0), point(50, f64::NAN), point(99, 2.0), point(100, 3.0)];
        let runs = runs(points.into_iter(), 0, 100, 4);
        let drawn: Vec<_> = runs.iter().map(|run| (run.column, run.joined)).collect();
        assert_eq!(drawn, [(0, false), (3, false)]);
        assert_eq!((runs[1].first, runs[1].last), (2.0, 3.0));
    }

    proptest! {
        /// The bounds of each column are those of its samples; all samples are in one.
        #[test]
        fn bounds_are_those_of_the_samples(
            values in prop::collection::vec(-1e6..1e6f64, 1..300),
            gaps in prop::collection::vec(0..10u8, 300),
            columns in 1..50usize,
            begin in 0..100u64,
        ) {
            let points: Vec<Point> = values
                .iter()
                .zip(&gaps)
                .enumerate()
                .map(|(at, (value, gap))| Point {
                    time_ns: begin + at as u64,
                    value: *value,
                    gap: (*gap == 0).then_some(1),
                })
                .collect();
            let end = begin + values.len() as u64 - 1;
            let runs = runs(points.iter().copied(), begin, end, columns);
            let span = (end - begin).max(1);
            for column in 0..columns {
                let of_column = |point: &&Point| {
                    let into = (point.time_ns - begin) as u128 * columns as u128;
                    (into / u128::from(span)).min(columns as u128 - 1) == column as u128
                };
                let bounds = |values: &mut dyn Iterator<Item = f64>| {
                    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                        (low.min(value), high.max(value))
                    })
                };
                let mut own = points.iter().filter(of_column).map(|point| point.value);
                let mut drawn = runs
                    .iter()
                    .filter(|run| run.column == column)
                    .flat_map(|run| [run.low, run.high]);
                prop_assert_eq!(bounds(&mut own), bounds(&mut drawn));
            }
            let lost: u64 = runs.iter().filter_map(|run| run.gap).sum();
            prop_assert_eq!(lost, points.iter().filter_map(|point| point.gap).sum::<u64>());
        }
    }
}
