//! Draws a [`Figure`] as SVG with plotters' SVG back end.
//!
//! The back end knows whole pixels only. Everything is therefore drawn `FINE` times larger than it
//! is shown, which makes lines smooth to a fifth of a CSS pixel. The axes are drawn here because
//! plotters' mesh has no inward ticks, no minor ticks between decades and no legend outside the
//! data area.

use anyhow::{Context as _, Result, bail};
use maud::html;
use plotters::backend::SVGBackend;
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind, IntoDrawingArea};
use plotters::element::{Circle, PathElement, Polygon, Rectangle, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    Color, FontDesc, FontFamily, FontStyle, FontTransform, RGBColor, ShapeStyle, TextStyle,
};

use crate::coordinate_map::{Axes, round};
use crate::decimate;
use crate::figure::{Figure, Mark, Series};
use crate::scale::{Kind, Scale, Tick};

const FINE: i32 = 5;
const FAMILY: &str = "Helvetica Neue, Helvetica, Arial, Liberation Sans, sans-serif";
const TEXT: i32 = 13;
/// Most dots of one series.
const MOST_DOTS: usize = 3000;
const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const GRID: RGBColor = RGBColor(0xE4, 0xE4, 0xE4);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = std::result::Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Width of a text in CSS pixels: an estimate, since only the viewer knows its fonts.
fn text_width(text: &str) -> i32 {
    (text.chars().map(|c| if "il.,:;|()−' ".contains(c) { 0.34 } else { 0.58 }).sum::<f64>()
        * f64::from(TEXT)) as i32
}

impl Figure {
    /// The figure as a stand-alone SVG document.
    ///
    /// # Errors
    /// Where columns of a series differ in length, or there is no finite point to draw.
    pub fn render_svg(&self) -> Result<String> {
        for s in &self.series {
            let (x, y) = match s.mark {
                Mark::HorizontalRule | Mark::VerticalRule => continue,
                Mark::Band | Mark::Errors if s.y.len() == s.x.len() => (s.x.len(), s.upper.len()),
                _ => (s.x.len(), s.y.len()),
            };
            if x != y {
                bail!(
                    "figure `{}`, series `{}`: {x} abscissae but {y} ordinates; pass columns of \
                        one length",
                    self.title,
                    s.name
                );
            }
        }
        svg(self)
    }
}

fn svg(figure: &Figure) -> Result<String> {
    let empty = || {
        format!(
            "figure `{}`: no finite point in any series (on a logarithmic axis: no positive one)",
            figure.title
        )
    };
    let xs = figure.series.iter().flat_map(|s| s.x.iter().copied());
    let ys = figure.series.iter().flat_map(|s| match s.mark {
        Mark::Band => s.y.iter().chain(&s.upper).copied().collect::<Vec<_>>(),
        Mark::Errors => s.y.iter().zip(&s.upper).flat_map(|(y, h)| [y - h, y + h]).collect(),
        _ => s.y.clone(),
    });
    let scale = |kind, range: Option<(f64, f64)>, values: &mut dyn Iterator<Item = f64>, margin| {
        match range {
            Some((low, high)) if low < high && (kind != Kind::Logarithmic || low > 0.0) => {
                Some(Scale { kind, low, high })
            }
            _ => Scale::fit(kind, values, margin),
        }
    };
    let x = scale(figure.x_kind, figure.x_range, &mut { xs }, 0.01).with_context(empty)?;
    let y = scale(figure.y_kind, figure.y_range, &mut { ys }, 0.06).with_context(empty)?;

    let (width, height) = (figure.size.0 as i32, figure.size.1 as i32);
    let mut buffer = String::new();
    let axes = draw(figure, x, y, &mut buffer, (width, height))
        .with_context(|| format!("figure `{}`: could not be drawn", figure.title))?;
    // The drawing is FINE times too large: shown at its CSS size, scaled by the view box.
    let (fine_width, fine_height) = (width * FINE, height * FINE);
    let view_box = format!("viewBox=\"0 0 {fine_width} {fine_height}\"");
    let opening = format!("<svg width=\"{fine_width}\" height=\"{fine_height}\" {view_box}");
    let title = html! { (figure.title) }.into_string();
    let frame = format!("{} {} {} {}", axes.left, axes.right, axes.top, axes.bottom);
    let (over, up) = (hover_scale(&axes.x), hover_scale(&axes.y));
    let shown = format!(
        "<svg width=\"{width}\" height=\"{height}\" {view_box} role=\"img\" \
         aria-label=\"{title}\" data-frame=\"{frame}\" data-x=\"{over}\" data-y=\"{up}\""
    );
    Ok(buffer.replacen(&opening, &shown, 1))
}

