//! Validation of a candidate on the selection rows.

/// Least relative decrease of the rms residual on the selection rows for which an effect is
/// accepted. On filtered rows at 200 Hz a significance test alone would reject clean data; the size
/// of the decrease protects against that.
pub const LEAST_GAIN: f64 = 0.10;

/// Least t: mean decrease of the blocks' squared residual over its standard error.
pub const LEAST_T: f64 = 2.5;

/// Validation of a candidate.
#[derive(Clone, Debug)]
pub struct Validation {
    /// Id of the effect, or name of the spline's variable.
    pub id: &'static str,
    /// Decrease of the rms residual on the selection rows, in percent.
    pub gain_percent: f64,
    /// Block t of the decrease.
    pub t: f64,
    /// Number of blocks on which the residual fell by more than 1 %.
    pub better: usize,
    /// Number of blocks on which it rose by more than 1 %.
    pub worse: usize,
    /// Whether it passes.
    pub accepted: bool,
}

/// Validates a candidate from the mean squared residuals of the selection blocks before and after.
pub fn validate(id: &'static str, before: &[f64], after: &[f64]) -> Validation {
    let n = before.len() as f64;
    let (sum_before, sum_after) = (before.iter().sum::<f64>(), after.iter().sum::<f64>());
    let gain = 1.0 - (sum_after / sum_before.max(f64::MIN_POSITIVE)).sqrt();
    let fall: Vec<f64> = before.iter().zip(after).map(|(b, a)| b - a).collect();
    let mean = fall.iter().sum::<f64>() / n;
    let variance = fall.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    let t = mean / (variance / n).sqrt().max(f64::MIN_POSITIVE);
    let better = before.iter().zip(after).filter(|(b, a)| a.sqrt() < 0.99 * b.sqrt()).count();
    let worse = before.iter().zip(after).filter(|(b, a)| a.sqrt() > 1.01 * b.sqrt()).count();
    let accepted = gain >= LEAST_GAIN && t >= LEAST_T && better > worse;
    Validation { id, gain_percent: 100.0 * gain, t, better, worse, accepted }
}
