//! Counters that follow encoders.

use rustix::io::Result;

use crate::device::{Device, Subdevice};
use crate::uapi::{channel_spec, config};

/// How a counter is made to follow an encoder. Drivers have no common way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CounterMode {
    /// It counts already.
    Counting,
    /// A counter of National Instruments' M series or 660x that counts each edge of A and B
    /// (`4`), two of them, or one. The subdevice is the counter.
    Quadrature(Edges),
    /// A counter of the Sensoray 626.
    S626,
}

/// Edges of a line of the encoder that are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Edges {
    /// One of four.
    One,
    /// Two of four.
    Two,
    /// All four.
    Four,
}

/// No source of a signal.
const NO_SOURCE: u32 = 0x8000;
/// The direction comes from the encoder's second signal.
const UP_DOWN_BY_HARDWARE: u32 = 0x200_0000;
/// Pins of National Instruments' counters that are given to A and to B.
const SIGNAL_A: u32 = 0;
const SIGNAL_B: u32 = 1;
const ARMED: u32 = 1;

/// A step of the configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Step {
    /// An instruction that configures the counter's channel.
    Configure(Vec<u32>),
    /// Writes to a channel of the counter.
    Write(u32, u32),
}

impl CounterMode {
    /// Starts a counter at the middle of its range.
    ///
    /// `inputs` are the terminals (PFI) of A and B, where the card lets them be chosen.
    ///
    /// # Errors
    /// The kernel's.
    pub fn start(
        self,
        device: &Device,
        counter: &Subdevice,
        channel: u32,
        inputs: Option<[u32; 2]>,
    ) -> Result<()> {
        let middle = middle(device.maxdata(counter, channel)?);
        for step in self.steps(channel, middle, inputs) {
            match step {
                Step::Configure(mut words) => {
                    device.configure(counter.number, channel_spec(channel, 0, 0), &mut words)?;
                }
                Step::Write(to, value) => {
                    device.write(counter.number, channel_spec(to, 0, 0), value)?;
                }
            }
        }
        Ok(())
    }

    fn steps(self, channel: u32, middle: u32, inputs: Option<[u32; 2]>) -> Vec<Step> {
        let edges = match self {
            Self::Counting => return Vec::new(),
            // The driver takes any word that the core lets pass for the count to begin with, which
            // the write sets.
            Self::S626 => {
                return vec![Step::Configure(vec![0]), Step::Write(channel, middle)];
            }
            Self::Quadrature(Edges::One) => 0x1_0000,
            Self::Quadrature(Edges::Two) => 0x2_0000,
            Self::Quadrature(Edges::Four) => 0x3_0000,
        };
        // Channels 0 to 2 of the counter: its count and the two registers that it is loaded from.
        // They may be written while it is not armed only.
        let mut steps = vec![Step::Configure(vec![config::RESET])];
        steps.extend((0..3).map(|register| Step::Write(register, middle)));
        for gate in [0, 1] {
            steps.push(Step::Configure(vec![config::GATE_SOURCE, gate, NO_SOURCE]));
        }
        if let Some([a, b]) = inputs {
            for (signal, input) in [(SIGNAL_A, a), (SIGNAL_B, b)] {
                let source = terminal(input);
                steps.push(Step::Configure(vec![config::OTHER_SOURCE, signal, source]));
            }
        }
        let mode = edges | UP_DOWN_BY_HARDWARE;
        steps.push(Step::Configure(vec![config::COUNTER_MODE, mode]));
        steps.push(Step::Configure(vec![config::ARM, 0]));
        steps
    }

    /// Whether a counter that was started before still counts, as far as the card tells.
    pub fn still_counts(self, device: &Device, counter: &Subdevice, channel: u32) -> bool {
        match self {
            Self::Counting | Self::S626 => true,
            Self::Quadrature(_) => {
                let mut words = [config::COUNTER_STATUS, 0, 0];
                let chanspec = channel_spec(channel, 0, 0);
                device.configure(counter.number, chanspec, &mut words).is_ok()
                    && words[1] & ARMED != 0
            }
        }
    }
}

/// How the driver names a terminal (PFI).
const fn terminal(pfi: u32) -> u32 {
    if pfi < 10 { pfi + 1 } else { pfi + 11 }
}

/// Middle of a counter's range.
const fn middle(maxdata: u32) -> u32 {
    maxdata / 2 + 1
}

/// A count beyond the range of its counter, which wraps.
#[derive(Clone, Copy, Debug)]
pub struct UnwrappedCount {
    range: i64,
    last: u32,
    count: i64,
}

impl UnwrappedCount {
    /// The count is 0 where the counter stands in the middle of its range, so that a successor
    /// finds the same count as long as it stays within ± half the range.
    pub fn new(maxdata: u32) -> Self {
        Self { range: i64::from(maxdata) + 1, last: middle(maxdata), count: 0 }
    }

