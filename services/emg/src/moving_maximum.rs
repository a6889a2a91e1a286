//! The maximum of a muscle's activity in a contraction.

use std::collections::VecDeque;

/// Window over which the rectified signal is averaged before its largest value is taken (s).
pub const MAXIMUM_WINDOW_S: f64 = 0.5;

/// Finds the largest mean of a rectified signal over a window. Allocates only when it is made.
#[derive(Clone, Debug)]
pub struct MovingMaximum {
    window: VecDeque<f64>,
    length: usize,
    sum: f64,
    largest: Option<f64>,
}

impl MovingMaximum {
    /// For a signal that is sampled at `rate_hz`.
    pub fn new(rate_hz: f64) -> Self {
        let length = ((MAXIMUM_WINDOW_S * rate_hz).round() as usize).max(1);
        Self { window: VecDeque::with_capacity(length), length, sum: 0.0, largest: None }
    }

    /// Begins another contraction.
    pub fn clear(&mut self) {
        self.window.clear();
        (self.sum, self.largest) = (0.0, None);
    }

    /// Takes a sample of the rectified signal. After one that is not finite a new window begins.
    pub fn update(&mut self, rectified: f64) {
        if !rectified.is_finite() {
            self.window.clear();
            self.sum = 0.0;
            return;
        }
        if self.window.len() == self.length {
            self.sum -= self.window.pop_front().unwrap_or(0.0);
        }
        self.window.push_back(rectified);
        self.sum += rectified;
        if self.window.len() == self.length {
            let mean = self.sum / self.length as f64;
            self.largest = Some(self.largest.map_or(mean, |largest| largest.max(mean)));
        }
    }

    /// The largest mean so far; `None` before a window is full.
    pub const fn largest(&self) -> Option<f64> {
        self.largest
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn the_largest_mean_over_half_a_second_counts() {
        let mut maximum = MovingMaximum::new(100.0);
        // A short peak counts as its share of the window, a long one whole.
        (0..49).for_each(|_| maximum.update(1.0));
        assert_eq!(maximum.largest(), None);
        maximum.update(1.0);
        assert_eq!(maximum.largest(), Some(1.0));
        (0..5).for_each(|_| maximum.update(11.0));
        (0..200).for_each(|_| maximum.update(1.0));
        assert!((maximum.largest().unwrap() - 2.0).abs() < 1e-12);
        (0..50).for_each(|_| maximum.update(3.0));
        assert!((maximum.largest().unwrap() - 3.0).abs() < 1e-12);
        maximum.clear();
        assert_eq!(maximum.largest(), None);
    }

    #[test]
    fn no_window_reaches_over_a_value_that_is_none() {
        let mut maximum = MovingMaximum::new(100.0);
        (0..49).for_each(|_| maximum.update(1.0));
        maximum.update(f64::NAN);
        (0..49).for_each(|_| maximum.update(1.0));
        assert_eq!(maximum.largest(), None);
        maximum.update(1.0);
        assert_eq!(maximum.largest(), Some(1.0));
    }
}
