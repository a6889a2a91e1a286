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

use super::candidate_movements::{Movement, PLAYED_S, PREDICTED_S, RigCapability};
use super::effect_descriptions::{rival_words, words};
use super::transmission_study::Study;
use crate::equation_error::split::Role;
use crate::outcome::{FittedParameter, NextExperiment, Verdict};
use crate::prediction_error::candidates::{Candidate, candidates};
use crate::prediction_error::fit::{Dataset, Fitted};
use crate::prediction_error::free_parameter::{FreeParameter, free_parameters_of};
use crate::prediction_error::record::Record;
use crate::prediction_error::screening::{basis, record_features};
use crate::prediction_error::search::WHICH_ENCODER;
use crate::prediction_error::transmission_model::{
    Channel, PlacedEffect, Residual, Setting, TransmissionModel,
};
use crate::prediction_error::validation::{BLOCK, errors};

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
struct ColumnSensitivity {
    movement: Movement,
    floors: f64,
}

/// The next experiment with its protocol, where one can be found; without one, why not.
pub(super) fn propose(
    study: &Study,
    capability: &RigCapability,
    verdict: Verdict,
    parameters: &[FittedParameter],
) -> Option<NextExperiment> {
    match verdict {
        Verdict::Ambiguous => between_two(study, capability),
        Verdict::Effect | Verdict::None => for_parameters(study, capability, parameters),
        // With something left that has no name there are no two models to be compared.
        Verdict::Unlisted => None,
    }
}

/// Separates the effect that is contested from its first rival.
fn between_two(study: &Study, capability: &RigCapability) -> Option<NextExperiment> {
    let found = &study.found;
    let (at, step) =
        found.steps.iter().enumerate().rev().find(|(_, step)| !step.rivals.is_empty())?;
    let rival = *step.rivals.first()?;
    let own = &found.last().setting;
    let (other, parameters) = rival_of(study, at, rival)?;
    let floors = floors(study)?;
    let all: Vec<(Movement, Record)> = Movement::all(capability)
        .into_par_iter()
        .filter_map(|movement| Some((movement, recorded(study, capability, movement, own)?)))
        .collect();
    // First by what differs at all, then by what the rival's parameters could not take up.
    let mut first: Vec<(f64, &Movement, TransmissionModel)> = all
        .iter()
        .filter_map(|(movement, record)| {
            let model = TransmissionModel { records: vec![record.clone()], ..study.model.clone() };
            let size = difference(&model, own, &other, &floors)?.norm();
            Some((size, movement, model))
        })
        .collect();
    first.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut told: Vec<ColumnSensitivity> = first
        .into_iter()
        .take(EXAMINED)
        .filter_map(|(_, movement, model)| {
            let left = difference(&model, own, &other, &floors)?;
            let rows = left.len();
            let slopes = slopes(&model, &other, &parameters, &floors)?;
            let left = without(&left, &slopes);
            Some(ColumnSensitivity {
                movement: *movement,
                floors: left.norm() / (rows as f64).sqrt(),
            })
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
    let chosen = chosen(told.iter().map(|told| told.movement));
    let what = format!(
        "{}, {PLAYED_S} s each: the two models would differ by {:.1} times what repeats leave, beyond what their parameters can take up",
        listed(&chosen),
        best.floors
    );
    let description = format!("Tells {names}");
    Some(NextExperiment {
        why,
        what,
        protocol: Some(capability.protocol("tell-apart", &description, &chosen)),
    })
}

/// How closely a trial shows declared parameters: 1 over the standard deviation to be expected, in
/// units of half the tolerance.
struct Shown {
    movement: Movement,
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
    capability: &RigCapability,
    parameters: &[FittedParameter],
) -> Option<NextExperiment> {
    let model = &study.model;
    let all: Vec<usize> =
        (0..model.base.len()).filter(|index| model.base[*index].declared.is_some()).collect();
    let unseen = |index: &usize| {
        parameters.iter().any(|p| p.name == model.base[*index].name && !p.identifiable)
    };
    let unseen: Vec<usize> = all.iter().copied().filter(unseen).collect();
    let floors = floors(study)?;
    let shown: Vec<Shown> = Movement::all(capability)
        .into_iter()
        .filter_map(|movement| shown(study, capability, movement, &all, &floors))
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
            list.iter().map(|index| model.base[*index].name.as_str()).take(4).collect();
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
    let chosen = chosen(order.iter().map(|shown| shown.movement));
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
        protocol: Some(capability.protocol("show-more", description, &chosen)),
    })
}

