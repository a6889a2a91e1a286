//! Outcome of an oscillator: verdict, numbers and page.

use std::collections::BTreeMap;

use report::Page;

use super::equation_error_outcome::{
    candidate_gain, channel_error, named, roles, unlisted, unsure,
};
use super::equation_error_parameters::{effect_parameters, parameters};
use super::next_experiment::OpenQuestion;
use super::oscillator_search::{SearchResult, SelectionStep, SimulatedCandidate};
use super::unaccepted_effects::{shift_note, shows};
use crate::equation_error::block_roles::{Block, Role};
use crate::equation_error::model::{Fitted, RegressionModel, Structure};
use crate::equation_error::search::{SitedEffect, of};
use crate::equation_error::validation::Validation;
use crate::outcome::{CandidateGain, FoundEffect, Left, Outcome, StepError, Verdict};
use crate::output_error::fit::{OutputErrorModel, Record, Simulated};
use crate::page;

/// An oscillator's model, records and search result.
pub(super) struct Study<'a> {
    /// Declared model and records for the equation-error method.
    pub(super) regression: &'a RegressionModel,
    /// Records for the output-error method.
    pub(super) records: &'a [Record],
    /// Rows by role.
    pub(super) blocks: &'a [Block],
    /// What the search found.
    pub(super) found: SearchResult,
    /// Notes on the data.
    pub(super) notes: Vec<String>,
}

