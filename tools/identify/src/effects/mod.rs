//! The listed effects: one file each, and one line in [`ALL`].

mod asymmetric_friction;
mod coulomb_friction;
mod extra_inertia;
mod stribeck_friction;
mod viscous_friction;

use crate::inverse::signals::Signals;
use crate::regression::Bound;

/// Every effect that identify knows by name.
pub static ALL: &[&dyn Effect] = &[
    &coulomb_friction::CoulombFriction,
    &asymmetric_friction::AsymmetricFriction,
    &stribeck_friction::StribeckFriction,
    &viscous_friction::ViscousFriction,
    &extra_inertia::ExtraInertia,
];

/// The effect of that id.
pub fn find(id: &str) -> Option<&'static dyn Effect> {
    ALL.iter().copied().find(|effect| effect.id() == id)
}

/// What an effect is, whatever the model: its name, where it can sit, what would tell it from others.
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

/// Names of units in one machine: those of a linear or of a rotary axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Units {
    /// `N` or `N·m`.
    pub force: &'static str,
    /// `m` or `rad`.
    pub position: &'static str,
    /// `m/s` or `rad/s`.
    pub velocity: &'static str,
    /// `N·s/m` or `N·m·s/rad`.
    pub damping: &'static str,
    /// `kg` or `kg·m²`.
    pub mass: &'static str,
}

/// A linear amplitude of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Name of the parameter.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Physical limits of the amplitude.
    pub bound: Bound,
}

/// A parameter that shapes a column and that no linear fit finds: searched on a logarithmic grid, then refined.
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
}

/// Which declared parameter an effect would change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Declared {
    /// Mass or inertia.
    Mass,
    /// Viscous friction.
    Viscous,
}

/// How fast the records move: what shapes are scaled with.
#[derive(Clone, Copy, Debug)]
pub struct Speeds {
    /// Root mean square over all records (m/s or rad/s).
    pub rms: f64,
    /// Largest magnitude.
    pub peak: f64,
}

/// An effect as columns of a regression.
///
/// Columns are functions of the filtered motion. They are nonlinear, so the caller low-passes them once more: the
/// force was low-passed after the machine had formed it, and a model must be treated alike.
pub trait InverseEffect: Sync {
    /// Effects that must be in the model first, because this one by itself would mimic them.
    fn needs(&self) -> &'static [&'static str] {
        &[]
    }
    /// The declared parameter whose tolerance it lifts, for effects that act like a changed parameter. Such an
    /// effect has no column of its own and is a candidate only where the fit stands at the tolerance's edge.
    fn lifts(&self) -> Option<Declared> {
        None
    }
    /// Linear amplitudes.
    fn terms(&self, units: &Units) -> Vec<Term>;
    /// Nonlinear parameters.
    fn shapes(&self, _units: &Units, _speeds: &Speeds) -> Vec<Shape> {
        Vec::new()
    }
    /// One column per term at the full rate. `sign` is the smoothed sign of the velocity.
    fn columns(&self, signals: &Signals, sign: &[f64], shapes: &[f64]) -> Vec<Vec<f64>>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_unique_and_needs_exist() {
        for (i, effect) in ALL.iter().enumerate() {
            assert!(ALL[..i].iter().all(|other| other.id() != effect.id()), "{}", effect.id());
            assert!(!effect.sites().is_empty() && !effect.words().is_empty());
            for need in effect.inverse().map_or(&[][..], InverseEffect::needs) {
                assert!(find(need).is_some(), "{need}");
            }
        }
    }
}
