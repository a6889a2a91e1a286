//! Velocity estimates from counts, with a known lag.

use super::Encoder;

/// A velocity estimate and its lag.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Speed {
    /// Speed, rad/s (m/s).
    pub velocity: f64,
    /// Lag, s: under constant acceleration the estimate is the true velocity that long ago.
    pub lag_s: f64,
}

/// The difference of successive positions, through a first-order low pass.
///
/// `d_k = (q_k - q_{k-1}) / T`, `y_k = y_{k-1} + a (d_k - y_{k-1})`, `a = 1 - exp(-T/τ)`. With `z =
/// e^{iωT}`:
///
/// ```text
/// H(ω) = (1 - z⁻¹)/T · a / (1 - (1 - a) z⁻¹)           gain and phase over those of q
/// lag  = T/2 + T (1 - a)/a = T/2 + T / (e^{T/τ} - 1)   at low frequency; T/2 without filter,
///                                                      near τ for τ ≫ T
/// ```
///
/// Quantisation by a pitch `δ` (position of one count) leaves noise: at constant speed up to `δ/T`
/// without a filter, and with one, for errors independent from sample to sample, a standard
/// deviation of `(δ/T) a / √(6 (2 - a))`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilteredDifference {
    step_s: f64,
    gain: f64,
    last: Option<f64>,
    velocity: f64,
}

impl FilteredDifference {
    /// For readings every `step_s` (positive) and a filter of time constant `time_constant_s`; 0
    /// for none.
    pub fn new(step_s: f64, time_constant_s: f64) -> Self {
        let gain = if time_constant_s > 0.0 { -(-step_s / time_constant_s).exp_m1() } else { 1.0 };
        Self { step_s, gain, last: None, velocity: 0.0 }
    }

    /// Lag at low frequency, s; constant.
    pub fn lag_s(&self) -> f64 {
        self.step_s * (0.5 + (1.0 - self.gain) / self.gain)
    }

    /// Gain and phase (rad) from true to estimated speed at an angular frequency, rad/s.
    pub fn response(&self, frequency_rad_s: f64) -> (f64, f64) {
        let half = 0.5 * frequency_rad_s * self.step_s;
        let difference = if half == 0.0 { 1.0 } else { half.sin() / half };
        let keep = 1.0 - self.gain;
        let (real, imaginary) = (1.0 - keep * (2.0 * half).cos(), keep * (2.0 * half).sin());
        (difference * self.gain / real.hypot(imaginary), -half - imaginary.atan2(real))
    }

    /// Takes the position (rad, or m) of the next reading. The first gives 0.
    pub fn update(&mut self, position: f64) -> Speed {
        let difference = self.last.map_or(0.0, |last| (position - last) / self.step_s);
        self.velocity += self.gain * (difference - self.velocity);
        self.last = Some(position);
        Speed { velocity: self.velocity, lag_s: self.lag_s() }
    }
}

/// Speed from the time between edges: travel from edge to edge over the time that it took.
///
/// Between the last edge of the reading before and the last edge of this one lie a whole number of
/// counts, so there is no quantisation of position. Under constant acceleration the result is
/// exactly the speed at the middle of the two:
///
/// ```text
/// lag = (now - t_edge) + (t_edge - t_edge,before) / 2
/// ```
///
/// At constant speed `v` and pitch `δ` that is between `T/2` and `T/2 + δ/v` where every reading
/// has edges (`δ/v < T`), and between `δ/2v` and `3δ/2v` where edges are rarer. While no edge
/// comes, the speed can be no more than one pitch over the time since the last, and the lag grows
/// with that time; after `standstill_s` without any it is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgePeriod {
    encoder: Encoder,
    standstill_s: f64,
    /// Position and time of the last edge.
    edge: Option<(f64, f64)>,
    before: Option<(i64, f64, f64)>,
    speed: Speed,
}

impl EdgePeriod {
    /// For an encoder; without an edge for `standstill_s` the speed is 0.
    pub fn new(encoder: Encoder, standstill_s: f64) -> Self {
        Self { encoder, standstill_s, edge: None, before: None, speed: Speed::default() }
    }

    /// Takes the true position (rad, or m) at a time, s. The timer of the encoder's input sees each
    /// edge as it comes: here its time follows from a straight line between the readings.
    pub fn update(&mut self, position: f64, time_s: f64) -> Speed {
        let counts = self.encoder.counts(position);
        if let Some((counts_before, position_before, time_before)) = self.before
            && counts != counts_before
        {
            // Going up in counts the last edge is the lower end of this count, going down its upper
            // end.
            let edge_counts = if counts > counts_before { counts } else { counts + 1 };
            let edge_position = edge_counts as f64 / self.encoder.counts_per_unit;
            let part =
                ((edge_position - position_before) / (position - position_before)).clamp(0.0, 1.0);
            let edge_time = time_before + part * (time_s - time_before);
            if let Some((last_position, last_time)) = self.edge
                && edge_time > last_time
            {
                let period = edge_time - last_time;
                let velocity = (edge_position - last_position) / period;
                self.speed = Speed { velocity, lag_s: time_s - edge_time + 0.5 * period };
            }
            self.edge = Some((edge_position, edge_time));
        } else if let (Some((_, edge_time)), Some((_, _, time_before))) = (self.edge, self.before) {
            let since = time_s - edge_time;
            self.speed.lag_s += time_s - time_before;
            let most = if since >= self.standstill_s {
                0.0
            } else {
                1.0 / (self.encoder.counts_per_unit.abs() * since)
            };
            self.speed.velocity = self.speed.velocity.clamp(-most, most);
        }
        self.before = Some((counts, position, time_s));
        self.speed
    }
}
