//! Rows of a regression from measured position and force.

use std::ops::{Deref, Range};

use plant::effects::one_channel::Motion;
use plant::effects::one_channel::samples::derivatives;

use crate::filter::ZeroPhase;
use crate::spectral::{LowPass, Spectrum};

/// Row rate after the low-pass, in cut-off frequencies.
const ROWS_PER_CUT_OFF: f64 = 5.0;

/// Oversampling factor of band-limited motion: even its cube stays below half the finer rate.
pub const FINER: usize = 4;

/// Share of the energy of the output below the edge of the band.
const BAND_ENERGY: f64 = 0.999;

/// Order of the difference that leaves noise and removes the movement.
const ORDER: usize = 6;
/// Its squared gain for white noise: the sum of its squared coefficients, `C(12, 6)`.
const GAIN_SQUARED: f64 = 924.0;

/// The low-pass that is applied to all signals of a record.
#[derive(Clone, Copy, Debug)]
enum Filter {
    /// Butterworth, forward and backward.
    ZeroPhase(ZeroPhase),
    /// In the frequency domain.
    Spectral(LowPass),
}

/// Filtered motion of one record, and how its rows are taken.
#[derive(Clone, Debug)]
pub struct Signals {
    /// Motion at the full rate.
    pub motion: Motion,
    filter: Filter,
    settling: usize,
    stride: usize,
}

/// One record, ready for regression.
#[derive(Clone, Debug)]
pub struct ForceBalance {
    /// Name of the record.
    pub name: String,
    /// Motion at the full rate.
    pub signals: Signals,
    /// Measured force, low-passed, one value per row (N or N·m).
    pub force: Vec<f64>,
    /// Cut-off of the low-pass (Hz).
    pub cut_off: f64,
    /// Time between two samples of the record (s).
    pub sampling: f64,
    /// Sixth differences of the position as recorded (m or rad), which are its noise, at the full
    /// rate; none where the noise is not known.
    pub differences: Vec<f64>,
}

/// The highest cut-off (Hz), and the largest as a share of the sampling frequency.
#[derive(Clone, Copy, Debug)]
pub struct CutOff {
    /// Highest (Hz).
    pub highest: f64,
    /// Largest share of the sampling frequency.
    pub share: f64,
}

impl ForceBalance {
    /// Low-passes position and force alike (see [`crate::filter`]) and differentiates the position.
    /// `None` if the record is too short to leave a row.
    pub fn new(
        name: &str,
        time: &[f64],
        position: &[f64],
        force: &[f64],
        limit: CutOff,
    ) -> Option<Self> {
        let step = (time.last()? - time.first()?) / (time.len().checked_sub(1)? as f64);
        let sampling = 1.0 / step;
        let cut_off = limit.highest.min(limit.share * sampling);
        let filter = ZeroPhase::new(cut_off, sampling)?;
        let stride = ((sampling / (ROWS_PER_CUT_OFF * cut_off)).floor() as usize).max(1);
        let differences = sixth_differences(position);
        let position = filter.run(position);
        let (velocity, acceleration) = derivatives(&position, step);
        let time = time.to_vec();
        let force = force.to_vec();
        let signals = Signals {
            motion: Motion { time, position, velocity, acceleration, force },
            settling: filter.settling(),
            filter: Filter::ZeroPhase(filter),
            stride,
        };
        Some(Self { differences, ..Self::of(name, signals, cut_off, step)? })
    }

    /// `None` if the signals leave no row.
    fn of(name: &str, signals: Signals, cut_off: f64, sampling: f64) -> Option<Self> {
        let force = signals.low_passed_rows(&signals.force);
        (!force.is_empty()).then(|| Self {
            name: name.to_owned(),
            signals,
            force,
            cut_off,
            sampling,
            differences: Vec::new(),
        })
    }

