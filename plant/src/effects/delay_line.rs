//! Dead time for one signal, with no allocation once made.

/// Remembered points. They lie at least half an interval apart, so that all of them span the dead
/// time.
const POINTS: usize = 8192;

/// A signal's past, on a grid of its own, read back by straight lines.
#[derive(Clone, Debug)]
pub(crate) struct DelayLine {
    delay_s: f64,
    interval_s: f64,
    points: Vec<(f64, f64)>,
    newest: usize,
}

impl DelayLine {
    /// For a dead time; allocates all that it will ever need.
    pub(crate) fn new(delay_s: f64) -> Self {
        let points = vec![(f64::NEG_INFINITY, 0.0); POINTS];
        Self { delay_s, interval_s: 2.0 * delay_s / (POINTS - 8) as f64, points, newest: 0 }
    }

    /// Remembers the value at `time_s`, which must not decrease.
    pub(crate) fn push(&mut self, time_s: f64, value: f64) {
        let count = self.points.len();
        let before = (self.newest + count - 1) % count;
        // A point too near to the last but one replaces the last, so that the memory spans the dead
        // time.
        if time_s - self.points[before].0 >= self.interval_s {
            self.newest = (self.newest + 1) % count;
        }
        self.points[self.newest] = (time_s, value);
    }

    /// The value a dead time before `time_s`; the oldest known where nothing was pushed then, 0
    /// before the first.
    pub(crate) fn past(&self, time_s: f64) -> f64 {
        let wanted = time_s - self.delay_s;
        let count = self.points.len();
        let at = |offset: usize| self.points[(self.newest + 1 + offset) % count];
        let (mut low, mut high) = (0, count - 1);
        if at(high).0 <= wanted {
            return at(high).1;
        }
        if at(low).0 > wanted {
            return at(low).1;
        }
        // Times ascend from the oldest to the newest.
        while high - low > 1 {
            let middle = usize::midpoint(low, high);
            if at(middle).0 <= wanted {
                low = middle;
            } else {
                high = middle;
            }
        }
        let ((from, a), (to, b)) = (at(low), at(high));
        if from.is_finite() && to > from { a + (b - a) * (wanted - from) / (to - from) } else { a }
    }
}

#[cfg(test)]
mod tests {
    use super::DelayLine;

    #[test]
    fn a_delay_line_returns_past_values() {
        for step in [1e-6, 0.25e-3, 0.5e-3] {
            let mut line = DelayLine::new(0.010);
            for index in 0..40_000 {
                let time = f64::from(index) * step;
                line.push(time, time * 3.0);
                let expected = ((time - 0.010) * 3.0).max(0.0);
                let late = line.past(time);
                assert!((late - expected).abs() < 1e-4, "{step} {time}: {late} {expected}");
            }
        }
    }
}
