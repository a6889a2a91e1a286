//! Score screening of the candidates.
//!
//! Every starting point of every candidate is simulated once. The change of the residual, with the
//! sensitivities to the estimated parameters projected out, is compared with the residual: the
//! score is the share of the squared residual that it would explain. Nothing is fitted here.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::candidates::{Candidate, RecordFeatures, StartPoint};
use super::fit::{Dataset, Fitted};
use super::free_parameter::{AT_BOUND, FreeParameter};
use super::record::Record;
use super::transmission_model::{Channel, PlacedEffect, Setting};
use crate::spectral::transform;

/// The residual of a fit, projected onto the complement of its own Jacobian.
pub struct Projection {
    /// Weights of every record and channel.
    pub weights: Vec<Vec<f64>>,
    /// Jacobian of the weighted residual.
    pub jacobian: DMatrix<f64>,
    here: DVector<f64>,
    basis: DMatrix<f64>,
    left: DVector<f64>,
}

/// Returns an orthonormal basis of the span of some columns with `rows` rows, zero columns left
/// out.
pub fn basis(columns: impl Iterator<Item = DVector<f64>>, rows: usize) -> DMatrix<f64> {
    let columns: Vec<DVector<f64>> = columns
        .filter_map(|column| {
            let norm = column.norm();
            (norm > 0.0).then(|| column / norm)
        })
        .collect();
    if columns.is_empty() {
        DMatrix::zeros(rows, 0)
    } else {
        DMatrix::from_columns(&columns).qr().q()
    }
}

/// A candidate with its best starting point.
#[derive(Clone, Debug)]
pub struct ScoredCandidate {
    /// Index of the candidate.
    pub candidate: usize,
    /// Starting point of the fit, with its size scaled.
    pub placed: PlacedEffect,
    /// Share of the squared residual that it explains, 0 to 1.
    pub share: f64,
}

impl Projection {
    /// Projects the residual of a fit by its estimated parameters.
    pub fn new(dataset: &Dataset<'_>, fitted: &Fitted, parameters: &[FreeParameter]) -> Self {
        let weights = Dataset::weights(&fitted.residuals);
        let here = Dataset::stack(&fitted.residuals, &weights);
        let jacobian = dataset.jacobian(fitted, parameters, &weights);
        // A parameter at its bound cannot explain more.
        let inside = |parameter: &FreeParameter| {
            parameter.normalised(dataset.model, &fitted.setting).abs() < AT_BOUND
        };
        let columns = parameters
            .iter()
            .zip(jacobian.column_iter())
            .filter(|(parameter, _)| inside(parameter));
        let basis = basis(columns.map(|(_, column)| column.into_owned()), here.len());
        let left = &here - &basis * (basis.transpose() * &here);
        Self { weights, jacobian, here, basis, left }
    }

    /// Returns the weighted, projected change of the residual; `None` if the setting cannot be
    /// simulated.
    fn change(&self, dataset: &Dataset<'_>, setting: &Setting) -> Option<DVector<f64>> {
        let change = Dataset::stack(&dataset.residuals(setting)?, &self.weights) - &self.here;
        Some(&change - &self.basis * (self.basis.transpose() * &change))
    }

    /// Least squares of the residual on some directions: bounded factors, and the share explained.
    fn best(&self, directions: &[DVector<f64>], limits: (f64, f64)) -> Option<(Vec<f64>, f64)> {
        let count = directions.len();
        let gram =
            DMatrix::from_fn(count, count, |row, column| directions[row].dot(&directions[column]));
        let right = DVector::from_iterator(
            count,
            directions.iter().map(|direction| -direction.dot(&self.left)),
        );
        let ridge = 1e-9 * gram.trace().max(f64::MIN_POSITIVE);
        let factors = (gram + DMatrix::identity(count, count) * ridge).cholesky()?.solve(&right);
        let factors: Vec<f64> =
            factors.iter().map(|factor| factor.clamp(limits.0, limits.1)).collect();
        let mut after = self.left.clone();
        for (direction, factor) in directions.iter().zip(&factors) {
            after.axpy(*factor, direction, 1.0);
        }
        Some((
            factors,
            1.0 - after.norm_squared() / self.left.norm_squared().max(f64::MIN_POSITIVE),
        ))
    }

