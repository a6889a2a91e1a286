//! The check of fields against the rig, held against the lock-step rig: what passes settles after a
//! push, what is far beyond runs away.
//!
//! Settled means no more than the chatter that force control has without any field as well
//! (`plant::stability`).
#![allow(clippy::unwrap_used, clippy::expect_used)]

use ipc_types::{Mode, Setpoint};
use lock_step::{Aim, LockStepRig};
use rig::protocol::Protocol;
use rig::{HandKind, RigFile};

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");

/// The push: a guided movement at this peak speed (rad/s) and 2 Hz, left alone at its middle.
const PUSH: f64 = 10.0;
/// Beyond this speed the watchdog would have cut the power (rad/s): 1500 °/s.
const RUNAWAY: f64 = 26.18;
/// A chatter stays below (rad/s).
const CHATTER: f64 = 13.0;

/// The rig with a hand of a stiffness (N·m/rad) and a damping (N·m·s/rad); of none, with nobody.
fn rig(stiffness: f64, damping: f64) -> RigFile {
    let mut rig = RigFile::parse(RIG, "hydrostatic.toml").unwrap();
    let hand = &mut rig.simulation.hand;
    hand.kind = if stiffness > 0.0 { HandKind::Passive } else { HandKind::Absent };
    (hand.stiffness, hand.damping) = (stiffness, damping);
    // What a field does is to be seen, not what ends it.
    rig.simulation.end_stops = None;
    rig
}

fn hands() -> [RigFile; 4] {
    [rig(0.0, 0.0), rig(0.3, 0.05), rig(5.0, 0.2), rig(20.0, 0.5)]
}

#[derive(Clone, Copy, Debug)]
struct Setting {
    key: &'static str,
    value: f64,
}

impl Setting {
    fn passes(&self) -> bool {
        let text = format!(
            "[protocol]\nname = \"p\"\n[[segments]]\nkind = \"free\"\nduration_s = 1.0\n{} = {}\n",
            self.key, self.value
        );
        Protocol::parse(&text, "p.toml")
            .unwrap()
            .check_against(&RigFile::parse(RIG, "hydrostatic.toml").unwrap())
            .is_ok()
    }

    fn put(&self, setpoint: &mut Setpoint) {
        match self.key {
            "spring" => setpoint.stiffness[0] = self.value,
            "damper" => setpoint.damping[0] = self.value,
            _ => setpoint.inertia[0] = self.value,
        }
    }
}

/// Highest speed of the handle in the last second of four after the push (rad/s), and farthest
/// position (rad).
fn pushed(rig: &RigFile, setting: &Setting) -> (f64, f64) {
    let mut system = LockStepRig::new(rig, &[]).unwrap();
    let omega = std::f64::consts::TAU * 2.0;
    let (mut speed, mut way) = (0.0_f64, 0.0_f64);
    while system.time_s() < 5.0 {
        let time_s = system.time_s();
        let guided = time_s < 1.0;
        let aim = if guided { Aim::sine(PUSH / omega, 2.0, time_s) } else { Aim::at_rest(0.0) };
        let mut setpoint = system.setpoint(&aim);
        if !guided {
            setpoint.mode = Mode::Impedance.code();
            setting.put(&mut setpoint);
        }
        let moment = system.cycle(&setpoint).unwrap();
        if time_s > 4.0 {
            speed = speed.max(moment.motion.slave_velocity_rad_s.abs());
            way = way.max(moment.motion.slave_position_rad.abs());
        }
    }
    (speed, way)
}

#[test]
fn what_passes_settles() {
    for (key, value) in [
        ("spring", 5.0),
        ("spring", 0.5),
        ("damper", 0.5),
        ("damper", -0.3),
        ("inertia", 0.006),
        ("inertia", -0.015),
        ("spring", -0.8),
    ] {
        let setting = Setting { key, value };
        assert!(setting.passes(), "{setting:?}");
        for rig in hands() {
            let (speed, way) = pushed(&rig, &setting);
            println!(
                "{setting:?} hand {}: {speed:.1} rad/s, {way:.2} rad",
                rig.simulation.hand.stiffness
            );
            assert!(
                speed < CHATTER,
                "{setting:?}, hand {}: {speed:.1} rad/s at {way:.2} rad",
                rig.simulation.hand.stiffness
            );
        }
    }
}

#[test]
fn what_is_far_beyond_runs_away() {
    for (key, value) in [("damper", 2.0), ("inertia", 0.02)] {
        let setting = Setting { key, value };
        assert!(!setting.passes(), "{setting:?}");
        let worst = hands().iter().map(|rig| pushed(rig, &setting).0).fold(0.0, f64::max);
        println!("{setting:?}: {worst:.1} rad/s");
        assert!(worst > RUNAWAY, "{setting:?}: {worst:.1} rad/s");
    }
}

#[test]
fn a_divergent_field_that_passes_is_held_by_a_relaxed_hand_and_one_that_does_not_leaves_the_range()
{
    let most = RigFile::parse(RIG, "hydrostatic.toml").unwrap().axes[0].limits.position_max;
    let (held, leaves) =
        (Setting { key: "spring", value: -0.8 }, Setting { key: "spring", value: -3.0 });
    assert!(held.passes() && !leaves.passes());
    let relaxed = rig(0.3, 0.05);
    assert!(pushed(&relaxed, &held).1 < most, "{:?}", pushed(&relaxed, &held));
    assert!(pushed(&relaxed, &leaves).1 > most, "{:?}", pushed(&relaxed, &leaves));
}
