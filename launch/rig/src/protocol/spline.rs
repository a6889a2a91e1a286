//! A smooth curve through the points of a table: a cubic spline that begins and ends at rest.

/// A cubic spline: points in time, with the speeds that make position, speed and acceleration
/// continuous.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline {
    times_s: Vec<f64>,
    positions: Vec<f64>,
    speeds: Vec<f64>,
}

impl Spline {
    /// Interpolates points at increasing times; `None` unless there are at least two times and as
    /// many positions.
    pub fn through(times_s: Vec<f64>, positions: Vec<f64>) -> Option<Self> {
        let increasing = times_s.windows(2).all(|pair| pair[1] > pair[0]);
        let finite = times_s.iter().chain(&positions).all(|value| value.is_finite());
        if times_s.len() < 2 || times_s.len() != positions.len() || !increasing || !finite {
            return None;
        }
        let speeds = speeds(&times_s, &positions);
        Some(Self { times_s, positions, speeds })
    }

    /// Rest at 0.
    pub(super) fn rest() -> Self {
        Self { times_s: vec![0.0, 1.0], positions: vec![0.0; 2], speeds: vec![0.0; 2] }
    }

    /// Time from the first point to the last (s).
    pub fn duration_s(&self) -> f64 {
        self.times_s.last().unwrap_or(&0.0) - self.times_s.first().unwrap_or(&0.0)
    }

    /// Position of the first point.
    pub fn begin(&self) -> f64 {
        self.positions.first().copied().unwrap_or_default()
    }

    /// Position of the last point.
    pub fn end(&self) -> f64 {
        self.positions.last().copied().unwrap_or_default()
    }

    /// Position, speed and acceleration `time_s` after the first point; at rest before and after.
    pub fn at(&self, time_s: f64) -> (f64, f64, f64) {
        if time_s <= 0.0 {
            return (self.begin(), 0.0, 0.0);
        }
        if time_s >= self.duration_s() {
            return (self.end(), 0.0, 0.0);
        }
        let time_s = time_s + self.times_s.first().copied().unwrap_or_default();
        let index =
            self.times_s.partition_point(|knot| *knot <= time_s).clamp(1, self.times_s.len() - 1)
                - 1;
        let [c0, c1, c2, c3] = self.cubic(index);
        let t = time_s - self.times_s[index];
        (
            c0 + t * (c1 + t * (c2 + t * c3)),
            c1 + t * (2.0 * c2 + 3.0 * t * c3),
            2.0 * c2 + 6.0 * t * c3,
        )
    }

    /// Lowest and highest position, also between the points.
    pub fn range(&self) -> (f64, f64) {
        let mut range = (f64::INFINITY, f64::NEG_INFINITY);
        let mut take = |position: f64| range = (range.0.min(position), range.1.max(position));
        self.positions.iter().copied().for_each(&mut take);
        for index in 0..self.times_s.len() - 1 {
            let [c0, c1, c2, c3] = self.cubic(index);
            let length = self.times_s[index + 1] - self.times_s[index];
            // Where the speed c1 + 2 c2 t + 3 c3 t² passes through zero.
            let root = (c2 * c2 - 3.0 * c1 * c3).sqrt();
            for t in [(-c2 + root) / (3.0 * c3), (-c2 - root) / (3.0 * c3), -c1 / (2.0 * c2)] {
                if t > 0.0 && t < length {
                    take(c0 + t * (c1 + t * (c2 + t * c3)));
                }
            }
        }
        range
    }

    /// Highest speed, also between the points.
    pub fn peak_speed(&self) -> f64 {
        let mut peak = self.speeds.iter().copied().map(f64::abs).fold(0.0, f64::max);
        for index in 0..self.times_s.len() - 1 {
            let [_, c1, c2, c3] = self.cubic(index);
            let t = -c2 / (3.0 * c3);
            if t > 0.0 && t < self.times_s[index + 1] - self.times_s[index] {
                peak = peak.max((c1 + t * (2.0 * c2 + 3.0 * t * c3)).abs());
            }
        }
        peak
    }

    /// Coefficients of the powers of the time since point `index`.
    fn cubic(&self, index: usize) -> [f64; 4] {
        let length = self.times_s[index + 1] - self.times_s[index];
        let slope = (self.positions[index + 1] - self.positions[index]) / length;
        let (one, two) = (self.speeds[index], self.speeds[index + 1]);
        [
            self.positions[index],
            one,
            (3.0 * slope - 2.0 * one - two) / length,
            (one + two - 2.0 * slope) / (length * length),
        ]
    }
}

