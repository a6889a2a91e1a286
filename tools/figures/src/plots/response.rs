//! Fig. 3.4, 3.7 and 5.7: frequency responses.

use anyhow::Result;
use plant::response::{LinearSystem, Response};
use report::Colour::{Black, Blue, Grey, Sky, Vermillion};
use report::{Figure, Panels};

use super::curve::{Curve, bode, measured_points};
use super::style::axes;
use super::{Common, Plot, columns};
use crate::calibration::{Prediction, SHORT_M};
use crate::linear_response;
use crate::simulated_line::Line;
use crate::simulated_response::{CUT_OFF_GAIN, VANISHED_GAIN, cycle, logarithmic, sweep};
use crate::table_row::{Role, Row};

/// Points of a drawn curve.
const POINTS: usize = 90;
/// Points of a curve that costs nothing.
const SMOOTH: usize = 600;

/// The two numbers that the thesis gives of the measured response (§ 5.2.3).
const RESONANCE: &str = "hydrostatic.frequency_response_measured.resonance_hz";
const CUT_OFF: &str = "hydrostatic.frequency_response_measured.cutoff_hz";

/// Gain and phase of the printed and the traced line, of the thesis's linear system and of the one
/// fitted to the traced line; then one cycle of the traced line with both systems.
struct Comparison<'a> {
    length: &'a str,
    /// Frequencies and gains shown: lowest and highest (Hz), lowest and highest.
    range_hz: (f64, f64),
    gains: (f64, f64),
    /// Responses of the printed and of the traced line.
    responses: [&'a [Response]; 2],
    traced: &'a Line,
    /// The thesis's equation and its system.
    equation: (&'a str, LinearSystem),
    fitted: Option<&'a LinearSystem>,
    /// Frequency of the cycle (Hz).
    cycle_hz: f64,
}

impl Comparison<'_> {
    fn panels(&self, title: &str) -> Result<Panels> {
        let [printed, traced] = self.responses;
        let (name, system) = &self.equation;
        let smooth = logarithmic(self.range_hz.0, self.range_hz.1, SMOOTH);
        let mut curves = vec![
            Curve::simulated("printed constants", Vermillion, printed),
            Curve::simulated("traced line", Blue, traced),
            Curve::linear(name, Black, system, &smooth),
        ];
        if let Some(fitted) = self.fitted {
            let frequencies: Vec<f64> =
                traced.iter().map(|response| response.frequency_hz).collect();
            curves.push(Curve::linear("linear fit to traced line", Sky, fitted, &frequencies));
        }
        let label = format!("A  {}", self.length);
        let [gains, phases] = bode(&label, &curves, self.range_hz, self.gains, -300.0);
        Ok(Panels::new(title).panel(gains).panel(phases).panel(self.one_cycle()?))
    }

    /// One cycle: master, simulated slave, and linear systems' slaves.
    fn one_cycle(&self) -> Result<Figure> {
        let hertz = self.cycle_hz;
        let [time, master, slave] = columns(&cycle(self.traced, hertz)?);
        let of = |system: &LinearSystem| {
            linear_response::cycle_deg(system, hertz, self.traced.amplitude_deg, &time)
        };
        let (name, printed) = &self.equation;
        let figure = axes(&format!("B  {hertz} Hz, traced line"), "time / s", "position / °")
            .line(Grey, "master", &time, &master)
            .line(Blue, "slave, simulated", &time, &slave)
            .dashed(Black, *name, &time, &of(printed));
        Ok(match self.fitted {
            Some(fitted) => figure.dashed(Sky, "linear fit", &time, &of(fitted)),
            None => figure,
        })
    }
}

/// Fig. 3.4.
///
/// # Errors
/// Where a constant is out of range.
pub fn ten_metres(common: &Common) -> Result<Plot> {
    let frequencies = logarithmic(0.2, 24.0, POINTS);
    let printed = sweep(&Line::printed(), &frequencies)?;
    let traced = sweep(&common.calibration.line, &frequencies)?;
    let panels = Comparison {
        length: "10 m",
        range_hz: (0.2, 24.0),
        gains: (0.1, 8.0),
        responses: [&printed, &traced],
        traced: &common.calibration.line,
        equation: ("eq. 3.3.1", LinearSystem::TEN_METRES),
        fitted: common.fitted[1].as_ref(),
        cycle_hz: 1.0,
    }
    .panels("Fig. 3.4, frequency response")?;
    let rows = ten_metre_rows(common, &printed, &traced)?;
    let caption =
        "Slave over master, the master moved along a sine of ±30°: gain and phase of the \
            fundamental from 0.2 to 24 Hz. The grey line is 0.707. With the printed constants the \
            peak lies beyond the figure, near 30 Hz; the traced line has it at the measured 8 Hz. \
            Where the line wound up by the master no longer breaks the slave loose, the gain drops \
            out of the figure and no phase is drawn. B: one cycle at 1 Hz; a linear system cannot \
            show the flat tops."
            .to_owned();
    Ok(Plot { number: "3.4", title: "Frequency response, 10 m", caption, panels, rows })
}

