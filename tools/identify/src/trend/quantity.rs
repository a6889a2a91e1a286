//! What happened to one parameter over a series of recordings: nothing, steps, or a drift.

use serde::Serialize;

use super::calibration::Limits;
use super::change_points::{Costs, scatter};
use super::statistics::{Drift, Mean, Point, drift, median, weighted_mean};

/// How a quantity moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Movement {
    /// Too few recordings tell it.
    Unknown,
    /// Not beyond chance.
    Constant,
    /// By one step or several.
    Steps,
    /// Steadily.
    Drift,
}

/// A stretch of recordings in which a quantity stayed the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Its first point.
    pub from: usize,
    /// One past its last point.
    pub to: usize,
    /// Weighted mean.
    pub mean: Mean,
}

/// The history of one quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// How it moved.
    pub movement: Movement,
    /// Its levels: one, or several where it moved in steps.
    pub levels: Vec<Level>,
    /// Mean over all points.
    pub mean: Option<Mean>,
    /// Line through all points.
    pub drift: Option<Drift>,
    /// Its value at the last point, with the standard deviation: the last level, or the line's end.
    pub today: Option<(f64, f64)>,
    /// Median of the points' standard deviations.
    pub typical: f64,
}

/// The history of a quantity; a step or a drift is told that comes by chance with a probability of
/// at most `probability`.
///
/// A change below the typical standard deviation of a single recording is not told, however
/// significant: parameters that did not change follow one that did, within their errors.
pub fn history(points: &[Point], probability: f64) -> History {
    let mean = weighted_mean(points);
    let line = drift(points);
    let typical = median(points.iter().map(|point| point.deviation)).unwrap_or(f64::NAN);
    let level = |from: usize, to: usize| {
        weighted_mean(&points[from..to]).map(|mean| Level { from, to, mean })
    };
    let mut history = History {
        movement: Movement::Unknown,
        levels: level(0, points.len()).into_iter().collect(),
        mean,
        drift: line,
        today: mean.map(|mean| (mean.value, mean.deviation)),
        typical,
    };
    let Some(limits) = Limits::of(points, 0.5 * probability) else { return history };
    history.movement = Movement::Constant;
    let (costs, variance) = (Costs::of(points), scatter(points).powi(2));
    let mut changes = costs.partition(limits.penalty * variance);
    leave_out_small(&mut changes, &level, points.len(), typical);
    let span = points.last().map_or(0.0, |last| last.time - points[0].time);
    let line = line.filter(|own| own.t.abs() > limits.t && (own.slope * span).abs() >= typical);
    // Each model at its cost, by Bayes' criterion in the scale of the scatter: levels and places
    // of the steps against the two parameters of a line.
    let parameter = variance * (points.len() as f64).ln();
    let of_steps = costs.cost_of(&changes) + parameter * (2 * changes.len() + 1) as f64;
    let steps = !changes.is_empty();
    match line {
        Some(line) if !steps || line.squares + 2.0 * parameter < of_steps => {
            history.movement = Movement::Drift;
            history.today = Some((line.last, line.last_deviation));
        }
        _ if steps => {
            history.movement = Movement::Steps;
            history.levels = levels(&changes, points.len(), &level);
            history.today =
                history.levels.last().map(|last| (last.mean.value, last.mean.deviation));
        }
        _ => {}
    }
    history
}

/// The levels between change points.
fn levels(
    changes: &[usize],
    count: usize,
    level: &dyn Fn(usize, usize) -> Option<Level>,
) -> Vec<Level> {
    let mut from = 0;
    let ends = changes.iter().copied().chain([count]);
    ends.filter_map(|to| level(std::mem::replace(&mut from, to), to)).collect()
}

/// Leaves out steps smaller than `least`, the smallest first.
fn leave_out_small(
    changes: &mut Vec<usize>,
    level: &dyn Fn(usize, usize) -> Option<Level>,
    count: usize,
    least: f64,
) {
    while !changes.is_empty() {
        let levels = levels(changes, count, level);
        let steps = levels.windows(2).map(|pair| (pair[1].mean.value - pair[0].mean.value).abs());
        let smallest = steps.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        match smallest {
            Some((at, step)) if step < least => changes.remove(at),
            _ => return,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_noise::noise;

    /// Points at days, whose errors are a fifth of what they state.
    fn points(of: impl Fn(usize) -> f64) -> Vec<Point> {
        let noise = noise(11, 24);
        let point = |(at, noise): (usize, &f64)| Point {
            time: 3.0 * at as f64,
            value: of(at) + 0.4 * noise,
            deviation: 1.0,
        };
        noise.iter().enumerate().map(point).collect()
    }

    #[test]
    fn a_constant_stays_one_level() {
        let history = history(&points(|_| 50.0), 0.01);
        assert_eq!(history.movement, Movement::Constant);
        assert_eq!(history.levels.len(), 1);
        assert!((history.today.unwrap().0 - 50.0).abs() < 0.3, "{history:?}");
    }

    #[test]
    fn a_step_is_told_at_its_recording() {
        let history = history(&points(|at| if at < 9 { 50.0 } else { 55.0 }), 0.01);
        assert_eq!(history.movement, Movement::Steps);
        let ends: Vec<_> = history.levels.iter().map(|level| (level.from, level.to)).collect();
        assert_eq!(ends, [(0, 9), (9, 24)]);
        assert!((history.today.unwrap().0 - 55.0).abs() < 0.3, "{history:?}");
    }

    #[test]
    fn a_ramp_is_a_drift_and_no_flight_of_steps() {
        let history = history(&points(|at| 50.0 + 0.5 * at as f64), 0.01);
        assert_eq!(history.movement, Movement::Drift, "{history:?}");
        let line = history.drift.unwrap();
        assert!((line.slope - 0.5 / 3.0).abs() < 0.01, "{history:?}");
        assert!((history.today.unwrap().0 - 61.5).abs() < 0.5, "{history:?}");
    }

    #[test]
    fn a_step_within_the_errors_of_a_recording_is_not_told() {
        let history = history(&points(|at| if at < 9 { 50.0 } else { 50.7 }), 0.01);
        assert_eq!(history.movement, Movement::Constant, "{history:?}");
    }

    #[test]
    fn five_recordings_tell_no_change() {
        let few = &points(|at| 50.0 * at as f64)[..5];
        let history = history(few, 0.01);
        assert_eq!(history.movement, Movement::Unknown);
        assert!(super::history(&[], 0.01).today.is_none());
    }
}
