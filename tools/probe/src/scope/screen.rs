//! Draws the screen.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::widgets::Widget;
use ratatui::widgets::canvas::{Canvas, Painter, Shape};

use crate::scope::args::DIVISIONS;
use crate::scope::capture::Capture;
use crate::scope::decimate::{self, Run};
use crate::scope::describe::{condition, value_at};
use crate::scope::numbers::{short, time, with_unit};
use crate::scope::view::{KEYS, Scale, Shown, VERTICAL, View};

/// Colours of the channels, in turn.
const COLOURS: [Color; 6] =
    [Color::Yellow, Color::Cyan, Color::Green, Color::Magenta, Color::LightBlue, Color::White];
/// Lines beside the plot and the channels: head, markers, losses, time, cursors, counts, keys.
const OTHER_LINES: u16 = 7;
/// Least lines of a plot.
const LEAST_PLOT: u16 = 4;
/// Least columns of the screen.
const LEAST_WIDTH: u16 = 40;
/// Dots of a character (Braille patterns).
const DOTS: (u16, u16) = (2, 4);

/// What has come in since the beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Messages.
    pub(crate) received: u64,
    /// Messages missing in the sequence of their senders.
    pub(crate) lost: u64,
    /// Messages that came with a time before that of others, and are not shown.
    pub(crate) out_of_order: u64,
    /// Triggers that came too early.
    pub(crate) early: u64,
}

/// All that is on a screen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scene<'a> {
    /// The rig or the recording.
    pub(crate) place: &'a str,
    pub(crate) view: &'a View,
    pub(crate) capture: Option<&'a Capture>,
    /// What the capture does.
    pub(crate) doing: &'a str,
    pub(crate) counts: Counts,
}

/// Draws a scene.
pub(crate) fn draw(scene: &Scene<'_>, area: Rect, buffer: &mut Buffer) {
    let view = scene.view;
    let channels = view.channels.len() as u16;
    let least = OTHER_LINES + LEAST_PLOT + channels;
    if area.height < least || area.width < LEAST_WIDTH {
        let text = format!("the window is too small: {LEAST_WIDTH} columns, {least} lines");
        line(buffer, area, area.y, &text, Style::new());
        return;
    }
    let plot = Rect {
        x: area.x,
        y: area.y + 2,
        width: area.width - 1,
        height: area.height - OTHER_LINES - channels,
    };
    head(scene, area, buffer);
    if view.help {
        help(plot, buffer);
    } else {
        graticule(plot, buffer);
        markers(scene, plot, buffer);
        traces(scene, plot, buffer);
    }
    let below = plot.bottom();
    time_axis(scene, plot, below + 1, buffer);
    channel_lines(scene, area, below + 2, buffer);
    cursor_line(scene, area, below + 2 + channels, buffer);
    counts(scene, area, area.bottom() - 2, buffer);
    let keys = "h keys  space stop/go  m mode  e trigger  +- level  tT time  vV scale  c cursors  \
                q end";
    line(buffer, area, area.bottom() - 1, keys, Style::new().fg(Color::DarkGray));
}

/// Writes one line, cut off where it does not fit.
fn line(buffer: &mut Buffer, area: Rect, y: u16, text: &str, style: Style) {
    if y < area.bottom() {
        buffer.set_stringn(area.x, y, text, usize::from(area.width), style);
    }
}

fn colour(channel: usize) -> Color {
    COLOURS[channel % COLOURS.len()]
}

/// Where from, mode, state, trigger and time base.
fn head(scene: &Scene<'_>, area: Rect, buffer: &mut Buffer) {
    let view = scene.view;
    let doing = if view.running { scene.doing } else { "stopped" };
    let trigger = view.trigger().map_or_else(String::new, |shown| {
        format!(" | {}", condition(&shown.channel, &view.settings.condition))
    });
    let text = format!(
        "{} | {}, {doing}{trigger} | {}/div",
        scene.place,
        view.settings.mode.text(),
        time(view.time_base_s())
    );
    line(buffer, area, area.y, &text, Style::new().add_modifier(Modifier::BOLD));
}

fn help(plot: Rect, buffer: &mut Buffer) {
    for (y, (key, what)) in (plot.y..plot.bottom()).zip(KEYS) {
        line(buffer, plot, y, &format!("{key:<8} {what}"), Style::new());
    }
}

/// Dots where the lines of the divisions cross.
fn graticule(plot: Rect, buffer: &mut Buffer) {
    for across in 0..=DIVISIONS {
        for up in 0..=VERTICAL as u32 {
            let x = place(f64::from(across) / f64::from(DIVISIONS), plot.x, plot.width);
            let y = place(f64::from(up) / VERTICAL, plot.y, plot.height);
            set(buffer, x, y, "·", Color::DarkGray);
        }
    }
}

/// The cell at a share of a length.
fn place(share: f64, from: u16, length: u16) -> u16 {
    from + ((share * f64::from(length)) as u16).min(length.saturating_sub(1))
}

