//! § 4.3 on the lock-step rig: what the learning laws come to on the hydrostatic rig.
#![allow(clippy::unwrap_used)]

use learning::{BlockReport, LearningLaw};
use lock_step::ilc::{IlcError, IlcSimulation, IlcTask, PUBLISHED, feedback_only, model_based};
use rig::RigFile;

fn rig() -> RigFile {
    feedback_only(
        RigFile::parse(include_str!("../../../launch/rigs/hydrostatic.toml"), "hydrostatic.toml")
            .unwrap(),
    )
}

fn degrees(report: &BlockReport) -> f64 {
    report.error.unwrap().to_degrees()
}

/// Published: from about 11° to 1° in 83 blocks of 3 s.
#[test]
fn the_published_law_comes_to_one_degree_within_83_blocks() {
    let task = IlcTask::of_the_thesis(LearningLaw::Published(PUBLISHED));
    let mut simulation = IlcSimulation::new(&rig(), &[], &task).unwrap();
    let errors: Vec<f64> = (0..83).map(|_| degrees(&simulation.block(None).unwrap())).collect();
    let blocks = errors.iter().position(|error| *error <= 1.0).map(|at| at + 1);
    println!("from {:.2}° to {:.2}° in 83 blocks, 1° in block {blocks:?}", errors[0], errors[82]);
    assert!((8.0..=14.0).contains(&errors[0]) && errors[82] <= 1.0, "{errors:?}");
    assert!(simulation.learner().frozen().is_none());
}

#[test]
fn the_model_based_law_takes_a_tenth_of_the_blocks() {
    let rig = rig();
    let mut task = IlcTask::of_the_thesis(LearningLaw::Published(PUBLISHED));
    task.law = LearningLaw::ModelBased(model_based(&rig, &[], &task).unwrap());
    let mut simulation = IlcSimulation::new(&rig, &[], &task).unwrap();
    let errors: Vec<f64> = (0..8).map(|_| degrees(&simulation.block(None).unwrap())).collect();
    println!("{errors:.2?}");
    assert!(errors.iter().any(|error| *error <= 1.0), "{errors:?}");
}

#[test]
fn a_cycle_of_broken_steps_is_refused() {
    let mut task = IlcTask::of_the_thesis(LearningLaw::Published(PUBLISHED));
    task.hertz = 3.0;
    assert!(matches!(IlcSimulation::new(&rig(), &[], &task).unwrap_err(), IlcError::Period { .. }));
}
