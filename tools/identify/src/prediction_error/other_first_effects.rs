//! Selection from other first effects: of several effects, the one that explains most alone may be
//! none of them.

use plant::effects::Site;

use super::backward_elimination::{LEAST_SUBSTITUTION, are_equivalent};
use super::candidates::candidates;
use super::dataset::Fitted;
use super::record_features::record_features;
use super::refit::refit;
use super::search::Search;
use super::search_result::{SearchResult, SelectionStep, Unfinished};
use super::validation::{LEAST_GAIN, validate};
use crate::deadline::Deadline;

/// Runners-up of the first round that are also tried as the first effect.
const TRIED: usize = 2;
/// Share of the time of the rounds after which no other first effect is tried: functions of one
/// variable and comparisons need the rest.
const UNTIL_SHARE: f64 = 0.65;

/// The effect that a model has last.
fn newest(fitted: &Fitted) -> Option<(&'static str, Site)> {
    fitted.setting.placed.last().map(|placed| (placed.id, placed.site))
}

impl Search<'_> {
    /// Whether the current model leaves no reason to try others.
    fn is_explained(&self) -> bool {
        let floor = self.against_floor(&self.now);
        floor.may_be_at_floor_in_sum() && floor.is_white()
    }

    /// Selects again with each of the foremost runners-up of the first round as the first effect,
    /// where the effects selected leave more than noise. Another selection replaces them only if
    /// what it leaves is noise.
    pub(super) fn select_from_other_first_effects(&mut self) {
        let placed = self.now.setting.placed.iter().map(|placed| (placed.id, placed.site));
        let placed: Vec<_> = placed.collect();
        let mut others = std::mem::take(&mut self.other_first_effects);
        // An equivalent effect leads to the same selection.
        let same = |own| placed.iter().any(|placed| *placed == own || are_equivalent(*placed, own));
        others.retain(|other| newest(other).is_some_and(|own| !same(own)));
        others.truncate(TRIED);
        if self.found.steps.is_empty() || others.is_empty() || self.is_explained() {
            return;
        }
        let until = self.fit.deadline.part(UNTIL_SHARE);
        for first in &others {
            if self.fit.deadline.has_passed() {
                return;
            }
            let other = self.select_from(first, &until);
            if until.left_work_out() {
                self.found.unfinished.get_or_insert(Unfinished::OtherFirstEffects);
                return;
            }
            let better = |other: &Search<'_>| {
                other.against_floor(&other.now).leaves_noise()
                    && self.gain_over_least(other).is_some_and(|gain| gain >= 0.0)
            };
            if let Some(Search { now, runners_up, latest, found, .. }) = other.filter(better) {
                self.found.give_up_all();
                let given_up = std::mem::take(&mut self.found.given_up);
                (self.now, self.runners_up, self.latest, self.found) =
                    (now, runners_up, latest, found);
                self.found.given_up.splice(0..0, given_up);
                if self.is_explained() {
                    return;
                }
            }
        }
    }

    /// Selects with a runner-up of the first round as the first effect, as long as that is about as
    /// good as the current model.
    fn select_from<'b>(&'b self, first: &Fitted, until: &'b Deadline) -> Option<Search<'b>> {
        let fit = self.fit.clone().until(until);
        let select = self.select.clone().until(until);
        let all = candidates(&record_features(&fit, &self.found.base));
        let of = all.iter().find(|of| newest(first) == Some((of.id, of.site)))?;
        let now = refit((&fit, &select), first, of);
        let found = SearchResult {
            base: self.found.base.clone(),
            rounds: self.found.rounds.iter().take(1).cloned().collect(),
            ..SearchResult::default()
        };
        let mut other = Search::of((fit, select), now, found);
        let runners_up = self.runners_up.iter().filter(|other| newest(other) != newest(first));
        other.runners_up = runners_up.cloned().collect();
        let (added, fitted) = (other.beside_declared()?, other.now.clone());
        other.found.steps.push(SelectionStep { added, rivals: Vec::new(), fitted });
        other.extend(|other| {
            let near = |gain: f64| gain >= -LEAST_SUBSTITUTION - LEAST_GAIN;
            other.found.rounds.len() == 1 || self.gain_over_least(other).is_some_and(near)
        });
        Some(other)
    }

    /// Gain of another selection over the current model beyond the least one for which it replaces
    /// that, which grows with the effects that it has more.
    fn gain_over_least(&self, other: &Search<'_>) -> Option<f64> {
        let residuals = |fitted: &Fitted| self.select.residuals(&fitted.setting);
        let (here, there) = (residuals(&self.now)?, residuals(&other.now)?);
        let count = |search: &Search<'_>| search.found.steps.len() as f64;
        let by = newest(&other.now)?;
        let least = LEAST_SUBSTITUTION + LEAST_GAIN * (count(other) - count(self));
        Some(validate(by, &here, &there).gain - least)
    }
}

