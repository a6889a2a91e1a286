//! Answers of known worth, and what the scoring makes of them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use blind_cases::case::{DrawnFrom, Set, Truth, drawn};
use blind_cases::detectability::Detectability;
use blind_cases::effects::{Kinds, Variable, listed, unlisted};
use blind_cases::one_channel;
use blind_cases::score::{Answer, End, Naming, Run, Score, score, score_one_channel, variable};
use blind_cases::table::{Table, table as table_of};
use serde_json::{Value, json};

fn seen(gain: f64) -> Detectability {
    Detectability {
        floor: [1e-3; 3],
        without: [1e-2; 3],
        refitted: [1e-3 * (1.0 + gain); 3],
        gain,
        channel: 0,
    }
}

/// The truth about the first case of a set whose effects are these, at their drawn sizes.
fn truth(set: Set, effects: &[&str]) -> Truth {
    let forced = effects.iter().map(|name| (*name).to_owned()).collect();
    let from = DrawnFrom { forced, ..DrawnFrom::default() };
    let mut truth = drawn(set, 0, 3, &from).unwrap();
    truth.detectability = effects.iter().map(|_| seen(2.0)).collect();
    truth
}

fn judged(truth: &Truth, answer: Value) -> Score {
    let answer: Answer = serde_json::from_value(answer).unwrap();
    score(
        truth,
        Some(&answer),
        &Run { end: End::Done, code: Some(0), message: String::new(), seconds: 12.0 },
    )
}

fn named(id: &str, site: &str) -> Value {
    json!({ "id": id, "site": site, "parameters": [], "t": 9.0, "gain_percent": 40.0 })
}

#[test]
fn names_are_right_ambiguous_or_wrong() {
    let truth = truth(Set::Listed, &["backlash@slave"]);
    let naming = |answer: Value| judged(&truth, answer).naming.unwrap();
    let right = named("backlash", "slave");
    assert_eq!(naming(json!({ "verdict": "effect", "effects": [right] })), Naming::Right);
    assert_eq!(
        naming(json!({ "verdict": "effect", "effects": [named("backlash", "line")] })),
        Naming::WrongSite
    );
    assert_eq!(
        naming(json!({ "verdict": "effect", "effects": [named("leakage", "line"), right] })),
        Naming::Wrong
    );
    assert_eq!(naming(json!({ "verdict": "none" })), Naming::Missed);
    assert_eq!(naming(json!({ "verdict": "unlisted" })), Naming::Unlisted);
    let rivals = |rivals: Value| {
        let effects = [named("leakage", "line")];
        json!({ "verdict": "ambiguous", "effects": effects, "ambiguous_with": rivals })
    };
    assert_eq!(naming(rivals(json!([right]))), Naming::Ambiguous);
    assert_eq!(naming(rivals(json!([named("leakage", "line")]))), Naming::Wrong);
    let three = json!([right, named("leakage", "line"), named("mains_hum", "sensor")]);
    assert_eq!(naming(rivals(three)), Naming::Wrong, "at most two");
    let failed = Run { end: End::Failed, code: Some(1), message: "kind".to_owned(), seconds: 0.1 };
    let nothing = score(&truth, None, &failed);
    assert_eq!(
        (nothing.naming, nothing.alarm, nothing.flagged),
        (Some(Naming::NoAnswer), false, false)
    );
}

/// An eccentric disc as identify names it, at an encoder.
fn eccentric(on_master: f64) -> Value {
    json!({ "id": "encoder_eccentricity", "site": "sensor", "parameters": [
        { "name": "amplitude", "value": 0.02 }, { "name": "on_master", "value": on_master },
    ] })
}

