//! The shipped rigs under their own control: the law of the control process on the simulated card,
//! in lock step.
#![allow(clippy::unwrap_used)]

use lock_step::{Aim, LockStepRig};
use rig::RigFile;

/// Time after which the movement has come up and its transients have died (s).
const SETTLED_S: f64 = 4.0;

fn rig(name: &str) -> RigFile {
    RigFile::load(format!("{}/../../launch/rigs/{name}.toml", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

/// What a guided sine came to, once settled.
#[derive(Debug)]
struct Followed {
    /// Root mean square of reference less master (rad).
    error_rad: f64,
    /// Half the way of the master over its gear, and of the slave (rad).
    master_rad: f64,
    slave_rad: f64,
    /// Highest volts, and root mean square of their change from one command to the next (V).
    peak_v: f64,
    step_v: f64,
}

fn guided_sine(rig: &RigFile, amplitude_deg: f64, hertz: f64, seconds: f64) -> Followed {
    let mut system = LockStepRig::new(rig, &[]).unwrap();
    let (mut errors, mut steps) = (Vec::new(), Vec::new());
    let (mut master, mut slave) = ((f64::MAX, f64::MIN), (f64::MAX, f64::MIN));
    let (mut last_v, mut peak_v) = (0.0_f64, 0.0_f64);
    while system.time_s() < seconds {
        let setpoint =
            system.setpoint(&Aim::sine(amplitude_deg.to_radians(), hertz, system.time_s()));
        let moment = system.cycle(&setpoint).unwrap();
        let volts = moment.command.volts[0];
        peak_v = peak_v.max(volts.abs());
        if moment.time_s >= SETTLED_S {
            let motion = moment.motion;
            errors.push(moment.command.reference_position[0] - moment.sample.master_position[0]);
            steps.push(volts - last_v);
            master = (
                master.0.min(motion.master_position_rad),
                master.1.max(motion.master_position_rad),
            );
            slave =
                (slave.0.min(motion.slave_position_rad), slave.1.max(motion.slave_position_rad));
        }
        last_v = volts;
    }
    let rms = |values: &[f64]| {
        (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
    };
    Followed {
        error_rad: rms(&errors),
        master_rad: 0.5 * (master.1 - master.0),
        slave_rad: 0.5 * (slave.1 - slave.0),
        peak_v,
        step_v: rms(&steps),
    }
}

#[test]
fn the_hydrostatic_rig_follows_a_guided_sine() {
    let followed = guided_sine(&rig("hydrostatic"), 30.0, 1.0, 10.0);
    println!("hydrostatic, 30°, 1 Hz: {followed:?}");
    assert!(followed.error_rad < 0.08, "{followed:?}");
    assert!(followed.slave_rad > 0.3, "{followed:?}");
    assert!(followed.peak_v < 3.0 && followed.step_v < 0.2, "{followed:?}");
}

#[test]
fn the_cable_rig_follows_a_guided_sine() {
    let rig = rig("cable");
    // The movement of the shipped protocols.
    let guided = guided_sine(&rig, 30.0, 1.0, 10.0);
    println!("cable, 30°, 1 Hz: {guided:?}");
    assert!(guided.error_rad < 0.02, "{guided:?}");
    // The handle follows, less what the cables give.
    assert!(guided.slave_rad > 0.3 && guided.slave_rad < guided.master_rad, "{guided:?}");
    let fast = guided_sine(&rig, 20.0, 3.0, 10.0);
    println!("cable, 20°, 3 Hz: {fast:?}");
    assert!(fast.error_rad < 0.04, "{fast:?}");
    // So small a movement that the handle's friction holds it: the cables give.
    let small = guided_sine(&rig, 5.0, 1.0, 10.0);
    println!("cable, 5°, 1 Hz: {small:?}");
    assert!(small.error_rad < 0.02 && small.slave_rad < 0.01, "{small:?}");
    // A loop near its margin would show in the volts first.
    for followed in [small, guided, fast] {
        assert!(followed.peak_v < 3.0 && followed.step_v < 0.2, "{followed:?}");
    }
}

#[test]
fn the_cable_rig_holds_still_with_and_without_a_hand() {
    for kind in ["passive", "absent"] {
        let text = rig("cable").text().replace("kind = \"passive\"", &format!("kind = \"{kind}\""));
        let rig = RigFile::parse(&text, "cable.toml").unwrap();
        let held = guided_sine(&rig, 0.0, 1.0, 8.0);
        // a count is 3.1e-4 rad
        assert!(held.error_rad < 3.2e-4 && held.master_rad < 3.2e-4, "{kind}: {held:?}");
        assert!(held.step_v < 0.05, "{kind}: {held:?}");
    }
}
