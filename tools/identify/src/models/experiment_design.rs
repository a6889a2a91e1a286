//! Design of the next experiment by simulation: the most informative of the movements that the rig
//! can play by itself.
//!
//! If two effects explain the records equally well, one model is simulated and the other's observer
//! follows it as a measured record; its innovations, with the sensitivities to its own parameters
//! projected out, discriminate the two. Otherwise the expected variance of the declared parameters
//! that were not identifiable is minimised. Both are in units of the noise floor: the
//! repeatability, or else the residual of the fitted model.

use rayon::prelude::*;

use super::candidate_movements::{Movement, PLAYED_S, PREDICTED_S, RigCapability};
use super::effect_descriptions::{rival_words, words};
use super::rival_model::rival_of;
use super::simulated_experiment::{difference, floors, jacobian, recorded, without};
use super::transmission_study::Study;
use crate::outcome::{FittedParameter, NextExperiment, Verdict};
use crate::prediction_error::free_parameter::FreeParameter;
use crate::prediction_error::record::Record;
use crate::prediction_error::transmission_model::{Channel, TransmissionModel};
use crate::prediction_error::validation::BLOCK;

/// Movements for which the parameters' sensitivities are projected out.
const PROJECTED: usize = 8;
/// Movements in a proposal.
const MOVEMENTS: usize = 2;
/// Least discriminating difference, in noise floors: it raises an error at the floor by a tenth.
const LEAST_DIFFERENCE: f64 = 0.46;
/// A parameter counts as identified if its expected standard deviation is less than half of half
/// its tolerance.
const IDENTIFIED: f64 = 2.0;

/// Discriminating power of a movement, in noise floors.
#[derive(Clone, Copy, Debug)]
struct Discrimination {
    movement: Movement,
    floors: f64,
}

/// Returns the next experiment with its protocol, or the reason why there is none.
pub(super) fn propose(
    study: &Study<'_>,
    capability: &RigCapability,
    verdict: Verdict,
    parameters: &[FittedParameter],
) -> Option<NextExperiment> {
    match verdict {
        Verdict::Ambiguous => between_two(study, capability),
        Verdict::Effect | Verdict::None => for_parameters(study, capability, parameters),
        // With an unlisted effect there are no two models to compare.
        Verdict::Unlisted | Verdict::Inadequate | Verdict::Undecided => None,
    }
}

/// Discriminates an effect from its first rival.
fn between_two(study: &Study<'_>, capability: &RigCapability) -> Option<NextExperiment> {
    let found = &study.found;
    let (at, step) = found.contested()?;
    let rival = *step.rivals.first()?;
    let own = &found.last().setting;
    let (other, parameters) = rival_of(study, at, rival)?;
    let floors = floors(study)?;
    let all: Vec<(Movement, Record)> = Movement::all(capability)
        .into_par_iter()
        .filter(|_| !study.deadline.has_passed())
        .filter_map(|movement| Some((movement, recorded(study, capability, movement, own)?)))
        .collect();
    // First by the whole difference, then by the part that the rival's parameters cannot absorb.
    let mut first: Vec<(f64, &Movement, TransmissionModel)> = all
        .iter()
        .filter_map(|(movement, record)| {
            let model = TransmissionModel { records: vec![record.clone()], ..study.model.clone() };
            let size = difference(&model, own, &other, &floors)?.norm();
            Some((size, movement, model))
        })
        .collect();
    first.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut ranked: Vec<Discrimination> = first
        .into_iter()
        .take(PROJECTED)
        .take_while(|_| !study.deadline.has_passed())
        .filter_map(|(_, movement, model)| {
            let left = difference(&model, own, &other, &floors)?;
            let rows = left.len();
            let jacobian = jacobian(&model, &other, &parameters, &floors)?;
            let left = without(&left, &jacobian);
            Some(Discrimination { movement: *movement, floors: left.norm() / (rows as f64).sqrt() })
        })
        .collect();
    ranked.sort_by(|a, b| b.floors.total_cmp(&a.floors));
    let names = format!(
        "{} from {}",
        words(step.added.id),
        rival_words((step.added.id, step.added.site), rival)
    );
    let why = format!("These records cannot distinguish {names}.");
    let Some(best) = ranked.first().filter(|best| best.floors >= LEAST_DIFFERENCE) else {
        let most = ranked.first().map_or(0.0, |best| best.floors);
        let what = format!(
            "no movement that the rig plays by itself: the two models would differ by at most \
             {most:.2} times the repeatability; a hand that drives the slave, or a sensor between \
             the two"
        );
        return Some(NextExperiment::new(why, what));
    };
    let chosen = chosen(ranked.iter().map(|ranked| ranked.movement));
    let what = format!(
        "{}, {PLAYED_S} s each: the two models would differ by {:.1} times the repeatability \
         beyond what their parameters can absorb",
        listed(&chosen),
        best.floors
    );
    let description = format!("Distinguishes {names}");
    Some(NextExperiment {
        why,
        what,
        protocol: Some(capability.protocol("tell-apart", &description, &chosen)),
    })
}

