//! The next experiment, found by simulation: of the movements that the rig can play by itself, the
//! one that tells most.
//!
//! Where two effects explain the records alike, each model is let predict what the other's machine
//! would do: one moves, the other is pulled along its record as along a measured one, and what it
//! has to be pulled by, less what its own parameters could take up, is what would tell the two
//! apart. Where nothing is contested, the declared parameters that the records do not show are
//! moved through their tolerances instead. Both are counted in units of the floor: what repeats of
//! a movement leave, or else what the fitted model leaves.

use nalgebra::{DMatrix, DVector};
use plant::any::Plant;
use plant::effects::Site;
use rayon::prelude::*;

use super::transmission_study::Study;
use super::transmission_words::{rival_words, words};
use super::trials::{PLAYED_S, PREDICTED_S, Stage, Trial};
use crate::forward::catalogue::{Candidate, candidates};
use crate::forward::fit::{Fitted, View};
use crate::forward::judge::{BLOCK, errors};
use crate::forward::knob::{Knob, knobs_of};
use crate::forward::machine::{Channel, Machine, Placed, Residual, Setting};
use crate::forward::record::Record;
use crate::forward::screen::{basis, scale};
use crate::forward::search::WHICH_ENCODER;
use crate::inverse::split::Role;
use crate::outcome::{FittedParameter, NextExperiment, Verdict};

/// Trials of which it is asked what the parameters could take up.
const EXAMINED: usize = 8;
/// Movements in a proposal.
const MOVEMENTS: usize = 2;
/// A difference of fewer floors tells nothing: it raises an error at the floor by less than a
/// tenth.
const LEAST: f64 = 0.46;
/// A parameter is shown where its standard deviation is to be less than half of half its tolerance.
const SHOWN: f64 = 2.0;

/// What a trial would tell, in floors.
#[derive(Clone, Copy, Debug)]
struct Told {
    trial: Trial,
    floors: f64,
}

/// The next experiment with its protocol, where one can be found; without one, why not.
pub(super) fn propose(
    study: &Study,
    stage: &Stage,
    verdict: Verdict,
    parameters: &[FittedParameter],
) -> Option<NextExperiment> {
    match verdict {
        Verdict::Ambiguous => between_two(study, stage),
        Verdict::Effect | Verdict::None => for_parameters(study, stage, parameters),
        // With something left that has no name there are no two models to be compared.
        Verdict::Unlisted => None,
    }
}

/// Separates the effect that is contested from its first rival.
fn between_two(study: &Study, stage: &Stage) -> Option<NextExperiment> {
    let found = &study.found;
    let (at, step) =
        found.steps.iter().enumerate().rev().find(|(_, step)| !step.rivals.is_empty())?;
    let rival = *step.rivals.first()?;
    let own = &found.last().setting;
    let (other, knobs) = rival_of(study, at, rival)?;
    let floors = floors(study)?;
    let all: Vec<(Trial, Record)> = Trial::all(stage)
        .into_par_iter()
        .filter_map(|trial| Some((trial, recorded(study, stage, trial, own)?)))
        .collect();
    // First by what differs at all, then by what the rival's parameters could not take up.
    let mut first: Vec<(f64, &Trial, Machine)> = all
        .iter()
        .filter_map(|(trial, record)| {
            let machine = Machine { records: vec![record.clone()], ..study.machine.clone() };
            let size = difference(&machine, own, &other, &floors)?.norm();
            Some((size, trial, machine))
        })
        .collect();
    first.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut told: Vec<Told> = first
        .into_iter()
        .take(EXAMINED)
        .filter_map(|(_, trial, machine)| {
            let left = difference(&machine, own, &other, &floors)?;
            let rows = left.len();
            let slopes = slopes(&machine, &other, &knobs, &floors)?;
            let left = without(&left, &slopes);
            Some(Told { trial: *trial, floors: left.norm() / (rows as f64).sqrt() })
        })
        .collect();
    told.sort_by(|a, b| b.floors.total_cmp(&a.floors));
    let names = format!(
        "{} from {}",
        words(step.added.id),
        rival_words((step.added.id, step.added.site), rival)
    );
    let why = format!("These records cannot tell {names}.");
    let Some(best) = told.first().filter(|best| best.floors >= LEAST) else {
        let most = told.first().map_or(0.0, |best| best.floors);
        return Some(NextExperiment {
            why,
            what: format!(
                "no movement that the rig plays by itself: the two models would differ by {most:.2} times what repeats leave at most; a hand that \
                 drives the slave, or an instrument between the two"
            ),
            protocol: None,
        });
    };
    let chosen = chosen(told.iter().map(|told| told.trial));
    let what = format!(
        "{}, {PLAYED_S} s each: the two models would differ by {:.1} times what repeats leave, beyond what their parameters can take up",
        listed(&chosen),
        best.floors
    );
    let description = format!("Tells {names}");
    Some(NextExperiment {
        why,
        what,
        protocol: Some(stage.protocol("tell-apart", &description, &chosen)),
    })
}

