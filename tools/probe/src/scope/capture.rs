//! Captures windows round a trigger: takes samples and the time, returns windows.

use crate::scope::ring::{Ring, Rows};
use crate::scope::trigger::{Condition, Trigger};

/// How long a window waits for the topics that are behind the one that triggered (ns): a slow topic
/// may have no sample at the end of the window.
const SETTLE_NS: u64 = 500_000_000;

/// When windows are captured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Mode {
    /// At each trigger; without one for a while, all the same
    Auto,
    /// At each trigger
    Normal,
    /// At the next trigger, and then no more
    Single,
    /// The newest samples all the time, without trigger
    Roll,
}

impl Mode {
    /// Its name on the screen.
    pub(crate) const fn text(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Normal => "normal",
            Self::Single => "single",
            Self::Roll => "roll",
        }
    }

    /// The next one.
    pub(crate) const fn next(self) -> Self {
        match self {
            Self::Auto => Self::Normal,
            Self::Normal => Self::Single,
            Self::Single => Self::Roll,
            Self::Roll => Self::Auto,
        }
    }
}

/// What is captured (times in ns).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Settings {
    pub(crate) mode: Mode,
    /// Length of a window.
    pub(crate) window_ns: u64,
    /// The part of it before the trigger.
    pub(crate) pre_ns: u64,
    /// Time without a trigger after which `auto` captures all the same.
    pub(crate) auto_ns: u64,
    /// Ring and column of the channel that triggers.
    pub(crate) channel: (usize, usize),
    pub(crate) condition: Condition,
    /// In the unit of that channel.
    pub(crate) hysteresis: f64,
}

impl Settings {
    fn post_ns(&self) -> u64 {
        self.window_ns.saturating_sub(self.pre_ns)
    }
}

/// A window.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Capture {
    /// Time of the sample that triggered, or the place where it would be (ns).
    pub(crate) zero_ns: u64,
    pub(crate) triggered: bool,
    /// Begin and end of the window (ns).
    pub(crate) begin_ns: u64,
    pub(crate) end_ns: u64,
    /// By ring.
    pub(crate) rows: Vec<Rows>,
    /// Whether the samples came to the end of the window.
    pub(crate) whole: bool,
    /// Whether the ring was too small for it: its beginning is missing.
    pub(crate) overwritten: bool,
}

impl Capture {
    /// Messages that are missing within it.
    pub(crate) fn lost(&self) -> u64 {
        self.rows.iter().map(Rows::lost).sum()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Waits for the trigger, since then.
    Armed(Option<u64>),
    /// Triggered at this time; the window is not full.
    Filling(u64),
    /// Has captured its one window.
    Done,
}

/// Holds the newest samples, and captures.
#[derive(Clone, Debug)]
pub(crate) struct Capturer {
    settings: Settings,
    trigger: Trigger,
    rings: Vec<Ring>,
    state: State,
    known_ns: u64,
    early: u64,
}

impl Capturer {
    /// For topics with that many channels each; a ring for each of `rows` rows.
    pub(crate) fn new(settings: Settings, widths: &[usize], rows: usize) -> Self {
        Self {
            trigger: Trigger::new(settings.condition, settings.hysteresis),
            settings,
            rings: widths.iter().map(|width| Ring::new(rows, *width)).collect(),
            state: State::Armed(None),
            known_ns: 0,
            early: 0,
        }
    }

    /// Changes what is captured, and waits for a trigger anew. The samples stay.
    pub(crate) fn set(&mut self, settings: Settings) {
        let same = |of: &Settings| (of.channel, of.condition, of.hysteresis);
        if same(&settings) != same(&self.settings) {
            self.trigger = Trigger::new(settings.condition, settings.hysteresis);
        }
        self.settings = settings;
        self.rearm();
    }

    /// Waits for the next trigger.
    pub(crate) fn rearm(&mut self) {
        self.state = State::Armed(None);
    }

