//! What the screen shows, and what the keys change.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use crate::scope::args::{AUTO_NS, DIVISIONS};
use crate::scope::capture::{Capture, Mode, Settings};
use crate::scope::channel::Channel;
use crate::scope::numbers::{larger, smaller, step_at_least};

/// Divisions of the screen along values.
pub(crate) const VERTICAL: f64 = 8.0;
/// Shortest and longest division along time (s).
const TIME_BASE: (f64, f64) = (1e-4, 10.0);

/// The keys, for the screen.
pub(crate) const KEYS: [(&str, &str); 14] = [
    ("space", "stop and go on; of a recording, the next window"),
    ("m", "mode: auto, normal, single, roll"),
    ("f", "a window now, without trigger (running rig)"),
    ("e", "trigger: rising, falling, above, below; or enters, leaves"),
    ("+ -", "level of the trigger"),
    ("g", "trigger on the channel that is selected"),
    ("p P", "less, more of the window before the trigger"),
    ("t T", "shorter, longer time base"),
    ("tab", "select the next channel"),
    ("v V", "finer, coarser scale of that channel"),
    ("up down", "shift that channel"),
    ("a", "scale it by itself again"),
    ("c", "cursor A, cursor B, none; left and right move it, shift faster"),
    ("q", "end"),
];

/// How a channel is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    /// In its unit.
    pub(crate) per_division: f64,
    /// Value in the middle of the screen.
    pub(crate) centre: f64,
}

impl Scale {
    /// The scale that shows values from `low` to `high`.
    fn of(low: f64, high: f64) -> Self {
        // A constant is shown with the zero.
        let (low, high) = if low < high { (low, high) } else { (low.min(0.0), high.max(0.0)) };
        let span = high - low;
        if span <= 0.0 {
            return Self { per_division: 1.0, centre: 0.0 };
        }
        let per_division = step_at_least(span / (VERTICAL - 1.0));
        let centre = ((low + span / 2.0) / per_division).round() * per_division;
        Self { per_division, centre }
    }

    /// Whether it shows these values, and large enough.
    fn suits(&self, low: f64, high: f64) -> bool {
        let half = VERTICAL / 2.0 * self.per_division;
        low >= self.centre - half
            && high <= self.centre + half
            && (high - low >= 2.0 * self.per_division || low == high)
    }
}

/// A channel on the screen.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    pub(crate) channel: Channel,
    pub(crate) scale: Scale,
    /// Whether the scale follows the values.
    automatic: bool,
    scaled: bool,
}

/// What is to be done after a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Action {
    Nothing,
    /// [`View::settings`] changed.
    Set,
    /// Captures anew, or further.
    Run,
    /// Captures now, without a trigger.
    Force,
    Quit,
}

/// What the screen shows.
#[derive(Clone, Debug)]
pub(crate) struct View {
    pub(crate) channels: Vec<Shown>,
    pub(crate) selected: usize,
    pub(crate) settings: Settings,
    /// Places of the cursors: shares of the window, from its beginning.
    pub(crate) cursors: [Option<f64>; 2],
    /// The cursor that the keys move.
    pub(crate) moved: Option<usize>,
    pub(crate) running: bool,
    pub(crate) help: bool,
    recorded: bool,
}

impl View {
    pub(crate) fn new(channels: Vec<Channel>, settings: Settings, recorded: bool) -> Self {
        let shown = |channel| Shown {
            channel,
            scale: Scale { per_division: 1.0, centre: 0.0 },
            automatic: true,
            scaled: false,
        };
        Self {
            channels: channels.into_iter().map(shown).collect(),
            selected: 0,
            settings,
            cursors: [None; 2],
            moved: None,
            running: true,
            help: false,
            recorded,
        }
    }

    /// The channel that triggers.
    pub(crate) fn trigger(&self) -> Option<&Shown> {
        self.channels.iter().find(|shown| shown.channel.place == self.settings.channel)
    }

    /// Length of a division along time (s).
    pub(crate) fn time_base_s(&self) -> f64 {
        self.settings.window_ns as f64 * 1e-9 / f64::from(DIVISIONS)
    }

    /// Fits the scales to a window, where they no longer suit it.
    pub(crate) fn fit(&mut self, capture: &Capture) {
        for shown in self.channels.iter_mut().filter(|shown| shown.automatic) {
            let (ring, column) = shown.channel.place;
            let Some(rows) = capture.rows.get(ring) else { continue };
            let values = rows.points(column).map(|point| point.value);
            let bounds = values.filter(|value| value.is_finite()).fold(None, |bounds, value| {
                let (low, high) = bounds.unwrap_or((value, value));
                Some((value.min(low), value.max(high)))
            });
            if let Some((low, high)) = bounds
                && !(shown.scaled && shown.scale.suits(low, high))
            {
                shown.scale = Scale::of(low, high);
                shown.scaled = true;
            }
        }
    }

