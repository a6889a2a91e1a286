//! Plots of a transmission's residual over position, velocity, torque, time since the last
//! reversal, time and frequency.

use report::{Figure, Page, Panels};

use super::transmission_study::Study;

use crate::prediction_error::record::Record;
use crate::prediction_error::transmission_model::{Channel, Residual};
use crate::residual_figures::{banded, drawn};
use crate::spectral::periodogram;

/// Slower motion counts as rest; a reversal is the next faster motion in the other direction
/// (rad/s).
const STILL_RAD_S: f64 = 0.1;
/// Longest time since a reversal that is shown (s).
const LONGEST_S: f64 = 1.0;
/// Frequency bins per decade.
const BINS_A_DECADE: f64 = 20.0;
/// Width and height of a plot.
const SIZE: (u32, u32) = (460, 250);

/// Rows of all reporting records, one record after another.
#[derive(Default)]
struct Rows {
    position: Vec<f64>,
    velocity: Vec<f64>,
    torque: Vec<f64>,
    since_reversal: Vec<f64>,
    time: Vec<f64>,
    before: Vec<f64>,
    after: Vec<f64>,
    /// Whether effects were found.
    with: bool,
}

/// Time since the velocity last changed its sign, for every row; NaN before the first time.
fn since_reversal(velocity: &[f64], pace_s: f64) -> Vec<f64> {
    let (mut way, mut since) = (0.0, f64::NAN);
    velocity
        .iter()
        .map(|speed| {
            since += pace_s;
            if speed.abs() > STILL_RAD_S && speed.signum() != way {
                since = if way == 0.0 { f64::NAN } else { 0.0 };
                way = speed.signum();
            }
            since
        })
        .collect()
}

impl Rows {
    /// Adds the rows of a record, with the residuals of the declared model and of the final one.
    fn take(
        &mut self,
        study: &Study,
        record: &Record,
        channel: Channel,
        (before, after): (&[f64], &[f64]),
    ) {
        let column = match (channel, &record.slave) {
            (Channel::Slave | Channel::Torque, Some(slave)) => slave,
            _ => &record.master,
        };
        let (position, pace_s) =
            (record.averaged(column), record.step_s * record.decimation() as f64);
        let inner = 2..record.residual_rows().saturating_sub(2);
        let velocity: Vec<f64> = inner
            .clone()
            .map(|row| (position[row + 2] - position[row - 2]) / (4.0 * pace_s))
            .collect();
        // The torque of the hand if it is measured, else that of the motor.
        let torque = match (channel, &record.torque) {
            (Channel::Slave, Some(torque)) if !record.idle => record.averaged(torque),
            _ => {
                let constants = study.model.constants(&study.found.last().setting);
                let per_volt = constants.map_or(f64::NAN, |own| own.motor_torque_per_volt_nm());
                record.averaged(&record.volts).into_iter().map(|volts| per_volt * volts).collect()
            }
        };
        self.since_reversal.extend(since_reversal(&velocity, pace_s));
        self.velocity.extend(velocity);
        for (out, column) in [
            (&mut self.position, &position[..]),
            (&mut self.torque, &torque),
            (&mut self.time, &record.residual_times()),
            (&mut self.before, before),
            (&mut self.after, after),
        ] {
            out.extend_from_slice(column.get(inner.clone()).unwrap_or_default());
        }
    }

    /// A plot over some values, of the rows in which they are finite; `None` if there are none, as
    /// after a movement without reversal.
    fn over(&self, what: &str, unit: &str, of: &str, values: &[f64]) -> Option<Figure> {
        let rows: Vec<usize> =
            (0..self.before.len()).filter(|row| values[*row].is_finite()).collect();
        if rows.is_empty() {
            return None;
        }
        let at = |column: &[f64]| rows.iter().map(|row| column[*row]).collect::<Vec<f64>>();
        Some(
            banded(what, unit, of, &at(values), (&at(&self.before), &at(&self.after)), self.with)
                .size(SIZE.0, SIZE.1),
        )
    }
}

/// Amplitude spectral density of some segments with equal sampling, in logarithmic bins:
/// frequencies (Hz) and unit/√Hz.
fn density(stretches: &[&[f64]], pace_s: f64) -> (Vec<f64>, Vec<f64>) {
    let longest = stretches.iter().map(|rows| rows.len()).max().unwrap_or(0) as f64 * pace_s;
    if longest <= 0.0 {
        return (Vec::new(), Vec::new());
    }
    let lowest = 2.0 / longest;
    let mut bins: Vec<(f64, f64, f64)> = Vec::new();
    for rows in stretches {
        // Two-sided power of all rows; negative frequencies are left out, so that it counts twice.
        let scale = 2.0 * pace_s / rows.len().max(1) as f64;
        for (frequency, power) in
            periodogram(rows, 1.0 / pace_s).into_iter().filter(|(f, _)| *f >= lowest)
        {
            let bin = (BINS_A_DECADE * (frequency / lowest).log10()) as usize;
            if bins.len() <= bin {
                bins.resize(bin + 1, (0.0, 0.0, 0.0));
            }
            let (sum_hz, sum, count) = &mut bins[bin];
            (*sum_hz, *sum, *count) = (*sum_hz + frequency, *sum + scale * power, *count + 1.0);
        }
    }
    let filled = bins.into_iter().filter(|(_, power, count)| *count > 0.0 && *power > 0.0);
    filled.map(|(hz, power, count)| (hz / count, (power / count).sqrt())).unzip()
}

