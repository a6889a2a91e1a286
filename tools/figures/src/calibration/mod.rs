//! Calibration against published measurements: what the printed constants predict, which softening
//! of the line gives the measured resonance, and what the softened line then predicts.
//!
//! One parameter (`line_stiffness_factor`) is fitted to one number
//! (`frequency_response_measured.resonance_hz`); everything else is prediction. The movement's
//! amplitude is not printed, and the friction of § 3.2.1 contradicts the measurement of § 5.2.2, so
//! [`sensitivity::sensitivity`] repeats fit and prediction over both, and [`conclusions`] tells
//! which statements hold in every combination. [`alternatives`] fits other explanations than a
//! softer line.

pub mod alternatives;
pub mod cable;
pub mod conclusions;
pub mod sensitivity;
pub mod table_rows;

use anyhow::{Context as _, Result};
use plant::effects::Site;
use plant::hydrostatic::Parameters;
use plant::hydrostatic::compliance::Explanations;

use crate::published::published;
use crate::simulated_line::{Added, Line};
use crate::simulated_response::{
    Peak, Rig, VANISHED_GAIN, at, cut_off, falls_below, logarithmic, peak, root, sound, sweep,
};

/// Frequencies between which the printed line's resonance is looked for, Hz.
const PRINTED_RANGE_HZ: (f64, f64) = (4.0, 60.0);
/// Softest line that is tried, as a share of the printed stiffness.
const SOFTEST: f64 = 1.0 / 100.0;
/// Steps in which a root is bracketed.
const BRACKETS: usize = 4;
/// A fit whose peak is off by more than this share is rejected.
const FIT_TOLERANCE: f64 = 0.02;
/// Lowest frequency of fig. 3.4, Hz.
const LOW_HZ: f64 = 0.2;
/// Highest frequency of fig. 3.4, Hz.
const HIGH_HZ: f64 = 24.0;
/// Length of the short hose (§ 3.3.4), m.
pub const SHORT_M: f64 = 1.0;

/// Predictions of the published numbers on the response.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Prediction {
    /// Frequency of the largest gain, Hz.
    pub peak_hz: Option<f64>,
    /// Gain there.
    pub peak_gain: Option<f64>,
    /// Where the gain falls below 0.707 above the peak, Hz.
    pub cut_off_hz: Option<f64>,
    /// Where it falls below 0.1, Hz.
    pub vanishing_hz: Option<f64>,
    /// Lag of the slave's fundamental at 1 Hz, s.
    pub lag_1hz_s: Option<f64>,
    /// Gain at 1 Hz: what is called the low-frequency gain here.
    pub low_frequency_gain: Option<f64>,
    /// Gain at 0.2 Hz, where stiction takes more.
    pub slowest_gain: Option<f64>,
    /// Peak with a hose of 1 m, Hz.
    pub short_peak_hz: Option<f64>,
    /// Cut-off with a hose of 1 m, Hz.
    pub short_cut_off_hz: Option<f64>,
}

/// The resonance that was measured on the rig, Hz.
///
/// # Errors
/// Never, as long as the table of published values holds it.
pub fn measured_resonance_hz() -> Result<f64> {
    measured("hydrostatic.frequency_response_measured.resonance_hz")
}

/// A published value by its name.
fn measured(id: &'static str) -> Result<f64> {
    Ok(published(id)?.value)
}

/// What a line predicts of its own response, the peak looked for between two frequencies, Hz: peak,
/// cut-off, lag and gain.
///
/// # Errors
/// Where a constant or an effect is out of range.
pub fn predict_response(line: &Line, (low, high): (f64, f64)) -> Result<Prediction> {
    let peak = peak(line, low, high)?;
    let slow = at(line, 1.0)?;
    let if_sound = |value: f64| sound(&slow).then_some(value);
    Ok(Prediction {
        peak_hz: peak.frequency_hz(),
        peak_gain: peak.gain(),
        cut_off_hz: cut_off(line, peak.frequency_hz())?,
        lag_1hz_s: if_sound(slow.lag_s()),
        low_frequency_gain: if_sound(slow.gain),
        ..Prediction::default()
    })
}

/// All that a line predicts: [`predict_response`], and its response with 1 m of hose, the peak
/// looked for between the lower bound and ten times the upper one (the resonance of a shorter line
/// rises at most with 1/length).
///
/// # Errors
/// Where a constant or an effect is out of range.
pub fn predict(line: &Line, (low, high): (f64, f64)) -> Result<Prediction> {
    let short = line.clone().with_length(SHORT_M);
    let peak = peak(&short, low, 10.0 * high)?;
    Ok(Prediction {
        short_peak_hz: peak.frequency_hz(),
        short_cut_off_hz: cut_off(&short, peak.frequency_hz())?,
        ..predict_response(line, (low, high))?
    })
}

/// [`predict`], and what happens at the ends of fig. 3.4.
fn predict_widely(line: &Line, range: (f64, f64)) -> Result<Prediction> {
    let prediction = predict(line, range)?;
    let slowest = at(line, LOW_HZ)?;
    let vanishing_hz = falls_below(line, prediction.peak_hz, VANISHED_GAIN, |r| r.gain)?;
    Ok(Prediction { slowest_gain: Some(slowest.gain), vanishing_hz, ..prediction })
}