#[test]
fn the_wrong_encoder_is_another_place() {
    let truth = truth(Set::Listed, &["encoder_eccentricity@sensor"]);
    let is = truth.effects[0].parameters.get("on_master");
    let (right, wrong) = (eccentric(is), eccentric(1.0 - is));
    let untold = named("encoder_eccentricity", "sensor");
    let judged = |verdict: &str, effect: &Value, rivals: Value| {
        judged(&truth, json!({ "verdict": verdict, "effects": [effect], "ambiguous_with": rivals }))
    };
    let naming = |verdict: &str, effect: &Value, rivals: Value| {
        judged(verdict, effect, rivals).naming.unwrap()
    };
    assert_eq!(naming("effect", &right, json!([])), Naming::Right);
    assert_eq!(naming("effect", &wrong, json!([])), Naming::WrongSite);
    assert_eq!(naming("effect", &untold, json!([])), Naming::WrongSite, "not told is not right");
    // Only with the verdict is it said that records cannot tell.
    assert_eq!(naming("effect", &wrong, json!([untold])), Naming::WrongSite);
    assert_eq!(naming("ambiguous", &wrong, json!([untold])), Naming::Ambiguous);
    assert_eq!(naming("ambiguous", &wrong, json!([right])), Naming::Ambiguous);
    assert_eq!(
        naming("ambiguous", &wrong, json!([wrong])),
        Naming::WrongSite,
        "the rival is the same wrong one"
    );
    assert_eq!(naming("ambiguous", &wrong, json!([named("backlash", "slave")])), Naming::WrongSite);
    assert_eq!(naming("ambiguous", &right, json!([untold])), Naming::Ambiguous);
    assert_eq!(
        naming("ambiguous", &named("backlash", "slave"), json!([untold])),
        Naming::Ambiguous
    );
    assert_eq!(judged("effect", &right, json!([])).size_errors.len(), 1);
    assert!(
        judged("effect", &wrong, json!([])).size_errors.is_empty(),
        "no size of what is not there"
    );
    assert!(judged("ambiguous", &wrong, json!([untold])).size_errors.is_empty());
    let table = table_of(&[judged("effect", &wrong, json!([]))]);
    assert_eq!(
        table.by_effect["encoder_eccentricity@sensor"].instead["encoder_eccentricity@sensor, \
            elsewhere"],
        1
    );
}

#[test]
fn the_wrong_encoder_of_a_pair_is_no_hit() {
    let truth = truth(Set::Pairs, &["backlash@slave", "encoder_eccentricity@sensor"]);
    let is = truth.effects[1].parameters.get("on_master");
    let judged = |verdict: &str, on_master: f64, rivals: Value| {
        let effects = [named("backlash", "slave"), eccentric(on_master)];
        let score = judged(
            &truth,
            json!({ "verdict": verdict, "effects": effects, "ambiguous_with": rivals }),
        );
        (score.both.unwrap(), score.false_third.unwrap())
    };
    let untold = named("encoder_eccentricity", "sensor");
    assert_eq!(judged("effect", is, json!([])), (true, false));
    assert_eq!(judged("effect", 1.0 - is, json!([])), (false, true));
    assert_eq!(judged("effect", 1.0 - is, json!([untold])), (false, true));
    assert_eq!(judged("ambiguous", 1.0 - is, json!([untold])), (true, false));
    assert_eq!(judged("ambiguous", 1.0 - is, json!([named("leakage", "line")])), (false, true));
}

#[test]
fn sizes_that_add_to_a_constant_are_compared_as_totals() {
    let truth = truth(Set::Listed, &["coulomb_friction@master"]);
    let added = truth.effects[0].parameters.get("level");
    let coulomb = truth.machine["motor_coulomb_nm"];
    let piston = ["master_piston_kinetic_friction_n", "master_pulley_radius_m"]
        .map(|name| truth.machine[name]);
    // A fifth of what was added is taken for motor friction: the total stays.
    let answer = |level: f64, base: f64| {
        let parameters = json!([{ "name": "level", "value": level }]);
        let effect = json!({
            "id": "coulomb_friction", "site": "master", "parameters": parameters
        });
        json!({ "verdict": "effect", "effects": [effect], "parameters": [
            { "name": "motor_coulomb_nm", "fitted": base },
            { "name": "master_piston_kinetic_friction_n", "fitted": piston[0] },
            { "name": "master_pulley_radius_m", "fitted": piston[1] },
        ] })
    };
    let shared = judged(&truth, answer(0.8 * added, coulomb + 0.2 * added));
    assert!(shared.size_errors[0] < 1e-9, "{:?}", shared.size_errors);
    assert!((shared.raw_size_errors[0] - 0.2).abs() < 1e-9);
    let total = coulomb + added + piston[0] * piston[1];
    let off = judged(&truth, answer(1.1 * added, coulomb));
    assert!((off.size_errors[0] - 0.1 * added / total).abs() < 1e-9, "{:?}", off.size_errors);
}

#[test]
fn unlisted_ones_need_flag_site_and_variable() {
    let truth = truth(Set::Unlisted, &["detent@slave"]);
    let told = |site: &str, on: &str| {
        judged(
            &truth,
            json!({
                "verdict": "unlisted",
                "unlisted": { "site": site, "depends_on": on, "table": [] }
            }),
        )
    };
    let right = told("slave", "slave_position");
    assert_eq!(
        (right.flagged, right.site_right, right.variable_right),
        (true, Some(true), Some(true))
    );
    let wrong = told("line", "slave velocity (rad/s)");
    assert_eq!(
        (wrong.flagged, wrong.site_right, wrong.variable_right),
        (true, Some(false), Some(false))
    );
    let missed = judged(
        &truth,
        json!({ "verdict": "effect", "effects": [named("gravity_imbalance", "slave")] }),
    );
    assert_eq!((missed.flagged, missed.site_right), (false, Some(false)));
}