#[cfg(test)]
mod tests {
    use plant::effects::parse;

    use super::*;
    use crate::deadline::NEVER;
    use crate::prediction_error::candidates::free_parameters_of;
    use crate::prediction_error::record::share_out;
    use crate::prediction_error::transmission_model::TransmissionModel;
    use crate::two_sides;

    /// A rig with backlash at the slave.
    fn with_backlash() -> TransmissionModel {
        let effects = || vec![parse("backlash@slave=0.06").unwrap()];
        let record = |turn| two_sides::record(turn, effects(), turn == 4, 0.0, &|_| 0.0);
        let mut records = (0..5).map(record).collect::<Vec<_>>();
        share_out(&mut records, false);
        let count_rad = Some(two_sides::COUNT_RAD);
        TransmissionModel::new("rig.toml", &two_sides::rig().model, records, count_rad).unwrap()
    }

    /// The declared model with one effect, fitted.
    fn with_one(search: &Search<'_>, id: &str, site: Site) -> Fitted {
        let base = &search.found.base;
        let all = candidates(&record_features(&search.fit, base));
        let of = all.iter().find(|of| (of.id, of.site) == (id, site)).unwrap();
        let free = [base.parameters.clone(), free_parameters_of(of, 0)].concat();
        let starts = of
            .starts
            .iter()
            .filter_map(|start| search.fit.fit(&base.setting.with(start), &free, 3));
        starts.min_by(|a, b| a.objective.total_cmp(&b.objective)).unwrap()
    }

    /// A selection that has taken a wrong effect, with another one as the runner-up.
    fn misled<'a>(search: &Search<'a>, first: &Fitted, other: &Fitted) -> Search<'a> {
        let found = SearchResult { base: search.found.base.clone(), ..SearchResult::default() };
        let views = (search.fit.clone(), search.select.clone());
        let mut misled = Search::of(views, first.clone(), found);
        let (added, fitted) = (misled.beside_declared().unwrap(), first.clone());
        misled.found.rounds.push(vec![added.clone()]);
        misled.found.steps.push(SelectionStep { added, rivals: Vec::new(), fitted });
        misled.other_first_effects.push(other.clone());
        misled
    }

    fn names(search: &Search<'_>) -> Vec<(&'static str, Site)> {
        search.found.steps.iter().map(|step| step.added.effect()).collect()
    }

    #[test]
    fn a_first_effect_that_leaves_more_than_noise_is_replaced_by_one_that_does_not() {
        let model = with_backlash();
        let search = Search::begin(&model, &NEVER).unwrap();
        let right = with_one(&search, "backlash", Site::Slave);
        let wrong = with_one(&search, "extra_inertia", Site::Slave);

        let mut replaced = misled(&search, &wrong, &right);
        assert!(!replaced.against_floor(&replaced.now).leaves_noise());
        replaced.select_from_other_first_effects();
        assert_eq!(names(&replaced), [("backlash", Site::Slave)]);
        assert!(replaced.against_floor(&replaced.now).leaves_noise());
        assert!(replaced.found.unfinished.is_none());
        assert_eq!(replaced.found.given_up, [("extra_inertia", Site::Slave)]);

        // The other way round the right effect comes back.
        let mut kept = misled(&search, &right, &wrong);
        kept.select_from_other_first_effects();
        assert_eq!(names(&kept), [("backlash", Site::Slave)]);

        // After two thirds of the time no other one is tried, and the result tells that.
        let late = Deadline::after(|| 0.7);
        let mut cut = misled(&search, &wrong, &right);
        cut.fit.deadline = &late;
        cut.select_from_other_first_effects();
        assert_eq!(names(&cut), [("extra_inertia", Site::Slave)]);
        assert_eq!(cut.found.unfinished, Some(Unfinished::OtherFirstEffects));
        assert!(!late.left_work_out());
    }
}
