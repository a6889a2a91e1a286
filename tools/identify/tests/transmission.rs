//! A transmission's records, made by a plant with an effect that the declared model lacks: the
//! search names it, and nothing where nothing is missing.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock};

use identify::deadline::{Deadline, NEVER};
use identify::equation_error::block_roles::Role;
use identify::prediction_error::candidates::{Candidate, candidates, free_parameters_of};
use identify::prediction_error::covariance::MODEL_ERROR;
use identify::prediction_error::dataset::Dataset;
use identify::prediction_error::floor_comparison::FloorComparison;
use identify::prediction_error::free_parameter::FreeParameter;
use identify::prediction_error::noise_floor::{above_floor, errors};
use identify::prediction_error::null_gains::NullGains;
use identify::prediction_error::parametric_bootstrap::{
    ServoGains, parametric_bootstrap, simulated_null,
};
use identify::prediction_error::record::{Record, rms, share_out};
use identify::prediction_error::record_features::record_features;
use identify::prediction_error::refit::fit_base;
use identify::prediction_error::score_bootstrap::{Replicates, score_bootstrap};
use identify::prediction_error::search::search;
use identify::prediction_error::search_result::{SearchResult, Unfinished};
use identify::prediction_error::selection_round::FittedCandidate;
use identify::prediction_error::step_refinement::{holds_with_finer_steps, refine_steps};
use identify::prediction_error::transmission_model::TransmissionModel;
use identify::prediction_error::validation::validate;
use plant::effects::{Site, parse};
use two_sides::{COUNT_RAD, rig};

mod two_sides;

fn record(turn: usize, effect: Option<&str>, hand: bool, push_v: f64) -> Record {
    let effects = effect.map(|text| parse(text).unwrap()).into_iter().collect();
    two_sides::record(turn, effects, hand, push_v, &|_| 0.0)
}

fn found(effect: Option<&str>, push_v: f64) -> (TransmissionModel, SearchResult) {
    found_in((0..5).map(|turn| record(turn, effect, turn == 4, push_v)).collect())
}

/// As [`found`], without the slave's encoder.
fn found_without_slave() -> SearchResult {
    let record = |turn| Record { slave: None, ..record(turn, None, turn == 4, 0.05) };
    found_in((0..5).map(record).collect()).1
}

fn model_of(records: Vec<Record>) -> TransmissionModel {
    model_with_zero(records, COUNT_RAD)
}

/// With the slave's zero unknown by this.
fn model_with_zero(mut records: Vec<Record>, error_rad: f64) -> TransmissionModel {
    share_out(&mut records, false);
    TransmissionModel::new("hydrostatic.toml", &rig().model, records, Some(error_rad)).unwrap()
}

fn found_in(records: Vec<Record>) -> (TransmissionModel, SearchResult) {
    let mut model = model_of(records);
    let found = search(&mut model, &NEVER).unwrap();
    (model, found)
}

#[test]
fn zeros_that_are_two_counts_apart_are_no_effect() {
    // A search for the stops finds each of the two to within one count.
    let zero = 1.8 * COUNT_RAD;
    let shifted = |turn| {
        let mut record = record(turn, None, turn == 4, 0.0);
        record.slave.iter_mut().flatten().for_each(|position| *position += zero);
        record
    };
    let mut model = model_with_zero((0..5).map(shifted).collect(), 2.0 * COUNT_RAD);
    let found = search(&mut model, &NEVER).unwrap();
    assert!(found.steps.is_empty(), "{:?}", found.steps.first().map(|step| step.added.id));
    let fitted = model.slave_zero_rad(&found.base.setting);
    assert!((fitted - zero).abs() < 0.2 * COUNT_RAD, "{fitted} rad of {zero}");
}

/// Backlash at the slave, searched once for the tests that need it.
static BACKLASH: LazyLock<(TransmissionModel, SearchResult)> =
    LazyLock::new(|| found(Some("backlash@slave=0.06"), 0.0));

