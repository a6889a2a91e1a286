//! The search of an oscillator: screened by the balance of the input, decided by simulation.

use crate::effects::InverseEffect;
use crate::inverse::fit::Known;
use crate::inverse::model::{Fitted, Machine, Structure};
use crate::inverse::search::{
    Candidate, LEAST_T, MOST_EFFECTS, Round, Sited, Standing, Tried, Unlisted, candidates, choose,
    generic, judge, near, of,
};
use crate::inverse::spline::{Spline, Variable};
use crate::inverse::split::{Block, Role};
use crate::output_error::fit::{Bench, Record, Simulated};
use crate::output_error::simulation::can_simulate;

/// So many of the screened candidates are simulated.
const SIMULATED: usize = 4;

/// A candidate that was simulated.
#[derive(Clone)]
pub(super) struct Proved {
    /// The effect.
    pub(super) sited: Sited,
    /// How its simulation did on the selecting rows.
    pub(super) verdict: Candidate,
    /// The model with it.
    pub(super) structure: Structure<'static>,
    /// Its simulation.
    pub(super) simulated: Simulated,
    after: Vec<f64>,
    /// Its fit to the balance of the input.
    screened: Fitted,
}

impl Proved {
    fn standing(&self) -> Standing<'_> {
        Standing { sited: self.sited, verdict: &self.verdict, after: &self.after }
    }
}

/// One step: an effect that was added.
pub(super) struct Step {
    /// Candidates as they did: simulated ones first, then those that were screened only.
    pub(super) ranking: Vec<(Candidate, bool)>,
    /// What was added.
    pub(super) added: Proved,
    /// What did as well.
    pub(super) rivals: Vec<Sited>,
}

/// What the search found.
pub(super) struct Found {
    /// The declared model within its tolerances.
    pub(super) base: Simulated,
    /// Effects in the order in which they were added.
    pub(super) steps: Vec<Step>,
    /// Candidates of the last round, in which none passed.
    pub(super) last_ranking: Vec<(Candidate, bool)>,
    /// Those of them that were simulated.
    pub(super) last_proved: Vec<Proved>,
    /// Generic functions: verdict, table, and whether it was simulated.
    pub(super) generic: Vec<(Candidate, Unlisted, bool)>,
    /// The best of them, where it passes.
    pub(super) unlisted: Option<Unlisted>,
}

impl Found {
    /// The last model.
    pub(super) fn last(&self) -> &Simulated {
        self.steps.last().map_or(&self.base, |s| &s.added.simulated)
    }
    /// Its structure.
    pub(super) fn structure(&self) -> Structure<'static> {
        self.steps.last().map_or_else(Structure::default, |s| s.added.structure.clone())
    }
}

struct Search<'a> {
    bench: Bench<'a>,
    fit: Vec<Block>,
    select: Vec<Block>,
    jobs: usize,
}

