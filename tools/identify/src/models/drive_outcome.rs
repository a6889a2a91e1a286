//! From what the search found to the verdict, its numbers and its page.

use report::Page;

use super::drive::{SITE, Study, error};
use crate::effects::Effect;
use crate::inverse::model::{Fitted, Structure};
use crate::inverse::search::{Candidate, of};
use crate::inverse::split::{Block, Role};
use crate::outcome::{
    CandidateGain, ChannelError, EffectParameter, FittedParameter, FoundEffect, Named, NextExperiment, Outcome, Roles,
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
    let rivals: Vec<&'static dyn Effect> =
        found.steps.iter().rev().find(|s| !s.rivals.is_empty()).map_or(Vec::new(), |s| s.rivals.clone());
    let remains = found.unlisted.is_some();
    let verdict = match (found.steps.is_empty(), rivals.is_empty(), remains) {
        (true, _, true) => Verdict::Unlisted,
        (true, _, false) => Verdict::None,
        (false, false, _) => Verdict::Ambiguous,
        (false, true, _) => Verdict::Effect,
    };
    let report = of(&study.blocks, Role::Report);
    let (before, force) = error(study, &found.base, &report);
    let (after, _) = error(study, found.last(), &report);
    let channel = ChannelError {
        before,
        after,
        floor: None,
        unit: study.machine.units.force.to_owned(),
        before_percent: 100.0 * before / force,
        after_percent: 100.0 * after / force,
    };
    Outcome {
        verdict,
        effects: effects(study),
        ambiguous_with: rivals.iter().map(|e| Named { id: e.id().into(), site: SITE.into() }).collect(),
        remains,
        unlisted: found.unlisted.as_ref().map(|u| UnlistedTable {
            site: SITE.into(),
            depends_on: u.variable.name().into(),
            table: u.table.clone(),
        }),
        error: [(study.channel.to_owned(), channel)].into(),
        parameters: parameters(study),
        records: roles(study),
        next_experiment: next_experiment(study, &rivals),
        steps: steps(study),
        candidates: candidates(study),
        notes: study.notes.clone(),
        seconds: 0.0,
    }
}

fn effects(study: &Study) -> Vec<FoundEffect> {
    let machine = &study.machine;
    let last = study.found.last();
    let mut amplitude = machine.parameters.len();
    let mut shape = 1;
    let mut out = Vec::new();
    for step in &study.found.steps {
        let Some(inverse) = step.added.inverse() else { continue };
        let mut parameters = Vec::new();
        for term in inverse.terms(&machine.units) {
            let (value, std) = match inverse.lifts() {
                // Its amplitude is what the declared parameter has beyond the edge of its tolerance.
                Some(which) => lifted(study, which),
                None => {
                    amplitude += 1;
                    (last.fit.coefficients[amplitude - 1], last.std[amplitude - 1])
                }
            };
            parameters.push(EffectParameter { name: term.name, value, std: Some(std), unit: term.unit });
        }
        for s in inverse.shapes(&machine.units, &machine.speeds) {
            parameters.push(EffectParameter { name: s.name, value: last.shapes[shape], std: None, unit: s.unit });
            shape += 1;
        }
        let own = step.ranking.iter().find(|c| c.id == step.added.id());
        out.push(FoundEffect {
            id: step.added.id().into(),
            site: SITE.into(),
            parameters,
            t: own.map_or(0.0, |c| c.t),
            gain_percent: own.map_or(0.0, |c| c.gain_percent),
        });
    }
    out
}

/// What a declared parameter has beyond its declared value, and the standard deviation of that.
fn lifted(study: &Study, which: crate::effects::Declared) -> (f64, f64) {
    use crate::effects::Declared;
    use crate::inverse::model::Column;
    let column = match which {
        Declared::Mass => Column::Acceleration,
        Declared::Viscous => Column::Velocity,
    };
    let last = study.found.last();
    let at = study.machine.parameters.iter().position(|p| p.column == column);
    at.map_or((0.0, 0.0), |i| (last.fit.coefficients[i] - study.machine.parameters[i].declared, last.std[i]))
}