    /// Does what a key says.
    pub(crate) fn key(&mut self, key: KeyEvent) -> Action {
        let control = key.modifiers.contains(KeyModifiers::CONTROL);
        match key.code {
            KeyCode::Char('c') if control => Action::Quit,
            KeyCode::Char('q') | KeyCode::Esc => Action::Quit,
            KeyCode::Char('h' | '?') => {
                self.help = !self.help;
                Action::Nothing
            }
            KeyCode::Char(' ') => self.stop_or_go(),
            KeyCode::Char('f') if !self.recorded => Action::Force,
            KeyCode::Char(letter) => self.letter(letter),
            KeyCode::Tab => {
                self.selected = (self.selected + 1) % self.channels.len().max(1);
                Action::Nothing
            }
            KeyCode::Up | KeyCode::Down => {
                let up = if key.code == KeyCode::Up { 1.0 } else { -1.0 };
                self.scaled(|scale| scale.centre -= up * scale.per_division / 2.0)
            }
            KeyCode::Left | KeyCode::Right => {
                let step = if key.modifiers.contains(KeyModifiers::SHIFT) { 0.05 } else { 0.005 };
                let step = if key.code == KeyCode::Left { -step } else { step };
                if let Some(moved) = self.moved
                    && let Some(cursor) = &mut self.cursors[moved]
                {
                    *cursor = (*cursor + step).clamp(0.0, 1.0);
                }
                Action::Nothing
            }
            _ => Action::Nothing,
        }
    }

    fn letter(&mut self, letter: char) -> Action {
        match letter {
            'm' => {
                let next = self.settings.mode.next();
                // Of a recording there is no now.
                let next = if self.recorded && next == Mode::Roll { next.next() } else { next };
                self.set(|settings| settings.mode = next)
            }
            'e' => self.set(|settings| settings.condition = settings.condition.next()),
            '+' | '=' => self.level(0.1),
            '-' => self.level(-0.1),
            'g' => match self.channels.get(self.selected).map(|shown| shown.channel.place) {
                Some(place) => self.set(|settings| settings.channel = place),
                None => Action::Nothing,
            },
            'p' => self.before(-0.1),
            'P' => self.before(0.1),
            't' => self.time_base(smaller),
            'T' => self.time_base(larger),
            'v' => self.scaled(|scale| scale.per_division = smaller(scale.per_division)),
            'V' => self.scaled(|scale| scale.per_division = larger(scale.per_division)),
            'a' => {
                if let Some(shown) = self.channels.get_mut(self.selected) {
                    (shown.automatic, shown.scaled) = (true, false);
                }
                Action::Nothing
            }
            'c' => {
                self.next_cursor();
                Action::Nothing
            }
            _ => Action::Nothing,
        }
    }

    fn stop_or_go(&mut self) -> Action {
        // A recording goes on from window to window; a single capture waits for the next one.
        self.running = self.recorded || self.settings.mode == Mode::Single || !self.running;
        if self.running { Action::Run } else { Action::Nothing }
    }

    fn set(&mut self, change: impl FnOnce(&mut Settings)) -> Action {
        change(&mut self.settings);
        Action::Set
    }

    /// Moves the level by a part of a division of its channel.
    fn level(&mut self, divisions: f64) -> Action {
        let division = self.trigger().map_or(1.0, |shown| shown.scale.per_division);
        self.set(|settings| settings.condition = settings.condition.moved(divisions * division))
    }

    /// Moves the trigger within the window by a share of it.
    fn before(&mut self, by: f64) -> Action {
        self.set(|settings| {
            let window_ns = settings.window_ns.max(1) as f64;
            // Rounded, or the steps would add up their errors.
            let share = ((settings.pre_ns as f64 / window_ns + by) * 20.0).round() / 20.0;
            settings.pre_ns = (share.clamp(0.0, 1.0) * window_ns).round() as u64;
        })
    }

    /// Makes the time base another step; the trigger stays at its place on the screen.
    fn time_base(&mut self, step: fn(f64) -> f64) -> Action {
        let division_s = step(self.time_base_s());
        if !(TIME_BASE.0 * 0.99..=TIME_BASE.1 * 1.01).contains(&division_s) {
            return Action::Nothing;
        }
        self.set(|settings| {
            let share = settings.pre_ns as f64 / settings.window_ns.max(1) as f64;
            let window_ns = division_s * f64::from(DIVISIONS) * 1e9;
            settings.window_ns = window_ns.round() as u64;
            settings.pre_ns = (share * window_ns).round() as u64;
            settings.auto_ns = settings.window_ns.max(AUTO_NS);
        })
    }

    fn scaled(&mut self, change: impl FnOnce(&mut Scale)) -> Action {
        if let Some(shown) = self.channels.get_mut(self.selected) {
            change(&mut shown.scale);
            shown.automatic = false;
        }
        Action::Nothing
    }

    /// The keys move cursor A, then cursor B, then both are gone.
    fn next_cursor(&mut self) {
        self.moved = match self.moved {
            None => Some(0),
            Some(0) => Some(1),
            Some(_) => None,
        };
        match self.moved {
            Some(moved) => {
                let place = [0.25, 0.75][moved];
                self.cursors[moved].get_or_insert(place);
            }
            None => self.cursors = [None; 2],
        }
    }
}

#[cfg(test)]
mod tests;
