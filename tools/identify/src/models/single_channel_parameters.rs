//! Parameters of an equation-error model and of its effects.

use crate::effects::{Declared, Term};
use crate::equation_error::model::{Column, Fitted, RegressionModel};
use crate::outcome::{EffectParameter, FittedParameter, Identifiability};
use crate::selection::candidates::FittedModel;

/// Parameters of the effect at one place of a fitted structure.
pub(super) fn effect_parameters(
    regression: &RegressionModel,
    model: &FittedModel<'_>,
    at: usize,
) -> Vec<EffectParameter> {
    let FittedModel { structure, fitted, .. } = model;
    let Some(regressor) = structure.effects.get(at).copied() else { return Vec::new() };
    let before =
        structure.effects[..at].iter().map(|e| regression.terms_of(*e).len()).sum::<usize>();
    let mut amplitude = regression.parameters.len() + before;
    let mut parameters = Vec::new();
    for term in regressor.terms(&regression.axis) {
        let (value, std) =
            match regressor.declaration().lifts.filter(|_| regression.frees(regressor)) {
                // Its amplitude is the excess of the declared parameter over its declared value.
                Some(which) => lifted(regression, fitted, which),
                None => {
                    amplitude += 1;
                    (fitted.fit.coefficients[amplitude - 1], fitted.std[amplitude - 1])
                }
            };
        if !term.is_given() {
            parameters.push(EffectParameter {
                name: term.name,
                value,
                std: Some(std),
                unit: term.unit,
            });
        }
    }
    let place = regression.places(structure)[at].clone();
    for (shape, value) in
        (regressor.declaration().shapes)(&regression.axis).into_iter().zip(&fitted.shapes[place])
    {
        parameters.push(EffectParameter {
            name: shape.name,
            value: *value,
            std: None,
            unit: shape.unit,
        });
    }
    parameters
}

/// Returns the excess of a declared parameter over its declared value, with its standard deviation.
fn lifted(regression: &RegressionModel, fitted: &Fitted, which: Declared) -> (f64, f64) {
    let at = regression.parameters.iter().position(|p| p.column == Column::of(which));
    at.map_or((0.0, 0.0), |i| {
        (fitted.fit.coefficients[i] - regression.parameters[i].declared, fitted.std[i])
    })
}

/// Names of the amplitudes of a model, in their order; none for the terms of a nonparametric
/// function.
pub(super) fn names(regression: &RegressionModel, model: &FittedModel<'_>) -> Vec<Option<String>> {
    let declared = regression.parameters.iter().map(|own| Some(own.name.clone()));
    let of_effects = model.structure.effects.iter().flat_map(|effect| {
        let id = effect.declaration().id;
        let name = move |term: Term| (!term.is_given()).then(|| format!("{} of {id}", term.name));
        regression.terms_of(*effect).into_iter().map(name)
    });
    declared.chain(of_effects).collect()
}

/// Declared parameters, as fitted.
pub(super) fn parameters(
    regression: &RegressionModel,
    model: &FittedModel<'_>,
) -> Vec<FittedParameter> {
    let last = &model.fitted;
    let mut out: Vec<FittedParameter> = regression
        .parameters
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let at_tolerance = last.fit.at_bound[i];
            // The records must say more than the declaration did.
            let identifiable = !at_tolerance && last.std[i] < p.spread;
            FittedParameter {
                name: p.name.clone(),
                declared: Some(p.declared),
                fitted: last.fit.coefficients[i],
                std: (!at_tolerance).then_some(last.std[i]),
                unit: p.unit.to_owned(),
                identifiable,
                at_tolerance,
                identifiability: identifiability(identifiable, at_tolerance),
                trades_with: None,
            }
        })
        .collect();
    let shapes = regression.shapes(&model.structure);
    if let Some(smoothing) = shapes.first().filter(|s| s.points > 1) {
        let fitted = last.shapes[0];
        let identifiable = fitted > 1.05 * smoothing.low && fitted < 0.95 * smoothing.high;
        out.push(FittedParameter {
            name: smoothing.name.clone(),
            declared: None,
            fitted,
            std: None,
            unit: smoothing.unit.clone(),
            identifiable,
            at_tolerance: false,
            identifiability: identifiability(identifiable, false),
            trades_with: None,
        });
    }
    out
}

/// Identifiability of one of few additive terms.
const fn identifiability(identifiable: bool, at_tolerance: bool) -> Identifiability {
    match (at_tolerance, identifiable) {
        (true, _) => Identifiability::AtBound,
        (false, true) => Identifiability::Identified,
        (false, false) => Identifiability::Weak,
    }
}
