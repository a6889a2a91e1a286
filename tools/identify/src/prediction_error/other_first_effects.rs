//! Selection from other first effects: of several effects, the one that explains most alone may be
//! none of them.

use plant::effects::Site;

use super::backward_elimination::LEAST_SUBSTITUTION;
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
/// Share of the time limit after which no other first effect is tried: functions of one variable
/// and comparisons need the rest.
const UNTIL_SHARE: f64 = 0.5;

/// The effect that a model has last.
fn newest(fitted: &Fitted) -> Option<(&'static str, Site)> {
    fitted.setting.placed.last().map(|placed| (placed.id, placed.site))
}

impl Search<'_> {
    /// Selects again with each of the foremost runners-up of the first round as the first effect,
    /// where the effects selected leave more than noise. Another selection replaces them only if
    /// what it leaves is noise.
    pub(super) fn select_from_other_first_effects(&mut self) {
        let placed = self.now.setting.placed.iter().map(|placed| (placed.id, placed.site));
        let placed: Vec<_> = placed.collect();
        let mut others = std::mem::take(&mut self.other_first_effects);
        others.retain(|other| newest(other).is_some_and(|own| !placed.contains(&own)));
        others.truncate(TRIED);
        if self.found.steps.is_empty() || others.is_empty() || self.is_explained() {
            return;
        }
        let until = self.fit.deadline.part(UNTIL_SHARE);
        for first in &others {
            if self.fit.deadline.has_passed() || self.is_explained() {
                return;
            }
            let other = self.select_from(first, &until);
            if until.left_work_out() {
                self.found.unfinished.get_or_insert(Unfinished::OtherFirstEffects);
                return;
            }
            let better = |other: &Search<'_>| {
                other.is_explained() && self.gain_over_least(other).is_some_and(|gain| gain >= 0.0)
            };
            if let Some(Search { now, runners_up, latest, found, .. }) = other.filter(better) {
                self.found.give_up_all();
                let given_up = std::mem::take(&mut self.found.given_up);
                (self.now, self.runners_up, self.latest, self.found) =
                    (now, runners_up, latest, found);
                self.found.given_up.splice(0..0, given_up);
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
