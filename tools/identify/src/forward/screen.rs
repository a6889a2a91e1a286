//! Which effects point along the residual.
//!
//! Each start of each candidate is simulated once. What it changes, less what the declared
//! parameters could change as well, is held against the residual: the part of the residual that it
//! would take away is its score. No effect is fitted here.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::catalogue::{Candidate, Scale, Start};
use super::fit::{Fitted, View};
use super::knob::{AT_EDGE, Knob};
use super::machine::{Channel, Placed, Setting};
use super::record::Record;
use crate::spectral::transform;

/// The residual of a fit with what its own parameters explain taken out.
pub struct Projection {
    /// Weights of every record and channel.
    pub weights: Vec<Vec<f64>>,
    /// Slopes of the weighted residual by every knob of the fit.
    pub slopes: DMatrix<f64>,
    here: DVector<f64>,
    basis: DMatrix<f64>,
    left: DVector<f64>,
}

/// An orthonormal basis of what some columns of so many rows span; those that are nothing are left
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

/// A candidate with the start that scored best.
#[derive(Clone, Debug)]
pub struct Scored {
    /// Index of the candidate.
    pub candidate: usize,
    /// Where a fit should begin.
    pub placed: Placed,
    /// Part of the squared residual that it takes away, 0 to 1.
    pub share: f64,
}

impl Projection {
    /// Of a fit, by the knobs that it moved.
    pub fn new(view: &View<'_>, fitted: &Fitted, knobs: &[Knob]) -> Self {
        let weights = View::weights(&fitted.residuals);
        let here = View::stack(&fitted.residuals, &weights);
        let slopes = view.slopes(fitted, knobs, &weights);
        // What stands at the end of its tolerance explains nothing more.
        let inside = |knob: &Knob| knob.place(view.machine, &fitted.setting).abs() < AT_EDGE;
        let columns = knobs.iter().zip(slopes.column_iter()).filter(|(knob, _)| inside(knob));
        let basis = basis(columns.map(|(_, column)| column.into_owned()), here.len());
        let left = &here - &basis * (basis.transpose() * &here);
        Self { weights, slopes, here, basis, left }
    }

    /// What a setting changes, weighted and projected; `None` where it cannot be simulated.
    fn change(&self, view: &View<'_>, setting: &Setting) -> Option<DVector<f64>> {
        let change = View::stack(&view.residuals(setting)?, &self.weights) - &self.here;
        Some(&change - &self.basis * (self.basis.transpose() * &change))
    }

    /// By how much of each of some directions the residual is best taken away, and the part of its
    /// square that goes.
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

    /// The score of some directions by themselves (functions without a name): factors and share.
    pub fn explain(&self, view: &View<'_>, settings: &[Setting]) -> Option<(Vec<f64>, f64)> {
        let directions: Vec<DVector<f64>> =
            settings.par_iter().map(|setting| self.change(view, setting)).collect::<Option<_>>()?;
        self.best(&directions, (f64::NEG_INFINITY, f64::INFINITY))
    }

    /// Scores every candidate, best first; those that cannot be simulated are left out.
    pub fn rank(&self, view: &View<'_>, fitted: &Fitted, candidates: &[Candidate]) -> Vec<Scored> {
        let starts: Vec<(usize, &Start)> = candidates
            .iter()
            .enumerate()
            .flat_map(|(index, candidate)| candidate.starts.iter().map(move |start| (index, start)))
            .collect();
        let scored: Vec<Scored> = starts
            .par_iter()
            .filter_map(|(index, start)| {
                self.score(view, fitted, *index, &candidates[*index], start)
            })
            .collect();
        let mut best: Vec<Scored> = Vec::new();
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
        view: &View<'_>,
        fitted: &Fitted,
        candidate: usize,
        of: &Candidate,
        start: &Start,
    ) -> Option<Scored> {
        let with = |placed: &Placed| self.change(view, &fitted.setting.with(placed));
        let mut directions = vec![with(&start.placed)?];
        if let Some(quadrature) = &start.quadrature {
            directions.push(with(quadrature)?);
        }
        let limits = if start.signed { (-3.0, 3.0) } else { (0.0, 2.0) };
        let (factors, share) = self.best(&directions, limits)?;
        Some(Scored { candidate, placed: scaled(of, start, &factors), share })
    }
}

/// A start with its size multiplied.
fn scaled(candidate: &Candidate, start: &Start, factors: &[f64]) -> Placed {
    let mut placed = start.placed.clone();
    if let ([cosine, sine], Some((name, most))) = (factors, candidate.wave) {
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
    // From nothing at all no fit finds its way back.
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

/// What of the records and of a fit the starts depend on.
pub fn scale(view: &View<'_>, fitted: &Fitted) -> Scale {
    let machine = view.machine;
    let records: Vec<&Record> = view.records.iter().map(|index| &machine.records[*index]).collect();
    let of = |channel: Channel| -> Vec<(&Record, &Vec<f64>)> {
        view.records
            .iter()
            .zip(&fitted.residuals)
            .filter_map(|(index, residual)| {
                Some((&machine.records[*index], machine.channel_of(*index, residual, channel)?))
            })
            .collect()
    };
    let (master, slave, torque) = (of(Channel::Master), of(Channel::Slave), of(Channel::Torque));
    let mut hum = vec![50.0, 60.0];
    hum.extend(lines(&torque, (15.0, 124.0), 2));
    Scale {
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
        hand: machine.records.iter().any(|record| !record.idle),
        folded: machine.records.iter().any(|record| record.turned.contains(&true)),
        slave: records.iter().all(|record| record.slave.is_some()),
    }
}

/// Frequencies (Hz) at which residuals have more power than their neighbourhood, the most prominent
/// first.
fn lines(residuals: &[(&Record, &Vec<f64>)], (low, high): (f64, f64), count: usize) -> Vec<f64> {
    const POINTS: usize = 1 << 14;
    let Some((first, _)) = residuals.first() else { return Vec::new() };
    let rate = 1.0 / (first.step_s * first.decimation() as f64);
    let mut power = vec![0.0; POINTS / 2 + 1];
    for (_, rows) in residuals {
        let mut input = vec![0.0; POINTS];
        let taken = rows.len().min(POINTS);
        for (index, (slot, row)) in input.iter_mut().zip(rows.iter()).enumerate() {
            // A Hann window: a strong slow residual must not leak into everything.
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

/// The frequency near another at which all records together, each at its own time, swing most: a
/// spectrum of one record does not tell the phase after the next hundred seconds.
fn coherent(residuals: &[(&Record, &Vec<f64>)], about_hz: f64, reach_hz: f64) -> f64 {
    let ends = residuals.iter().map(|(record, rows)| {
        let length = rows.len() as f64 * record.step_s * record.decimation() as f64;
        (record.start_s, record.start_s + length)
    });
    let (first, last) =
        ends.fold((f64::MAX, f64::MIN), |(low, high), (from, to)| (low.min(from), high.max(to)));
    // A sixth of a turn from end to end.
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

/// Orders over the master's angle at which its residual has more power than its neighbourhood.
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

/// The places of a spectrum that stand out most from the mean of their neighbourhood, `apart` from
/// one another.
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
    fn what_stands_out_of_its_neighbourhood_is_found_beside_something_larger() {
        let mut power: Vec<f64> = (0..1000).map(|index| 1e3 / f64::from(1 + index)).collect();
        power[400] += 40.0;
        power[700] += 20.0;
        assert_eq!(
            prominent(&power, |index| index as f64 * 0.1, (1.0, 99.0), 30, 0.5, 2),
            vec![40.0, 70.0]
        );
    }
}