#[test]
fn variables_are_recognised_by_their_usual_names() {
    for (text, expected) in [
        ("master_position", Variable::Position),
        ("slave_rad", Variable::Position),
        ("slave_velocity", Variable::Velocity),
        ("fluid speed", Variable::Velocity),
        ("slave_rad_s", Variable::Velocity),
        ("slave acceleration", Variable::Acceleration),
        ("line_force", Variable::Load),
        ("slave_torque_nm", Variable::Load),
        ("motor_v", Variable::Volts),
        ("time", Variable::Time),
        ("t_s", Variable::Time),
    ] {
        assert_eq!(variable(text), Some(expected), "{text}");
    }
    assert_eq!(variable("?"), None);
}

#[test]
fn two_effects_and_errors() {
    let truth = truth(Set::Pairs, &["backlash@slave", "torque_ripple@drive"]);
    let errors = json!({
        "master_rad": { "before": 4e-3, "after": 4e-4, "floor": 4e-4 },
        "slave_rad": { "before": 2e-2, "after": 6e-4, "floor": 5e-4 },
        "slave_torque_nm": { "before": 1.0, "after": 1.0, "floor": null },
    });
    let effects =
        [named("torque_ripple", "drive"), named("backlash", "slave"), named("leakage", "line")];
    let three = judged(&truth, json!({ "verdict": "effect", "effects": effects, "error": errors }));
    assert_eq!((three.both, three.false_third), (Some(true), Some(true)));
    assert!((three.over_floor.unwrap() - 1.2).abs() < 1e-12, "the worst channel with a floor");
    let one = judged(&truth, json!({ "verdict": "effect", "effects": effects[..1] }));
    assert_eq!((one.both, one.false_third), (Some(false), Some(false)));
}

/// A dead time at a place that no record tells from the true one is rightly ambiguous in a pair as
/// it is alone, if the true place is told.
#[test]
fn an_effect_of_a_pair_at_an_equivalent_site_is_rightly_ambiguous() {
    let truth = truth(Set::Pairs, &["transport_delay@drive", "quadratic_drag@slave"]);
    let effects =
        |site: &str| json!([named("quadratic_drag", "slave"), named("transport_delay", site)]);
    let judged = |verdict: &str, effects: Value, rivals: Value| {
        let answer = json!({ "verdict": verdict, "effects": effects, "ambiguous_with": rivals });
        let score = judged(&truth, answer);
        let counts = (score.all_found_or_ambiguous(), score.false_further());
        (score.both.unwrap(), counts)
    };
    let told = json!([named("transport_delay", "drive")]);
    assert_eq!(judged("effect", effects("drive"), json!([])), (true, (true, false)));
    assert_eq!(judged("ambiguous", effects("sensor"), told.clone()), (false, (true, false)));
    assert_eq!(judged("effect", effects("sensor"), told.clone()), (false, (false, true)));
    assert_eq!(judged("ambiguous", effects("sensor"), json!([])), (false, (false, true)));
    // A rival beside another name is none of the effect that it is a rival of.
    let other = json!([named("quadratic_drag", "slave"), named("backlash", "slave")]);
    assert_eq!(judged("ambiguous", other, told.clone()), (false, (false, true)));
    let mut three = effects("sensor");
    three.as_array_mut().unwrap().push(named("backlash", "slave"));
    assert_eq!(judged("ambiguous", three, told), (false, (true, true)));
}

fn count_in(table: &Table, what: &str) -> (usize, usize) {
    let row = table.rows.iter().find(|row| row.what == what).unwrap_or_else(|| panic!("{what}"));
    (row.share.unwrap().count, row.share.unwrap().of)
}

/// The table counts detectable cases only, and says how many there were.
#[test]
fn the_table_counts() {
    let mut scores = Vec::new();
    let mut truth = truth(Set::Listed, &["backlash@slave"]);
    for index in 0..10 {
        truth.index = index;
        truth.detectability = vec![seen(if index == 9 { 0.05 } else { 2.0 })];
        let site = if index < 6 { "slave" } else { "line" };
        scores.push(judged(
            &truth,
            json!({ "verdict": "effect", "effects": [named("backlash", site)] }),
        ));
    }
    let table = table_of(&scores);
    let count = |what: &str| count_in(&table, what);
    assert_eq!(count("detectable (all rows below are of these)"), (9, 10));
    assert_eq!(count("right name first (id and site)"), (6, 9));
    // Silence is no merit: a case without an answer is a missed name, and no proof against false
    // alarms.
    let late = Run { end: End::TooLate, code: None, message: String::new(), seconds: 300.0 };
    truth.detectability = vec![seen(2.0)];
    scores.push(score(&truth, None, &late));
    truth.set = Set::Clean;
    truth.effects.clear();
    truth.detectability.clear();
    scores.push(score(&truth, None, &late));
    scores.push(judged(&truth, json!({ "verdict": "unlisted" })));
    let table = table_of(&scores);
    let count = |what: &str| count_in(&table, what);
    assert_eq!(count("right name first (id and site)"), (6, 10));
    assert_eq!(count("right id at another site (likewise)"), (3, 9));
    assert_eq!(count("false alarms (of those answered)"), (1, 1));
    assert_eq!(table.by_effect["backlash@slave"].instead["backlash@line"], 3);
    assert!(table.to_string().contains("6 of 10 = 60.0 %"), "{table}");
}

