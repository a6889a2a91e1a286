//! From what the search found to the verdict, its numbers and its page, for models that are read
//! inversely.

use report::Page;

use super::inverse_found::{Study, error};
use super::inverse_left::{left, shift_note, shows};
use super::inverse_parameters::{effect_parameters, parameters};
use super::next_experiment::Open;
use crate::inverse::fit::Known;
use crate::inverse::model::{Fitted, Machine, Structure};
use crate::inverse::search::{Candidate, Found, Sited, Tried, of};
use crate::inverse::split::{Block, Role};
use crate::outcome::{
    CandidateGain, ChannelError, FoundEffect, Named, Outcome, Roles, StepError, UnlistedTable,
    Verdict,
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
    let rivals: Vec<Sited> = found
        .steps
        .iter()
        .rev()
        .find(|s| !s.rivals.is_empty())
        .map_or(Vec::new(), |s| s.rivals.clone());
    // With three effects in the model a fourth that passes is something left, too.
    let remains = found.unlisted.is_some() || found.last_round.iter().any(|t| t.verdict.accepted);
    let verdict = Verdict::of(found.steps.len(), rivals.len(), remains);
    let report = of(&study.blocks, Role::Report);
    let (before, force) = error(&study.machine, &found.base, &report);
    let (after, _) = error(&study.machine, found.last(), &report);
    let channel = ChannelError {
        declared: None,
        before,
        after,
        floor: None,
        unit: study.machine.axis.units.force.to_owned(),
        before_percent: 100.0 * before / force,
        after_percent: 100.0 * after / force,
    };
    let declared = parameters(&study.machine, &found.structure(), found.last());
    let contested = found.steps.iter().rev().find(|s| !s.rivals.is_empty());
    let open = Open {
        contested: contested.and_then(|s| Some((s.added, *s.rivals.first()?))),
        unlisted: found.unlisted.as_ref().map(|u| u.variable),
        unsure: declared
            .iter()
            .find(|p| !p.identifiable && p.declared.is_some())
            .map(|p| p.name.clone()),
        last: found.steps.last().map(|s| s.added),
        records: study.machine.balances.len(),
        spring: study.machine.axis.spring,
    };
    Outcome {
        verdict,
        effects: effects(&study.machine, found),
        ambiguous_with: rivals.iter().map(named).collect(),
        remains,
        unlisted: unlisted(&study.machine, found),
        calibration: None,
        left: left(study),
        error: [(study.channel.to_owned(), channel)].into(),
        parameters: declared,
        records: roles(&study.machine, &study.blocks),
        next_experiment: open.next_experiment(),
        steps: steps(study),
        candidates: candidates(found),
        notes: notes(study),
        seconds: 0.0,
    }
}

fn notes(study: &Study) -> Vec<String> {
    let shift = |tried: &Tried| {
        let shift = study
            .machine
            .hidden_shift(&tried.structure, &tried.fitted)
            .filter(|_| shows(&tried.verdict))?;
        Some(shift_note(&study.machine, &tried.verdict, shift))
    };
    study.notes.iter().cloned().chain(study.found.last_round.iter().filter_map(shift)).collect()
}

/// An effect by name and site.
pub(super) fn named(sited: &Sited) -> Named {
    Named { id: sited.effect.id().into(), site: sited.site.into() }
}

/// The table of what has no name. The site is where most of the listed effects of this kind of
/// model sit.
pub(super) fn unlisted(machine: &Machine, found: &Found) -> Option<UnlistedTable> {
    let unlisted = found.unlisted.as_ref()?;
    let site = machine.sites.first().copied().unwrap_or_default();
    Some(UnlistedTable {
        site: site.into(),
        depends_on: unlisted.variable.name().into(),
        table: unlisted.table.clone(),
        ..UnlistedTable::default()
    })
}