    /// Takes what the counter shows, which may have moved by less than half its range, and returns
    /// the count.
    pub fn observe(&mut self, shown: u32) -> i64 {
        let forward = (i64::from(shown) - i64::from(self.last)).rem_euclid(self.range);
        let moved = if 2 * forward >= self.range { forward - self.range } else { forward };
        self.last = shown;
        self.count += moved;
        self.count
    }
}

/// The count at `tick` on the straight line between two that were read, rounded; the later one from
/// its tick on.
pub fn interpolated(before: (u64, i64), after: (u64, i64), tick: u64) -> i64 {
    let ((from, first), (to, last)) = (before, after);
    if tick >= to || to <= from {
        return last;
    }
    let share = tick.saturating_sub(from) as f64 / (to - from) as f64;
    first + ((last - first) as f64 * share).round() as i64
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_counter_of_the_m_series_is_started_step_by_step() {
        let steps = CounterMode::Quadrature(Edges::Four).steps(0, 0x8000_0000, Some([8, 10]));
        let configure = |words: &[u32]| Step::Configure(words.to_vec());
        assert_eq!(
            steps,
            [
                configure(&[34]),
                Step::Write(0, 0x8000_0000),
                Step::Write(1, 0x8000_0000),
                Step::Write(2, 0x8000_0000),
                configure(&[2001, 0, 0x8000]),
                configure(&[2001, 1, 0x8000]),
                configure(&[2005, 0, 9]),
                configure(&[2005, 1, 21]),
                configure(&[4097, 0x203_0000]),
                configure(&[31, 0]),
            ]
        );
        // fixed terminals
        let fixed = CounterMode::Quadrature(Edges::One).steps(0, 5, None);
        assert_eq!(fixed.len(), steps.len() - 2);
        assert!(fixed.contains(&configure(&[4097, 0x201_0000])));
    }

    #[test]
    fn other_counters_are_written_to_or_left_alone() {
        let steps = CounterMode::S626.steps(3, 0x80_0000, None);
        assert_eq!(steps, [Step::Configure(vec![0]), Step::Write(3, 0x80_0000)]);
        assert_eq!(CounterMode::Counting.steps(0, 1, None), []);
    }

    #[test]
    fn a_count_begins_at_the_middle_and_goes_on_over_the_ends() {
        let mut count = UnwrappedCount::new(0xffff);
        let shown = [0x8000, 0x8001, 0xffff, 0x0001, 0x7fff, 0xfffe, 0x8000];
        let counts = shown.map(|raw| count.observe(raw));
        assert_eq!(counts, [0, 1, 0x7fff, 0x8001, 0xffff, 0x1_7ffe, 0x1_0000]);
        // a successor
        assert_eq!(UnwrappedCount::new(0xffff).observe(0x8123), 0x123);
        assert_eq!(UnwrappedCount::new(0xffff).observe(0x7fff), -1);
        assert_eq!(UnwrappedCount::new(u32::MAX).observe(0x7fff_ffff), -1);
    }

    #[test]
    fn counts_between_two_readings_lie_on_a_line() {
        let at = |tick| interpolated((10, 100), (14, 110), tick);
        assert_eq!([10, 11, 12, 13, 14, 15].map(at), [100, 103, 105, 108, 110, 110]);
        assert_eq!(interpolated((14, 100), (14, 110), 14), 110);
    }

    proptest! {
        #[test]
        fn any_path_in_steps_below_half_the_range_is_followed(
            bits in 8u32..=32,
            steps in prop::collection::vec(-1.0..1.0f64, 1..50),
        ) {
            let maxdata = u32::MAX >> (32 - bits);
            let range = i64::from(maxdata) + 1;
            let mut count = UnwrappedCount::new(maxdata);
            let mut truth = 0i64;
            for step in steps {
                truth += (step * (range / 2 - 1) as f64) as i64;
                let shown = (truth + range / 2).rem_euclid(range) as u32;
                prop_assert_eq!(count.observe(shown), truth);
            }
        }

        #[test]
        fn interpolated_counts_stay_between_and_never_turn_back(
            first in -1_000_000i64..1_000_000,
            moved in -10_000i64..10_000,
            span in 1u64..500,
        ) {
            let at = |tick| interpolated((7, first), (7 + span, first + moved), tick);
            let counts: Vec<i64> = (7..=7 + span).map(at).collect();
            prop_assert_eq!((counts[0], counts[counts.len() - 1]), (first, first + moved));
            prop_assert!(counts.windows(2).all(|pair| (pair[1] - pair[0]) * moved.signum() >= 0));
        }
    }
}
