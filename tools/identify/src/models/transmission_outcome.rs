//! Outcome of a transmission: verdict, numbers and page.

use std::collections::BTreeMap;

use plant::effects::Site;
use plant::effects::search::SearchRange;
use report::Page;

use super::candidate_movements::RigCapability;
use super::effect_descriptions::{rival_words, words};
use super::experiment_design::propose;
use super::transmission_page;
use super::transmission_residual_tests::tested;
use super::transmission_study::Study;
use crate::correlation::TestedResidual;
use crate::equation_error::block_roles::Role;
use crate::estimate_correlation::strong;
use crate::outcome::{
    AtBounds, CandidateGain, ChannelError, EffectParameter, FittedParameter, FoundEffect,
    Identifiability, Named, NextExperiment, Outcome, Roles, UNKNOWN, Unexplained, UnlistedTable,
    Verdict,
};
use crate::prediction_error::dataset::Dataset;
use crate::prediction_error::floor_comparison::FloorComparison;
use crate::prediction_error::free_parameter::{AT_BOUND, FreeParameter};
use crate::prediction_error::identifiability::{Sensitivity, sensitivities};
use crate::prediction_error::location::JumpingEncoder;
use crate::prediction_error::noise_floor::errors;
use crate::prediction_error::nonparametric::{NODES, Variable};
use crate::prediction_error::nonparametric_search::UnlistedFunction;
use crate::prediction_error::record::rms;
use crate::prediction_error::search_result::{SearchResult, Unfinished};
use crate::prediction_error::transmission_model::Channel;
use crate::prediction_error::validation::{BLOCK, Validation};

/// Note on a proposal that the deadline cut short.
const PROPOSED_EARLY: &str = "the time limit (--limit-s) passed before every movement of \
                              --propose-experiment was simulated";

/// A parameter is identified if its standard deviation is below this share of the width of its
/// tolerance: half of what a truth anywhere within the tolerance has (1/√12).
const IDENTIFIED: f64 = 0.144;

/// Returns the outcome and its page; `None` if the last model cannot be simulated. With a
/// `capability`, the next experiment is designed by simulation.
pub(super) fn conclude(
    study: &Study<'_>,
    capability: Option<&RigCapability>,
) -> Option<(Outcome, Page)> {
    let mut outcome = outcome(study)?;
    if let Some(next) = capability
        .and_then(|capability| propose(study, capability, outcome.verdict, &outcome.parameters))
    {
        outcome.next_experiment = next;
    }
    if capability.is_some() && study.deadline.left_work_out() {
        outcome.notes.push(PROPOSED_EARLY.to_owned());
    }
    outcome.early = study.deadline.left_work_out() || study.found.unfinished.is_some();
    let tested = tested(study)?;
    let tests =
        |(channel, own): &(Channel, TestedResidual)| (channel.column().to_owned(), own.tests());
    outcome.residual_tests = tested.iter().map(tests).collect();
    outcome.notes.extend(no_noise(study, &tested));
    let page = transmission_page::page(study, &outcome, tested)?;
    Some((outcome, page))
}

/// Notes on where the final model leaves what is no noise: in which octave, and in which record if
/// it is a single one.
fn no_noise(study: &Study<'_>, tested: &[(Channel, TestedResidual)]) -> Vec<String> {
    if !study.found.coloured {
        return Vec::new();
    }
    let select = study.model.of_role(Role::Select);
    let floor = FloorComparison::of(&study.model, &select, &study.found.last().setting);
    let in_octave = floor.is_coloured_over_octaves().then(|| coloured(tested)).flatten();
    let alone = floor.outlying_record().filter(|_| in_octave.is_none() && floor.at_floor_in_sum());
    let in_record = alone.map(|of| {
        format!(
            "what remains is no noise: in {} the error of {} is {:.1} times the noise floor, as an \
             effect leaves it that acts in this record alone; check that nothing disturbed it",
            study.model.records[of.record].name,
            of.channel.column(),
            of.over_floor
        )
    });
    in_octave.into_iter().chain(in_record).collect()
}

