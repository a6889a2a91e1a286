//! The setpoint's own limit on the output, and what it holds back.

use control::law::{AUTHORITY_S, Law};
use ipc_types::{Mode, MotorCommand, Setpoint};

use super::{SECOND, axis_law, config, sample, setpoint};

const PERIOD_NS: u64 = 2_000_000;

/// Steps a law in front of a hand at 0 that does not move; the setpoint by cycle.
fn play(
    law: &mut Law,
    from: u64,
    cycles: u64,
    mut aim: impl FnMut(u64) -> Setpoint,
) -> Vec<MotorCommand> {
    (from..from + cycles)
        .map(|cycle| {
            let now = SECOND + cycle * PERIOD_NS;
            law.step(now, &sample(now, 0.0), Some(&aim(now)), true)
        })
        .collect()
}

fn limited(now: u64, mode: Mode, position: f64, limit_v: f64) -> Setpoint {
    let mut setpoint = setpoint(now, mode, [position, 0.0, 0.0, 0.0]);
    setpoint.output_limit_v[0] = limit_v;
    setpoint
}

#[test]
fn sr_22_a_setpoint_narrows_the_limit_and_never_widens_it() {
    // 1.9 rad ask for 5.4 V; the rig allows 5 V.
    for (asked, holds) in
        [(2.0, 2.0), (0.0, 5.0), (-3.0, 5.0), (f64::NAN, 5.0), (50.0, 5.0), (f64::INFINITY, 5.0)]
    {
        for mode in [Mode::Hold, Mode::Position, Mode::Centre, Mode::Learning] {
            let mut law = Law::new(config(axis_law(), 500));
            let commands = play(&mut law, 0, 1500, |now| limited(now, mode, 1.9, asked));
            let most = commands.iter().map(|command| command.volts[0]).fold(0.0, f64::max);
            assert!((most - holds).abs() < 1e-9, "{mode}: asked for {asked} V, got {most} V");
        }
    }
}

#[test]
fn sr_21_the_limit_comes_and_goes_gradually() {
    let mut law = Law::new(config(axis_law(), 500));
    let mut commands = play(&mut law, 0, 1500, |now| limited(now, Mode::Position, 1.9, 0.0));
    commands.extend(play(&mut law, 1500, 100, |now| limited(now, Mode::Position, 1.9, 1.0)));
    assert!((commands[1500 + 99].volts[0] - 1.0).abs() < 1e-9);
    commands.extend(play(&mut law, 1600, 100, |now| limited(now, Mode::Position, 1.9, 0.0)));
    assert!((commands[1699].volts[0] - 5.0).abs() < 1e-9);
    let largest = 5.0 * 2e-3 / AUTHORITY_S + 1e-9;
    for pair in commands[1490..].windows(2) {
        let step = (pair[1].volts[0] - pair[0].volts[0]).abs();
        assert!(step <= largest, "{step} V in a step");
    }
}

#[test]
fn sr_21_against_a_stop_the_reference_does_not_wind_up() {
    let law_of_axis = axis_law();
    let lead = 1.5 / law_of_axis.control.position_gain;
    // Driven at 0.5 rad/s against a stop at 0 for 3 s.
    let drive = |law: &mut Law, mode: Mode| {
        play(law, 0, 1500, |now| {
            let t = (now - SECOND) as f64 * 1e-9;
            let mut setpoint = setpoint(now, mode, [0.5 * t, 0.5, 0.0, 0.5]);
            setpoint.output_limit_v[0] = 1.5;
            setpoint
        })
    };
    let fresh = || Law::new(config(law_of_axis, 500));
    let mut law = fresh();
    let there = drive(&mut law, Mode::Initialise);
    for command in &there {
        assert!(
            command.reference_position[0].abs() <= lead + 1e-9,
            "{}",
            command.reference_position[0]
        );
        assert!(command.volts[0].abs() <= 1.5 + 1e-9);
    }
    assert!((there[1499].volts[0] - 1.5).abs() < 1e-9, "the whole of the limit pushes");
    // Mode hold takes over from the reference that was held back: nothing leaps, and there is no
    // far way to go.
    for command in play(&mut law, 1500, 500, |now| limited(now, Mode::Hold, f64::NAN, 0.0)) {
        assert!(
            command.reference_position[0].abs() <= lead + 0.1,
            "{}",
            command.reference_position[0]
        );
    }
    // Without it the reference is where the setpoint drove it.
    let wound = drive(&mut fresh(), Mode::Position);
    assert!(wound[1499].reference_position[0] > 1.4);
}