fn set(buffer: &mut Buffer, x: u16, y: u16, symbol: &str, colour: Color) {
    if let Some(cell) = buffer.cell_mut((x, y)) {
        cell.set_symbol(symbol).set_fg(colour);
    }
}

/// The trigger above and at the right of the plot, and the cursors.
fn markers(scene: &Scene<'_>, plot: Rect, buffer: &mut Buffer) {
    let view = scene.view;
    let above = plot.y - 1;
    for (name, cursor) in ["A", "B"].into_iter().zip(view.cursors) {
        let Some(share) = cursor else { continue };
        let x = place(share, plot.x, plot.width);
        set(buffer, x, above, name, Color::White);
        for y in plot.y..plot.bottom() {
            set(buffer, x, y, "│", Color::DarkGray);
        }
    }
    if let Some(capture) = scene.capture {
        let window_ns = capture.end_ns.saturating_sub(capture.begin_ns).max(1) as f64;
        let share = (capture.zero_ns - capture.begin_ns) as f64 / window_ns;
        let symbol = if capture.triggered { "▼" } else { "▽" };
        set(buffer, place(share, plot.x, plot.width), above, symbol, Color::White);
    }
    let index = view.channels.iter().position(|shown| shown.channel.place == view.settings.channel);
    if let Some((index, shown)) = index.and_then(|at| Some((at, view.channels.get(at)?))) {
        for level in view.settings.condition.levels() {
            let y = plot.y + dot(level, shown.scale, plot.height) / DOTS.1;
            set(buffer, plot.right(), y, "◀", colour(index));
        }
    }
}

/// The row of dots of a value, from the top; the nearest one where it is off the screen.
fn dot(value: f64, scale: Scale, lines: u16) -> u16 {
    let dots = f64::from(lines * DOTS.1);
    let top = scale.centre + VERTICAL / 2.0 * scale.per_division;
    let down = (top - value) / (VERTICAL * scale.per_division) * dots;
    down.clamp(0.0, dots - 1.0) as u16
}

/// The signals, and below them where messages are missing.
fn traces(scene: &Scene<'_>, plot: Rect, buffer: &mut Buffer) {
    let Some(capture) = scene.capture else { return };
    let columns = plot.width * DOTS.0;
    let mut all: Vec<Trace> = Vec::new();
    for (at, shown) in scene.view.channels.iter().enumerate() {
        let (ring, column) = shown.channel.place;
        let Some(rows) = capture.rows.get(ring) else { continue };
        let points = rows.points(column);
        let (begin_ns, end_ns) = (capture.begin_ns, capture.end_ns);
        let runs = decimate::runs(points, begin_ns, end_ns, usize::from(columns));
        all.push(Trace { runs, scale: shown.scale, colour: colour(at), lines: plot.height });
    }
    let gaps = all.iter().flat_map(|trace| &trace.runs).filter(|run| run.gap.is_some());
    for run in gaps {
        let x = plot.x + run.column as u16 / DOTS.0;
        set(buffer, x, plot.bottom(), "×", Color::Red);
    }
    // The channel that is selected lies above the others.
    let selected = scene.view.selected.min(all.len().saturating_sub(1));
    let order = (0..all.len()).filter(|at| *at != selected).chain([selected]);
    let order: Vec<&Trace> = order.filter_map(|at| all.get(at)).collect();
    Canvas::default()
        .marker(Marker::Braille)
        .x_bounds([0.0, f64::from(columns)])
        .y_bounds([0.0, f64::from(plot.height * DOTS.1)])
        .paint(|context| order.iter().for_each(|trace| context.draw(*trace)))
        .render(plot, buffer);
}

/// The line of one channel.
struct Trace {
    runs: Vec<Run>,
    scale: Scale,
    colour: Color,
    /// of the plot
    lines: u16,
}

impl Trace {
    fn dot(&self, value: f64) -> usize {
        usize::from(dot(value, self.scale, self.lines))
    }
}

impl Shape for Trace {
    fn draw(&self, painter: &mut Painter<'_, '_>) {
        let mut before: Option<&Run> = None;
        for run in &self.runs {
            for y in self.dot(run.high)..=self.dot(run.low) {
                painter.paint(run.column, y, self.colour);
            }
            if let Some(before) = before.filter(|_| run.joined) {
                let from = (before.column, self.dot(before.last));
                for (x, y) in between(from, (run.column, self.dot(run.first))) {
                    painter.paint(x, y, self.colour);
                }
            }
            before = Some(run);
        }
    }
}

/// The dots of a line.
fn between(from: (usize, usize), to: (usize, usize)) -> impl Iterator<Item = (usize, usize)> {
    let steps = from.0.abs_diff(to.0).max(from.1.abs_diff(to.1)).max(1);
    (0..=steps).map(move |step| {
        let along =
            |from: usize, to: usize| (from * (steps - step) + to * step + steps / 2) / steps;
        (along(from.0, to.0), along(from.1, to.1))
    })
}

