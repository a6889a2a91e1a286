//! The effects of drives, elements and oscillators as parts of a model. Each is declared in its own
//! file of the plant ([`plant::effects::one_channel`]).

use plant::effects::entry;

pub use plant::effects::of_one_channel as all;
pub use plant::effects::one_channel::{
    Axis, Declared, Instant, OneChannel as Effect, Shape, Spacing, Term, Units, View,
};

/// The effect of that id.
pub fn find(id: &str) -> Option<&'static Effect> {
    entry(id)?.one_channel
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
                load: view.model.get(i).copied().unwrap_or(0.0),
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
    use plant::effects::Site;

    use super::*;

    /// An axis with a spring or without, with an amplifier or without.
    fn axis(spring: bool, commanded: bool) -> Axis {
        Axis {
            units: Units::ROTARY,
            rotary: true,
            turn: None,
            spring,
            commanded,
            positions: (-3.0, 3.0),
            velocity_rms: 0.5,
            velocity_peak: 1.0,
            force_rms: 1.0,
            force_peak: 3.0,
            seconds: 20.0,
            cut_off: 40.0,
        }
    }

    #[test]
    fn every_effect_has_columns_on_some_machine() {
        let machines = [axis(false, false), axis(false, true), axis(true, false), axis(true, true)];
        for effect in all() {
            let machine = machines.iter().find(|axis| (effect.applies)(axis));
            let machine = machine.unwrap_or_else(|| panic!("nothing searches {}", effect.id));
            assert!(!(effect.terms)(machine).is_empty(), "{}", effect.id);
            assert!(effect.columns.is_some() || effect.force.is_some(), "{}", effect.id);
            assert!(!effect.words.is_empty() && !effect.experiment.is_empty(), "{}", effect.id);
            assert!(effect.sites.iter().all(|site| Site::from_name(site).is_some()));
        }
    }

    #[test]
    fn ids_are_unique_and_needs_exist() {
        let listed = all();
        for (i, effect) in listed.iter().enumerate() {
            assert!(listed[..i].iter().all(|other| other.id != effect.id), "{}", effect.id);
            assert!(!effect.sites.is_empty(), "{}", effect.id);
            for need in effect.needs.iter().chain(&effect.refines) {
                assert!(find(need).is_some(), "{need}");
            }
        }
    }
}