    /// The same for band-limited signals: motion and force are oversampled by [`FINER`], with
    /// spectral derivatives (see [`crate::spectral`]), and rows are the sampling instants. The
    /// cut-off is 1.25 times the frequency below which 99.9 % of the energy of the motion lies.
    /// `None` if the record is too short to leave a row.
    pub fn band_limited(name: &str, time: &[f64], position: &[f64], force: &[f64]) -> Option<Self> {
        let first = *time.first()?;
        let step = (time.last()? - first) / (time.len().checked_sub(1)? as f64);
        let sampling = 1.0 / step;
        let motion = Spectrum::of(position)?;
        let cut_off = (1.25 * motion.energy_below(BAND_ENERGY, sampling))
            .clamp(0.02 * sampling, 0.38 * sampling);
        let low_pass = LowPass { cut_off, sampling: sampling * FINER as f64 };
        let derivative = |order| motion.wave(FINER, order, sampling, |f| low_pass.weight(f));
        let signals = Signals {
            motion: Motion {
                time: (0..(time.len() - 1) * FINER + 1)
                    .map(|i| first + i as f64 * step / FINER as f64)
                    .collect(),
                position: derivative(0)?,
                velocity: derivative(1)?,
                acceleration: derivative(2)?,
                force: Spectrum::of(force)?.wave(FINER, 0, sampling, |_| 1.0)?,
            },
            // Rows must be sampling instants.
            settling: low_pass.settling().next_multiple_of(FINER),
            filter: Filter::Spectral(low_pass),
            stride: FINER,
        };
        Self::of(name, signals, cut_off, step)
    }

    /// Standard deviation of the white noise of the position; 0 where it is not known.
    pub fn position_noise(&self) -> f64 {
        noise_of(&self.differences)
    }

    /// The same within some rows: that of a coarse encoder vanishes where nothing moves.
    pub fn position_noise_in(&self, rows: &Range<usize>) -> f64 {
        let signals = &self.signals;
        let sample =
            |row: usize| (signals.settling + row * signals.stride).min(self.differences.len());
        noise_of(&self.differences[sample(rows.start)..sample(rows.end)])
    }

    /// Number of rows of the regression.
    pub fn rows(&self) -> usize {
        self.force.len()
    }

    /// Time between rows (s).
    pub fn row_step(&self) -> f64 {
        let s = &self.signals;
        s.stride as f64 * (s.time[s.time.len() - 1] - s.time[0]) / (s.time.len() - 1) as f64
    }
}

impl Deref for Signals {
    type Target = Motion;

    fn deref(&self) -> &Motion {
        &self.motion
    }
}

impl Signals {
    /// Samples at the full rate before the first row.
    pub fn before_rows(&self) -> usize {
        self.settling
    }

    /// Rows of a full-rate signal that is linear in the filtered motion: edges cut, every
    /// `stride`th sample.
    pub fn rows(&self, full: &[f64]) -> Vec<f64> {
        if full.len() <= 2 * self.settling {
            return Vec::new();
        }
        full[self.settling..full.len() - self.settling]
            .iter()
            .step_by(self.stride)
            .copied()
            .collect()
    }

    /// The low-pass, at the full rate.
    pub fn low_passed(&self, full: &[f64]) -> Vec<f64> {
        match &self.filter {
            Filter::ZeroPhase(filter) => filter.run(full),
            Filter::Spectral(filter) => filter.run(full),
        }
    }

    /// As [`Self::rows`], after the low-pass: for measured force and for nonlinear functions of the
    /// motion.
    pub fn low_passed_rows(&self, full: &[f64]) -> Vec<f64> {
        self.rows(&self.low_passed(full))
    }

    /// The rows alone, as signals at the row rate, for a coarse screening.
    pub fn thin(&self) -> Motion {
        Motion {
            time: self.rows(&self.time),
            position: self.rows(&self.position),
            velocity: self.rows(&self.velocity),
            acceleration: self.rows(&self.acceleration),
            force: self.rows(&self.force),
        }
    }

    /// Sign of the velocity, smoothed: `tanh(v / smoothing)`. With a hard sign, noise at standstill
    /// would switch the whole friction; the width is fitted.
    pub fn sign(&self, smoothing: f64) -> Vec<f64> {
        self.velocity.iter().map(|v| (v / smoothing).tanh()).collect()
    }
}

/// Returns the sixth differences of a signal, in which movements below a twentieth of the sampling
/// frequency lose all but a thousandth.
pub(super) fn sixth_differences(signal: &[f64]) -> Vec<f64> {
    let mut left = signal.to_vec();
    for _ in 0..ORDER {
        left = left.windows(2).map(|pair| pair[1] - pair[0]).collect();
    }
    left
}

/// Returns the standard deviation of the white noise of which these are the sixth differences.
pub(super) fn noise_of(differences: &[f64]) -> f64 {
    let squares: f64 = differences.iter().map(|value| value * value).sum();
    (squares / differences.len().max(1) as f64 / GAIN_SQUARED).sqrt()
}
