//! The control law: closed forms, continuity, limits, symmetry.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod force;
mod homing;
mod limit;
mod options;
mod properties;

use control::law::{AUTHORITY_S, AxisLaw, Law, LawConfig};
use ipc_types::{AXES, Mode, MotorCommand, Sample, Setpoint};
use rig::{AxisControl, Feedforward, ForceControl, Limits};

const SECOND: u64 = 1_000_000_000;
const COUNTS: f64 = 4000.0 / std::f64::consts::TAU;

/// The thesis's gains, which § 4.1 prints in encoder counts (V/count, V·s/count); 4,000 counts per
/// turn.
fn axis_law() -> AxisLaw {
    let control = AxisControl {
        position_gain: 4.5e-3 * COUNTS,
        velocity_gain: 7e-4 * COUNTS,
        velocity_filter_hz: 30.0,
        output_limit_v: 5.0,
        feedforward: Feedforward { friction_peak_v: 1.5, friction_floor_v: 0.6, inertia_v: 0.011 },
        ramp_s: 0.5,
        force: Some(force_control()),
        ..AxisControl::default()
    };
    let limits =
        Limits { position_min: -2.0, position_max: 2.0, speed_max: 10.0, ..Limits::default() };
    AxisLaw { control, limits, movement_range: (-2.0, 2.0), search: None, model: None }
}

/// Eq. 4.2.1 to 4.2.3, with a torque cell of 0.5 V/(N·m).
fn force_control() -> ForceControl {
    ForceControl {
        volts_per_torque: 0.5,
        torque_gain: 0.333,
        forgetting: 0.4,
        offset_slow_v: 1.5,
        offset_fast_v: 1.2,
        threshold_speed: 1000.0 / COUNTS,
        offset_slope: 1.11e-4 * COUNTS,
        torque_threshold_v: 0.02,
        end_stop_stiffness: 10.0,
        end_stop_way: 0.1,
    }
}

fn config(law: AxisLaw, rate: u64) -> LawConfig {
    LawConfig { axes: 1, axis: [law; AXES], period_s: 1.0 / rate as f64 }
}

fn sample(time_ns: u64, position: f64) -> Sample {
    let mut sample = Sample {
        scan_time_ns: time_ns,
        time_ns,
        tick: time_ns,
        master_present: 1,
        torque_present: 1,
        axes: 1,
        homed: 1,
        ..Sample::default()
    };
    sample.master_position[0] = position;
    sample
}

fn setpoint(
    time_ns: u64,
    mode: Mode,
    [position, velocity, acceleration, peak]: [f64; 4],
) -> Setpoint {
    let mut setpoint = Setpoint {
        incarnation: 61,
        at_ns: time_ns,
        lease_until_ns: time_ns + SECOND / 10,
        mode: mode.code(),
        axes: 1,
        ..Setpoint::default()
    };
    setpoint.position[0] = position;
    setpoint.velocity[0] = velocity;
    setpoint.acceleration[0] = acceleration;
    setpoint.peak_speed[0] = peak;
    setpoint
}

/// A sine of 1 rad and `hertz`, as the experiment would send it for `time_ns`.
fn sine(time_ns: u64, hertz: f64) -> [f64; 4] {
    let omega = std::f64::consts::TAU * hertz;
    let phase = omega * time_ns as f64 * 1e-9;
    [phase.sin(), omega * phase.cos(), -omega * omega * phase.sin(), omega]
}

/// A mass on which volts act through `inertia_v`, with dry friction (V); exact between two
/// commands.
#[derive(Clone, Copy, Default)]
struct Mass {
    position: f64,
    velocity: f64,
    friction_v: f64,
}

impl Mass {
    fn advance(&mut self, volts: f64, inertia_v: f64, seconds: f64) {
        const STEPS: u32 = 20;
        let step = seconds / f64::from(STEPS);
        for _ in 0..STEPS {
            let before = self.velocity;
            let mut after = before + volts / inertia_v * step;
            // Friction takes away what it can, and never turns the motion round.
            let friction = self.friction_v / inertia_v * step;
            after -= after.clamp(-friction, friction);
            self.position += 0.5 * (before + after) * step;
            self.velocity = after;
        }
    }
}

/// Runs the law on a mass at `rate` for `seconds`; calls `look` with each command.
fn closed_loop(
    law: AxisLaw,
    rate: u64,
    seconds: f64,
    mass: &mut Mass,
    mut aim: impl FnMut(u64) -> Option<Setpoint>,
    mut look: impl FnMut(u64, &mut Mass, &MotorCommand),
) {
    let mut controller = Law::new(config(law, rate));
    for cycle in 0..(seconds * rate as f64) as u64 {
        let now = SECOND + cycle * SECOND / rate;
        let command = controller.step(now, &sample(now, mass.position), aim(now).as_ref(), true);
        look(now, mass, &command);
        mass.advance(command.volts[0], law.control.feedforward.inertia_v, 1.0 / rate as f64);
    }
}