/// How closely a trial shows each of some parameters beside all others: what the others could do
/// alike is no sign of it.
fn shown(
    study: &Study,
    capability: &RigCapability,
    movement: Movement,
    of: &[usize],
    floors: &[(Channel, f64)],
) -> Option<Shown> {
    let own = &study.found.last().setting;
    let parameters: Vec<FreeParameter> =
        (0..study.model.base.len()).map(FreeParameter::Base).collect();
    let model = TransmissionModel {
        records: vec![recorded(study, capability, movement, own)?],
        ..study.model.clone()
    };
    let slopes = slopes(&model, own, &parameters, floors)?;
    let closeness = |index: &usize| {
        let others = slopes.clone().remove_column(*index);
        let left = without(&slopes.column(*index).into_owned(), &others).norm();
        (*index, left / (BLOCK as f64).sqrt())
    };
    Some(Shown { movement, closeness: of.iter().map(closeness).collect() })
}

/// The best trial, and the best of another kind.
fn chosen(best_first: impl Iterator<Item = Movement>) -> Vec<Movement> {
    let mut chosen: Vec<Movement> = Vec::new();
    for movement in best_first {
        if chosen.len() < MOVEMENTS && chosen.iter().all(|before| !before.is_like(movement)) {
            chosen.push(movement);
        }
    }
    chosen
}

fn listed(movements: &[Movement]) -> String {
    movements.iter().map(|movement| movement.words()).collect::<Vec<_>>().join(", then ")
}

/// What repeats leave of each channel, or what the fitted model leaves where nothing was repeated.
fn floors(study: &Study) -> Option<Vec<(Channel, f64)>> {
    let report = study.model.of_role(Role::Report);
    let errors = errors(&study.model, &report, &study.found.last().setting)?;
    Some(
        errors
            .into_iter()
            .map(|(channel, error, floor)| (channel, floor.unwrap_or(error).max(1e-7)))
            .collect(),
    )
}

/// The record of a trial by the machine that a setting describes.
fn recorded(
    study: &Study,
    capability: &RigCapability,
    movement: Movement,
    setting: &Setting,
) -> Option<Record> {
    let model = &study.model;
    let mut record = capability.record(movement, plant(model, setting)?);
    let zero = model.slave_zero_rad(setting);
    let measured = |of: fn(&Record) -> bool| model.records.iter().all(of);
    record.slave = record
        .slave
        .filter(|_| measured(|record| record.slave.is_some()))
        .map(|slave| slave.into_iter().map(|position| position + zero).collect());
    record.torque = record.torque.filter(|_| measured(|record| record.torque.is_some()));
    Some(record)
}

/// The plant that a setting describes; what only the instruments have is in its readings.
fn plant(model: &TransmissionModel, setting: &Setting) -> Option<Plant> {
    let effects = setting.placed.iter().map(PlacedEffect::effect).collect::<Option<Vec<_>>>()?;
    model.constants(setting)?.plant(effects).ok()
}

/// One over the floor, by record and channel.
fn weights(model: &TransmissionModel, floors: &[(Channel, f64)]) -> Vec<Vec<f64>> {
    let weight = |channel: Channel| {
        floors.iter().find(|(own, _)| *own == channel).map_or(0.0, |(_, floor)| 1.0 / floor)
    };
    (0..model.records.len())
        .map(|record| model.channels(record).into_iter().map(weight).collect())
        .collect()
}

/// What one setting has to be pulled by along the records more than another, in floors.
fn difference(
    model: &TransmissionModel,
    own: &Setting,
    other: &Setting,
    floors: &[(Channel, f64)],
) -> Option<DVector<f64>> {
    let dataset = Dataset::whole(model);
    let weights = weights(model, floors);
    let stacked = |residuals: Vec<Residual>| Dataset::stack(&residuals, &weights);
    Some(stacked(dataset.residuals(other)?) - stacked(dataset.residuals(own)?))
}

