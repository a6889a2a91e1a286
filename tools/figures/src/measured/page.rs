//! The page of a recording, its figures, and its lines on a terminal.

use std::path::Path;

use anyhow::Result;
use report::Colour::{Black, Blue, Grey, Vermillion};
use report::{Figure, Page, Panels, Table, Tone};
use rig::RigFile;

use super::friction::{Direction, FrictionMap, SpeedPoint};
use super::response::Point;
use super::work::Work;
use super::{Beside, Shown};

/// Coherence below which a gain says little.
const COHERENT: f64 = 0.8;

/// The files of a folder: page, figures, numbers. `replaced` says which programs of others ran.
///
/// # Errors
/// Where a figure cannot be drawn.
pub(super) fn files(
    file: &Path,
    rig: &RigFile,
    axis: usize,
    replaced: &[String],
    shown: &[Shown],
    json: &str,
) -> Result<Vec<(String, Vec<u8>)>> {
    let mut page = Page::new("Figures of a recording").subtitle(&format!(
        "{}, rig {}, axis {axis}; the model is the rig file's",
        file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        rig.name
    ));
    for line in replaced {
        page = page.verdict(Tone::Warning, line, "");
    }
    let mut files = Vec::new();
    for (heading, panels, caption) in figures(shown) {
        let name = format!("figure-{}.svg", files.len() + 1);
        files.push((name, panels.clone().columns(1).render_svg()?.into_bytes()));
        page = page.heading(&heading).panels(&panels.columns(2), &caption);
    }
    let page = page
        .heading("Work and friction")
        .table(table(shown), TABLE)
        .details("All values as written by --json", json)
        .footer(concat!("farreach figures ", env!("CARGO_PKG_VERSION")));
    files.push(("index.html".to_owned(), page.render()?.into_bytes()));
    files.push(("figures.json".to_owned(), format!("{json}\n").into_bytes()));
    Ok(files)
}

const TABLE: &str = "Measured, and in brackets the model. Friction: mean magnitude of the motor's \
    torque over the second half of each stroke, forward and backward. At speed: mean torque where \
    a sine is fastest and does not accelerate. Work of motor and hand over the whole segment; the \
    efficiency is what comes out over what is put in, none where both put work in or less than a \
    tenth comes out, as with nobody at the handle.";

/// Every figure with its heading and caption.
fn figures(shown: &[Shown]) -> Vec<(String, Panels, String)> {
    let mut figures = Vec::new();
    for one in shown {
        if let Some(response) = &one.response {
            figures.push((
                format!("Frequency response: {}", one.label),
                bode(response),
                BODE.into(),
            ));
        }
        if let Some(map) = &one.friction {
            let both = Beside {
                measured: &map.measured.directions[..],
                model: map.model.as_ref().map(|model| &model.directions[..]),
            };
            let panels = Panels::new(one.label.clone()).panel(friction(&both));
            figures.push((format!("Friction against position: {}", one.label), panels, MAP.into()));
        }
    }
    if let Some(panels) = against_speed(shown) {
        figures.push(("Friction against speed".to_owned(), panels, SPEED.into()));
    }
    figures
}

const BODE: &str = "Slave over master (H1 estimate, Welch's method), with bars of one standard \
    deviation; grey: 0.707. Where the coherence is low, the slave does not follow the master \
    alone: friction, a hand, noise.";
const MAP: &str = "Torque of the motor on its shaft during a slow sine, which is friction and \
    gravity, in stretches of the handle's position. Full: measured; dashed: the model.";
const SPEED: &str = "Mean torque of the motor where each sine is fastest, forward and backward.";

fn bode(response: &Beside<Vec<Point>>) -> Panels {
    let column =
        |points: &[Point], of: fn(&Point) -> f64| points.iter().map(of).collect::<Vec<_>>();
    let (measured, model) = (&response.measured, response.model.as_deref().unwrap_or_default());
    let hertz = column(measured, |point| point.frequency_hz);
    let model_hertz = column(model, |point| point.frequency_hz);
    // The phase goes on where it leaves half a turn.
    let phases = |points: &[Point]| {
        let mut before = 0.0;
        let unwrapped = points.iter().map(|point| {
            let turns = ((before - point.phase_deg) / 360.0_f64).round();
            before = point.phase_deg + 360.0 * turns;
            before
        });
        unwrapped.collect::<Vec<_>>()
    };
    let axes =
        |title: &str, y: &str| Figure::new(title, "frequency / Hz", y).size(420, 300).log_x();
    let gain = axes("A  gain", "gain, slave over master")
        .log_y()
        .errors(
            Blue,
            "",
            &hertz,
            &column(measured, |point| point.gain),
            &column(measured, |point| point.gain_sd),
        )
        .scatter(Blue, "measured", &hertz, &column(measured, |point| point.gain))
        .dashed(Vermillion, "model", &model_hertz, &column(model, |point| point.gain))
        .horizontal(Grey, "", std::f64::consts::FRAC_1_SQRT_2);
    let phase = axes("B  phase", "phase / °")
        .errors(Blue, "", &hertz, &phases(measured), &column(measured, |point| point.phase_sd_deg))
        .scatter(Blue, "measured", &hertz, &phases(measured))
        .dashed(Vermillion, "model", &model_hertz, &phases(model));
    let coherence = axes("C  coherence", "coherence")
        .y_range(0.0, 1.05)
        .scatter(Blue, "measured", &hertz, &column(measured, |point| point.coherence))
        .dashed(Vermillion, "model", &model_hertz, &column(model, |point| point.coherence))
        .horizontal(Grey, "", COHERENT);
    Panels::new("Frequency response").panel(gain).panel(phase).panel(coherence)
}

