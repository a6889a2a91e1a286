//! Guided movement on the lock-step rig: the loop on the slave beats every law that knows the
//! master alone, on lines of 1 m to 10 m, and is stable.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use lock_step::guided::{Quality, Sine, guided};
use lock_step::{Aim, LockStepRig};
use rig::{CompensationKind, ControlOptions, HandKind, Observer, RigFile, SlaveLoop};

const HYDROSTATIC: (&str, &str) =
    ("hydrostatic.toml", include_str!("../../../launch/rigs/hydrostatic.toml"));
const CABLE: (&str, &str) = ("cable.toml", include_str!("../../../launch/rigs/cable.toml"));
const LENGTHS_M: [f64; 4] = [1.0, 2.0, 5.0, 10.0];

fn rig((name, text): (&str, &str), length: Option<f64>) -> RigFile {
    let mut rig = RigFile::parse(text, name).unwrap();
    if let Some(length) = length {
        rig.model
            .parameters
            .iter_mut()
            .find(|parameter| parameter.name == "hose_length_m")
            .unwrap()
            .value = length;
    }
    rig.simulation.hand.kind = HandKind::Absent;
    rig
}

fn with(rig: &RigFile, kind: CompensationKind, observer: bool, slave: bool) -> RigFile {
    let mut rig = rig.clone();
    let options = &mut rig.axes[0].control.options;
    options.compensation.kind = kind;
    *options = ControlOptions {
        observer: observer.then(Observer::default),
        slave: slave.then(SlaveLoop::default),
        ..*options
    };
    rig
}

/// Root mean square error of the slave (°), the master's reference being `stretch` times the
/// desired movement.
fn error_deg(
    rig: &RigFile,
    effects: &[String],
    amplitude_deg: f64,
    hertz: f64,
    stretch: f64,
) -> f64 {
    let amplitude = stretch * amplitude_deg.to_radians();
    let mut trace =
        guided(rig, effects, &Sine { amplitude, hertz, settle_s: 4.0, keep_s: 2.0 }).unwrap();
    trace.desired.iter_mut().for_each(|desired| *desired /= stretch);
    Quality::of(&trace).unwrap().slave_error.to_degrees()
}

/// The best law that knows the master alone.
fn master_only(rig: &RigFile, amplitude_deg: f64, hertz: f64, stretch: f64) -> f64 {
    let laws = [
        (CompensationKind::Printed, false),
        (CompensationKind::Identified, false),
        (CompensationKind::Identified, true),
    ];
    laws.map(|(kind, observer)| {
        error_deg(&with(rig, kind, observer, false), &[], amplitude_deg, hertz, stretch)
    })
    .into_iter()
    .fold(f64::INFINITY, f64::min)
}

#[test]
fn it_beats_the_laws_of_the_master_on_every_line() {
    for length in LENGTHS_M {
        let rig = rig(HYDROSTATIC, Some(length));
        let all = with(&rig, CompensationKind::Identified, true, true);
        for hertz in [0.5, 1.0, 2.0] {
            let (ours, master) =
                (error_deg(&all, &[], 40.0, hertz, 1.0), master_only(&rig, 40.0, hertz, 1.0));
            assert!(
                ours < 0.8 * master && ours < 2.5,
                "{length} m, {hertz} Hz: {ours}°, the master alone {master}°"
            );
        }
    }
}

/// Even a master that is told of the pistons' ratio does not come near on the thesis's line.
#[test]
fn it_beats_a_master_that_knows_the_ratio() {
    let rig = rig(HYDROSTATIC, None);
    let stretch = 1.0 / rig.reflected_dynamics(0).unwrap().ratio;
    let slave = with(&rig, CompensationKind::Identified, false, true);
    for hertz in [0.5, 1.0, 2.0] {
        let (ours, master) =
            (error_deg(&slave, &[], 40.0, hertz, 1.0), master_only(&rig, 40.0, hertz, stretch));
        assert!(ours < 0.7 * master, "{hertz} Hz: {ours}°, the master alone {master}°");
    }
}

#[test]
fn it_beats_the_laws_of_the_master_on_the_cable() {
    let rig = rig(CABLE, None);
    let slave = with(&rig, CompensationKind::Identified, false, true);
    for (hertz, part) in [(0.5, 0.5), (1.0, 0.6), (2.0, 0.75)] {
        let (ours, master) =
            (error_deg(&slave, &[], 30.0, hertz, 1.0), master_only(&rig, 30.0, hertz, 1.0));
        assert!(ours < part * master, "{hertz} Hz: {ours}°, the master alone {master}°");
    }
}

/// Friction that the model knows nothing of, a quarter of what the slave has: the corrections find
/// it.
#[test]
fn it_finds_friction_that_the_model_lacks() {
    let rig = rig(HYDROSTATIC, None);
    let slave = with(&rig, CompensationKind::Identified, false, true);
    let effects = ["coulomb_friction@slave=0.6".to_owned()];
    for hertz in [0.5, 1.0, 2.0] {
        let (known, unknown) = (
            error_deg(&slave, &[], 40.0, hertz, 1.0),
            error_deg(&slave, &effects, 40.0, hertz, 1.0),
        );
        assert!(
            unknown < 1.6 * known,
            "{hertz} Hz: {unknown}°, {known}° with the friction that the model has"
        );
    }
}

/// After a movement, at rest: with all options on, nothing hunts, held by a hand or not.
#[test]
fn at_rest_nothing_moves_on_any_line() {
    let lines = LENGTHS_M
        .map(|length| rig(HYDROSTATIC, Some(length)))
        .into_iter()
        .chain([rig(CABLE, None)]);
    for (line, hand) in
        lines.flat_map(|rig| [(rig.clone(), HandKind::Absent), (rig, HandKind::Passive)])
    {
        let mut rig = with(&line, CompensationKind::Identified, true, true);
        rig.simulation.hand.kind = hand;
        let mut system = LockStepRig::new(&rig, &[]).unwrap();
        let (mut lowest, mut highest) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        while system.time_s() < 6.0 {
            let time_s = system.time_s();
            let aim = if time_s < 2.75 { Aim::sine(0.5, 1.0, time_s) } else { Aim::at_rest(-0.5) };
            let setpoint = system.setpoint(&aim);
            let motion = system.cycle(&setpoint).unwrap().motion;
            if time_s > 5.0 {
                for (side, position) in
                    [motion.master_position_rad, motion.slave_position_rad].into_iter().enumerate()
                {
                    lowest[side] = lowest[side].min(position);
                    highest[side] = highest[side].max(position);
                }
            }
        }
        for (side, name) in ["master", "slave"].into_iter().enumerate() {
            let moved = (highest[side] - lowest[side]).to_degrees();
            assert!(moved < 0.3, "{} {hand:?}: the {name} still moves by {moved}°", rig.name);
        }
    }
}