#[test]
fn gains_per_count_are_those_of_the_thesis() {
    let law = axis_law();
    assert!(
        (law.control.position_gain - 2.8648).abs() < 1e-4
            && (law.control.velocity_gain - 0.44563).abs() < 1e-5
    );
}

/// A mass that is pushed while it is held: `inertia_v x'' + D x' + P x = 0`, x(0) = 0, x'(0) = v.
/// Held against the closed form, with an error that falls in proportion to the period.
#[test]
fn feedback_on_a_pure_inertia_has_the_closed_form() {
    let mut law = axis_law();
    (law.control.velocity_gain, law.control.velocity_filter_hz) = (0.1, 1e6);
    let damping = law.control.velocity_gain / (2.0 * law.control.feedforward.inertia_v);
    let omega =
        (law.control.position_gain / law.control.feedforward.inertia_v - damping * damping).sqrt();
    let mut errors = vec![];
    for rate in [1_000, 2_000, 4_000] {
        let mut mass = Mass::default();
        let mut error = 0.0f64;
        let push = 2 * SECOND;
        closed_loop(
            law,
            rate,
            2.0,
            &mut mass,
            |_| None,
            |now, mass, _| {
                if now == push {
                    mass.velocity = 1.0;
                }
                if now >= push {
                    let t = (now - push) as f64 * 1e-9;
                    error = error.max(
                        (mass.position - (-damping * t).exp() * (omega * t).sin() / omega).abs()
                            * omega,
                    );
                }
            },
        );
        errors.push(error);
    }
    assert!(errors[0] < 0.05, "{errors:?}");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((0.8..1.4).contains(&order), "observed order {order}: {errors:?}");
    }
}

#[test]
fn feedforward_of_a_sine_is_the_curve_of_fig_4_3_a() {
    let law = axis_law();
    let mut controller = Law::new(config(law, 500));
    for cycle in 0..2_000u64 {
        let now = SECOND + cycle * 2_000_000;
        let aim = sine(now, 1.0);
        let command = controller.step(
            now,
            &sample(now, aim[0]),
            Some(&setpoint(now, Mode::Position, aim)),
            true,
        );
        // Once on the target, and away from the reversals that are smoothed.
        if cycle > 1_000 && aim[1].abs() > 0.3 * aim[3] {
            let phase = (aim[1].abs() / aim[3]).asin() * 2.0 / std::f64::consts::PI;
            let triangle = (1.5 - 0.9 * phase).copysign(aim[1]);
            let expected = triangle + law.control.feedforward.inertia_v * aim[2];
            assert!(
                (command.feedforward_v[0] - expected).abs() < 0.01,
                "{} {expected}",
                command.feedforward_v[0]
            );
            assert_eq!((command.ramping, command.lapsed), (0, 0));
            assert!((command.reference_position[0] - aim[0]).abs() < 1e-9);
        }
    }
}

#[test]
fn feedforward_makes_a_mass_with_friction_follow_better() {
    let rms = |law: AxisLaw| {
        let mut mass = Mass { friction_v: 1.0, position: sine(SECOND, 1.0)[0], ..Mass::default() };
        let (mut sum, mut count) = (0.0, 0.0);
        closed_loop(
            law,
            500,
            5.0,
            &mut mass,
            |now| Some(setpoint(now, Mode::Position, sine(now, 1.0))),
            |now, mass, _| {
                if now > 3 * SECOND {
                    sum += (mass.position - sine(now, 1.0)[0]).powi(2);
                    count += 1.0;
                }
            },
        );
        f64::sqrt(sum / count)
    };
    let with = rms(axis_law());
    let mut law = axis_law();
    law.control.feedforward =
        Feedforward { friction_peak_v: 0.0, friction_floor_v: 0.0, inertia_v: 0.011 };
    let without = rms(law);
    assert!(with < 0.5 * without, "with {with} rad, without {without} rad");
    assert!(with < 0.12, "{with} rad");
}

#[test]
fn the_rate_of_the_loop_changes_little() {
    let path = |rate: u64| {
        let mut mass = Mass { friction_v: 0.5, ..Mass::default() };
        let mut positions = vec![];
        closed_loop(
            axis_law(),
            rate,
            3.0,
            &mut mass,
            |now| Some(setpoint(now, Mode::Position, sine(now, 1.0))),
            |now, mass, _| {
                if (now - SECOND).is_multiple_of(10_000_000) {
                    positions.push(mass.position);
                }
            },
        );
        positions
    };
    let (slow, fast) = (path(500), path(1_000));
    assert_eq!(slow.len(), fast.len());
    let worst = slow.iter().zip(&fast).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 0.02, "{worst} rad apart");
}

