//! The declared model: names and ranges of its parameters, its effects, the shared handle.

use plant::coupled_axes::{CouplingError, HandleCoupling, LEAST_EIGENVALUE};
use plant::effects::EffectError;
use plant::transmission_kinds::Parameters;
use plant::{ParameterError, ParameterInfo};

use crate::axis::Axis;
use crate::checked_toml::{Source, nearest};
use crate::effect::{ModelEffect, ModelEffectError};
use crate::model::{Model, ModelKind};
use crate::parameter::Parameter;
use crate::siso_parameters::{self, FORCE_PER_VOLT};

/// Checks the model, also with each axis's own parameters.
pub(super) fn check(model: &Model, axes: &[Axis], source: &Source<'_>) {
    check_parameters(model.kind, "model.parameters", &model.parameters, source);
    for (at, axis) in axes.iter().enumerate() {
        let table = format!("axes.{at}.model");
        if !axis.model.is_empty() && !model.kind.is_transmission() {
            let found = format!("the model \"{}\"", model.kind.name());
            let expected = "a transmission of the axis's own";
            source.problem(&table, expected, found, "take the section out");
        } else {
            check_parameters(model.kind, &table, &axis.model, source);
        }
    }
    if model.force.is_some() && model.kind.is_transmission() {
        let found = format!("the model \"{}\"", model.kind.name());
        let expected = "a drive, an element or an oscillator, which have one measured channel";
        source.problem("model.force", expected, found, "take the key out");
    }
    let has_motor = FORCE_PER_VOLT.iter().any(|name| model.parameter(name).is_some());
    if model.kind == ModelKind::Drive && !axes.is_empty() && !has_motor {
        let [name, _] = FORCE_PER_VOLT;
        let advice = format!("add {name} = {{ value = … }}, in N/V");
        source.problem("model.parameters", format!("`{name}`"), "nothing", advice);
    }
    if source.is_clean() {
        check_effects(model, axes, source);
    }
    if source.is_clean() && !model.handle_coupling.is_empty() {
        check_coupling(model, axes, source);
    }
}

fn check_parameters(kind: ModelKind, table: &str, parameters: &[Parameter], source: &Source<'_>) {
    let of_drive = siso_parameters::of_drive();
    let infos: &[ParameterInfo] = match kind {
        ModelKind::Transmission(kind) => kind.infos(),
        ModelKind::Drive => &of_drive,
        ModelKind::Oscillator => siso_parameters::OSCILLATOR,
        ModelKind::Element => siso_parameters::ELEMENT,
    };
    let infos = || infos.iter();
    for parameter in parameters {
        let key = format!("{table}.{}", parameter.name);
        let Some(info) = infos().find(|info| info.name == parameter.name) else {
            let names: Vec<_> = infos().map(|info| info.name).collect();
            let advice = match nearest(&parameter.name, names.iter().copied()) {
                Some(name) => format!("did you mean `{name}`?"),
                None => format!("the model has {}", names.join(", ")),
            };
            let expected = format!("a parameter of the {} model", kind.name());
            source.problem(&key, expected, "an unknown key", advice);
            continue;
        };
        if !(info.minimum..=info.maximum).contains(&parameter.value) {
            let expected = format!("{} to {} {}", info.minimum, info.maximum, info.unit);
            let advice = format!("the value is in {}; printed is {}", info.unit, info.printed);
            source.problem(&key, expected, parameter.value, advice);
        }
    }
}

/// Whether no effect is listed twice, and each can act in the transmission of its axis, or of every
/// axis.
fn check_effects(model: &Model, axes: &[Axis], source: &Source<'_>) {
    let mut listed: Vec<(String, &ModelEffect)> = Vec::new();
    for (at, effect) in model.effects.iter().enumerate() {
        let key = format!("model.effects.{at}");
        check_listed_once(&key, effect, &listed, source);
        if axes.is_empty() {
            check_effect(&key, effect, None, source);
        }
        for axis in axes {
            check_effect(&key, effect, model.of_axis(&axis.model, "").ok(), source);
            if !source.is_clean() {
                break;
            }
        }
        listed.push((key, effect));
    }
    for (number, axis) in axes.iter().enumerate() {
        let mut listed = listed.clone();
        for (at, effect) in axis.effects.iter().enumerate() {
            let key = format!("axes.{number}.effects.{at}");
            check_listed_once(&key, effect, &listed, source);
            check_effect(&key, effect, model.of_axis(&axis.model, "").ok(), source);
            listed.push((key, effect));
        }
    }
}