fn effects(machine: &Machine, found: &Found) -> Vec<FoundEffect> {
    let structure = found.structure();
    let effect = |(at, step): (usize, &crate::inverse::search::Step)| {
        let own = step.ranking.iter().find(|c| c.id == step.added.effect.id());
        FoundEffect {
            id: step.added.effect.id().into(),
            site: step.added.site.into(),
            parameters: effect_parameters(machine, &structure, at, found.last()),
            t: own.map_or(0.0, |c| c.t),
            gain_percent: own.map_or(0.0, |c| c.gain_percent),
        }
    };
    found.steps.iter().enumerate().map(effect).collect()
}

/// What was used for what.
pub(super) fn roles(machine: &Machine, blocks: &[Block]) -> Roles {
    let name = |b: &Block| {
        let balance = &machine.balances[b.record];
        let times = balance.signals.rows(&balance.signals.time);
        let end = times[(b.rows.end - 1).min(times.len() - 1)];
        format!("{}[{:.2}..{:.2} s]", balance.name, times[b.rows.start], end)
    };
    let names = |role| {
        let mut names: Vec<String> = Vec::new();
        for (i, balance) in machine.balances.iter().enumerate() {
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
    let rows =
        study.machine.balances.iter().map(crate::inverse::signals::Balance::rows).enumerate();
    rows.map(|(record, n)| Block { record, rows: 0..n, role: Role::Fit }).collect()
}

fn steps(study: &Study) -> Vec<StepError> {
    let machine = &study.machine;
    let all = all_rows(study);
    let percent = |fitted: &Fitted, blocks: &[Block]| {
        let (e, f) = error(machine, fitted, blocks);
        100.0 * e / f
    };
    let by_role = |fitted: &Fitted, role| percent(fitted, &of(&study.blocks, role));
    let declared = Structure::default();
    let models = std::iter::once(("declared", &declared, &study.found.base))
        .chain(study.found.steps.iter().map(|s| (s.added.effect.id(), &s.structure, &s.fitted)));
    let mut out = Vec::new();
    for (model, structure, fitted) in models {
        let whole = machine.fit(structure, &all, &fitted.shapes, Known::Start);
        let terms = machine.terms(structure);
        let names = machine
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

/// How all candidates did, round by round.
pub(super) fn candidates(found: &Found) -> Vec<CandidateGain> {
    let row = |round: usize, generic: bool, c: &Candidate| CandidateGain {
        round,
        id: c.id.to_owned(),
        generic,
        gain_percent: c.gain_percent,
        t: c.t,
        blocks_better: c.better,
        blocks_worse: c.worse,
        accepted: c.accepted,
    };
    let last = found.steps.len() + 1;
    let mut out = Vec::new();
    for (i, step) in found.steps.iter().enumerate() {
        out.extend(step.ranking.iter().map(|c| row(i + 1, false, c)));
    }
    out.extend(found.last_round.iter().map(|t| row(last, false, &t.verdict)));
    out.extend(found.generic.iter().map(|g| row(last, true, &g.verdict)));
    out
}

/// What the page shows.
fn study_view(study: &Study) -> page::View {
    let machine = &study.machine;
    let records: Vec<page::RecordView> = machine
        .balances
        .iter()
        .enumerate()
        .map(|(record, b)| {
            let block = Block { record, rows: 0..b.rows(), role: Role::Fit };
            page::RecordView {
                name: b.name.clone(),
                time: b.signals.rows(&b.signals.time),
                position: b.signals.rows(&b.signals.position),
                velocity: b.signals.rows(&b.signals.velocity),
                measured: b.force.clone(),
                before: machine.residual(&study.found.base, &block),
                after: machine.residual(study.found.last(), &block),
            }
        })
        .collect();
    let cut_off = machine.balances.first().map_or(0.0, |b| b.cut_off);
    let words = study.found.steps.iter().map(|s| s.added.effect.words()).collect();
    page::View {
        units: machine.axis.units,
        channel: page::Channel::Force,
        spring: machine.axis.spring,
        records,
        words,
        cut_off,
    }
}
