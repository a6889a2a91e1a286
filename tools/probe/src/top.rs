//! `top`.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::io::{IsTerminal, Write};

use ipc_types::{LoopTiming, Message, Process, Profile, TOPICS, Topic};
use runtime::clock::{MILLISECOND_NS, SECOND_NS, now_ns};
use runtime::{Losses, RigName};

use crate::args::TopArgs;
use crate::attach::{self, Attached};
use crate::meter::Meter;
use crate::model_rows::ModelRows;
use crate::stream::{Arrived, Progress, Source, Stream};

/// Polling period; part of the latency shown (ns).
const PERIOD_NS: u64 = MILLISECOND_NS;
/// Age at which a loop counts as silent: it publishes its timing every second (ns).
const SILENT_NS: u64 = 3 * SECOND_NS;
/// Number of screens over which a rate is averaged, so that a topic of 1 Hz has one.
const AVERAGED_SCREENS: usize = 5;

/// The state of `top`.
struct State {
    meters: Vec<Meter>,
    /// messages and duration (s) of the last pictures, by topic
    counts: Vec<VecDeque<(u64, f64)>>,
    timings: Vec<LoopTiming>,
    model: ModelRows,
}

impl State {
    fn new(streams: &[Stream]) -> anyhow::Result<Self> {
        Ok(Self {
            meters: streams.iter().map(Meter::new).collect::<Result<Vec<_>, _>>()?,
            counts: vec![VecDeque::new(); streams.len()],
            timings: Vec::new(),
            model: ModelRows::default(),
        })
    }

    /// Takes a message of a topic; those from before `since_ns` are history.
    fn observe(&mut self, topic: &Topic, message: &Arrived<'_>, since_ns: u64) {
        if topic.type_name == LoopTiming::TYPE_NAME
            && let Some(timing) = LoopTiming::from_bytes(message.bytes)
        {
            // The last timing of a process is shown even if it is history.
            match self.timings.iter_mut().find(|known| known.source == timing.source) {
                Some(known) => *known = timing,
                None => self.timings.push(timing),
            }
            self.timings.sort_by_key(|timing| timing.source);
        }
        self.model.observe(topic, message.bytes);
        if message.sent.time_ns >= since_ns
            && let Some(meter) = self.meters.get_mut(message.stream)
        {
            meter.observe(message);
        }
    }

    /// Ends the interval of a screen.
    fn count(&mut self, seconds: f64) {
        for (meter, counts) in self.meters.iter().zip(&mut self.counts) {
            counts.push_back((meter.count, seconds));
            if counts.len() > AVERAGED_SCREENS {
                counts.pop_front();
            }
        }
    }

    fn rate(&self, index: usize) -> f64 {
        let (messages, seconds) = self.counts[index]
            .iter()
            .fold((0, 0.0), |(m, s), (count, duration)| (m + count, s + duration));
        if seconds > 0.0 { messages as f64 / seconds } else { 0.0 }
    }

    /// Rate of the samples (Hz), by acquisition's loop.
    fn sample_rate_hz(&self) -> Option<f64> {
        let own = |timing: &&LoopTiming| timing.source == Process::Acquisition.code();
        let timing = self.timings.iter().find(own)?;
        (timing.period_ns > 0).then(|| 1e9 / timing.period_ns as f64)
    }

    fn reset(&mut self) {
        self.meters.iter_mut().for_each(Meter::reset);
        self.model.reset();
    }

    /// Renders a screen; `feeds` gives name, messages received and lost of each topic. Sentences
    /// are wrapped at `width` columns, tables never.
    fn render(&self, rig: &str, now_ns: u64, feeds: &[(&str, u64, u64)], width: usize) -> String {
        let words = |text: String| {
            textwrap::fill(&text, textwrap::Options::new(width).subsequent_indent("    "))
        };
        let mut text = String::new();
        let mut line = |content: String| {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{}", content.trim_end());
        };
        let profile = self.timings.first().and_then(|timing| Profile::from_code(timing.profile));
        line(format!(
            "rig {rig}{}",
            profile.map_or_else(String::new, |profile| format!(", {profile}"))
        ));
        line(format!(
            "{:<11} {:>6} {:>6}  {:>24}  {:>19}  grants",
            "loop", "Hz", "missed", "late µs: p50   p99   max", "run µs: p50 p99 max"
        ));
        for timing in &self.timings {
            line(loop_row(timing, now_ns));
        }
        for timing in &self.timings {
            let losses = Losses::told_by(timing);
            if !losses.is_empty() {
                let process = Process::from_code(timing.source).map_or("?", Process::text);
                line(words(format!("{process}: since its start {losses}")));
            }
        }
        line(String::new());
        let (table, sentences) = self.model.render(self.sample_rate_hz(), now_ns);
        if !table.is_empty() {
            table.into_iter().for_each(&mut line);
            sentences.into_iter().map(words).for_each(&mut line);
            line(String::new());
        }
        line(format!(
            "{:<21} {:>8} {:>6} {:>11}  {:>12} {:>7} {:>7}",
            "topic", "rate Hz", "lost", "received", "late µs: p50", "p99", "max"
        ));
        let mut silent = Vec::new();
        for (index, (name, received, lost)) in feeds.iter().enumerate() {
            let meter = &self.meters[index];
            if *received == 0 {
                silent.push(*name);
                continue;
            }
            let times = if meter.latency.count() == 0 {
                format!("{:>12} {:>7} {:>7}", "-", "-", "-")
            } else {
                let [p50, p99, _, max] = meter.latency.microseconds();
                format!("{p50:>12.0} {p99:>7.0} {max:>7.0}")
            };
            line(format!("{name:<21} {:>8.1} {lost:>6} {received:>11}  {times}", self.rate(index)));
        }
        if !silent.is_empty() {
            line(words(format!("no message yet: {}", silent.join(", "))));
        }
        let period_ms = PERIOD_NS / MILLISECOND_NS;
        line(format!(
            "late (topics): from publishing to this probe, which polls every {period_ms} ms"
        ));
        text
    }
}

