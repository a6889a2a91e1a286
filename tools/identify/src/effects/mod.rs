//! The listed effects of drives, elements and oscillators: one file each, and one line in [`ALL`].
//! Those of transmissions are the plant's ([`plant::effects`]).

mod amplifier_deadzone;
mod amplifier_lag;
mod amplifier_saturation;
mod asymmetric_friction;
mod backlash;
mod coulomb_friction;
mod extra_inertia;
mod gravity_imbalance;
mod line_compliance;
mod line_damping;
mod load_dependent_friction;
mod mains_hum;
mod nonlinear_stiffness;
mod periodic_disturbance;
mod position_dependent_friction;
mod presliding_hysteresis;
mod quadratic_drag;
mod sensor_drift;
mod stribeck_friction;
mod thermal_drift;
mod torque_ripple;
mod transport_delay;
mod viscoelastic_line;
mod viscous_friction;
mod waves;

use crate::equation_error::signals::Signals;
use crate::regression::Bound;

/// The effects of drives, elements and oscillators, in the order in which they are tried.
pub static ALL: &[Effect] = &[
    coulomb_friction::EFFECT,
    asymmetric_friction::EFFECT,
    stribeck_friction::EFFECT,
    viscous_friction::EFFECT,
    extra_inertia::EFFECT,
    quadratic_drag::EFFECT,
    presliding_hysteresis::EFFECT,
    position_dependent_friction::EFFECT,
    load_dependent_friction::EFFECT,
    thermal_drift::EFFECT,
    gravity_imbalance::EFFECT,
    nonlinear_stiffness::EFFECT,
    backlash::EFFECT,
    viscoelastic_line::EFFECT,
    line_compliance::EFFECT,
    line_damping::EFFECT,
    torque_ripple::EFFECT,
    amplifier_deadzone::EFFECT,
    amplifier_saturation::EFFECT,
    amplifier_lag::EFFECT,
    transport_delay::EFFECT,
    periodic_disturbance::EFFECT,
    sensor_drift::EFFECT,
    mains_hum::EFFECT,
];

/// The effect of that id.
pub fn find(id: &str) -> Option<&'static Effect> {
    ALL.iter().find(|effect| effect.id == id)
}

/// Columns of a regression from the signals of a record and the effect's shapes.
type Columns = fn(&View<'_>, &[f64]) -> Vec<Vec<f64>>;

/// Force per unit amplitude at an instant, from the effect's shapes and states: one value per term,
/// positive against the input.
type Force = fn(&Instant, &[f64], &[f64], &mut [f64]);

/// Output of an amplifier for a command sampled at a step (s), from amplitudes and shapes.
type Deliver = fn(&[f64], f64, &[f64], &[f64]) -> Vec<f64>;

/// A listed effect, as each declares itself in its own file.
///
/// Columns are functions of the filtered motion. Nonlinear ones are low-passed by the caller: the
/// measured force is low-passed too, so that both sides of the balance have passed the same filter.
#[derive(Clone, Copy, Debug)]
pub struct Effect {
    /// Fixed id, as in rig files and results.
    pub id: &'static str,
    /// Sites at which it may act.
    pub sites: &'static [&'static str],
    /// A description that completes "The model lacks ...".
    pub words: &'static str,
    /// The experiment that would settle what one run leaves open about it.
    pub experiment: &'static str,
    /// Effects that must be in the model already, because without them this one would imitate them.
    pub needs: &'static [&'static str],
    /// The simpler effect that this one contains as a limiting case. Where the simpler one explains
    /// as much, it is chosen, and the two are not reported as rivals.
    pub refines: Option<&'static str>,
    /// The declared parameter whose bounds it lifts, for effects that act like a changed parameter.
    /// Such an effect is a candidate only where the fitted value is at the bound of its tolerance;
    /// where the parameter is not declared, the effect has a column of its own.
    pub lifts: Option<Declared>,
    /// Whether it can occur on an axis.
    pub applies: fn(&Axis) -> bool,
    /// Whether its columns depend on the smoothed sign of the velocity.
    pub uses_sign: bool,
    /// Whether its columns are computed from the force that the model predicts.
    pub uses_model: bool,
    /// Whether its columns are linear in signals that are already low-passed.
    pub linear: bool,
    /// Whether its columns are a sine and a cosine of time, with the frequency as the only shape.
    pub is_tone: bool,
    /// Whether it may be added more than once, as waves of several orders.
    pub repeats: bool,
    /// Whether it is also searched beside a nonparametric function: friction, gravity and mass,
    /// which nearly every machine has.
    pub beside_functions: bool,
    /// The time (s) by which it shifts the force, from amplitudes and shapes, for effects that do
    /// nothing else. A shift of about one sampling period is caused by sampling and zero-order hold
    /// and is not reported as an effect.
    pub shift: fn(&[f64], &[f64]) -> Option<f64>,
    /// Linear amplitudes.
    pub terms: fn(&Axis) -> Vec<Term>,
    /// Nonlinear parameters.
    pub shapes: fn(&Axis) -> Vec<Shape>,
    /// One column per term at the full rate, for effects whose columns are not [`Self::force`] at
    /// each row.
    pub columns: Option<Columns>,
    /// Number of states of its own in the simulation; they start at 0.
    pub states: usize,
    /// Their time derivative, from the motion, the shapes and the states.
    pub rates: fn(&Instant, &[f64], &[f64], &mut [f64]),
    /// The effect as a force at an instant, if it can be written as one.
    pub force: Option<Force>,
    /// What the amplifier puts out, for effects of the amplifier.
    pub deliver: Option<Deliver>,
}

