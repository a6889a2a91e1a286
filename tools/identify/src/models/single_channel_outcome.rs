//! Outcome of a model with one measured channel: verdict, numbers and page.

use std::collections::BTreeMap;

use report::Page;

use super::next_experiment::next_experiment;
use super::resemblance::resemblance;
use super::single_channel_page::page;
use super::single_channel_parameters::{effect_parameters, names, parameters};
use super::single_channel_result::{Study, all_rows, tested};
use super::unaccepted_effects::{left, sampling_delay_notes};
use crate::correlation::TestedResidual;
use crate::equation_error::block_roles::{Block, Role, blocks_of_role};
use crate::equation_error::model::{Fitted, RegressionModel, Structure};
use crate::estimate_correlation::strong;
use crate::outcome::{
    AtBounds, CandidateGain, ChannelError, FoundEffect, Named, Outcome, Roles, StepError,
    UnlistedTable, Unsettled, Verdict,
};
use crate::selection::candidates::SitedEffect;
use crate::selection::forward_selection::SelectionStep;
use crate::selection::predictor::Predictor;
use crate::selection::search::SearchResult;
use crate::selection::validation::Validation;

/// The verdict, and the page that shows it.
pub(super) fn conclude(study: &Study<'_>) -> (Outcome, Page) {
    let tested = tested(study);
    let outcome = outcome(study, &tested);
    let page = page(study, &outcome, tested);
    (outcome, page)
}

fn outcome(study: &Study<'_>, tested: &TestedResidual) -> Outcome {
    let Study { predictor, found, .. } = study;
    let regression = predictor.regression();
    let contested = found.steps.iter().rev().find(|step| !step.rivals.is_empty());
    let rivals: &[SitedEffect] = contested.map_or(&[], |step| &step.rivals);
    // With three effects in the model, a fourth that passes remains unexplained, too; so does a
    // large error that is no noise.
    let remains = found.unlisted.is_some()
        || found.is_inadequate()
        || found.leaves_coloured()
        || found.last_round.iter().any(|t| t.validation.accepted);
    let verdict = match (&found.function, found.is_inadequate()) {
        // A small error would not tell whether an effect is missing: these records have no floor.
        _ if study.early && found.steps.is_empty() => Verdict::Undecided,
        (Some(_), _) => Verdict::Unlisted,
        (None, true) => Verdict::Inadequate,
        (None, false) => Verdict::of(found.steps.len(), rivals.len(), remains),
    };
    let report = blocks_of_role(&study.blocks, Role::Report);
    let [(before, size), (after, _)] =
        [&found.base, found.last()].map(|model| predictor.error(&model.fitted, &report));
    let error = ChannelError {
        declared: None,
        before,
        after,
        floor: None,
        unit: predictor.unit().to_owned(),
        before_percent: 100.0 * before / size,
        after_percent: 100.0 * after / size,
    };
    let parameters = parameters(regression, found.last());
    // The site of an unlisted effect is that of most listed effects of this kind of model.
    let site = regression.sites.first().copied().unwrap_or_default();
    Outcome {
        axis: None,
        verdict,
        early: study.early,
        effects: found.steps.iter().enumerate().map(|step| effect(study, step)).collect(),
        ambiguous_with: rivals
            .iter()
            .map(|rival| Named { id: rival.effect.id.into(), site: rival.site.into() })
            .collect(),
        remains,
        unlisted: found.unlisted.as_ref().map(|unlisted| UnlistedTable {
            site: site.into(),
            depends_on: unlisted.variable.name().into(),
            table: unlisted.table.clone(),
            resembles: resemblance(unlisted.variable, &unlisted.table, &regression.axis.units),
            ..UnlistedTable::default()
        }),
        unsettled: found.unsettled().map(|own| Unsettled {
            id: own.id.into(),
            gain_percent: own.gain_percent,
            blocks_better: own.better,
            blocks: own.blocks,
        }),
        calibration: None,
        false_alarms: Vec::new(),
        left: left(study),
        error: [(study.channel.to_owned(), error)].into(),
        residual_tests: [(study.channel.to_owned(), tested.tests())].into(),
        records: roles(regression, &study.blocks),
        next_experiment: next_experiment(regression, found, &parameters),
        at_bounds: AtBounds::of(&parameters, &BTreeMap::new()),
        correlations: strong(&names(regression, found.last()), &found.last().fitted.correlation),
        parameters,
        steps: steps(study),
        candidates: candidates(found),
        notes: study
            .notes
            .iter()
            .cloned()
            .chain(withdrawal_note(found))
            .chain(found.adequacy.notes())
            .chain(sampling_delay_notes(study))
            .collect(),
        seconds: 0.0,
    }
}

/// Why effects that passed are not named.
fn withdrawal_note(found: &SearchResult<'_>) -> Option<String> {
    let ids: Vec<&str> = found.withdrawn.iter().map(|step| step.added.sited.effect.id).collect();
    (!ids.is_empty()).then(|| {
        format!(
            "{} reduce the error but leave {:.0} % of its square on the selection rows and {:.0} % \
             on the reporting rows: they are not named, since the model lacks something larger",
            ids.join(", "),
            100.0 * found.adequacy.left_selected,
            100.0 * found.adequacy.left_reported
        )
    })
}

