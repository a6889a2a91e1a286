//! The parameters that a fit varies, each kept within its bounds by a change of variable: `value =
//! centre + half-width · sin(u)` with `u` unbounded.

use std::f64::consts::TAU;

use plant::effects::search::{PHASE, Scaling, SearchRange};

use super::record::Record;
use super::transmission_model::{Setting, TransmissionModel};

/// Largest normalised value that a fit reaches (1 is the bound): beyond it the slope of `sin(u)`
/// vanishes.
pub(super) const BOUND_MARGIN: f64 = 0.995;
/// A normalised value beyond this counts as at its bound.
pub const AT_BOUND: f64 = 0.97;
/// Finite-difference perturbation, normalised: a smaller one would resolve single stick-slip
/// events.
const PERTURBATION: f64 = 0.02;
/// Perturbation of an effect's parameter relative to its value, where that is smaller.
const RELATIVE_PERTURBATION: f64 = 0.04;
/// Bound of a node's value in units of the first trial value; no fitted node comes near it.
pub const NODE_BOUND: f64 = 40.0;

/// Phase by which a frequency's perturbation shifts the last record against the first (turns).
const PHASE_SHIFT: f64 = 0.03;

/// One parameter that a fit varies.
#[derive(Clone, Debug, PartialEq)]
pub enum FreeParameter {
    /// A declared parameter.
    Base(usize),
    /// A parameter of an effect that was added.
    Effect {
        /// Index of the effect.
        placed: usize,
        /// Which parameter, and where it is searched.
        range: SearchRange,
    },
    /// Cosine (0) or sine (1) part of an effect with amplitude and phase.
    Phasor {
        /// Index of the effect.
        placed: usize,
        /// Name of the amplitude.
        name: &'static str,
        /// Its greatest value.
        most: f64,
        /// Which part.
        part: usize,
    },
    /// A node of the last nonparametric function.
    Node {
        /// Which.
        node: usize,
        /// Its greatest value, either way.
        most: f64,
    },
}

impl FreeParameter {
    /// Whether it is a declared parameter.
    pub const fn is_base(&self) -> bool {
        matches!(self, Self::Base(_))
    }

    fn range(&self, model: &TransmissionModel) -> (f64, f64, bool) {
        match self {
            Self::Base(index) => {
                let parameter = &model.base[*index];
                (parameter.low, parameter.high, parameter.logarithmic)
            }
            Self::Effect { range: SearchRange { low, high, scaling, .. }, .. } => {
                (*low, *high, *scaling != Scaling::Linear)
            }
            Self::Phasor { most, .. } | Self::Node { most, .. } => (-most, *most, false),
        }
    }

    /// Returns its value in a setting.
    pub fn value(&self, setting: &Setting) -> f64 {
        match self {
            Self::Base(index) => setting.base[*index],
            Self::Effect { placed, range } => {
                setting.placed[*placed].value(range.name).unwrap_or_default()
            }
            Self::Phasor { placed, name, part, .. } => {
                let placed = &setting.placed[*placed];
                let phase = placed.value(PHASE).unwrap_or_default();
                placed.value(name).unwrap_or_default()
                    * if *part == 0 { phase.cos() } else { phase.sin() }
            }
            Self::Node { node, .. } => {
                setting.tables.last().map_or(0.0, |table| table.values[*node])
            }
        }
    }

