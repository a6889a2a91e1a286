//! When the machine departs from the model: the innovation's energy against its baseline, by a
//! cumulative sum, which notices whatever it is; and the score of the listed changes
//! ([`crate::score`]), which notices those when they are smaller.

use ipc_types::{MODEL_DEPARTURE_SCORE, MODEL_DEPARTURE_SUM};

use crate::bank::CHANNELS;
use crate::score::Score;

/// Energy that the machine may have more than in the baseline, as the logarithm of the ratio: the
/// innovation depends somewhat on the movement. It is 2.5 times the baseline's spread where that is
/// more.
const SLACK: f64 = 0.9;
const SPREADS: f64 = 2.5;
/// Most that one block adds: it alone is no departure.
const MOST: f64 = 1.5;
/// It has come back after so many blocks in a row within the slack.
const BACK: u32 = 20;

/// The innovation of a machine that is as it should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Baseline {
    /// Standard deviation by channel (rad).
    pub deviation_rad: [f64; CHANNELS],
    /// Standard deviation of the logarithm of a block's energy, by channel.
    pub spread: [f64; CHANNELS],
}

impl Baseline {
    /// From the energies of some blocks (rad²); `None` without blocks.
    pub fn of(blocks: &[[f64; CHANNELS]]) -> Option<Self> {
        if blocks.is_empty() {
            return None;
        }
        let count = blocks.len() as f64;
        let mut own = Self { deviation_rad: [0.0; CHANNELS], spread: [0.0; CHANNELS] };
        for channel in 0..CHANNELS {
            let logarithm = |block: &[f64; CHANNELS]| block[channel].max(f64::MIN_POSITIVE).ln();
            let mean = blocks.iter().map(logarithm).sum::<f64>() / count;
            let square = |block| (logarithm(block) - mean).powi(2);
            own.deviation_rad[channel] = (0.5 * mean).exp();
            own.spread[channel] = (blocks.iter().map(square).sum::<f64>() / count).sqrt();
        }
        Some(own)
    }
}

/// What a block has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// As in the baseline.
    Steady,
    /// More than in the baseline, not yet for long enough.
    Suspicious,
    /// It departs with this block.
    Departs,
    /// It departed before.
    Departed,
    /// It is back since this block.
    Returns,
}

/// The cumulative sums of one axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Detector {
    sums: [f64; CHANNELS],
    departed: bool,
    within: u32,
    /// Blocks since the sum left 0, or what is shown began.
    since: u32,
}

impl Detector {
    /// The sums, by channel; above 2.5 the machine has departed.
    pub const fn sums(&self) -> [f64; CHANNELS] {
        self.sums
    }

    /// Whether the machine has departed.
    pub const fn departed(&self) -> bool {
        self.departed
    }

    /// Blocks since the departure began, the newest included; 0 where there is none.
    pub const fn blocks(&self) -> u32 {
        self.since
    }

