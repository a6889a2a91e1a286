//! Measured records of a transmission, checked and resampled.

use plant::thinning::{centred, held, samples_in_row};
use recording::record::jumps;

use super::other_axes::{OtherAcceleration, OtherAxis, accelerations};
use crate::equation_error::block_roles::Role;
use crate::error::{IdentifyError, Result};
use crate::input::Series;

/// One record.
#[derive(Clone, Debug)]
pub struct Record {
    /// File or segment, for messages.
    pub name: String,
    /// Time of the first row (s).
    pub start_s: f64,
    /// Time between rows (s).
    pub step_s: f64,
    /// Motor voltage, held from a row to the next (V).
    pub volts: Vec<f64>,
    /// Master position (rad).
    pub master: Vec<f64>,
    /// Slave position (rad), where it was measured.
    pub slave: Option<Vec<f64>>,
    /// Hand torque on the slave (N·m), where it was measured.
    pub torque: Option<Vec<f64>>,
    /// Rows whose torque was negative, if the sensor shows magnitudes only; else empty.
    pub sign_flipped: Vec<bool>,
    /// Its role.
    pub role: Role,
    /// Smallest change of master and slave between rows: one encoder count (rad).
    pub count_rad: [f64; 2],
    /// Whether nobody was at the handle: the torque channel shows sensor errors only.
    pub idle: bool,
    /// Accelerations of the other axes at the same handle, where they were recorded.
    pub others: Vec<OtherAcceleration>,
    /// Least number of simulation steps per row.
    pub steps: u32,
    /// Positions of master and slave behind each jump of their encoder (rad).
    pub jumps: [Vec<f64>; 2],
}

/// Approximate rate of residual rows (Hz), to which innovations are averaged.
const RESIDUAL_HZ: f64 = 250.0;
/// Transient of the observer, left out at the start (s).
pub const SETTLING_S: f64 = 0.2;
/// Shortest record (s).
const SHORTEST_S: f64 = 2.0;
/// Largest time between rows (s): 50 Hz, with the tolerance of uniform rows.
const SLOWEST_S: f64 = 0.02 * 1.02;
/// Largest rms torque of an idle channel after regression on a constant, time and voltage (N·m).
const IDLE_NM: f64 = 0.05;
/// A position with less range did not move (rad).
const STILL_RAD: f64 = 0.02;
/// Positions beyond this are counts or degrees (rad).
const FAR_RAD: f64 = 60.0;
/// Voltages beyond this are counts or millivolts (V).
const HIGH_V: f64 = 200.0;

impl Record {
    /// Checks the columns of a record and resamples them; `gear` is the number of turns of the
    /// model's master per turn of the measured one, `others` are the other axes at the same handle.
    ///
    /// # Errors
    /// If a column is missing, constant, not finite or implausible by orders of magnitude, or time
    /// is not uniform.
    pub fn new(
        series: &Series,
        gear: f64,
        others: &[OtherAxis],
        notes: &mut Vec<String>,
    ) -> Result<Self> {
        let time = series.time()?;
        let (_, volts) = series.any(&["motor_v"])?;
        let (_, master) = series.any(&["master_rad"])?;
        let (slave, torque) = (series.column("slave_rad"), series.column("slave_torque_nm"));
        for (name, column) in [
            ("motor_v", Some(volts)),
            ("master_rad", Some(master)),
            ("slave_rad", slave),
            ("slave_torque_nm", torque),
        ] {
            if column.is_some() {
                series.finite(name)?;
            }
        }
        for other in others {
            series.finite(&other.column())?;
        }
        let step_s = (time[time.len() - 1] - time[0]) / (time.len() - 1) as f64;
        if (time.len() as f64) * step_s < SHORTEST_S {
            let found = format!("{:.2} s", time.len() as f64 * step_s);
            let expected = format!("at least {SHORTEST_S} s of movement");
            return Err(IdentifyError::short(&series.file, found, expected));
        }
        check_plausible(series, step_s, notes)?;
        let torque = torque.map(<[f64]>::to_vec);
        let idle = torque.as_ref().is_none_or(|torque| is_idle(torque, volts, step_s));
        let whole = Self {
            name: series.file.clone(),
            start_s: time[0],
            step_s,
            volts: volts.to_vec(),
            master: master.iter().map(|position| gear * position).collect(),
            slave: slave.map(<[f64]>::to_vec),
            torque,
            sign_flipped: Vec::new(),
            role: series.role.unwrap_or(Role::Fit),
            count_rad: [gear * least_change(master), slave.map_or(0.0, least_change)],
            idle,
            others: accelerations(series, step_s, others),
            steps: 1,
            jumps: [Some(master), slave].map(|column| column.map_or_else(Vec::new, behind_jumps)),
        };
        Ok(whole.thinned())
    }

