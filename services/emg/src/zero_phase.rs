//! Filtering without delay, for recordings.

use crate::conditioner::{Activity, Conditioner, Conditioning, ConditioningError};
use crate::signal::Signal;

/// Time for which the ends are continued, in periods of the lowest frequency: what the filters
/// still ring with there is below a thousandth.
const CONTINUED_PERIODS: f64 = 6.0;

/// Filters a whole signal forward and backward, so that nothing is delayed: the attenuation in dB
/// is twice that of [`Conditioner`]. Both ends are continued by their mirror image about the end
/// point.
///
/// # Errors
/// Those of [`Conditioner::new`].
pub fn zero_phase(
    how: &Conditioning,
    rate_hz: f64,
    values: &[f64],
) -> Result<Vec<Activity>, ConditioningError> {
    let Ok((filtered, envelope)) = ZeroPhase::new(how, rate_hz)?.run(&values.to_vec());
    let activity = |(filtered, envelope): (f64, f64)| {
        let rectified = filtered.abs();
        Activity { filtered, rectified, envelope }
    };
    Ok(filtered.into_iter().zip(envelope).map(activity).collect())
}

/// As [`zero_phase`], of signals that may be longer than the memory.
#[derive(Clone, Copy, Debug)]
pub struct ZeroPhase {
    conditioner: Conditioner,
    /// Periods of the lowest frequencies of signal and envelope, in samples.
    periods: (f64, f64),
}

impl ZeroPhase {
    /// Filters a signal that is sampled at `rate_hz`.
    ///
    /// # Errors
    /// Those of [`Conditioner::new`].
    pub fn new(how: &Conditioning, rate_hz: f64) -> Result<Self, ConditioningError> {
        let conditioner = Conditioner::new(how, rate_hz)?;
        Ok(Self { conditioner, periods: (rate_hz / how.low_hz, rate_hz / how.envelope_hz) })
    }

    /// The filtered signal, and the envelope of its magnitude.
    ///
    /// # Errors
    /// Those of the signal.
    pub fn run<S: Signal>(&self, values: &S) -> Result<(S, S), S::Error> {
        let (period, envelope_period) = self.periods;
        let filtered = both_ways(values, std::convert::identity, period, || {
            let mut filters = self.conditioner;
            move |value| filters.filter(value)
        })?;
        let envelope = both_ways(&filtered, f64::abs, envelope_period, || {
            let mut filters = self.conditioner;
            move |value| filters.smooth(value)
        })?;
        Ok((filtered, envelope))
    }
}

/// Runs a filter forward, then backward, over what `of` makes of the values; `period` is that of
/// its lowest frequency, in samples.
fn both_ways<S: Signal, F: FnMut(f64) -> f64>(
    values: &S,
    of: fn(f64) -> f64,
    period: f64,
    filter: impl Fn() -> F,
) -> Result<S, S::Error> {
    let mut result = values.empty();
    let Some(end) = values.length().checked_sub(1) else { return Ok(result) };
    let margin = ((CONTINUED_PERIODS * period) as usize).min(end);
    let mut forward = values.empty();
    {
        let (mut read, mut run) = (values.reader(), filter());
        let mut value = |at| read(at).map(of);
        let (first, last) = (value(0)?, value(end)?);
        for at in (1..=margin).rev() {
            forward.push(run(2.0 * first - value(at)?))?;
        }
        for at in 0..=end {
            forward.push(run(value(at)?))?;
        }
        for at in (end - margin..end).rev() {
            forward.push(run(2.0 * last - value(at)?))?;
        }
    }
    let mut backward = values.empty();
    {
        let (mut read, mut run) = (forward.reader(), filter());
        for at in (margin..forward.length()).rev() {
            let value = run(read(at)?);
            if at <= margin + end {
                backward.push(value)?;
            }
        }
    }
    let mut read = backward.reader();
    for at in (0..=end).rev() {
        result.push(read(at)?)?;
    }
    Ok(result)
}
