//! Nonparametric functions of one variable, fitted beside a model.

use std::sync::Arc;

use super::adequacy::MOST_NOISE;
use super::candidates::FittedModel;
use super::forward_selection::{Search, starting_point};
use super::predictor::Predictor;
use super::validation::{LEAST_T, Validation, validate};
use crate::effects::Regressor;
use crate::equation_error::block_roles::Block;
use crate::equation_error::fit::ShapeSearch;
use crate::equation_error::model::{Fitted, Structure};
use crate::equation_error::spline::{Spline, Variable};

/// Least gain of a nonparametric function in screening for which it is simulated (%).
const LEAST_NONPARAMETRIC_PERCENT: f64 = 3.0;

/// Least gain of a function of the acceleration (%). The acceleration is the position's second
/// derivative and has its noise: the force over a variable with noise bends although the law is
/// straight (errors in variables), and a function takes a part of what the noise leaves.
const LEAST_OF_ACCELERATION_PERCENT: f64 = 30.0;

/// A residual that no listed effect explains, as a function of one variable.
#[derive(Clone, Debug)]
pub struct Unlisted {
    /// What it depends on.
    pub variable: Variable,
    /// Abscissa, force, standard deviation.
    pub table: Vec<[f64; 3]>,
}

impl Unlisted {
    /// The table of a fitted spline, whose amplitudes are the last of the model.
    pub(super) fn new(variable: Variable, spline: &Spline, fitted: &Fitted) -> Self {
        let from = fitted.fit.coefficients.len() - spline.knots.len();
        let row = |(i, knot): (usize, &f64)| {
            [*knot, fitted.fit.coefficients[from + i], fitted.std[from + i]]
        };
        Self { variable, table: spline.knots.iter().enumerate().map(row).collect() }
    }
}

/// A nonparametric function of one variable, fitted beside the model.
pub struct NonparametricFit {
    /// Its validation.
    pub validation: Validation,
    /// Its table.
    pub unlisted: Unlisted,
    /// Rms of its force on the selection rows.
    pub size: f64,
    /// Whether it was screened by its equation error only.
    pub screened_only: bool,
}

impl Search<'_> {
    /// A function of a variable with knots over the fitted rows; `None` if it does not vary.
    pub(super) fn function_of(&self, variable: Variable) -> Option<Spline> {
        let balances = &self.predictor.regression().balances;
        let mut values = Vec::new();
        for block in &self.fit {
            let signals = &balances[block.record].signals;
            values.extend_from_slice(&signals.rows(variable.values(signals))[block.rows.clone()]);
        }
        Spline::over(variable, values)
    }

    /// Whether most of what a model leaves on the selecting rows is noise of the position, over
    /// which a function of the acceleration bends.
    pub(super) fn leaves_noise_of_position(&self, model: &FittedModel<'_>) -> bool {
        let (error, _) = self.predictor.error(&model.fitted, &self.select);
        let noise = self.predictor.noise_square(&model.structure, &model.fitted, &self.select);
        noise > MOST_NOISE * error * error
    }

    /// Mean squared residuals of a model without what noise of the position leaves.
    pub(super) fn less_noise_of_position(
        &self,
        model: &FittedModel<'_>,
        errors: &[f64],
    ) -> Vec<f64> {
        let less = |(block, error): (&Block, &f64)| {
            let block = std::slice::from_ref(block);
            let noise = self.predictor.noise_square(&model.structure, &model.fitted, block);
            (error - noise).max(0.0)
        };
        self.select.iter().zip(errors).map(less).collect()
    }

    /// Fits nonparametric functions of one variable to the residual; best first.
    pub(super) fn nonparametric(&self, current: &FittedModel<'_>) -> Vec<NonparametricFit> {
        let least_percent = self.least_percent(&current.fitted);
        let noisy = self.leaves_noise_of_position(current);
        let one = |variable: Variable| {
            let mut one = self.nonparametric_in(current, variable)?;
            one.validation.accepted &= one.validation.gain_percent >= least_percent;
            let small = one.validation.gain_percent < LEAST_OF_ACCELERATION_PERCENT;
            one.validation.exclude_if(variable == Variable::Acceleration && (small || noisy));
            Some(one)
        };
        let mut tried: Vec<NonparametricFit> = Variable::ALL.into_iter().filter_map(one).collect();
        let gain = |tried: &NonparametricFit| tried.validation.gain_percent;
        tried.sort_by(|a, b| {
            a.screened_only.cmp(&b.screened_only).then(gain(b).total_cmp(&gain(a)))
        });
        tried
    }

    fn nonparametric_in(
        &self,
        current: &FittedModel<'_>,
        variable: Variable,
    ) -> Option<NonparametricFit> {
        let (regression, known) = (self.predictor.regression(), current.equation_error_fit());
        let spline = self.function_of(variable)?;
        let effects =
            current.structure.effects.iter().copied().chain([&spline as &dyn Regressor]).collect();
        let wider = Structure { effects, model: Arc::clone(&current.structure.model) };
        // Shapes are held: a spline must not compensate for a worse smoothing speed.
        let fitted = regression.fit(&wider, &self.fit, &known.shapes, ShapeSearch::Fixed)?;
        let [before, after] =
            [known, &fitted].map(|fitted| self.screening().mean_squares(fitted, &self.select));
        let mut validation = validate(variable.name(), &before, &after);
        validation.exclude_if(!self.passes_while_moving(current, &fitted));
        let screened = NonparametricFit {
            validation,
            unlisted: Unlisted::new(variable, &spline, &fitted),
            size: regression.size_of_last(&fitted, spline.knots.len(), &self.select),
            screened_only: false,
        };
        let Predictor::OutputError(simulation) = self.predictor else { return Some(screened) };
        let Validation { t, gain_percent, .. } = screened.validation;
        let shows = t >= LEAST_T && gain_percent > LEAST_NONPARAMETRIC_PERCENT;
        let smoothed = regression.uses_sign(&current.structure);
        let start = starting_point(&fitted, &current.fitted, smoothed);
        let simulate = || simulation.fit(&wider, &self.fit, &start, &[]);
        let simulated = (shows && spline.is_force()).then(simulate).flatten();
        let Some(fitted) = simulated else {
            let validation = Validation { accepted: false, ..screened.validation };
            return Some(NonparametricFit { validation, screened_only: true, ..screened });
        };
        let [before, after] = [&current.fitted, &fitted]
            .map(|fitted| self.predictor.mean_squares(fitted, &self.select));
        let validation = validate(variable.name(), &before, &after);
        let unlisted = Unlisted::new(variable, &spline, &fitted);
        Some(NonparametricFit { validation, unlisted, ..screened })
    }
}
