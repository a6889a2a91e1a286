//! Samples of one axis, made into the rows with which the model is compared.

use std::collections::VecDeque;

use ipc_types::Sample;
use plant::thinning::{centred, held, samples_in_row};
use plant::transmission::Input;

/// One row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row {
    /// Tick of the sample at its beginning.
    pub tick: u64,
    /// Position of the model's master at its beginning (rad).
    pub master_rad: f64,
    /// Position of the slave at its beginning (rad); `None` without an encoder there.
    pub slave_rad: Option<f64>,
    /// Motor voltage and torque of the hand during the row; without a torque cell, no torque.
    pub input: Input,
}

/// What a sample gives.
#[derive(Clone, Copy, Debug)]
struct Reading {
    tick: u64,
    /// Zeros that positions count from, by number.
    homing: u64,
    master_rad: f64,
    slave_rad: Option<f64>,
    volts: f64,
    torque_nm: Option<f64>,
}

/// What became of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Taken {
    /// It is needed for a later row.
    Nothing,
    /// A row is complete.
    Row(Row),
    /// Rows do not go on from those before: samples are missing, or positions count from another
    /// zero.
    Restart,
}

/// Thins samples to rows: voltage and torque, which are held, by their mean; positions by a centred
/// average. Does not allocate after it is made.
#[derive(Clone, Debug)]
pub struct RowFilter {
    axis: usize,
    gear: f64,
    every: usize,
    waiting: VecDeque<Reading>,
    /// Number of the first waiting sample that begins a row.
    begins: usize,
}

impl RowFilter {
    /// For an axis whose motor turns `gear` times per turn of its measured position, with samples
    /// at this rate (Hz).
    pub fn new(axis: usize, gear: f64, rate_hz: u32) -> Self {
        let every = samples_in_row(1.0 / f64::from(rate_hz)).max(1);
        Self { axis, gear, every, waiting: VecDeque::with_capacity(2 * every + 2), begins: 0 }
    }

    /// Time between rows (s), for samples at this rate (Hz).
    pub fn step_s(&self, rate_hz: u32) -> f64 {
        self.every as f64 / f64::from(rate_hz)
    }

    /// Takes the next sample; one that was read again is left out.
    pub fn take(&mut self, sample: &Sample) -> Taken {
        let last = self.waiting.back().copied();
        if last.is_some_and(|last| sample.tick <= last.tick && last.tick - sample.tick < 10_000) {
            return Taken::Nothing;
        }
        let Some(reading) = self.read(sample) else {
            self.waiting.clear();
            return if last.is_some() { Taken::Restart } else { Taken::Nothing };
        };
        let follows = |last: &Reading| {
            last.tick + 1 == reading.tick
                && last.homing == reading.homing
                && last.slave_rad.is_some() == reading.slave_rad.is_some()
        };
        let restart = last.is_some_and(|last| !follows(&last));
        if restart {
            self.waiting.clear();
        }
        if self.waiting.is_empty() {
            self.begins = self.every / 2;
        }
        self.waiting.push_back(reading);
        if restart {
            return Taken::Restart;
        }
        self.row().map_or(Taken::Nothing, Taken::Row)
    }

    fn read(&self, sample: &Sample) -> Option<Reading> {
        let at = self.axis;
        let present = |bits: u8| bits >> at & 1 == 1;
        let slave = present(sample.slave_present).then(|| sample.slave_position[at]);
        let torque = present(sample.torque_present).then(|| sample.slave_torque[at]);
        let reading = Reading {
            tick: sample.tick,
            homing: sample.homing_sequence,
            master_rad: self.gear * sample.master_position[at],
            slave_rad: slave,
            volts: sample.motor_v[at],
            torque_nm: torque,
        };
        let finite = [Some(reading.master_rad), slave, torque, Some(reading.volts)];
        // Positions of an unhomed axis are not the model's, and its search drives it against stops
        // that no model has.
        let there = present(sample.master_present)
            && present(sample.motor_present)
            && present(sample.homed);
        (there && finite.into_iter().flatten().all(f64::is_finite)).then_some(reading)
    }