/// What has no answer, no floor or another name does not hold a bar.
#[test]
fn bars_are_over_all_detectable_cases() {
    let mut truth = truth(Set::Listed, &["backlash@slave"]);
    let gap = truth.effects[0].parameters.get("gap");
    let answer = |after: f64, floor: Value, site: &str| {
        let parameters = json!([{ "name": "gap", "value": 1.01 * gap }]);
        let effect = json!({ "id": "backlash", "site": site, "parameters": parameters });
        let errors = json!({ "slave_rad": { "before": 1e-2, "after": after, "floor": floor } });
        json!({ "verdict": "effect", "effects": [effect], "error": errors })
    };
    let mut scores: Vec<Score> = (0..10)
        .map(|index| {
            truth.index = index;
            match index {
                0..7 => judged(&truth, answer(6e-4, json!(5e-4), "slave")),
                7 => judged(&truth, answer(9e-4, json!(5e-4), "slave")),
                8 => judged(&truth, answer(6e-4, Value::Null, "line")),
                _ => score(
                    &truth,
                    None,
                    &Run { end: End::TooLate, code: None, message: String::new(), seconds: 300.0 },
                ),
            }
        })
        .collect();
    let table = table_of(&scores);
    assert_eq!(count_in(&table, "error at most 1.4 repeat floors"), (7, 10));
    let row = |what: &str| table.rows.iter().find(|row| row.what == what).unwrap();
    let within = row("error at most 1.4 repeat floors");
    assert!(within.found.ends_with("2 of them without an answer or a floor"), "{}", within.found);
    assert_eq!(row("error over floor, 90th percentile").value, None, "two of ten have none");
    let median = row("error of the effective size, median");
    assert!((median.value.unwrap() - 0.01).abs() < 1e-9);
    assert!(median.found.ends_with("(n = 10, 2 of them without)"), "{}", median.found);
    let p90 = row("error of the effective size, 90th percentile");
    assert_eq!((p90.value, &p90.found[..]), (None, "no bound (n = 10, 2 of them without)"));
    assert!(
        (row("... of those rightly named, 90th percentile").value.unwrap() - 0.01).abs() < 1e-9
    );
    // A case that cannot be seen is in no bar.
    for score in &mut scores[8..] {
        score.detectable = false;
    }
    assert_eq!(count_in(&table_of(&scores), "error at most 1.4 repeat floors"), (7, 8));
}

/// The interface's table of sites has at least 20 ids, and eight effects are on no list.
#[test]
fn a_campaign_covers_all_effects_and_sites() {
    let ids: std::collections::BTreeSet<&str> = listed().iter().map(|entry| entry.id).collect();
    assert!(ids.len() >= 20 && unlisted(Kinds::New).len() >= 8);
}

/// A model with one channel does not tell its sites apart, and damping at either is one column.
#[test]
fn one_channel_is_scored_by_the_effect() {
    let names = ["line_damping@oscillator".to_owned()];
    let truth = one_channel::case::make(Set::OneChannelListed, 1, 5, &names).unwrap().truth;
    let run = Run { end: End::Done, code: Some(0), message: String::new(), seconds: 1.0 };
    let judged = |answer: Value| {
        score_one_channel(&truth, Some(&serde_json::from_value(answer).unwrap()), &run)
    };
    let naming = |answer: Value| judged(answer).naming.unwrap();
    let effect = |named: Value| json!({ "verdict": "effect", "effects": [named] });
    assert_eq!(naming(effect(named("line_damping", "line"))), Naming::Right);
    assert_eq!(naming(effect(named("viscous_friction", "slave"))), Naming::Right);
    assert_eq!(naming(effect(named("quadratic_drag", "slave"))), Naming::Wrong);
    let inadequate = judged(json!({ "verdict": "inadequate" }));
    assert_eq!((inadequate.naming, inadequate.flagged), (Some(Naming::Unlisted), true));
    assert!(inadequate.alarm && inadequate.size_errors.is_empty());
}