    /// Takes the energy of a block and what it may have beside the baseline (rad²), and the score
    /// with it.
    pub fn take(
        &mut self,
        energy: [f64; CHANNELS],
        expected: [f64; CHANNELS],
        score: Score,
        baseline: &Baseline,
    ) -> Verdict {
        // What was noticed is there until it shows half as much.
        let least = if self.departed { 0.5 } else { 1.0 } * MODEL_DEPARTURE_SCORE;
        let shown = score.ratio > least;
        let mut beyond = shown;
        for (channel, energy) in energy.into_iter().enumerate() {
            let usual = baseline.deviation_rad[channel].powi(2) + expected[channel];
            let usual = usual.max(f64::MIN_POSITIVE);
            let ratio = (energy.max(f64::MIN_POSITIVE) / usual).ln();
            let more = ratio - SLACK.max(SPREADS * baseline.spread[channel]);
            beyond |= more > 0.0;
            self.sums[channel] = (self.sums[channel] + more.min(MOST)).max(0.0);
        }
        let largest = self.sums.iter().copied().fold(0.0, f64::max);
        self.within = if beyond { 0 } else { self.within + 1 };
        if self.departed {
            self.since += 1;
            if self.within < BACK {
                return Verdict::Departed;
            }
            *self = Self::default();
            return Verdict::Returns;
        }
        self.since = if largest > 0.0 { self.since + 1 } else { 0 };
        if shown || largest > MODEL_DEPARTURE_SUM {
            self.departed = true;
            if shown {
                self.since = self.since.max(score.blocks as u32);
            }
            return Verdict::Departs;
        }
        if largest > 0.0 { Verdict::Suspicious } else { Verdict::Steady }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const USUAL: Baseline = Baseline { deviation_rad: [1e-3, 2e-3], spread: [0.1, 0.1] };

    const NONE: Score = Score { ratio: 0.5, blocks: 3 };
    const NOTHING: [f64; CHANNELS] = [0.0; CHANNELS];

    fn energy(master: f64, slave: f64) -> [f64; CHANNELS] {
        [master * 1e-6, slave * 4e-6]
    }

    #[test]
    fn a_baseline_is_the_mean_of_logarithms() {
        let blocks = [[1e-6, 4e-6], [4e-6, 4e-6]];
        let baseline = Baseline::of(&blocks).unwrap();
        assert!((baseline.deviation_rad[0] - 2f64.sqrt() * 1e-3).abs() < 1e-12);
        assert!((baseline.spread[0] - 2f64.ln()).abs() < 1e-12);
        assert_eq!(baseline.spread[1], 0.0);
        assert_eq!(Baseline::of(&[]), None);
    }

    #[test]
    fn one_large_block_is_no_departure_and_two_are() {
        let mut detector = Detector::default();
        assert_eq!(detector.take(energy(1.0, 1e6), NOTHING, NONE, &USUAL), Verdict::Suspicious);
        assert_eq!(detector.take(energy(1.0, 1.0), NOTHING, NONE, &USUAL), Verdict::Suspicious);
        while detector.take(energy(1.0, 1.0), NOTHING, NONE, &USUAL) != Verdict::Steady {}
        assert_eq!(detector.take(energy(9.0, 1.0), NOTHING, NONE, &USUAL), Verdict::Suspicious);
        assert_eq!(detector.take(energy(9.0, 1.0), NOTHING, NONE, &USUAL), Verdict::Departs);
        assert_eq!((detector.blocks(), detector.sums()[1]), (2, 0.0));
    }

    #[test]
    fn within_the_slack_nothing_adds_up() {
        let mut detector = Detector::default();
        for _ in 0..10_000 {
            assert_eq!(detector.take(energy(1.5, 1.5), NOTHING, NONE, &USUAL), Verdict::Steady);
        }
        assert_eq!(detector.sums(), [0.0, 0.0]);
    }

    #[test]
    fn what_the_calibration_does_not_know_yet_is_expected() {
        let mut detector = Detector::default();
        for _ in 0..100 {
            let verdict = detector.take(energy(9.0, 1.0), energy(8.0, 0.0), NONE, &USUAL);
            assert_eq!(verdict, Verdict::Steady);
        }
    }

    #[test]
    fn what_shows_is_a_departure_though_its_energy_is_usual() {
        let mut detector = Detector::default();
        let shown = Score { ratio: 1.1 * MODEL_DEPARTURE_SCORE, blocks: 6 };
        assert_eq!(detector.take(energy(1.0, 1.0), NOTHING, NONE, &USUAL), Verdict::Steady);
        assert_eq!(detector.take(energy(1.0, 1.0), NOTHING, shown, &USUAL), Verdict::Departs);
        assert_eq!(detector.blocks(), 6);
        for _ in 0..2 * BACK {
            assert_eq!(detector.take(energy(1.0, 1.0), NOTHING, shown, &USUAL), Verdict::Departed);
        }
    }

    #[test]
    fn it_is_back_after_ten_seconds_as_before() {
        let mut detector = Detector::default();
        while detector.take(energy(9.0, 1.0), NOTHING, NONE, &USUAL) != Verdict::Departs {}
        for _ in 1..BACK {
            assert_eq!(detector.take(energy(1.0, 1.0), NOTHING, NONE, &USUAL), Verdict::Departed);
        }
        assert_eq!(detector.take(energy(1.0, 1.0), NOTHING, NONE, &USUAL), Verdict::Returns);
        assert_eq!(detector, Detector::default());
    }
}
