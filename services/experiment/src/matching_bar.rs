//! The bars of a matching experiment: what they compare, and how high they are (appendix, part C).

use ipc_types::{ANALOG, AXES, BAR_MIDDLE, BARS};
use rig::protocol::Signal;

/// Largest height; the bar's field is 20 high.
pub const HIGHEST: f64 = 19.0;
/// Least target, so that a session without effort does not divide by zero; the appendix's first
/// target.
pub const LEAST_TARGET: f64 = 1e-4;
/// Intervals over which the activity of a muscle is averaged.
const INTERVALS: usize = 3;

/// Height of a bar, 0 to [`HIGHEST`]: [`BAR_MIDDLE`] where the value is the target's.
pub fn height(value: f64, target: f64) -> f64 {
    (BAR_MIDDLE * value / target.max(LEAST_TARGET)).clamp(0.0, HIGHEST)
}

/// Heights of the bars.
pub fn heights(values: [f64; BARS], targets: [f64; BARS]) -> [f64; BARS] {
    std::array::from_fn(|bar| height(values[bar], targets[bar]))
}

/// The effort in one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effort {
    /// When the card took the sample (ns, CLOCK_MONOTONIC).
    pub at_ns: u64,
    /// Tick of acquisition.
    pub tick: u64,
    /// Torque of the hand (N·m or N), 0 for an axis without a sensor.
    pub torque: [f64; AXES],
    /// Activity of agonists and antagonists, in the unit of their channels or as a share of their
    /// maxima; NaN where it is not known.
    pub activity: [f64; BARS],
    /// The rectified signal at each input, in its channel's unit; NaN where there is no electrode.
    pub rectified: [f64; ANALOG],
}

/// Sums of effort over samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Samples in the sums.
    pub samples: u64,
    /// Samples that are missing between them.
    pub missed: u64,
    /// Sum of the magnitudes of the torque (N·m or N).
    pub torque: [f64; AXES],
    /// Sums of the activity of agonists and antagonists.
    pub activity: [f64; BARS],
}

impl Sums {
    /// Adds a sample; of the activity, what is known.
    pub fn add(&mut self, effort: &Effort) {
        self.samples += 1;
        for (sum, torque) in self.torque.iter_mut().zip(effort.torque) {
            *sum += torque.abs();
        }
        for (sum, activity) in self.activity.iter_mut().zip(effort.activity) {
            if activity.is_finite() {
                *sum += activity;
            }
        }
    }

    /// The mean activity of each group since earlier sums; 0 without samples.
    fn activity_since(&self, earlier: &Self) -> [f64; BARS] {
        let samples = self.samples.saturating_sub(earlier.samples);
        let mut means = [0.0; BARS];
        for ((mean, now), before) in means.iter_mut().zip(self.activity).zip(earlier.activity) {
            *mean = mean_of(now - before, samples);
        }
        means
    }
}

fn mean_of(sum: f64, samples: u64) -> f64 {
    if samples == 0 { 0.0 } else { sum / samples as f64 }
}

/// What a matching experiment compares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matched {
    /// Torque, or the activity of two groups of muscles.
    pub signal: Signal,
    /// The axis whose torque it is.
    pub axis: usize,
}

impl Matched {
    /// Time between two updates of the bar (ns).
    pub const fn period_ns(self) -> u64 {
        match self.signal {
            Signal::Torque => 1_000_000_000,
            Signal::Emg => 500_000_000,
        }
    }

    /// Whether a sample has what is compared.
    pub fn is_in(self, effort: &Effort) -> bool {
        match self.signal {
            Signal::Torque => true,
            Signal::Emg => effort.activity.iter().all(|activity| activity.is_finite()),
        }
    }

    /// Number of bars.
    pub const fn bars(self) -> usize {
        match self.signal {
            Signal::Torque => 1,
            Signal::Emg => 2,
        }
    }

    /// The mean over a whole session, which the next one has to match (N·m or N; unit of the
    /// channels).
    pub fn mean(self, sums: &Sums) -> [f64; BARS] {
        match self.signal {
            Signal::Torque => [mean_of(sums.torque[self.axis], sums.samples), 0.0],
            Signal::Emg => sums.activity_since(&Sums::default()),
        }
    }
}

/// The bar's values in a session: the mean torque since its beginning, or the activity of each
/// group of muscles in the last three intervals.
#[derive(Clone, Copy, Debug)]
pub struct BarValues {
    matched: Matched,
    /// Sums at the last updates, the newest first.
    earlier: [Sums; INTERVALS],
    updates: usize,
}

impl BarValues {
    /// At the beginning of a session.
    pub fn new(matched: Matched) -> Self {
        Self { matched, earlier: [Sums::default(); INTERVALS], updates: 0 }
    }

    /// The values at an update, from the session's sums.
    pub fn update(&mut self, sums: &Sums) -> [f64; BARS] {
        let values = match self.matched.signal {
            Signal::Torque => self.matched.mean(sums),
            Signal::Emg => self.recent(sums),
        };
        self.earlier.rotate_right(1);
        self.earlier[0] = *sums;
        self.updates += 1;
        values
    }

    /// Mean over the last three intervals, or those that there were, of the activity in each.
    fn recent(&self, sums: &Sums) -> [f64; BARS] {
        let intervals = (self.updates + 1).min(INTERVALS);
        let mut total = [0.0; BARS];
        let mut newer = sums;
        for older in &self.earlier[..intervals] {
            for (total, mean) in total.iter_mut().zip(newer.activity_since(older)) {
                *total += mean;
            }
            newer = older;
        }
        total.map(|total| total / intervals as f64)
    }
}