/// A note on the octave of frequency in which the final model leaves most of the error.
fn coloured(tested: &[(Channel, TestedResidual)]) -> Option<String> {
    let all =
        tested.iter().flat_map(|(channel, own)| own.octaves.iter().map(move |o| (channel, o)));
    let (channel, worst) = all.max_by(|a, b| a.1.over_floor.total_cmp(&b.1.over_floor))?;
    Some(format!(
        "what remains is no noise: on the selection rows the error of {} from {:.2} to {:.2} Hz is \
         {:.1} times the noise floor",
        channel.column(),
        worst.from_hz,
        worst.to_hz,
        worst.over_floor
    ))
}

fn outcome(study: &Study<'_>) -> Option<Outcome> {
    let found = &study.found;
    let rivals = found.contested().map_or(&[][..], |(_, step)| &step.rivals);
    let remains = found.unlisted_function.is_some() || found.inadequate || found.coloured;
    let verdict = match Verdict::of(found.steps.len(), rivals.len(), remains) {
        _ if found.undecided => Verdict::Undecided,
        Verdict::Unlisted if found.unfinished == Some(Unfinished::Candidates) => {
            Verdict::Inadequate
        }
        Verdict::None if found.hidden_by_friction => Verdict::Undecided,
        verdict => verdict,
    };
    let fit = Dataset::of(&study.model, Role::Fit);
    let (with_deviation, correlation) = fit.deviations_with_correlation(found.last(), BLOCK);
    let names: Vec<Option<String>> =
        with_deviation.iter().map(|(own, _)| correlated_name(study, own)).collect();
    let (error, parameters) = (error(study)?, parameters(study, &with_deviation));
    Some(Outcome {
        axis: study.axis.clone(),
        unsettled: None,
        verdict,
        early: false,
        effects: effects(study, &with_deviation),
        ambiguous_with: rivals.iter().map(|(id, site)| Named::new(id, *site)).collect(),
        remains,
        left: Vec::new(),
        unlisted: unlisted(found, &fit, &with_deviation),
        calibration: study.calibration.clone(),
        false_alarms: study.false_alarms.clone(),
        at_bounds: AtBounds::of(&parameters, &error),
        correlations: strong(&names, &correlation),
        error,
        residual_tests: BTreeMap::new(),
        parameters,
        records: roles(study),
        next_experiment: next_experiment(study, verdict),
        steps: Vec::new(),
        candidates: candidates(study),
        notes: notes(study),
        seconds: 0.0,
    })
}

/// The standard deviation of a parameter.
fn deviation(
    with_deviation: &[(FreeParameter, f64)],
    is: impl Fn(&FreeParameter) -> bool,
) -> Option<f64> {
    with_deviation.iter().find(|(parameter, _)| is(parameter)).map(|(_, deviation)| *deviation)
}

/// The unlisted effect; `with_deviation` are the parameters of the final model, each with its
/// standard deviation.
fn unlisted(
    found: &SearchResult,
    fit: &Dataset<'_>,
    with_deviation: &[(FreeParameter, f64)],
) -> Option<UnlistedTable> {
    let of_function = |unlisted_function| {
        table(unlisted_function, fit, found.inadequate.then_some(with_deviation))
    };
    let jumping = JumpingEncoder::of(&fit.model.records);
    let dependence = found.localisation.as_ref().and_then(|localisation| localisation.dependence);
    let alone = |site: Site| match jumping {
        Some(jumping) => UnlistedTable {
            site: site.name().into(),
            depends_on: if jumping.at_one_place { Variable::Position.name() } else { UNKNOWN }
                .into(),
            resembles: Some(jumping.words().to_owned()),
            ..UnlistedTable::default()
        },
        None => UnlistedTable {
            site: site.name().into(),
            depends_on: dependence.map_or(UNKNOWN, |own| own.variable.name()).into(),
            resembles: dependence.map(|own| own.words.to_owned()),
            regression_share: dependence.map(|own| own.share),
            ..UnlistedTable::default()
        },
    };
    let told = (found.unlisted_function.as_ref().map(of_function))
        .or_else(|| found.acts_at(jumping).map(alone))?;
    let places = found.localisation.iter().flat_map(|localisation| &localisation.left);
    let unexplained = places
        .map(|(place, share)| Unexplained { place: place.name().into(), share: *share })
        .collect();
    Some(UnlistedTable { unexplained, ..told })
}

