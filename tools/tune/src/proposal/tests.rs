//! Proposals in lock-step: from the excitation to the tracking error on the true machine.

use identify::study::{StudyOptions, study};
use rig::{RigFile, load_protocol, load_rig};

use super::*;

fn movement() -> Protocol {
    load_protocol("guided-1hz".as_ref(), &["segments.0.duration_s=8".to_owned()]).unwrap()
}

fn rms(control: &RigFile, machine: Machine<'_>) -> f64 {
    play(control, machine, &movement()).unwrap().followed.error().unwrap().rms
}

#[test]
fn a_hidden_effect_is_found_and_the_proposal_keeps_its_promise() {
    let rig = load_rig("hydrostatic".as_ref()).unwrap();
    let effects = ["viscous_friction@slave=0.15".to_owned()];
    let machine = Machine { rig: &rig, effects: &effects };
    let excitation = load_protocol("tuning-excitation".as_ref(), &[]).unwrap();
    let record = play(&rig, machine, &excitation).unwrap().record;
    let outcome = study(&rig, &[record], StudyOptions::default()).unwrap().outcome;
    assert_eq!(outcome.effects[0].id, "viscous_friction", "{:?}", outcome.effects);
    let provenance = Provenance::today("test");
    let proposal = propose(&rig, &outcome, &movement(), &provenance).unwrap();
    let (before, after) = (rms(&rig, machine), rms(&proposal.control.rig, machine));
    assert!((proposal.before.rms / before - 1.0).abs() < 0.1, "{:?} {before}", proposal.before);
    assert!((proposal.control.error.rms / after - 1.0).abs() < 0.2, "{after}");
    assert!(after < 0.3 * before, "{before} {after}");
    assert!(proposal.control.uncompensated.is_empty(), "{:?}", proposal.control.uncompensated);
    assert!(proposal.left_out.is_empty() && proposal.model.contains("1 effect"));

    // With a motor three times as strong the present gains have no margin.
    let mut strong = outcome.clone();
    let per_volt = strong.parameters.iter_mut().find(|own| own.name == "motor_torque_per_volt_nm");
    per_volt.unwrap().fitted *= 4.0;
    let refused = propose(&rig, &strong, &movement(), &provenance).unwrap_err().to_string();
    assert!(refused.contains("margin of 1.5"), "{refused}");

    // What cannot be told apart is proposed by its first name, and said.
    let mut ambiguous = outcome.clone();
    ambiguous.verdict = Verdict::Ambiguous;
    ambiguous.ambiguous_with =
        vec![identify::outcome::Named { id: "leakage".to_owned(), site: "line".to_owned() }];
    let proposal = propose(&rig, &ambiguous, &movement(), &provenance).unwrap();
    assert!(proposal.left_out[0].contains("leakage@line"), "{:?}", proposal.left_out);
    assert_eq!(proposal.control.rig.model.effects.len(), 1);

    // An early answer is none to write.
    let early = Outcome { early: true, ..outcome };
    let refused = propose(&rig, &early, &movement(), &provenance).unwrap_err().to_string();
    assert!(refused.contains("early"), "{refused}");
}

#[test]
fn without_an_encoder_at_the_slave_the_outer_loop_is_refused() {
    let shipped = load_rig("hydrostatic".as_ref()).unwrap();
    let text = shipped.text().replacen("[axes.slave]\ncounts_per_turn = 4000\n", "", 1);
    let rig = RigFile::parse(&text, "no-slave.toml").unwrap();
    let best = best_control(&rig, &movement()).unwrap();
    assert!(!best.chosen.name.contains("slave"), "{:?}", best.chosen);
    let refused = best.choices.iter().filter(|choice| choice.predicted.error().is_none());
    for choice in refused.clone() {
        let Predicted::Refused(why) = &choice.predicted else { panic!() };
        assert!(why.contains("slave"), "{why}");
    }
    assert_eq!(refused.count(), 2);
}

#[test]
fn an_effect_that_no_knowledge_takes_away_is_said_to_remain() {
    let shipped = load_rig("hydrostatic".as_ref()).unwrap();
    let entry = "[[model.effects]]\nid = \"line_compliance\"\nsite = \"line\"\nparameters = { \
                 compliance_ratio = 1.0 }\n\n[replay]";
    let text = shipped.text().replacen("[replay]", entry, 1);
    let rig = RigFile::parse(&text, "soft.toml").unwrap();
    let best = best_control(&rig, &movement()).unwrap();
    let [remaining] = &best.uncompensated[..] else { panic!("{:?}", best.uncompensated) };
    assert_eq!(remaining.effect, "line_compliance@line");
    assert!(remaining.rms_without < 0.8 * best.error.rms);
}

#[test]
fn a_movement_that_is_too_short_is_refused_with_the_time_that_is_needed() {
    let rig = load_rig("hydrostatic".as_ref()).unwrap();
    let short = load_protocol("guided-1hz".as_ref(), &["segments.0.duration_s=4".to_owned()]);
    let refused = best_control(&rig, &short.unwrap()).unwrap_err().to_string();
    assert!(refused.contains("5 s or more") && refused.contains("4.0 s"), "{refused}");
}
