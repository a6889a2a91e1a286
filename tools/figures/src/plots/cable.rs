//! Fig. 5.3 to 5.6 and 5.8, and the cable's part of fig. 5.7.
//!
//! The cable's own softening is declared in `plant::cable::Parameters::traced` (`docs/errata.md`),
//! not fitted here.

use anyhow::Result;
use plant::cable::{Element, Parameters, Plant};
use report::Colour::{Black, Blue, Sky, Vermillion};
use report::{Figure, Panels};

use super::curve::{Curve, bode, measured_points};
use super::style::{axes, curve};
use super::{Common, Plot, over_cycle};
use crate::quasi_static::{QuasiStaticCycle, quasi_static_cycle};
use crate::simulated_response::{Rig, at, cut_off, cycle, logarithmic, peak, sweep};
use crate::table_row::{Role, Row};

/// Amplitude of the slave where the cables are rigid, degrees: the hydrostatic master's. None is
/// printed.
const SLAVE_AMPLITUDE_DEG: f64 = 30.0;
/// Where the response with the traced stiffness is drawn closer, Hz: it jumps near its peak.
const CLOSE_HZ: (f64, f64) = (5.0, 15.0);

/// The cable transmission, ready to be moved.
#[derive(Clone, Debug, PartialEq)]
pub struct Cable {
    /// Its constants.
    pub parameters: Parameters,
    /// Amplitude of the slave where the cables are rigid, degrees.
    pub slave_amplitude_deg: f64,
}

impl Cable {
    /// Moved as far as the hydrostatic line.
    pub fn new(parameters: Parameters) -> Self {
        Self { parameters, slave_amplitude_deg: SLAVE_AMPLITUDE_DEG }
    }
}

impl Rig for Cable {
    type Plant = Plant;

    fn plant(&self) -> Result<Plant> {
        Ok(Plant::new(self.parameters.clone(), Vec::new())?)
    }

    fn amplitude_rad(&self) -> f64 {
        self.slave_amplitude_deg.to_radians() * self.parameters.mechanical_ratio
    }

    fn mechanical_ratio(&self) -> f64 {
        self.parameters.mechanical_ratio
    }
}

/// Extension in mm and force in N of a piece that is taken through some extensions, m.
fn stretch(element: &mut Element, path: impl Iterator<Item = f64>) -> (Vec<f64>, Vec<f64>) {
    path.map(|extension| (1e3 * extension, element.extend(extension))).unzip()
}

/// Fig. 5.3: force over extension of one cable of 9 m.
///
/// # Errors
/// Where a published value is missing from the table.
pub fn extension(_: &Common) -> Result<Plot> {
    let panel = |title: &str, parameters: &Parameters| -> (Figure, f64) {
        let path = || (0..=500).map(|step| 2e-6 * f64::from(step));
        let mut new = parameters.specimen(parameters.line_length_m);
        let (_, first) = stretch(&mut new, path());
        let (mut used, start) = Element::bedded(*new.law(), parameters.bedding_tension_n, 0.0);
        let (extension, force) = stretch(&mut used, path().map(|extension| start + extension));
        let extension: Vec<f64> = extension.iter().map(|x| x - 1e3 * start).collect();
        let slope = slope_n_per_m(&extension, &force);
        let fitted: Vec<f64> = extension.iter().map(|x| slope.0 + slope.1 * x * 1e-3).collect();
        let figure = axes(title, "extension / mm", "force / N")
            .line(Blue, "used cable", &extension, &force)
            .line(Sky, "new cable", &extension, &first)
            .dashed(Black, "line through 0.02 to 1.0 mm", &extension, &fitted);
        (figure, slope.1)
    };
    let (printed, printed_slope) = panel("Printed stiffness", &Parameters::printed());
    let (traced, traced_slope) = panel("Traced stiffness", &Parameters::calibrated());
    let slopes = [Some(printed_slope), Some(traced_slope)];
    let rows = vec![Row::beside("cable.stiffness_n_per_m", Role::Input, slopes)?.note(
        "slope of a straight line through 0.02 to 1.0 mm of a cable that has been loaded before",
    )];
    let caption = "Force against extension of one cable of 9 m: it starts soft, where the fibres \
        are still crimped, and goes on straight; a new cable also takes a set. § 5.2.1's stiffness \
        would take a fibre four times stiffer than kevlar at this length; with the traced one the \
        response peaks where the test-bed's did, but 1 mm hardly leaves the soft start."
        .to_owned();
    let panels = Panels::new("Fig. 5.3, force over extension").panel(printed).panel(traced);
    Ok(Plot { number: "5.3", title: "Cable: force over extension", caption, panels, rows })
}

