//! Two and three axes in lock step: each goes where it shall, feels the others through the handle
//! alone, and a force field may act across.
#![allow(clippy::unwrap_used)]

use ipc_types::Mode;
use lock_step::{Aim, CycleResult, LockStepRig};
use rig::{HandKind, RigFile};

const TWO: &str = include_str!("../../../launch/rigs/two-axis.toml");
const THREE: &str = include_str!("../../../launch/rigs/three-axis.toml");
const ONE: &str = include_str!("../../../launch/rigs/hydrostatic.toml");

fn rig(text: &str) -> RigFile {
    RigFile::parse(text, "rig.toml").unwrap()
}

/// What the cycles of a movement show, an aim an axis.
fn play(rig: &RigFile, seconds: f64, aims: impl Fn(f64) -> Vec<Aim>) -> Vec<CycleResult> {
    let mut system = LockStepRig::new(rig, &[]).unwrap();
    let mut moments = Vec::new();
    while system.time_s() < seconds {
        let setpoint = system.setpoint_of(&aims(system.time_s()));
        moments.push(system.cycle(&setpoint).unwrap());
    }
    moments
}

/// Root mean square of master against reference on an axis, without the ramp at the beginning (°).
fn error_deg(moments: &[CycleResult], axis: usize) -> f64 {
    let settled: Vec<_> = moments.iter().filter(|moment| moment.time_s > 2.0).collect();
    let squares: f64 = settled
        .iter()
        .map(|m| (m.command.reference_position[axis] - m.sample.master_position[axis]).powi(2))
        .sum();
    (squares / settled.len() as f64).sqrt().to_degrees()
}

fn span_deg(moments: &[CycleResult], axis: usize) -> f64 {
    let positions = moments
        .iter()
        .filter(|m| m.time_s > 2.0)
        .map(|m| m.motions[axis].slave_position_rad.to_degrees());
    positions.clone().fold(f64::MIN, f64::max) - positions.fold(f64::MAX, f64::min)
}

#[test]
fn three_axes_follow_each_its_own_movement() {
    let amplitudes = [20.0_f64, 25.0, 30.0];
    let aims = |t: f64| {
        let sine = |axis: usize| Aim::sine(amplitudes[axis].to_radians(), [0.5, 1.0, 0.7][axis], t);
        (0..3).map(sine).collect::<Vec<_>>()
    };
    let moments = play(&rig(THREE), 6.0, aims);
    let mut single = rig(ONE);
    single.rates.control_hz = 1000;
    for (axis, amplitude) in amplitudes.into_iter().enumerate() {
        let (error, span) = (error_deg(&moments, axis), span_deg(&moments, axis));
        let alone = play(&single, 6.0, |t| aims(t)[axis..=axis].to_vec());
        let (alone_error, alone_span) = (error_deg(&alone, 0), span_deg(&alone, 0));
        println!(
            "axis {axis}: {error:.2}° rms of ±{}°, the handle spans {span:.1}°; \
             alone {alone_error:.2}°, {alone_span:.1}°",
            amplitude
        );
        assert!(
            (error / alone_error - 1.0).abs() < 0.25,
            "axis {axis}: {error}° against {alone_error}°"
        );
        assert!(
            (span / alone_span - 1.0).abs() < 0.25 && span > 0.5 * amplitude,
            "axis {axis}: {span}° against {alone_span}°"
        );
    }
    let sample = moments.last().unwrap().sample;
    let present = (
        sample.axes,
        sample.master_present,
        sample.slave_present,
        sample.torque_present,
        sample.motor_present,
    );
    assert_eq!(present, (3, 7, 7, 7, 7));
    // Each torque cell reads its own hand.
    for axis in 0..3 {
        let hand = rig(THREE).simulation.hand;
        let motion = moments.last().unwrap().motions[axis];
        let torque = hand.torque(motion.slave_position_rad, motion.slave_velocity_rad_s, 0.0);
        assert!(
            (sample.slave_torque[axis] - torque).abs() < 0.05,
            "axis {axis}: {} {torque}",
            sample.slave_torque[axis]
        );
    }
}