impl Effect {
    /// Without terms: what an effect does not declare.
    pub const NONE: Self = Self {
        id: "",
        sites: &[],
        words: "",
        experiment: "",
        needs: &[],
        refines: None,
        lifts: None,
        applies: |_| true,
        uses_sign: false,
        uses_model: false,
        linear: false,
        is_tone: false,
        repeats: false,
        beside_functions: false,
        shift: |_, _| None,
        terms: |_| Vec::new(),
        shapes: |_| Vec::new(),
        columns: None,
        states: 0,
        rates: |_, _, _, _| (),
        force: None,
        deliver: None,
    };
}

impl Effect {
    /// Whether it takes a part of the measured force away, instead of adding a force that the
    /// motion needs: one of its columns has a given amplitude and is not computed from the motion.
    pub fn alters_target(&self, axis: &Axis) -> bool {
        !self.uses_model && (self.terms)(axis).iter().any(Term::is_given)
    }
}

/// Names of the units of a machine: a linear axis, a rotary axis or a circuit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Units {
    /// `N` or `N·m`.
    pub force: &'static str,
    /// `m` or `rad`.
    pub position: &'static str,
    /// `m/s` or `rad/s`.
    pub velocity: &'static str,
    /// `N/m` or `N·m/rad`.
    pub stiffness: &'static str,
    /// `N·s/m` or `N·m·s/rad`.
    pub damping: &'static str,
    /// `kg` or `kg·m²`.
    pub mass: &'static str,
}

impl Units {
    /// A linear axis.
    pub const LINEAR: Self = Self {
        force: "N",
        position: "m",
        velocity: "m/s",
        stiffness: "N/m",
        damping: "N·s/m",
        mass: "kg",
    };
    /// A rotary axis.
    pub const ROTARY: Self = Self {
        force: "N·m",
        position: "rad",
        velocity: "rad/s",
        stiffness: "N·m/rad",
        damping: "N·m·s/rad",
        mass: "kg·m²",
    };
    /// A circuit whose input and output are voltages.
    pub const VOLTS: Self = Self {
        force: "V",
        position: "V",
        velocity: "V/s",
        stiffness: "1",
        damping: "s",
        mass: "s²",
    };
}

/// Units of the axis, and the ranges of the records, by which effects are scaled.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// Names of units.
    pub units: Units,
    /// Whether the position is an angle.
    pub rotary: bool,
    /// Position per motor turn, where it is declared; one turn of a rotary axis is 2π rad.
    pub turn: Option<f64>,
    /// Whether the declared model has a stiffness.
    pub spring: bool,
    /// Whether the force column is the command to an amplifier rather than a measured force.
    pub commanded: bool,
    /// Lowest and highest position.
    pub positions: (f64, f64),
    /// Root mean square of the velocity over all records.
    pub velocity_rms: f64,
    /// Largest magnitude of the velocity.
    pub velocity_peak: f64,
    /// Root mean square of the force.
    pub force_rms: f64,
    /// Largest magnitude of the force.
    pub force_peak: f64,
    /// Longest record (s).
    pub seconds: f64,
    /// Cut-off frequency of the low-pass (Hz).
    pub cut_off: f64,
}

impl Axis {
    /// Range of the position.
    pub fn travel(&self) -> f64 {
        self.positions.1 - self.positions.0
    }
}

/// A linear amplitude of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Name of the parameter.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Physical limits of the amplitude. Where the two are equal, the amplitude is given: it is
    /// neither fitted nor reported.
    pub bound: Bound,
}

impl Term {
    /// An amplitude of any sign.
    pub fn free(name: &str, unit: impl Into<String>) -> Self {
        Self { name: name.into(), unit: unit.into(), bound: (f64::NEG_INFINITY, f64::INFINITY) }
    }
    /// An amplitude that is at least 0.
    pub fn positive(name: &str, unit: impl Into<String>) -> Self {
        Self { name: name.into(), unit: unit.into(), bound: (0.0, f64::INFINITY) }
    }
    /// The amplitudes of a wave of unknown phase.
    pub fn sine_and_cosine(axis: &Axis) -> Vec<Self> {
        ["sine", "cosine"].map(|name| Self::free(name, axis.units.force)).to_vec()
    }
    /// A column with the fixed amplitude 1.
    pub fn given() -> Self {
        Self { name: String::new(), unit: String::new(), bound: (1.0, 1.0) }
    }
    /// Whether the amplitude is given, not fitted.
    pub fn is_given(&self) -> bool {
        self.bound.0 == self.bound.1
    }
}

