//! Features of records and residuals, for the initial values of candidate effects: spectral lines,
//! orders, ranges.

use plant::effects::search::RecordFeatures;
use plant::thinning::PACE_S;
use rayon::prelude::*;

use super::dataset::{Dataset, Fitted};
use super::record::Record;
use super::transmission_model::Channel;
use crate::spectral::transform;

/// Returns the features of records and residuals.
pub fn record_features(dataset: &Dataset<'_>, fitted: &Fitted) -> RecordFeatures {
    let model = dataset.model;
    let records: Vec<&Record> =
        dataset.records.iter().map(|index| &model.records[*index]).collect();
    let of = |channel: Channel| -> Vec<(&Record, &Vec<f64>)> {
        dataset
            .records
            .iter()
            .zip(&fitted.residuals)
            .filter_map(|(index, residual)| {
                Some((&model.records[*index], model.channel_of(*index, residual, channel)?))
            })
            .collect()
    };
    let (master, slave, torque) = (of(Channel::Master), of(Channel::Slave), of(Channel::Torque));
    let mut hum = vec![50.0, 60.0];
    hum.extend(lines(&torque, (15.0, 124.0), 2));
    RecordFeatures {
        step_s: PACE_S,
        volts: records
            .iter()
            .flat_map(|record| &record.volts)
            .fold(0.0, |most, volts| volts.abs().max(most)),
        lines_hz: [lines(&master, (0.4, 110.0), 3), lines(&slave, (0.4, 110.0), 3)],
        hum_hz: if torque.is_empty() { Vec::new() } else { hum },
        orders: orders(&master),
        count_rad: [0, 1]
            .map(|side| records.iter().map(|record| record.count_rad[side]).fold(0.0, f64::max)),
        torque: records.iter().any(|record| record.torque.is_some()),
        hand: model.records.iter().any(|record| !record.idle),
        rectified: model.records.iter().any(|record| record.sign_flipped.contains(&true)),
        slave: records.iter().all(|record| record.slave.is_some()),
        other_axes: model.others.iter().map(|other| other.index).collect(),
    }
}

/// Returns the spectral lines of residuals (Hz), the most prominent first.
fn lines(residuals: &[(&Record, &Vec<f64>)], (low, high): (f64, f64), count: usize) -> Vec<f64> {
    const POINTS: usize = 1 << 14;
    let Some((first, _)) = residuals.first() else { return Vec::new() };
    let rate = 1.0 / (first.step_s * first.decimation() as f64);
    let mut power = vec![0.0; POINTS / 2 + 1];
    for (_, rows) in residuals {
        let mut input = vec![0.0; POINTS];
        let taken = rows.len().min(POINTS);
        for (index, (slot, row)) in input.iter_mut().zip(rows.iter()).enumerate() {
            // Hann window against leakage of strong low frequencies.
            let window = 0.5 - 0.5 * (std::f64::consts::TAU * index as f64 / taken as f64).cos();
            *slot = window * row;
        }
        let bins = transform(input).unwrap_or_default();
        power.iter_mut().zip(&bins).for_each(|(sum, bin)| *sum += bin.norm_sqr());
    }
    let step = rate / POINTS as f64;
    let found = prominent(
        &power,
        |index| index as f64 * step,
        (low, high),
        (2.0 / step) as usize,
        0.4,
        count,
    );
    found.into_iter().map(|hz| coherent(residuals, hz, 2.0 * step)).collect()
}

/// Power of all records together in a wave of this frequency (rad per unit of the abscissa).
fn power_at(frequency: f64, residuals: &[(&Record, &Vec<f64>)], abscissae: &[Vec<f64>]) -> f64 {
    let parts = residuals.iter().zip(abscissae).flat_map(|((_, rows), x)| rows.iter().zip(x));
    let (cosine, sine) = parts.fold((0.0, 0.0), |(cosine, sine), (row, x)| {
        let (s, c) = (frequency * x).sin_cos();
        (cosine + row * c, sine + row * s)
    });
    cosine * cosine + sine * sine
}

/// Refines a frequency by the power of all records together at their absolute times: the spectrum
/// of one record cannot predict the phase of the next.
fn coherent(residuals: &[(&Record, &Vec<f64>)], about_hz: f64, reach_hz: f64) -> f64 {
    let ends = residuals.iter().map(|(record, rows)| {
        let length = rows.len() as f64 * record.step_s * record.decimation() as f64;
        (record.start_s, record.start_s + length)
    });
    let (first, last) =
        ends.fold((f64::MAX, f64::MIN), |(low, high), (from, to)| (low.min(from), high.max(to)));
    // One sixth of a period over the whole duration.
    let step = 1.0 / (6.0 * (last - first).max(1.0));
    let steps = (reach_hz / step).ceil() as i32;
    let times: Vec<Vec<f64>> =
        residuals.iter().map(|(record, _)| record.residual_times()).collect();
    (-steps..=steps)
        .into_par_iter()
        .map(|index| about_hz + f64::from(index) * step)
        .map(|hz| (power_at(std::f64::consts::TAU * hz, residuals, &times), hz))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(about_hz, |(_, hz)| hz)
}

/// Returns prominent orders of the master's residual over its angle.
fn orders(residuals: &[(&Record, &Vec<f64>)]) -> Vec<f64> {
    const STEP: f64 = 0.25;
    let order = |index: usize| 3.5 + STEP * index as f64;
    let positions: Vec<Vec<f64>> =
        residuals.iter().map(|(record, _)| record.averaged(&record.master)).collect();
    let power: Vec<f64> = (0..400)
        .into_par_iter()
        .map(|index| power_at(order(index), residuals, &positions))
        .collect();
    prominent(&power, order, (3.75, 100.0), 24, 0.6, 3)
}

/// Returns the peaks of a spectrum with the highest ratio to the mean of their neighbourhood, at
/// least `apart` from one another.
fn prominent(
    power: &[f64],
    place: impl Fn(usize) -> f64,
    (low, high): (f64, f64),
    reach: usize,
    apart: f64,
    count: usize,
) -> Vec<f64> {
    let mut sums = vec![0.0];
    for value in power {
        sums.push(sums[sums.len() - 1] + value);
    }
    let mut contrast: Vec<(f64, f64)> = (1..power.len().saturating_sub(1))
        .filter(|index| {
            (low..high).contains(&place(*index))
                && power[*index] >= power[index - 1]
                && power[*index] >= power[index + 1]
        })
        .map(|index| {
            let (from, to) = (index.saturating_sub(reach), (index + reach + 1).min(power.len()));
            let around = (sums[to] - sums[from]) / (to - from) as f64;
            (power[index] / around.max(f64::MIN_POSITIVE), place(index))
        })
        .collect();
    contrast.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut found: Vec<f64> = Vec::new();
    for (_, at) in contrast {
        if found.len() < count && found.iter().all(|known| (known - at).abs() > apart) {
            found.push(at);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_are_relative_to_their_neighbourhood() {
        let mut power: Vec<f64> = (0..1000).map(|index| 1e3 / f64::from(1 + index)).collect();
        power[400] += 40.0;
        power[700] += 20.0;
        assert_eq!(
            prominent(&power, |index| index as f64 * 0.1, (1.0, 99.0), 30, 0.5, 2),
            vec![40.0, 70.0]
        );
    }
}
