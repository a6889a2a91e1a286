//! Fig. 3.5 and 3.6: another hose. Its diameter, its length.

use std::f64::consts::FRAC_PI_2;

use anyhow::Result;
use rayon::prelude::*;
use report::{Colour, Figure, Panels};

use super::style::{gain, phase, tall};
use super::{Common, Plot};
use crate::simulated_line::Line;
use crate::simulated_response::{Cycle, cycle, falls_below, logarithmic, peak};
use crate::table_row::Row;

/// Diameters, m (fig. 3.5: 0.005 to 0.015 m).
const DIAMETERS_M: [f64; 6] = [0.005, 0.007, 0.009, 0.011, 0.013, 0.015];
/// Lengths, m.
const LENGTHS_M: [f64; 6] = [1.0, 2.0, 5.0, 10.0, 15.0, 20.0];
/// Points of a drawn curve.
const POINTS: usize = 48;
/// Range of the figures, Hz. They start at 0; at 0 there is no movement.
const RANGE_HZ: (f64, f64) = (0.5, 24.0);
/// Below this gain the slave stands still.
const STILL: f64 = 0.02;

/// One hose, over all frequencies.
struct Hose {
    name: String,
    id: String,
    cycles: Vec<Cycle>,
    /// Frequency of the largest gain, and where the phase passes -90°, Hz.
    peak_hz: Option<f64>,
    quarter_turn_hz: Option<f64>,
}

impl Hose {
    fn new(name: String, id: String, line: &Line) -> Result<Self> {
        let frequencies = logarithmic(RANGE_HZ.0, RANGE_HZ.1, POINTS);
        let cycles = frequencies.par_iter().map(|f| cycle(line, *f)).collect::<Result<Vec<_>>>()?;
        let peak_hz = peak(line, 1.5, 300.0)?.frequency_hz();
        // Friction alone turns the phase at low frequencies, so the search begins not far below the
        // peak.
        let quarter_turn_hz =
            falls_below(line, peak_hz.map(|peak| 0.6 * peak), -FRAC_PI_2, |r| r.phase_rad)?;
        Ok(Self { name, id, cycles, peak_hz, quarter_turn_hz })
    }

    fn column(&self, value: impl Fn(&Cycle) -> f64) -> Vec<f64> {
        self.cycles.iter().map(value).collect()
    }

    /// Mean over the figure's range, on a logarithmic axis; a slave that stands still counts as 0.
    fn mean(&self, value: impl Fn(&Cycle) -> f64) -> f64 {
        self.cycles
            .iter()
            .map(|c| if c.response.gain < STILL { 0.0 } else { value(c) })
            .sum::<f64>()
            / self.cycles.len().max(1) as f64
    }
}

/// A way to measure efficiency.
struct Efficiency {
    id: &'static str,
    panel: &'static str,
    what: &'static str,
    of: fn(&Cycle) -> f64,
    /// Plot over decades, since it is no efficiency and knows no bound.
    wide: bool,
    /// Top of the axis.
    top: f64,
}

const EFFICIENCIES: [Efficiency; 3] = [
    Efficiency {
        id: "as_printed",
        panel: "B  Eq. 3.2.1 as printed",
        what: "max(τ_m q̇_s)/max(τ_s q̇_m)",
        of: Cycle::efficiency_as_printed,
        wide: true,
        top: 100.0,
    },
    Efficiency {
        id: "corrected",
        panel: "B  Eq. 3.2.1, each side's own power",
        what: "max(τ_s q̇_s)/max(τ_m q̇_m)",
        of: |cycle| cycle.response.efficiency,
        wide: false,
        top: 2.0,
    },
    Efficiency {
        id: "work",
        panel: "B  Work per cycle",
        what: "work into the slave over work of the motor",
        of: Cycle::work_efficiency,
        wide: false,
        top: 1.0,
    },
];

