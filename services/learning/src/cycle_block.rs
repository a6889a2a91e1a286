//! Measurements of one block of cycles.

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: usize,
    magnitude: f64,
}

impl Sums {
    fn add(&mut self, error: f64) {
        self.count += 1;
        self.magnitude += error.abs();
    }

    fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.magnitude / self.count as f64)
    }
}

/// Averages the slave's path over a block. Counts and ignores values that are not finite.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    sums: Vec<f64>,
    counts: Vec<u32>,
    whole: Sums,
    settled: Sums,
    not_finite: usize,
}

impl Block {
    pub(crate) fn new(samples: usize) -> Self {
        Self {
            sums: vec![0.0; samples],
            counts: vec![0; samples],
            whole: Sums::default(),
            settled: Sums::default(),
            not_finite: 0,
        }
    }

    /// Records the slave's position at a step of the cycle. `settled`: the transient after the
    /// update of the reference has decayed.
    pub(crate) fn record(&mut self, step: usize, slave: f64, desired: f64, settled: bool) {
        let error = desired - slave;
        if !error.is_finite() {
            self.not_finite += 1;
            return;
        }
        self.whole.add(error);
        if settled
            && let (Some(sum), Some(count)) = (self.sums.get_mut(step), self.counts.get_mut(step))
        {
            *sum += slave;
            *count += 1;
            self.settled.add(error);
        }
    }

    /// Mean absolute error over the whole block, and over its settled cycles (rad or m).
    pub(crate) fn errors(&self) -> Option<(f64, f64)> {
        Some((self.whole.mean()?, self.settled.mean()?))
    }

    /// Number of values that were not finite.
    pub(crate) fn not_finite(&self) -> usize {
        self.not_finite
    }

    /// Number of steps of the cycle without a value in any settled cycle.
    pub(crate) fn missing(&self) -> usize {
        self.counts.iter().filter(|count| **count == 0).count()
    }

    /// Writes the slave's mean path over the settled cycles; requires that none is
    /// [`Block::missing`].
    pub(crate) fn path(&self, path: &mut [f64]) {
        for ((value, sum), count) in path.iter_mut().zip(&self.sums).zip(&self.counts) {
            *value = sum / f64::from((*count).max(1));
        }
    }

    pub(crate) fn clear(&mut self) {
        self.sums.fill(0.0);
        self.counts.fill(0);
        (self.whole, self.settled, self.not_finite) = (Sums::default(), Sums::default(), 0);
    }
}
