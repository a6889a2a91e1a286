//! Free movement of § 4.2 on the lock-step rig: what a hand must spend to move the handle, with
//! force control and without.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use ipc_types::Mode;
use lock_step::free_movement::{HandEffort, HandleControl, Swing, swing};
use lock_step::{Aim, LockStepRig};
use rig::RigFile;

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");

fn rig() -> RigFile {
    RigFile::parse(RIG, "hydrostatic.toml").unwrap()
}

fn pair(rig: &RigFile, movement: &Swing) -> [HandEffort; 2] {
    [HandleControl::Off, HandleControl::Force].map(|control| swing(rig, control, movement).unwrap())
}

/// How little of the uncompensated machine's torque the hand must spend at most, rms. What is left
/// at 3 Hz is inertia, of which eq. 4.2.2 with P1 v_s = 0.167 V per N·m takes about a quarter.
const SHARES: [(f64, f64); 4] = [(0.5, 0.6), (1.0, 0.5), (2.0, 0.65), (3.0, 0.75)];

#[test]
fn force_control_takes_work_from_the_hand_up_to_three_hertz() {
    let rig = rig();
    for (hertz, share) in SHARES {
        let movement = Swing::of_the_thesis(hertz);
        let [dead, free] = pair(&rig, &movement);
        for spent in [&dead, &free] {
            assert!(
                (spent.amplitude / movement.amplitude - 1.0).abs() < 0.03,
                "{hertz} Hz: {:.1}°",
                spent.amplitude.to_degrees()
            );
        }
        assert!(free.rms < share * dead.rms, "{hertz} Hz: {:.2} of {:.2} N·m", free.rms, dead.rms);
        // Friction that is given back by the direction of the torque makes slow turns rougher: 0.5
        // Hz ripples 3.6 N·m instead of 1.4.
        if hertz >= 2.0 {
            assert!(
                free.ripple < 0.85 * dead.ripple,
                "{hertz} Hz: {:.2} of {:.2} N·m",
                free.ripple,
                dead.ripple
            );
        }
        let limits = &rig.axes[0].limits;
        assert!(
            free.peak < limits.torque_max.unwrap() && free.speed < limits.speed_max,
            "{hertz} Hz"
        );
    }
}

#[test]
fn without_torque_there_is_no_offset() {
    // Nobody at the handle, and a torque cell without noise: the motor gets nothing, whatever the
    // offset is.
    let mut rig = rig();
    rig.simulation.hand.kind = rig::HandKind::Absent;
    rig.simulation.torque_noise_v = 0.0;
    let mut system = LockStepRig::new(&rig, &[]).unwrap();
    for _ in 0..1000 {
        let mut setpoint = system.setpoint(&Aim::at_rest(0.0));
        setpoint.mode = Mode::Impedance.code();
        assert_eq!(system.cycle(&setpoint).unwrap().command.volts[0], 0.0);
    }
}