fn slopes(
    model: &TransmissionModel,
    setting: &Setting,
    parameters: &[FreeParameter],
    floors: &[(Channel, f64)],
) -> Option<DMatrix<f64>> {
    let dataset = Dataset::whole(model);
    let fitted = dataset.evaluate(setting.clone())?;
    Some(dataset.jacobian(&fitted, parameters, &weights(model, floors)))
}

/// What is left of a column when all that others can do is taken out.
fn without(column: &DVector<f64>, others: &DMatrix<f64>) -> DVector<f64> {
    let basis = basis(others.column_iter().map(|other| other.into_owned()), others.nrows());
    column - &basis * (basis.transpose() * column)
}

/// The model with a rival in the place of the effect that stands `at`, fitted to the same records;
/// and what was moved.
fn rival_of(
    study: &Study,
    at: usize,
    rival: (&'static str, Site),
) -> Option<(Setting, Vec<FreeParameter>)> {
    let model = &study.model;
    let found = &study.found;
    let fit = Dataset::of(model, Role::Fit);
    let now = fit.evaluate(found.last().setting.clone())?;
    let listed: Vec<Candidate> = candidates(&record_features(&fit, &now));
    let candidate = listed.iter().find(|candidate| (candidate.id, candidate.site) == rival)?;
    let placed = candidate.starts.iter().flat_map(|start| {
        let sign_flipped = start.signed.then(|| {
            let mut sign_flipped = start.placed.clone();
            sign_flipped.values.iter_mut().take(1).for_each(|(_, size)| *size = -*size);
            sign_flipped
        });
        [Some(start.placed.clone()), start.quadrature.clone(), sign_flipped]
    });
    // Where an effect is its own rival, it is that of the other encoder.
    let encoder = |placed: &PlacedEffect| {
        placed.values.iter().find(|(name, _)| *name == WHICH_ENCODER).map(|(_, which)| *which)
    };
    let own = &now.setting.placed[at];
    let another = |placed: &PlacedEffect| {
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
    let of_others = found.effect_parameters.iter().filter(|parameter| !parameter.is_of(at));
    let mut parameters: Vec<FreeParameter> = found.parameters.clone();
    parameters.extend(of_others.cloned());
    parameters.extend(free_parameters_of(candidate, at));
    let fitted = fit.fit(&best.setting, &parameters, 4)?;
    Some((fitted.setting, parameters))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outcome::Sight;
    use crate::prediction_error::search::{SearchResult, SelectionStep};
    use crate::prediction_error::validation::Validation;
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
        effect: Option<PlacedEffect>,
        rival: Option<(&'static str, Site)>,
    ) -> (RigFile, RigCapability, Study) {
        let rig = rig();
        let capability = RigCapability::of(&rig).unwrap();
        let empty =
            TransmissionModel::new("rig.toml", &rig.model, Vec::new(), Some(COUNT_RAD)).unwrap();
        let setting = Setting { placed: effect.clone().into_iter().collect(), ..empty.start() };
        let moves = [
            (Movement::Sine(20.0, 1.0), Role::Fit),
            (Movement::Sine(10.0, 1.0), Role::Select),
            (Movement::Sine(20.0, 0.5), Role::Report),
        ];
        let records = moves.map(|(movement, role)| {
            let mut record = capability.record(movement, plant(&empty, &setting).unwrap());
            let counted =
                |position: &mut f64| *position = (*position / COUNT_RAD).round() * COUNT_RAD;
            record.master.iter_mut().for_each(counted);
            record.slave.iter_mut().flatten().for_each(counted);
            record.role = role;
            record
        });
        let model = TransmissionModel { records: records.to_vec(), ..empty };
        let fit = Dataset { model: &model, records: vec![0] };
        let base = fit.evaluate(model.start()).unwrap();
        let fitted = fit.evaluate(setting).unwrap();
        let index = |name: &str| {
            FreeParameter::Base(
                model.base.iter().position(|parameter| parameter.name == name).unwrap(),
            )
        };
        let parameters = [
            "motor_coulomb_nm",
            "motor_inertia_kg_m2",
            "line_stiffness_factor",
            "port_damping_n_s_per_m",
        ]
        .map(index)
        .to_vec();
        let steps = effect.map(|placed| SelectionStep {
            added: Validation {
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
        let found = SearchResult {
            base,
            base_parameters: parameters.clone(),
            parameters,
            steps: steps.into_iter().collect(),
            rounds: Vec::new(),
            given_up: Vec::new(),
            inadequate: false,
            generic: Vec::new(),
            unlisted_function: None,
            localisation: None,
            effect_parameters: Vec::new(),
        };
        (rig, capability, Study { model, found, notes: Vec::new(), calibration: None })
    }

    fn simulate(next: &NextExperiment, rig: &RigFile) -> Protocol {
        let protocol = Protocol::parse(next.protocol.as_deref().unwrap(), "next.toml").unwrap();
        protocol.check_against(rig).unwrap();
        protocol
    }

    #[test]
    fn a_lag_is_told_from_dead_time_by_a_movement_in_which_the_two_models_differ() {
        let delay = PlacedEffect {
            id: "transport_delay",
            site: Site::Drive,
            values: vec![("delay_s", 4e-3)],
        };
        let (rig, capability, study) = study(Some(delay), Some(("amplifier_lag", Site::Drive)));
        let next = propose(&study, &capability, Verdict::Ambiguous, &[]).unwrap();
        println!("{} {}", next.why, next.what);
        assert!(next.why.contains("dead time from an amplifier that follows late"), "{}", next.why);
        let protocol = simulate(&next, &rig);
        assert!(
            protocol.duration_s() > 2.0 * PLAYED_S,
            "two movements: {} s",
            protocol.duration_s()
        );

        // And it keeps its word: along what it proposes the rival has to be pulled by more than
        // along the movements that there were.
        let own = &study.found.last().setting;
        let (other, parameters) = rival_of(&study, 0, ("amplifier_lag", Site::Drive)).unwrap();
        let lag = other.placed[0].value("time_constant").unwrap();
        assert!((1e-3..1e-2).contains(&lag), "fitted to the records: {lag} s");
        let floors = floors(&study).unwrap();
        let told = |movement: Movement| {
            let model = TransmissionModel {
                records: vec![recorded(&study, &capability, movement, own).unwrap()],
                ..study.model.clone()
            };
            let difference = difference(&model, own, &other, &floors).unwrap();
            let rows = (difference.len() as f64).sqrt();
            without(&difference, &slopes(&model, &other, &parameters, &floors).unwrap()).norm()
                / rows
        };
        let label = &protocol.segments[1].label;
        let best = Movement::all(&capability)
            .into_iter()
            .find(|movement| movement.words() == *label)
            .unwrap();
        let (best, before) = (told(best), told(Movement::Sine(20.0, 1.0)));
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
        let (rig, capability, study) = study(None, None);
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
            propose(&study, &capability, Verdict::None, &[unseen("slave_static_friction_nm")])
                .unwrap();
        println!("{} {}", next.why, next.what);
        assert!(
            next.why.contains("The records say no more than the declaration of")
                && next.why.contains("slave_static_friction_nm")
        );
        assert!(next.what.contains("should tell slave_static_friction_nm to"), "{}", next.what);
        // It keeps its word: it shows the parameter, and the movement that there was shows less of
        // it.
        let label = simulate(&next, &rig).segments[1].label.clone();
        let best = Movement::all(&capability)
            .into_iter()
            .find(|movement| movement.words() == label)
            .unwrap();
        let index = study
            .model
            .base
            .iter()
            .position(|parameter| parameter.name == "slave_static_friction_nm")
            .unwrap();
        let floors = floors(&study).unwrap();
        let closeness = |movement| {
            shown(&study, &capability, movement, &[index], &floors).unwrap().closeness[0].1
        };
        let (best, before) = (closeness(best), closeness(Movement::Sine(20.0, 1.0)));
        assert!(
            best >= SHOWN && best > before,
            "{label}: {best:.2}, a sine of 20° and 1 Hz {before:.2}"
        );
        // Of one that no movement shows it says so.
        let next = propose(&study, &capability, Verdict::None, &[unseen("hose_length_m")]).unwrap();
        assert!(
            next.why.contains("hose_length_m, which no movement of this rig tells from the others"),
            "{}",
            next.why
        );
        assert!(propose(&study, &capability, Verdict::Unlisted, &[]).is_none());
    }
}
