//! Speed out of positions, not fooled by the encoder's quantisation.

const LENGTH: usize = 64;

/// The newest positions of one encoder.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpeedWindow {
    times_ns: [u64; LENGTH],
    positions: [f64; LENGTH],
    next: usize,
    filled: usize,
}

impl SpeedWindow {
    pub(super) const fn new() -> Self {
        Self { times_ns: [0; LENGTH], positions: [0.0; LENGTH], next: 0, filled: 0 }
    }

    pub(super) fn push(&mut self, time_ns: u64, position: f64) {
        self.times_ns[self.next] = time_ns;
        self.positions[self.next] = position;
        self.next = (self.next + 1) % LENGTH;
        self.filled = (self.filled + 1).min(LENGTH);
    }

    /// The speed that the encoder surely had on the mean of the window [rad/s or m/s]: two readings
    /// tell a distance to within one count, so that count is taken off. A position that flickers
    /// between two counts has speed 0. `None` while the window is not half full.
    pub(super) fn at_least(&self, window_ns: u64, count: f64) -> Option<f64> {
        let newest = self.index(0);
        let mut oldest = newest;
        for back in 1..self.filled {
            let index = self.index(back);
            if self.times_ns[newest]
                .checked_sub(self.times_ns[index])
                .is_none_or(|age| age > window_ns)
            {
                break;
            }
            oldest = index;
        }
        let elapsed_ns = self.times_ns[newest] - self.times_ns[oldest];
        if elapsed_ns < window_ns / 2 {
            return None;
        }
        let distance = (self.positions[newest] - self.positions[oldest]).abs();
        Some((distance - count).max(0.0) / (elapsed_ns as f64 * 1e-9))
    }

    /// Index of the reading that came `back` readings before the newest.
    const fn index(&self, back: usize) -> usize {
        (self.next + LENGTH - 1 - back) % LENGTH
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: f64 = std::f64::consts::TAU / 4000.0;
    const WINDOW: u64 = 8_000_000;

    fn quantised(speed: f64, phase: f64) -> SpeedWindow {
        let mut window = SpeedWindow::new();
        for tick in 0..200u64 {
            let position = ((speed * tick as f64 * 5e-4) / COUNT + phase).floor() * COUNT;
            window.push(tick * 500_000, position);
        }
        window
    }

    #[test]
    fn never_above_the_true_speed_and_at_most_two_counts_below() {
        for tenths in 0..300 {
            for phase in [0.0, 0.3, 0.999] {
                let speed = f64::from(tenths) / 10.0;
                let bound = quantised(speed, phase).at_least(WINDOW, COUNT).unwrap();
                assert!(bound <= speed + 1e-9, "{bound} above {speed}");
                assert!(bound >= speed - 2.0 * COUNT / 8e-3 - 1e-9, "{bound} far below {speed}");
            }
        }
    }

    #[test]
    fn flicker_between_two_counts_is_rest() {
        let mut window = SpeedWindow::new();
        for tick in 0..100u64 {
            window.push(tick * 500_000, (tick % 2) as f64 * COUNT);
            if tick > 20 {
                assert!(window.at_least(WINDOW, COUNT).unwrap() < 1e-9);
            }
        }
    }

    #[test]
    fn unknown_until_half_the_window_is_there_and_after_a_gap() {
        let mut window = SpeedWindow::new();
        assert_eq!(window.at_least(WINDOW, COUNT), None);
        for tick in 0..8u64 {
            window.push(tick * 500_000, 0.0);
            assert_eq!(window.at_least(WINDOW, COUNT), None);
        }
        window.push(4_000_000, 0.0);
        assert_eq!(window.at_least(WINDOW, COUNT), Some(0.0));
        window.push(400_000_000, 7.0);
        assert_eq!(window.at_least(WINDOW, COUNT), None);
    }
}