/// How the grid of a shape is spaced over its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spacing {
    /// Logarithmic.
    Logarithmic,
    /// By equal steps.
    Linear,
    /// Linear, from 49.9 to 50.1 Hz and then from 59.9 to 60.1 Hz.
    Mains,
}

/// A nonlinear parameter of a column: searched on a grid, then refined.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Name of the parameter.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Lowest value tried.
    pub low: f64,
    /// Highest value tried.
    pub high: f64,
    /// Points of the grid.
    pub points: usize,
    /// How they are spaced.
    pub spacing: Spacing,
}

impl Shape {
    /// A shape on a logarithmic grid.
    pub fn by_factors(
        name: &str,
        unit: impl Into<String>,
        range: (f64, f64),
        points: usize,
    ) -> Self {
        Self { spacing: Spacing::Logarithmic, ..Self::by_steps(name, unit, range, points) }
    }
    /// A shape on a linear grid.
    pub fn by_steps(
        name: &str,
        unit: impl Into<String>,
        (low, high): (f64, f64),
        points: usize,
    ) -> Self {
        Self { name: name.into(), unit: unit.into(), low, high, points, spacing: Spacing::Linear }
    }
    /// The value at a fraction of the range, 0 to 1.
    pub fn at(&self, share: f64) -> f64 {
        let share = share.clamp(0.0, 1.0);
        match self.spacing {
            Spacing::Logarithmic => self.low * (self.high / self.low).powf(share),
            Spacing::Linear => self.low + (self.high - self.low) * share,
            Spacing::Mains if share < 0.5 => 49.9 + 0.4 * share,
            Spacing::Mains => 59.9 + 0.4 * (share - 0.5),
        }
    }
    /// The fraction of the range at which a value lies, 0 to 1.
    pub fn share(&self, value: f64) -> f64 {
        let share = match self.spacing {
            Spacing::Logarithmic => (value / self.low).ln() / (self.high / self.low).ln(),
            Spacing::Linear => (value - self.low) / (self.high - self.low),
            Spacing::Mains if value < 55.0 => (value - 49.9) / 0.4,
            Spacing::Mains => 0.5 + (value - 59.9) / 0.4,
        };
        if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// Which declared parameter an effect would change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Declared {
    /// Mass or inertia.
    Mass,
    /// Viscous friction or damping.
    Viscous,
    /// Stiffness.
    Stiffness,
}

/// The signals of a record at the full rate, from which an effect computes its columns.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Filtered motion, and the force as recorded.
    pub signals: &'a Signals,
    /// Smoothed sign of the velocity.
    pub sign: &'a [f64],
    /// The force that the model without this effect predicts from the motion, low-passed; empty
    /// before the first fit.
    pub model: &'a [f64],
    /// Units and scales.
    pub axis: &'a Axis,
}

/// The motion at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Instant {
    /// Time since the start (s).
    pub time: f64,
    /// Position.
    pub position: f64,
    /// Velocity.
    pub velocity: f64,
    /// Smoothed sign of the velocity.
    pub sign: f64,
}

/// A part of a model: a listed effect, or a nonparametric function, which overrides the methods.
pub trait Regressor: Sync {
    /// How it is declared.
    fn declaration(&self) -> &Effect;
    /// Linear amplitudes.
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        (self.declaration().terms)(axis)
    }
    /// Whether it can be simulated as a force.
    fn is_force(&self) -> bool {
        self.declaration().force.is_some()
    }
    /// Force per unit amplitude, as [`Effect::force`].
    fn force(&self, now: &Instant, shapes: &[f64], states: &[f64], out: &mut [f64]) {
        if let Some(force) = self.declaration().force {
            force(now, shapes, states, out);
        }
    }
    /// One column per term at the full rate.
    fn columns(&self, view: &View<'_>, shapes: &[f64]) -> Vec<Vec<f64>> {
        if let Some(columns) = self.declaration().columns {
            return columns(view, shapes);
        }
        let signals = view.signals;
        let n = signals.time.len();
        let terms = self.terms(view.axis).len();
        let mut columns = vec![vec![0.0; n]; terms];
        let mut out = vec![0.0; terms];
        for i in 0..n {
            let now = Instant {
                time: signals.time[i],
                position: signals.position[i],
                velocity: signals.velocity[i],
                sign: view.sign.get(i).copied().unwrap_or(0.0),
            };
            self.force(&now, shapes, &[], &mut out);
            for (column, value) in columns.iter_mut().zip(&out) {
                column[i] = *value;
            }
        }
        columns
    }
}

impl Regressor for Effect {
    fn declaration(&self) -> &Effect {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_unique_and_needs_exist() {
        for (i, effect) in ALL.iter().enumerate() {
            assert!(ALL[..i].iter().all(|other| other.id != effect.id), "{}", effect.id);
            assert!(!effect.sites.is_empty() && !effect.words.is_empty());
            for need in effect.needs.iter().chain(&effect.refines) {
                assert!(find(need).is_some(), "{need}");
            }
        }
    }
}
