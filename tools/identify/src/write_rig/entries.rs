//! Effects found, with the names of rig files, which are those of the plant.
//!
//! Transmissions are identified by simulation of the plant: ids, names and units are the plant's.
//! Drives, oscillators and elements are fitted by columns of the force that the motion requires,
//! whose amplitudes and shapes have other names. Where the plant's effect of the same id has the
//! same law, its names are written, as the effect declares them (`of_plant`). Other effects are
//! left out, with a message; so are effects in another unit, as all forces of an oscillator, which
//! are in volts, or beyond the range of the plant, as an excess below 0.

use plant::effects::one_channel::{DeclaredFit, FittedEffect, Quantity};
use plant::effects::parse;
use rig::Model as Declared;

use crate::effects::find;
use crate::outcome::{EffectParameter, FittedParameter, FoundEffect, Outcome};

/// Effects as entries of a rig file.
#[derive(Default)]
pub(super) struct Entries<'o> {
    /// Effects that can be written, with the names of rig files.
    pub(super) effects: Vec<FoundEffect>,
    /// Parameters that stay as declared, because the excess is written as an effect.
    pub(super) beside: Vec<&'o str>,
    /// Effects that cannot be written, and why.
    pub(super) left_out: Vec<String>,
}

/// The effects of an outcome for the declared model of its rig file.
pub(super) fn entries<'o>(outcome: &'o Outcome, declared: &Declared) -> Entries<'o> {
    if declared.kind.is_transmission() {
        return Entries { effects: outcome.effects.clone(), ..Entries::default() };
    }
    let turn = declared.motor_turn();
    let fit = Fit { parameters: &outcome.parameters, turn };
    let mut entries = Entries::default();
    for effect in &outcome.effects {
        let exceeded = fit.exceeded(effect).map(|parameter| parameter.name.as_str());
        match fit.in_words_of_the_plant(effect) {
            Ok(written) => {
                entries.beside.extend(exceeded);
                entries.effects.push(written);
            }
            Err(why) => {
                let instead = match exceeded {
                    Some(name) => format!("{name} has all of the fitted value instead"),
                    None => "the parameters are as fitted beside it".to_owned(),
                };
                entries
                    .left_out
                    .push(format!("{} at the {}: {why}; {instead}", effect.id, effect.site));
            }
        }
    }
    entries
}

/// The fit that the effects are part of.
struct Fit<'o> {
    /// Parameters as fitted.
    parameters: &'o [FittedParameter],
    /// Position per motor turn, where it is declared.
    turn: Option<f64>,
}