/// Offset in N and slope in N/m of a straight line through the points from 0.02 mm to 1.0 mm.
fn slope_n_per_m(extension_mm: &[f64], force_n: &[f64]) -> (f64, f64) {
    let inside = || extension_mm.iter().zip(force_n).filter(|(x, _)| (0.02..=1.0).contains(*x));
    let count = inside().count().max(1) as f64;
    let mean = inside().fold((0.0, 0.0), |sum, (x, f)| (sum.0 + x / count, sum.1 + f / count));
    let (cross, square) = inside().fold((0.0, 0.0), |sum, (x, f)| {
        (sum.0 + (x - mean.0) * (f - mean.1), sum.1 + (x - mean.0).powi(2))
    });
    let slope = cross / square;
    (mean.1 - slope * mean.0, 1e3 * slope)
}

/// Largest force in fig. 5.4, N: within what the cable carries at work.
const LOOP_FORCE_N: f64 = 100.0;

/// Fig. 5.4: two loading cycles of 20 cm.
///
/// # Errors
/// Never.
pub fn loops(_: &Common) -> Result<Plot> {
    let mut panels = Panels::new("Fig. 5.4, two loading cycles");
    let mut ratios = [0.0; 2];
    for (index, (title, parameters)) in [
        ("Printed stiffness", Parameters::printed()),
        ("Traced stiffness", Parameters::calibrated()),
    ]
    .into_iter()
    .enumerate()
    {
        let mut element = parameters.specimen(0.2);
        // Small against the extension at the largest force, so that the turns lie there.
        let step = 2e-3 * LOOP_FORCE_N / element.law().elastic_n_per_m();
        let mut figure = axes(title, "extension / mm", "force / N");
        let mut slopes = [0.0; 2];
        let mut extension = 0.0;
        for (turn, slope) in slopes.iter_mut().enumerate() {
            let (mut x, mut f) = (vec![1e3 * extension], vec![element.tension_n()]);
            let start = extension;
            while element.tension_n() < LOOP_FORCE_N {
                extension += step;
                f.push(element.extend(extension));
                x.push(1e3 * extension);
            }
            *slope = (LOOP_FORCE_N - f[0]) / (extension - start);
            while element.tension_n() > 0.0 && extension > 0.0 {
                extension -= step;
                f.push(element.extend(extension));
                x.push(1e3 * extension);
            }
            // Dashed, since both unloadings lie on one another.
            figure = match turn {
                0 => figure.line(Blue, "first", &x, &f),
                _ => figure.dashed(Vermillion, "second", &x, &f),
            };
        }
        ratios[index] = slopes[1] / slopes[0];
        panels = panels.panel(figure);
    }
    let caption =
        "Two loadings and unloadings, one after the other, of 20 cm of the cable, to 100 N. The \
            second loading is stiffer: the first has laid the fibres straight and left a permanent \
            set. Fibres that rub make loading and unloading differ. The amount of both is assumed, \
            since fig. 5.4 has no numbers in the text."
            .to_owned();
    let rows = vec![
        Row::own("own.cable.second_over_first_loading", "5.4", "1", ratios.map(Some))
            .note("mean stiffness of the second loading to 100 N over that of the first"),
    ];
    Ok(Plot { number: "5.4", title: "Cable: two loading cycles", caption, panels, rows })
}

