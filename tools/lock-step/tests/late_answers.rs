//! The position loop while control is kept from running: gaps of 2 to 22 ms, as ordinary tasks see
//! them on a busy host.
#![allow(clippy::unwrap_used)]

use lock_step::{Aim, LockStepRig};
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use rig::RigFile;

/// Twenty seconds of a guided sine of 1 Hz, ±35°; in the first 0.4 s of every second control misses
/// 0 to 10 cycles after each one that it computes. Returns the motor's largest speed as a share of
/// its limit, and the smallest factor on the feedback.
fn guided(rig: &str, seed: u64) -> (f64, f64) {
    let rig = RigFile::parse(rig, "rig.toml").unwrap();
    let mut system = LockStepRig::new(&rig, &[]).unwrap();
    let mut random = SplitMix64::seed_from_u64(seed);
    let (mut speed, mut factor) = (0.0_f64, 1.0_f64);
    while system.time_s() < 20.0 {
        let time_s = system.time_s();
        let aim = Aim::sine(35f64.to_radians() * (0.5 * time_s).min(1.0), 1.0, time_s);
        let moment = system.cycle(&system.setpoint(&aim)).unwrap();
        speed = speed.max(moment.motion.master_velocity_rad_s.abs());
        factor = factor.min(moment.command.feedback_factor);
        if time_s > 2.0 && time_s.fract() < 0.4 {
            system.miss(random.next_u64() % 11).unwrap();
        }
    }
    (speed / rig.axes[0].limits.speed_max, factor)
}

/// With the whole feedback, the motor of these rigs would reach 2 to 8 times its speed limit, and
/// the watchdog trip.
#[test]
fn gaps_do_not_make_the_position_loop_oscillate() {
    for rig in [
        include_str!("../../../launch/rigs/hydrostatic.toml"),
        include_str!("../../../launch/rigs/cable.toml"),
    ] {
        for seed in 1..=4 {
            let (speed, factor) = guided(rig, seed);
            assert!(speed < 0.6, "{speed:.3} of the speed limit");
            assert!((0.2..0.3).contains(&factor), "feedback reduced to {factor:.3}");
        }
    }
}