/// The published values on the response of 10 m of hose, beside those of both lines.
fn ten_metre_rows(common: &Common, printed: &[Response], traced: &[Response]) -> Result<Vec<Row>> {
    let (p, t) = (&common.calibration.printed, &common.calibration.traced);
    let decibels = |gain: Option<f64>| gain.map(|gain| 20.0 * gain.log10());
    let smallest = |responses: &[Response], cut_off: Option<f64>| {
        let limit = cut_off.unwrap_or(f64::INFINITY);
        let inside = responses.iter().filter(|r| r.frequency_hz <= limit).map(|r| r.gain);
        decibels(Some(inside.chain(cut_off.map(|_| CUT_OFF_GAIN)).fold(f64::INFINITY, f64::min)))
    };
    let beside = |id, ours| Row::beside(id, Role::Predicted, ours);
    let of = |read: fn(&Prediction) -> Option<f64>| [read(p), read(t)];
    let [slowest_p, slowest_t] = of(|line| line.slowest_gain).map(|gain| gain.unwrap_or(f64::NAN));
    let (peaks, cut_offs) = (of(|line| line.peak_hz), of(|line| line.cut_off_hz));
    let smallest = [
        smallest(printed, p.cut_off_hz.filter(|cut_off| *cut_off <= 24.0)),
        smallest(traced, t.cut_off_hz),
    ];
    let (peak, cut_off) = ("frequency of the largest gain", "gain 0.707 above the peak");
    let rows =
        vec![
        beside("hydrostatic.linear_fit_10m.low_frequency_gain", of(|line| line.low_frequency_gain))?
            .note(format!(
                "gain at 1 Hz; at 0.2 Hz it is {slowest_p:.3} (printed constants) and \
                    {slowest_t:.3} (traced)"
            )),
        beside("hydrostatic.linear_fit_10m.stated_resonance_hz", peaks)?.note(peak),
        beside("hydrostatic.linear_fit_10m.stated_cutoff_hz", cut_offs)?.note(cut_off),
        beside("hydrostatic.linear_fit_10m.formula_peak_hz", peaks)?.note(peak),
        beside("hydrostatic.linear_fit_10m.formula_cutoff_hz", cut_offs)?.note(cut_off),
        beside("hydrostatic.linear_fit_10m.formula_lag_1hz_s", of(|line| line.lag_1hz_s))?
            .note("lag of the slave's fundamental at 1 Hz, ±30°"),
        beside("hydrostatic.gain_bounds.min_db", smallest)?.note(
            "smallest gain from 0.2 Hz to the cut-off, or to 24 Hz where the cut-off lies higher",
        ),
        beside("hydrostatic.gain_bounds.max_db", of(|line| line.peak_gain).map(decibels))?
            .note("gain at the peak"),
        beside("hydrostatic.vanishing.frequency_hz", of(|line| line.vanishing_hz))?.note(format!(
            "gain falls below {VANISHED_GAIN}; the thesis says \"almost disappears\""
        )),
    ];
    Ok(rows.into_iter().chain(fit_rows("10m", "3.4", &common.fitted)).collect())
}

/// Fig. 3.7.
///
/// # Errors
/// Where a constant is out of range.
pub fn one_metre(common: &Common) -> Result<Plot> {
    let frequencies = logarithmic(0.5, 120.0, POINTS);
    let line = common.calibration.line.clone().with_length(SHORT_M);
    let printed = sweep(&Line::printed().with_length(SHORT_M), &frequencies)?;
    let traced = sweep(&line, &frequencies)?;
    let panels = Comparison {
        length: "1 m",
        range_hz: (0.5, 120.0),
        gains: (0.1, 20.0),
        responses: [&printed, &traced],
        traced: &line,
        equation: ("eq. 3.3.2", LinearSystem::ONE_METRE),
        fitted: common.fitted_short[1].as_ref(),
        cycle_hz: 2.0,
    }
    .panels("Fig. 3.7, 1 m of hose")?;
    let lines = [&common.calibration.printed, &common.calibration.traced];
    let (peaks, cut_offs) =
        (lines.map(|line| line.short_peak_hz), lines.map(|line| line.short_cut_off_hz));
    let peak = "frequency of the largest gain, 1 m of hose, softened as at 10 m";
    let cut_off = "gain 0.707 above the peak, 1 m of hose";
    let mut rows = Vec::new();
    for (id, ours, note) in [
        ("hydrostatic.linear_fit_1m.stated_natural_frequency_hz", peaks, peak),
        ("hydrostatic.linear_fit_1m.stated_cutoff_hz", cut_offs, cut_off),
        ("hydrostatic.linear_fit_1m.formula_natural_hz", peaks, peak),
        ("hydrostatic.linear_fit_1m.formula_cutoff_hz", cut_offs, cut_off),
    ] {
        rows.push(Row::beside(id, Role::Predicted, ours)?.note(note));
    }
    rows.extend(fit_rows("1m", "3.7", &common.fitted_short));
    let caption = "The same with 1 m of hose. The softening is the one fitted at 10 m to the \
        measured 8 Hz; eq. 3.3.2, which the author fitted to his simulation, took no part in it. \
        The printed constants put the peak near 170 Hz, beyond the figure: the author's own \
        simulation had a softer line too, at both lengths. B: one cycle at 2 Hz."
        .to_owned();
    Ok(Plot { number: "3.7", title: "Frequency response, 1 m", caption, panels, rows })
}

