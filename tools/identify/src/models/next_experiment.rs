//! The next experiment, by the open question.

use crate::equation_error::search::SitedEffect;
use crate::equation_error::spline::Variable;
use crate::outcome::NextExperiment;

/// The open question after a search.
pub(super) struct OpenQuestion {
    /// An effect that was added and one that the records cannot distinguish from it.
    pub(super) contested: Option<(SitedEffect, SitedEffect)>,
    /// The variable of an unlisted residual.
    pub(super) unlisted: Option<Variable>,
    /// A declared parameter that the records do not identify.
    pub(super) unsure: Option<String>,
    /// The last effect that was added.
    pub(super) last: Option<SitedEffect>,
    /// Number of records.
    pub(super) records: usize,
    /// Whether a spring holds the position.
    pub(super) spring: bool,
}

impl OpenQuestion {
    /// Returns the experiment that would settle it.
    pub(super) fn next_experiment(&self) -> NextExperiment {
        let make =
            |why: String, what: &str| NextExperiment { why, what: what.to_owned(), protocol: None };
        if let Some((added, rival)) = &self.contested {
            let (added, rival) = (added.effect, rival.effect);
            let why =
                format!("These records cannot distinguish {} from {}.", added.words, rival.words);
            return make(why, added.experiment);
        }
        if let Some(variable) = self.unlisted {
            let on = variable.name().replace('_', " ");
            return make(
                format!("A residual remains that depends on {on} and matches no listed effect."),
                self.along(variable),
            );
        }
        if let Some(name) = &self.unsure {
            let what = match self.spring {
                false => {
                    "quick reversals (for the mass) and strokes at several constant speeds (for \
                     friction and offset)"
                }
                true => {
                    "slow movement over the whole range (for stiffness and offset) and fast \
                     movement (for damping and mass)"
                }
            };
            return make(
                format!("These records do not identify {name} beyond its declaration."),
                what,
            );
        }
        match &self.last {
            Some(last) if self.records < 3 => make(
                format!(
                    "One run cannot show that {} is the same on another day.",
                    last.effect.words
                ),
                last.effect.experiment,
            ),
            Some(last) => make(
                format!(
                    "The value of {} could be estimated with less variance.",
                    last.effect.words
                ),
                last.effect.experiment,
            ),
            None => make(
                "This movement shows no missing effect; effects that it does not excite remain \
                 undetected."
                    .to_owned(),
                match self.spring {
                    false => {
                        "the whole stroke slowly both ways, quick reversals, and a long run with \
                         the temperature recorded"
                    }
                    true => {
                        "a larger range, slower and faster movement, and a step that is held for \
                         long"
                    }
                },
            ),
        }
    }

    /// A movement that shows how something depends on one variable.
    fn along(&self, variable: Variable) -> &'static str {
        match (variable, self.spring) {
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
}