fn slave_error(model: &TransmissionModel, found: &SearchResult) -> [f64; 2] {
    let report = model.of_role(Role::Report);
    [&found.base.setting, &found.last().setting]
        .map(|setting| errors(model, &report, setting).unwrap()[1].1)
}

#[test]
fn backlash_at_the_slave_is_found_with_its_size() {
    let (model, found) = &*BACKLASH;
    let names: Vec<_> =
        found.steps.iter().map(|step| (step.added.id, step.added.site.name())).collect();
    assert_eq!(names, [("backlash", "slave")]);
    let gap = found.last().setting.placed[0].value("gap").unwrap();
    assert!((gap - 0.06).abs() < 0.006, "{gap} rad");
    let [before, after] = slave_error(model, found);
    println!("backlash of {gap:.4} rad, slave error {before:.2e} -> {after:.2e} rad");
    assert!(after < 0.3 * before, "{before} -> {after} rad");
}

#[test]
fn no_effect_is_found_where_none_is_missing() {
    let (model, found) = found(None, 0.0);
    assert!(
        found.steps.is_empty() && found.unlisted_function.is_none(),
        "{:?}",
        found.steps.iter().map(|step| &step.added).collect::<Vec<_>>()
    );
    let [error, _] = slave_error(&model, &found);
    // What is left is what a count is: COUNT_RAD/√12 is 0.45 mrad a row, and less where rows are
    // averaged.
    assert!(error < 1e-3, "{error} rad");
    let torque = model
        .base
        .iter()
        .position(|parameter| parameter.name == "motor_torque_per_volt_nm")
        .unwrap();
    let fitted = found.base.setting.base[torque];
    assert!((fitted / 1.62 - 1.0).abs() < 0.03, "{fitted} N·m/V");
    // What the best candidate gained is what chance and a small error of the model give.
    let gain = found.rounds[0][0].gain;
    let gains = by_chance(&model, &found, 1, &NEVER).unwrap();
    println!("largest gain {gain:.4}, p = {:.3}", gains.probability(gain));
    assert!(gains.probability(gain) > 0.05, "{gain}: {:.3}", gains.probability(gain));
}

/// Gains of 199 linearised replicates of the declared model.
fn by_chance(
    model: &TransmissionModel,
    found: &SearchResult,
    seed: u64,
    deadline: &Deadline,
) -> Option<NullGains> {
    let [fit, select] =
        [Role::Fit, Role::Select].map(|role| Dataset::of(model, role).until(deadline));
    let replicates = Replicates { count: 199, seed, model_error: MODEL_ERROR, over_octaves: false };
    score_bootstrap((&fit, &select), &found.base, &found.last().setting, replicates)
}

#[test]
fn no_linearised_replicate_gains_as_much_as_a_true_effect() {
    let (model, found) = &*BACKLASH;
    let gain = found.steps[0].added.gain;
    let gains = by_chance(model, found, 1, &NEVER).unwrap();
    assert_eq!((gains.replicates(), gains.as_much(gain)), (199, 0), "{gain}: {gains:?}");
    // It follows from the seed, not from the number of threads.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert_eq!(pool.install(|| by_chance(model, found, 1, &NEVER)), Some(gains.clone()));
    assert_ne!(by_chance(model, found, 2, &NEVER), Some(gains));
    assert_eq!(by_chance(model, found, 1, &Deadline::when(|| true)), None);
}

#[test]
fn without_the_slaves_encoder_nothing_is_named_that_is_not_missing() {
    let found = found_without_slave();
    assert!(found.steps.is_empty(), "{:?}", found.steps[0].added);
    assert!(!found.inadequate && found.unlisted_function.is_none());
}