/// How closely a trial shows declared parameters: 1 over the standard deviation to be expected, in
/// units of half the tolerance.
struct Shown {
    trial: Trial,
    /// By index in the machine's base.
    closeness: Vec<(usize, f64)>,
}

impl Shown {
    /// Of some parameters; each counts once it is shown, and hardly more for being shown very
    /// closely.
    fn score(&self, of: &[usize]) -> f64 {
        self.of(of).map(|(_, closeness)| closeness / (SHOWN + closeness)).sum()
    }

    fn of(&self, of: &[usize]) -> impl Iterator<Item = (usize, f64)> {
        self.closeness.iter().copied().filter(|(index, _)| of.contains(index))
    }
}

/// Shows the parameters that the records did not; where they showed all, or no movement shows more,
/// all of them more closely.
fn for_parameters(
    study: &Study,
    stage: &Stage,
    parameters: &[FittedParameter],
) -> Option<NextExperiment> {
    let machine = &study.machine;
    let all: Vec<usize> =
        (0..machine.base.len()).filter(|index| machine.base[*index].declared.is_some()).collect();
    let unseen = |index: &usize| {
        parameters.iter().any(|p| p.name == machine.base[*index].name && !p.identifiable)
    };
    let unseen: Vec<usize> = all.iter().copied().filter(unseen).collect();
    let floors = floors(study)?;
    let shown: Vec<Shown> = Trial::all(stage)
        .into_iter()
        .filter_map(|trial| shown(study, stage, trial, &all, &floors))
        .collect();
    let best =
        |wanted: &[usize]| shown.iter().max_by(|a, b| a.score(wanted).total_cmp(&b.score(wanted)));
    let clear = |shown: &Shown, wanted: &[usize]| {
        let mut clear: Vec<(usize, f64)> =
            shown.of(wanted).filter(|(_, closeness)| *closeness >= SHOWN).collect();
        clear.sort_by(|a, b| b.1.total_cmp(&a.1));
        clear
    };
    let names = |list: &[usize]| -> String {
        let names: Vec<&str> =
            list.iter().map(|index| machine.base[*index].name.as_str()).take(4).collect();
        format!("{}{}", names.join(", "), if list.len() > 4 { " and others" } else { "" })
    };
    let unseen_can_be = best(&unseen).is_some_and(|best| !clear(best, &unseen).is_empty());
    let why = match (unseen.is_empty(), unseen_can_be) {
        (true, _) => {
            "The records show every declared parameter; they could show them more closely."
                .to_owned()
        }
        (false, true) => {
            format!("The records say no more than the declaration of {}.", names(&unseen))
        }
        (false, false) => format!(
            "The records say no more than the declaration of {}, which no movement of this rig tells from the others; of the others they could say \
             more.",
            names(&unseen)
        ),
    };
    let wanted = if unseen_can_be { unseen } else { all };
    let mut order: Vec<&Shown> = shown.iter().collect();
    order.sort_by(|a, b| b.score(&wanted).total_cmp(&a.score(&wanted)));
    let clear = order.first().map_or(Vec::new(), |best| clear(best, &wanted));
    let Some((first, closeness)) = clear.first() else {
        let what = "parameters measured by themselves, or declared more closely: no movement that the rig plays by itself shows them";
        return Some(NextExperiment { why, what: what.to_owned(), protocol: None });
    };
    let chosen = chosen(order.iter().map(|shown| shown.trial));
    let others: Vec<usize> = clear.iter().skip(1).map(|(index, _)| *index).collect();
    let what = format!(
        "{}, {PLAYED_S} s each: {:.0} s of the first should tell {} to {:.0} % of its tolerance{}",
        listed(&chosen),
        PREDICTED_S,
        names(&[*first]),
        100.0 / closeness,
        if others.is_empty() { String::new() } else { format!(", and shows {}", names(&others)) }
    );
    let description = "Shows what the records did not, or more closely";
    Some(NextExperiment {
        why,
        what,
        protocol: Some(stage.protocol("show-more", description, &chosen)),
    })
}

