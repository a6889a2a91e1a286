//! Result of the stepwise selection: effects in their order, and what is known beside them.

use plant::effects::Site;

use super::dataset::{Dataset, Fitted};
use super::excess_over_floor::excess_left;
use super::floor_comparison::FloorComparison;
use super::location::{JumpingEncoder, Localisation};
use super::nonparametric_search::{
    LEAST_HINT, NonparametricResult, UnlistedFunction, least_hint, search_nonparametric,
};
use super::transmission_model::TransmissionModel;
use super::validation::Validation;
use crate::deadline::Deadline;
use crate::equation_error::block_roles::Role;

/// Share of the excess over the noise floor that effects may leave. Right ones of six machines left
/// 0.003 at most at the median over records, and a gain of the sensor in place of its creep 0.66.
const MOST_LEFT: f64 = 0.5;
/// Fit rounds after an effect was withdrawn.
const WITHDRAWAL_FIT_ROUNDS: usize = 4;

/// An effect that was added.
#[derive(Clone, Debug)]
pub struct SelectionStep {
    /// The effect, with its validation.
    pub added: Validation,
    /// Effects that the records cannot distinguish from it.
    pub rivals: Vec<(&'static str, Site)>,
    /// The model with it.
    pub fitted: Fitted,
}

/// The part of a search that a deadline left unfinished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unfinished {
    /// The declared model was not fitted to the end.
    DeclaredModel,
    /// Not every candidate was tried beside the effects added.
    Candidates,
    /// The effects added were not compared with every alternative, and no further one was tried.
    Comparison,
    /// Not every leading candidate was tried as the first effect.
    OtherFirstEffects,
    /// Not every nonparametric function was tried.
    Functions,
}

/// Result of the stepwise selection.
#[derive(Clone, Debug, Default)]
pub struct SearchResult {
    /// The declared model, fitted within its tolerances.
    pub base: Fitted,
    /// Effects in the order in which they were added.
    pub steps: Vec<SelectionStep>,
    /// Candidates fitted in each round, best first.
    pub rounds: Vec<Vec<Validation>>,
    /// Effects that were added and removed again.
    pub given_up: Vec<(&'static str, Site)>,
    /// Nonparametric functions tried after the listed effects.
    pub nonparametric: Vec<Validation>,
    /// The best of them, if it passes; where the listed effects are inadequate, a smaller gain than
    /// that suffices.
    pub unlisted_function: Option<UnlistedFunction>,
    /// Where the unmodelled torque enters; only if no listed effect is adequate, or if what the
    /// effects leave is no noise.
    pub localisation: Option<Localisation>,
    /// Whether the error stays so far above the noise floor that no listed effect is adequate.
    pub inadequate: bool,
    /// Whether what the final model leaves is no noise.
    pub coloured: bool,
    /// Whether the error stays far above the repeatability, but no further than the unknown passage
    /// of an unobserved slave's friction through zero speed may leave it.
    pub hidden_by_friction: bool,
    /// What a deadline left unfinished.
    pub unfinished: Option<Unfinished>,
    /// Whether an effect may be missing that the unfinished search did not reach: no effect was
    /// added, and the error is above the noise floor or that is not known.
    pub undecided: bool,
}

impl SearchResult {
    /// Returns the final model: with all effects, or with a nonparametric function if no listed
    /// effect is adequate.
    pub fn last(&self) -> &Fitted {
        let nonparametric =
            self.stand_alone_function().map(|unlisted_function| &unlisted_function.fitted);
        self.steps.last().map(|step| &step.fitted).or(nonparametric).unwrap_or(&self.base)
    }

    /// Returns the last effect that the records cannot distinguish from others, with its index.
    pub fn contested(&self) -> Option<(usize, &SelectionStep)> {
        self.steps.iter().enumerate().rev().find(|(_, step)| !step.rivals.is_empty())
    }

    /// Returns the nonparametric function if no listed effect is adequate.
    pub fn stand_alone_function(&self) -> Option<&UnlistedFunction> {
        self.unlisted_function.as_ref().filter(|_| self.inadequate)
    }

    /// Returns where an unlisted effect acts if no function of one variable explains it: at an
    /// encoder that jumps, else where the residual says.
    pub fn acts_at(&self, jumping: Option<JumpingEncoder>) -> Option<Site> {
        if self.unlisted_function.is_some() {
            return None;
        }
        // A function that the jumps replaced may have been tried without a localisation.
        if jumping.is_some() && (self.inadequate || self.localisation.is_some()) {
            return Some(Site::Sensor);
        }
        let localisation = self.localisation.as_ref()?;
        // Motor torque acts on the master too; only what it depends on distinguishes the two, and
        // regressions are on the motion.
        let best = self.nonparametric.first().filter(|best| best.gain > 0.0);
        match (localisation.site(), &localisation.dependence) {
            (Site::Master, None) => Some(best.map_or(Site::Master, |best| best.site)),
            (own, _) => Some(own),
        }
    }

