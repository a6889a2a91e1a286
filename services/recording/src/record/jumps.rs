//! Jumps of an encoder: positions that change from a row to the next as no machine moves.

use std::io;

use super::{Finding, FindingKind};
use crate::column::{Cursor, nth};

/// Least size of a jump in the smallest steps of the column, which are encoder counts.
const LEAST_COUNTS: f64 = 8.0;
/// Least size in multiples of [`USUAL`] of the unevenness of the rows: where they are sparse, a
/// machine may accelerate noticeably between two of them. Measured machines reached two thirds
/// of it at most.
const LEAST_UNEVENNESS: f64 = 8.0;
/// The quantile of the unevenness that counts as usual.
const USUAL: f64 = 0.99;

/// A jump of a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// The row behind it, from 0.
    pub row: usize,
    /// Change beyond that of the rows around it, in the unit of the column.
    pub by: f64,
}

/// Returns where a position, in rows uniform in time, changes by much more than before and after:
/// an encoder that lost or regained counts, or a wrong reading.
pub fn jumps(position: &[f64]) -> Vec<Jump> {
    // What is in memory can be read.
    jumps_in(&mut Position(Cursor::of(position))).unwrap_or_default()
}

/// The rows of a position.
struct Position<'a>(Cursor<'a>);

impl Position<'_> {
    /// From a row to the next.
    fn step(&mut self, row: usize) -> io::Result<f64> {
        Ok(self.0.at(row + 1)? - self.0.at(row)?)
    }

    /// The second of three steps from a row on, beyond what those around it have.
    fn beyond(&mut self, row: usize) -> io::Result<f64> {
        Ok(self.step(row + 1)? - 0.5 * (self.step(row)? + self.step(row + 2)?))
    }
}

fn jumps_in(position: &mut Position<'_>) -> io::Result<Vec<Jump>> {
    let steps = position.0.len().saturating_sub(1);
    let beyond = steps.saturating_sub(2);
    if beyond == 0 {
        return Ok(Vec::new());
    }
    let mut count = f64::INFINITY;
    for row in 0..steps {
        let step = position.step(row)?.abs();
        if step > 0.0 {
            count = count.min(step);
        }
    }
    let at = ((beyond as f64 * USUAL) as usize).min(beyond - 1);
    let usual = nth(at, |take| {
        (0..beyond).try_for_each(|row| position.beyond(row).map(|own| take(own.abs())))
    })?;
    let least = f64::max(LEAST_COUNTS * count, LEAST_UNEVENNESS * usual);
    let mut found = Vec::new();
    for at in 0..beyond {
        let by = position.beyond(at)?;
        if by.abs() > least && stands_out(position, at, by.abs())? {
            found.push(Jump { row: at + 2, by });
        }
    }
    Ok(found)
}

/// Whether what is beyond the steps around it is more than what is so of the rows around it.
fn stands_out(position: &mut Position<'_>, at: usize, own: f64) -> io::Result<bool> {
    let steps = position.0.len() - 1;
    let beyond = steps - 2;
    // A machine that meets a stop, or a channel at the end of its range, changes its speed
    // and keeps the new one; behind a jump the speed is the one before.
    let before = position.step(at.saturating_sub(1))?;
    let behind = position.step((at + 3).min(steps - 1))?;
    let returns = (behind - before).abs() < own;
    // The rows before and after it are off by half of it, the other way.
    for row in at.saturating_sub(2)..at {
        if position.beyond(row)?.abs() >= own {
            return Ok(false);
        }
    }
    for row in (at + 1..at + 3).filter(|row| *row < beyond) {
        if position.beyond(row)?.abs() > own {
            return Ok(false);
        }
    }
    Ok(returns)
}

/// Whether a column is a position (rad or m).
fn is_position(column: &str) -> bool {
    column.ends_with("_rad") || column.ends_with("_m")
}