    /// Takes a row of one topic (times in ns, the same clock for all).
    pub(crate) fn take(&mut self, ring: usize, time_ns: u64, gap: Option<u64>, values: &[f64]) {
        let begin_ns = time_ns.saturating_sub(self.settings.pre_ns);
        let Some(own) = self.rings.get_mut(ring) else { return };
        let Some(after_gap) = own.push(time_ns, gap, values) else { return };
        let reaches = own.reaches(begin_ns);
        if ring != self.settings.channel.0 {
            return;
        }
        let value = values.get(self.settings.channel.1).copied().unwrap_or(f64::NAN);
        let fires = self.trigger.see(value, after_gap);
        if !fires || !self.is_waiting() || self.settings.mode == Mode::Roll {
            return;
        }
        // As on any oscilloscope: there is no window without the time before its trigger.
        if reaches {
            self.state = State::Filling(time_ns);
        } else {
            self.early += 1;
        }
    }

    /// Says that every sample up to this time is here (ns); a window that is full then.
    pub(crate) fn advance(&mut self, known_ns: u64) -> Option<Capture> {
        self.known_ns = self.known_ns.max(known_ns);
        let known_ns = self.known_ns;
        match self.state {
            State::Armed(since) => {
                let since_ns = since.unwrap_or(known_ns);
                self.state = State::Armed(Some(since_ns));
                let waited_ns = known_ns - since_ns.min(known_ns);
                if self.settings.mode != Mode::Auto || waited_ns < self.settings.auto_ns {
                    return None;
                }
                self.state = State::Armed(Some(known_ns));
                Some(self.newest())
            }
            State::Filling(at_ns) => {
                let end_ns = at_ns.saturating_add(self.settings.post_ns());
                let there = |ring: &Ring| ring.newest_ns().is_some_and(|newest| newest >= end_ns);
                let settled = known_ns >= end_ns.saturating_add(SETTLE_NS);
                if !settled && !self.rings.iter().all(there) {
                    return None;
                }
                self.state = match self.settings.mode {
                    Mode::Single => State::Done,
                    _ => State::Armed(Some(known_ns)),
                };
                Some(self.window(at_ns, true, true))
            }
            State::Done => None,
        }
    }

    /// Says that there will be no more samples; a window that has begun, as far as it came.
    pub(crate) fn finish(&mut self) -> Option<Capture> {
        let State::Filling(at_ns) = self.state else { return None };
        self.state = State::Done;
        let end_ns = at_ns.saturating_add(self.settings.post_ns());
        let there = |ring: &Ring| ring.newest_ns().is_some_and(|newest| newest >= end_ns);
        let whole = self.rings.iter().any(there);
        Some(self.window(at_ns, true, whole))
    }

    /// The window that ends now, without a trigger.
    pub(crate) fn newest(&self) -> Capture {
        let zero_ns = self.known_ns.saturating_sub(self.settings.post_ns());
        self.window(zero_ns, false, true)
    }

    /// A window once more, as the settings now are, from the samples that are still there.
    pub(crate) fn again(&self, capture: &Capture) -> Capture {
        self.window(capture.zero_ns, capture.triggered, capture.whole)
    }

    fn window(&self, zero_ns: u64, triggered: bool, whole: bool) -> Capture {
        let begin_ns = zero_ns.saturating_sub(self.settings.pre_ns);
        let end_ns = zero_ns.saturating_add(self.settings.post_ns());
        Capture {
            zero_ns,
            triggered,
            begin_ns,
            end_ns,
            rows: self.rings.iter().map(|ring| ring.between(begin_ns, end_ns)).collect(),
            whole,
            overwritten: self.rings.iter().any(|ring| ring.has_overwritten(begin_ns)),
        }
    }

    /// Whether it waits for a trigger.
    pub(crate) const fn is_waiting(&self) -> bool {
        matches!(self.state, State::Armed(_))
    }

    /// What it does, for the screen.
    pub(crate) const fn doing(&self) -> &'static str {
        match (self.settings.mode, self.state) {
            (Mode::Roll, _) => "rolling",
            (_, State::Armed(_)) => "waiting for the trigger",
            (_, State::Filling(_)) => "triggered",
            (_, State::Done) => "captured",
        }
    }

    /// Triggers that came too early: the part of the window before them was not there.
    pub(crate) const fn early(&self) -> u64 {
        self.early
    }

    /// Rows that came with a time that was not later than the one before, and are not shown.
    pub(crate) fn out_of_order(&self) -> u64 {
        self.rings.iter().map(Ring::out_of_order).sum()
    }
}

#[cfg(test)]
mod tests;