/// The first of two uncoupled axes does what the only one of a rig does, bit for bit, as far as the
/// noise is the same.
#[test]
fn an_axis_of_several_is_the_axis_of_one() {
    let quiet = |text: &str| {
        let mut rig = rig(text);
        rig.simulation.encoder_noise_counts = 0.0;
        rig.rates.control_hz = 1000;
        rig.model.handle_coupling.clear();
        rig
    };
    let aims = |t: f64| vec![Aim::sine(0.4, 1.0, t), Aim::sine(0.3, 1.3, t)];
    let (one, two) =
        (play(&quiet(ONE), 2.0, |t| aims(t)[..1].to_vec()), play(&quiet(TWO), 2.0, aims));
    assert!(one.iter().zip(&two).all(|(one, two)| {
        one.sample.master_counts[0] == two.sample.master_counts[0]
            && one.sample.slave_counts[0] == two.sample.slave_counts[0]
            && one.command.volts[0] == two.command.volts[0]
    }));
    assert!(two.iter().any(|moment| moment.command.volts[1].abs() > 1.0));
    assert!(one.iter().all(
        |moment| moment.command.volts[1..] == [0.0, 0.0] && moment.sample.master_counts[1] == 0
    ));
}

/// The second of two moving axes feels the first one's acceleration through the handle, and through
/// nothing else. (One that rests is held by its friction: 2.3 N·m against the tenth of one that the
/// handle makes of 2 Hz.)
#[test]
fn the_handle_couples_the_axes() {
    let second = |pairs: Vec<f64>, first_rad: f64| {
        let mut rig = rig(TWO);
        rig.simulation.encoder_noise_counts = 0.0;
        rig.model.handle_coupling = pairs;
        let aims = |t: f64| vec![Aim::sine(first_rad, 2.0, t), Aim::sine(0.4, 1.0, t)];
        play(&rig, 4.0, aims)
            .iter()
            .map(|moment| moment.motions[1].slave_position_rad)
            .collect::<Vec<_>>()
    };
    let apart_deg = |one: &[f64], two: &[f64]| {
        one.iter().zip(two).map(|(one, two)| (one - two).abs()).fold(0.0, f64::max).to_degrees()
    };
    let none = apart_deg(&second(Vec::new(), 0.4), &second(Vec::new(), 0.0));
    let strong = apart_deg(&second(vec![1.5e-3], 0.4), &second(vec![1.5e-3], 0.0));
    println!(
        "the first axis's movement shows in the second's by {none:.4}° \
         without coupling, {strong:.4}° with 1.5e-3 kg·m²"
    );
    assert_eq!(none, 0.0);
    assert!(strong > 0.02, "{strong}");
}

/// A curl field: damping across the axes. The hand moves both axes along one line; the field turns
/// speed into torque on the other axis, so the movement bends to the side that the sign says.
#[test]
fn a_curl_field_acts_across() {
    let curl = |strength: f64| {
        let mut rig = rig(TWO);
        rig.simulation.hand.kind = HandKind::Moving;
        rig.simulation.hand.stiffness = 8.0;
        rig.simulation.hand.damping = 0.4;
        rig.simulation.hand.amplitude = 0.5;
        let mut system = LockStepRig::new(&rig, &[]).unwrap();
        let mut area = 0.0;
        let mut before: Option<CycleResult> = None;
        while system.time_s() < 6.0 {
            let mut setpoint = system.setpoint(&Aim::at_rest(0.0));
            setpoint.mode = Mode::Impedance.code();
            // torque = - damping velocity, row by row
            setpoint.damping[1] = strength;
            setpoint.damping[3] = -strength;
            let moment = system.cycle(&setpoint).unwrap();
            if let Some(before) = before.filter(|before| before.time_s > 2.0) {
                let at =
                    |moment: &CycleResult, axis: usize| moment.motions[axis].slave_position_rad;
                let (dx, dy) = (at(&moment, 0) - at(&before, 0), at(&moment, 1) - at(&before, 1));
                area += 0.5 * (at(&before, 0) * dy - at(&before, 1) * dx);
            }
            before = Some(moment);
        }
        area
    };
    let (left, none, right) = (curl(0.15), curl(0.0), curl(-0.15));
    println!("area that the handle goes round in 4 s: {left:.4}, {none:.4}, {right:.4} rad²");
    assert!(left * right < 0.0 && left.abs() > 5.0 * none.abs() && right.abs() > 5.0 * none.abs());
}