/// A scale as `hover.js` reads it: kind, lowest and highest value.
fn hover_scale(scale: &Scale) -> String {
    let kind = match scale.kind {
        Kind::Linear => "linear",
        Kind::Logarithmic => "log",
        Kind::Dates => "dates",
    };
    format!("{kind} {:e} {:e}", scale.low, scale.high)
}

fn draw(
    figure: &Figure,
    x: Scale,
    y: Scale,
    buffer: &mut String,
    (width, height): (i32, i32),
) -> std::result::Result<Axes, DrawingAreaErrorKind<std::io::Error>> {
    let area = SVGBackend::with_string(buffer, ((width * FINE) as u32, (height * FINE) as u32))
        .into_drawing_area();
    let x_ticks = x.ticks((width / 80).max(2) as usize);
    let y_ticks = y.ticks((height / 55).max(2) as usize);
    let label_width =
        y_ticks.iter().filter_map(|t| t.label.as_deref()).map(text_width).max().unwrap_or(0);
    let legend = legend_rows(figure, width - 24);
    let title_height = if figure.title.is_empty() { 4 } else { 24 };
    let axes = Axes {
        left: (34 + label_width) * FINE,
        right: (width - 14) * FINE,
        top: (title_height + 6 + 19 * legend.len() as i32) * FINE,
        bottom: (height - 46) * FINE,
        x,
        y,
    };
    area.fill(&RGBColor(255, 255, 255))?;
    grid(&area, &axes, &x_ticks, &y_ticks)?;
    // Shaded areas lie under everything else.
    let (bands, others): (Vec<_>, _) = figure.series.iter().partition(|s| s.mark == Mark::Band);
    for s in bands.into_iter().chain(others) {
        series(&area, &axes, s)?;
    }
    frame(&area, &axes, &x_ticks, &y_ticks)?;
    labels(&area, &axes, figure, height)?;
    draw_legend(&area, &legend, title_height)?;
    area.present()?;
    Ok(axes)
}

/// One grid line at every labelled tick.
fn grid(area: &Area<'_>, axes: &Axes, x_ticks: &[Tick], y_ticks: &[Tick]) -> Drawn {
    for tick in x_ticks.iter().filter(|t| t.label.is_some()) {
        upright(area, axes, axes.px(tick.at).round() as i32, GRID, 0.8)?;
    }
    for tick in y_ticks.iter().filter(|t| t.label.is_some()) {
        across(area, axes, axes.py(tick.at).round() as i32, GRID, 0.8)?;
    }
    Ok(())
}

/// A line from the top of the frame to its bottom.
fn upright(area: &Area<'_>, axes: &Axes, at: i32, colour: RGBColor, width: f64) -> Drawn {
    line(area, &[(at, axes.top), (at, axes.bottom)], colour, width)
}

/// A line from the left side of the frame to its right side.
fn across(area: &Area<'_>, axes: &Axes, at: i32, colour: RGBColor, width: f64) -> Drawn {
    line(area, &[(axes.left, at), (axes.right, at)], colour, width)
}

/// The frame with ticks on all four sides, labelled below and on the left.
fn frame(area: &Area<'_>, axes: &Axes, x_ticks: &[Tick], y_ticks: &[Tick]) -> Drawn {
    let Axes { left, right, top, bottom, .. } = *axes;
    // A path, since the back end draws rectangles without a line width.
    let corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)];
    line(area, &corners, INK, 1.0)?;
    let long = |tick: &Tick| if tick.label.is_some() { 5 * FINE } else { 3 * FINE };
    for tick in x_ticks {
        let at = axes.px(tick.at).round() as i32;
        line(area, &[(at, bottom), (at, bottom - long(tick))], INK, 1.0)?;
        line(area, &[(at, top), (at, top + long(tick))], INK, 1.0)?;
        if let Some(label) = &tick.label {
            text(area, label, (at, bottom + 6 * FINE), (HPos::Center, VPos::Top))?;
        }
    }
    for tick in y_ticks {
        let at = axes.py(tick.at).round() as i32;
        line(area, &[(left, at), (left + long(tick), at)], INK, 1.0)?;
        line(area, &[(right, at), (right - long(tick), at)], INK, 1.0)?;
        if let Some(label) = &tick.label {
            text(area, label, (left - 6 * FINE, at), (HPos::Right, VPos::Center))?;
        }
    }
    Ok(())
}