/// The table of a nonparametric function; `with_deviation` are the parameters of its model, each
/// with its standard deviation, if that model is the final one.
fn table(
    unlisted_function: &UnlistedFunction,
    fit: &Dataset<'_>,
    with_deviation: Option<&[(FreeParameter, f64)]>,
) -> UnlistedTable {
    let own = || fit.deviations(&unlisted_function.fitted, BLOCK);
    let with_deviation = with_deviation.map_or_else(own, <[_]>::to_vec);
    let of = |node: usize| {
        let is = |parameter: &FreeParameter| match parameter {
            FreeParameter::Node { node: own, .. } => *own == node,
            _ => false,
        };
        deviation(&with_deviation, is).filter(|deviation| deviation.is_finite()).unwrap_or(f64::NAN)
    };
    let table = &unlisted_function.table;
    UnlistedTable {
        site: unlisted_function.validation.site.name().into(),
        depends_on: table.variable.name().into(),
        table: (0..NODES).map(|node| [table.at(node), table.values[node], of(node)]).collect(),
        ..UnlistedTable::default()
    }
}

fn effects(study: &Study<'_>, with_deviation: &[(FreeParameter, f64)]) -> Vec<FoundEffect> {
    let last = study.found.last();
    let of = |at: usize, name: &str| {
        let waves: Vec<&(FreeParameter, f64)> = with_deviation
            .iter()
            .filter(|(parameter, _)| match parameter {
                FreeParameter::Phasor { placed, name: own, .. } => {
                    *placed == at && (*own == name || name == "phase")
                }
                _ => false,
            })
            .collect();
        if let [(cosine, of_cosine), (sine, of_sine)] = waves[..] {
            let (c, s) = (cosine.value(&last.setting), sine.value(&last.setting));
            let amplitude = c.hypot(s).max(f64::MIN_POSITIVE);
            let along = (c * of_cosine).hypot(s * of_sine) / amplitude;
            let across = (s * of_cosine).hypot(c * of_sine) / amplitude;
            return Some(if name == "phase" { across / amplitude } else { along });
        }
        deviation(with_deviation, |parameter| match parameter {
            FreeParameter::Effect { placed, range } => *placed == at && range.name == name,
            _ => false,
        })
    };
    study
        .found
        .steps
        .iter()
        .enumerate()
        .map(|(at, step)| {
            let placed = &last.setting.placed[at];
            let infos = placed.effect().map_or(&[][..], |effect| effect.infos());
            let parameters = placed
                .values
                .iter()
                .map(|(name, value)| EffectParameter {
                    name: (*name).to_owned(),
                    value: *value,
                    std: of(at, name),
                    unit: infos
                        .iter()
                        .find(|info| info.name == *name)
                        .map_or("", |info| info.unit)
                        .to_owned(),
                })
                .collect();
            FoundEffect {
                id: step.added.id.to_owned(),
                site: step.added.site.name().to_owned(),
                parameters,
                t: step.added.t,
                gain_percent: step.added.gain_percent(),
            }
        })
        .collect()
}