/// Where the peak of a line that was fitted to `target_hz` is looked for, Hz.
fn near(target_hz: f64) -> (f64, f64) {
    (0.5 * target_hz, 2.0 * target_hz)
}

/// Where it is looked for once a size is bracketed, Hz: of what lies farther off, the side is all
/// that matters.
fn close(target_hz: f64) -> (f64, f64) {
    (target_hz / 1.3, 1.3 * target_hz)
}

/// The size with which `rig(size)` peaks at `target_hz`, and that peak; `None` where no size from
/// `harmless` to `strongest` (both positive) does. Of several it is the one nearest to `harmless`.
///
/// Brackets a root of "simulated peak less target" in the logarithm of the size, then closes in on
/// it. A size whose peak lies outside half to twice the target counts as on that side of it, one
/// with which the slave no longer moves as beyond the target. What is found is simulated again,
/// since a peak may jump.
///
/// # Errors
/// Where a constant or an effect is out of range.
pub fn fit<R: Rig>(
    target_hz: f64,
    harmless: f64,
    strongest: f64,
    rig: impl Fn(f64) -> R,
) -> Result<Option<(f64, Peak)>> {
    // Clamped, since the exponential of a logarithm may step over the end of a parameter's range.
    let size =
        |logarithm: f64| logarithm.exp().clamp(harmless.min(strongest), harmless.max(strongest));
    let off = |peak: &Peak| match peak {
        Peak::Inside { frequency_hz, .. } => frequency_hz - target_hz,
        Peak::Below | Peak::Still => -target_hz,
        Peak::Above => target_hz,
        Peak::Diverged => f64::NAN,
    };
    let top = |logarithm: f64, (low, high)| peak(&rig(size(logarithm)), low, high);
    let miss = |logarithm: f64| top(logarithm, near(target_hz)).map(|peak| off(&peak));
    let (start, end) = (harmless.ln(), strongest.ln());
    let mut last = (start, miss(start)?);
    for step in 1..=BRACKETS {
        let at = start + (end - start) * step as f64 / BRACKETS as f64;
        let next = (at, miss(at)?);
        if last.1 * next.1 <= 0.0 {
            // The ends are known already.
            let found = root(last.0, next.0, 5e-3, |at| match at {
                _ if at == last.0 => Ok(last.1),
                _ if at == next.0 => Ok(next.1),
                _ => top(at, close(target_hz)).map(|peak| off(&peak)),
            })?;
            let Some(logarithm) = found else { return Ok(None) };
            let peak = top(logarithm, near(target_hz))?;
            let fits = off(&peak).abs() <= FIT_TOLERANCE * target_hz;
            return Ok(fits.then(|| (size(logarithm), peak)));
        }
        last = next;
    }
    Ok(None)
}

/// The softening with which a line peaks at `target_hz`: a factor on the stiffness of the line.
///
/// # Errors
/// Those of [`fit`].
pub fn fit_softening(line: &Line, target_hz: f64) -> Result<Option<f64>> {
    let found = fit(target_hz, 1.0, SOFTEST, |factor| line.clone().softened(factor))?;
    Ok(found.map(|(factor, _)| factor))
}

/// The nominal case: printed friction, 30°.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The fitted factor on the line's stiffness.
    pub factor: f64,
    /// The line with it.
    pub line: Line,
    /// What the printed constants predict.
    pub printed: Prediction,
    /// What the softened line predicts.
    pub traced: Prediction,
    /// Largest difference of gain between a line with the effect `line_compliance` and one with the
    /// bulk modulus times the factor, over fig. 3.4's frequencies.
    pub misprint_difference: f64,
}

impl Calibration {
    /// What the softening would be in the terms of a hose, belts, gas, or a misprint.
    pub fn softening_as(&self) -> Explanations {
        Parameters::printed().explain_softening(self.factor)
    }
}

/// Fits the softening to the measured resonance alone and predicts the rest.
///
/// # Errors
/// Where no softening gives it.
pub fn calibrate() -> Result<Calibration> {
    let target = measured_resonance_hz()?;
    let printed = Line::printed();
    let factor = fit_softening(&printed, target)?.with_context(|| {
        let (low, high) = near(target);
        format!(
            "the line, softened: no peak between {low} and {high} Hz; widen the range or change \
                the constants"
        )
    })?;
    let line = printed.clone().softened(factor);
    let frequencies = logarithmic(LOW_HZ, HIGH_HZ, 12);
    let compliance = Added::new("line_compliance", Site::Line, 1.0 / factor - 1.0);
    let softer = sweep(&printed.clone().with(compliance), &frequencies)?;
    let misprinted = sweep(&printed.clone().with_bulk_modulus(factor), &frequencies)?;
    let misprint_difference =
        softer.iter().zip(&misprinted).map(|(a, b)| (a.gain - b.gain).abs()).fold(0.0, f64::max);
    Ok(Calibration {
        factor,
        printed: predict_widely(&printed, PRINTED_RANGE_HZ)?,
        traced: predict_widely(&line, near(target))?,
        line,
        misprint_difference,
    })
}
