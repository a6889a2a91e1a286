//! The counter card behind an encoder: quadrature decoder, counter with wrap and index latch, and
//! unwrapping.

use super::{Encoder, Phases};
use crate::parameter::parameter_set;
use crate::{ParameterError, ParameterSet};

/// Counts the edges of two tracks in quadrature, all four a period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QuadratureDecoder {
    counts: i64,
    last: Phases,
    index_at: Option<i64>,
    missed: u64,
}

impl QuadratureDecoder {
    /// Starts at a count with the present levels.
    pub fn new(counts: i64, phases: Phases) -> Self {
        Self { counts, last: phases, index_at: None, missed: 0 }
    }

    /// Takes the present levels and returns the count.
    ///
    /// Both tracks changing at once means that an edge was missed and the direction is unknown: the
    /// count stays, and [`QuadratureDecoder::missed`] counts it. Four edges missed at once go
    /// unseen.
    pub fn update(&mut self, phases: Phases) -> i64 {
        match (phases.quarter() - self.last.quarter()).rem_euclid(4) {
            1 => self.counts += 1,
            3 => self.counts -= 1,
            2 => self.missed += 1,
            _ => {}
        }
        if phases.index && !self.last.index {
            self.index_at = Some(self.counts);
        }
        self.last = phases;
        self.counts
    }

    /// The count at which the index last came, if it did.
    pub fn index_at(&self) -> Option<i64> {
        self.index_at
    }

    /// How often both tracks changed at once.
    pub fn missed(&self) -> u64 {
        self.missed
    }
}

parameter_set! {
    /// An encoder and the counter that it drives.
    #[derive(PartialEq)]
    pub struct EncoderCounterParameters {
        /// Counts per turn, all edges counted (a whole number).
        counts_per_turn: "1", 4.0, 4e9, 20_000.0, "§ 5.1: 5000 lines per turn, four edges each";
        /// Width of the counter (a whole number).
        bits: "bit", 4.0, 32.0, 32.0, "assumed: APCI-1710, 32 bit";
        /// Sign of the count over that of the position, 1 or -1.
        direction: "1", -1.0, 1.0, 1.0, "choice of wiring";
        /// Count at position 0 (a whole number): where the index lies is a matter of assembly.
        count_at_zero: "1", -4e9, 4e9, 0.0, "choice of assembly";
    }
}

/// Largest count followed; leaves room for turns and offset in `i64`.
const FARTHEST: i64 = 1 << 61;

/// What the counter card returns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CounterReading {
    /// The counter, wrapped to its width.
    pub raw: u32,
    /// The counter as it was when the index last came, wrapped; 0 before the first.
    pub latched: u32,
    /// How often the index came since the counter was made, wrapped at 2³².
    pub latches: u32,
}

/// An encoder on a counter card. The card's hardware sees every edge, however seldom it is read.
///
/// A position that is not finite leaves the counter unchanged.
#[derive(Clone, Debug)]
pub struct EncoderCounter {
    encoder: Encoder,
    counts_per_turn: i64,
    count_at_zero: i64,
    mask: u64,
    counts: Option<i64>,
    reading: CounterReading,
}

impl EncoderCounter {
    /// A counter before its first reading, which returns the position without a latch.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`].
    pub fn new(parameters: &EncoderCounterParameters) -> Result<Self, ParameterError> {
        parameters.check()?;
        let counts_per_turn = parameters.counts_per_turn.round();
        let bits = parameters.bits.round() as u32;
        Ok(Self {
            encoder: Encoder::per_turn(if parameters.direction < 0.0 {
                -counts_per_turn
            } else {
                counts_per_turn
            }),
            counts_per_turn: counts_per_turn as i64,
            count_at_zero: parameters.count_at_zero.round() as i64,
            mask: (1_u64 << bits) - 1,
            counts: None,
            reading: CounterReading::default(),
        })
    }

    /// The encoder.
    pub fn encoder(&self) -> Encoder {
        self.encoder
    }

    /// Moves to a position (rad, or m) straight from the one before, and reads the counter.
    ///
    /// The index lies at every multiple of the counts per turn; its edge comes on entering that
    /// count, from either side.
    pub fn read(&mut self, position: f64) -> CounterReading {
        if position.is_nan() {
            return self.reading;
        }
        let now = self.encoder.counts(position).clamp(-FARTHEST, FARTHEST) + self.count_at_zero;
        if let Some(before) = self.counts {
            let turn = self.counts_per_turn;
            // Index counts entered: multiples of a turn in (before, now], or in [now, before) when
            // going back.
            let (entered, last) = if now >= before {
                (now.div_euclid(turn) - before.div_euclid(turn), now.div_euclid(turn) * turn)
            } else {
                let (first, end) =
                    ((now - 1).div_euclid(turn) + 1, (before - 1).div_euclid(turn) + 1);
                (end - first, first * turn)
            };
            if entered > 0 {
                self.reading.latched = self.wrap(last);
                self.reading.latches = self.reading.latches.wrapping_add(entered as u32);
            }
        }
        self.counts = Some(now);
        self.reading.raw = self.wrap(now);
        self.reading
    }

    fn wrap(&self, counts: i64) -> u32 {
        (counts as u64 & self.mask) as u32
    }
}

/// Undoes the wrap of a counter: right as long as less than half its range passes between two
/// readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unwrap {
    shift: u32,
    last: Option<u32>,
    counts: i64,
}

impl Unwrap {
    /// For a counter of that many bits, 1 to 32; others are taken to the nearest end.
    pub fn new(bits: u32) -> Self {
        Self { shift: 32 - bits.clamp(1, 32), last: None, counts: 0 }
    }

    /// The unwrapped count of a reading. The first is taken as signed.
    pub fn update(&mut self, raw: u32) -> i64 {
        // Shifted to the top, the difference wraps as the counter does, and the arithmetic shift
        // brings its sign back.
        let change = raw.wrapping_sub(self.last.unwrap_or(0));
        self.counts += i64::from((change << self.shift) as i32 >> self.shift);
        self.last = Some(raw);
        self.counts
    }

    /// The count that a latched reading stands for: the one nearest to the last count.
    pub fn nearby(&self, latched: u32) -> i64 {
        let change = latched.wrapping_sub(self.last.unwrap_or(0));
        self.counts + i64::from((change << self.shift) as i32 >> self.shift)
    }
}