/// Speeds at the points for a continuous acceleration, 0 at both ends; solves the tridiagonal
/// system by Thomas's algorithm.
fn speeds(times_s: &[f64], positions: &[f64]) -> Vec<f64> {
    let count = times_s.len();
    let mut speeds = vec![0.0; count];
    let mut ratio = vec![0.0; count];
    let length = |index: usize| times_s[index + 1] - times_s[index];
    let slope = |index: usize| (positions[index + 1] - positions[index]) / length(index);
    for index in 1..count - 1 {
        let (before, after) = (1.0 / length(index - 1), 1.0 / length(index));
        let wanted = 3.0 * (before * slope(index - 1) + after * slope(index));
        let pivot = 2.0 * (before + after) - before * ratio[index - 1];
        ratio[index] = after / pivot;
        speeds[index] = (wanted - before * speeds[index - 1]) / pivot;
    }
    for index in (1..count - 1).rev() {
        speeds[index] -= ratio[index] * speeds[index + 1];
    }
    speeds
}

#[cfg(test)]
mod tests {
    use super::*;

    fn minimum_jerk(x: f64) -> (f64, f64, f64) {
        (
            x * x * x * (10.0 - 15.0 * x + 6.0 * x * x),
            30.0 * x * x * (1.0 - x) * (1.0 - x),
            60.0 * x * (1.0 - x) * (1.0 - 2.0 * x),
        )
    }

    #[test]
    fn converges_to_a_minimum_jerk_movement_with_the_fourth_power_of_the_spacing() {
        let error = |points: usize| {
            let times: Vec<_> = (0..=points).map(|k| k as f64 / points as f64).collect();
            let positions = times.iter().map(|time| minimum_jerk(*time).0).collect();
            let spline = Spline::through(times, positions).unwrap();
            (0..=1000)
                .map(|k| f64::from(k) / 1000.0)
                .map(|t| (spline.at(t).0 - minimum_jerk(t).0).abs())
                .fold(0.0, f64::max)
        };
        let order = (error(10) / error(20)).log2();
        assert!((3.5..4.5).contains(&order), "order {order}, error {}", error(10));
    }

    #[test]
    fn speed_and_acceleration_are_the_derivatives_and_range_and_peak_hold() {
        let times: Vec<f64> = vec![0.0, 0.3, 0.5, 1.4, 1.5, 2.2];
        let positions = vec![0.2, 1.0, -0.7, 0.4, 0.45, 0.1];
        let spline = Spline::through(times, positions).unwrap();
        let ((least, most), peak) = (spline.range(), spline.peak_speed());
        let (mut seen, mut fastest) = ((f64::INFINITY, f64::NEG_INFINITY), 0.0f64);
        let step = 1e-5;
        for k in 1..21_999 {
            let t = f64::from(k) * 1e-4;
            let [before, here, after] = [t - step, t, t + step].map(|t| spline.at(t));
            assert!(((after.0 - before.0) / (2.0 * step) - here.1).abs() < 1e-4, "{t}");
            assert!(
                ((after.1 - before.1) / (2.0 * step) - here.2).abs() < 0.1 + 1e-3 * here.2.abs(),
                "{t}"
            );
            seen = (seen.0.min(here.0), seen.1.max(here.0));
            fastest = fastest.max(here.1.abs());
        }
        assert!(
            (seen.0 - least).abs() < 1e-5 && (seen.1 - most).abs() < 1e-5,
            "{seen:?} {least} {most}"
        );
        assert!((fastest - peak).abs() < 1e-4 * peak, "{fastest} {peak}");
        assert_eq!((spline.at(-1.0), spline.at(9.0)), ((0.2, 0.0, 0.0), (0.1, 0.0, 0.0)));
    }

    #[test]
    fn an_invalid_table_has_no_spline() {
        assert!(Spline::through(vec![0.0], vec![1.0]).is_none());
        assert!(Spline::through(vec![0.0, 0.0], vec![1.0, 2.0]).is_none());
        assert!(Spline::through(vec![0.0, 1.0], vec![1.0]).is_none());
        assert!(Spline::through(vec![0.0, 1.0], vec![1.0, f64::NAN]).is_none());
    }
}
