//! Measurements of one block of cycles.

/// Error of the slave's position in a block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockError {
    /// Mean absolute error (rad or m), as in fig. 4.6B.
    pub mean_abs: f64,
    /// Root mean square (rad or m).
    pub rms: f64,
    /// Largest magnitude (rad or m).
    pub largest: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: usize,
    magnitude: f64,
    square: f64,
    largest: f64,
}

impl Sums {
    fn add(&mut self, error: f64) {
        self.count += 1;
        self.magnitude += error.abs();
        self.square += error * error;
        self.largest = self.largest.max(error.abs());
    }

    fn error(&self) -> Option<BlockError> {
        let count = self.count as f64;
        (self.count > 0).then(|| BlockError {
            mean_abs: self.magnitude / count,
            rms: (self.square / count).sqrt(),
            largest: self.largest,
        })
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

    /// Error over the whole block, and over its settled cycles.
    pub(crate) fn errors(&self) -> Option<(BlockError, BlockError)> {
        Some((self.whole.error()?, self.settled.error()?))
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