fn friction(both: &Beside<&[Direction]>) -> Figure {
    let mut figure = Figure::new("", "handle / °", "torque of the motor / (N·m)").size(560, 340);
    let degrees =
        |one: &Direction| one.position_rad.iter().map(|rad| rad.to_degrees()).collect::<Vec<_>>();
    for ((one, colour), name) in
        both.measured.iter().zip([Blue, Vermillion]).zip(["forward", "backward"])
    {
        figure = figure.line(colour, format!("measured, {name}"), &degrees(one), &one.torque_nm);
    }
    for ((one, colour), name) in
        both.model.unwrap_or_default().iter().zip([Blue, Vermillion]).zip(["forward", "backward"])
    {
        figure = figure.dashed(colour, format!("model, {name}"), &degrees(one), &one.torque_nm);
    }
    figure.horizontal(Grey, "", 0.0)
}

fn against_speed(shown: &[Shown]) -> Option<Panels> {
    let points: Vec<_> = shown.iter().filter_map(|one| one.at_speed.as_ref()).collect();
    if points.is_empty() {
        return None;
    }
    let mut figure =
        Figure::new("", "speed of the motor, at the handle / (rad/s)", "torque / (N·m)")
            .size(560, 340);
    let sides = |points: Vec<SpeedPoint>| -> (Vec<f64>, Vec<f64>) {
        let both = points.into_iter().flat_map(|point| {
            let [forward, backward] = point.torque_nm;
            [(point.speed_rad_s, forward), (-point.speed_rad_s, backward)]
        });
        both.unzip()
    };
    let (x, y) = sides(points.iter().map(|point| point.measured).collect());
    figure = figure.scatter(Blue, "measured", &x, &y);
    let (x, y) = sides(points.iter().filter_map(|point| point.model).collect());
    figure = figure.scatter(Vermillion, "model", &x, &y);
    Some(Panels::new("Friction against speed").panel(figure.horizontal(Black, "", 0.0)))
}

fn number(value: Option<f64>) -> String {
    match value.filter(|value| value.is_finite()) {
        Some(value) => format!("{value:.3}"),
        None => "-".to_owned(),
    }
}

/// The cells of a segment: measured, and in brackets the model.
fn cells(one: &Shown) -> [String; 6] {
    let pair = |measured: Option<f64>, model: Option<f64>| match (measured, model) {
        (None, None) => "-".to_owned(),
        _ => format!("{} ({})", number(measured), number(model)),
    };
    let friction = |direction: usize| match (&one.friction, &one.at_speed) {
        (Some(both), _) => {
            let of = |map: &FrictionMap| map.directions[direction].mean_nm;
            pair(Some(of(&both.measured)), both.model.as_ref().map(of))
        }
        (None, at_speed) => {
            let of = |point: SpeedPoint| point.torque_nm[direction].abs();
            let both = at_speed.as_ref();
            pair(both.map(|both| of(both.measured)), both.and_then(|both| both.model).map(of))
        }
    };
    let work = |of: fn(&Work) -> Option<f64>| {
        let both = one.work.as_ref();
        let model = both.and_then(|both| both.model.as_ref());
        pair(both.and_then(|both| of(&both.measured)), model.and_then(of))
    };
    [
        one.label.clone(),
        friction(0),
        friction(1),
        work(|work| Some(work.motor_j)),
        work(|work| Some(work.hand_j)),
        work(|work| work.efficiency),
    ]
}

const HEADER: [&str; 6] = [
    "segment",
    "torque forward / N·m",
    "backward / N·m",
    "work of the motor / J",
    "of the hand / J",
    "efficiency",
];

fn table(shown: &[Shown]) -> Table {
    Table::new(HEADER).rows(shown.iter().map(cells))
}

/// The result as text.
pub(super) fn lines(shown: &[Shown]) -> Vec<String> {
    let mut lines = vec!["measured (model)".to_owned()];
    for one in shown {
        let missing = match one.missing {
            0 => String::new(),
            missing => format!(", {missing} samples MISSING"),
        };
        lines.push(format!("{}: {}, {:.1} s{missing}", one.label, one.kind, one.duration_s));
        if let Some(both) = &one.response {
            for (at, point) in both.measured.iter().enumerate() {
                let model = both.model.as_ref().and_then(|model| model.get(at));
                let of = |of: fn(&Point) -> f64| model.map_or(f64::NAN, of);
                lines.push(format!(
                    "  {:8.3} Hz  gain {:.3} ± {:.3} ({:.3})  phase {:7.1}° ({:7.1}°)  coherence \
                     {:.3}",
                    point.frequency_hz,
                    point.gain,
                    point.gain_sd,
                    of(|point| point.gain),
                    point.phase_deg,
                    of(|point| point.phase_deg),
                    point.coherence
                ));
            }
        }
        for (name, cell) in HEADER.iter().zip(cells(one)).skip(1).filter(|(_, cell)| cell != "-") {
            lines.push(format!("  {name}: {cell}"));
        }
    }
    lines
}
