//! The lock-step rig against what the processes promise: times, delay of the answer, errors.
#![allow(clippy::unwrap_used)]

use lock_step::{Aim, LockStepError, LockStepRig, OUTPUT_DELAY_TICKS};
use rig::RigFile;
use simulator::CardError;

const HYDROSTATIC: &str = include_str!("../../../launch/rigs/hydrostatic.toml");

fn rig(text: &str) -> RigFile {
    RigFile::parse(text, "rig.toml").unwrap()
}

/// Whatever the ratio of the rates, time counts from the first scan, and the answer takes its card
/// periods: the scans show it.
#[test]
fn cycles_are_on_the_grid_and_the_answer_comes_when_it_must() {
    for control_hz in [500, 1000, 2000] {
        let mut rig = rig(HYDROSTATIC);
        rig.rates.control_hz = control_hz;
        let mut system = LockStepRig::new(&rig, &[]).unwrap();
        let mut commanded = Vec::new();
        for cycle in 0..200u32 {
            let (time_s, scan_ns) = (system.time_s(), system.scan_ns());
            assert!((time_s - f64::from(cycle) / f64::from(control_hz)).abs() < 1e-12);
            let setpoint = system.setpoint(&Aim::sine(0.3, 1.0, time_s));
            assert_eq!(setpoint.at_ns, scan_ns);
            let moment = system.cycle(&setpoint).unwrap();
            assert_eq!((moment.time_s, moment.sample.scan_time_ns), (time_s, scan_ns));
            assert_eq!(moment.sample.motor_power, 1);
            // A scan reads back the volts of the newest command that is at least so old.
            let old = commanded
                .iter()
                .rev()
                .find(|(tick, _)| tick + OUTPUT_DELAY_TICKS <= moment.sample.tick);
            assert_eq!(
                moment.sample.motor_v[0],
                old.map_or(0.0, |(_, volts)| *volts),
                "{control_hz} Hz, {cycle}"
            );
            commanded.push((moment.sample.tick, moment.command.volts[0]));
            assert!(
                (moment.motion.slave_position_rad - moment.sample.slave_position[0]).abs() < 3e-3
            );
        }
        assert!(commanded.last().unwrap().1 != 0.0);
    }
}

#[test]
fn the_same_rig_does_the_same_again() {
    let run = || {
        let mut system =
            LockStepRig::new(&rig(HYDROSTATIC), &["backlash=0.01".to_owned()]).unwrap();
        let mut last = 0.0;
        while system.time_s() < 1.0 {
            let setpoint = system.setpoint(&Aim::sine(0.5, 1.0, system.time_s()));
            last = system.cycle(&setpoint).unwrap().motion.slave_position_rad;
        }
        last
    };
    assert_eq!(run(), run());
}

#[test]
fn a_rig_without_a_plant_and_an_unknown_effect_are_refused() {
    let drive = include_str!("../../../launch/rigs/emps.toml");
    let error = LockStepRig::new(&rig(drive), &[]).unwrap_err();
    assert!(matches!(error, LockStepError::Card(CardError::NoPlant { .. })), "{error}");
    let error = LockStepRig::new(&rig(HYDROSTATIC), &["no_such_effect".to_owned()]).unwrap_err();
    assert!(matches!(error, LockStepError::Card(CardError::Effect(_))), "{error}");
    let mut uneven = rig(HYDROSTATIC);
    uneven.rates.control_hz = 300;
    assert!(matches!(LockStepRig::new(&uneven, &[]).unwrap_err(), LockStepError::Rates { .. }));
}