    /// Time of the row after the last (s).
    pub fn end_s(&self) -> f64 {
        self.start_s + self.volts.len() as f64 * self.step_s
    }

    /// Decimates to the simulation's row interval: voltage, torque and the accelerations of other
    /// axes, which are held between rows, by their means; positions by a centred average.
    #[must_use]
    pub fn thinned(self) -> Self {
        let every = samples_in_row(self.step_s);
        if every < 2 {
            return self;
        }
        let means = |column: &[f64]| -> Vec<f64> {
            column.chunks_exact(every).map(|rows| held(every, |at| rows[at])).collect()
        };
        let about = |column: &[f64]| -> Vec<f64> {
            let at = |row: isize| column[row.clamp(0, column.len() as isize - 1) as usize];
            (0..column.len() / every)
                .map(|row| (row * every) as isize)
                .map(|row| centred(every, |off| at(row + off)))
                .collect()
        };
        let others = self
            .others
            .iter()
            .map(|other| OtherAcceleration { axis: other.axis, rad_s2: means(&other.rad_s2) });
        Self {
            step_s: self.step_s * every as f64,
            volts: means(&self.volts),
            master: about(&self.master),
            slave: self.slave.as_deref().map(about),
            torque: self.torque.as_deref().map(means),
            others: others.collect(),
            ..self
        }
    }

    /// Longest step of the simulation (s).
    pub fn longest_step_s(&self) -> f64 {
        self.step_s / f64::from(self.steps)
    }

    /// Rows per residual row.
    pub fn decimation(&self) -> usize {
        ((1.0 / (RESIDUAL_HZ * self.step_s)).round() as usize).max(1)
    }

    /// Residual rows per channel.
    pub fn residual_rows(&self) -> usize {
        (self.volts.len() / self.decimation()).saturating_sub(self.settling_rows())
    }

    /// Residual rows left out at the start.
    pub fn settling_rows(&self) -> usize {
        (SETTLING_S / (self.step_s * self.decimation() as f64)).ceil() as usize
    }

    /// Time of each residual row (s).
    pub fn residual_times(&self) -> Vec<f64> {
        let width = self.decimation();
        // A mean belongs to the middle of its rows.
        let middle = 0.5 * (width - 1) as f64;
        (0..self.residual_rows())
            .map(|row| {
                self.start_s
                    + self.step_s * (((row + self.settling_rows()) * width) as f64 + middle)
            })
            .collect()
    }

    /// Averages a column like the residual.
    pub fn averaged(&self, column: &[f64]) -> Vec<f64> {
        let width = self.decimation();
        column
            .chunks_exact(width)
            .skip(self.settling_rows())
            .map(|rows| rows.iter().sum::<f64>() / width as f64)
            .collect()
    }
}

/// The positions behind the jumps of a position.
fn behind_jumps(position: &[f64]) -> Vec<f64> {
    jumps(position).iter().filter_map(|jump| position.get(jump.row).copied()).collect()
}

/// Why a record tells nothing about the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Uninformative {
    /// The column that does not change.
    pub column: &'static str,
    /// What it does instead.
    pub found: String,
    /// What to do where no record is better.
    pub advice: &'static str,
}

/// Returns the column for which a record, or a segment of one, tells nothing: a position that
/// hardly moved, or a voltage that never changed; `None` if there is no such column.
///
/// A slave that sticks does show that its friction exceeds the torque of the line. But the residual
/// of a position that stays within an encoder count is zero for every model that sticks, so that
/// the logarithm of its variance has no lower limit and would outweigh all other records.
pub fn uninformative(series: &Series) -> Option<Uninformative> {
    let known = |name| series.column(name).filter(|column| column.iter().all(|v| v.is_finite()));
    for column in ["master_rad", "slave_rad"] {
        if let Some(way) = known(column).map(range).filter(|way| *way < STILL_RAD) {
            return Some(Uninformative {
                column,
                found: format!("the position never moved (it stays within {way:.2e} rad)"),
                advice: "no inertia, friction or stiffness can be seen without movement; check \
                         the encoder, and move the machine",
            });
        }
    }
    let constant = known("motor_v").filter(|volts| range(volts) == 0.0)?;
    Some(Uninformative {
        column: "motor_v",
        found: format!("it is {} in all rows", constant.first()?),
        advice: "identify needs what the DAC put out; check the channel",
    })
}