impl<'o> Fit<'o> {
    /// The declared parameter whose tolerance the effect lifts: one column is fitted for both, and
    /// the effect is the excess of its amplitude over the declared value.
    fn exceeded(&self, effect: &FoundEffect) -> Option<&'o FittedParameter> {
        find(&effect.id)?.lifts?;
        self.declared_in(&effect.parameters.first()?.unit)
    }

    /// The declared parameter with a unit: mass, damping and stiffness have different units, with
    /// one parameter each.
    fn declared_in(&self, unit: &str) -> Option<&'o FittedParameter> {
        self.parameters
            .iter()
            .find(|parameter| parameter.declared.is_some() && parameter.unit == unit)
    }

    /// The effect with the plant's names, or why there is none.
    fn in_words_of_the_plant(&self, effect: &FoundEffect) -> Result<FoundEffect, String> {
        let parameters = self.parameters_of_the_plant(effect).ok_or_else(|| {
            let own: Vec<String> =
                effect.parameters.iter().map(|own| format!("`{}`", own.name)).collect();
            format!("rig files have nothing that means the same as its {}", own.join(", "))
        })?;
        let mut of_plant =
            parse(&format!("{}@{}", effect.id, effect.site)).map_err(|error| error.to_string())?;
        for EffectParameter { name, value, unit, .. } in &parameters {
            let wanted =
                of_plant.infos().iter().find(|info| info.name == name).map_or("", |info| info.unit);
            if !is_same_unit(wanted, unit) {
                return Err(format!(
                    "rig files have its `{name}` in {wanted}, and it was found in {unit}"
                ));
            }
            of_plant.set(name, *value).map_err(|error| error.to_string())?;
        }
        Ok(FoundEffect { parameters, ..effect.clone() })
    }

    /// Its parameters with the plant's names; `None` if they mean something else there.
    fn parameters_of_the_plant(&self, effect: &FoundEffect) -> Option<Vec<EffectParameter>> {
        let parameters: Vec<Quantity<'_>> = effect
            .parameters
            .iter()
            .map(|own| Quantity { name: &own.name, value: own.value, unit: &own.unit })
            .collect();
        let declared = |parameter: &'o FittedParameter| {
            let (fitted, unit) = (parameter.fitted, parameter.unit.as_str());
            Some(DeclaredFit { declared: parameter.declared?, fitted, unit })
        };
        let declared: Vec<DeclaredFit<'_>> = self.parameters.iter().filter_map(declared).collect();
        let fit = FittedEffect {
            site: &effect.site,
            parameters: &parameters,
            declared: &declared,
            turn: self.turn,
        };
        let of_plant = (find(&effect.id)?.of_plant)(&fit)?;
        Some(of_plant.iter().map(|own| named(own.name, own.value, own.unit)).collect())
    }
}

fn named(name: &str, value: f64, unit: &str) -> EffectParameter {
    EffectParameter { name: name.to_owned(), value, std: None, unit: unit.to_owned() }
}

