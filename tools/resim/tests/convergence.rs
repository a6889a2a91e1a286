//! The law of a control that ran before the recording began.
#![allow(clippy::unwrap_used)]

use control::cycle::Seen;
use control::law::{Law, LawConfig};
use ipc_types::program_flow::{CONTROL_CYCLE, signature};
use ipc_types::{MotorCommand, Profile, Sample};
use resim::{NotCompared, Recorded, Replay, Report, Rigs, Runs};
use rig::RigFile;

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const PERIOD_NS: u64 = 2_000_000;
/// Scan time of the first cycle: of a computer that has run for hours.
const START_NS: u64 = 10_000_000_000_000;
/// The cycle with which the recording begins.
const BEGIN: u64 = 1000;

/// Control without power, beside a hand that moves the handle to and fro; what is recorded of it.
fn recorded(cycles: u64, position: impl Fn(f64) -> f64) -> Vec<(Sample, MotorCommand)> {
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    let mut law = Law::new(LawConfig::of_rig(&rig));
    let mut recorded = Vec::new();
    for cycle in 0..cycles {
        let scan_time_ns = START_NS + cycle * PERIOD_NS;
        let mut sample = Sample {
            session: 1,
            incarnation: 2,
            sequence: cycle,
            time_ns: scan_time_ns + 80_000,
            tick: cycle,
            scan_time_ns,
            axes: 1,
            master_present: 1,
            slave_present: 1,
            torque_present: 1,
            homed: 1,
            homing_sequence: 1,
            ..Sample::default()
        };
        sample.master_position[0] = position(cycle as f64 * 2e-3);
        sample.slave_position[0] = 0.9 * sample.master_position[0];
        // A gap before the recording begins, which the law remembers for a while.
        let late_ns = if cycle == BEGIN - 20 { 30_000_000 } else { 200_000 };
        let now_ns = scan_time_ns + late_ns;
        let seen = Seen { sample: &sample, setpoint: None, token: None, incarnation: 3 };
        let command = MotorCommand {
            session: 1,
            incarnation: 3,
            sequence: cycle,
            time_ns: now_ns,
            flow: signature(CONTROL_CYCLE, 0),
            ..seen.step(&mut law, now_ns)
        };
        if cycle >= BEGIN {
            recorded.push((sample, command));
        }
    }
    recorded
}

fn replay(recorded: &[(Sample, MotorCommand)]) -> Report {
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    let rigs = Rigs::new(rig, Profile::BestEffort, START_NS + BEGIN * PERIOD_NS);
    let mut replay = Replay::new(rigs, Runs::default(), None, Vec::new()).unwrap();
    for (sample, command) in recorded {
        replay.take(Recorded::Sample(sample));
        replay.take(Recorded::Command(command));
    }
    replay.report()
}

#[test]
fn the_state_of_a_control_that_ran_before_comes_to_follow_from_its_inputs() {
    let recorded = recorded(BEGIN + 6000, |t_s| 0.3 * (2.0 * t_s).sin());
    let report = replay(&recorded);
    let control = &report.cores[0];
    assert_eq!((control.messages, control.differing), (6000, 0), "{control:?}");
    let [begin] = control.begins.as_slice() else { panic!("{control:?}") };
    assert!((6.0..9.0).contains(&begin.at_s), "{begin:?}");
    assert_eq!(control.compared + control.not_compared[&NotCompared::BeganBefore], 6000);
    assert!(control.compared > 1500, "{control:?}");
}

#[test]
fn a_state_that_did_not_follow_would_have_differed() {
    let mut recorded = recorded(BEGIN + 6000, |t_s| 0.3 * (2.0 * t_s).sin());
    // One step of which the samples do not tell: the estimate of the velocity remembers it.
    let law_has = recorded[5000].0.master_position[0];
    recorded[5000].0.master_position[0] = law_has + 1e-4;
    let control = replay(&recorded).cores.remove(0);
    let found = control.first_difference.unwrap();
    assert_eq!(found.sequence, BEGIN + 5000);
    assert!(control.differing > 10, "{}", control.differing);
}