fn parameters(study: &Study) -> Vec<FittedParameter> {
    let last = study.found.last();
    let mut out: Vec<FittedParameter> = study
        .machine
        .parameters
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let at_tolerance = last.fit.at_bound[i];
            FittedParameter {
                name: p.name.clone(),
                declared: Some(p.declared),
                fitted: last.fit.coefficients[i],
                std: (!at_tolerance).then_some(last.std[i]),
                unit: p.unit.to_owned(),
                // The records must say more than the declaration did.
                identifiable: !at_tolerance && last.std[i] < p.spread,
                at_tolerance,
            }
        })
        .collect();
    let shapes = study.machine.shapes(&study.found.structure());
    if let Some(smoothing) = shapes.first().filter(|s| s.points > 1) {
        let fitted = last.shapes[0];
        out.push(FittedParameter {
            name: smoothing.name.clone(),
            declared: None,
            fitted,
            std: None,
            unit: smoothing.unit.clone(),
            identifiable: fitted > 1.05 * smoothing.low && fitted < 0.95 * smoothing.high,
            at_tolerance: false,
        });
    }
    out
}

fn roles(study: &Study) -> Roles {
    let name = |b: &Block| {
        let balance = &study.machine.balances[b.record];
        let times = balance.signals.rows(&balance.signals.time);
        let end = times[(b.rows.end - 1).min(times.len() - 1)];
        format!("{}[{:.2}..{:.2} s]", balance.name, times[b.rows.start], end)
    };
    let names = |role| {
        let mut names: Vec<String> = Vec::new();
        for (i, balance) in study.machine.balances.iter().enumerate() {
            let own: Vec<&Block> = study.blocks.iter().filter(|b| b.record == i).collect();
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
        let (e, f) = error(study, fitted, blocks);
        100.0 * e / f
    };
    let by_role = |fitted: &Fitted, role| percent(fitted, &of(&study.blocks, role));
    let mut structure = Structure { effects: Vec::new() };
    let models = std::iter::once(("declared", None, &study.found.base))
        .chain(study.found.steps.iter().map(|s| (s.added.id(), s.added.inverse(), &s.fitted)));
    let mut out = Vec::new();
    for (model, effect, fitted) in models {
        structure.effects.extend(effect);
        let whole = machine.fit(&structure, &all, None);
        let terms = machine.terms(&structure);
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

fn candidates(study: &Study) -> Vec<CandidateGain> {
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
    let found = &study.found;
    let last = found.steps.len() + 1;
    let mut out = Vec::new();
    for (i, step) in found.steps.iter().enumerate() {
        out.extend(step.ranking.iter().map(|c| row(i + 1, false, c)));
    }
    out.extend(found.last_ranking.iter().map(|c| row(last, false, c)));
    out.extend(found.splines.iter().map(|c| row(last, true, c)));
    out
}

fn next_experiment(study: &Study, rivals: &[&'static dyn Effect]) -> NextExperiment {
    let make = |why: String, what: &str| NextExperiment { why, what: what.to_owned() };
    let steps = &study.found.steps;
    if let (Some(rival), Some(step)) = (rivals.first(), steps.iter().rev().find(|s| !s.rivals.is_empty())) {
        return make(
            format!("These records cannot tell {} from {}.", step.added.words(), rival.words()),
            step.added.experiment(),
        );
    }
    if let Some(unlisted) = &study.found.unlisted {
        let what = match unlisted.variable.name() {
            "time" => "the same movement for ten times as long, with the temperature recorded",
            "velocity" => "constant speeds from the slowest to the fastest that the drive can hold, both ways",
            "acceleration" => "the same stroke with accelerations that differ by factors of two",
            _ => "the whole stroke at one slow constant speed, both ways, several times",
        };
        return make(
            format!("Something is left that depends on {} and has no name here.", unlisted.variable.name()),
            what,
        );
    }
    let unsure = parameters(study).into_iter().find(|p| !p.identifiable && p.declared.is_some());
    if let Some(parameter) = unsure {
        let why = format!("These records say no more about {} than its declaration.", parameter.name);
        return make(
            why,
            "quick reversals (for the mass) and strokes at several constant speeds (for friction and offset)",
        );
    }
    match steps.last() {
        Some(step) if study.machine.balances.len() < 3 => make(
            format!("One run cannot show that {} is the same on another day.", step.added.words()),
            step.added.experiment(),
        ),
        Some(step) => {
            make(format!("The value of {} could be had more exactly.", step.added.words()), step.added.experiment())
        }
        None => make(
            "Nothing is missing that this movement could show; effects that it does not excite stay unseen.".to_owned(),
            "the whole stroke slowly both ways, quick reversals, and a long run with the temperature recorded",
        ),
    }
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
                force: b.force.clone(),
                before: machine.residual(&study.found.base, &block),
                after: machine.residual(study.found.last(), &block),
            }
        })
        .collect();
    let cut_off = machine.balances.first().map_or(0.0, |b| b.cut_off);
    let words = study.found.steps.iter().map(|s| s.added.words()).collect();
    page::View { units: machine.units, records, words, cut_off }
}