/// Panels and rows of the hoses of some values (m), with the printed constants and with the traced
/// line; `make` gives each hose its name, its name in rows and its line.
fn study(
    common: &Common,
    figure: &'static str,
    kind: &str,
    values: &[f64],
    make: fn(Line, f64) -> (String, String, Line),
) -> Result<(Panels, Vec<Row>)> {
    let hoses = |base: &Line| -> Result<Vec<Hose>> {
        let all: Vec<_> = values.iter().map(|value| make(base.clone(), *value)).collect();
        all.into_par_iter().map(|(name, id, line)| Hose::new(name, id, &line)).collect()
    };
    let (printed, traced) = (hoses(&Line::printed())?, hoses(&common.calibration.line)?);
    let moving =
        |cycle: &Cycle, value: f64| if cycle.response.gain < STILL { f64::NAN } else { value };
    let frequencies = logarithmic(RANGE_HZ.0, RANGE_HZ.1, POINTS);
    let draw = |mut figure: Figure, value: &dyn Fn(&Cycle) -> f64| {
        for (index, hose) in traced.iter().enumerate() {
            let colour = Colour::ramp(index, traced.len());
            figure = figure.line(colour, &hose.name, &frequencies, &hose.column(value));
        }
        figure.x_range(RANGE_HZ.0, RANGE_HZ.1)
    };
    let mut panels = Panels::new(format!("Fig. {figure}, hose {kind}"))
        .panel(draw(gain("A  Gain, traced line").y_range(0.1, 8.0), &|c| c.response.gain.max(1e-9)))
        .panel(draw(phase("A  Phase, traced line"), &|c| {
            moving(c, c.response.phase_rad.to_degrees())
        }));
    for efficiency in &EFFICIENCIES {
        let axes = tall(efficiency.panel, "frequency / Hz", "efficiency").log_x();
        let axes = if efficiency.wide {
            axes.log_y().y_range(0.3, 100.0)
        } else {
            axes.y_range(0.0, efficiency.top)
        };
        panels = panels.panel(draw(axes, &|c| moving(c, (efficiency.of)(c))));
    }
    let mut rows = Vec::new();
    for (p, t) in printed.iter().zip(&traced) {
        let hoses = [p, t];
        let id = |name: &str| format!("own.{kind}.{}.{name}", t.id);
        let peaks = hoses.map(|hose| hose.peak_hz);
        let quarter_turns = hoses.map(|hose| hose.quarter_turn_hz);
        rows.push(
            Row::own(id("peak_hz"), figure, "Hz", peaks).note("frequency of the largest gain"),
        );
        rows.push(Row::own(id("resonance_hz"), figure, "Hz", quarter_turns).note(
            "frequency at which the slave lags by 90°: the resonance, which damping does not move",
        ));
        for efficiency in &EFFICIENCIES {
            let means = hoses.map(|hose| Some(hose.mean(efficiency.of)));
            let id = id(&format!("efficiency_{}", efficiency.id));
            let what = efficiency.what;
            rows.push(
                Row::own(id, figure, "1", means)
                    .note(format!("{what}, mean over 0.5 to 24 Hz on a logarithmic axis")),
            );
        }
    }
    Ok((panels, rows))
}

const EFFICIENCY_WORDS: &str = "B: efficiency by eq. 3.2.1 as printed, which pairs the torque of \
    one side with the speed of the other; with each side's own torque and speed; and as work per \
    cycle, which alone cannot exceed 1, since inertia swings power to and fro. Curves end where \
    the slave stands still.";

/// Fig. 3.5: diameter.
///
/// # Errors
/// Where a constant is out of range.
pub fn diameter(common: &Common) -> Result<Plot> {
    let make = |line: Line, diameter: f64| {
        let name = format!("{:.0} mm", 1e3 * diameter);
        (name.clone(), name.replace(' ', ""), line.with_diameter(diameter))
    };
    let (panels, rows) = study(common, "3.5", "diameter", &DIAMETERS_M, make)?;
    let caption = format!(
        "Hoses of 5 to 15 mm, 10 m long, the cylinders kept. A: a narrower hose damps more, so the \
            peak is lower and its top moves down; the frequency at which the slave lags by 90°, \
            the resonance proper, stays (stiffness and fluid mass, seen from the pulleys, both \
            grow as the bore shrinks). {EFFICIENCY_WORDS}"
    );
    Ok(Plot { number: "3.5", title: "Hose diameter", caption, panels, rows })
}

/// Fig. 3.6: length.
///
/// # Errors
/// Where a constant is out of range.
pub fn length(common: &Common) -> Result<Plot> {
    let make = |line: Line, length: f64| {
        (format!("{length:.0} m"), format!("{length:.0}m"), line.with_length(length))
    };
    let (panels, rows) = study(common, "3.6", "length", &LENGTHS_M, make)?;
    let caption = format!(
        "Hoses of 1 to 20 m with the bore of the printed area. A: a shorter hose is stiffer and \
            holds less fluid, so the peak moves up; short hoses lag little below it. \
            {EFFICIENCY_WORDS}"
    );
    Ok(Plot { number: "3.6", title: "Hose length", caption, panels, rows })
}