/// The title and the labels of both axes.
fn labels(area: &Area<'_>, axes: &Axes, figure: &Figure, height: i32) -> Drawn {
    let middle = ((axes.left + axes.right) / 2, (axes.top + axes.bottom) / 2);
    text(area, &figure.x_label, (middle.0, (height - 8) * FINE), (HPos::Center, VPos::Bottom))?;
    let style = text_style(FontStyle::Normal, (HPos::Center, VPos::Top));
    let style = style.transform(FontTransform::Rotate270);
    area.draw(&Text::new(figure.y_label.as_str(), (5 * FINE, middle.1), style))?;
    if figure.title.is_empty() {
        return Ok(());
    }
    let style = text_style(FontStyle::Bold, (HPos::Left, VPos::Top));
    area.draw(&Text::new(figure.title.as_str(), (12 * FINE, 7 * FINE), style))
}

fn draw_legend(area: &Area<'_>, rows: &[Vec<&Series>], title_height: i32) -> Drawn {
    for (i, row) in rows.iter().enumerate() {
        let at = (title_height + 19 * i as i32 + 9) * FINE;
        let mut from = 12 * FINE;
        for s in row {
            legend_mark(area, s, (from, at))?;
            text(area, &s.name, (from + 30 * FINE, at), (HPos::Left, VPos::Center))?;
            from += legend_width(s) * FINE;
        }
    }
    Ok(())
}

fn legend_width(s: &Series) -> i32 {
    30 + text_width(&s.name) + 16
}

/// The legend stands above the frame, where it covers no data, in as many rows as it needs.
fn legend_rows(figure: &Figure, width: i32) -> Vec<Vec<&Series>> {
    let mut rows: Vec<Vec<&Series>> = Vec::new();
    let mut used = i32::MAX;
    for s in figure.series.iter().filter(|s| !s.name.is_empty()) {
        if used.saturating_add(legend_width(s)) > width {
            rows.push(Vec::new());
            used = 0;
        }
        used += legend_width(s);
        if let Some(row) = rows.last_mut() {
            row.push(s);
        }
    }
    rows
}

fn legend_mark(area: &Area<'_>, s: &Series, (x, y): (i32, i32)) -> Drawn {
    let (from, to) = ((x, y), (x + 24 * FINE, y));
    let colour = s.colour.rgb();
    match s.mark {
        Mark::Line => line(area, &[from, to], colour, 1.6),
        Mark::Dashed => dashed(area, &[from, to], colour),
        Mark::HorizontalRule | Mark::VerticalRule => line(area, &[from, to], colour, 1.0),
        Mark::Band => {
            let corners = [(x, y - 5 * FINE), (x + 24 * FINE, y + 5 * FINE)];
            area.draw(&Rectangle::new(corners, colour.mix(0.25).filled()))
        }
        Mark::Scatter | Mark::Errors => dot(area, (x + 12 * FINE, y), colour, false),
    }
}

