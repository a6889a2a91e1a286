//! One record: the machine under position control, as measured by its instruments.
//!
//! Conventions of a row: angles and torque are measured at `t_s`, the voltage is applied from `t_s`
//! to the next row.

use std::io::{self, Write};

use crate::deviation::Instruments;
use crate::random::Draw;
use crate::rules::{Conditions, Missing};
use crate::simulator::{Input, Simulator, State};

/// Rows per second.
pub const SAMPLE_HZ: f64 = 2000.0;
/// Length of a row, s.
pub const SAMPLE_S: f64 = 1.0 / SAMPLE_HZ;
/// Rows per record.
pub const SAMPLES: usize = 20_000;
/// Counts per turn of both encoders.
pub const COUNTS_PER_TURN: f64 = 4000.0;
/// From the start of one record to the start of the next, s.
pub const RECORD_TO_RECORD_S: f64 = 15.0;
/// The header of a file.
pub const HEADER: &str = "t_s,motor_v,master_rad,slave_rad,slave_torque_nm";

/// Voltage step of the DAC: 16 bit over ±10 V.
const DAC_STEP_V: f64 = 20.0 / 65_536.0;
/// Torque step of the ADC: 16 bit over ±10 V at 0.5 V/N·m.
const ADC_STEP_NM: f64 = 20.0 / 65_536.0 / 0.5;
/// Samples per control cycle: 500 Hz.
const CONTROL_SAMPLES: usize = 4;
/// Control of `hydrostatic.toml`: V/rad and V·s/rad.
const GAINS: [f64; 2] = [
    4.5e-3 * COUNTS_PER_TURN / std::f64::consts::TAU,
    7.0e-4 * COUNTS_PER_TURN / std::f64::consts::TAU,
];
const VELOCITY_FILTER_HZ: f64 = 40.0;
const OUTPUT_LIMIT_V: f64 = 8.0;
/// Feed-forward of friction at reversal and at speed, V; below, the speed over which its sign
/// changes and the speed at which it is lowest, rad/s.
const FRICTION_V: [f64; 2] = [1.5, 1.2];
const REVERSAL_RAD_S: f64 = 0.17;
const FRICTION_FLOOR_RAD_S: f64 = 3.0;
/// Feed-forward of inertia, V/(rad/s²).
const INERTIA_V: f64 = 8.0e-3;

/// Noise of instruments and surroundings.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Noise {
    /// Standard deviation of the white noise of the torque cell, N·m.
    pub torque_nm: f64,
    /// Standard deviation of the torque disturbance on master and slave, N·m.
    pub process_nm: [f64; 2],
    /// Its corner frequency, Hz.
    pub process_hz: f64,
}

impl Noise {
    /// Drawn for a case.
    pub fn drawn(draw: &mut Draw) -> Self {
        Self {
            torque_nm: draw.uniform(2e-3, 3e-3),
            process_nm: [draw.uniform(2e-3, 6e-3), draw.uniform(2e-3, 6e-3)],
            process_hz: draw.log_uniform(3.0, 20.0),
        }
    }
}

/// Columns of a record.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Time of the first row, s.
    pub start_s: f64,
    /// Volts.
    pub motor_v: Vec<f64>,
    /// Quantised angle of the master, rad.
    pub master_rad: Vec<f64>,
    /// Quantised angle of the slave, rad.
    pub slave_rad: Vec<f64>,
    /// Measured torque, N·m.
    pub slave_torque_nm: Vec<f64>,
}

/// The torque disturbance of a side: white noise through a first-order low-pass.
#[derive(Debug)]
struct Disturbance {
    value: f64,
    kept: f64,
    deviation: f64,
}

impl Disturbance {
    fn new(deviation: f64, corner_hz: f64, draw: &mut Draw) -> Self {
        let kept = (-std::f64::consts::TAU * corner_hz * SAMPLE_S).exp();
        Self { value: deviation * draw.normal(), kept, deviation }
    }

    fn next(&mut self, draw: &mut Draw) -> f64 {
        self.value = self.kept * self.value
            + (1.0 - self.kept * self.kept).sqrt() * self.deviation * draw.normal();
        self.value
    }
}

/// An angle quantised by the encoder, rad.
pub fn counted(angle: f64) -> f64 {
    let count = std::f64::consts::TAU / COUNTS_PER_TURN;
    (angle / count).round() * count
}

