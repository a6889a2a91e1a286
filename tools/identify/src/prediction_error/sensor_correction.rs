//! Correction of measured columns: errors of the torque sensor, and readings that come late.

use std::borrow::Cow;
use std::f64::consts::{FRAC_PI_2, PI};

use plant::effects::{Effect, Moment, Site};
use plant::transmission::Reading;

use super::nonparametric::{PiecewiseLinear, Variable};
use super::record::Record;

/// Half the span of finite differences for speed and acceleration (s).
const REACH_S: f64 = 0.01;

/// Half the length of the interpolator (rows).
const HALF: usize = 16;

/// Advances a column by a number of rows; constant at its ends.
///
/// Between rows by a windowed sinc, which passes nearly all frequencies alike. Linear interpolation
/// would average the quantisation noise of two rows, by up to 30 %, and so make a dead time that is
/// not there lower the error.
pub fn advanced(column: &[f64], rows: f64) -> Cow<'_, [f64]> {
    if rows <= 0.0 {
        return Cow::Borrowed(column);
    }
    let (whole, part) = (rows.floor() as usize, rows.fract());
    let at = |row: usize| column[row.saturating_sub(HALF - 1).min(column.len() - 1)];
    let count = column.len();
    if part == 0.0 {
        return Cow::Owned((0..count).map(|row| at(row + whole + HALF - 1)).collect());
    }
    let padded: Vec<f64> = (whole..whole + count + 2 * HALF - 1).map(at).collect();
    let mut later = vec![0.0; count];
    for (tap, weight) in interpolator(part).into_iter().enumerate() {
        for (row, value) in later.iter_mut().zip(&padded[tap..]) {
            *row += weight * value;
        }
    }
    Cow::Owned(later)
}