/// The row of a loop.
fn loop_row(timing: &LoopTiming, now_ns: u64) -> String {
    let us = |ns: u64| format!("{:.0}", ns as f64 * 1e-3);
    let process = Process::from_code(timing.source).map_or("?", Process::text);
    let [late, runs] = [timing.wake_late_ns, timing.execution_ns];
    let silent = now_ns.saturating_sub(timing.time_ns) > SILENT_NS;
    format!(
        "{process:<11} {:>6.0} {:>6}  {:>12} {:>5} {:>5}  {:>9} {:>4} {:>4}  {}",
        1e9 / timing.period_ns.max(1) as f64,
        timing.missed_periods,
        us(late[0]),
        us(late[1]),
        us(late[3]),
        us(runs[0]),
        us(runs[1]),
        us(runs[3]),
        match (silent, timing.memory_locked, timing.kept_awake) {
            (true, ..) => "SILENT",
            (false, 1, 1) => "both",
            (false, 1, _) => "lock",
            (false, _, 1) => "awake",
            (false, ..) => "-",
        },
    )
}

pub(crate) fn top(args: &TopArgs, rig_name: &RigName, out: &mut dyn Write) -> anyhow::Result<i32> {
    let topics: Vec<_> = TOPICS.iter().collect();
    let mut rig = Attached::new(rig_name, &topics, PERIOD_NS)?;
    let mut state = State::new(rig.streams())?;
    let terminal = std::io::stdout().is_terminal();
    let mut left = args.count.unwrap_or(if terminal { u64::MAX } else { 1 });
    let mut screen = Screen::begin(terminal, out)?;
    let since_ns = rig.since_ns();
    let mut begun_ns = since_ns;
    let mut stopping = false;
    while left > 0 && !stopping {
        let end_ns = begun_ns + attach::ns(args.seconds);
        while now_ns() < end_ns && !stopping {
            let progress = rig.read(end_ns, &mut |message| {
                state.observe(topics[message.stream], message, since_ns);
            })?;
            stopping = progress == Progress::Ended;
        }
        let now = now_ns();
        state.count((now - begun_ns) as f64 * 1e-9);
        let feeds: Vec<_> = rig
            .streams()
            .iter()
            .map(|stream| (stream.name.as_str(), stream.received(), stream.lost()))
            .collect();
        let width = screen.size().map_or(usize::MAX, |(width, _)| width);
        screen.show(state.render(rig_name.as_str(), now, &feeds, width))?;
        state.reset();
        begun_ns = now;
        left -= 1;
    }
    Ok(recorder::DONE)
}

/// The output: redrawn in place on a terminal, appended in a pipe.
struct Screen<'a> {
    out: &'a mut dyn Write,
    terminal: bool,
    last: String,
}

impl<'a> Screen<'a> {
    fn begin(terminal: bool, out: &'a mut dyn Write) -> std::io::Result<Self> {
        if terminal {
            // The alternate screen, without cursor; the old contents come back at the end.
            write!(out, "\x1b[?1049h\x1b[?25l")?;
        }
        Ok(Self { out, terminal, last: String::new() })
    }

    /// Columns and lines; `None` unless it is a terminal.
    fn size(&self) -> Option<(usize, usize)> {
        let size = || {
            terminal_size::terminal_size().map(|(width, height)| (width.0.into(), height.0.into()))
        };
        self.terminal.then(|| size().unwrap_or((80, 24)))
    }

