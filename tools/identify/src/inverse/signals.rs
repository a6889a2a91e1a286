//! From measured position and force to the rows of a regression.

use crate::filter::{ZeroPhase, derivatives};

/// Cut-off of the low-pass (one pass) (Hz); a tenth of the sampling frequency where that is lower.
pub const CUT_OFF_HZ: f64 = 40.0;

/// Rows per cut-off frequency that are kept after the low-pass: five, since nothing is left above the cut-off.
const ROWS_PER_CUT_OFF: f64 = 5.0;

/// Filtered motion of one record at its full rate.
#[derive(Clone, Debug)]
pub struct Signals {
    /// Time (s).
    pub time: Vec<f64>,
    /// Position, low-passed (m or rad).
    pub position: Vec<f64>,
    /// Velocity: derivative of the low-passed position (m/s or rad/s).
    pub velocity: Vec<f64>,
    /// Acceleration: second derivative of the low-passed position.
    pub acceleration: Vec<f64>,
    filter: ZeroPhase,
    stride: usize,
}

/// One record, ready for regression.
#[derive(Clone, Debug)]
pub struct Balance {
    /// Name of the record.
    pub name: String,
    /// Motion at the full rate.
    pub signals: Signals,
    /// Measured force, low-passed, one value per row (N or N·m).
    pub force: Vec<f64>,
    /// Cut-off of the low-pass (Hz).
    pub cut_off: f64,
}

impl Balance {
    /// Low-passes position and force alike (see [`crate::filter`]) and takes derivatives of the position. `None` where the
    /// record is too short to leave a row.
    pub fn new(name: &str, time: &[f64], position: &[f64], force: &[f64]) -> Option<Self> {
        let step = (time.last()? - time.first()?) / (time.len().checked_sub(1)? as f64);
        let sampling = 1.0 / step;
        let cut_off = CUT_OFF_HZ.min(0.1 * sampling);
        let filter = ZeroPhase::new(cut_off, sampling)?;
        let stride = ((sampling / (ROWS_PER_CUT_OFF * cut_off)).floor() as usize).max(1);
        let position = filter.run(position);
        let (velocity, acceleration) = derivatives(&position, step);
        let signals = Signals { time: time.to_vec(), position, velocity, acceleration, filter, stride };
        let force = signals.low_passed_rows(force);
        (!force.is_empty()).then(|| Self { name: name.to_owned(), signals, force, cut_off })
    }

    /// Rows of the regression.
    pub fn rows(&self) -> usize {
        self.force.len()
    }

    /// Seconds from one row to the next.
    pub fn row_step(&self) -> f64 {
        let s = &self.signals;
        s.stride as f64 * (s.time[s.time.len() - 1] - s.time[0]) / (s.time.len() - 1) as f64
    }
}

impl Signals {
    /// Rows of a full-rate signal that is linear in the filtered motion: edges cut, every `stride`th sample.
    pub fn rows(&self, full: &[f64]) -> Vec<f64> {
        let settled = self.filter.settling();
        if full.len() <= 2 * settled {
            return Vec::new();
        }
        full[settled..full.len() - settled].iter().step_by(self.stride).copied().collect()
    }

    /// As [`Self::rows`], after the low-pass: for measured force and for nonlinear functions of the motion.
    pub fn low_passed_rows(&self, full: &[f64]) -> Vec<f64> {
        self.rows(&self.filter.run(full))
    }

    /// Sign of the velocity, smoothed: `tanh(v / smoothing)`. A hard sign would make noise at standstill switch
    /// the whole friction; the width is fitted.
    pub fn sign(&self, smoothing: f64) -> Vec<f64> {
        self.velocity.iter().map(|v| (v / smoothing).tanh()).collect()
    }
}