pub(super) fn error(study: &Study<'_>) -> Option<BTreeMap<String, ChannelError>> {
    let report = study.model.of_role(Role::Report);
    let declared = errors(&study.model, &report, &study.model.as_declared()).unwrap_or_default();
    let before = errors(&study.model, &report, &study.found.base.setting)?;
    let after = errors(&study.model, &report, &study.found.last().setting)?;
    let size = |channel: Channel| {
        let rows = report.iter().filter_map(|index| {
            let record = &study.model.records[*index];
            match channel {
                Channel::Master => Some(record.averaged(&record.master)),
                Channel::Slave => record.slave.as_ref().map(|slave| record.averaged(slave)),
                // The torque is a residual channel only without a hand; otherwise it is an input.
                Channel::Torque => record
                    .torque
                    .as_ref()
                    .filter(|_| record.idle)
                    .map(|torque| record.averaged(torque)),
            }
        });
        rms(rows.flatten()).max(f64::MIN_POSITIVE)
    };
    let channels =
        before.into_iter().zip(after).map(|((channel, before, _), (_, after, floor))| {
            let error = ChannelError {
                declared: declared
                    .iter()
                    .find(|(own, ..)| *own == channel)
                    .map(|(_, declared, _)| *declared),
                before,
                after,
                floor,
                unit: channel.unit().to_owned(),
                before_percent: 100.0 * before / size(channel),
                after_percent: 100.0 * after / size(channel),
            };
            (channel.column().to_owned(), error)
        });
    Some(channels.collect())
}

pub(super) fn parameters(
    study: &Study<'_>,
    with_deviation: &[(FreeParameter, f64)],
) -> Vec<FittedParameter> {
    let model = &study.model;
    let last = study.found.last();
    let effects: Vec<FreeParameter> = with_deviation
        .iter()
        .map(|(parameter, _)| parameter)
        .filter(|parameter| !parameter.is_base())
        .cloned()
        .collect();
    let seen = sensitivities(&Dataset::of(model, Role::Fit), last, &effects);
    let name_of = |index: usize| match index.checked_sub(model.base.len()) {
        None => Some(model.base[index].name.clone()),
        Some(of_effect) => parameter_name(study, &effects[of_effect]),
    };
    model
        .base
        .iter()
        .zip(&seen)
        .enumerate()
        .map(|(index, (parameter, seen))| {
            let free = FreeParameter::Base(index);
            let deviation = deviation(with_deviation, |own| *own == free);
            let is_at_bound = parameter.declared.is_some()
                && free.normalised(model, &last.setting).abs() > AT_BOUND;
            let identifiable = !is_at_bound
                && deviation.is_some_and(|deviation| {
                    deviation < IDENTIFIED * (parameter.high - parameter.low)
                });
            let (identifiability, trades_with) = match seen {
                _ if is_at_bound => (Identifiability::AtBound, None),
                _ if identifiable => (Identifiability::Identified, None),
                Sensitivity::Absent => (Identifiability::Absent, None),
                Sensitivity::Collinear(like) => (Identifiability::TradeOff, like.and_then(name_of)),
                Sensitivity::Weak | Sensitivity::Distinct => (Identifiability::Weak, None),
            };
            FittedParameter {
                name: parameter.name.clone(),
                declared: parameter.declared,
                fitted: last.setting.base[index],
                std: deviation.filter(|deviation| deviation.is_finite() && !is_at_bound),
                unit: parameter.unit.to_owned(),
                identifiable,
                at_tolerance: is_at_bound,
                identifiability,
                trades_with,
            }
        })
        .collect()
}

/// The name under which the correlation of an estimate is told; nodes of a function and the phases
/// of waves have none.
fn correlated_name(study: &Study<'_>, parameter: &FreeParameter) -> Option<String> {
    match parameter {
        FreeParameter::Phasor { .. } | FreeParameter::Node { .. } => None,
        own => parameter_name(study, own),
    }
}

/// The name of a free parameter for readers.
fn parameter_name(study: &Study<'_>, parameter: &FreeParameter) -> Option<String> {
    match parameter {
        FreeParameter::Effect { placed, range: SearchRange { name, .. } }
        | FreeParameter::Phasor { placed, name, .. } => {
            let step = study.found.steps.get(*placed)?;
            Some(format!("{name} of {}", step.added.id))
        }
        FreeParameter::Base(index) => Some(study.model.base[*index].name.clone()),
        FreeParameter::Node { .. } => Some("the nonparametric function".to_owned()),
    }
}