impl Search<'_> {
    /// Simulates the best screened candidates; best first.
    fn prove(&self, tried: &[Tried], now: &Simulated) -> Vec<Proved> {
        let before = self.bench.mean_squares(now, &self.select);
        let promising: Vec<&Tried> = tried
            .iter()
            .filter(|t| t.verdict.t >= LEAST_T && t.verdict.gain_percent > 0.0)
            .take(SIMULATED)
            .collect();
        let prove = |tried: &Tried| {
            let start = from_here(&tried.fitted, now);
            let simulated = self.bench.fit(&tried.structure, &self.fit, &start, &[])?;
            let after = self.bench.mean_squares(&simulated, &self.select);
            let mut verdict = judge(tried.verdict.id, &before, &after);
            verdict.accepted &=
                self.bench.machine.hidden_shift(&tried.structure, &simulated.fitted).is_none();
            let (structure, screened) = (tried.structure.clone(), tried.fitted.clone());
            Some(Proved { sited: tried.sited, verdict, structure, simulated, after, screened })
        };
        let jobs = self.jobs.max(1);
        let mut proved: Vec<Proved> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..jobs)
                .map(|job| {
                    let own = promising.iter().skip(job).step_by(jobs);
                    scope.spawn(move || own.filter_map(|t| prove(t)).collect::<Vec<_>>())
                })
                .collect();
            threads.into_iter().flat_map(|t| t.join().unwrap_or_default()).collect()
        });
        proved.sort_by(|a, b| b.verdict.gain_percent.total_cmp(&a.verdict.gain_percent));
        proved
    }

    /// Those that did about as well as the winner and have nothing to add to it; at most two.
    fn rivals(&self, winner: &Proved, near: Vec<Sited>) -> Vec<Sited> {
        if near.is_empty() {
            return near;
        }
        let round = Round {
            machine: self.bench.machine,
            structure: &winner.structure,
            now: &winner.screened,
            fit: &self.fit,
            select: &self.select,
            how: Known::Unrefined,
        };
        let beside = self.prove(&round.try_all(&near, self.jobs), &winner.simulated);
        let adds =
            |c: &Sited| beside.iter().any(|b| b.verdict.id == c.effect.id() && b.verdict.accepted);
        near.into_iter().filter(|c| !adds(c)).take(2).collect()
    }

    /// Generic functions, screened, the promising ones simulated.
    fn generic(&self, round: &Round<'_>, now: &Simulated) -> Vec<(Candidate, Unlisted, bool)> {
        let mut all: Vec<_> = generic(round)
            .into_iter()
            .map(|g| {
                let shows = g.verdict.t >= LEAST_T && g.verdict.gain_percent > 3.0;
                let proved =
                    shows.then(|| self.prove_generic(round, g.unlisted.variable, now)).flatten();
                match proved {
                    Some((verdict, unlisted)) => (verdict, unlisted, true),
                    None => (Candidate { accepted: false, ..g.verdict }, g.unlisted, false),
                }
            })
            .collect();
        all.sort_by(|a, b| {
            (b.2, b.0.gain_percent)
                .partial_cmp(&(a.2, a.0.gain_percent))
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        all
    }

    fn prove_generic(
        &self,
        round: &Round<'_>,
        variable: Variable,
        now: &Simulated,
    ) -> Option<(Candidate, Unlisted)> {
        let before = &self.bench.mean_squares(now, &self.select);
        let machine = self.bench.machine;
        let spline = Spline::over(variable, machine.balances.iter().map(|b| &b.signals))?;
        let generic: &dyn InverseEffect = &spline;
        generic.law()?;
        let effects = round.structure.effects.iter().copied().chain([generic]).collect();
        let wider = Structure { effects, model: round.structure.model.clone() };
        let start = machine.fit(&wider, &self.fit, &round.now.shapes, Known::Held)?;
        let simulated = self.bench.fit(&wider, &self.fit, &from_here(&start, now), &[])?;
        let verdict =
            judge(variable.name(), before, &self.bench.mean_squares(&simulated, &self.select));
        let fitted = &simulated.fitted;
        let from = fitted.fit.coefficients.len() - spline.knots.len();
        let at =
            |i: usize| [spline.knots[i], fitted.fit.coefficients[from + i], fitted.std[from + i]];
        Some((verdict, Unlisted { variable, table: (0..spline.knots.len()).map(at).collect() }))
    }
}

/// What is in the model starts where its simulation is, what is new where the screening found it.
fn from_here(screened: &Fitted, now: &Simulated) -> Fitted {
    let mut start = screened.clone();
    let known = &now.fitted;
    for (to, from) in start.fit.coefficients.iter_mut().zip(known.fit.coefficients.iter()) {
        *to = *from;
    }
    start.shapes[1..known.shapes.len()].copy_from_slice(&known.shapes[1..]);
    start
}

/// Simulated candidates first, then those that were screened only, which cannot pass.
fn ranking(proved: &[Proved], tried: &[Tried]) -> Vec<(Candidate, bool)> {
    let simulated = |id: &str| proved.iter().any(|p| p.verdict.id == id);
    let screened = tried.iter().filter(|t| !simulated(t.verdict.id)).map(|t| &t.verdict);
    let screened = screened.map(|v| (Candidate { accepted: false, ..v.clone() }, false));
    proved.iter().map(|p| (p.verdict.clone(), true)).chain(screened).collect()
}

/// Greedy search by simulated output. `None` where not even the declared model can be fitted.
pub(super) fn search(
    machine: &Machine,
    records: &[Record],
    blocks: &[Block],
    jobs: usize,
) -> Option<Found> {
    let (fit, select) = (of(blocks, Role::Fit), of(blocks, Role::Select));
    let search = Search { bench: Bench { machine, records }, fit, select, jobs };
    let mut structure = Structure::default();
    let mut screened = machine.fit(&structure, &search.fit, &[], Known::Start)?;
    let base = search.bench.fit(&structure, &search.fit, &screened, &[])?;
    let mut now = base.clone();
    let mut steps: Vec<Step> = Vec::new();
    let (last_ranking, last_proved) = loop {
        let added: Vec<Sited> = steps.iter().map(|s| s.added.sited).collect();
        let list: Vec<Sited> = candidates(machine, &added, &now.fitted)
            .into_iter()
            .filter(|c| machine.frees(c.inverse) || can_simulate(c.inverse))
            .collect();
        // What the screening leaves coarse the simulation refines.
        let how = Known::Unrefined;
        let round = Round {
            machine,
            structure: &structure,
            now: &screened,
            fit: &search.fit,
            select: &search.select,
            how,
        };
        let tried = round.try_all(&list, jobs);
        let proved = search.prove(&tried, &now);
        let ranking = ranking(&proved, &tried);
        let standings: Vec<Standing<'_>> = proved.iter().map(Proved::standing).collect();
        let room = steps.len() < MOST_EFFECTS;
        let Some(best) = choose(machine, &added, &standings).filter(|_| room) else {
            break (ranking, proved);
        };
        let rivals = search.rivals(&proved[best], near(machine, &standings, best));
        let added = proved[best].clone();
        structure = added.structure.clone();
        screened = added.screened.clone();
        now = added.simulated.clone();
        steps.push(Step { ranking, added, rivals });
    };
    let how = Known::Held;
    let round = Round {
        machine,
        structure: &structure,
        now: &screened,
        fit: &search.fit,
        select: &search.select,
        how,
    };
    let generic = search.generic(&round, &now);
    let unlisted = generic.iter().find(|g| g.0.accepted).map(|g| g.1.clone());
    Some(Found { base, steps, last_ranking, last_proved, generic, unlisted })
}