    /// Scores several settings together (nonparametric functions): factors and share explained.
    pub fn explain(&self, dataset: &Dataset<'_>, settings: &[Setting]) -> Option<(Vec<f64>, f64)> {
        let directions: Vec<DVector<f64>> = settings
            .par_iter()
            .map(|setting| self.change(dataset, setting))
            .collect::<Option<_>>()?;
        self.best(&directions, (f64::NEG_INFINITY, f64::INFINITY))
    }

    /// Scores every candidate, best first; those that cannot be simulated are omitted.
    pub fn rank(
        &self,
        dataset: &Dataset<'_>,
        fitted: &Fitted,
        candidates: &[Candidate],
    ) -> Vec<ScoredCandidate> {
        let starts: Vec<(usize, &StartPoint)> = candidates
            .iter()
            .enumerate()
            .flat_map(|(index, candidate)| candidate.starts.iter().map(move |start| (index, start)))
            .collect();
        let scored: Vec<ScoredCandidate> = starts
            .par_iter()
            .filter_map(|(index, start)| {
                self.score(dataset, fitted, *index, &candidates[*index], start)
            })
            .collect();
        let mut best: Vec<ScoredCandidate> = Vec::new();
        for scored in scored {
            match best.iter_mut().find(|known| known.candidate == scored.candidate) {
                Some(known) if known.share >= scored.share => {}
                Some(known) => *known = scored,
                None => best.push(scored),
            }
        }
        best.sort_by(|a, b| b.share.total_cmp(&a.share));
        best
    }

    fn score(
        &self,
        dataset: &Dataset<'_>,
        fitted: &Fitted,
        candidate: usize,
        of: &Candidate,
        start: &StartPoint,
    ) -> Option<ScoredCandidate> {
        let with = |placed: &PlacedEffect| self.change(dataset, &fitted.setting.with(placed));
        let mut directions = vec![with(&start.placed)?];
        if let Some(quadrature) = &start.quadrature {
            directions.push(with(quadrature)?);
        }
        let limits = if start.signed { (-3.0, 3.0) } else { (0.0, 2.0) };
        let (factors, share) = self.best(&directions, limits)?;
        Some(ScoredCandidate { candidate, placed: scaled(of, start, &factors), share })
    }
}

/// Scales the size of a starting point.
fn scaled(candidate: &Candidate, start: &StartPoint, factors: &[f64]) -> PlacedEffect {
    let mut placed = start.placed.clone();
    if let ([cosine, sine], Some((name, most))) = (factors, candidate.phasor) {
        for (own, value) in &mut placed.values {
            if *own == name {
                *value = (*value * cosine.hypot(*sine)).clamp(0.02 * most, most);
            } else if *own == "phase" {
                *value = sine.atan2(*cosine);
            }
        }
        return placed;
    }
    let Some(factor) = factors.first() else { return placed };
    // Not below a tenth: near zero the gradient vanishes.
    let factor = if factor.abs() < 0.1 { 0.1_f64.copysign(*factor) } else { *factor };
    for (name, value) in placed.values.iter_mut().take(candidate.sizes) {
        let (low, high) = candidate
            .free
            .iter()
            .find(|free| free.name == *name)
            .map_or((f64::MIN, f64::MAX), |free| (free.low, free.high));
        *value = (*value * factor).clamp(low, high);
    }
    placed
}

/// Returns the features of records and residuals from which starting points are derived.
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
    let power = |hz: f64| {
        let parts =
            residuals.iter().zip(&times).flat_map(|((_, rows), times)| rows.iter().zip(times));
        let (cosine, sine) = parts.fold((0.0, 0.0), |(cosine, sine), (row, time)| {
            let (s, c) = (std::f64::consts::TAU * hz * time).sin_cos();
            (cosine + row * c, sine + row * s)
        });
        cosine * cosine + sine * sine
    };
    (-steps..=steps)
        .into_par_iter()
        .map(|index| about_hz + f64::from(index) * step)
        .map(|hz| (power(hz), hz))
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
        .map(|index| {
            let parts = residuals
                .iter()
                .zip(&positions)
                .flat_map(|((_, rows), positions)| rows.iter().zip(positions));
            let (cosine, sine) = parts.fold((0.0, 0.0), |(cosine, sine), (row, position)| {
                let (s, c) = (order(index) * position).sin_cos();
                (cosine + row * c, sine + row * s)
            });
            cosine * cosine + sine * sine
        })
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