/// Checks that columns move, are in SI units, and are not clipped.
fn check_plausible(series: &Series, step_s: f64, notes: &mut Vec<String>) -> Result<()> {
    let (_, volts) = series.any(&["motor_v"])?;
    let (_, master) = series.any(&["master_rad"])?;
    let (slave, torque) = (series.column("slave_rad"), series.column("slave_torque_nm"));
    let wrong = |column: &str, found: String, advice: &str| {
        Err(IdentifyError::channel(&series.file, column, found, advice))
    };
    if step_s > SLOWEST_S {
        let advice = "record at 50 Hz or more, better at 100: the line's resonance must be seen";
        return wrong("t_s", format!("a row every {step_s:.4} s"), advice);
    }
    if let Some(Uninformative { column, found, advice }) = uninformative(series) {
        return wrong(column, found, advice);
    }
    for (name, column) in [("master_rad", Some(master)), ("slave_rad", slave)] {
        if let Some(far) = column.map(peak).filter(|peak| *peak > FAR_RAD) {
            let advice = "positions are in rad: these look like counts or degrees";
            return wrong(name, format!("values up to {far:.4e}"), advice);
        }
    }
    if peak(volts) > HIGH_V {
        let advice = "this is the voltage at the amplifier, in V: these look like counts or mV";
        return wrong("motor_v", format!("values up to {:.4e}", peak(volts)), advice);
    }
    for (name, column) in [("motor_v", Some(volts)), ("slave_torque_nm", torque)] {
        let railed = if column.is_some() { series.railed(name) } else { 0.0 };
        if railed > 0.01 {
            let share = 100.0 * railed;
            notes.push(format!(
                "{}: {name} stands at its extreme for {share:.1} % of the rows: a clipped channel \
                 says less than the truth there",
                series.file
            ));
        }
    }
    Ok(())
}

/// Assigns roles in turn, separately to records with and without a hand, unless they are `fixed`.
pub fn share_out(records: &mut [Record], fixed: bool) {
    if fixed {
        return;
    }
    const ORDER: [Role; 7] =
        [Role::Fit, Role::Select, Role::Fit, Role::Report, Role::Fit, Role::Select, Role::Report];
    for idle in [true, false] {
        for (turn, record) in records.iter_mut().filter(|record| record.idle == idle).enumerate() {
            record.role = ORDER[turn % ORDER.len()];
        }
    }
    // Every role must be taken.
    let has = |records: &[Record], role| records.iter().any(|record| record.role == role);
    for role in [Role::Report, Role::Select] {
        if !has(records, role)
            && let Some(last) = records.iter().rposition(|record| record.role == Role::Fit)
            && records.iter().filter(|record| record.role == Role::Fit).count() > 1
        {
            records[last].role = role;
        }
    }
}

/// Returns pairs of records that repeat the same movement.
pub fn repeats(records: &[Record]) -> Vec<(usize, usize)> {
    let mut pairs = Vec::new();
    for (first, a) in records.iter().enumerate() {
        for (second, b) in records.iter().enumerate().skip(first + 1) {
            let rows = a.master.len().min(b.master.len());
            if a.master.len().abs_diff(b.master.len()) * 50 > rows || a.idle != b.idle {
                continue;
            }
            let difference = rms((0..rows).map(|row| a.master[row] - b.master[row]));
            let mean = a.master.iter().sum::<f64>() / a.master.len() as f64;
            if difference < 0.1 * rms(a.master.iter().map(|position| position - mean)) {
                pairs.push((first, second));
            }
        }
    }
    pairs
}

/// Root mean square; 0 for no values.
pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) =
        values.fold((0.0, 0usize), |(sum, count), value| (sum + value * value, count + 1));
    (sum / count.max(1) as f64).sqrt()
}

pub(super) fn range(values: &[f64]) -> f64 {
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    high - values.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Smallest non-zero change between rows; 0 if nothing changes.
fn least_change(values: &[f64]) -> f64 {
    // Smaller changes are rounding errors.
    let changes =
        values.windows(2).map(|rows| (rows[1] - rows[0]).abs()).filter(|change| *change > 1e-9);
    let least = changes.fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 0.0 }
}