impl Study<'_> {
    /// The verdict, and the page that shows it.
    pub(super) fn conclude(&self) -> (Outcome, Page) {
        let outcome = self.outcome();
        let page = page::page(self.view(), &outcome);
        (outcome, page)
    }

    fn simulation(&self) -> OutputErrorModel<'_> {
        OutputErrorModel { regression: self.regression, records: self.records }
    }

    fn outcome(&self) -> Outcome {
        let found = &self.found;
        let contested = found.steps.iter().rev().find(|s| !s.rivals.is_empty());
        let rivals: &[SitedEffect] = contested.map_or(&[], |s| &s.rivals);
        let remains =
            found.unlisted.is_some() || found.last_simulated.iter().any(|p| p.validation.accepted);
        let verdict = Verdict::of(found.steps.len(), rivals.len(), remains);
        let report = of(self.blocks, Role::Report);
        let [before, after] =
            [&found.base, found.last()].map(|simulated| self.error(simulated, &report));
        let channel = channel_error(before, after, self.regression.axis.units.position);
        let declared = parameters(self.regression, &found.structure(), &found.last().fitted);
        let open = OpenQuestion {
            contested: contested.and_then(|s| Some((s.added.sited, *s.rivals.first()?))),
            unlisted: found.unlisted.as_ref().map(|u| u.variable),
            unsure: unsure(&declared),
            last: found.steps.last().map(|s| s.added.sited),
            records: self.records.len(),
            spring: true,
        };
        Outcome {
            verdict,
            effects: self.effects(),
            ambiguous_with: rivals.iter().map(named).collect(),
            remains,
            unlisted: unlisted(self.regression, found.unlisted.as_ref()),
            calibration: None,
            left: self.left(),
            error: BTreeMap::from([("output".to_owned(), channel)]),
            parameters: declared,
            records: roles(self.regression, self.blocks),
            next_experiment: open.next_experiment(),
            steps: self.steps(),
            candidates: self.candidates(),
            notes: self.notes(),
            seconds: 0.0,
        }
    }

    fn notes(&self) -> Vec<String> {
        let shift = |ranked: &SimulatedCandidate| {
            let (structure, fitted) = (&ranked.structure, &ranked.simulated.fitted);
            let shift = self
                .regression
                .hidden_shift(structure, fitted)
                .filter(|_| shows(&ranked.validation))?;
            Some(shift_note(self.regression, &ranked.validation, shift))
        };
        self.notes
            .iter()
            .cloned()
            .chain(self.found.last_simulated.iter().filter_map(shift))
            .collect()
    }

    /// Root mean square of the output error over some blocks, and of the output over the same rows.
    fn error(&self, simulated: &Simulated, blocks: &[Block]) -> (f64, f64) {
        let (mut e, mut y, mut n) = (0.0, 0.0, 0usize);
        for block in blocks {
            e += self
                .simulation()
                .residual(&simulated.outputs, block)
                .iter()
                .map(|e| e * e)
                .sum::<f64>();
            y += self.records[block.record].output[block.rows.clone()]
                .iter()
                .map(|y| y * y)
                .sum::<f64>();
            n += block.rows.len();
        }
        ((e / n.max(1) as f64).sqrt(), (y / n.max(1) as f64).sqrt())
    }

    fn effects(&self) -> Vec<FoundEffect> {
        let structure = self.found.structure();
        let effect = |(at, step): (usize, &SelectionStep)| {
            let sited = step.added.sited;
            FoundEffect {
                id: sited.effect.id.into(),
                site: sited.site.into(),
                parameters: effect_parameters(
                    self.regression,
                    &structure,
                    at,
                    &self.found.last().fitted,
                ),
                t: step.added.validation.t,
                gain_percent: step.added.validation.gain_percent,
            }
        };
        self.found.steps.iter().enumerate().map(effect).collect()
    }

    /// Errors after each step; an effect of two terms is shown with its first term alone, too.
    fn steps(&self) -> Vec<StepError> {
        let declared = Structure::default();
        let found = &self.found;
        let mut out: Vec<StepError> =
            vec![self.step("declared".to_owned(), &declared, &found.base, &found.base.fitted, &[])];
        for step in &found.steps {
            let (structure, simulated) = (&step.added.structure, &step.added.simulated);
            let id = step.added.sited.effect.id;
            let terms = self.regression.terms_of(step.added.sited.effect.regressor);
            if terms.len() == 2 {
                let all = self.regression.terms(structure).len();
                let second = [all - 1];
                let fit = of(self.blocks, Role::Fit);
                if let Some(first) =
                    self.simulation().fit(structure, &fit, &simulated.fitted, &second)
                {
                    let name = format!("{id}, {} alone", terms[0].name);
                    out.push(self.step(name, structure, &first, &simulated.fitted, &second));
                }
            }
            out.push(self.step(id.to_owned(), structure, simulated, &simulated.fitted, &[]));
        }
        out
    }

    fn step(
        &self,
        model: String,
        structure: &Structure<'static>,
        simulated: &Simulated,
        start: &Fitted,
        without: &[usize],
    ) -> StepError {
        let regression = self.regression;
        let percent = |simulated: &Simulated, blocks: &[Block]| {
            let (e, y) = self.error(simulated, blocks);
            100.0 * e / y
        };
        let by_role = |role| percent(simulated, &of(self.blocks, role));
        let rows = self.records.iter().map(|r| r.output.len()).enumerate();
        let all: Vec<Block> =
            rows.map(|(record, n)| Block { record, rows: 0..n, role: Role::Fit }).collect();
        let whole = self.simulation().fit(structure, &all, start, without);
        let terms = regression.terms(structure).into_iter().map(|t| t.name);
        let names = regression.parameters.iter().map(|p| p.name.clone()).chain(terms);
        StepError {
            model,
            fit_percent: by_role(Role::Fit),
            select_percent: by_role(Role::Select),
            report_percent: by_role(Role::Report),
            all_rows_percent: whole.as_ref().map_or(f64::NAN, |w| percent(w, &all)),
            all_rows_parameters: whole.map_or(Vec::new(), |w| {
                names
                    .enumerate()
                    .map(|(i, n)| (n, w.fitted.fit.coefficients[i], w.fitted.std[i]))
                    .collect()
            }),
        }
    }

    fn candidates(&self) -> Vec<CandidateGain> {
        let row = |round: usize, generic: bool, c: &Validation, simulated: bool| {
            let id = if simulated { c.id.to_owned() } else { format!("{} (screened)", c.id) };
            CandidateGain { id, ..candidate_gain(round, generic, c) }
        };
        let found = &self.found;
        let last = found.steps.len() + 1;
        let mut out = Vec::new();
        for (i, step) in found.steps.iter().enumerate() {
            out.extend(step.ranking.iter().map(|(c, simulated)| row(i + 1, false, c, *simulated)));
        }
        let last_ranking = found.last_ranking.iter();
        out.extend(last_ranking.map(|(c, simulated)| row(last, false, c, *simulated)));
        let nonparametric = found.nonparametric.iter();
        out.extend(nonparametric.map(|(c, _, simulated)| row(last, true, c, *simulated)));
        out
    }

    /// Effects that are visible in the last round but not accepted. Sizes are rms changes of the
    /// output.
    fn left(&self) -> Vec<Left> {
        let select = of(self.blocks, Role::Select);
        let now = &self.found.last().outputs;
        let mut left: Vec<Left> = Vec::new();
        for ranked in self.found.last_simulated.iter().filter(|p| shows(&p.validation)) {
            let (mut sum, mut rows) = (0.0, 0usize);
            for block in &select {
                let (with, without) = (&ranked.simulated.outputs[block.record], &now[block.record]);
                sum += block.rows.clone().map(|r| (with[r] - without[r]).powi(2)).sum::<f64>();
                rows += block.rows.len();
            }
            let at = ranked.structure.effects.len() - 1;
            left.push(Left {
                id: ranked.validation.id.into(),
                site: Some(ranked.sited.site.into()),
                size: (sum / rows.max(1) as f64).sqrt(),
                unit: self.regression.axis.units.position.into(),
                gain_percent: ranked.validation.gain_percent,
                t: ranked.validation.t,
                parameters: effect_parameters(
                    self.regression,
                    &ranked.structure,
                    at,
                    &ranked.simulated.fitted,
                ),
            });
        }
        left
    }

    fn view(&self) -> page::View {
        let records = self.regression.balances.iter().zip(self.records).enumerate().map(
            |(i, (b, record))| {
                let block = Block { record: i, rows: 0..b.rows(), role: Role::Fit };
                let [before, after] = [&self.found.base, self.found.last()]
                    .map(|model| self.simulation().residual(&model.outputs, &block));
                page::RecordView::new(b, &record.output, before, after)
            },
        );
        page::View {
            units: self.regression.axis.units,
            channel: page::Channel::Output,
            spring: true,
            records: records.collect(),
            words: self.found.steps.iter().map(|s| s.added.sited.effect.words).collect(),
            cut_off: self.regression.axis.cut_off,
        }
    }
}
