//! A protocol's force field reaches the setpoint whole.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::Arc;

use experiment::player::{Player, Program};
use ipc_types::{AXES, Mode, Setpoint, TABLE};
use rig::RigFile;
use rig::protocol::Protocol;

const FREE: &str = "[protocol]\nname = \"p\"\n[[segments]]\nkind = \"free\"\nduration_s = 5.0\n";

fn rig() -> RigFile {
    RigFile::parse(include_str!("../../../launch/rigs/hydrostatic.toml"), "hydrostatic.toml")
        .unwrap()
}

fn played(lines: &str) -> Setpoint {
    let protocol = Protocol::parse(&format!("{FREE}{lines}"), "p.toml").unwrap();
    let mut player = Player::default();
    player.start(Arc::new(Program::new(&protocol, &rig()).unwrap()), 1);
    let mut setpoint = None;
    for step in 0..3 {
        setpoint = player.step(1_000_000_000 + step * 2_000_000, &[0.1, 0.2, 0.3]).setpoint;
    }
    setpoint.unwrap()
}

#[test]
fn inertia_and_tables() {
    let setpoint = played(
        "inertia = 0.004\nposition_table_deg = [[-40, 0.0], [0, 0.5], [40, -0.5]]\n\
         velocity_table_deg_s = [[-50, 0.1], [100, -0.1]]\n",
    );
    assert_eq!(Mode::from_code(setpoint.mode), Some(Mode::Impedance));
    assert_eq!(setpoint.inertia[0], 0.004);
    assert!((setpoint.table_position_min[0] + 40f64.to_radians()).abs() < 1e-12);
    assert!((setpoint.table_position_max[0] - 40f64.to_radians()).abs() < 1e-12);
    let position = &setpoint.position_table[..TABLE];
    for (point, torque) in [(0, 0.0), (4, 0.25), (8, 0.5), (12, 0.0), (16, -0.5)] {
        assert!((position[point] - torque).abs() < 1e-12, "{position:?}");
    }
    // From minus to plus the highest speed that it names, the ends held.
    assert!((setpoint.table_speed[0] - 100f64.to_radians()).abs() < 1e-12);
    let velocity = &setpoint.velocity_table[..TABLE];
    for (point, torque) in [(0, 0.1), (4, 0.1), (16, -0.1)] {
        assert!((velocity[point] - torque).abs() < 1e-12, "{velocity:?}");
    }
    assert!(
        setpoint.position_table[TABLE..]
            .iter()
            .chain(&setpoint.velocity_table[TABLE..])
            .all(|torque| *torque == 0.0)
    );
}

#[test]
fn a_matrix_with_its_centre() {
    let setpoint = played(
        "matrix_stiffness = [[0.5]]\nmatrix_damping = [[0.1]]\nmatrix_inertia = [[0.001]]\n\
         centres_deg = [10.0]\n",
    );
    assert_eq!(
        (setpoint.stiffness[0], setpoint.damping[0], setpoint.inertia[0]),
        (0.5, 0.1, 0.001)
    );
    assert!((setpoint.position[0] - 10f64.to_radians()).abs() < 1e-12);
    assert!(setpoint.stiffness[1..AXES * AXES].iter().all(|entry| *entry == 0.0));
}

#[test]
fn a_field_that_the_rig_does_not_bear_is_not_played() {
    let protocol = Protocol::parse(&format!("{FREE}damper = 1.5\n"), "p.toml").unwrap();
    let error = Program::new(&protocol, &rig()).unwrap_err();
    assert_eq!(error.problems()[0].key, "segments.0.damper");
}
