//! The processes' cores on the time grid of a rig, against the lock-step rig: sample by sample, bit
//! for bit.
//!
//! Every process of the live rig has its pure core here (card, converter and gate, law, watchdog's
//! machine, protocol's player), each called when its grid says so, in the order of the phases; a
//! message is seen by whoever looks after it was sent, as through shared memory. Nothing sleeps and
//! nothing is shared: this is the live rig whose clock is never late. The lock-step rig then gets
//! the setpoints that control saw, with the times moved to its own clock.
//!
//! What is equal: every scan that control answers (encoder counts, analog inputs with their noise,
//! volts at the motors), and every command, from the first scan on, before power and after. What is
//! not: whether the motor has power before anybody enabled it, for the lock-step rig's enable line
//! toggles by itself (at 0 V that moves nothing; a hand of kind "moving" would set off earlier),
//! and identities, sequences and times.
#![allow(clippy::unwrap_used)]

mod cores;

use cores::{Cycle, Rig, Timeline};
use ipc_types::{AXES, GateState, MotorCommand, Sample, Setpoint, WatchdogState};
use lock_step::LockStepRig;
use rig::RigFile;

/// The lock-step rig's card counts its first scan so.
const LOCK_STEP_FIRST_TICK: u64 = 2;

/// Runs the cores for that many periods of the card; returns the tick of the first scan and
/// control's cycles.
fn run_live(rig: &RigFile, protocol: &str, periods: u64) -> (u64, Vec<Cycle>) {
    let (mut live, mut timeline) = (Rig::new(rig, protocol), Timeline::new(rig));
    let first = timeline.first;
    for tick in first..first + periods {
        timeline.run(&mut live, tick);
    }
    assert_eq!(live.machine.state(), WatchdogState::Enabled, "{:?}", live.machine.cause());
    assert_eq!(live.gate.state(), GateState::Open);
    (first, live.cycles)
}

/// What of a sample the machine decides, as bits.
fn machine_of(sample: &Sample) -> impl PartialEq + std::fmt::Debug + use<> {
    (
        sample.master_counts,
        sample.slave_counts,
        sample.analog_v.map(f64::to_bits),
        sample.motor_v.map(f64::to_bits),
        (sample.master_position, sample.slave_position, sample.slave_torque, sample.axes),
    )
}

/// What of a command the law decides, as bits.
fn law_of(command: &MotorCommand) -> impl PartialEq + std::fmt::Debug + use<> {
    (
        command.volts.map(f64::to_bits),
        command.feedforward_v.map(f64::to_bits),
        command.reference_position.map(f64::to_bits),
        command.reference_velocity.map(f64::to_bits),
        command.velocity.map(f64::to_bits),
        (command.mode, command.axes, command.limited, command.ramping, command.lapsed),
    )
}

fn assert_equal(rig: &RigFile, protocol: &str, periods: u64) {
    let (first, cycles) = run_live(rig, protocol, periods);
    let period = rig.rates.acquisition_period_ns();
    // From the rig's clock to the lock-step rig's (ns).
    let shift = |time_ns: u64| time_ns - (first - LOCK_STEP_FIRST_TICK) * period;
    let mut system = LockStepRig::new(rig, &[]).unwrap();
    let mut moved = [0.0_f64; AXES];
    for (at, cycle) in cycles.iter().enumerate() {
        assert_eq!(shift(cycle.sample.scan_time_ns), system.scan_ns(), "cycle {at}");
        let setpoint = cycle.setpoint.map(|setpoint| Setpoint {
            at_ns: shift(setpoint.at_ns),
            lease_until_ns: shift(setpoint.lease_until_ns),
            ..setpoint
        });
        let moment = system.cycle_with(setpoint.as_ref(), cycle.powered).unwrap();
        assert_eq!(machine_of(&moment.sample), machine_of(&cycle.sample), "cycle {at}");
        assert_eq!(law_of(&moment.command), law_of(&cycle.command), "cycle {at}");
        for (moved, position) in moved.iter_mut().zip(moment.sample.slave_position) {
            *moved = moved.max(position.abs());
        }
        assert!(!cycle.powered || moment.sample.motor_power == 1);
    }
    let powered = cycles.iter().filter(|cycle| cycle.powered).count();
    let led = cycles.iter().filter(|cycle| cycle.command.volts != [0.0; AXES]).count();
    let axes = rig.axes.len();
    println!(
        "{} at {} Hz: {} cycles equal, {powered} of them with power, {led} with volts; \
         handle up to {:.1?}°",
        rig.name,
        rig.rates.control_hz,
        cycles.len(),
        &moved.map(f64::to_degrees)[..axes]
    );
    assert!(powered > cycles.len() / 2 && led > cycles.len() / 3);
    assert!(moved[..axes].iter().all(|moved| moved.to_degrees() > 5.0), "{moved:?}");
}

const ONE_AXIS: &str = r#"[protocol]
name = "one"

[[segments]]
kind = "guided_sine"
amplitude_deg = 25.0
frequency_hz = 1.0
duration_s = 2.5
fade_in_s = 0.8

[[segments]]
kind = "steps"
positions_deg = [15.0, 0.0]
rise_s = 0.4
dwell_s = 0.3
"#;

const THREE_AXES: &str = r#"[protocol]
name = "three"

[[segments]]
kind = "guided_sine"
axes = [0, 1, 2]
phases_deg = [0.0, 120.0, 240.0]
amplitude_deg = 20.0
frequency_hz = 1.0
duration_s = 3.0
fade_in_s = 0.5
"#;

/// Also with control at the card's own rate, where every single scan is answered and compared.
#[test]
fn live_and_offline_agree_on_one_axis_at_every_rate() {
    for control_hz in [500, 1000, 2000] {
        let mut rig =
            RigFile::parse(include_str!("../../../launch/rigs/hydrostatic.toml"), "rig.toml")
                .unwrap();
        rig.rates.control_hz = control_hz;
        assert_equal(&rig, ONE_AXIS, 9000);
    }
}

#[test]
fn live_and_offline_agree_on_a_cable() {
    let rig = RigFile::parse(include_str!("../../../launch/rigs/cable.toml"), "rig.toml").unwrap();
    assert_equal(&rig, ONE_AXIS, 9000);
}

#[test]
fn live_and_offline_agree_on_three_axes() {
    let rig =
        RigFile::parse(include_str!("../../../launch/rigs/three-axis.toml"), "rig.toml").unwrap();
    assert_equal(&rig, THREE_AXES, 8000);
}