/// Fig. 5.5: torque of a slow movement.
///
/// # Errors
/// Where a constant is out of range.
pub fn static_friction(common: &Common) -> Result<Plot> {
    let hydrostatic = quasi_static_cycle(&common.calibration.line)?;
    let traced = quasi_static_cycle(&Cable::new(Parameters::calibrated()))?;
    let printed = quasi_static_cycle(&Cable::new(Parameters::printed()))?;
    let panel = |title: &str, slow: &QuasiStaticCycle| {
        let (x_label, y_label) = ("slave position / °", "motor torque / (N·m)");
        curve(title, x_label, y_label, &slow.position_deg, &slow.torque_nm)
    };
    let panels = Panels::new("Fig. 5.5, static friction over position")
        .panel(panel("A  Hydrostatic line, traced", &hydrostatic))
        .panel(panel("B  Cable, traced", &traced));
    let note =
        "mean magnitude of the motor's torque in one direction, master along a sine of 0.008 Hz";
    let torque = |direction: usize| [&printed, &traced].map(|cycle| Some(cycle.mean_nm[direction]));
    let rows = vec![
        Row::beside("cable.static_friction_positive_nm", Role::Input, torque(0))?.note(format!(
            "{note}; the supports' friction was set from it as breakaway, which stick-slip \
                undercuts"
        )),
        Row::beside("cable.static_friction_negative_nm", Role::Input, torque(1))?.note(note),
    ];
    let caption = "The motor's torque while the master moves very slowly (0.008 Hz) along a sine \
        and back. It is static friction, cut down wherever the slave breaks loose. The hydrostatic \
        model's friction does not depend on position or direction, the measured one did; the \
        cable's does both."
        .to_owned();
    Ok(Plot { number: "5.5", title: "Static friction over position", caption, panels, rows })
}

/// Fig. 5.6: friction over pretension.
///
/// # Errors
/// Never.
pub fn pretension(_: &Common) -> Result<Plot> {
    let at = |pretension_n: f64| {
        Parameters { pretension_n, ..Parameters::printed() }.static_friction_at_motor_nm()
    };
    let tension: Vec<f64> = (1..=200).map(f64::from).collect();
    let friction: Vec<f64> = tension.iter().map(|tension| at(*tension)).collect();
    let declared = Parameters::printed().pretension_n;
    let panels = Panels::new("Fig. 5.6, friction over pretension").panel(
        axes("", "pretension of a cable / N", "static friction at the motor / (N·m)")
            .y_range(0.0, 0.9)
            .line(Blue, "model", &tension, &friction)
            .scatter(Black, "declared", &[declared], &[at(declared)]),
    );
    let caption = "Breakaway torque at the motor against the cables' tension: it grows with \
        tension and settles, as measured. The law's limit is set from § 5.2.2's friction; the \
        tension at which it bends is assumed."
        .to_owned();
    let rows = [30.0, 60.0, 120.0]
        .map(|tension| {
            let id = format!("own.cable.static_friction_at_{tension:.0}n_nm");
            Row::own(id, "5.6", "N·m", [Some(at(tension)); 2])
                .note("does not depend on the stiffness")
        })
        .to_vec();
    Ok(Plot { number: "5.6", title: "Cable: friction over pretension", caption, panels, rows })
}

