//! Feedback of a loop that answers late.
//!
//! Feedback that is stable at the loop's own delay is not if its volts are held for several periods
//! of the loop: a position loop that crosses over at 18 Hz has 8 ms left before it oscillates. In
//! the best-effort profile without `SCHED_FIFO`, gaps of 20 ms occur, often several within 100 ms.
//! The feedback is therefore reduced by the factor `TOLERATED_S / latency`, which lowers the
//! crossover frequency as the delay grows. Feed-forward has no part in the oscillation and stays.
//!
//! The latency is the longest of the recent ones (time constant `RECENT_S`), since one gap is
//! rarely the only one: the larger of the sample's age and the time since the previous step.

/// Latency up to which the feedback is not reduced (s): the longest that the realtime profile
/// allows, where the gate latches closed at this age of the command.
pub const TOLERATED_S: f64 = 5e-3;
/// Time constant with which an earlier latency is forgotten (s).
const RECENT_S: f64 = 0.5;

/// The factor on the feedback and the latency that it follows from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Latency {
    recent_s: f64,
    /// Factor on the feedback, 0 to 1.
    pub(super) feedback_factor: f64,
}

impl Default for Latency {
    fn default() -> Self {
        Self { recent_s: 0.0, feedback_factor: 1.0 }
    }
}

impl Latency {
    /// Accounts for a step on a sample of this age, `elapsed_s` after the previous step (s). The
    /// factor falls by at most `largest_fall` (1), so that the output does not step.
    pub(super) fn update(&mut self, age_s: f64, elapsed_s: f64, largest_fall: f64) {
        let faded_s = self.recent_s * (-elapsed_s / RECENT_S).exp();
        self.recent_s = age_s.max(elapsed_s).max(faded_s);
        let wanted = (TOLERATED_S / self.recent_s).min(1.0);
        self.feedback_factor = wanted.max(self.feedback_factor - largest_fall);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The factor, allowed to fall by all of it in 50 ms.
    fn step(latency: &mut Latency, age_s: f64, elapsed_s: f64) -> f64 {
        latency.update(age_s, elapsed_s, elapsed_s / 0.05);
        latency.feedback_factor
    }

    #[test]
    fn feedback_is_whole_as_long_as_no_answer_takes_longer_than_tolerated() {
        let mut latency = Latency::default();
        for age_s in [0.0, 2e-4, 4.9e-3, TOLERATED_S] {
            assert_eq!(step(&mut latency, age_s, 2e-3), 1.0);
        }
        assert_eq!(step(&mut latency, 0.0, TOLERATED_S), 1.0);
    }

    #[test]
    fn a_gap_reduces_the_feedback_at_once_and_less_than_a_second_restores_it() {
        let mut latency = Latency::default();
        let first = step(&mut latency, 0.0, 0.02);
        assert!((first - 0.6).abs() < 1e-12, "by 20 of 50 ms: {first}");
        assert_eq!(step(&mut latency, 0.0, 0.02), 0.25);
        let mut time_s = 0.0;
        while step(&mut latency, 0.0, 2e-3) < 1.0 {
            time_s += 2e-3;
        }
        assert!((0.6..0.8).contains(&time_s), "ln 4 time constants: {time_s}");
    }

    #[test]
    fn an_old_sample_counts_as_a_gap_does() {
        let mut latency = Latency::default();
        let last = (0..50).map(|_| step(&mut latency, 0.02, 2e-3)).last();
        assert_eq!(last, Some(0.25));
    }
}