/// How closely a trial shows each of some parameters beside all others: what the others could do
/// alike is no sign of it.
fn shown(
    study: &Study,
    stage: &Stage,
    trial: Trial,
    of: &[usize],
    floors: &[(Channel, f64)],
) -> Option<Shown> {
    let own = &study.found.last().setting;
    let knobs: Vec<Knob> = (0..study.machine.base.len()).map(Knob::Base).collect();
    let machine =
        Machine { records: vec![recorded(study, stage, trial, own)?], ..study.machine.clone() };
    let slopes = slopes(&machine, own, &knobs, floors)?;
    let closeness = |index: &usize| {
        let others = slopes.clone().remove_column(*index);
        let left = without(&slopes.column(*index).into_owned(), &others).norm();
        (*index, left / (BLOCK as f64).sqrt())
    };
    Some(Shown { trial, closeness: of.iter().map(closeness).collect() })
}

/// The best trial, and the best of another kind.
fn chosen(best_first: impl Iterator<Item = Trial>) -> Vec<Trial> {
    let mut chosen: Vec<Trial> = Vec::new();
    for trial in best_first {
        if chosen.len() < MOVEMENTS && chosen.iter().all(|before| !before.is_like(trial)) {
            chosen.push(trial);
        }
    }
    chosen
}

fn listed(trials: &[Trial]) -> String {
    trials.iter().map(|trial| trial.words()).collect::<Vec<_>>().join(", then ")
}

/// What repeats leave of each channel, or what the fitted model leaves where nothing was repeated.
fn floors(study: &Study) -> Option<Vec<(Channel, f64)>> {
    let report = study.machine.of_role(Role::Report);
    let errors = errors(&study.machine, &report, &study.found.last().setting)?;
    Some(
        errors
            .into_iter()
            .map(|(channel, error, floor)| (channel, floor.unwrap_or(error).max(1e-7)))
            .collect(),
    )
}

/// The record of a trial by the machine that a setting describes.
fn recorded(study: &Study, stage: &Stage, trial: Trial, setting: &Setting) -> Option<Record> {
    let machine = &study.machine;
    let mut record = stage.record(trial, plant(machine, setting)?);
    let zero = machine.slave_zero_rad(setting);
    let measured = |of: fn(&Record) -> bool| machine.records.iter().all(of);
    record.slave = record
        .slave
        .filter(|_| measured(|record| record.slave.is_some()))
        .map(|slave| slave.into_iter().map(|position| position + zero).collect());
    record.torque = record.torque.filter(|_| measured(|record| record.torque.is_some()));
    Some(record)
}

/// The plant that a setting describes; what only the instruments have is in its readings.
fn plant(machine: &Machine, setting: &Setting) -> Option<Plant> {
    let effects = setting.placed.iter().map(Placed::effect).collect::<Option<Vec<_>>>()?;
    machine.constants(setting)?.plant(effects).ok()
}

/// One over the floor, by record and channel.
fn weights(machine: &Machine, floors: &[(Channel, f64)]) -> Vec<Vec<f64>> {
    let weight = |channel: Channel| {
        floors.iter().find(|(own, _)| *own == channel).map_or(0.0, |(_, floor)| 1.0 / floor)
    };
    (0..machine.records.len())
        .map(|record| machine.channels(record).into_iter().map(weight).collect())
        .collect()
}

/// What one setting has to be pulled by along the records more than another, in floors.
fn difference(
    machine: &Machine,
    own: &Setting,
    other: &Setting,
    floors: &[(Channel, f64)],
) -> Option<DVector<f64>> {
    let view = View::whole(machine);
    let weights = weights(machine, floors);
    let stacked = |residuals: Vec<Residual>| View::stack(&residuals, &weights);
    Some(stacked(view.residuals(other)?) - stacked(view.residuals(own)?))
}

fn slopes(
    machine: &Machine,
    setting: &Setting,
    knobs: &[Knob],
    floors: &[(Channel, f64)],
) -> Option<DMatrix<f64>> {
    let view = View::whole(machine);
    let fitted = view.evaluate(setting.clone())?;
    Some(view.slopes(&fitted, knobs, &weights(machine, floors)))
}

/// What is left of a column when all that others can do is taken out.
fn without(column: &DVector<f64>, others: &DMatrix<f64>) -> DVector<f64> {
    let basis = basis(others.column_iter().map(|other| other.into_owned()), others.nrows());
    column - &basis * (basis.transpose() * column)
}

