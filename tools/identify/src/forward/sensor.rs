//! What the sensors of a record mean: the torque cell's errors taken back, and readings that come late.

use std::borrow::Cow;

use plant::effects::{Effect, Moment, Site};
use plant::transmission::Reading;

use super::generic::{Table, Variable};
use super::record::Record;

/// Half the time over which speed and acceleration of a measured position are taken (s).
const REACH_S: f64 = 0.01;

/// A column as it was so many rows later, by straight lines; level at its end.
pub fn advanced(column: &[f64], rows: f64) -> Cow<'_, [f64]> {
    if rows <= 0.0 {
        return Cow::Borrowed(column);
    }
    let (whole, part) = (rows.floor() as usize, rows.fract());
    let at = |row: usize| column[row.min(column.len() - 1)];
    Cow::Owned((0..column.len()).map(|row| at(row + whole) * (1.0 - part) + at(row + whole + 1) * part).collect())
}

/// What a cell's error may depend on, as measured, at a row; 0 for what was not.
pub fn beside(record: &Record, variable: Variable, row: usize) -> f64 {
    let position = record.slave.as_deref().unwrap_or(&record.master);
    let reach = ((REACH_S / record.step_s).round() as usize).max(1);
    let here = row.clamp(reach, position.len() - 1 - reach);
    let (before, after, span) = (position[here - reach], position[here + reach], reach as f64 * record.step_s);
    match variable {
        Variable::Position => position[row],
        Variable::Velocity => (after - before) / (2.0 * span),
        Variable::Acceleration => (after - 2.0 * position[here] + before) / (span * span),
        // Nobody's torque is 0, whatever the cell shows.
        Variable::Torque if record.idle => 0.0,
        Variable::Torque => record.torque.as_ref().map_or(0.0, |torque| torque[row]),
        Variable::Time => record.start_s + row as f64 * record.step_s,
        Variable::Voltage => record.volts[row],
        Variable::VoltageTurning | Variable::VoltageMean | Variable::Deflection | Variable::Force => 0.0,
    }
}

/// The hand's torque on the slave, row by row: what was measured with the sensor's effects taken back. Where nobody is at the handle it
/// is 0, and what the channel shows beyond that is returned too.
pub fn hand_torque(record: &Record, effects: &mut [Box<dyn Effect>], tables: &[Table]) -> (Vec<f64>, Option<Vec<f64>>) {
    let rows = record.volts.len();
    let Some(torque) = &record.torque else { return (vec![0.0; rows], None) };
    let mut torque = torque.clone();
    for table in tables.iter().filter(|table| table.site == Site::Sensor) {
        for (row, shown) in torque.iter_mut().enumerate() {
            *shown -= table.value(beside(record, table.variable, row));
        }
    }
    if effects.is_empty() {
        return if record.idle { (vec![0.0; rows], Some(torque)) } else { (torque, None) };
    }
    let mut shown = |row: usize, hand_nm: f64| {
        let mut reading = Reading {
            motor_v: record.volts[row],
            master_rad: record.master[row],
            slave_rad: record.slave.as_ref().map_or(0.0, |slave| slave[row]),
            slave_torque_nm: hand_nm,
        };
        let time_s = record.start_s + row as f64 * record.step_s;
        let moment = Moment {
            time_s,
            master_position_rad: reading.master_rad,
            slave_position_rad: reading.slave_rad,
            ..Moment::default()
        };
        effects.iter_mut().for_each(|effect| effect.sense(&mut reading, &moment));
        reading.slave_torque_nm
    };
    if record.idle {
        let left = (0..rows).map(|row| torque[row] - shown(row, 0.0)).collect();
        return (vec![0.0; rows], Some(left));
    }
    // Each effect is straight on either side of no torque.
    let back = (0..rows).map(|row| {
        let at_rest = shown(row, 0.0);
        let beyond = torque[row] - at_rest;
        let slopes = [shown(row, 1.0) - at_rest, at_rest - shown(row, -1.0)];
        let slope = if beyond >= 0.0 { slopes[0] } else { slopes[1] };
        // A sensor that shows no torque of one sign says nothing of it.
        if slope.abs() < 0.05 { 0.0 } else { beyond / slope }
    });
    (back.collect(), None)
}