/// Information of a movement on declared parameters: half the tolerance over the expected standard
/// deviation.
struct Information {
    movement: Movement,
    /// By index in the machine's base.
    closeness: Vec<(usize, f64)>,
}

impl Information {
    /// Scores some parameters, saturating once a parameter is identified.
    fn score(&self, of: &[usize]) -> f64 {
        self.of(of).map(|(_, closeness)| closeness / (IDENTIFIED + closeness)).sum()
    }

    fn of(&self, of: &[usize]) -> impl Iterator<Item = (usize, f64)> {
        self.closeness.iter().copied().filter(|(index, _)| of.contains(index))
    }
}

/// Selects movements for the parameters that were not identifiable; if there are none, or no
/// movement helps, for all of them.
fn for_parameters(
    study: &Study<'_>,
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
    let shown: Vec<Information> = Movement::all(capability)
        .into_par_iter()
        .filter(|_| !study.deadline.has_passed())
        .filter_map(|movement| shown(study, capability, movement, &all, &floors))
        .collect();
    let best =
        |wanted: &[usize]| shown.iter().max_by(|a, b| a.score(wanted).total_cmp(&b.score(wanted)));
    let clear = |shown: &Information, wanted: &[usize]| {
        let mut clear: Vec<(usize, f64)> =
            shown.of(wanted).filter(|(_, closeness)| *closeness >= IDENTIFIED).collect();
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
            "Every declared parameter is identifiable from these records; their variance could be \
             reduced."
                .to_owned()
        }
        (false, true) => {
            format!("These records do not identify {} beyond its declaration.", names(&unseen))
        }
        (false, false) => format!(
            "These records do not identify {} beyond its declaration, and no movement of this rig \
             distinguishes it from the others, whose variance could be reduced.",
            names(&unseen)
        ),
    };
    let wanted = if unseen_can_be { unseen } else { all };
    let mut order: Vec<&Information> = shown.iter().collect();
    order.sort_by(|a, b| b.score(&wanted).total_cmp(&a.score(&wanted)));
    let clear = order.first().map_or(Vec::new(), |best| clear(best, &wanted));
    let Some((first, closeness)) = clear.first() else {
        let what = "separate measurements of the parameters, or tighter declarations: no movement \
                    that the rig plays by itself identifies them";
        return Some(NextExperiment::new(why, what));
    };
    let chosen = chosen(order.iter().map(|shown| shown.movement));
    let others: Vec<usize> = clear.iter().skip(1).map(|(index, _)| *index).collect();
    let what = format!(
        "{}, {PLAYED_S} s each: {:.0} s of the first should identify {} to {:.0} % of its \
         tolerance{}",
        listed(&chosen),
        PREDICTED_S,
        names(&[*first]),
        100.0 / closeness,
        if others.is_empty() { String::new() } else { format!(", and shows {}", names(&others)) }
    );
    let description = "Identifies parameters that the records did not, or with less variance";
    Some(NextExperiment {
        why,
        what,
        protocol: Some(capability.protocol("show-more", description, &chosen)),
    })
}

/// Computes the information of a movement on each parameter, with the sensitivities to all others
/// projected out.
fn shown(
    study: &Study<'_>,
    capability: &RigCapability,
    movement: Movement,
    of: &[usize],
    floors: &[(Channel, f64)],
) -> Option<Information> {
    let own = &study.found.last().setting;
    let parameters: Vec<FreeParameter> =
        (0..study.model.base.len()).map(FreeParameter::Base).collect();
    let model = TransmissionModel {
        records: vec![recorded(study, capability, movement, own)?],
        ..study.model.clone()
    };
    // Of the triangular factor the columns have the same lengths and angles, in far fewer rows.
    let jacobian = jacobian(&model, own, &parameters, floors)?.qr().r();
    let closeness = |index: &usize| {
        let others = jacobian.clone().remove_column(*index);
        let left = without(&jacobian.column(*index).into_owned(), &others).norm();
        (*index, left / (BLOCK as f64).sqrt())
    };
    Some(Information { movement, closeness: of.iter().map(closeness).collect() })
}

/// Returns the best movement, and the best of another kind.
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