/// The cable's panels of fig. 5.7, and its rows.
///
/// # Errors
/// Where a constant is out of range.
pub fn response() -> Result<([Figure; 2], Vec<Row>)> {
    let mut frequencies = logarithmic(0.2, 0.98 * CLOSE_HZ.0, 24);
    frequencies.extend(logarithmic(CLOSE_HZ.0, CLOSE_HZ.1, 48));
    // As printed, the cable takes steps so small that the slowest are left out; its gain is flat
    // there.
    let few = logarithmic(0.5, CLOSE_HZ.1, 28);
    let (printed, traced) =
        (Cable::new(Parameters::printed()), Cable::new(Parameters::calibrated()));
    let curves = [
        Curve::simulated("printed constants", Vermillion, &sweep(&printed, &few)?),
        Curve::simulated("traced cable", Blue, &sweep(&traced, &frequencies)?),
    ];
    let peaks = [peak(&printed, 10.0, 120.0)?, peak(&traced, 3.0, 20.0)?];
    let frequency = peaks.map(|peak| peak.frequency_hz());
    let cuts = [cut_off(&printed, frequency[0])?, cut_off(&traced, frequency[1])?];
    let lags = [at(&printed, 1.0)?.lag_s(), at(&traced, 1.0)?.lag_s()];
    let [gain, phase] = bode("B  Cable", &curves, (0.2, 15.0), (0.5, 12.0), -220.0);
    let gain = measured_points(gain, "cable.resonance_hz", "cable.cutoff_hz")?;
    let p = Parameters::printed();
    let mut rows = vec![
        Row::beside("cable.resonance_hz", Role::Fitted, frequency)?.note(
            "frequency of the largest gain; the traced factor on the stiffness was chosen for it",
        ),
        Row::beside("cable.cutoff_hz", Role::Predicted, cuts)?
            .note("gain 0.707 above the peak, over the mechanical ratio"),
        Row::own("own.cable.peak_gain", "5.7", "1", peaks.map(|peak| peak.gain())).note(
            "over the mechanical ratio; the thesis says the gain \"remains same till after \
                resonance\"",
        ),
        Row::own("own.cable.lag_1hz_s", "5.8", "s", lags.map(Some))
            .note("lag of the slave's fundamental at 1 Hz"),
    ];
    for (id, value) in [
        ("cable.length_m", Some(p.line_length_m)),
        ("cable.diameter_mm", Some(1e3 * p.cable_diameter_m)),
        ("cable.mechanical_ratio", Some(p.mechanical_ratio)),
        ("cable.support_spacing_m", Some(p.support_spacing_m)),
        ("cable.cable_length_m", None),
        ("cable.encoder_lines_per_rev", None),
    ] {
        let row = Row::beside(id, Role::Input, [value; 2])?;
        rows.push(if value.is_none() { row.note("not a constant of the model") } else { row });
    }
    Ok(([gain, phase], rows))
}

/// Fig. 5.8: both transmissions at 1 Hz.
///
/// # Errors
/// Where a constant is out of range.
pub fn movement(common: &Common) -> Result<Plot> {
    let hydrostatic = cycle(&common.calibration.line, 1.0)?;
    let cable = cycle(&Cable::new(Parameters::calibrated()), 1.0)?;
    let printed = [
        cycle(&crate::simulated_line::Line::printed(), 1.0)?.flat_top_s(),
        cycle(&Cable::new(Parameters::printed()), 1.0)?.flat_top_s(),
    ];
    let ratio = Parameters::calibrated().mechanical_ratio;
    let panels = Panels::new("Fig. 5.8, both transmissions at 1 Hz")
        .panel(over_cycle("A  Hydrostatic line, traced", &hydrostatic, ("master", 1.0)))
        .panel(over_cycle("B  Cable, traced", &cable, ("master / 6", ratio)));
    let flat_tops = [hydrostatic.flat_top_s(), cable.flat_top_s()];
    let row = |name: &str, index: usize| {
        let ours = [Some(printed[index]), Some(flat_tops[index])];
        Row::own(format!("own.flat_top_1hz.{name}_s"), "5.8", "s", ours)
            .note("longest time for which the slave stands still")
    };
    let rows = vec![row("hydrostatic", 0), row("cable", 1)];
    let caption = format!(
        "Master (full) and slave (dashed) at 1 Hz; the cable's master turns six times as far, and \
            is drawn over that ratio. The master is moved along a sine of ±30° (cable: ±180°). The \
            slave stands still for up to {:.0} ms with the hydrostatic line and {:.0} ms with the \
            cable; the thesis saw the cable stick visibly more.",
        1e3 * flat_tops[0],
        1e3 * flat_tops[1]
    );
    Ok(Plot { number: "5.8", title: "Both transmissions at 1 Hz", caption, panels, rows })
}