fn peak(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |peak, value| value.abs().max(peak))
}

/// Whether nobody is at the handle: a constant, a drift and crosstalk from the motor voltage
/// explain the torque channel, averaged over 40 ms against noise and hum.
fn is_idle(torque: &[f64], volts: &[f64], step_s: f64) -> bool {
    let width = ((0.04 / step_s).round() as usize).max(1);
    let mean = |column: &[f64]| -> Vec<f64> {
        column.chunks_exact(width).map(|rows| rows.iter().sum::<f64>() / width as f64).collect()
    };
    let (torque, volts) = (mean(torque), mean(volts));
    let rows = torque.len();
    let columns = nalgebra::DMatrix::from_fn(rows, 3, |row, column| match column {
        0 => 1.0,
        1 => row as f64 / rows as f64,
        _ => volts[row],
    });
    let right = nalgebra::DVector::from_vec(torque);
    let normal = columns.transpose() * &columns;
    let Some(solution) =
        normal.cholesky().map(|normal| normal.solve(&(columns.transpose() * &right)))
    else {
        return false;
    };
    let left = right - columns * solution;
    (left.norm_squared() / rows.max(1) as f64).sqrt() < IDLE_NM
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(torque: impl Fn(f64) -> f64) -> Series {
        let time: Vec<f64> = (0..8000).map(|row| f64::from(row) * 5e-4).collect();
        let of = |f: &dyn Fn(f64) -> f64| time.iter().map(|t| f(*t)).collect::<Vec<f64>>();
        let columns = vec![
            ("motor_v".to_owned(), of(&|t| 3.0 * (5.0 * t).sin())),
            ("master_rad".to_owned(), of(&|t| (5.0 * t).sin())),
            ("slave_rad".to_owned(), of(&|t| 0.8 * (5.0 * t).sin())),
            ("slave_torque_nm".to_owned(), of(&torque)),
            ("t_s".to_owned(), time.clone()),
        ];
        Series { file: "a.csv".into(), columns, role: None, notes: Vec::new() }
    }

    #[test]
    fn an_idle_handle_is_detected_despite_offset_drift_crosstalk_and_hum() {
        let idle = |torque: &dyn Fn(f64) -> f64| {
            Record::new(&series(torque), 1.0, &[], &mut Vec::new()).unwrap().idle
        };
        assert!(idle(&|_| 0.0));
        assert!(idle(&|t| 0.3 + 0.05 * t + 0.06 * (5.0 * t).sin() + 0.1 * (314.159 * t).sin()));
        assert!(!idle(&|t| 2.0 * (3.0 * t).sin()));
    }

    #[test]
    fn implausible_columns_are_refused() {
        let refused = |edit: &dyn Fn(&mut Series)| {
            let mut series = series(|_| 0.0);
            edit(&mut series);
            Record::new(&series, 1.0, &[], &mut Vec::new()).unwrap_err().to_string()
        };
        let text = refused(&|series| series.columns[1].1.iter_mut().for_each(|value| *value = 0.1));
        assert!(text.contains("master_rad") && text.contains("never moved"), "{text}");
        let text =
            refused(&|series| series.columns[2].1.iter_mut().for_each(|value| *value *= 4000.0));
        assert!(text.contains("slave_rad") && text.contains("counts or degrees"), "{text}");
        let text = refused(&|series| series.columns[0].1.iter_mut().for_each(|value| *value = 1.0));
        assert!(text.contains("motor_v") && text.contains("in all rows"), "{text}");
        let text =
            refused(&|series| series.columns.iter_mut().for_each(|column| column.1.truncate(800)));
        assert!(text.contains("0.40 s"), "{text}");
    }

    #[test]
    fn rows_are_averaged_and_timed_alike() {
        let record = Record::new(&series(|_| 0.0), 2.0, &[], &mut Vec::new()).unwrap();
        assert_eq!((record.decimation(), record.step_s), (2, 2e-3));
        let times = record.residual_times();
        assert_eq!(times.len(), record.residual_rows());
        let master = record.averaged(&record.master);
        assert_eq!(master.len(), times.len());
        for (time, position) in times.iter().zip(&master) {
            assert!((position - 2.0 * (5.0 * time).sin()).abs() < 5e-3);
        }
    }
}