/// Runs the machine from rest at zero along a reference.
pub fn run(
    model: &mut Simulator,
    reference: &[f64],
    hand_nm: &[f64],
    start_s: f64,
    noise: &Noise,
    seed: u64,
) -> Record {
    let mut draw = Draw::new(seed);
    let mut record = Record { start_s, ..Record::default() };
    let mut disturbances =
        noise.process_nm.map(|size| Disturbance::new(size, noise.process_hz, &mut draw));
    let mut state = State::default();
    let mut control = Control::default();
    let zero_count = [draw.uniform(-0.5, 0.5), draw.uniform(-0.5, 0.5)]
        .map(|part| part * std::f64::consts::TAU / COUNTS_PER_TURN);
    let at = |values: &[f64], index: usize| {
        values.get(index.min(values.len().saturating_sub(1))).copied().unwrap_or(0.0)
    };
    for (index, _) in reference.iter().enumerate() {
        let local = index as f64 * SAMPLE_S;
        let time = start_s + local;
        let mut seen = Instruments {
            time_s: time,
            position: [state.0[0], state.0[2]],
            slave_velocity_rad_s: state.0[3],
            torque_nm: at(hand_nm, index),
            ..Instruments::default()
        };
        for deviation in model.deviations_mut() {
            deviation.sense_angles(&mut seen);
        }
        let master = counted(seen.position[0] + zero_count[0]);
        let slave = counted(seen.position[1] + zero_count[1]);
        let volts = control.volts(reference, index, master);
        record.motor_v.push(volts);
        seen.motor_v = volts;
        let input = Input {
            volts: &record.motor_v,
            hand_nm: [at(hand_nm, index), at(hand_nm, index + 1)],
            disturbance_nm: [0, 1].map(|side| disturbances[side].next(&mut draw)),
            pull: [0.0; 4],
        };
        let rates = model.advance(&mut state, time, local, &input);
        seen.slave_acceleration_rad_s2 = rates[3];
        for deviation in model.deviations_mut() {
            deviation.sense_torque(&mut seen);
        }
        let torque = seen.torque_nm + noise.torque_nm * draw.normal();
        record.master_rad.push(master);
        record.slave_rad.push(slave);
        record.slave_torque_nm.push((torque / ADC_STEP_NM).round() * ADC_STEP_NM);
    }
    record
}

/// PD control with feed-forward, as in the rig file.
#[derive(Debug, Default)]
struct Control {
    volts: f64,
    velocity: f64,
    last: Option<f64>,
}

impl Control {
    fn volts(&mut self, reference: &[f64], index: usize, master: f64) -> f64 {
        if !index.is_multiple_of(CONTROL_SAMPLES) {
            return self.volts;
        }
        let cycle = CONTROL_SAMPLES as f64 * SAMPLE_S;
        let difference = (master - self.last.unwrap_or(master)) / cycle;
        self.last = Some(master);
        let share = 1.0 - (-std::f64::consts::TAU * VELOCITY_FILTER_HZ * cycle).exp();
        self.velocity += share * (difference - self.velocity);
        // The reference's speed and acceleration over one cycle to either side.
        let of =
            |index: usize| reference.get(index.min(reference.len() - 1)).copied().unwrap_or(0.0);
        let (before, now, after) =
            (of(index.saturating_sub(CONTROL_SAMPLES)), of(index), of(index + CONTROL_SAMPLES));
        let speed = 0.5 * (after - before) / cycle;
        let acceleration = (after - 2.0 * now + before) / (cycle * cycle);
        let fall = (speed.abs() / FRICTION_FLOOR_RAD_S).min(1.0);
        let friction = FRICTION_V[0] + (FRICTION_V[1] - FRICTION_V[0]) * fall;
        let wanted = GAINS[0] * (now - master)
            + GAINS[1] * (speed - self.velocity)
            + friction * (speed / REVERSAL_RAD_S).clamp(-1.0, 1.0)
            + INERTIA_V * acceleration;
        self.volts =
            (wanted.clamp(-OUTPUT_LIMIT_V, OUTPUT_LIMIT_V) / DAC_STEP_V).round() * DAC_STEP_V;
        self.volts
    }
}

