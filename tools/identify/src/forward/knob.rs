//! The numbers of a setting that a fit moves, each held within its range by a transformation that
//! no step leaves.

use std::f64::consts::TAU;

use super::catalogue::{Candidate, Way};
use super::machine::{Machine, Setting};
use super::record::Record;

/// Nearest to an end of its range that a fit comes, as a share of half of it: there the free number
/// hardly moves the value.
const EDGE: f64 = 0.995;
/// A value this far out, as a share of half its range, stands at its end.
pub const AT_EDGE: f64 = 0.97;
/// How far a number is moved for a slope, as a share of half its range: small ones see stick-slip
/// from too near.
const ASIDE: f64 = 0.02;
/// The same of an effect, as a share of its value, where that is less.
const ASIDE_OF_VALUE: f64 = 0.04;
/// Greatest value of a function's node, in units of a first try: far beyond what any has.
pub const MOST_UNITS: f64 = 40.0;

/// Part of a turn by which the slope of a wave's length is taken.
const OUT_OF_STEP: f64 = 0.03;

/// One number of a setting that a fit moves.
#[derive(Clone, Debug, PartialEq)]
pub enum Knob {
    /// A declared parameter.
    Base(usize),
    /// A parameter of an effect.
    Effect {
        /// Index of the effect.
        placed: usize,
        /// Name of the parameter.
        name: &'static str,
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
        /// How it is searched.
        way: Way,
    },
    /// Cosine (0) or sine (1) part of an effect with amplitude and phase.
    Wave {
        /// Index of the effect.
        placed: usize,
        /// Name of the amplitude.
        name: &'static str,
        /// Its greatest value.
        most: f64,
        /// Which part.
        part: usize,
    },
    /// A node of the last function without a name.
    Node {
        /// Which.
        node: usize,
        /// Its greatest value, either way.
        most: f64,
    },
}

/// The knobs of an effect that stands at `placed`.
pub fn knobs_of(candidate: &Candidate, placed: usize) -> Vec<Knob> {
    let free = candidate.free.iter().map(|free| Knob::Effect {
        placed,
        name: free.name,
        low: free.low,
        high: free.high,
        way: free.way,
    });
    let waves = candidate
        .wave
        .iter()
        .flat_map(|(name, most)| [0, 1].map(|part| Knob::Wave { placed, name, most: *most, part }));
    free.chain(waves).collect()
}

impl Knob {
    /// Whether it is a declared parameter.
    pub const fn is_base(&self) -> bool {
        matches!(self, Self::Base(_))
    }

    fn range(&self, machine: &Machine) -> (f64, f64, bool) {
        match self {
            Self::Base(index) => {
                let parameter = &machine.base[*index];
                (parameter.low, parameter.high, parameter.logarithmic)
            }
            Self::Effect { low, high, way, .. } => (*low, *high, *way != Way::Straight),
            Self::Wave { most, .. } | Self::Node { most, .. } => (-most, *most, false),
        }
    }

    /// Its value in a setting.
    pub fn value(&self, setting: &Setting) -> f64 {
        match self {
            Self::Base(index) => setting.base[*index],
            Self::Effect { placed, name, .. } => {
                setting.placed[*placed].value(name).unwrap_or_default()
            }
            Self::Wave { placed, name, part, .. } => {
                let placed = &setting.placed[*placed];
                let phase = placed.value("phase").unwrap_or_default();
                placed.value(name).unwrap_or_default()
                    * if *part == 0 { phase.cos() } else { phase.sin() }
            }
            Self::Node { node, .. } => {
                setting.tables.last().map_or(0.0, |table| table.values[*node])
            }
        }
    }