/// The plots of one channel, over the reporting records.
pub(super) fn maps(
    page: Page,
    study: &Study,
    report: &[usize],
    channel: Channel,
    (before, after): (&[Residual], &[Residual]),
    with: bool,
) -> Page {
    let mut rows = Rows { with, ..Rows::default() };
    let (mut of_before, mut of_after): (Vec<&[f64]>, Vec<&[f64]>) = (Vec::new(), Vec::new());
    let (mut pace_s, mut driven) = (0.0, true);
    for (at, index) in report.iter().enumerate() {
        let record = &study.model.records[*index];
        let Some(place) = study.model.channels(*index).iter().position(|own| *own == channel)
        else {
            continue;
        };
        let both = (&before[at].channels[place][..], &after[at].channels[place][..]);
        rows.take(study, record, channel, both);
        of_before.push(both.0);
        of_after.push(both.1);
        pace_s = record.step_s * record.decimation() as f64;
        driven &= record.torque.is_some() && !record.idle;
    }
    if rows.before.is_empty() {
        return page;
    }
    let torque =
        if channel == Channel::Slave && driven { "hand's torque" } else { "motor's torque" };
    let unit = channel.unit();
    rows.since_reversal
        .iter_mut()
        .filter(|since| **since > LONGEST_S)
        .for_each(|since| *since = f64::NAN);
    let mut spectral = false;
    let mut spectrum = Figure::new("", "frequency / Hz", format!("residual / ({unit}/√Hz)"))
        .size(SIZE.0, SIZE.1)
        .log_x()
        .log_y();
    for (name, colour, stretches) in drawn(&of_before, &of_after, with) {
        let (hz, amplitude) = density(stretches, pace_s);
        spectral |= !hz.is_empty();
        spectrum = spectrum.line(colour, name, &hz, &amplitude);
    }
    let panels = [
        rows.over("position", "rad", unit, &rows.position),
        rows.over("velocity", "rad/s", unit, &rows.velocity),
        rows.over(torque, "N·m", unit, &rows.torque),
        rows.over("time since the last reversal", "s", unit, &rows.since_reversal),
        rows.over("time", "s", unit, &rows.time),
        spectral.then_some(spectrum),
    ];
    let sheet =
        Panels::new(format!("What the innovation of {} depends on", channel.column())).columns(2);
    let sheet = panels.into_iter().flatten().fold(sheet, Panels::panel);
    page.panels(&sheet, &format!("Innovation of {}.", channel.column()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_at_rest_has_not_reversed() {
        let since = since_reversal(&[0.0, 1.0, 0.0, 1.0, -0.05, -1.0, -1.0, 0.02, -1.0, 1.0], 0.1);
        assert!(since[..5].iter().all(|since| since.is_nan()));
        let expected = [0.0, 0.1, 0.2, 0.3, 0.0];
        assert!(
            since[5..]
                .iter()
                .zip(expected)
                .all(|(since, expected)| (since - expected).abs() < 1e-12),
            "{since:?}"
        );
    }

    #[test]
    fn a_plot_without_finite_values_is_left_out() {
        let row = vec![0.0, 1.0, 2.0];
        let rows = Rows { before: row.clone(), after: row.clone(), ..Rows::default() };
        assert!(rows.over("time since the last reversal", "s", "rad", &[f64::NAN; 3]).is_none());
        assert!(rows.over("time", "s", "rad", &row).is_some());
    }

    #[test]
    fn density_of_a_known_tone_and_of_known_noise() {
        // White: the mean square over the band of half the sampling frequency.
        let mut seed = 1u64;
        let noise: Vec<f64> = (0..4000)
            .map(|_| {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (seed >> 33) as f64 / f64::from(1u32 << 31) - 0.5
            })
            .collect();
        let (hz, amplitude) = density(&[&noise[..2000], &noise[2000..]], 4e-3);
        let expected = (1.0 / 12.0 / 125.0_f64).sqrt();
        let high = hz.iter().zip(&amplitude).filter(|(hz, _)| **hz > 20.0);
        assert!(high.clone().count() > 10);
        for (hz, amplitude) in high {
            assert!(
                (amplitude / expected - 1.0).abs() < 0.25,
                "{hz}: {amplitude}, expected {expected}"
            );
        }
        let tone: Vec<f64> = (0..2000)
            .map(|row| (std::f64::consts::TAU * 30.0 * 4e-3 * f64::from(row)).sin())
            .collect();
        let (hz, amplitude) = density(&[&tone], 4e-3);
        let most = amplitude
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .map(|(at, _)| hz[at])
            .unwrap();
        assert!((most / 30.0 - 1.0).abs() < 0.06, "{most}");
        assert!(density(&[], 4e-3).0.is_empty());
    }
}
