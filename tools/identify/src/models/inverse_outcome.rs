//! From what the search found to the verdict, its numbers and its page, for models that are read inversely.

use report::Page;

use super::inverse_left::{left, shift_note, shows};
use super::inverse_study::{Study, error};
use super::next_experiment::Open;
use crate::effects::Declared;
use crate::inverse::fit::Known;
use crate::inverse::model::{Column, Fitted, Machine, Structure};
use crate::inverse::search::{Candidate, Found, Sited, Tried, of};
use crate::inverse::split::{Block, Role};
use crate::outcome::{
    CandidateGain, ChannelError, EffectParameter, FittedParameter, FoundEffect, Named, Outcome, Roles, Sight,
    StepError, UnlistedTable, Verdict,
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
    let rivals: Vec<Sited> =
        found.steps.iter().rev().find(|s| !s.rivals.is_empty()).map_or(Vec::new(), |s| s.rivals.clone());
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
        unsure: declared.iter().find(|p| !p.identifiable && p.declared.is_some()).map(|p| p.name.clone()),
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
        let shift = study.machine.hidden_shift(&tried.structure, &tried.fitted).filter(|_| shows(&tried.verdict))?;
        Some(shift_note(&study.machine, &tried.verdict, shift))
    };
    study.notes.iter().cloned().chain(study.found.last_round.iter().filter_map(shift)).collect()
}

/// An effect by name and site.
pub(super) fn named(sited: &Sited) -> Named {
    Named { id: sited.effect.id().into(), site: sited.site.into() }
}

/// The table of what has no name. The site is where most of the listed effects of this kind of model sit.
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

/// Parameters of the effect at one place of a fitted structure.
pub(super) fn effect_parameters(
    machine: &Machine,
    structure: &Structure<'static>,
    at: usize,
    fitted: &Fitted,
) -> Vec<EffectParameter> {
    let Some(inverse) = structure.effects.get(at).copied() else { return Vec::new() };
    let before = structure.effects[..at].iter().map(|e| machine.terms_of(*e).len()).sum::<usize>();
    let mut amplitude = machine.parameters.len() + before;
    let mut parameters = Vec::new();
    for term in inverse.terms(&machine.axis) {
        let (value, std) = match inverse.lifts().filter(|_| machine.frees(inverse)) {
            // Its amplitude is what the declared parameter has beyond its declared value.
            Some(which) => lifted(machine, fitted, which),
            None => {
                amplitude += 1;
                (fitted.fit.coefficients[amplitude - 1], fitted.std[amplitude - 1])
            }
        };
        if !term.is_given() {
            parameters.push(EffectParameter { name: term.name, value, std: Some(std), unit: term.unit });
        }
    }
    let place = machine.places(structure)[at].clone();
    for (shape, value) in inverse.shapes(&machine.axis).into_iter().zip(&fitted.shapes[place]) {
        parameters.push(EffectParameter { name: shape.name, value: *value, std: None, unit: shape.unit });
    }
    parameters
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

/// What a declared parameter has beyond its declared value, and the standard deviation of that.
fn lifted(machine: &Machine, fitted: &Fitted, which: Declared) -> (f64, f64) {
    let at = machine.parameters.iter().position(|p| p.column == Column::of(which));
    at.map_or((0.0, 0.0), |i| (fitted.fit.coefficients[i] - machine.parameters[i].declared, fitted.std[i]))
}

/// A force is a sum of few terms here: what is not seen is flat.
const fn sight(identifiable: bool, at_tolerance: bool) -> Sight {
    match (at_tolerance, identifiable) {
        (true, _) => Sight::AtBound,
        (false, true) => Sight::Seen,
        (false, false) => Sight::Flat,
    }
}

/// Declared parameters, as fitted.
pub(super) fn parameters(machine: &Machine, structure: &Structure<'_>, last: &Fitted) -> Vec<FittedParameter> {
    let mut out: Vec<FittedParameter> = machine
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
                sight: sight(identifiable, at_tolerance),
                trades_with: None,
            }
        })
        .collect();
    let shapes = machine.shapes(structure);
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
            sight: sight(identifiable, false),
            trades_with: None,
        });
    }
    out
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
    let rows = study.machine.balances.iter().map(crate::inverse::signals::Balance::rows).enumerate();
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
        let names = machine.parameters.iter().map(|p| p.name.clone()).chain(terms.into_iter().map(|t| t.name));
        out.push(StepError {
            model: model.to_owned(),
            fit_percent: by_role(fitted, Role::Fit),
            select_percent: by_role(fitted, Role::Select),
            report_percent: by_role(fitted, Role::Report),
            all_rows_percent: whole.as_ref().map_or(f64::NAN, |w| percent(w, &all)),
            all_rows_parameters: whole
                .map_or(Vec::new(), |w| names.enumerate().map(|(i, n)| (n, w.fit.coefficients[i], w.std[i])).collect()),
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