fn series(area: &Area<'_>, axes: &Axes, s: &Series) -> Drawn {
    let colour = s.colour.rgb();
    match s.mark {
        Mark::Line | Mark::Dashed => {
            for run in axes.runs(&s.x, &s.y) {
                let run = decimate::envelope(&run, FINE / 2);
                if s.mark == Mark::Line {
                    line(area, &run, colour, 1.3)?
                } else {
                    dashed(area, &run, colour)?
                }
            }
        }
        Mark::Scatter => {
            let points = s.x.iter().zip(&s.y).map(|(x, y)| (axes.px(*x), axes.py(*y)));
            let points: Vec<_> = points.filter(|p| axes.inside(*p)).map(round).collect();
            // Many points become small and transparent, or they hide what they show; and no more of
            // them than a browser draws at once.
            let many = points.len() > 400;
            let mut cell = 1;
            let mut kept = decimate::thin(&points, cell);
            while kept.len() > MOST_DOTS {
                cell += FINE / 2;
                kept = decimate::thin(&points, cell);
            }
            for p in kept {
                dot(area, p, colour, many)?;
            }
        }
        Mark::Band => {
            let clamp = |y: f64| axes.py(y).clamp(f64::from(axes.top), f64::from(axes.bottom));
            // Broken where values are not finite, as lines are.
            let there =
                |row: usize| [&s.x, &s.y, &s.upper].iter().all(|values| values[row].is_finite());
            let rows: Vec<usize> = (0..s.x.len().min(s.y.len()).min(s.upper.len())).collect();
            for run in rows.chunk_by(|a, b| there(*a) == there(*b)).filter(|run| there(run[0])) {
                let edge = |ys: &[f64]| -> Vec<(i32, i32)> {
                    let points = run.iter().map(|row| (axes.px(s.x[*row]), clamp(ys[*row])));
                    // A value below zero has no place on a logarithmic axis.
                    let inside = |p: &(f64, f64)| {
                        p.1.is_finite()
                            && p.0 >= f64::from(axes.left)
                            && p.0 <= f64::from(axes.right)
                    };
                    decimate::envelope(&points.filter(inside).map(round).collect::<Vec<_>>(), FINE)
                };
                let mut outline = edge(&s.y);
                outline.extend(edge(&s.upper).into_iter().rev());
                area.draw(&Polygon::new(outline, colour.mix(0.25).filled()))?;
            }
        }
        Mark::Errors => {
            for ((x, y), half) in s.x.iter().zip(&s.y).zip(&s.upper) {
                let at = (axes.px(*x), axes.py(*y));
                if !axes.inside(at) {
                    continue;
                }
                if let Some((a, b)) =
                    axes.clip((at.0, axes.py(y - half)), (at.0, axes.py(y + half)))
                {
                    line(area, &[round(a), round(b)], colour, 1.1)?;
                }
                dot(area, round(at), colour, false)?;
            }
        }
        Mark::HorizontalRule => {
            let at = axes.py(s.y.first().copied().unwrap_or(f64::NAN));
            if at >= f64::from(axes.top) && at <= f64::from(axes.bottom) {
                across(area, axes, at as i32, colour, 1.0)?;
            }
        }
        Mark::VerticalRule => {
            let at = axes.px(s.x.first().copied().unwrap_or(f64::NAN));
            if at >= f64::from(axes.left) && at <= f64::from(axes.right) {
                upright(area, axes, at as i32, colour, 1.0)?;
            }
        }
    }
    Ok(())
}

fn stroke(colour: RGBColor, width: f64) -> ShapeStyle {
    colour.stroke_width((width * f64::from(FINE)).round() as u32)
}

fn line(area: &Area<'_>, points: &[(i32, i32)], colour: RGBColor, width: f64) -> Drawn {
    area.draw(&PathElement::new(points.to_vec(), stroke(colour, width)))
}

/// Dashes of 6 and gaps of 4 CSS pixels along the line.
fn dashed(area: &Area<'_>, points: &[(i32, i32)], colour: RGBColor) -> Drawn {
    let (on, period) = (f64::from(6 * FINE), f64::from(10 * FINE));
    let mut phase = 0.0;
    let mut dash: Vec<(i32, i32)> = Vec::new();
    for pair in points.windows(2) {
        let (a, b) = (
            (f64::from(pair[0].0), f64::from(pair[0].1)),
            (f64::from(pair[1].0), f64::from(pair[1].1)),
        );
        let length = (b.0 - a.0).hypot(b.1 - a.1);
        let mut along = 0.0;
        while along < length {
            let drawn = phase < on;
            let step = (if drawn { on - phase } else { period - phase }).min(length - along);
            let at =
                |s: f64| round((a.0 + (b.0 - a.0) * s / length, a.1 + (b.1 - a.1) * s / length));
            if drawn {
                if dash.is_empty() {
                    dash.push(at(along));
                }
                dash.push(at(along + step));
            } else if !dash.is_empty() {
                line(area, &std::mem::take(&mut dash), colour, 1.3)?;
            }
            along += step;
            phase = if phase + step >= period - 1e-9 { 0.0 } else { phase + step };
        }
    }
    if dash.len() > 1 { line(area, &dash, colour, 1.3) } else { Ok(()) }
}

fn dot(area: &Area<'_>, at: (i32, i32), colour: RGBColor, small: bool) -> Drawn {
    let (radius, alpha) = if small { (1.2, 0.5) } else { (2.2, 0.9) };
    let radius = (f64::from(FINE) * radius).round() as i32;
    area.draw(&Circle::new(at, radius, colour.mix(alpha).filled()))
}

fn text_style(style: FontStyle, (h_pos, v_pos): (HPos, VPos)) -> TextStyle<'static> {
    // The back end divides the size by 1.24.
    let size = f64::from(TEXT * FINE) * 1.24;
    TextStyle::from(FontDesc::new(FontFamily::Name(FAMILY), size, style))
        .color(&INK)
        .pos(Pos::new(h_pos, v_pos))
}

fn text(area: &Area<'_>, content: &str, at: (i32, i32), anchor: (HPos, VPos)) -> Drawn {
    area.draw(&Text::new(content, at, text_style(FontStyle::Normal, anchor)))
}