/// An effect in one record alone, which fits: no candidate can pass on the others.
#[test]
fn an_effect_in_a_single_record_is_not_called_nothing() {
    let effect = |turn| (turn == 2).then_some("backlash@slave=0.06");
    let records: Vec<Record> =
        (0..5).map(|turn| record(turn, effect(turn), turn == 4, 0.0)).collect();
    let (model, found) = found_in(records);
    let floor = FloorComparison::of(&model, &model.of_role(Role::Select), &found.base.setting);
    let outlying = floor.outlying_record().map(|of| of.record);
    assert_eq!((model.records[2].role, outlying), (Role::Fit, Some(2)), "{:?}", floor.largest);
    let names: Vec<_> = found.steps.iter().map(|step| step.added.effect()).collect();
    assert!(found.inadequate && names.is_empty(), "{names:?}");
}

#[test]
fn friction_beyond_the_declared_is_found() {
    let (_, found) = found(Some("coulomb_friction@slave=1.2"), 0.0);
    let names: Vec<_> =
        found.steps.iter().map(|step| (step.added.id, step.added.site.name())).collect();
    assert_eq!(names, [("coulomb_friction", "slave")]);
}

#[test]
fn presliding_holds_with_finer_steps_only_if_it_is_real() {
    for (effect, is_there) in [(Some("presliding_hysteresis@slave=0.8"), true), (None, false)] {
        let mut records: Vec<Record> =
            (0..5).map(|turn| record(turn, effect, turn == 4, 0.0)).collect();
        share_out(&mut records, false);
        let model =
            TransmissionModel::new("hydrostatic.toml", &rig().model, records, Some(COUNT_RAD))
                .unwrap();
        let (fit, select) = (Dataset::of(&model, Role::Fit), Dataset::of(&model, Role::Select));
        let base = fit_base((&fit, &select)).unwrap();
        let listed = candidates(&record_features(&fit, &base));
        let slave = |of: &&Candidate| (of.id, of.site) == ("presliding_hysteresis", Site::Slave);
        let of = listed.iter().find(slave).unwrap();
        let own = [base.parameters.clone(), free_parameters_of(of, 0)].concat();
        let fits = of.starts.iter().filter_map(|start| fit.fit(&base.setting.with(start), &own, 3));
        let fitted = fits.min_by(|a, b| a.objective.total_cmp(&b.objective)).unwrap();
        let [before, after] =
            [&base, &fitted].map(|fitted| select.residuals(&fitted.setting).unwrap());
        let mut validation = validate((of.id, of.site), &before, &after);
        println!("{effect:?}: gain {:.2}", validation.gain);
        // Where there is none, steps of 2 ms are supposed to have shown one.
        validation.gain = validation.gain.max(0.5);
        let added = FittedCandidate { candidate: 0, fitted, validation };
        assert_eq!(holds_with_finer_steps((&fit, &select), &base, &added), is_there, "{effect:?}");
    }
}

const DRIVE: ServoGains = ServoGains { position_gain: 7.0, velocity_gain: 0.4, volts_max: 10.0 };

#[test]
fn records_whose_voltage_chatters_are_simulated_with_finer_steps() {
    let model = |records: Vec<Record>| {
        TransmissionModel::new("hydrostatic.toml", &rig().model, records, Some(COUNT_RAD)).unwrap()
    };
    let slow: Vec<Record> = (0..2).map(|turn| record(turn, None, false, 0.05)).collect();
    // As a position servo with dead time does, between its limits a hundred times a second.
    let mut chattering = slow.clone();
    for (row, volts) in chattering[1].volts.iter_mut().enumerate() {
        *volts = if row % 10 < 5 { 8.0 } else { -8.0 };
    }
    for (records, finer) in [(slow, false), (chattering, true)] {
        let mut model = model(records);
        refine_steps(&mut model);
        let steps: Vec<u32> = model.records.iter().map(|record| record.steps).collect();
        assert!(steps.iter().all(|steps| (*steps > 1) == finer), "{steps:?}");
        let again = steps.clone();
        refine_steps(&mut model);
        let steps: Vec<u32> = model.records.iter().map(|record| record.steps).collect();
        assert_eq!(steps, again);
    }
}