/// Whether none of the effects listed before is the same.
fn check_listed_once(
    key: &str,
    effect: &ModelEffect,
    listed: &[(String, &ModelEffect)],
    source: &Source<'_>,
) {
    let same = |other: &ModelEffect| (other.id, other.site) == (effect.id, effect.site);
    if let Some((before, _)) = listed.iter().find(|(_, other)| same(other)) {
        let expected = format!("an effect of its own ({before} has it already)");
        let found = format!("{} at {}", effect.id, effect.site);
        source.problem(&format!("{key}.id"), expected, found, "take one of the two out");
    }
}

/// Checks the effect at `key`: id, site and parameters, and whether it can act in the transmission,
/// if the model is one.
fn check_effect(
    key: &str,
    effect: &ModelEffect,
    transmission: Option<Parameters>,
    source: &Source<'_>,
) {
    let parameter_key = |name: &str| format!("{key}.parameters.{name}");
    match effect.make() {
        Err(ModelEffectError::Effect(EffectError::WrongSite { allowed, .. })) => {
            let expected = format!("a site of {}: {allowed}", effect.id);
            let found = format!("\"{}\"", effect.site);
            source.problem(&format!("{key}.site"), expected, found, "name the site");
        }
        Err(ModelEffectError::Parameter(ParameterError::Unknown { name, known })) => {
            let advice = match nearest(&name, known.split(", ")) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("it has {known}"),
            };
            let expected = format!("a parameter of {}", effect.id);
            source.problem(&parameter_key(&name), expected, "an unknown key", advice);
        }
        Err(ModelEffectError::Parameter(ParameterError::OutOfRange {
            name,
            value,
            minimum,
            maximum,
            unit,
        })) => {
            let expected = format!("{minimum} to {maximum} {unit}");
            let advice = format!("the value is in {unit}");
            source.problem(&parameter_key(name), expected, value, advice);
        }
        Err(other) => {
            let advice = "correct the entry, or take it out";
            source.problem(key, "an effect of the model", other, advice);
        }
        Ok(made) => {
            if let Some(constants) = transmission
                && let Err(error) = constants.plant(vec![made])
            {
                let expected = "an effect that acts in this transmission";
                source.problem(key, expected, error, "take the entry out");
            }
        }
    }
}

/// Whether a physical handle can have these products of inertia.
fn check_coupling(model: &Model, axes: &[Axis], source: &Source<'_>) {
    let key = "model.handle_coupling_kg_m2";
    let inertia = |axis: &Axis| model.of_axis(&axis.model, "").map(|own| own.slave_inertia_kg_m2());
    let Ok(inertia) = axes.iter().map(inertia).collect::<Result<Vec<_>, _>>() else {
        let found = format!("the model \"{}\"", model.kind.name());
        let expected = "a transmission, whose slave is at the handle";
        source.problem(key, expected, found, "take the key out");
        return;
    };
    match HandleCoupling::of_pairs(axes.len(), &model.handle_coupling)
        .and_then(|handle| handle.check(&inertia))
    {
        Ok(_) => {}
        Err(CouplingError::TooStrong { found }) => {
            let expected = format!(
                "a handle with at least {LEAST_EIGENVALUE} of the axes' own inertia \
                 in every direction"
            );
            let found = format!("{:?} with a least of {found:.3}", model.handle_coupling);
            let advice = "for two axes: at most 0.8 times the root of the product of their \
                          slaves' inertia";
            source.problem(key, expected, found, advice);
        }
        Err(_) => {
            let pairs = axes.len() * (axes.len() - 1) / 2;
            let expected = format!("{pairs} numbers, one for each pair of the {} axes", axes.len());
            let advice = "in the order first and second axis, first and third, second and third";
            source.problem(key, expected, model.handle_coupling.len(), advice);
        }
    }
}
