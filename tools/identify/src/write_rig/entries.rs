//! Effects found, with the names of rig files, which are those of the plant.
//!
//! Transmissions are identified by simulation of the plant: ids, names and units are the plant's.
//! Drives, oscillators and elements are fitted by columns of the force that the motion requires,
//! whose amplitudes and shapes have other names. Where the plant's effect of the same id has the
//! same law, its names are written. Other effects are left out, with a message:
//!
//! - `asymmetric_friction`: the plant's viscous difference comes with a dry one, which the fit
//!   cannot distinguish from the offset;
//! - `load_dependent_friction`: the fit's coefficient refers to the force without this friction,
//!   the plant's to all that is transmitted;
//! - `position_dependent_friction`, `presliding_hysteresis`, `thermal_drift`: the plant's are
//!   fractions of the friction of the side;
//! - `backlash`, `nonlinear_stiffness`: the plant's gap is centred at zero and takes the whole
//!   force, and its nonlinear spring is scaled by a reference force;
//! - `transport_delay` at sites other than the drive: the plant's line carries waves;
//! - `sensor_drift`, `mains_hum`: the plant's act on the torque cell of a transmission;
//! - effects in another unit, as all forces of an oscillator, which are in volts, or beyond the
//!   range of the plant, as an excess below 0.

use std::f64::consts::TAU;

use plant::effects::{Site, parse};
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

/// Effects with the same law and the same number of parameters in the plant: names of the fit and
/// of the plant.
const RENAMED: &[(&str, &[(&str, &str)])] = &[
    ("coulomb_friction", &[("coulomb", "level")]),
    ("stribeck_friction", &[("stribeck", "level"), ("stribeck_speed", "speed")]),
    ("viscous_friction", &[("viscous_beyond_declared", "coefficient")]),
    ("extra_inertia", &[("mass_beyond_declared", "inertia")]),
    ("quadratic_drag", &[("coefficient", "coefficient")]),
    ("line_damping", &[("damping_beyond_declared", "damping")]),
    ("amplifier_deadzone", &[("half_width", "half_width")]),
    ("amplifier_saturation", &[("limit", "limit")]),
    ("amplifier_lag", &[("time_constant", "time_constant")]),
    ("transport_delay", &[("delay", "delay_s")]),
];

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
        let own = |name: &str| effect.parameters.iter().find(|own| own.name == name);
        // `sign` is -1 where the plant's wave drives the machine: the fit's wave is the force
        // required to overcome it.
        let wave = |size: &str, sign: f64| {
            let (sine, cosine) = (own("sine")?, own("cosine")?);
            let (along, across) = (sign * sine.value, sign * cosine.value);
            Some(vec![
                named(size, along.hypot(across), &sine.unit),
                named("phase", across.atan2(along), "rad"),
            ])
        };
        match effect.id.as_str() {
            "transport_delay" if effect.site != Site::Drive.name() => None,
            "gravity_imbalance" => wave("torque", 1.0),
            "periodic_disturbance" => {
                let frequency = own("frequency")?;
                let mut parameters = wave("amplitude", -1.0)?;
                parameters.push(named("frequency_hz", frequency.value, &frequency.unit));
                Some(parameters)
            }
            "torque_ripple" => {
                let order = own("order")?;
                // The plant counts waves per 2π of the position.
                let turn = if order.unit == "waves/m" { 1.0 } else { self.turn.unwrap_or(TAU) };
                let mut parameters = wave("amplitude", -1.0)?;
                parameters.push(named("order", TAU * order.value / turn, "1"));
                Some(parameters)
            }
            "line_compliance" => {
                // Springs in series: 1/k = (1 + r)/k_declared.
                let stiffness = self.exceeded(effect)?;
                Some(vec![named(
                    "compliance_ratio",
                    stiffness.declared? / stiffness.fitted - 1.0,
                    "1",
                )])
            }
            "viscoelastic_line" => {
                let (branch, relaxation) = (own("branch_stiffness")?, own("relaxation")?);
                // The plant's branch is relative to the spring in parallel, added compliance
                // included.
                let stiffness = self.declared_in(&branch.unit)?.fitted;
                let ratio = named("stiffness_ratio", branch.value / stiffness, "1");
                Some(vec![ratio, named("relaxation_s", relaxation.value, &relaxation.unit)])
            }
            id => {
                let (_, names) = RENAMED.iter().find(|(renamed, _)| *renamed == id)?;
                let renamed = |own: &EffectParameter| {
                    let (_, name) = names.iter().find(|(of_fit, _)| *of_fit == own.name)?;
                    Some(named(name, own.value, &own.unit))
                };
                effect.parameters.iter().map(renamed).collect()
            }
        }
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
    use super::*;
    use crate::effects::{ALL, Axis, Effect, Units};
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

    /// Ids of the listed effects that can be written, of all that such a machine can have.
    fn written(axis: &Axis, sites: &[&str]) -> Vec<&'static str> {
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
        let can_be = ALL.iter().filter(|effect| (effect.applies)(axis));
        let is_written = |effect: &&Effect| {
            let site = sites.iter().find(|site| effect.sites.contains(site)).unwrap();
            fit.in_words_of_the_plant(&found(effect, site, axis)).is_ok()
        };
        can_be.filter(is_written).map(|effect| effect.id).collect()
    }

    #[test]
    fn effects_with_the_same_law_are_written_with_the_plants_names() {
        let of_friction = [
            "coulomb_friction",
            "stribeck_friction",
            "viscous_friction",
            "extra_inertia",
            "quadratic_drag",
        ];
        let of_drive = [
            "torque_ripple",
            "amplifier_deadzone",
            "amplifier_saturation",
            "amplifier_lag",
            "transport_delay",
            "periodic_disturbance",
        ];
        let linear = written(&axis(Units::LINEAR, false, true), DRIVE);
        assert_eq!(linear, [&of_friction[..], &of_drive].concat());
        let rotary = written(&axis(Units::ROTARY, false, true), DRIVE);
        assert_eq!(rotary, [&of_friction[..], &["gravity_imbalance"], &of_drive].concat());
        let of_line =
            ["viscoelastic_line", "line_compliance", "line_damping", "periodic_disturbance"];
        let element = written(&axis(Units::LINEAR, true, false), ELEMENT);
        assert_eq!(element, [&of_friction[..], &of_line].concat());
        // Of volts the plant has an amplifier's alone.
        let oscillator = written(&axis(Units::VOLTS, true, true), OSCILLATOR);
        let expected = [
            "viscoelastic_line",
            "line_compliance",
            "amplifier_deadzone",
            "amplifier_saturation",
            "amplifier_lag",
        ];
        assert_eq!(oscillator, expected);
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