    /// Withdraws the last effect and refits the rest; nonparametric results go with it. `None` if
    /// that cannot be simulated.
    pub fn without_last(&mut self, model: &TransmissionModel) -> Option<()> {
        let Some(step) = self.steps.pop() else { return Some(()) };
        self.set_nonparametric(NonparametricResult::default());
        if let Some(last) = self.steps.last_mut() {
            let at = step.fitted.setting.placed.len().saturating_sub(1);
            last.fitted = Dataset::of(model, Role::Fit).fit_without(
                &step.fitted,
                at,
                WITHDRAWAL_FIT_ROUNDS,
            )?;
        }
        Some(())
    }
}

impl SearchResult {
    pub(super) fn set_nonparametric(
        &mut self,
        NonparametricResult { tried, best, localisation }: NonparametricResult,
    ) {
        (self.nonparametric, self.unlisted_function, self.localisation) =
            (tried, best, localisation);
    }

    /// Whether the noise floor refutes every listed effect; `floor` is the comparison of the final
    /// model. What passed octave by octave must have taken what showed that something was missing,
    /// and effects must not leave most of what lies above the floor.
    pub(super) fn is_refuted(
        &self,
        (fit, select): (&Dataset<'_>, &Dataset<'_>),
        floor: &FloorComparison,
    ) -> bool {
        let by_octaves = self.steps.iter().any(|step| step.added.over_octaves);
        let leave_most = || {
            let records = [&fit.records[..], &select.records].concat();
            let settings = [&self.base, self.last()].map(|fitted| &fitted.setting);
            excess_left(fit.model, &records, settings).is_some_and(|left| left > MOST_LEFT)
        };
        floor.refutes(!self.steps.is_empty())
            || (by_octaves && floor.is_coloured())
            || (!self.steps.is_empty() && leave_most())
    }

    /// Takes over the nonparametric search, with whether the listed effects are `inadequate`: they
    /// are withdrawn then. `coloured` tells whether what the final model leaves is no noise; where
    /// a function stands alone, its own model is asked. An encoder that jumps explains more than a
    /// function that leaves more than noise.
    pub(super) fn take_nonparametric(
        &mut self,
        select: &Dataset<'_>,
        nonparametric: NonparametricResult,
        (inadequate, coloured): (bool, bool),
    ) {
        self.set_nonparametric(nonparametric);
        self.inadequate = inadequate;
        let of = |function: &UnlistedFunction| {
            let setting = &function.fitted.setting;
            FloorComparison::of(select.model, &select.records, setting).is_coloured()
        };
        self.coloured = self.stand_alone_function().map_or(coloured, of);
        if inadequate && self.coloured && JumpingEncoder::of(&select.model.records).is_some() {
            self.unlisted_function = None;
            self.coloured = coloured;
        }
        if inadequate {
            self.give_up_all();
        }
    }

    /// Reassesses adequacy and nonparametric functions after an effect was withdrawn.
    pub fn reassess(&mut self, model: &TransmissionModel, deadline: &Deadline) {
        let [fit, select] =
            [Role::Fit, Role::Select].map(|role| Dataset::of(model, role).until(deadline));
        let floor = FloorComparison::of(model, &select.records, &self.last().setting);
        let coloured = floor.is_coloured();
        if floor.leaves_noise() {
            self.coloured = false;
            return;
        }
        let inadequate = self.is_refuted((&fit, &select), &floor);
        let now = if inadequate { &self.base } else { self.last() };
        let hint = match inadequate {
            true => Some(least_hint(self.rounds.first())),
            false => coloured.then_some(LEAST_HINT),
        };
        let nonparametric = search_nonparametric((&fit, &select), now, hint);
        self.take_nonparametric(&select, nonparametric, (inadequate, coloured));
        self.conclude_early(deadline.left_work_out(), Unfinished::Functions, false);
    }

    /// Notes what was left unfinished, if a deadline cut it `short`; only the first is noted.
    pub(super) fn conclude_early(&mut self, short: bool, what: Unfinished, at_floor: bool) {
        if short {
            self.unfinished.get_or_insert(what);
            self.undecided = self.steps.is_empty() && !self.inadequate && !at_floor;
        }
    }

    pub(super) fn give_up_all(&mut self) {
        self.given_up.extend(self.steps.drain(..).map(|step| step.added.effect()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jumps_tell_the_place_with_or_without_a_localisation_but_only_of_what_is_missing() {
        let jumping = Some(JumpingEncoder { of_slave: true, at_one_place: false });
        let found = SearchResult::default();
        assert_eq!(found.acts_at(jumping), None);
        let inadequate = SearchResult { inadequate: true, ..found.clone() };
        assert_eq!(inadequate.acts_at(jumping), Some(Site::Sensor));
        assert_eq!(inadequate.acts_at(None), None);
        let located = SearchResult { localisation: Some(Localisation::default()), ..found };
        assert_eq!(located.acts_at(jumping), Some(Site::Sensor));
    }
}
