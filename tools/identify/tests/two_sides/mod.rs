//! Records of a hydrostatic rig that is not quite as declared, made by the plant itself.
#![allow(dead_code, reason = "each test file uses its part")]

use std::f64::consts::TAU;

use identify::input::Series;
use identify::prediction_error::record::Record;
use plant::effects::Effect;
use plant::transmission::{Input, Motion, Transmission as _};
use plant::transmission_kinds;
use rig::RigFile;

/// From a row to the next (s).
pub(crate) const STEP_S: f64 = 1e-3;
/// A count of both encoders (rad).
pub(crate) const COUNT_RAD: f64 = TAU / 4000.0;

/// The rig as declared.
pub(crate) fn rig() -> RigFile {
    RigFile::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml"))
        .unwrap()
}

/// From the beginning of a record to that of the next (s).
pub(crate) const RECORD_S: f64 = 10.0;

/// Reproducible noise, uniform from -0.5 to 0.5.
pub(crate) fn uniform_noise(mut state: u64) -> impl FnMut() -> f64 {
    move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    }
}

/// The volts of a position servo at the master.
pub(crate) fn servo_v(reference_rad: f64, motion: &Motion) -> f64 {
    let volts =
        7.0 * (reference_rad - motion.master_position_rad) - 0.4 * motion.master_velocity_rad_s;
    volts.clamp(-8.0, 8.0)
}

/// The rig in closed loop along some sines, its torque constant and friction off the declared ones;
/// a hand pushes where `hand` says, and something at the motor, slowly and at random, with so many
/// volts. The cell shows the hand's torque and what `cell` says, by the time since the record
/// began.
pub(crate) fn record(
    turn: usize,
    effects: Vec<Box<dyn Effect>>,
    hand: bool,
    push_v: f64,
    cell: &dyn Fn(f64) -> f64,
) -> Record {
    let declared = rig().model.transmission("").unwrap();
    let transmission_kinds::Parameters::Hydrostatic(mut own) = declared else {
        panic!("a hydrostatic rig")
    };
    own.motor_torque_per_volt_nm *= 0.9;
    own.slave_static_friction_nm *= 1.1;
    own.slave_kinetic_friction_nm *= 0.9;
    own.motor_coulomb_nm *= 1.08;
    own.line_stiffness_factor *= 0.88;
    let mut plant = transmission_kinds::Parameters::from(own).plant(effects).unwrap();
    let start_s = RECORD_S * turn as f64;
    plant.set_time(start_s);
    // The fourth record repeats the first: without a repeat nobody knows what a model may leave.
    let phase = 0.7 + 1.9 * (turn % 3) as f64;
    let mut random = uniform_noise(17 + turn as u64);
    let mut push = 0.0;
    let rows = 4000;
    let mut columns: [Vec<f64>; 5] = std::array::from_fn(|_| Vec::with_capacity(rows));
    for row in 0..rows {
        let t = row as f64 * STEP_S;
        let rise = (t / 0.5).min(1.0);
        let reference = rise
            * (0.45 * (TAU * 0.6 * t + phase).sin()
                + 0.25 * (TAU * 1.7 * t + 2.0 * phase).sin()
                + 0.06 * (TAU * 5.3 * t).sin());
        let motion = plant.motion();
        let volts = servo_v(reference, &motion);
        let torque = if hand { 2.0 * rise * (TAU * 0.9 * t + phase).sin() } else { 0.0 };
        let counts = |position: f64| (position / COUNT_RAD).round() * COUNT_RAD;
        let values = [
            start_s + t,
            volts,
            counts(motion.master_position_rad),
            counts(motion.slave_position_rad),
            torque + cell(t) + 4e-3 * random(),
        ];
        columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
        push = 0.99 * push + push_v * random();
        plant.step(Input { motor_v: volts + push, hand_torque_nm: torque }, STEP_S);
    }
    let names = ["t_s", "motor_v", "master_rad", "slave_rad", "slave_torque_nm"];
    let columns = names.into_iter().map(str::to_owned).zip(columns).collect();
    let series =
        Series { file: format!("record-{turn}.csv"), columns, role: None, notes: Vec::new() };
    Record::new(&series, 1.0, &[], &mut Vec::new()).unwrap()
}
