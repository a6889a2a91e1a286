//! Writes a window to a file: a figure, a table, or its messages.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use anyhow::{Context, bail};
use recording::mcap_edit;
use recording::mcap_read::Recording;
use recording::mcap_write::{Start, Writer, key};
use report::{Colour, Figure, Panels};
use rig::RigFile;
use runtime::RigName;
use runtime::clock::{ClockPair, SECOND_NS};

use crate::scope::capture::{Capture, Settings};
use crate::scope::channel::Channel;
use crate::scope::ring::Rows;

/// Colours of the channels of a figure, in turn.
const COLOURS: [Colour; 7] = [
    Colour::Blue,
    Colour::Vermillion,
    Colour::Green,
    Colour::Purple,
    Colour::Orange,
    Colour::Sky,
    Colour::Black,
];
/// How long messages are kept beyond the length of a window (ns): until its end is known.
const KEPT_BEYOND_NS: u64 = 2 * SECOND_NS;

/// What a file is, by its ending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Svg,
    Csv,
    Mcap,
}

/// A new file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Target<'a> {
    pub(crate) path: &'a Path,
    pub(crate) kind: Kind,
}

impl<'a> Target<'a> {
    /// Checks a path before anything is waited for.
    ///
    /// # Errors
    /// If its ending is not known, or there is something of that name.
    pub(crate) fn new(path: &'a Path) -> anyhow::Result<Self> {
        let kind = match path.extension().and_then(|ending| ending.to_str()) {
            Some("svg") => Kind::Svg,
            Some("csv") => Kind::Csv,
            Some("mcap") => Kind::Mcap,
            _ => bail!("--out {}: expected a file .svg, .csv or .mcap", path.display()),
        };
        if path.symlink_metadata().is_ok() {
            bail!("{}: it is there already; files are never overwritten", path.display());
        }
        Ok(Self { path, kind })
    }

    /// Writes the file whole or not at all.
    pub(crate) fn write(&self, contents: impl AsRef<[u8]>) -> anyhow::Result<()> {
        files::create_new(self.path, contents)
            .with_context(|| format!("{}: cannot create", self.path.display()))
    }

    /// Writes the messages of a window that came from a running rig.
    pub(crate) fn write_messages(
        &self,
        capture: &Capture,
        kept: Kept,
        rig_name: &RigName,
        rig: Option<&RigFile>,
    ) -> anyhow::Result<()> {
        let clock = ClockPair::measure();
        let start = Start { realtime_offset_ns: clock.offset_ns(), ..Start::default() };
        let mut start = start.with(key::RIG_NAME, rig_name.as_str());
        if let Some(rig) = rig {
            start = start.with(key::RIG, &rig.name).with(key::RIG_FILE, rig.text());
        }
        let mut writer = Writer::create(self.path, &start, clock.monotonic_ns)?;
        let written = kept
            .within(capture)
            .try_for_each(|(topic, bytes)| writer.write(topic, &bytes))
            .and_then(|()| writer.finish(&[]).map(drop));
        if written.is_err() {
            // A part of a window would only mislead. What cannot be removed says so itself: it has
            // no end.
            let _removed = std::fs::remove_file(self.path);
        }
        Ok(written?)
    }

    /// Copies all messages that a recording has of a window.
    pub(crate) fn copy_messages(&self, capture: &Capture, file: &Path) -> anyhow::Result<()> {
        let recording = Recording::open(file)?;
        let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
        let how = BTreeMap::from([
            ("edit".to_owned(), "scope".to_owned()),
            ("sources".to_owned(), name.into_owned()),
        ]);
        let (from_ns, until_ns) = (capture.begin_ns, capture.end_ns.saturating_add(1));
        mcap_edit::rewrite(&[&recording], Some(from_ns), Some(until_ns), &how, self.path)?;
        Ok(())
    }
}

/// The newest messages, for a window that is written as they came.
#[derive(Debug)]
pub(crate) struct Kept {
    longest_ns: u64,
    /// time (ns), topic (index in the table of topics), bytes
    messages: VecDeque<(u64, usize, Vec<u8>)>,
}

impl Kept {
    /// For windows of that length.
    pub(crate) const fn new(window_ns: u64) -> Self {
        Self { longest_ns: window_ns.saturating_add(KEPT_BEYOND_NS), messages: VecDeque::new() }
    }

    /// Keeps a message, and lets go of those that no window needs any more.
    pub(crate) fn keep(&mut self, time_ns: u64, topic: usize, bytes: &[u8]) {
        self.messages.push_back((time_ns, topic, bytes.to_vec()));
        let old =
            |(at_ns, ..): &(u64, usize, Vec<u8>)| at_ns.saturating_add(self.longest_ns) < time_ns;
        while self.messages.front().is_some_and(old) {
            self.messages.pop_front();
        }
    }