fn effect(study: &Study<'_>, (at, step): (usize, &SelectionStep<'_>)) -> FoundEffect {
    FoundEffect {
        id: step.added.sited.effect.id.into(),
        site: step.added.sited.site.into(),
        // After the function that takes the place of listed effects, where there is one.
        parameters: effect_parameters(
            study.predictor.regression(),
            study.found.last(),
            at + usize::from(study.found.function.is_some()),
        ),
        t: step.added.validation.t,
        gain_percent: step.added.validation.gain_percent,
    }
}

/// What was used for what.
fn roles(regression: &RegressionModel, blocks: &[Block]) -> Roles {
    let name = |b: &Block| {
        let balance = &regression.balances[b.record];
        let times = balance.signals.rows(&balance.signals.time);
        let end = times[(b.rows.end - 1).min(times.len() - 1)];
        format!("{}[{:.2}..{:.2} s]", balance.name, times[b.rows.start], end)
    };
    let names = |role| {
        let mut names: Vec<String> = Vec::new();
        for (i, balance) in regression.balances.iter().enumerate() {
            let own: Vec<&Block> = blocks.iter().filter(|b| b.record == i).collect();
            if own.iter().all(|b| b.role == role) && !own.is_empty() {
                names.push(balance.name.clone());
            } else {
                names.extend(own.iter().filter(|b| b.role == role).map(|b| name(b)));
            }
        }
        names
    };
    Roles { fit: names(Role::Fit), select: names(Role::Select), report: names(Role::Report) }
}

/// Errors after each step; an effect of two terms is shown with its first term alone, too, where
/// the output is simulated.
fn steps(study: &Study<'_>) -> Vec<StepError> {
    let Study { predictor, found, .. } = study;
    let base = &found.base.fitted;
    let mut out =
        vec![step(study, "declared".to_owned(), &found.base.structure, (base, base), &[])];
    if let (Some(function), Some(unlisted)) = (&found.function, &found.unlisted) {
        let name = format!("function of {}", unlisted.variable.name());
        out.push(step(study, name, &function.structure, (&function.fitted, base), &[]));
    }
    for added in found.steps.iter().map(|step| &step.added) {
        let (id, structure, fitted) =
            (added.sited.effect.id, &added.model.structure, &added.model.fitted);
        let terms = predictor.regression().terms_of(added.sited.effect);
        if let (Predictor::OutputError(simulation), [first, _]) = (predictor, &terms[..]) {
            let second = [simulation.regression.terms(structure).len() - 1];
            let fit = blocks_of_role(&study.blocks, Role::Fit);
            if let Some(alone) = simulation.fit(structure, &fit, fitted, &second) {
                let name = format!("{id}, {} alone", first.name);
                out.push(step(study, name, structure, (&alone, fitted), &second));
            }
        }
        out.push(step(study, id.to_owned(), structure, (fitted, fitted), &[]));
    }
    out
}

/// Errors of a fitted structure, and of its fit to all rows that starts from `start`.
fn step(
    study: &Study<'_>,
    model: String,
    structure: &Structure<'_>,
    (fitted, start): (&Fitted, &Fitted),
    without: &[usize],
) -> StepError {
    let (predictor, regression) = (&study.predictor, study.predictor.regression());
    let percent = |fitted: &Fitted, blocks: &[Block]| {
        let (error, size) = predictor.error(fitted, blocks);
        100.0 * error / size
    };
    let by_role = |role| percent(fitted, &blocks_of_role(&study.blocks, role));
    let all: Vec<Block> =
        regression.balances.iter().enumerate().map(|(i, balance)| all_rows(i, balance)).collect();
    let whole = predictor.refit(structure, &all, start, without);
    let terms = regression.terms(structure).into_iter().map(|term| term.name);
    let names = regression.parameters.iter().map(|p| p.name.clone()).chain(terms);
    StepError {
        model,
        fit_percent: by_role(Role::Fit),
        select_percent: by_role(Role::Select),
        report_percent: by_role(Role::Report),
        all_rows_percent: whole.as_ref().map_or(f64::NAN, |whole| percent(whole, &all)),
        all_rows_parameters: whole.map_or(Vec::new(), |whole| {
            names.enumerate().map(|(i, n)| (n, whole.fit.coefficients[i], whole.std[i])).collect()
        }),
    }
}

/// Validation of all candidates, round by round.
fn candidates(found: &SearchResult<'_>) -> Vec<CandidateGain> {
    let row = |round: usize, generic: bool, c: &Validation, screened_only: bool| CandidateGain {
        round,
        id: if screened_only { format!("{} (screened)", c.id) } else { c.id.to_owned() },
        generic,
        gain_percent: c.gain_percent,
        t: c.t,
        blocks_better: c.better,
        blocks_worse: c.worse,
        accepted: c.accepted,
    };
    let mut out = Vec::new();
    for (round, step) in (1..).zip(&found.steps) {
        let ranking = step.ranking.iter();
        out.extend(ranking.map(|c| row(round, false, &c.validation, c.screened_only)));
    }
    let last = found.steps.len() + 1;
    let listed = found.last_round.iter();
    out.extend(listed.map(|c| row(last, false, &c.validation, c.screened_only)));
    let nonparametric = found.nonparametric.iter();
    out.extend(nonparametric.map(|c| row(last, true, &c.validation, c.screened_only)));
    out
}