/// Fig. 5.7.
///
/// # Errors
/// Where a constant is out of range.
pub fn measured(common: &Common) -> Result<Plot> {
    let frequencies = logarithmic(0.2, 15.0, POINTS);
    let (printed, traced) = (Line::printed(), &common.calibration.line);
    let curves = [
        Curve::simulated("printed constants", Vermillion, &sweep(&printed, &frequencies)?),
        Curve::simulated("traced line", Blue, &sweep(traced, &frequencies)?),
    ];
    let [gains, phases] = bode("A  Hydrostatic", &curves, (0.2, 15.0), (0.5, 4.0), -220.0);
    let gains = measured_points(gains, RESONANCE, CUT_OFF)?;
    let ([cable_gains, cable_phases], cable_rows) = super::cable::response()?;
    let panels = Panels::new("Fig. 5.7, responses against what was measured")
        .panel(gains)
        .panel(phases)
        .panel(cable_gains)
        .panel(cable_phases);
    let lines = [&common.calibration.printed, &common.calibration.traced];
    let peaks = lines.map(|line| line.peak_hz);
    let mut rows = vec![
        Row::beside(RESONANCE, Role::Fitted, peaks)?.note(
            "frequency of the largest gain, ±30°; the only value that the softening was fitted to",
        ),
        Row::beside(CUT_OFF, Role::Predicted, lines.map(|line| line.cut_off_hz))?
            .note("gain 0.707 above the peak, ±30°"),
    ];
    for (name, unit, ours) in [
        ("peak_hz", "Hz", peaks),
        ("peak_gain", "1", lines.map(|line| line.peak_gain)),
        ("lag_1hz_s", "s", lines.map(|line| line.lag_1hz_s)),
    ] {
        let row = Row::own(format!("own.nominal.{name}"), "5.7", unit, ours);
        rows.push(row.note("±30°, printed friction"));
    }
    rows.extend(cable_rows);
    let caption = "Both transmissions over the frequencies of the measurement. Of it the text \
        gives two numbers, the same for both: resonance at 8 Hz (grey line), cut-off at 12 Hz \
        (dot). The traced line was fitted to the first; the second it predicts. The cable's gain \
        is over the mechanical ratio. Its peak is far higher than the measured one, which \
        \"remains same till after resonance\"."
        .to_owned();
    Ok(Plot { number: "5.7", title: "Measured frequency response", caption, panels, rows })
}

fn fit_rows(length: &str, figure: &str, fitted: &[Option<LinearSystem>; 2]) -> Vec<Row> {
    type Read = fn(&LinearSystem) -> Option<f64>;
    let readings: [(&str, &str, Read); 6] = [
        ("low_frequency_gain", "1", |system| Some(system.low_frequency_gain())),
        ("peak_hz", "Hz", |system| Some(linear_response::peak_hz(system))),
        ("natural_frequency_hz", "Hz", |system| Some(system.natural_frequency_hz())),
        ("cutoff_hz", "Hz", linear_response::cut_off_hz),
        ("damping_ratio", "1", |system| Some(system.damping_ratio())),
        ("dead_time_s", "s", |system| Some(system.dead_time_s)),
    ];
    readings
        .into_iter()
        .map(|(name, unit, read)| {
            let ours = fitted.each_ref().map(|fitted| fitted.as_ref().and_then(read));
            Row::own(format!("own.linear_fit_{length}.{name}"), figure, unit, ours).note(
                "second order with dead time, fitted to the simulated response as the thesis's was",
            )
        })
        .collect()
}
