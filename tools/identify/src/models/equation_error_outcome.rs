//! Outcome of an equation-error model: verdict, numbers and page.

use report::Page;

use super::equation_error_parameters::{effect_parameters, parameters};
use super::equation_error_result::{Study, error};
use super::next_experiment::OpenQuestion;
use super::unaccepted_effects::{left, shift_note, shows};
use crate::equation_error::block_roles::{Block, Role};
use crate::equation_error::fit::ShapeSearch;
use crate::equation_error::model::{Fitted, RegressionModel, Structure};
use crate::equation_error::search::{
    FittedCandidate, SearchResult, SelectionStep, SitedEffect, Unlisted, of,
};
use crate::equation_error::signals::ForceBalance;
use crate::equation_error::validation::Validation;
use crate::outcome::{
    CandidateGain, ChannelError, FittedParameter, FoundEffect, Named, Outcome, Roles, StepError,
    UnlistedTable, Verdict,
};
use crate::page;

/// The verdict, and the page that shows it.
pub(super) fn conclude(study: &Study) -> (Outcome, Page) {
    let outcome = outcome(study);
    let page = page::page(study_view(study), &outcome);
    (outcome, page)
}

fn outcome(study: &Study) -> Outcome {
    let found = &study.found;
    let rivals: Vec<SitedEffect> = found
        .steps
        .iter()
        .rev()
        .find(|s| !s.rivals.is_empty())
        .map_or(Vec::new(), |s| s.rivals.clone());
    // With three effects in the model, a fourth that passes remains unexplained, too.
    let remains =
        found.unlisted.is_some() || found.last_round.iter().any(|t| t.validation.accepted);
    let verdict = Verdict::of(found.steps.len(), rivals.len(), remains);
    let report = of(&study.blocks, Role::Report);
    let [before, after] =
        [&found.base, found.last()].map(|fitted| error(&study.regression, fitted, &report));
    let channel = channel_error(before, after, study.regression.axis.units.force);
    let declared = parameters(&study.regression, &found.structure(), found.last());
    let contested = found.steps.iter().rev().find(|s| !s.rivals.is_empty());
    let open = OpenQuestion {
        contested: contested.and_then(|s| Some((s.added, *s.rivals.first()?))),
        unlisted: found.unlisted.as_ref().map(|u| u.variable),
        unsure: unsure(&declared),
        last: found.steps.last().map(|s| s.added),
        records: study.regression.balances.len(),
        spring: study.regression.axis.spring,
    };
    Outcome {
        verdict,
        effects: effects(&study.regression, found),
        ambiguous_with: rivals.iter().map(named).collect(),
        remains,
        unlisted: unlisted(&study.regression, found.unlisted.as_ref()),
        calibration: None,
        left: left(study),
        error: [(study.channel.to_owned(), channel)].into(),
        parameters: declared,
        records: roles(&study.regression, &study.blocks),
        next_experiment: open.next_experiment(),
        steps: steps(study),
        candidates: candidates(found),
        notes: notes(study),
        seconds: 0.0,
    }
}

fn notes(study: &Study) -> Vec<String> {
    let shift = |tried: &FittedCandidate| {
        let shift = study
            .regression
            .hidden_shift(&tried.structure, &tried.fitted)
            .filter(|_| shows(&tried.validation))?;
        Some(shift_note(&study.regression, &tried.validation, shift))
    };
    study.notes.iter().cloned().chain(study.found.last_round.iter().filter_map(shift)).collect()
}

/// An effect by name and site.
pub(super) fn named(sited: &SitedEffect) -> Named {
    Named { id: sited.effect.id.into(), site: sited.site.into() }
}

/// The errors of a channel on the reporting rows, before and after: each with the root mean square
/// of the channel.
pub(super) fn channel_error(
    (before, size): (f64, f64),
    (after, _): (f64, f64),
    unit: &str,
) -> ChannelError {
    ChannelError {
        declared: None,
        before,
        after,
        floor: None,
        unit: unit.to_owned(),
        before_percent: 100.0 * before / size,
        after_percent: 100.0 * after / size,
    }
}

/// The first declared parameter that the records do not identify.
pub(super) fn unsure(parameters: &[FittedParameter]) -> Option<String> {
    let unsure = parameters.iter().find(|p| !p.identifiable && p.declared.is_some());
    unsure.map(|p| p.name.clone())
}