#[test]
fn a_replicate_moves_alike_and_its_innovations_match_the_repeatability() {
    let (model, found) = found(Some("backlash@slave=0.06"), 0.05);
    let (simulated_null, setting) = simulated_null(&model, &found, DRIVE, 1).unwrap();
    assert!(setting.placed.is_empty(), "{:?}", setting.placed);
    for (old, new) in model.records.iter().zip(&simulated_null.records) {
        let off = rms(old.master.iter().zip(&new.master).map(|(old, new)| old - new));
        assert!(
            off > 0.0 && off < 0.2 * rms(old.master.iter().copied()),
            "{}: {off} rad",
            old.name
        );
        assert_eq!((old.idle, old.role, old.volts.len()), (new.idle, new.role, new.volts.len()));
    }
    let all: Vec<usize> = (0..model.records.len()).collect();
    let measured = errors(&model, &all, &found.last().setting).unwrap();
    let simulated = errors(&simulated_null, &all, &setting).unwrap();
    for ((channel, _, floor), (_, left, _)) in measured.iter().zip(&simulated).take(2) {
        let ratio = left / floor.unwrap();
        println!("{channel:?}: {left:.2e} rad, {ratio:.2} of what repeats differ by");
        assert!((0.6..1.7).contains(&ratio), "{channel:?}: {ratio}");
    }
}

/// Deadlines that count how often they are asked, in place of a clock.
#[test]
fn an_early_answer_keeps_what_was_finished_and_names_nothing_else() {
    let (mut model, whole) = (BACKLASH.0.clone(), &BACKLASH.1);
    let asked = Arc::new(AtomicUsize::new(0));
    let after = |most: usize| {
        let asked = Arc::clone(&asked);
        asked.store(0, Ordering::Relaxed);
        Deadline::when(move || asked.fetch_add(1, Ordering::Relaxed) >= most)
    };
    let found = search(&mut model, &after(usize::MAX)).unwrap();
    assert_eq!((found.unfinished, found.undecided), (None, false));
    assert_eq!(found.last().objective.to_bits(), whole.last().objective.to_bits());
    assert_eq!(found.last().setting.base, whole.last().setting.base);
    let all = asked.load(Ordering::Relaxed);
    assert!(all > 100, "{all} units of work");

    for most in [0, 3, all / 8, all / 2, all - 1] {
        let deadline = after(most);
        let found = search(&mut model, &deadline).unwrap();
        let names: Vec<_> = found.steps.iter().map(|step| step.added.effect()).collect();
        println!("{most} of {all}: {:?} {names:?}", found.unfinished);
        assert!(deadline.left_work_out() && found.unfinished.is_some());
        // Backlash shows far above the floor: without it the question is open.
        assert_eq!(found.undecided, names.is_empty() && !found.inadequate);
        match found.unfinished {
            Some(Unfinished::DeclaredModel) => assert!(found.undecided && names.is_empty()),
            Some(Unfinished::Candidates) if names.is_empty() => {
                let tried = found.rounds.iter().flatten();
                assert!(found.undecided && tried.into_iter().all(|tried| !tried.accepted));
            }
            _ => assert_eq!(names, [("backlash", Site::Slave)]),
        }
    }
}

/// A search with a clock that stands at four fifths of the time from the end of the first fit of
/// the declared model, or from the beginning.
fn late_from(model: &TransmissionModel, fitted: bool) -> SearchResult {
    let asked = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&asked);
    let counting = Deadline::after(move || {
        count.fetch_add(1, Ordering::Relaxed);
        0.0
    });
    let [fit, select] =
        [Role::Fit, Role::Select].map(|role| Dataset::of(model, role).until(&counting));
    fit_base((&fit, &select)).unwrap();
    let most = if fitted { asked.swap(0, Ordering::Relaxed) } else { 0 };
    let late = move || if asked.fetch_add(1, Ordering::Relaxed) < most { 0.0 } else { 0.8 };
    search(&mut model.clone(), &Deadline::after(late)).unwrap()
}

