//! Finds the pulses on the trigger line.

use ipc_types::LineEvent as LineEventKind;

/// How the trigger line is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// What a volume looks like.
    pub kind: LineKind,
    /// Whether the line is active below the threshold.
    pub active_low: bool,
    /// Voltage between idle and active (V).
    pub threshold_v: f64,
    /// Width of the band about the threshold within which the line keeps its state (V).
    pub hysteresis_v: f64,
    /// A level that lasts for a shorter time is a glitch (s).
    pub minimum_width_s: f64,
}

/// What a volume looks like on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineKind {
    /// The line becomes active for a moment with every volume.
    Pulse,
    /// The line changes its level with every volume.
    Toggle,
    /// The line is active for as long as the scanner measures.
    Gate,
}

impl Default for Line {
    /// The line of the thesis: it rests high, and is active below 2 V (appendix, `tg.s90 > 2.0`).
    fn default() -> Self {
        Self {
            kind: LineKind::Pulse,
            active_low: true,
            threshold_v: 2.0,
            hysteresis_v: 0.5,
            minimum_width_s: 0.5e-3,
        }
    }
}

impl Line {
    /// Height of a level above the threshold, on the active side (V).
    fn height(&self, volts: f64) -> f64 {
        let above = volts - self.threshold_v;
        if self.active_low { -above } else { above }
    }

    /// Whether a level is active or idle; `None` within the band, where the line keeps its state.
    pub fn state_of(&self, volts: f64) -> Option<bool> {
        let (height, band) = (self.height(volts), 0.5 * self.hysteresis_v);
        match height {
            height if height > band => Some(true),
            height if height < -band => Some(false),
            _ => None,
        }
    }
}

/// What happened on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineEvent {
    /// When the line crossed into its new state, interpolated between two samples (ns).
    pub at_ns: u64,
    /// What it was.
    pub kind: LineEventKind,
}

/// Longest time between two samples within which an edge is interpolated (ns): of a longer one
/// nobody knows when in it the line changed.
const INTERPOLATED_NS: u64 = 5_000_000;

/// State of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    /// No sample has told yet. An active first sample is no pulse: it may have begun earlier.
    Unknown,
    /// Active or idle, for longer than a glitch.
    Settled { active: bool },
    /// In another state since then, for no longer than a glitch.
    Changing { active: bool, since_ns: u64 },
}

/// Finds the pulses in the samples of a line, one sample at a time.
#[derive(Clone, Copy, Debug)]
pub struct PulseDetector {
    line: Line,
    level: Level,
    /// Time (ns), and height above the threshold on the active side (V), of the last sample.
    previous: Option<(u64, f64)>,
    pulses: u64,
    glitches: u64,
}

impl PulseDetector {
    /// A detector that has seen nothing.
    pub const fn new(line: Line) -> Self {
        Self { line, level: Level::Unknown, previous: None, pulses: 0, glitches: 0 }
    }

    /// Takes the sample of `time_ns`; returns a pulse once it has lasted for the least width,
    /// and a glitch once it is over. A value that is not finite is ignored.
    pub fn observe(&mut self, time_ns: u64, volts: f64) -> Option<LineEvent> {
        if !volts.is_finite() {
            return None;
        }
        let (height, seen) = (self.line.height(volts), self.line.state_of(volts));
        let previous = self.previous.replace((time_ns, height));
        let band = 0.5 * self.line.hysteresis_v;
        match (self.level, seen) {
            (Level::Unknown, Some(active)) => self.level = Level::Settled { active },
            (Level::Settled { active }, Some(seen)) if seen != active => {
                let crossed = if seen { band } else { -band };
                let since_ns = crossing(previous, (time_ns, height), crossed);
                self.level = Level::Changing { active: seen, since_ns };
                return self.settle(time_ns);
            }
            (Level::Changing { active, since_ns }, Some(seen)) if seen != active => {
                self.glitches += 1;
                self.level = Level::Settled { active: seen };
                return Some(LineEvent { at_ns: since_ns, kind: LineEventKind::Glitch });
            }
            (Level::Changing { .. }, _) => return self.settle(time_ns),
            _ => {}
        }
        None
    }

    /// Settles a change that has lasted for long enough.
    fn settle(&mut self, time_ns: u64) -> Option<LineEvent> {
        let Level::Changing { active, since_ns } = self.level else { return None };
        if (time_ns.saturating_sub(since_ns) as f64) < 1e9 * self.line.minimum_width_s {
            return None;
        }
        self.level = Level::Settled { active };
        let kind = match self.line.kind {
            LineKind::Pulse if !active => return None,
            LineKind::Gate if !active => LineEventKind::GateEnd,
            LineKind::Pulse | LineKind::Toggle | LineKind::Gate => LineEventKind::Pulse,
        };
        self.pulses += u64::from(kind == LineEventKind::Pulse);
        Some(LineEvent { at_ns: since_ns, kind })
    }

    /// Number of pulses so far.
    pub const fn pulses(&self) -> u64 {
        self.pulses
    }

    /// Number of levels so far that were too short.
    pub const fn glitches(&self) -> u64 {
        self.glitches
    }
}

/// When a line that is straight between two samples crosses a height (ns).
fn crossing(previous: Option<(u64, f64)>, (time_ns, height): (u64, f64), crossed: f64) -> u64 {
    let Some((before_ns, before)) = previous else { return time_ns };
    let share = (crossed - before) / (height - before);
    if !(0.0..=1.0).contains(&share) || time_ns.saturating_sub(before_ns) > INTERPOLATED_NS {
        return time_ns;
    }
    before_ns + (share * time_ns.saturating_sub(before_ns) as f64).round() as u64
}