/// What a person should check about a column's jumps.
pub(super) fn jumping(
    column: &str,
    values: Cursor<'_>,
    first_row: u64,
) -> io::Result<Option<Finding>> {
    let found = if is_position(column) { jumps_in(&mut Position(values))? } else { Vec::new() };
    let Some(first) = found.first() else { return Ok(None) };
    let largest = found.iter().map(|jump| jump.by.abs()).fold(0.0, f64::max);
    let unit = if column.ends_with("_rad") { "rad" } else { "m" };
    let how = match found.len() {
        1 => format!("once from a row to the next, by {largest:.3e} {unit}"),
        times => format!("{times} times from a row to the next, by up to {largest:.3e} {unit}"),
    };
    Ok(Some(Finding {
        column: column.to_owned(),
        kind: FindingKind::Jumping,
        first_row: first_row + first.row as u64,
        rows: found.len() as u64,
        text: format!(
            "jumps {how}, as no machine moves: the encoder lost or regained counts, or a reading \
             is wrong; check the encoder's cable, supply and highest count rate"
        ),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jumping(column: &str, values: &[f64], first_row: u64) -> Option<Finding> {
        super::jumping(column, Cursor::of(values), first_row).unwrap()
    }

    /// A movement in encoder counts of 1.57 mrad, at 2 kHz.
    fn movement(rows: usize) -> Vec<f64> {
        let count = std::f64::consts::TAU / 4000.0;
        let at = |row: usize| 0.5 * (0.004 * row as f64).sin() + 0.1 * (0.03 * row as f64).sin();
        (0..rows).map(|row| (at(row) / count).round() * count).collect()
    }

    #[test]
    fn lost_counts_are_found_with_row_and_size_and_movement_is_not() {
        assert_eq!(jumps(&movement(8000)), vec![]);
        let mut lost = movement(8000);
        lost[3000..].iter_mut().for_each(|position| *position -= 0.03);
        lost[5000..].iter_mut().for_each(|position| *position += 0.02);
        let found = jumps(&lost);
        let rows: Vec<usize> = found.iter().map(|jump| jump.row).collect();
        assert_eq!(rows, [3000, 5000]);
        assert!((found[0].by + 0.03).abs() < 3e-3 && (found[1].by - 0.02).abs() < 3e-3);
    }

    #[test]
    fn one_wrong_reading_is_a_jump_there() {
        let mut wrong = movement(4000);
        wrong[1500] += 0.5;
        let rows: Vec<usize> = jumps(&wrong).iter().map(|jump| jump.row).collect();
        assert!(rows.iter().all(|row| (1500..=1501).contains(row)) && !rows.is_empty(), "{rows:?}");
    }

    #[test]
    fn sparse_rows_of_a_fast_movement_have_no_jumps() {
        let sparse: Vec<f64> = movement(40_000).iter().step_by(20).copied().collect();
        assert_eq!(jumps(&sparse), vec![]);
        assert!(jumps(&[0.0, 1.0]).is_empty() && jumps(&[0.25; 50]).is_empty());
    }

    #[test]
    fn a_stop_and_the_end_of_a_range_are_no_jumps() {
        let at = |row: usize| (0.01 * row as f64).sin();
        for end in [0.3, 0.55, 0.8] {
            let stopped: Vec<f64> = (0..2000).map(|row| at(row).clamp(-end, end)).collect();
            assert_eq!(jumps(&stopped), vec![], "{end}");
            // A hand that meets a stop and is thrown back from it.
            let thrown = |row: usize| end - (at(row) - end).abs();
            assert_eq!(jumps(&(0..2000).map(thrown).collect::<Vec<_>>()), vec![], "{end}");
        }
    }

    #[test]
    fn positions_alone_are_checked() {
        let mut lost = movement(4000);
        lost[2000..].iter_mut().for_each(|position| *position += 0.03);
        assert_eq!(jumping("slave_torque_nm", &lost, 2), None);
        assert_eq!(jumping("motor_v", &lost, 2), None);
        let found = jumping("slave_rad", &lost, 2).map(|found| (found.first_row, found.rows));
        assert_eq!(found, Some((2002, 1)));
        assert!(jumping("position_m", &lost, 2).is_some());
    }
}