    fn show(&mut self, screen: String) -> std::io::Result<()> {
        if let Some((width, height)) = self.size() {
            write!(self.out, "\x1b[H{}\x1b[J", fit(&screen, width, height))?;
        } else {
            self.out.write_all(screen.as_bytes())?;
        }
        self.out.flush()?;
        self.last = screen;
        Ok(())
    }
}

impl Drop for Screen<'_> {
    fn drop(&mut self) {
        if self.terminal {
            // A closed output needs no repair.
            let _ = write!(self.out, "\x1b[?25h\x1b[?1049l{}", self.last);
            let _ = self.out.flush();
        }
    }
}

/// Fits a screen to a terminal: cuts long lines, and replaces the lines that do not fit by a
/// note.
fn fit(screen: &str, width: usize, height: usize) -> String {
    let total = screen.lines().count();
    let shown = if total > height { height.saturating_sub(1) } else { total };
    let mut lines: Vec<String> =
        screen.lines().take(shown).map(|line| line.chars().take(width).collect()).collect();
    if total > height {
        let more = format!("... {} more lines: make the window taller", total - shown);
        lines.push(more.chars().take(width).collect());
    }
    lines.join("\x1b[K\r\n") + "\x1b[K"
}

#[cfg(test)]
mod tests {
    use ipc_types::{COMMAND, MotorCommand};

    use super::*;
    use crate::stream::tests::arrived;

    #[test]
    fn rates_losses_and_timing_are_in_the_picture() {
        let mut streams: Vec<_> = TOPICS.iter().map(Stream::of_topic).collect();
        let mut state = State::new(&streams).unwrap();
        let index_of = |name: &str| TOPICS.iter().position(|topic| topic.name == name).unwrap();
        let command = index_of(COMMAND.topic.name);
        for cycle in 0..500 {
            let mut message = MotorCommand::default();
            message.stamp(1, 2, cycle, 1_000_000 * cycle);
            let received_ns = 1_000_000 * cycle + 40_000;
            let message = arrived(&mut streams, command, message.as_bytes(), received_ns);
            state.observe(&TOPICS[command], &message, 0);
        }
        let mut timing = LoopTiming {
            period_ns: 2_000_000,
            missed_periods: 13,
            lost: 7,
            wake_late_ns: [4_000, 9_000, 21_000, 77_000],
            memory_locked: 1,
            kept_awake: 1,
            source: Process::Control.code(),
            ..LoopTiming::default()
        };
        timing.stamp(1, 2, 0, 900_000_000);
        let index = index_of("timing/control");
        let message = arrived(&mut streams, index, timing.as_bytes(), 900_000_000);
        state.observe(&TOPICS[index], &message, 0);
        state.count(1.0);
        let feeds: Vec<_> = TOPICS
            .iter()
            .map(|topic| match topic.name {
                "command" => (topic.name, 500, 3),
                "timing/control" => (topic.name, 1, 0),
                _ => (topic.name, 0, 0),
            })
            .collect();
        let words = |screen: &str, name: &str| -> Vec<String> {
            let line = screen.lines().find(|line| line.starts_with(name)).unwrap();
            line.split_whitespace().map(str::to_owned).collect()
        };
        let screen = state.render("demo", 1_000_000_000, &feeds, usize::MAX);
        assert_eq!(words(&screen, "command "), ["command", "500.0", "3", "500", "40", "40", "40"]);
        assert_eq!(words(&screen, "control ")[..6], ["control", "500", "13", "4", "9", "77"]);
        assert!(screen.contains("no message yet: sample, token"), "{screen}");
        assert!(
            screen.contains("\ncontrol: since its start 7 messages lost on the way to it\n"),
            "{screen}"
        );
        assert!(
            screen.starts_with("rig demo, realtime\n") && !screen.contains("SILENT"),
            "{screen}"
        );
        let narrow = state.render("demo", 1_000_000_000, &feeds, 80);
        assert_eq!(
            narrow.lines().find(|line| line.chars().count() > 80),
            None,
            "a terminal has 80 columns"
        );
        let told = |screen: &str| screen.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(told(&narrow), told(&screen), "and what does not fit stands in the next line");
        // a rate over several pictures, and a loop that fell silent
        state.reset();
        state.count(1.0);
        let screen = state.render("demo", 9_000_000_000, &feeds, usize::MAX);
        assert_eq!(words(&screen, "command ")[1..], ["250.0", "3", "500", "-", "-", "-"]);
        assert!(words(&screen, "control ").contains(&"SILENT".to_owned()));
    }

    #[test]
    fn a_picture_fits_its_terminal() {
        let screen = "one\ntwo µµµ\nthree\n";
        assert_eq!(fit(screen, 5, 3), "one\x1b[K\r\ntwo µ\x1b[K\r\nthree\x1b[K");
        assert_eq!(
            fit(screen, 80, 2),
            "one\x1b[K\r\n... 2 more lines: make the window taller\x1b[K"
        );
    }
}
