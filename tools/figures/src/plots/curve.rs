//! Curves of a frequency response, and the two panels that show them.

use anyhow::Result;
use plant::response::{LinearSystem, Response};
use report::Colour::{Black, Grey};
use report::{Colour, Figure};

use super::style::{gain, phase};
use crate::published::published;
use crate::simulated_response::CUT_OFF_GAIN;

/// Below this gain the slave stands still, and a phase means nothing.
const STILL: f64 = 0.02;

/// A curve with its place in the legend.
pub(super) struct Curve {
    name: String,
    colour: Colour,
    dashed: bool,
    frequency: Vec<f64>,
    gain: Vec<f64>,
    phase: Vec<f64>,
}

impl Curve {
    pub(super) fn simulated(name: &str, colour: Colour, responses: &[Response]) -> Self {
        let moving =
            |value: f64, response: &Response| if response.gain < STILL { f64::NAN } else { value };
        Self {
            name: name.to_owned(),
            colour,
            dashed: false,
            frequency: responses.iter().map(|r| r.frequency_hz).collect(),
            gain: responses.iter().map(|r| r.gain.max(1e-9)).collect(),
            phase: responses.iter().map(|r| moving(r.phase_rad.to_degrees(), r)).collect(),
        }
    }

    pub(super) fn linear(
        name: &str,
        colour: Colour,
        system: &LinearSystem,
        frequency: &[f64],
    ) -> Self {
        // The rational part is given within half a turn either way; it lags by up to a whole one.
        let phase = |f: &f64| {
            let phase = system.phase_rad(*f).to_degrees();
            if phase > 30.0 { phase - 360.0 } else { phase }
        };
        Self {
            name: name.to_owned(),
            colour,
            dashed: true,
            frequency: frequency.to_vec(),
            gain: frequency.iter().map(|f| system.gain(*f)).collect(),
            phase: frequency.iter().map(phase).collect(),
        }
    }
}

fn put(figure: Figure, curve: &Curve, values: &[f64]) -> Figure {
    let add = if curve.dashed { Figure::dashed } else { Figure::line };
    add(figure, curve.colour, &curve.name, &curve.frequency, values)
}

/// Gain and phase panels of some curves.
pub(super) fn bode(
    label: &str,
    curves: &[Curve],
    (low, high): (f64, f64),
    (floor, ceiling): (f64, f64),
    lowest_phase: f64,
) -> [Figure; 2] {
    let mut gains = gain(&format!("{label}, gain")).x_range(low, high).y_range(floor, ceiling);
    let mut phases =
        phase(&format!("{label}, phase")).x_range(low, high).y_range(lowest_phase, 20.0);
    for curve in curves {
        gains = put(gains, curve, &curve.gain);
        phases = put(phases, curve, &curve.phase);
    }
    [gains.horizontal(Grey, "", CUT_OFF_GAIN), phases]
}

/// Adds a measured resonance, as a line, and a measured cut-off, as a point, to a gain panel.
pub(super) fn measured_points(
    gain: Figure,
    resonance: &'static str,
    cut_off: &'static str,
) -> Result<Figure> {
    let (resonance_hz, cut_off_hz) = (published(resonance)?.value, published(cut_off)?.value);
    Ok(gain.vertical(Grey, "measured resonance", resonance_hz).scatter(
        Black,
        "measured cut-off",
        &[cut_off_hz],
        &[CUT_OFF_GAIN],
    ))
}