    fn row(&mut self) -> Option<Row> {
        let (first, every, reach) = (self.begins, self.every, self.every / 2);
        if self.waiting.len() < first + every.max(reach + 1) {
            return None;
        }
        let of = |at: usize| self.waiting.get(at);
        let mean = |value: fn(&Reading) -> f64| held(every, |at| of(first + at).map_or(0.0, value));
        let about = |value: fn(&Reading) -> f64| {
            centred(every, |off| of(first.saturating_add_signed(off)).map_or(0.0, value))
        };
        let head = of(first)?;
        let row = Row {
            tick: head.tick,
            master_rad: about(|reading| reading.master_rad),
            slave_rad: head.slave_rad.map(|_| about(|reading| reading.slave_rad.unwrap_or(0.0))),
            input: Input {
                motor_v: mean(|reading| reading.volts),
                hand_torque_nm: mean(|reading| reading.torque_nm.unwrap_or(0.0)),
            },
        };
        // Those before the next row's beginning, less its reach, are not needed any more.
        self.waiting.drain(..first + every - reach);
        self.begins = reach;
        Some(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(tick: u64) -> Sample {
        let mut sample = Sample {
            tick,
            master_present: 1,
            homed: 1,
            motor_present: 1,
            slave_present: 1,
            torque_present: 1,
            ..Sample::default()
        };
        // A position that rises evenly, and volts that are held over four samples.
        sample.master_position[0] = 1e-3 * tick as f64;
        sample.slave_position[0] = 2e-3 * tick as f64;
        sample.motor_v[0] = (tick / 4) as f64;
        sample.slave_torque[0] = 0.5;
        sample
    }

    #[test]
    fn rows_are_centred_and_hold_what_was_put_out() {
        let mut filter = RowFilter::new(0, 3.0, 2000);
        assert_eq!(filter.step_s(2000), 2e-3);
        let mut rows = Vec::new();
        for tick in 6..40 {
            match filter.take(&sample(tick)) {
                Taken::Row(row) => rows.push(row),
                other => assert_eq!(other, Taken::Nothing),
            }
        }
        // The first row begins two samples after the first.
        assert_eq!(rows.iter().map(|row| row.tick).collect::<Vec<_>>()[..3], [8, 12, 16]);
        for row in &rows {
            let tick = row.tick as f64;
            assert!((row.master_rad - 3e-3 * tick).abs() < 1e-12, "{row:?}");
            assert!((row.slave_rad.unwrap() - 2e-3 * tick).abs() < 1e-12, "{row:?}");
            let held = Input { motor_v: (row.tick / 4) as f64, hand_torque_nm: 0.5 };
            assert_eq!(row.input, held);
        }
    }

    #[test]
    fn a_gap_another_zero_and_an_absent_channel_restart() {
        let mut filter = RowFilter::new(0, 1.0, 2000);
        assert_eq!(filter.take(&sample(10)), Taken::Nothing);
        assert_eq!(filter.take(&sample(12)), Taken::Restart);
        assert_eq!(filter.take(&sample(12)), Taken::Nothing);
        let homed = Sample { homing_sequence: 1, ..sample(13) };
        assert_eq!(filter.take(&homed), Taken::Restart);
        let absent = Sample { master_present: 0, homing_sequence: 1, ..sample(14) };
        assert_eq!(filter.take(&absent), Taken::Restart);
        assert_eq!(filter.take(&absent), Taken::Nothing);
        assert_eq!(filter.take(&sample(15)), Taken::Nothing);
        let unhomed = Sample { homed: 0, ..sample(16) };
        assert_eq!(filter.take(&unhomed), Taken::Restart);
        assert_eq!(filter.take(&Sample { tick: 17, ..unhomed }), Taken::Nothing);
    }
}