/// Whether a unit of the plant, with that of a rotary machine first and that of a linear one in
/// brackets, is the unit of the fit.
fn is_same_unit(of_plant: &str, of_fit: &str) -> bool {
    const SPELLED: [(&str, &str); 4] =
        [("(m/s)⁻²", "s²/m²"), ("(rad/s)⁻²", "s²/rad²"), ("·", " "), ("²", "^2")];
    let spelled = SPELLED.iter().fold(of_fit.to_owned(), |unit, (from, to)| unit.replace(from, to));
    // A rotary drive reads N·m where an amplifier's unit is "V (N)".
    let is = |unit: &str| unit == spelled || (unit == "N" && spelled == "N m");
    of_plant.trim_end_matches(')').split(" (").any(is)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::effects::{Axis, Effect, Units};
    use crate::outcome::Identifiability;

    const DRIVE: &[&str] = &["master", "drive", "sensor"];
    const ELEMENT: &[&str] = &["line", "slave", "sensor"];
    const OSCILLATOR: &[&str] = &["line", "slave", "drive", "sensor"];

    fn axis(units: Units, spring: bool, commanded: bool) -> Axis {
        let rotary = units.position == "rad";
        Axis {
            units,
            rotary,
            turn: rotary.then_some(TAU),
            spring,
            commanded,
            positions: (-1.0, 1.0),
            velocity_rms: 0.1,
            velocity_peak: 0.3,
            force_rms: 1.0,
            force_peak: 3.0,
            seconds: 10.0,
            cut_off: 40.0,
        }
    }

    /// A listed effect as a fit tells it, all values 1.
    fn found(effect: &Effect, site: &str, axis: &Axis) -> FoundEffect {
        let terms = (effect.terms)(axis)
            .into_iter()
            .filter(|term| !term.is_given())
            .map(|term| (term.name, term.unit));
        let shapes = (effect.shapes)(axis).into_iter().map(|shape| (shape.name, shape.unit));
        let parameters = terms.chain(shapes).map(|(name, unit)| named(&name, 1.0, &unit)).collect();
        FoundEffect {
            id: effect.id.into(),
            site: site.into(),
            parameters,
            t: 9.0,
            gain_percent: 40.0,
        }
    }

    /// Of these effects, those that can be written for such a machine.
    fn written(axis: &Axis, sites: &[&str], ids: &[&'static str]) -> Vec<&'static str> {
        let stiffness = FittedParameter {
            name: "stiffness".into(),
            declared: Some(4.0),
            fitted: 2.0,
            std: None,
            unit: axis.units.stiffness.into(),
            identifiable: false,
            at_tolerance: false,
            identifiability: Identifiability::Weak,
            trades_with: None,
        };
        let fit = Fit { parameters: &[stiffness], turn: axis.turn };
        let is_written = |id: &&'static str| {
            let effect = find(id).unwrap();
            let site = sites.iter().find(|site| effect.sites.contains(site)).unwrap();
            fit.in_words_of_the_plant(&found(effect, site, axis)).is_ok()
        };
        ids.iter().copied().filter(is_written).collect()
    }

    #[test]
    fn effects_with_the_same_law_are_written_with_the_plants_names() {
        const FRICTION: [&str; 5] = [
            "coulomb_friction",
            "stribeck_friction",
            "viscous_friction",
            "extra_inertia",
            "quadratic_drag",
        ];
        const AMPLIFIER: [&str; 3] =
            ["amplifier_deadzone", "amplifier_saturation", "amplifier_lag"];
        const DRIVE_ALONE: [&str; 3] = ["torque_ripple", "transport_delay", "periodic_disturbance"];
        const LINE: [&str; 2] = ["viscoelastic_line", "line_compliance"];
        // Fractions of what the plant has already, or of another instrument.
        const OTHERS: [&str; 5] = [
            "asymmetric_friction",
            "load_dependent_friction",
            "presliding_hysteresis",
            "thermal_drift",
            "sensor_drift",
        ];
        let of_drive = [&FRICTION[..], &AMPLIFIER, &DRIVE_ALONE].concat();
        let linear = axis(Units::LINEAR, false, true);
        assert_eq!(written(&linear, DRIVE, &of_drive), of_drive);
        assert!(written(&linear, DRIVE, &OTHERS).is_empty());
        let of_drive = [&of_drive[..], &["gravity_imbalance"]].concat();
        assert_eq!(written(&axis(Units::ROTARY, false, true), DRIVE, &of_drive), of_drive);
        let element = axis(Units::LINEAR, true, false);
        let of_line = [&FRICTION[..], &LINE, &["line_damping", "periodic_disturbance"]].concat();
        assert_eq!(written(&element, ELEMENT, &of_line), of_line);
        assert!(written(&element, ELEMENT, &["backlash", "nonlinear_stiffness"]).is_empty());
        // Of volts the plant has an amplifier's alone.
        let oscillator = axis(Units::VOLTS, true, true);
        let of_volts = [&LINE[..], &AMPLIFIER].concat();
        assert_eq!(written(&oscillator, OSCILLATOR, &of_volts), of_volts);
        let in_newtons = [&FRICTION[..], &["line_damping", "periodic_disturbance"]].concat();
        assert!(written(&oscillator, OSCILLATOR, &in_newtons).is_empty());
    }

    #[test]
    fn units_are_compared_despite_different_spelling() {
        for (of_plant, of_fit) in [
            ("N m (N)", "N"),
            ("N m (N)", "N·m"),
            ("V (N)", "N·m"),
            ("kg m^2 (kg)", "kg·m²"),
            ("N m s^2/rad^2 (N s^2/m^2)", "N·(m/s)⁻²"),
            ("N m s^2/rad^2 (N s^2/m^2)", "N·m·(rad/s)⁻²"),
        ] {
            assert!(is_same_unit(of_plant, of_fit), "{of_plant} {of_fit}");
        }
        for (of_plant, of_fit) in
            [("N m (N)", "V"), ("kg m^2 (kg)", "s²"), ("N s/m", "N·m·s/rad"), ("", "N")]
        {
            assert!(!is_same_unit(of_plant, of_fit), "{of_plant} {of_fit}");
        }
    }
}
