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

/// Every effect that identify knows by name of drives, elements and oscillators; of transmissions
/// it knows [`plant::effects::LIST`].
pub static ALL: &[&dyn Effect] = &[
    &coulomb_friction::CoulombFriction,
    &asymmetric_friction::AsymmetricFriction,
    &stribeck_friction::StribeckFriction,
    &viscous_friction::ViscousFriction,
    &extra_inertia::ExtraInertia,
    &quadratic_drag::QuadraticDrag,
    &presliding_hysteresis::PreslidingHysteresis,
    &position_dependent_friction::PositionDependentFriction,
    &load_dependent_friction::LoadDependentFriction,
    &thermal_drift::ThermalDrift,
    &gravity_imbalance::GravityImbalance,
    &nonlinear_stiffness::NonlinearStiffness,
    &backlash::Backlash,
    &viscoelastic_line::ViscoelasticLine,
    &line_compliance::LineCompliance,
    &line_damping::LineDamping,
    &torque_ripple::TorqueRipple,
    &amplifier_deadzone::AmplifierDeadzone,
    &amplifier_saturation::AmplifierSaturation,
    &amplifier_lag::AmplifierLag,
    &transport_delay::TransportDelay,
    &periodic_disturbance::PeriodicDisturbance,
    &sensor_drift::SensorDrift,
    &mains_hum::MainsHum,
];

/// The effect of that id.
pub fn find(id: &str) -> Option<&'static dyn Effect> {
    ALL.iter().copied().find(|effect| effect.id() == id)
}

/// What an effect is, whatever the model: its name, where it can sit, what would tell it from
/// others.
pub trait Effect: Sync {
    /// Fixed id, as in the table of effects.
    fn id(&self) -> &'static str;
    /// Sites at which it can sit.
    fn sites(&self) -> &'static [&'static str];
    /// In words, to complete "The model lacks ...".
    fn words(&self) -> &'static str;
    /// The experiment that would settle what one run leaves open about it.
    fn experiment(&self) -> &'static str;
    /// Its share in the force balance of a model that is read inversely (motion in, force out).
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        None
    }
}

/// Names of units in one machine: those of a linear or of a rotary axis, or of a circuit.
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
    /// Of a linear axis.
    pub const LINEAR: Self = Self {
        force: "N",
        position: "m",
        velocity: "m/s",
        stiffness: "N/m",
        damping: "N·s/m",
        mass: "kg",
    };
    /// Of a rotary axis.
    pub const ROTARY: Self = Self {
        force: "N·m",
        position: "rad",
        velocity: "rad/s",
        stiffness: "N·m/rad",
        damping: "N·m·s/rad",
        mass: "kg·m²",
    };
    /// Of a circuit whose input and output are volts.
    pub const VOLTS: Self = Self {
        force: "V",
        position: "V",
        velocity: "V/s",
        stiffness: "1",
        damping: "s",
        mass: "s²",
    };
}

/// What effects are scaled with: units, and how far, fast and long the records go.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// Names of units.
    pub units: Units,
    /// Whether the position is an angle.
    pub rotary: bool,
    /// Position per motor turn, where it is declared; one turn of a rotary axis is 2π rad.
    pub turn: Option<f64>,
    /// Whether a spring holds the position: the declared model has a stiffness.
    pub spring: bool,
    /// Whether the force is a command that something puts out, rather than a measured force.
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
    /// Highest frequency that the rows carry (Hz).
    pub cut_off: f64,
}

impl Axis {
    /// How far the position goes.
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
    /// Physical limits of the amplitude. Where they meet it is given, not fitted, and is not
    /// reported.
    pub bound: Bound,
}

impl Term {
    /// An amplitude of either sign.
    pub fn free(name: &str, unit: impl Into<String>) -> Self {
        Self { name: name.into(), unit: unit.into(), bound: (f64::NEG_INFINITY, f64::INFINITY) }
    }
    /// An amplitude that is at least 0.
    pub fn positive(name: &str, unit: impl Into<String>) -> Self {
        Self { name: name.into(), unit: unit.into(), bound: (0.0, f64::INFINITY) }
    }
    /// A column that enters as it is.
    pub fn given() -> Self {
        Self { name: String::new(), unit: String::new(), bound: (1.0, 1.0) }
    }
    /// Whether the amplitude is given, not fitted.
    pub fn is_given(&self) -> bool {
        self.bound.0 == self.bound.1
    }
}

/// How values of a shape are spread over its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spacing {
    /// By equal factors.
    Logarithmic,
    /// By equal steps.
    Linear,
    /// By equal steps through the 0.2 Hz about 50 Hz, then through those about 60 Hz.
    Mains,
}

/// A parameter that shapes a column and that no linear fit finds: searched on a grid, then refined.
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
    /// How they are spread.
    pub spacing: Spacing,
}

