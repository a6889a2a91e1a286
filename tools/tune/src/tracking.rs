//! How well the handle follows: the error of the slave's measured position against the desired one.

use serde::Serialize;

/// Time from the start of a movement that is left out (s): power comes up, the slave loop fades in
/// and adapts.
pub const SETTLING_S: f64 = 3.0;
/// Time before the end of a movement that is left out (s): the fade to rest.
pub const ENDING_S: f64 = 1.0;
/// Shortest movement (s).
pub const SHORTEST_S: f64 = SETTLING_S + ENDING_S + 1.0;
/// Fewest pairs that are evaluated: half a second at 500 Hz.
const FEWEST: usize = 250;

/// A measured movement: at each time the desired and the measured position of the slave, or of the
/// master where the slave has no encoder (rad or m).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Followed {
    /// Time from the start of the movement (s), ascending.
    pub time_s: Vec<f64>,
    /// Desired position.
    pub desired: Vec<f64>,
    /// Measured position.
    pub measured: Vec<f64>,
}

/// Tracking error over a movement, without its first and last seconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrackingError {
    /// Root mean square (rad or m).
    pub rms: f64,
    /// Largest magnitude (rad or m).
    pub peak: f64,
    /// The measured movement lags the desired one by this time (s): the least-squares estimate
    /// from the correlation of error and desired velocity.
    pub lag_s: f64,
}

impl Followed {
    /// Adds one pair.
    pub fn push(&mut self, time_s: f64, desired: f64, measured: f64) {
        self.time_s.push(time_s);
        self.desired.push(desired);
        self.measured.push(measured);
    }

    /// The pairs that are evaluated.
    fn evaluated(&self) -> std::ops::Range<usize> {
        let Some(end_s) = self.time_s.last().map(|last| last - ENDING_S) else { return 0..0 };
        let from = self.time_s.partition_point(|time| *time < SETTLING_S);
        let to = self.time_s.partition_point(|time| *time < end_s);
        from..to.max(from)
    }

    /// The tracking error; `None` where the movement is too short, or a position is not finite.
    pub fn error(&self) -> Option<TrackingError> {
        let rows = self.evaluated();
        if rows.len() < FEWEST {
            return None;
        }
        let errors = rows.clone().map(|row| self.desired[row] - self.measured[row]);
        let (mut squares, mut peak) = (0.0, 0.0_f64);
        for error in errors {
            if !error.is_finite() {
                return None;
            }
            squares += error * error;
            peak = peak.max(error.abs());
        }
        let rms = (squares / rows.len() as f64).sqrt();
        Some(TrackingError { rms, peak, lag_s: self.lag_s(rows) })
    }

    /// `e(t) = r(t) - r(t - lag) ≈ lag · ṙ(t)`, solved for the lag.
    fn lag_s(&self, rows: std::ops::Range<usize>) -> f64 {
        let (mut products, mut squares) = (0.0, 0.0);
        for row in rows.start.max(1)..rows.end.min(self.time_s.len() - 1) {
            let speed = (self.desired[row + 1] - self.desired[row - 1])
                / (self.time_s[row + 1] - self.time_s[row - 1]);
            products += speed * (self.desired[row] - self.measured[row]);
            squares += speed * speed;
        }
        if squares > 0.0 { products / squares } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    fn sine(length_s: f64, lag_s: f64) -> Followed {
        let mut followed = Followed::default();
        for step in 0..(length_s * 500.0) as usize {
            let time_s = step as f64 / 500.0;
            let at = |time_s: f64| 0.5 * (TAU * time_s).sin();
            followed.push(time_s, at(time_s), at(time_s - lag_s));
        }
        followed
    }

    #[test]
    fn a_lagging_sine_has_the_error_of_its_lag() {
        let error = sine(10.0, 0.01).error().unwrap();
        // 2 A sin(ω lag / 2), a sine of that amplitude.
        let amplitude = (TAU * 0.005).sin();
        assert!((error.peak - amplitude).abs() < 1e-4, "{error:?}");
        assert!((error.rms - amplitude / 2f64.sqrt()).abs() < 1e-4, "{error:?}");
        assert!((error.lag_s - 0.01).abs() < 1e-4, "{error:?}");
    }

    #[test]
    fn first_and_last_seconds_do_not_count() {
        let mut followed = sine(10.0, 0.0);
        for (time_s, measured) in followed.time_s.iter().zip(&mut followed.measured) {
            if *time_s < SETTLING_S || *time_s >= 9.0 {
                *measured += 1.0;
            }
        }
        assert!(followed.error().unwrap().peak < 1e-12);
    }

    #[test]
    fn a_short_movement_or_one_with_a_missing_position_has_no_error() {
        assert!(sine(4.2, 0.0).error().is_none());
        assert!(Followed::default().error().is_none());
        let mut followed = sine(10.0, 0.0);
        followed.measured[2500] = f64::NAN;
        assert!(followed.error().is_none());
    }
}