#[test]
fn sr_21_without_power_it_follows_the_hand_at_0_v() {
    let mut controller = Law::new(config(axis_law(), 500));
    for cycle in 0..500u64 {
        let now = SECOND + cycle * 2_000_000;
        let position = (cycle as f64 * 0.01).sin();
        let aim = setpoint(now, Mode::Position, [1.5, 0.0, 0.0, 0.0]);
        let command = controller.step(now, &sample(now, position), Some(&aim), false);
        assert_eq!((command.volts, command.reference_position[0]), ([0.0; AXES], position));
        assert_eq!(command.mode, Mode::Passive.code());
    }
}

#[test]
fn sr_21_power_comes_without_a_bump_and_the_reference_catches_up_no_faster_than_allowed() {
    // The hand is held: all that changes the output is the law itself.
    let mut controller = Law::new(config(axis_law(), 500));
    let bound = controller.step_bound_v(0, 2e-3);
    let mut last: Option<MotorCommand> = None;
    let mut peak = 0.0f64;
    for cycle in 0..2_000u64 {
        let now = SECOND + cycle * 2_000_000;
        let aim = setpoint(now, Mode::Position, [1.5, 0.0, 0.0, 0.0]);
        let command = controller.step(now, &sample(now, -1.0), Some(&aim), true);
        if let Some(last) = last {
            assert!(
                (command.volts[0] - last.volts[0]).abs() <= bound + 2e-3 * 20.0,
                "cycle {cycle}"
            );
        } else {
            assert!(command.volts[0].abs() < 1e-9, "first step: {} V", command.volts[0]);
        }
        peak = peak.max(command.reference_velocity[0].abs());
        assert_eq!(
            command.ramping == 1,
            command.reference_position[0] < 1.5 - 1e-9,
            "cycle {cycle}"
        );
        last = Some(command);
    }
    assert!(peak <= 2.0 && peak > 1.9, "{peak} rad/s");
    assert!((last.unwrap().reference_position[0] - 1.5).abs() < 1e-12);
}

#[test]
fn sr_23_comes_to_rest_and_holds_when_the_lease_lapses() {
    let mut controller = Law::new(config(axis_law(), 500));
    let mut begin = 0.0;
    let mut last_lapsed = 0;
    let mut aim = Setpoint::default();
    let mut rest = 0.0;
    for cycle in 0..2_000u64 {
        let now = SECOND + cycle * 2_000_000;
        if cycle < 1_000 {
            aim = setpoint(now, Mode::Position, sine(now, 1.0));
        }
        let command = controller.step(now, &sample(now, 0.0), Some(&aim), true);
        if command.lapsed == 1 && last_lapsed == 0 {
            assert!(now > aim.lease_until_ns);
            begin = command.reference_position[0];
            assert!(command.reference_velocity[0] > 2.0, "it moves when its lease lapses");
        }
        last_lapsed = command.lapsed;
        if cycle == 1_500 {
            rest = command.reference_position[0];
        }
        if cycle >= 1_500 {
            assert_eq!((command.reference_position[0], command.reference_velocity[0]), (rest, 0.0));
            assert_eq!((command.lapsed, command.ramping), (1, 0));
        }
    }
    // Half of 2π rad/s for 0.25 s, and never backwards.
    assert!(rest > begin && rest < begin + 0.8, "from {begin} to {rest}");
}

#[test]
fn sr_23_a_movement_is_not_extrapolated_for_ever_however_long_its_lease() {
    let mut controller = Law::new(config(axis_law(), 500));
    let mut aim = setpoint(SECOND, Mode::Position, [0.0, 1.0, 0.0, 1.0]);
    aim.lease_until_ns = u64::MAX;
    for cycle in 0..1_000u64 {
        let now = SECOND + cycle * 2_000_000;
        let command = controller.step(now, &sample(now, 0.0), Some(&aim), true);
        assert_eq!(command.lapsed == 1, cycle > 50, "cycle {cycle}");
        assert!(command.reference_position[0] < 0.3);
    }
}

#[test]
fn sr_23_without_a_setpoint_it_holds_the_place_where_power_came() {
    let mut controller = Law::new(config(axis_law(), 500));
    controller.step(SECOND, &sample(SECOND, 0.3), None, true);
    for cycle in 1..500u64 {
        let now = SECOND + cycle * 2_000_000;
        let command = controller.step(now, &sample(now, 0.3 + 0.1), None, true);
        assert_eq!(
            (command.reference_position[0], command.mode, command.lapsed),
            (0.3, Mode::Hold.code(), 0)
        );
        if cycle > 200 {
            assert!((command.volts[0] + 0.1 * axis_law().control.position_gain).abs() < 1e-3);
        }
    }
}