impl Shape {
    /// A shape that is searched by factors.
    pub fn by_factors(
        name: &str,
        unit: impl Into<String>,
        (low, high): (f64, f64),
        points: usize,
    ) -> Self {
        Self {
            name: name.into(),
            unit: unit.into(),
            low,
            high,
            points,
            spacing: Spacing::Logarithmic,
        }
    }
    /// A shape that is searched by equal steps.
    pub fn by_steps(
        name: &str,
        unit: impl Into<String>,
        (low, high): (f64, f64),
        points: usize,
    ) -> Self {
        Self { name: name.into(), unit: unit.into(), low, high, points, spacing: Spacing::Linear }
    }
    /// The value at a share of the range, 0 to 1.
    pub fn at(&self, share: f64) -> f64 {
        let share = share.clamp(0.0, 1.0);
        match self.spacing {
            Spacing::Logarithmic => self.low * (self.high / self.low).powf(share),
            Spacing::Linear => self.low + (self.high - self.low) * share,
            Spacing::Mains if share < 0.5 => 49.9 + 0.4 * share,
            Spacing::Mains => 59.9 + 0.4 * (share - 0.5),
        }
    }
    /// The share of the range at which a value stands.
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

/// What an effect sees of a record, at the full rate.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Filtered motion, and the force as recorded.
    pub signals: &'a Signals,
    /// Smoothed sign of the velocity.
    pub sign: &'a [f64],
    /// The force that the model without this effect asks for, low-passed. Empty before there is
    /// one.
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

/// An effect as a force at an instant, by which a model can also be simulated from its input.
pub trait Law: Sync {
    /// Number of own states; they begin at 0.
    fn states(&self) -> usize {
        0
    }
    /// Time derivative of the states.
    fn rates(&self, _now: &Instant, _shapes: &[f64], _states: &[f64], _rates: &mut [f64]) {}
    /// Force per unit amplitude, one value a term, positive against the input.
    fn force(&self, now: &Instant, shapes: &[f64], states: &[f64], out: &mut [f64]);
}

/// An effect as columns of a regression.
///
/// Columns are functions of the filtered motion. They are nonlinear, so the caller low-passes them
/// once more: the force was low-passed after the machine had formed it, and a model must be treated
/// alike.
pub trait InverseEffect: Sync {
    /// Effects that must be in the model first, because this one by itself would mimic them.
    fn needs(&self) -> &'static [&'static str] {
        &[]
    }
    /// The simpler effect that this one contains as a limit. Where the simpler one does as well it
    /// is taken, and the two are no rivals.
    fn refines(&self) -> Option<&'static str> {
        None
    }
    /// The declared parameter whose tolerance it lifts, for effects that act like a changed
    /// parameter. Such an effect is a candidate only where the fit stands at the tolerance's edge;
    /// where the parameter is not declared it has a column of its own.
    fn lifts(&self) -> Option<Declared> {
        None
    }
    /// Whether it makes sense on this axis.
    fn applies(&self, _axis: &Axis) -> bool {
        true
    }
    /// Whether its columns depend on the smoothed sign of the velocity.
    fn uses_sign(&self) -> bool {
        false
    }
    /// Whether its columns come from the force that the model asks for.
    fn uses_model(&self) -> bool {
        false
    }
    /// Whether its columns are linear in signals that are low-passed already.
    fn linear(&self) -> bool {
        false
    }
    /// By how much it shifts the force in time (s), where that is all it does. A shift of about a
    /// sampling period is what sampling and holding make, and gets no name.
    fn shift(&self, _amplitudes: &[f64], _shapes: &[f64]) -> Option<f64> {
        None
    }
    /// Whether its columns are sine and cosine of the time, its only shape being the frequency.
    fn is_tone(&self) -> bool {
        false
    }
    /// Linear amplitudes.
    fn terms(&self, axis: &Axis) -> Vec<Term>;
    /// Nonlinear parameters.
    fn shapes(&self, _axis: &Axis) -> Vec<Shape> {
        Vec::new()
    }
    /// As a force at an instant, where it is one.
    fn law(&self) -> Option<&dyn Law> {
        None
    }
    /// What arrives of a command that passes it (`step` apart (s)); `None` where it leaves the
    /// command alone.
    fn deliver(
        &self,
        _command: &[f64],
        _step: f64,
        _amplitudes: &[f64],
        _shapes: &[f64],
    ) -> Option<Vec<f64>> {
        None
    }
    /// One column per term at the full rate; a law without states is tabulated.
    fn columns(&self, view: &View<'_>, shapes: &[f64]) -> Vec<Vec<f64>> {
        let signals = view.signals;
        let n = signals.time.len();
        let terms = self.terms(view.axis).len();
        let mut columns = vec![vec![0.0; n]; terms];
        let Some(law) = self.law() else { return columns };
        let mut out = vec![0.0; terms];
        for i in 0..n {
            let now = Instant {
                time: signals.time[i],
                position: signals.position[i],
                velocity: signals.velocity[i],
                sign: view.sign.get(i).copied().unwrap_or(0.0),
            };
            law.force(&now, shapes, &[], &mut out);
            for (column, value) in columns.iter_mut().zip(&out) {
                column[i] = *value;
            }
        }
        columns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_unique_and_needs_exist() {
        for (i, effect) in ALL.iter().enumerate() {
            assert!(ALL[..i].iter().all(|other| other.id() != effect.id()), "{}", effect.id());
            assert!(!effect.sites().is_empty() && !effect.words().is_empty());
            let Some(inverse) = effect.inverse() else { continue };
            for need in inverse.needs().iter().chain(&inverse.refines()) {
                assert!(find(need).is_some(), "{need}");
            }
        }
    }
}
