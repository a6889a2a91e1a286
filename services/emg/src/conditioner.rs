//! The filters of one electrode.

use std::f64::consts::PI;

use biquad::{Biquad, Coefficients, DirectForm2Transposed, Type};
use thiserror::Error;

/// Quality factor of the notch: 1.7 Hz wide at 50 Hz.
const NOTCH_Q: f64 = 30.0;
/// Highest corner frequency as a share of the sampling rate.
pub const HIGHEST_SHARE: f64 = 0.45;
/// Sections of a fourth-order Butterworth filter.
const SECTIONS: usize = 2;

/// How the voltage of an electrode becomes activity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditioning {
    /// Lower corner of the band-pass: fourth-order Butterworth (Hz).
    pub low_hz: f64,
    /// Upper corner of the band-pass: fourth-order Butterworth (Hz).
    pub high_hz: f64,
    /// Frequency of the mains, which a notch takes out; `None`: no notch (Hz).
    pub notch_hz: Option<f64>,
    /// Corner of the envelope's low-pass: second-order Butterworth (Hz).
    pub envelope_hz: f64,
    /// Volumes over which the scanner's gradient artefact is averaged, to be subtracted; 0: none.
    pub artefact_volumes: u32,
}

impl Default for Conditioning {
    /// The thesis's band (§ 2.2: 10 to 400 Hz), and an envelope as is usual for surface EMG.
    fn default() -> Self {
        Self {
            low_hz: 10.0,
            high_hz: 400.0,
            notch_hz: Some(50.0),
            envelope_hz: 5.0,
            artefact_volumes: 0,
        }
    }
}

/// Why a signal cannot be filtered so.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error(
    "expected filters between 0 and {HIGHEST_SHARE} of the {rate_hz} Hz of sampling, found \
     {found_hz} Hz"
)]
pub struct ConditioningError {
    /// Sampling rate (Hz).
    pub rate_hz: f64,
    /// Corner or centre frequency (Hz).
    pub found_hz: f64,
}

/// A sample of an electrode, in the electrode's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Activity {
    /// After band-pass and notch.
    pub filtered: f64,
    /// Its magnitude.
    pub rectified: f64,
    /// The magnitude after the envelope's low-pass.
    pub envelope: f64,
}

type Section = DirectForm2Transposed<f64>;

/// Filters one electrode, sample by sample.
#[derive(Clone, Copy, Debug)]
pub struct Conditioner {
    high_pass: [Section; SECTIONS],
    low_pass: [Section; SECTIONS],
    notch: Option<Section>,
    envelope: Section,
}

impl Conditioner {
    /// Filters at rest, for a signal that is sampled at `rate_hz`.
    ///
    /// # Errors
    /// [`ConditioningError`] where a frequency is not positive, or above [`HIGHEST_SHARE`] of the
    /// rate.
    pub fn new(how: &Conditioning, rate_hz: f64) -> Result<Self, ConditioningError> {
        let section = |kind: Type<f64>, at_hz: f64, q: f64| {
            let error = ConditioningError { rate_hz, found_hz: at_hz };
            // Written such that NaN fails, too.
            if !(at_hz > 0.0 && at_hz <= HIGHEST_SHARE * rate_hz) {
                return Err(error);
            }
            let coefficients = Coefficients::from_normalized_params(kind, 2.0 * at_hz / rate_hz, q);
            Ok(Section::new(coefficients.map_err(|_| error)?))
        };
        let fourth_order = |kind: Type<f64>, at_hz: f64| {
            let [first, second] = butterworth_q();
            Ok([section(kind, at_hz, first)?, section(kind, at_hz, second)?])
        };
        Ok(Self {
            high_pass: fourth_order(Type::HighPass, how.low_hz)?,
            low_pass: fourth_order(Type::LowPass, how.high_hz)?,
            notch: how.notch_hz.map(|at_hz| section(Type::Notch, at_hz, NOTCH_Q)).transpose()?,
            envelope: section(Type::LowPass, how.envelope_hz, std::f64::consts::FRAC_1_SQRT_2)?,
        })
    }

    /// Takes a sample.
    pub fn update(&mut self, value: f64) -> Activity {
        let filtered = self.filter(value);
        let rectified = filtered.abs();
        Activity { filtered, rectified, envelope: self.smooth(rectified) }
    }

    /// Band-pass and notch.
    pub(crate) fn filter(&mut self, value: f64) -> f64 {
        let sections = self.high_pass.iter_mut().chain(&mut self.low_pass).chain(&mut self.notch);
        sections.fold(value, |value, section| section.run(value))
    }

    /// The envelope's low-pass.
    pub(crate) fn smooth(&mut self, rectified: f64) -> f64 {
        self.envelope.run(rectified)
    }
}

/// Quality factors of the two sections of a fourth-order Butterworth filter.
fn butterworth_q() -> [f64; SECTIONS] {
    [0.5 / (PI / 8.0).cos(), 0.5 / (3.0 * PI / 8.0).cos()]
}