#[test]
fn hold_goes_to_its_position_and_without_one_stays() {
    for (position, expected) in [(0.8, 0.8), (f64::NAN, 0.2)] {
        let mut controller = Law::new(config(axis_law(), 500));
        let mut command = MotorCommand::default();
        for cycle in 0..1_000u64 {
            let now = SECOND + cycle * 2_000_000;
            let aim = setpoint(now, Mode::Hold, [position, f64::NAN, f64::NAN, 0.0]);
            command = controller.step(now, &sample(now, 0.2), Some(&aim), true);
        }
        assert!((command.reference_position[0] - expected).abs() < 1e-12);
        assert_eq!((command.mode, command.lapsed), (Mode::Hold.code(), 0));
    }
}

#[test]
fn sr_23_passive_ramps_to_0_v_and_then_follows_the_hand() {
    let mut controller = Law::new(config(axis_law(), 500));
    let mut before = 0.0;
    let mut last = 0.0;
    for cycle in 0..700u64 {
        let now = SECOND + cycle * 2_000_000;
        let mode = if cycle < 600 { Mode::Hold } else { Mode::Passive };
        let aim = setpoint(now, mode, [1.0, 0.0, 0.0, 0.0]);
        let command = controller.step(now, &sample(now, 0.0), Some(&aim), true);
        if cycle == 599 {
            before = command.volts[0];
            assert!(before > 2.0);
        }
        if cycle >= 600 {
            assert!(
                (command.volts[0] - last).abs() <= before * 2e-3 / AUTHORITY_S + 1e-9,
                "cycle {cycle}"
            );
            assert_eq!(command.mode, Mode::Passive.code());
        }
        if cycle > 600 + 26 {
            assert_eq!((command.volts[0], command.reference_position[0]), (0.0, 0.0));
        }
        last = command.volts[0];
    }
}

#[test]
fn sr_22_the_output_limit_acts_and_says_so() {
    let mut controller = Law::new(config(axis_law(), 500));
    let mut command = MotorCommand::default();
    for cycle in 0..2_000u64 {
        let now = SECOND + cycle * 2_000_000;
        let aim = setpoint(now, Mode::Position, [2.0, 0.0, 0.0, 0.0]);
        command = controller.step(now, &sample(now, -1.9), Some(&aim), true);
    }
    assert_eq!((command.volts[0], command.limited), (5.0, 1));
}

#[test]
fn sr_22_a_sensor_that_fails_gives_0_v_at_once_and_recovers_without_a_bump() {
    for absent in [true, false] {
        let mut controller = Law::new(config(axis_law(), 500));
        let bound = controller.step_bound_v(0, 2e-3);
        let mut last = 0.0;
        for cycle in 0..1_000u64 {
            let now = SECOND + cycle * 2_000_000;
            let mut sample = sample(now, 0.0);
            let fails = (300..310).contains(&cycle);
            match (fails, absent) {
                (true, true) => sample.master_present = 0,
                (true, false) => sample.master_position[0] = f64::NAN,
                _ => {}
            }
            let aim = setpoint(now, Mode::Hold, [1.0, 0.0, 0.0, 0.0]);
            let command = controller.step(now, &sample, Some(&aim), true);
            if fails {
                assert_eq!(
                    (command.volts, command.limited, command.mode),
                    ([0.0; AXES], 1, Mode::Passive.code())
                );
            } else {
                assert!((command.volts[0] - last).abs() <= bound + 0.05, "cycle {cycle}");
            }
            last = command.volts[0];
        }
        assert!(last > 2.0);
    }
}

#[test]
fn a_repeated_sample_and_a_skipped_cycle_are_no_event() {
    let mut controller = Law::new(config(axis_law(), 500));
    let mut command = MotorCommand::default();
    let mut now = SECOND;
    for cycle in 0..2_000u64 {
        now = SECOND + cycle * 2_000_000;
        // Every fifth cycle is skipped; every third reads the sample of the cycle before.
        if cycle % 5 == 0 {
            continue;
        }
        let scan = if cycle % 3 == 0 { now - 2_000_000 } else { now };
        let aim = sine(scan, 1.0);
        let setpoint = setpoint(now, Mode::Position, sine(now, 1.0));
        command = controller.step(now, &sample(scan, aim[0]), Some(&setpoint), true);
        if cycle > 1_000 {
            assert!((command.reference_position[0] - aim[0]).abs() < 2e-4, "cycle {cycle}");
            assert!((command.velocity[0] - aim[1]).abs() < 0.4, "cycle {cycle}");
            assert_eq!(command.ramping, 0, "cycle {cycle}");
        }
    }
    assert_eq!(command.computed_ns, now);
}