    /// The messages of a window in the order of time: topic and bytes.
    fn within(self, capture: &Capture) -> impl Iterator<Item = (usize, Vec<u8>)> {
        let window = capture.begin_ns..=capture.end_ns;
        let mut messages: Vec<_> =
            self.messages.into_iter().filter(|(at_ns, ..)| window.contains(at_ns)).collect();
        messages.sort_by_key(|(at_ns, ..)| *at_ns);
        messages.into_iter().map(|(_, topic, bytes)| (topic, bytes))
    }
}

/// A window with what is needed to describe it.
pub(crate) struct Window<'a> {
    /// The rig or the recording, in words.
    pub(crate) place: &'a str,
    pub(crate) capture: &'a Capture,
    pub(crate) channels: &'a [Channel],
    pub(crate) settings: &'a Settings,
    /// In words.
    pub(crate) trigger: &'a str,
}

impl Window<'_> {
    /// Seconds from the trigger.
    fn seconds(&self, time_ns: u64) -> f64 {
        time_ns.wrapping_sub(self.capture.zero_ns) as i64 as f64 * 1e-9
    }

    fn rows(&self, channel: &Channel) -> Option<&Rows> {
        self.capture.rows.get(channel.place.0)
    }

    /// A figure, with a panel for each unit.
    pub(crate) fn svg(&self) -> anyhow::Result<String> {
        let capture = self.capture;
        let mut title = match capture.triggered {
            true => format!("{}: {}", self.place, self.trigger),
            false => format!("{}: without a trigger", self.place),
        };
        let lost = capture.lost();
        if lost > 0 {
            title += &format!("; {lost} messages are missing");
        }
        let mut units: Vec<&str> = Vec::new();
        for channel in self.channels {
            if !units.contains(&channel.unit.as_str()) {
                units.push(&channel.unit);
            }
        }
        let mut panels = Panels::new(title.clone());
        for (at, unit) in units.into_iter().enumerate() {
            let title = if at == 0 { title.as_str() } else { "" };
            panels = panels.panel(self.panel(title, unit));
        }
        panels.render_svg()
    }

    fn panel(&self, title: &str, unit: &str) -> Figure {
        let capture = self.capture;
        let label = if unit.is_empty() { "value" } else { unit };
        let (begin_s, end_s) = (self.seconds(capture.begin_ns), self.seconds(capture.end_ns));
        let mut figure = Figure::new(title, "time from the trigger / s", label)
            .size(900, 300)
            .x_range(begin_s, end_s);
        let own = self.channels.iter().zip(COLOURS.iter().cycle());
        for (channel, colour) in own.filter(|(channel, _)| channel.unit == unit) {
            let Some(rows) = self.rows(channel) else { continue };
            let (mut x, mut y) = (Vec::new(), Vec::new());
            for point in rows.points(channel.place.1) {
                let time_s = self.seconds(point.time_ns);
                if point.gap.is_some() {
                    // Breaks the line.
                    x.push(time_s);
                    y.push(f64::NAN);
                }
                x.push(time_s);
                y.push(point.value);
            }
            figure = figure.line(*colour, channel.name.clone(), &x, &y);
            if channel.place == self.settings.channel && capture.triggered {
                for level in self.settings.condition.levels() {
                    figure = figure.horizontal(Colour::Grey, "level of the trigger", level);
                }
            }
        }
        let zero = if capture.triggered { "trigger" } else { "" };
        figure.vertical(Colour::Grey, zero, 0.0)
    }

    /// A table: time (s, from the trigger), the channels, and how many messages are missing before
    /// each row. Topics have rows of their own, unless their times are the same.
    pub(crate) fn csv(&self) -> anyhow::Result<Vec<u8>> {
        let mut table = csv::Writer::from_writer(Vec::new());
        let name = |channel: &Channel| match channel.unit.as_str() {
            "" => channel.name.clone(),
            unit => format!("{} [{unit}]", channel.name),
        };
        let mut header = vec!["t_s".to_owned()];
        header.extend(self.channels.iter().map(name));
        header.push("lost_before".to_owned());
        table.write_record(&header)?;
        let rings = &self.capture.rows;
        let mut next = vec![0; rings.len()];
        let time = |next: &[usize]| {
            let times = rings.iter().zip(next).filter_map(|(rows, at)| Some(rows.row(*at)?.0));
            times.min()
        };
        while let Some(time_ns) = time(next.as_slice()) {
            let mut cells = vec![String::new(); self.channels.len()];
            let mut lost = 0;
            for (ring, (rows, at)) in rings.iter().zip(&mut next).enumerate() {
                let Some((_, gap, values)) = rows.row(*at).filter(|row| row.0 == time_ns) else {
                    continue;
                };
                *at += 1;
                lost += gap.unwrap_or(0);
                let values: Vec<f64> = values.collect();
                for (channel, cell) in self.channels.iter().zip(&mut cells) {
                    if channel.place.0 == ring
                        && let Some(value) = values.get(channel.place.1)
                    {
                        *cell = value.to_string();
                    }
                }
            }
            let time = std::iter::once(format!("{:.9}", self.seconds(time_ns)));
            table.write_record(time.chain(cells).chain([lost.to_string()]))?;
        }
        table.flush()?;
        Ok(table.get_ref().clone())
    }
}

#[cfg(test)]
mod tests;
