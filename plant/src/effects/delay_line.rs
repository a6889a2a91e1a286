//! Dead time for one signal, with no allocation once made.

/// Remembered points; dead time over this is the resolution.
const POINTS: usize = 1024;

/// A signal's past, on a grid of its own, read back by straight lines.
#[derive(Clone, Debug)]
pub(crate) struct DelayLine {
    delay_s: f64,
    interval_s: f64,
    points: Vec<(f64, f64)>,
    newest: usize,
}

impl DelayLine {
    /// For a dead time; before it has passed, the first value is given back.
    pub(crate) fn new(delay_s: f64) -> Self {
        Self { delay_s, interval_s: delay_s / (POINTS - 8) as f64, points: Vec::with_capacity(POINTS), newest: 0 }
    }

    /// Puts in the value at `time_s` (not decreasing) and takes out that of a dead time before.
    pub(crate) fn push(&mut self, time_s: f64, value: f64) -> f64 {
        if self.delay_s <= 0.0 {
            return value;
        }
        if self.points.is_empty() {
            self.points.resize(POINTS, (time_s, value));
        }
        let count = self.points.len();
        let before = (self.newest + count - 1) % count;
        // A point that is too near to the last but one replaces the last, so that the memory spans the dead time.
        if time_s - self.points[before].0 >= self.interval_s {
            self.newest = (self.newest + 1) % count;
        }
        self.points[self.newest] = (time_s, value);
        let wanted = time_s - self.delay_s;
        // Walk back by halves: times ascend from the oldest to the newest.
        let oldest = self.newest + 1;
        let at = |offset: usize| self.points[(oldest + offset) % count];
        let (mut low, mut high) = (0, count - 1);
        if at(low).0 >= wanted {
            return at(low).1;
        }
        while high - low > 1 {
            let middle = usize::midpoint(low, high);
            if at(middle).0 <= wanted {
                low = middle;
            } else {
                high = middle;
            }
        }
        let ((from, a), (to, b)) = (at(low), at(high));
        if to > from { a + (b - a) * (wanted - from) / (to - from) } else { b }
    }
}

#[cfg(test)]
mod tests {
    use super::DelayLine;

    #[test]
    fn gives_back_the_past() {
        for step in [1e-6, 0.25e-3, 0.5e-3] {
            let mut line = DelayLine::new(0.010);
            for index in 0..40_000 {
                let time = f64::from(index) * step;
                let late = line.push(time, time * 3.0);
                let expected = ((time - 0.010) * 3.0).max(0.0);
                assert!((late - expected).abs() < 1e-4, "{step} {time}: {late} {expected}");
            }
        }
    }
}
