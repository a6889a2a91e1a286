//! Filtering without delay, for recordings.

use crate::conditioner::{Activity, Conditioner, Conditioning, ConditioningError};

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
    let conditioner = Conditioner::new(how, rate_hz)?;
    let filtered = both_ways(values, rate_hz / how.low_hz, |signal| {
        let mut filters = conditioner;
        signal.iter_mut().for_each(|value| *value = filters.filter(*value));
    });
    let rectified: Vec<f64> = filtered.iter().map(|value| value.abs()).collect();
    let envelope = both_ways(&rectified, rate_hz / how.envelope_hz, |signal| {
        let mut filters = conditioner;
        signal.iter_mut().for_each(|value| *value = filters.smooth(*value));
    });
    let activity = |((filtered, rectified), envelope): ((&f64, &f64), &f64)| Activity {
        filtered: *filtered,
        rectified: *rectified,
        envelope: *envelope,
    };
    Ok(filtered.iter().zip(&rectified).zip(&envelope).map(activity).collect())
}

/// Runs a filter forward, then backward; `period` is that of its lowest frequency, in samples.
fn both_ways(values: &[f64], period: f64, run: impl Fn(&mut [f64])) -> Vec<f64> {
    let (Some(first), Some(last)) = (values.first(), values.last()) else { return Vec::new() };
    let margin = ((CONTINUED_PERIODS * period) as usize).min(values.len() - 1);
    let before = values[1..=margin].iter().rev().map(|value| 2.0 * first - value);
    let end = values.len() - 1;
    let after = values[end - margin..end].iter().rev().map(|value| 2.0 * last - value);
    let mut signal: Vec<f64> = before.chain(values.iter().copied()).chain(after).collect();
    run(&mut signal);
    signal.reverse();
    run(&mut signal);
    signal.reverse();
    signal[margin..margin + values.len()].to_vec()
}
