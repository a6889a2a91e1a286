//! The next experiment, by the open question.

use crate::equation_error::model::RegressionModel;
use crate::equation_error::spline::Variable;
use crate::outcome::{FittedParameter, NextExperiment};
use crate::selection::search::SearchResult;

/// Returns the experiment that would settle the open question after a search.
pub(super) fn next_experiment(
    regression: &RegressionModel,
    found: &SearchResult<'_>,
    parameters: &[FittedParameter],
) -> NextExperiment {
    let (why, what) = open_question(regression, found, parameters);
    NextExperiment::new(why, what)
}

fn open_question(
    regression: &RegressionModel,
    found: &SearchResult<'_>,
    parameters: &[FittedParameter],
) -> (String, &'static str) {
    let spring = regression.axis.spring;
    let contested = found.steps.iter().rev().find_map(|step| Some((step, step.rivals.first()?)));
    if let Some((step, rival)) = contested {
        let (added, rival) = (step.added.sited.effect, rival.effect);
        let why = format!("These records cannot distinguish {} from {}.", added.words, rival.words);
        return (why, added.experiment);
    }
    if let Some(unlisted) = &found.unlisted {
        let on = unlisted.variable.name().replace('_', " ");
        return (
            format!("A residual remains that depends on {on} and matches no listed effect."),
            along(unlisted.variable, spring),
        );
    }
    if found.is_inadequate() {
        let why = "No model that was tried describes these records.".to_owned();
        let what = "slow strokes both ways, strokes at several constant speeds, and quick \
                    reversals, each recorded by itself: they separate force over position, over \
                    speed and over acceleration";
        return (why, what);
    }
    if let Some(unsure) = parameters.iter().find(|p| !p.identifiable && p.declared.is_some()) {
        let what = match spring {
            false => {
                "quick reversals (for the mass) and strokes at several constant speeds (for \
                 friction and offset)"
            }
            true => {
                "slow movement over the whole range (for stiffness and offset) and fast movement \
                 (for damping and mass)"
            }
        };
        let name = &unsure.name;
        return (format!("These records do not identify {name} beyond its declaration."), what);
    }
    if let Some(last) = found.steps.last().map(|step| step.added.sited.effect) {
        let why = match regression.balances.len() < 3 {
            true => format!("One run cannot show that {} is the same on another day.", last.words),
            false => format!("The value of {} could be estimated with less variance.", last.words),
        };
        return (why, last.experiment);
    }
    let why = "This movement shows no missing effect; effects that it does not excite remain \
               undetected.";
    let what = match spring {
        false => {
            "the whole stroke slowly both ways, quick reversals, and a long run with the \
             temperature recorded"
        }
        true => "a larger range, slower and faster movement, and a step that is held for long",
    };
    (why.to_owned(), what)
}

/// A movement that shows how something depends on one variable.
fn along(variable: Variable, spring: bool) -> &'static str {
    match (variable, spring) {
        (Variable::Time, _) => {
            "the same movement for ten times as long, with the temperature recorded"
        }
        (Variable::Velocity, false) => {
            "constant speeds from the slowest to the fastest that the drive can hold, both ways"
        }
        (Variable::Velocity, true) => {
            "triangles of the same amplitude at speeds that differ by factors of two"
        }
        (Variable::Acceleration, false) => {
            "the same stroke with accelerations that differ by factors of two"
        }
        (Variable::Acceleration, true) => {
            "sines of the same amplitude at frequencies that differ by factors of two"
        }
        (Variable::Position | Variable::PositionByDirection, false) => {
            "the whole stroke at one slow constant speed, both ways, several times"
        }
        (Variable::Position | Variable::PositionByDirection, true) => {
            "slow load and unload over the whole range, both ways, several times"
        }
    }
}