fn roles(study: &Study<'_>) -> Roles {
    let names = |role| {
        study
            .model
            .of_role(role)
            .into_iter()
            .map(|index| study.model.records[index].name.clone())
            .collect()
    };
    Roles { fit: names(Role::Fit), select: names(Role::Select), report: names(Role::Report) }
}

fn candidates(study: &Study<'_>) -> Vec<CandidateGain> {
    let row = |round: usize, generic: bool, validation: &Validation| CandidateGain {
        round,
        id: format!("{}@{}", validation.id, validation.site),
        generic,
        gain_percent: validation.gain_percent(),
        t: validation.t,
        blocks_better: validation.better,
        blocks_worse: validation.worse,
        accepted: validation.accepted,
    };
    let found = &study.found;
    let mut rows: Vec<CandidateGain> = (1..)
        .zip(&found.rounds)
        .flat_map(|(round, ranking)| {
            ranking.iter().map(move |validation| row(round, false, validation))
        })
        .collect();
    let last = found.rounds.len().max(1);
    rows.extend(found.nonparametric.iter().map(|validation| row(last, true, validation)));
    rows
}

fn notes(study: &Study<'_>) -> Vec<String> {
    let steps = &study.found.steps;
    let came_back = |id: &str, site: Site| {
        steps.iter().any(|step| (step.added.id, step.added.site) == (id, site))
    };
    let given_up =
        study.found.given_up.iter().filter(|(id, site)| !came_back(id, *site)).map(|(id, site)| {
            format!(
                "{id} at the {site} was added and removed again: a later effect or a better fit of \
                 the declared model made it redundant, or the error stayed far above the \
                 repeatability"
            )
        });
    let unfinished = study.found.unfinished.map(|what| {
        let left_out = match what {
            Unfinished::DeclaredModel => "the declared model was not fitted to the end",
            Unfinished::Candidates => "not every effect was tried",
            Unfinished::Comparison => {
                "the effects named were not compared with every alternative, and no further one \
                 was tried"
            }
            Unfinished::OtherFirstEffects => {
                "not every leading candidate was tried as the first effect"
            }
            Unfinished::Functions => "not every function of one variable was tried",
        };
        format!("the time limit (--limit-s) ended the search early: {left_out}")
    });
    study.notes.iter().cloned().chain(given_up).chain(unfinished).collect()
}

fn next_experiment(study: &Study<'_>, verdict: Verdict) -> NextExperiment {
    let found = &study.found;
    match verdict {
        Verdict::Ambiguous => {
            let names = found.contested().map_or(String::new(), |(_, step)| {
                let own = step.added.effect();
                let rivals: Vec<String> =
                    step.rivals.iter().map(|rival| rival_words(own, *rival)).collect();
                format!("{} from {}", words(step.added.id), rivals.join(" or "))
            });
            NextExperiment::new(
                format!("These records cannot distinguish {names}."),
                "slow triangles and quick sines of several amplitudes, with a free handle and with \
                 a hand that drives the slave",
            )
        }
        Verdict::Undecided if found.unfinished.is_none() => NextExperiment::new(
            "Without the slave's position its friction near zero speed is not known well enough.",
            "the same movements with the slave's encoder (slave_rad)",
        ),
        Verdict::Undecided | Verdict::Inadequate => NextExperiment::new(
            "The search was not finished.",
            "nothing new: identify these records again with a larger --limit-s",
        ),
        Verdict::Unlisted => NextExperiment::new(
            "A residual remains that no listed effect explains.",
            "the same movement several times, and movements in which the variable it depends on \
             varies independently",
        ),
        _ if study.model.records.iter().all(|record| record.idle) => NextExperiment::new(
            "Without a hand that drives the slave, the scale of all torques relies on the motor \
             constant.",
            "two records in which a hand drives the slave with about 2 N·m while the torque sensor \
             records",
        ),
        _ => NextExperiment::new(
            "Effects that these movements do not excite remain undetected.",
            "the whole stroke slowly both ways, quick sines of several amplitudes, and every \
             movement repeated, for the noise floor",
        ),
    }
}