/// The table of an unlisted effect. Its site is that of most listed effects of this kind of model.
pub(super) fn unlisted(
    regression: &RegressionModel,
    unlisted: Option<&Unlisted>,
) -> Option<UnlistedTable> {
    let unlisted = unlisted?;
    let site = regression.sites.first().copied().unwrap_or_default();
    Some(UnlistedTable {
        site: site.into(),
        depends_on: unlisted.variable.name().into(),
        table: unlisted.table.clone(),
        ..UnlistedTable::default()
    })
}

fn effects(regression: &RegressionModel, found: &SearchResult) -> Vec<FoundEffect> {
    let structure = found.structure();
    let effect = |(at, step): (usize, &SelectionStep)| {
        let own = step.ranking.iter().find(|c| c.id == step.added.effect.id);
        FoundEffect {
            id: step.added.effect.id.into(),
            site: step.added.site.into(),
            parameters: effect_parameters(regression, &structure, at, found.last()),
            t: own.map_or(0.0, |c| c.t),
            gain_percent: own.map_or(0.0, |c| c.gain_percent),
        }
    };
    found.steps.iter().enumerate().map(effect).collect()
}

/// What was used for what.
pub(super) fn roles(regression: &RegressionModel, blocks: &[Block]) -> Roles {
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

/// All rows of all records as one block each.
fn all_rows(study: &Study) -> Vec<Block> {
    let rows = study.regression.balances.iter().map(ForceBalance::rows).enumerate();
    rows.map(|(record, n)| Block { record, rows: 0..n, role: Role::Fit }).collect()
}

fn steps(study: &Study) -> Vec<StepError> {
    let regression = &study.regression;
    let all = all_rows(study);
    let percent = |fitted: &Fitted, blocks: &[Block]| {
        let (e, f) = error(regression, fitted, blocks);
        100.0 * e / f
    };
    let by_role = |fitted: &Fitted, role| percent(fitted, &of(&study.blocks, role));
    let declared = Structure::default();
    let models = std::iter::once(("declared", &declared, &study.found.base))
        .chain(study.found.steps.iter().map(|s| (s.added.effect.id, &s.structure, &s.fitted)));
    let mut out = Vec::new();
    for (model, structure, fitted) in models {
        let whole = regression.fit(structure, &all, &fitted.shapes, ShapeSearch::Refine);
        let terms = regression.terms(structure);
        let names = regression
            .parameters
            .iter()
            .map(|p| p.name.clone())
            .chain(terms.into_iter().map(|t| t.name));
        out.push(StepError {
            model: model.to_owned(),
            fit_percent: by_role(fitted, Role::Fit),
            select_percent: by_role(fitted, Role::Select),
            report_percent: by_role(fitted, Role::Report),
            all_rows_percent: whole.as_ref().map_or(f64::NAN, |w| percent(w, &all)),
            all_rows_parameters: whole.map_or(Vec::new(), |w| {
                names.enumerate().map(|(i, n)| (n, w.fit.coefficients[i], w.std[i])).collect()
            }),
        });
    }
    out
}

/// Validation of one candidate in a round; `generic` for a nonparametric function.
pub(super) fn candidate_gain(round: usize, generic: bool, c: &Validation) -> CandidateGain {
    CandidateGain {
        round,
        id: c.id.to_owned(),
        generic,
        gain_percent: c.gain_percent,
        t: c.t,
        blocks_better: c.better,
        blocks_worse: c.worse,
        accepted: c.accepted,
    }
}

/// Validation of all candidates, round by round.
fn candidates(found: &SearchResult) -> Vec<CandidateGain> {
    let last = found.steps.len() + 1;
    let mut out = Vec::new();
    for (i, step) in found.steps.iter().enumerate() {
        out.extend(step.ranking.iter().map(|c| candidate_gain(i + 1, false, c)));
    }
    out.extend(found.last_round.iter().map(|t| candidate_gain(last, false, &t.validation)));
    out.extend(found.nonparametric.iter().map(|g| candidate_gain(last, true, &g.validation)));
    out
}

/// What the page shows.
fn study_view(study: &Study) -> page::View {
    let regression = &study.regression;
    let records: Vec<page::RecordView> = regression
        .balances
        .iter()
        .enumerate()
        .map(|(record, b)| {
            let block = Block { record, rows: 0..b.rows(), role: Role::Fit };
            let [before, after] = [&study.found.base, study.found.last()]
                .map(|fitted| regression.residual(fitted, &block));
            page::RecordView::new(b, &b.force, before, after)
        })
        .collect();
    let cut_off = regression.balances.first().map_or(0.0, |b| b.cut_off);
    let words = study.found.steps.iter().map(|s| s.added.effect.words).collect();
    page::View {
        units: regression.axis.units,
        channel: page::Channel::Force,
        spring: regression.axis.spring,
        records,
        words,
        cut_off,
    }
}