/// The times at the beginning and the end of the window, and at the trigger.
fn time_axis(scene: &Scene<'_>, plot: Rect, y: u16, buffer: &mut Buffer) {
    let settings = &scene.view.settings;
    let (before_s, window_s) = (settings.pre_ns as f64 * 1e-9, settings.window_ns as f64 * 1e-9);
    let style = Style::new().fg(Color::DarkGray);
    let (first, last) = (time(-before_s), time(window_s - before_s));
    buffer.set_stringn(plot.x, y, &first, usize::from(plot.width), style);
    let zero = place(before_s / window_s, plot.x, plot.width);
    let at = plot.right().saturating_sub(last.chars().count() as u16);
    buffer.set_stringn(at, y, &last, last.len(), style);
    // Where there is place for it.
    if zero > plot.x + first.chars().count() as u16 && zero + 1 < at {
        set(buffer, zero, y, "0", Color::DarkGray);
    }
}

/// A line for each channel: scale, and its values at the cursors or in the window.
fn channel_lines(scene: &Scene<'_>, area: Rect, from: u16, buffer: &mut Buffer) {
    let width = scene.view.channels.iter().map(|shown| shown.channel.name.chars().count()).max();
    let width = width.unwrap_or(0);
    for (at, (y, shown)) in (from..).zip(&scene.view.channels).enumerate() {
        let (channel, scale) = (&shown.channel, shown.scale);
        let mark = if at == scene.view.selected { '>' } else { ' ' };
        let values =
            scene.capture.map_or_else(String::new, |capture| values(scene, capture, shown));
        let text = format!(
            "{mark}{:<width$}  {}/div{values}",
            channel.name,
            with_unit(scale.per_division, &channel.unit)
        );
        line(buffer, area, y, &text, Style::new().fg(colour(at)));
    }
}

/// The values of a channel at the cursors and their difference; without cursors, its bounds.
fn values(scene: &Scene<'_>, capture: &Capture, shown: &Shown) -> String {
    let (ring, column) = shown.channel.place;
    let Some(rows) = capture.rows.get(ring) else { return String::new() };
    let window_ns = capture.end_ns.saturating_sub(capture.begin_ns) as f64;
    let at = |share: f64| {
        let time_ns = capture.begin_ns + (share * window_ns) as u64;
        value_at(rows.points(column), time_ns)
    };
    let text = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), short);
    match scene.view.cursors {
        [None, None] => {
            let values = rows.points(column).map(|point| point.value).filter(|v| v.is_finite());
            let bounds = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                (low.min(value), high.max(value))
            });
            format!("  min {}  max {}", short(bounds.0), short(bounds.1))
        }
        [a, b] => {
            let (a, b) = (a.and_then(at), b.and_then(at));
            let difference = a.zip(b).map(|(a, b)| b - a);
            format!("  A {}  B {}  B−A {}", text(a), text(b), text(difference))
        }
    }
}

/// The times of the cursors, their difference, and how often that would be a second.
fn cursor_line(scene: &Scene<'_>, area: Rect, y: u16, buffer: &mut Buffer) {
    let settings = &scene.view.settings;
    let (before_s, window_s) = (settings.pre_ns as f64 * 1e-9, settings.window_ns as f64 * 1e-9);
    let at = |share: f64| share * window_s - before_s;
    let text = match scene.view.cursors.map(|cursor| cursor.map(at)) {
        [None, None] => return,
        [Some(a), Some(b)] => {
            let difference = b - a;
            let rate = match difference.abs() {
                0.0 => String::new(),
                apart => format!("  ({} Hz)", short(1.0 / apart)),
            };
            format!("A {}  B {}  B−A {}{rate}", time(a), time(b), time(difference))
        }
        [Some(a), None] => format!("A {}", time(a)),
        [None, Some(b)] => format!("B {}", time(b)),
    };
    line(buffer, area, y, &text, Style::new());
}

/// What has come, what is missing, and what the window lacks.
fn counts(scene: &Scene<'_>, area: Rect, y: u16, buffer: &mut Buffer) {
    let Counts { received, lost, out_of_order, early } = scene.counts;
    let mut text = format!("{received} messages, {lost} lost");
    if out_of_order > 0 {
        text += &format!(", {out_of_order} out of order, not shown");
    }
    if early > 0 {
        text += &format!(", {early} triggers too early");
    }
    if let Some(capture) = scene.capture {
        text += &match capture.lost() {
            0 => "; none in this window".to_owned(),
            missing => format!("; {missing} of them in this window (×)"),
        };
        if capture.overwritten {
            text += "; its beginning was overwritten";
        }
        if !capture.whole {
            text += "; it ends with the recording";
        }
    }
    let bad = lost > 0 || out_of_order > 0 || scene.capture.is_some_and(|it| it.overwritten);
    let style = if bad { Style::new().fg(Color::Red) } else { Style::new() };
    line(buffer, area, y, &text, style);
}

#[cfg(test)]
mod tests;