/// Weights of the rows from `HALF - 1` before to `HALF` after, for a part of a row between 0 and 1:
/// a sinc under Hann's window, with the sum 1.
fn interpolator(part: f64) -> [f64; 2 * HALF] {
    let weights: [f64; 2 * HALF] = std::array::from_fn(|tap| {
        let off = tap as f64 - (HALF - 1) as f64 - part;
        let sinc = if off == 0.0 { 1.0 } else { (PI * off).sin() / (PI * off) };
        sinc * (FRAC_PI_2 * off / HALF as f64).cos().powi(2)
    });
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// Returns the measured variable on which a torque sensor's error may depend, at a row; 0 if not
/// measured.
pub fn variable_at(record: &Record, variable: Variable, row: usize) -> f64 {
    let position = record.slave.as_deref().unwrap_or(&record.master);
    let reach = ((REACH_S / record.step_s).round() as usize).max(1);
    let here = row.clamp(reach, position.len() - 1 - reach);
    let (before, after, span) =
        (position[here - reach], position[here + reach], reach as f64 * record.step_s);
    match variable {
        Variable::Position => position[row],
        Variable::Velocity => (after - before) / (2.0 * span),
        Variable::Acceleration => (after - 2.0 * position[here] + before) / (span * span),
        // Without a hand the torque is 0, whatever the sensor shows.
        Variable::Torque if record.idle => 0.0,
        Variable::Torque => record.torque.as_ref().map_or(0.0, |torque| torque[row]),
        Variable::Time => record.start_s + row as f64 * record.step_s,
        Variable::Voltage => record.volts[row],
        Variable::VoltageTurning
        | Variable::VoltageMean
        | Variable::Deflection
        | Variable::Force => 0.0,
    }
}

/// Returns the sensor's reading of a torque with its effects, at a row of a record.
pub fn reading_of(
    record: &Record,
    effects: &mut [Box<dyn Effect>],
    row: usize,
    hand_nm: f64,
) -> f64 {
    let mut reading = Reading {
        motor_v: record.volts[row],
        master_rad: record.master[row],
        slave_rad: record.slave.as_ref().map_or(0.0, |slave| slave[row]),
        slave_torque_nm: hand_nm,
    };
    let moment = Moment {
        time_s: record.start_s + row as f64 * record.step_s,
        master_position_rad: reading.master_rad,
        slave_position_rad: reading.slave_rad,
        ..Moment::default()
    };
    effects.iter_mut().for_each(|effect| effect.sense(&mut reading, &moment));
    reading.slave_torque_nm
}

/// Returns the hand torque on the slave, row by row: the reading with the sensor's effects
/// inverted. Without a hand it is 0, and the residual of the channel is returned too.
pub fn hand_torque(
    record: &Record,
    effects: &mut [Box<dyn Effect>],
    tables: &[PiecewiseLinear],
) -> (Vec<f64>, Option<Vec<f64>>) {
    let rows = record.volts.len();
    let Some(torque) = &record.torque else { return (vec![0.0; rows], None) };
    let mut torque = torque.clone();
    for table in tables.iter().filter(|table| table.site == Site::Sensor) {
        for (row, shown) in torque.iter_mut().enumerate() {
            *shown -= table.value(variable_at(record, table.variable, row));
        }
    }
    if effects.is_empty() {
        return if record.idle { (vec![0.0; rows], Some(torque)) } else { (torque, None) };
    }
    let mut shown = |row: usize, hand_nm: f64| reading_of(record, effects, row, hand_nm);
    if record.idle {
        let left = (0..rows).map(|row| torque[row] - shown(row, 0.0)).collect();
        return (vec![0.0; rows], Some(left));
    }
    // Each effect is linear on either side of zero.
    let back = (0..rows).map(|row| {
        let at_rest = shown(row, 0.0);
        let beyond = torque[row] - at_rest;
        let slopes = [shown(row, 1.0) - at_rest, at_rest - shown(row, -1.0)];
        // A rectified reading does not tell the sign.
        let negative = if slopes[1] < 0.0 {
            record.sign_flipped.get(row) == Some(&true)
        } else {
            beyond < 0.0
        };
        let slope = slopes[usize::from(negative)];
        // Without gain the torque cannot be recovered.
        if slope.abs() < 0.05 { 0.0 } else { beyond / slope }
    });
    (back.collect(), None)
}

#[cfg(test)]
mod tests {
    use plant::effects;

    use super::*;
    use crate::equation_error::block_roles::Role;
    use crate::prediction_error::nonparametric::NODES;

    const STEP_S: f64 = 2e-3;

    /// A slave with a constant acceleration of 2 rad/s², sampled every 2 ms, and a torque channel.
    fn record(torque: Option<Vec<f64>>, idle: bool) -> Record {
        let rows = torque.as_ref().map_or(100, Vec::len);
        let slave = (0..rows).map(|row| (row as f64 * STEP_S).powi(2)).collect();
        Record {
            name: "record".to_owned(),
            start_s: 10.0,
            step_s: STEP_S,
            volts: vec![1.5; rows],
            master: vec![0.25; rows],
            slave: Some(slave),
            torque,
            sign_flipped: Vec::new(),
            role: Role::Fit,
            count_rad: [1e-3; 2],
            idle,
            others: Vec::new(),
            steps: 1,
            jumps: Default::default(),
        }
    }

    fn close(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        let near =
            found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-9);
        assert!(near, "{found:?}, expected {expected:?}");
    }

    #[test]
    fn a_late_column_is_advanced_and_constant_at_its_ends() {
        let column = [0.0, 1.0, 3.0, 7.0];
        close(&advanced(&column, 1.0), &[1.0, 3.0, 7.0, 7.0]);
        assert!(matches!(advanced(&column, 0.0), Cow::Borrowed(_)));
        close(&advanced(&column, 40.5), &[7.0; 4]);
        let wave = |row: f64| (0.9 * row).sin() + (0.1 * row).cos();
        let column: Vec<f64> = (0..200).map(|row| wave(f64::from(row))).collect();
        for late in [0.25, 0.5, 3.9] {
            let found = advanced(&column, late);
            for row in 20..170 {
                assert!((found[row] - wave(row as f64 + late)).abs() < 2e-3, "{late} {row}");
            }
        }
    }

    /// A dead time must not lower the error by averaging the noise.
    #[test]
    fn noise_keeps_its_size_between_rows() {
        for part in [0.1, 0.3, 0.5, 0.7, 0.9] {
            let power: f64 = interpolator(part).iter().map(|weight| weight * weight).sum();
            assert!((0.94..1.0).contains(&power), "{part}: {power}");
            assert!((interpolator(part).iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn variables_of_a_sensor_error() {
        let record = record(Some(vec![0.5; 100]), false);
        let at = |variable, row| variable_at(&record, variable, row);
        assert!((at(Variable::Velocity, 50) - 2.0 * 50.0 * STEP_S).abs() < 1e-9);
        assert!((at(Variable::Acceleration, 50) - 2.0).abs() < 1e-9);
        // At an end, the nearest complete difference.
        assert!((at(Variable::Acceleration, 0) - 2.0).abs() < 1e-9);
        assert!((at(Variable::Time, 5) - 10.01).abs() < 1e-9);
        assert_eq!((at(Variable::Voltage, 3), at(Variable::Torque, 3)), (1.5, 0.5));
        let idle = Record { idle: true, ..record };
        assert_eq!(variable_at(&idle, Variable::Torque, 3), 0.0);
    }

    #[test]
    fn an_effect_of_the_torque_cell_is_inverted() {
        let truth = [1.0, -0.5, 0.0, 2.0];
        for (id, value) in [("sensor_gain", 0.2), ("sensor_offset", 0.3), ("rectified_sensor", 0.4)]
        {
            let effect = || effects::make(id, Site::Sensor, value).unwrap();
            let mut shown = truth.to_vec();
            for torque in &mut shown {
                let mut reading = Reading {
                    motor_v: 1.5,
                    master_rad: 0.25,
                    slave_rad: 0.0,
                    slave_torque_nm: *torque,
                };
                effect().sense(&mut reading, &Moment::default());
                *torque = reading.slave_torque_nm;
            }
            assert_ne!(shown, truth, "{id}");
            let (hand, left) = hand_torque(&record(Some(shown), false), &mut [effect()], &[]);
            close(&hand, &truth);
            assert!(left.is_none());
        }
    }

    #[test]
    fn the_torque_at_an_idle_handle_is_zero_whatever_the_cell_shows() {
        let idle = record(Some(vec![0.3; 4]), true);
        let (hand, left) = hand_torque(&idle, &mut [], &[]);
        assert_eq!((hand, left), (vec![0.0; 4], Some(vec![0.3; 4])));
        let offset = effects::make("sensor_offset", Site::Sensor, 0.3).unwrap();
        let (_, left) = hand_torque(&idle, &mut [offset], &[]);
        close(&left.unwrap(), &[0.0; 4]);
        assert_eq!(hand_torque(&record(None, false), &mut [], &[]), (vec![0.0; 100], None));
    }

    #[test]
    fn a_function_of_the_cell_is_subtracted_from_its_reading() {
        let mut table = PiecewiseLinear::new((Site::Sensor, Variable::Torque), -1.0, 1.0);
        for node in 0..NODES {
            table.values[node] = 0.1 * table.at(node);
        }
        let mut elsewhere = table.clone();
        (elsewhere.site, elsewhere.values) = (Site::Slave, [5.0; NODES]);
        let shown = [[0.5, -1.0, 3.0]; 10].concat();
        let (hand, _) = hand_torque(&record(Some(shown), false), &mut [], &[table, elsewhere]);
        close(&hand, &[[0.45, -0.9, 2.9]; 10].concat());
    }
}
