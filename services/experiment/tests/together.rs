//! A protocol that moves several axes at once.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::Arc;

use experiment::player::{Player, Program};
use ipc_types::{AXES, Setpoint};
use rig::RigFile;
use rig::protocol::Protocol;

const MS: u64 = 1_000_000;
const RIG: &str = include_str!("../../../launch/rigs/three-axis.toml");

/// The setpoints of a protocol, each millisecond, with a handle that follows perfectly.
fn play(text: &str) -> Vec<Setpoint> {
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    let protocol = Protocol::parse(text, "test.toml").unwrap_or_else(|error| panic!("{error}"));
    let mut player = Player::default();
    player.start(
        Arc::new(Program::new(&protocol, &rig).unwrap_or_else(|error| panic!("{error}"))),
        1,
    );
    let mut measured = [0.0; AXES];
    let mut setpoints = Vec::new();
    let duration = (protocol.duration_s() * 1e3) as u64 + 400;
    for now in (0..duration).map(|ms| ms * MS) {
        let setpoint = player.step(now, &measured).setpoint.unwrap();
        measured = setpoint.position;
        setpoints.push(setpoint);
    }
    setpoints
}

#[test]
fn two_axes_a_quarter_period_apart_go_round_in_a_circle() {
    let setpoints = play(
        "[protocol]\nname = \"circle\"\n\
         [[segments]]\nkind = \"guided_sine\"\naxes = [0, 2]\nphases_deg = [0.0, 90.0]\n\
         amplitude_deg = 20.0\nfrequency_hz = 0.5\nduration_s = 8.0\nfade_in_s = 1.0\n",
    );
    let radius = 20.0_f64.to_radians();
    let speed = radius * std::f64::consts::TAU * 0.5;
    for setpoint in &setpoints[1100..6900] {
        let [x, none, y] = setpoint.position;
        let [vx, _, vy] = setpoint.velocity;
        assert!(
            (x.hypot(y) / radius - 1.0).abs() < 1e-9 && (vx.hypot(vy) / speed - 1.0).abs() < 1e-9,
            "{setpoint:?}"
        );
        assert_eq!((none, setpoint.axes), (0.0, 3));
        assert!(
            (setpoint.peak_speed[0] / speed - 1.0).abs() < 0.03
                && (setpoint.peak_speed[2] / speed - 1.0).abs() < 0.03
        );
    }
    // No jump at either end, on no axis.
    for pair in setpoints.windows(2) {
        for axis in 0..AXES {
            assert!(
                (pair[1].position[axis] - pair[0].position[axis]).abs()
                    < 1e-3 * 2.0 * (speed + 2.0 * radius)
            );
        }
    }
    assert_eq!(setpoints[8300].position, [0.0; AXES]);
}

#[test]
fn each_goes_on_from_where_it_came_to_rest() {
    let setpoints = play(
        "[protocol]\nname = \"steps\"\n\
         [[segments]]\nkind = \"steps\"\naxes = [1, 0]\nscales = [1.0, -0.5]\n\
         positions_deg = [10.0]\nrise_s = 0.5\ndwell_s = 0.5\n\
         [[segments]]\nkind = \"hold\"\naxis = 2\nposition_deg = 8.0\n\
         rise_s = 0.5\nduration_s = 1.0\n",
    );
    let at = |ms: usize| setpoints[ms].position.map(|rad| (rad.to_degrees() * 1e6).round() / 1e6);
    assert_eq!(at(900), [-5.0, 10.0, 0.0]);
    assert_eq!(at(1900), [-5.0, 10.0, 8.0]);
}

#[test]
fn a_field_acts_on_every_axis_that_is_named() {
    let setpoints = play(
        "[protocol]\nname = \"free\"\n\
         [[segments]]\nkind = \"free\"\naxes = [0, 2]\nspring = 2.0\nduration_s = 1.0\n",
    );
    let stiffness = setpoints[500].stiffness;
    assert_eq!([stiffness[0], stiffness[4], stiffness[8]], [2.0, 0.0, 2.0]);
}