    /// Puts a value into a setting.
    pub fn put(&self, setting: &mut Setting, value: f64) {
        let into = |setting: &mut Setting, placed: usize, name: &'static str, value: f64| {
            let values = &mut setting.placed[placed].values;
            match values.iter_mut().find(|(own, _)| *own == name) {
                Some((_, old)) => *old = value,
                None => values.push((name, value)),
            }
        };
        match self {
            Self::Base(index) => setting.base[*index] = value,
            Self::Effect { placed, name, .. } => into(setting, *placed, name, value),
            Self::Wave { placed, name, most, part } => {
                let other = Self::Wave { placed: *placed, name, most: *most, part: 1 - part }
                    .value(setting);
                let (cosine, sine) = if *part == 0 { (value, other) } else { (other, value) };
                into(setting, *placed, name, cosine.hypot(sine).min(*most));
                into(setting, *placed, "phase", sine.atan2(cosine));
            }
            Self::Node { node, .. } => {
                if let Some(table) = setting.tables.last_mut() {
                    table.values[*node] = value;
                }
            }
        }
    }

    /// The same knob once an effect is taken away; `None` for its own.
    pub fn without(&self, gone: usize) -> Option<Self> {
        let mut knob = self.clone();
        if let Self::Effect { placed, .. } | Self::Wave { placed, .. } = &mut knob {
            if *placed == gone {
                return None;
            }
            *placed -= usize::from(*placed > gone);
        }
        Some(knob)
    }

    /// The same of the effect in another place; none but an effect's have one.
    pub fn moved_to(&self, at: usize) -> Self {
        let mut knob = self.clone();
        if let Self::Effect { placed, .. } | Self::Wave { placed, .. } = &mut knob {
            *placed = at;
        }
        knob
    }

    /// Whether it is of the effect in that place.
    pub const fn is_of(&self, at: usize) -> bool {
        match self {
            Self::Effect { placed, .. } | Self::Wave { placed, .. } => *placed == at,
            Self::Base(_) | Self::Node { .. } => false,
        }
    }

    /// Where the value stands in its range, -1 to 1.
    pub fn place(&self, machine: &Machine, setting: &Setting) -> f64 {
        let (low, high, logarithmic) = self.range(machine);
        let scale =
            |value: f64| if logarithmic { value.max(f64::MIN_POSITIVE).ln() } else { value };
        let (low, high) = (scale(low), scale(high));
        (2.0 * scale(self.value(setting)) - low - high) / (high - low)
    }

    /// The value at a place.
    fn at_place(&self, machine: &Machine, place: f64) -> f64 {
        let (low, high, logarithmic) = self.range(machine);
        let within = |low: f64, high: f64| 0.5 * (low + high + place * (high - low));
        if logarithmic { within(low.ln(), high.ln()).exp() } else { within(low, high) }
    }

    /// The number that the fit moves freely.
    pub fn open(&self, machine: &Machine, setting: &Setting) -> f64 {
        self.place(machine, setting).clamp(-EDGE, EDGE).asin()
    }

    /// Puts the value of a free number into a setting.
    pub fn close(&self, machine: &Machine, setting: &mut Setting, open: f64) {
        self.put(setting, self.at_place(machine, open.sin().clamp(-EDGE, EDGE)));
    }

    /// The free number a little off, for a slope.
    pub fn aside(&self, machine: &Machine, setting: &Setting) -> f64 {
        let place = self.place(machine, setting).clamp(-EDGE, EDGE);
        let step = match self {
            Self::Wave { .. } => 4e-3,
            Self::Node { .. } => 0.5 / MOST_UNITS,
            // So far that the wave comes out of step by a small part of a turn between the first
            // record and the last.
            Self::Effect { way: Way::WavesInTime, low, high, .. } => {
                let turn_hz = 1.0 / machine.records.iter().map(Record::end_s).fold(1.0, f64::max);
                2.0 * (OUT_OF_STEP * turn_hz / self.value(setting).max(*low)) / (high / low).ln()
            }
            // The same over a movement of a radian.
            Self::Effect { way: Way::WavesInAngle, low, high, .. } => {
                (2.0 * (OUT_OF_STEP * TAU / self.value(setting).max(*low)) / (high / low).ln())
                    .min(ASIDE)
            }
            // An effect's range is wide beside what its size may be.
            Self::Effect { way: Way::Straight, low, high, .. } => {
                (ASIDE_OF_VALUE * self.value(setting).abs() / (0.5 * (high - low)))
                    .clamp(1e-4, ASIDE)
            }
            _ => ASIDE,
        };
        let moved = if place > 0.0 { place - step } else { place + step };
        moved.asin()
    }
}