/// Effects are not tried any more, but the rest of the time tells where a refuted model lacks
/// something.
#[test]
fn what_refutes_the_declared_model_is_placed_though_not_every_effect_was_tried() {
    let found = late_from(&BACKLASH.0, true);
    assert_eq!(found.unfinished, Some(Unfinished::Candidates));
    assert!(found.steps.is_empty() && found.inadequate && !found.undecided);
    assert!(found.unlisted_function.is_some() || found.localisation.is_some());
    // A model that was not fitted is not refuted.
    let found = late_from(&BACKLASH.0, false);
    assert_eq!(found.unfinished, Some(Unfinished::DeclaredModel));
    assert!(found.steps.is_empty() && !found.inadequate && found.undecided);
    // Where nothing is missing, nothing is placed.
    let model = model_of((0..5).map(|turn| record(turn, None, turn == 4, 0.0)).collect());
    let found = late_from(&model, true);
    assert_eq!(found.unfinished, Some(Unfinished::Candidates));
    assert!(found.steps.is_empty() && !found.inadequate && found.localisation.is_none());
}

#[test]
fn replicates_that_the_deadline_leaves_out_are_not_counted() {
    let (model, found) = &*BACKLASH;
    let deadline = Deadline::when(|| true);
    let bootstrap = parametric_bootstrap(model, found, DRIVE, 19, 1, &deadline).unwrap();
    assert_eq!((bootstrap.gains.replicates(), bootstrap.unsearched, bootstrap.alarms), (0, 19, 0));
}

#[test]
fn replicates_without_a_missing_effect_raise_no_alarm() {
    let (model, found) = &*BACKLASH;
    let bootstrap = parametric_bootstrap(model, found, DRIVE, 2, 1, &NEVER).unwrap();
    let gain = found.steps[0].added.gain;
    assert_eq!(
        (bootstrap.gains.replicates(), bootstrap.alarms, bootstrap.gains.as_much(gain)),
        (2, 0, 0),
        "{bootstrap:?}"
    );
    assert!((bootstrap.gains.probability(gain) - 1.0 / 3.0).abs() < 1e-12);
}

#[test]
fn a_withdrawn_effect_leaves_the_declared_model() {
    let (model, mut found) = (&BACKLASH.0, BACKLASH.1.clone());
    found.without_last(model).unwrap();
    assert!(
        found.steps.is_empty()
            && found.last().parameters.iter().all(FreeParameter::is_base)
            && found.last().setting.placed.is_empty()
    );
    assert!(found.without_last(model).is_some(), "nothing to take back is no failure");
    // What it explained is missing again, and that must be said.
    found.reassess(model, &NEVER);
    assert!(found.inadequate || found.unlisted_function.is_some(), "{:?}", found.nonparametric);
}

#[test]
fn reporting_records_do_not_decide_whether_the_floor_is_reached() {
    let mut records: Vec<Record> = (0..5).map(|turn| record(turn, None, turn == 4, 0.0)).collect();
    share_out(&mut records, false);
    let mut model =
        TransmissionModel::new("hydrostatic.toml", &rig().model, records, Some(COUNT_RAD)).unwrap();
    let (select, setting) = (model.of_role(Role::Select), model.start());
    let above = |model: &TransmissionModel| above_floor(model, &select, &setting);
    assert!(above(&model).is_some(), "the fourth record repeats the first");
    model.records[0].role = Role::Report;
    model.records[3].role = Role::Report;
    assert_eq!(above(&model), None, "only reporting records are repeated");
}

#[test]
fn roles_are_assigned_among_records_with_a_hand_and_without() {
    let mut records: Vec<Record> = (0..5).map(|turn| record(turn, None, turn == 4, 0.0)).collect();
    share_out(&mut records, false);
    assert!(records[..4].iter().all(|record| record.idle) && !records[4].idle);
    let count = |role| records.iter().filter(|record| record.role == role).count();
    assert_eq!([count(Role::Fit), count(Role::Select), count(Role::Report)], [3, 1, 1]);
    assert!(rms(records[0].master.iter().copied()) > 0.1);
}