impl Record {
    /// Writes the record as a CSV file, as its conditions have it: the voltage of a row is the
    /// mean until the next. `seed` draws the rows that are lost.
    ///
    /// # Errors
    /// What the writer says.
    pub fn write(&self, to: &mut impl Write, taken: &Conditions, seed: u64) -> io::Result<()> {
        let mut draw = Draw::new(seed);
        let columns: Vec<&str> = HEADER
            .split(',')
            .filter(|name| taken.missing.is_none_or(|it| it.name() != *name))
            .collect();
        writeln!(to, "{}", columns.join(","))?;
        let mut before_lost = true;
        for index in (0..self.motor_v.len()).step_by(taken.stride) {
            // Not two in succession, and not the first.
            before_lost = !before_lost && draw.uniform(0.0, 1.0) < taken.lost;
            if before_lost {
                continue;
            }
            let time = self.start_s + index as f64 * SAMPLE_S;
            let until = (index + taken.stride).min(self.motor_v.len());
            let held = &self.motor_v[index..until];
            let volts = held.iter().sum::<f64>() / held.len() as f64;
            write!(to, "{time:.4},{volts:.6},{:.8}", self.master_rad[index])?;
            if taken.missing != Some(Missing::SlaveAngle) {
                write!(to, ",{:.8}", self.slave_rad[index])?;
            }
            if taken.missing != Some(Missing::SlaveTorque) {
                write!(to, ",{:.6}", self.slave_torque_nm[index])?;
            }
            writeln!(to)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_parameters::MachineParameters;
    use crate::reference::{Kind, reference};
    use crate::smoothing::{Shape, Smoothing};

    fn recorded(samples: usize) -> Record {
        let smoothing = Smoothing { shape: Shape::Root, speed_rad_s: 0.06 };
        let mut model =
            Simulator::new(MachineParameters::declared(), smoothing, Vec::new(), SAMPLE_S).unwrap();
        let noise = Noise { torque_nm: 2.5e-3, process_nm: [4e-3; 2], process_hz: 10.0 };
        let reference = reference(Kind::Multisine, &mut Draw::new(3), samples, SAMPLE_S);
        run(&mut model, &reference, &[], 15.0, &noise, 1)
    }

    #[test]
    fn a_file_has_its_header_and_all_rows() {
        let record = recorded(200);
        let mut text = Vec::new();
        record.write(&mut text, &Conditions::default(), 1).unwrap();
        let text = String::from_utf8(text).unwrap();
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some("t_s,motor_v,master_rad,slave_rad,slave_torque_nm"));
        let rows: Vec<Vec<f64>> = lines
            .map(|line| line.split(',').map(|field| field.parse().unwrap()).collect())
            .collect();
        assert_eq!(rows.len(), 200);
        assert!(rows.iter().all(|row| row.len() == 5));
        assert_eq!((rows[0][0], rows[1][0]), (15.0, 15.0005));
        assert!((rows[150][2] - record.master_rad[150]).abs() < 1e-8);
    }

    #[test]
    fn a_file_as_its_conditions_have_it() {
        let record = recorded(4000);
        let taken =
            Conditions { stride: 4, lost: 0.1, missing: Some(Missing::SlaveAngle), stuck: None };
        let mut text = Vec::new();
        record.write(&mut text, &taken, 7).unwrap();
        let text = String::from_utf8(text).unwrap();
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some("t_s,motor_v,master_rad,slave_torque_nm"));
        let rows: Vec<Vec<f64>> = lines
            .map(|line| line.split(',').map(|field| field.parse().unwrap()).collect())
            .collect();
        assert!((860..960).contains(&rows.len()), "{} of 1000", rows.len());
        let steps = rows.windows(2).map(|two| ((two[1][0] - two[0][0]) / 0.002).round());
        let steps: Vec<f64> = steps.collect();
        assert!(steps.iter().all(|step| *step == 1.0 || *step == 2.0) && steps.contains(&2.0));
        for row in &rows {
            let index = ((row[0] - record.start_s) * SAMPLE_HZ).round() as usize;
            assert!((row[1] - record.motor_v[index]).abs() < 1e-6, "held for a control cycle");
            assert!((row[2] - record.master_rad[index]).abs() < 1e-8);
        }
    }

    #[test]
    fn readings_are_whole_counts_and_volts_whole_steps() {
        let record = recorded(6000);
        let count = std::f64::consts::TAU / 4000.0;
        for angle in record.master_rad.iter().chain(&record.slave_rad) {
            assert!((angle / count - (angle / count).round()).abs() < 1e-6, "{angle}");
        }
        for volts in &record.motor_v {
            assert!((volts / DAC_STEP_V - (volts / DAC_STEP_V).round()).abs() < 1e-6, "{volts}");
        }
        assert!(record.master_rad.iter().any(|angle| angle.abs() > 0.2), "it moved");
        // Held for a cycle of control.
        assert!(record.motor_v.chunks(4).all(|cycle| cycle.iter().all(|volts| *volts == cycle[0])));
    }

    #[test]
    fn the_master_follows_its_reference() {
        let samples = 12_000;
        let record = recorded(samples);
        let wanted = reference(Kind::Multisine, &mut Draw::new(3), samples, SAMPLE_S);
        let rms = |values: &mut dyn Iterator<Item = f64>| {
            (values.map(|value| value * value).sum::<f64>() / samples as f64).sqrt()
        };
        let error = rms(&mut record.master_rad.iter().zip(&wanted).map(|(is, should)| is - should));
        let movement = rms(&mut wanted.iter().copied());
        assert!(error < 0.35 * movement, "{error} of {movement}");
    }
}