    /// Writes a value into a setting.
    pub fn assign(&self, setting: &mut Setting, value: f64) {
        let into = |setting: &mut Setting, placed: usize, name: &'static str, value: f64| {
            let values = &mut setting.placed[placed].values;
            match values.iter_mut().find(|(own, _)| *own == name) {
                Some((_, old)) => *old = value,
                None => values.push((name, value)),
            }
        };
        match self {
            Self::Base(index) => setting.base[*index] = value,
            Self::Effect { placed, range } => into(setting, *placed, range.name, value),
            Self::Phasor { placed, name, most, part } => {
                let other = Self::Phasor { placed: *placed, name, most: *most, part: 1 - part }
                    .value(setting);
                let (cosine, sine) = if *part == 0 { (value, other) } else { (other, value) };
                into(setting, *placed, name, cosine.hypot(sine).min(*most));
                into(setting, *placed, PHASE, sine.atan2(cosine));
            }
            Self::Node { node, .. } => {
                if let Some(table) = setting.tables.last_mut() {
                    table.values[*node] = value;
                }
            }
        }
    }

    /// Returns the parameter as indexed after the effect `gone` was removed; `None` if it belongs
    /// to that effect.
    pub fn without(&self, gone: usize) -> Option<Self> {
        let mut parameter = self.clone();
        if let Self::Effect { placed, .. } | Self::Phasor { placed, .. } = &mut parameter {
            if *placed == gone {
                return None;
            }
            *placed -= usize::from(*placed > gone);
        }
        Some(parameter)
    }

    /// Returns the parameter with its effect at index `at`; others are returned unchanged.
    pub fn moved_to(&self, at: usize) -> Self {
        let mut parameter = self.clone();
        if let Self::Effect { placed, .. } | Self::Phasor { placed, .. } = &mut parameter {
            *placed = at;
        }
        parameter
    }

    /// Whether it belongs to the effect at index `at`.
    pub const fn is_of(&self, at: usize) -> bool {
        match self {
            Self::Effect { placed, .. } | Self::Phasor { placed, .. } => *placed == at,
            Self::Base(_) | Self::Node { .. } => false,
        }
    }

    /// Returns the value normalised to its bounds: -1 at the lower, 1 at the upper.
    pub fn normalised(&self, model: &TransmissionModel, setting: &Setting) -> f64 {
        let (low, high, logarithmic) = self.range(model);
        let scale =
            |value: f64| if logarithmic { value.max(f64::MIN_POSITIVE).ln() } else { value };
        let (low, high) = (scale(low), scale(high));
        (2.0 * scale(self.value(setting)) - low - high) / (high - low)
    }

    /// Whether the value is off its bounds: at one of them a parameter cannot explain more.
    pub(super) fn is_inside(&self, model: &TransmissionModel, setting: &Setting) -> bool {
        self.normalised(model, setting).abs() < AT_BOUND
    }

    /// Returns the value at a normalised position.
    fn value_at(&self, model: &TransmissionModel, place: f64) -> f64 {
        let (low, high, logarithmic) = self.range(model);
        let within = |low: f64, high: f64| 0.5 * (low + high + place * (high - low));
        if logarithmic { within(low.ln(), high.ln()).exp() } else { within(low, high) }
    }

    /// Returns the unbounded variable `u` that the fit varies.
    pub fn unbounded(&self, model: &TransmissionModel, setting: &Setting) -> f64 {
        self.normalised(model, setting).clamp(-BOUND_MARGIN, BOUND_MARGIN).asin()
    }

    /// Writes the value for an unbounded variable into a setting.
    pub fn set_unbounded(&self, model: &TransmissionModel, setting: &mut Setting, open: f64) {
        self.assign(setting, self.value_at(model, open.sin().clamp(-BOUND_MARGIN, BOUND_MARGIN)));
    }

    /// Returns the unbounded variable perturbed for a finite difference.
    pub fn perturbed(&self, model: &TransmissionModel, setting: &Setting) -> f64 {
        let place = self.normalised(model, setting).clamp(-BOUND_MARGIN, BOUND_MARGIN);
        let step = match self {
            Self::Phasor { .. } => 4e-3,
            Self::Node { .. } => 0.5 / NODE_BOUND,
            Self::Base(_) => PERTURBATION,
            Self::Effect { range: SearchRange { low, high, scaling, .. }, .. } => match scaling {
                // The perturbed wave drifts by a small phase between the first record and the last.
                Scaling::Frequency => {
                    let turn_hz = 1.0 / model.records.iter().map(Record::end_s).fold(1.0, f64::max);
                    2.0 * (PHASE_SHIFT * turn_hz / self.value(setting).max(*low))
                        / (high / low).ln()
                }
                // The same phase over a movement of one radian.
                Scaling::SpatialFrequency => {
                    (2.0 * (PHASE_SHIFT * TAU / self.value(setting).max(*low)) / (high / low).ln())
                        .min(PERTURBATION)
                }
                // An effect's range is much wider than its likely size.
                Scaling::Linear => (RELATIVE_PERTURBATION * self.value(setting).abs()
                    / (0.5 * (high - low)))
                    .clamp(1e-4, PERTURBATION),
                Scaling::Logarithmic => PERTURBATION,
            },
        };
        let moved = if place > 0.0 { place - step } else { place + step };
        moved.asin()
    }
}