#[cfg(test)]
mod tests {
    use plant::effects::Site;

    use super::*;
    use crate::deadline::NEVER;
    use crate::equation_error::block_roles::Role;
    use crate::models::simulated_experiment::plant;
    use crate::outcome::Identifiability;
    use crate::prediction_error::dataset::{Dataset, Fitted};
    use crate::prediction_error::search_result::{SearchResult, SelectionStep};
    use crate::prediction_error::transmission_model::{PlacedEffect, Setting};
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
    ) -> (RigFile, RigCapability, Study<'static>) {
        let rig = rig();
        let capability = RigCapability::of(&rig, 0).unwrap();
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
        let fit = Dataset { records: vec![0], ..Dataset::whole(&model) };
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
        let [base, fitted] =
            [base, fitted].map(|fitted| Fitted { parameters: parameters.clone(), ..fitted });
        let steps = effect.map(|placed| SelectionStep {
            added: Validation {
                id: placed.id,
                site: placed.site,
                gain: 0.5,
                t: 9.0,
                better: 1,
                worse: 0,
                accepted: true,
                over_octaves: false,
            },
            rivals: rival.into_iter().collect(),
            fitted,
        });
        let steps = steps.into_iter().collect();
        let found = SearchResult { base, steps, ..SearchResult::default() };
        (
            rig,
            capability,
            Study {
                model,
                found,
                notes: Vec::new(),
                calibration: None,
                false_alarms: Vec::new(),
                axis: None,
                deadline: &NEVER,
            },
        )
    }

    fn simulate(next: &NextExperiment, rig: &RigFile) -> Protocol {
        let protocol = Protocol::parse(next.protocol.as_deref().unwrap(), "next.toml").unwrap();
        protocol.check_against(rig).unwrap();
        protocol
    }

    #[test]
    fn the_proposed_movement_distinguishes_a_lag_from_dead_time() {
        let delay = PlacedEffect {
            id: "transport_delay",
            site: Site::Drive,
            values: vec![("delay_s", 4e-3)],
        };
        let (rig, capability, study) = study(Some(delay), Some(("amplifier_lag", Site::Drive)));
        let next = propose(&study, &capability, Verdict::Ambiguous, &[]).unwrap();
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
        let ranked = |movement: Movement| {
            let model = TransmissionModel {
                records: vec![recorded(&study, &capability, movement, own).unwrap()],
                ..study.model.clone()
            };
            let difference = difference(&model, own, &other, &floors).unwrap();
            let rows = (difference.len() as f64).sqrt();
            without(&difference, &jacobian(&model, &other, &parameters, &floors).unwrap()).norm()
                / rows
        };
        let label = &protocol.segments[1].label;
        let best = Movement::all(&capability)
            .into_iter()
            .find(|movement| movement.words() == *label)
            .unwrap();
        let (best, before) = (ranked(best), ranked(Movement::Sine(20.0, 1.0)));
        println!(
            "{label}: {best:.2} floors of {floors:?}, a sine of 20° and 1 Hz {before:.2}, a lag of \
             {lag:.2e} s"
        );
        assert!(
            best > 1.5 * before && best > LEAST_DIFFERENCE,
            "{label}: {best:.2} floors, a sine of 20° and 1 Hz {before:.2}"
        );
    }

    #[test]
    fn the_proposed_movement_identifies_further_parameters() {
        let (rig, capability, study) = study(None, None);
        let unseen = |name: &str| FittedParameter {
            name: name.into(),
            declared: Some(0.3),
            fitted: 0.3,
            std: None,
            unit: String::new(),
            identifiable: false,
            at_tolerance: false,
            identifiability: Identifiability::Weak,
            trades_with: None,
        };
        let next =
            propose(&study, &capability, Verdict::None, &[unseen("slave_static_friction_nm")])
                .unwrap();
        assert!(
            next.why.contains("do not identify slave_static_friction_nm beyond its declaration")
                && next.why.contains("slave_static_friction_nm")
        );
        assert!(next.what.contains("should identify slave_static_friction_nm to"), "{}", next.what);
        // The movement identifies the parameter, better than the recorded one does.
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
            best >= IDENTIFIED && best > before,
            "{label}: {best:.2}, a sine of 20° and 1 Hz {before:.2}"
        );
        // Reports a parameter that no movement identifies.
        let next = propose(&study, &capability, Verdict::None, &[unseen("hose_length_m")]).unwrap();
        assert!(
            next.why.contains("no movement of this rig distinguishes it from the others"),
            "{}",
            next.why
        );
        assert!(propose(&study, &capability, Verdict::Unlisted, &[]).is_none());
    }
}