/// The model with a rival in the place of the effect that stands `at`, fitted to the same records;
/// and what was moved.
fn rival_of(study: &Study, at: usize, rival: (&'static str, Site)) -> Option<(Setting, Vec<Knob>)> {
    let machine = &study.machine;
    let found = &study.found;
    let fit = View::of(machine, Role::Fit);
    let now = fit.evaluate(found.last().setting.clone())?;
    let listed: Vec<Candidate> = candidates(&scale(&fit, &now));
    let candidate = listed.iter().find(|candidate| (candidate.id, candidate.site) == rival)?;
    let placed = candidate.starts.iter().flat_map(|start| {
        let turned = start.signed.then(|| {
            let mut turned = start.placed.clone();
            turned.values.iter_mut().take(1).for_each(|(_, size)| *size = -*size);
            turned
        });
        [Some(start.placed.clone()), start.quadrature.clone(), turned]
    });
    // Where an effect is its own rival, it is that of the other encoder.
    let encoder = |placed: &Placed| {
        placed.values.iter().find(|(name, _)| *name == WHICH_ENCODER).map(|(_, which)| *which)
    };
    let own = &now.setting.placed[at];
    let another = |placed: &Placed| {
        (placed.id, placed.site) != (own.id, own.site)
            || encoder(placed).is_none()
            || encoder(placed) != encoder(own)
    };
    let starts: Vec<Fitted> = placed
        .flatten()
        .filter(another)
        .filter_map(|placed| {
            let mut setting = now.setting.clone();
            setting.placed[at] = placed;
            fit.evaluate(setting)
        })
        .collect();
    let best = starts.into_iter().min_by(|a, b| a.objective.total_cmp(&b.objective))?;
    let of_others = found.effect_knobs.iter().filter(|knob| !knob.is_of(at));
    let mut knobs: Vec<Knob> = found.knobs.clone();
    knobs.extend(of_others.cloned());
    knobs.extend(knobs_of(candidate, at));
    let fitted = fit.fit(&best.setting, &knobs, 4)?;
    Some((fitted.setting, knobs))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forward::judge::Judged;
    use crate::forward::search::{Found, Step};
    use crate::outcome::Sight;
    use rig::RigFile;
    use rig::protocol::Protocol;

    const COUNT_RAD: f64 = 1.570_8e-3;

    fn rig() -> RigFile {
        RigFile::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml"))
            .unwrap()
    }

    /// Three records of the declared machine with an effect, and a search that found it, with a
    /// rival or without.
    fn study(
        effect: Option<Placed>,
        rival: Option<(&'static str, Site)>,
    ) -> (RigFile, Stage, Study) {
        let rig = rig();
        let stage = Stage::of(&rig).unwrap();
        let empty = Machine::new("rig.toml", &rig.model, Vec::new(), Some(COUNT_RAD)).unwrap();
        let setting = Setting { placed: effect.clone().into_iter().collect(), ..empty.start() };
        let moves = [
            (Trial::Sine(20.0, 1.0), Role::Fit),
            (Trial::Sine(10.0, 1.0), Role::Select),
            (Trial::Sine(20.0, 0.5), Role::Report),
        ];
        let records = moves.map(|(trial, role)| {
            let mut record = stage.record(trial, plant(&empty, &setting).unwrap());
            let counted =
                |position: &mut f64| *position = (*position / COUNT_RAD).round() * COUNT_RAD;
            record.master.iter_mut().for_each(counted);
            record.slave.iter_mut().flatten().for_each(counted);
            record.role = role;
            record
        });
        let machine = Machine { records: records.to_vec(), ..empty };
        let fit = View { machine: &machine, records: vec![0] };
        let base = fit.evaluate(machine.start()).unwrap();
        let fitted = fit.evaluate(setting).unwrap();
        let index = |name: &str| {
            Knob::Base(machine.base.iter().position(|parameter| parameter.name == name).unwrap())
        };
        let knobs = [
            "motor_coulomb_nm",
            "motor_inertia_kg_m2",
            "line_stiffness_factor",
            "port_damping_n_s_per_m",
        ]
        .map(index)
        .to_vec();
        let steps = effect.map(|placed| Step {
            added: Judged {
                id: placed.id,
                site: placed.site,
                gain: 0.5,
                t: 9.0,
                better: 1,
                worse: 0,
                accepted: true,
            },
            rivals: rival.into_iter().collect(),
            fitted,
        });
        let found = Found {
            base,
            base_knobs: knobs.clone(),
            knobs,
            steps: steps.into_iter().collect(),
            rounds: Vec::new(),
            given_up: Vec::new(),
            inadequate: false,
            generic: Vec::new(),
            nameless: None,
            origin: None,
            effect_knobs: Vec::new(),
        };
        (rig, stage, Study { machine, found, notes: Vec::new(), calibration: None })
    }

    fn played(next: &NextExperiment, rig: &RigFile) -> Protocol {
        let protocol = Protocol::parse(next.protocol.as_deref().unwrap(), "next.toml").unwrap();
        protocol.check_against(rig).unwrap();
        protocol
    }

    #[test]
    fn a_lag_is_told_from_dead_time_by_a_movement_in_which_the_two_models_differ() {
        let delay =
            Placed { id: "transport_delay", site: Site::Drive, values: vec![("delay_s", 4e-3)] };
        let (rig, stage, study) = study(Some(delay), Some(("amplifier_lag", Site::Drive)));
        let next = propose(&study, &stage, Verdict::Ambiguous, &[]).unwrap();
        println!("{} {}", next.why, next.what);
        assert!(next.why.contains("dead time from an amplifier that follows late"), "{}", next.why);
        let protocol = played(&next, &rig);
        assert!(
            protocol.duration_s() > 2.0 * PLAYED_S,
            "two movements: {} s",
            protocol.duration_s()
        );

        // And it keeps its word: along what it proposes the rival has to be pulled by more than
        // along the movements that there were.
        let own = &study.found.last().setting;
        let (other, knobs) = rival_of(&study, 0, ("amplifier_lag", Site::Drive)).unwrap();
        let lag = other.placed[0].value("time_constant").unwrap();
        assert!((1e-3..1e-2).contains(&lag), "fitted to the records: {lag} s");
        let floors = floors(&study).unwrap();
        let told = |trial: Trial| {
            let machine = Machine {
                records: vec![recorded(&study, &stage, trial, own).unwrap()],
                ..study.machine.clone()
            };
            let difference = difference(&machine, own, &other, &floors).unwrap();
            let rows = (difference.len() as f64).sqrt();
            without(&difference, &slopes(&machine, &other, &knobs, &floors).unwrap()).norm() / rows
        };
        let label = &protocol.segments[1].label;
        let best = Trial::all(&stage).into_iter().find(|trial| trial.words() == *label).unwrap();
        let (best, before) = (told(best), told(Trial::Sine(20.0, 1.0)));
        println!(
            "{label}: {best:.2} floors of {floors:?}, a sine of 20° and 1 Hz {before:.2}, a lag of {lag:.2e} s"
        );
        assert!(
            best > 1.5 * before && best > LEAST,
            "{label}: {best:.2} floors, a sine of 20° and 1 Hz {before:.2}"
        );
    }

    #[test]
    fn parameters_that_the_records_do_not_show_are_moved() {
        let (rig, stage, study) = study(None, None);
        let unseen = |name: &str| FittedParameter {
            name: name.into(),
            declared: Some(0.3),
            fitted: 0.3,
            std: None,
            unit: String::new(),
            identifiable: false,
            at_tolerance: false,
            sight: Sight::Flat,
            trades_with: None,
        };
        let next =
            propose(&study, &stage, Verdict::None, &[unseen("slave_static_friction_nm")]).unwrap();
        println!("{} {}", next.why, next.what);
        assert!(
            next.why.contains("The records say no more than the declaration of")
                && next.why.contains("slave_static_friction_nm")
        );
        assert!(next.what.contains("should tell slave_static_friction_nm to"), "{}", next.what);
        // It keeps its word: it shows the parameter, and the movement that there was shows less of
        // it.
        let label = played(&next, &rig).segments[1].label.clone();
        let best = Trial::all(&stage).into_iter().find(|trial| trial.words() == label).unwrap();
        let index = study
            .machine
            .base
            .iter()
            .position(|parameter| parameter.name == "slave_static_friction_nm")
            .unwrap();
        let floors = floors(&study).unwrap();
        let closeness =
            |trial| shown(&study, &stage, trial, &[index], &floors).unwrap().closeness[0].1;
        let (best, before) = (closeness(best), closeness(Trial::Sine(20.0, 1.0)));
        assert!(
            best >= SHOWN && best > before,
            "{label}: {best:.2}, a sine of 20° and 1 Hz {before:.2}"
        );
        // Of one that no movement shows it says so.
        let next = propose(&study, &stage, Verdict::None, &[unseen("hose_length_m")]).unwrap();
        assert!(
            next.why.contains("hose_length_m, which no movement of this rig tells from the others"),
            "{}",
            next.why
        );
        assert!(propose(&study, &stage, Verdict::Unlisted, &[]).is_none());
    }
}
