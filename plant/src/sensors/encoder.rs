//! An incremental encoder: position to counts, counts to its tracks.

/// An incremental encoder: counts are the position, quantised downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoder {
    /// Counts per rad (or per m), all edges counted; negative for an encoder that counts backwards.
    pub counts_per_unit: f64,
}

impl Encoder {
    /// An encoder of that many counts per turn.
    pub fn per_turn(counts: f64) -> Self {
        Self { counts_per_unit: counts / std::f64::consts::TAU }
    }

    /// Counts at a position, rad (or m). Saturates at the ends of `i64`; NaN reads 0.
    pub fn counts(&self, position: f64) -> i64 {
        (position * self.counts_per_unit).floor() as i64
    }

    /// Middle of the interval of positions that read `counts`.
    pub fn position(&self, counts: i64) -> f64 {
        (counts as f64 + 0.5) / self.counts_per_unit
    }
}

/// The two tracks of an incremental encoder and its index, as logic levels.
///
/// Track A leads track B when the count rises: A and B read 00, 10, 11, 01 over four counts. The
/// index is high over one count a turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Phases {
    /// Track A.
    pub a: bool,
    /// Track B.
    pub b: bool,
    /// Index.
    pub index: bool,
}

impl Phases {
    /// The levels at a count, with the index at every multiple of `counts_per_turn` (none for 0).
    pub fn at(counts: i64, counts_per_turn: u32) -> Self {
        let quarter = counts.rem_euclid(4);
        Self {
            a: quarter == 1 || quarter == 2,
            b: quarter >= 2,
            index: counts_per_turn > 0 && counts.rem_euclid(i64::from(counts_per_turn)) == 0,
        }
    }

    /// Place within the four counts of a period, 0 to 3.
    pub fn quarter(self) -> i64 {
        match (self.a, self.b) {
            (false, false) => 0,
            (true, false) => 1,
            (true, true) => 2,
            (false, true) => 3,
        }
    }
}
