//! Force control: eq. 4.2.1 to 4.2.3, fields, and what happens where they meet the law.

use control::law::field::{Handle, field_torque};
use control::law::force_law::{end_stop_torque, offset_v, settled_v, step};
use control::law::{AUTHORITY_S, AxisLaw, Law};
use ipc_types::{AXES, Mode, MotorCommand, Setpoint, TABLE};

use super::{COUNTS, SECOND, axis_law, config, force_control, sample, setpoint, sine};

fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-12, "found {found}, expected {expected}");
}

#[test]
fn offset_is_that_of_eq_4_2_3() {
    let gains = force_control();
    // counts/s and V
    for (speed, volts) in
        [(0.0, 1.5), (999.0, 1.5), (1000.0, 1.2), (2000.0, 1.2 - 0.111), (11_000.0, 1.2 - 1.11)]
    {
        close(offset_v(&gains, speed / COUNTS), volts);
        close(offset_v(&gains, -speed / COUNTS), volts);
    }
    // The printed line goes below zero at 11,811 counts/s, and would brake.
    assert_eq!(offset_v(&gains, 20_000.0 / COUNTS), 0.0);
}

#[test]
fn settles_at_eq_4_2_2_in_the_direction_of_the_torque() {
    let gains = force_control();
    for velocity in [-1.0, 1.0] {
        close(settled_v(&gains, 2.0, velocity), 0.333 + 1.5);
        close(settled_v(&gains, -2.0, velocity), -0.333 - 1.5);
    }
    assert_eq!(settled_v(&gains, 0.0, 0.0), 0.0, "no torque, no offset");
    // Within the threshold of 0.02 V, 0.04 N·m, in proportion.
    close(settled_v(&gains, 0.02, 0.0), 0.333 * 0.01 + 0.75);
}

#[test]
fn forgets_as_eq_4_2_1_whatever_the_rate() {
    let gains = force_control();
    let wanted = settled_v(&gains, 2.0, 0.0);
    let once = step(&gains, 0.7, 2.0, 0.0, 2e-3, 5.0);
    close(once, 0.6 * 0.7 + 0.4 * wanted);
    let twice = step(&gains, step(&gains, 0.7, 2.0, 0.0, 1e-3, 5.0), 2.0, 0.0, 1e-3, 5.0);
    close(twice, once);
    assert_eq!(step(&gains, 0.0, 1e9, 0.0, 1.0, 5.0), 5.0, "within the limit");
    assert!(step(&gains, 0.0, f64::NAN, 0.0, 2e-3, 5.0).is_nan());
}

#[test]
fn fields_pull_as_their_matrices_say() {
    let mut field = Setpoint { position: [0.1, 0.2, 0.0], ..Setpoint::default() };
    // A spring on axis 0, a curl field on both: torque across the velocity, no work.
    field.stiffness[0] = 2.0;
    (field.damping[1], field.damping[AXES]) = (0.5, -0.5);
    let handle =
        Handle { position: [0.4, 0.7, 0.0], velocity: [1.0, -2.0, 0.0], ..Handle::default() };
    let on =
        |field: &Setpoint, axis, handle: &Handle| field_torque(field, axis, handle, f64::INFINITY);
    let torque: [f64; AXES] = std::array::from_fn(|axis| on(&field, axis, &handle));
    close(torque[0], -2.0 * 0.3 - 0.5 * -2.0);
    close(torque[1], 0.5 * 1.0);
    close(torque[0] * handle.velocity[0] + torque[1] * handle.velocity[1], -2.0 * 0.3);
    let rest = |position| Handle { position, ..Handle::default() };
    (field.wall_min[1], field.wall_max[1], field.wall_stiffness[1]) = (-0.5, 0.5, 10.0);
    close(on(&field, 1, &rest(handle.position)), -10.0 * 0.2);
    close(on(&field, 1, &rest([0.1, 0.2, 0.0])), 0.0);
}

#[test]
fn inertia_pulls_against_acceleration_and_no_harder_than_the_motor_can() {
    let mut field = Setpoint::default();
    (field.inertia[0], field.inertia[1]) = (0.02, -0.01);
    let handle = Handle { acceleration: [100.0, 50.0, 0.0], ..Handle::default() };
    close(field_torque(&field, 0, &handle, 10.0), -0.02 * 100.0 + 0.01 * 50.0);
    close(field_torque(&field, 0, &handle, 1.0), -1.0);
    close(field_torque(&field, 1, &handle, 10.0), 0.0);
}

#[test]
fn tables_are_linear_between_their_points_and_hold_their_ends() {
    let mut field = Setpoint::default();
    for (point, torque) in field.position_table[TABLE..2 * TABLE].iter_mut().enumerate() {
        *torque = (point as f64 - 3.0).powi(2);
    }
    (field.table_position_min[1], field.table_position_max[1]) = (-1.0, 0.6);
    // 0.1 rad from point to point.
    for (position, torque) in
        [(-1.0, 9.0), (-0.95, 6.5), (-0.7, 0.0), (0.6, 169.0), (-4.0, 9.0), (4.0, 169.0)]
    {
        let handle = Handle { position: [0.3, position, 0.0], ..Handle::default() };
        assert!((field_torque(&field, 1, &handle, 0.0) - torque).abs() < 1e-9, "{position}");
        assert_eq!(field_torque(&field, 0, &handle, 0.0), 0.0, "another axis");
    }
    let mut field = Setpoint::default();
    for (point, torque) in field.velocity_table[..TABLE].iter_mut().enumerate() {
        *torque = -0.5 * (point as f64 - 8.0);
    }
    field.table_speed[0] = 4.0;
    for (velocity, torque) in
        [(0.0, 0.0), (4.0, -4.0), (-4.0, 4.0), (1.3, -1.3), (9.0, -4.0), (-9.0, 4.0)]
    {
        let handle = Handle { velocity: [velocity, 0.0, 0.0], ..Handle::default() };
        assert!((field_torque(&field, 0, &handle, 0.0) - torque).abs() < 1e-9, "{velocity}");
    }
    // Limits the wrong way round, or of no width: no table.
    (field.table_speed[0], field.table_position_min[0], field.table_position_max[0]) =
        (-4.0, 1.0, 1.0);
    field.position_table.fill(5.0);
    assert_eq!(field_torque(&field, 0, &Handle::default(), 0.0), 0.0);
}

#[test]
fn acceleration_of_the_handle_is_felt_within_its_bandwidth() {
    // A hand that swings the handle at 1 Hz in a field of inertia alone: volts against the
    // acceleration, a little late.
    let mut law = Law::new(config(axis_law(), 500));
    let (mut now, mut found) = (SECOND, [0.0, 0.0]);
    let mut gains = [0.0; 2];
    for step in 0..2500 {
        now += 2_000_000;
        let phase = std::f64::consts::TAU * f64::from(step) * 2e-3;
        let mut sample = sample(now, phase.sin());
        sample.slave_present = 0;
        let mut aim = free(now);
        aim.inertia[0] = 0.05;
        let command = law.step(now, &sample, Some(&aim), true);
        if step >= 1500 {
            found[0] += command.volts[0] * phase.sin() / 500.0;
            found[1] += command.volts[0] * phase.cos() / 500.0;
        }
    }
    // Torque + 0.05 · (2π)² sin: within the offset's threshold nothing, so P1 v_s and 4/π of the
    // offset of 1.5 V.
    gains[0] = found[0].hypot(found[1]);
    gains[1] = (-found[1]).atan2(found[0]).to_degrees();
    let expected = 0.333 * 0.5 * 0.05 * std::f64::consts::TAU.powi(2);
    assert!(
        gains[0] > expected && gains[0] < expected + 1.5 * 4.0 / std::f64::consts::PI,
        "{gains:?}"
    );
    // 10 Hz, 40 (30) Hz and forgetting: 6°, 2° and 1°.
    assert!((5.0..15.0).contains(&gains[1]), "{gains:?}");
}

#[test]
fn soft_stops_begin_before_the_ends() {
    let gains = force_control();
    assert_eq!(end_stop_torque(&gains, 1.89, -2.0, 2.0), 0.0);
    close(end_stop_torque(&gains, 2.0, -2.0, 2.0), -1.0);
    close(end_stop_torque(&gains, -2.05, -2.0, 2.0), 1.5);
}

#[test]
fn soft_stops_of_a_narrow_way_do_not_meet() {
    let gains = force_control();
    // 0.15 rad, less than twice their width of 0.1 rad: each has a quarter.
    for (position, torque) in
        [(-0.1, 0.375), (-0.0625, 0.0), (-0.025, 0.0), (0.0125, 0.0), (0.05, -0.375), (0.1, -0.875)]
    {
        close(end_stop_torque(&gains, position, -0.1, 0.05), torque);
    }
    // Monotonic and inwards, whatever the width of the way.
    for width in [0.0, 1e-3, 0.1, 0.19, 0.21, 3.0] {
        let (least, most) = (-0.3, -0.3 + width);
        let torques: Vec<f64> = (0..=100)
            .map(|step| f64::from(step).mul_add(0.01 * width, least))
            .map(|position| end_stop_torque(&gains, position, least, most))
            .collect();
        assert!(torques.windows(2).all(|pair| pair[1] <= pair[0] + 1e-12), "{width}: {torques:?}");
        assert!(torques[0] >= 0.0 && torques[100] <= 0.0, "{width}: {torques:?}");
        assert!(torques[50].abs() < 1e-12, "{width}: {}", torques[50]);
    }
}

#[test]
fn soft_stops_are_at_the_ends_of_the_range_of_motion() {
    let law = AxisLaw { movement_range: (-0.1, 0.05), ..axis_law() };
    let volts_at = |position: f64| {
        let mut law = Law::new(config(law, 500));
        let mut now = SECOND;
        let mut volts = f64::NAN;
        for _ in 0..200 {
            now += 2_000_000;
            volts = law.step(now, &sample(now, position), Some(&free(now)), true).volts[0];
        }
        volts
    };
    let gains = force_control();
    close(volts_at(-0.1), settled_v(&gains, 0.375, 0.0));
    close(volts_at(-0.025), 0.0);
    close(volts_at(0.05), settled_v(&gains, -0.375, 0.0));
}

fn free(now: u64) -> Setpoint {
    setpoint(now, Mode::Impedance, [0.0; 4])
}

/// Runs a law for some cycles of 2 ms on a hand that rests and pushes; the last command.
fn run(
    law: &mut Law,
    now: &mut u64,
    cycles: u32,
    torque: f64,
    aim: impl Fn(u64) -> Setpoint,
) -> Vec<MotorCommand> {
    (0..cycles)
        .map(|_| {
            *now += 2_000_000;
            let mut sample = sample(*now, 0.5);
            sample.slave_torque[0] = torque;
            law.step(*now, &sample, Some(&aim(*now)), true)
        })
        .collect()
}

#[test]
fn goes_over_from_guidance_to_the_hand_and_back_without_a_jump() {
    let mut law = Law::new(config(axis_law(), 500));
    let mut now = SECOND;
    let guided =
        run(&mut law, &mut now, 600, 0.0, |now| setpoint(now, Mode::Position, sine(now, 0.3)));
    let held_v = guided.last().unwrap().volts[0];
    assert!(held_v.abs() > 0.5, "{held_v}");
    let given = run(&mut law, &mut now, 200, 0.0, free);
    assert!((given[0].volts[0] - held_v).abs() < 1e-9, "{held_v}, then {}", given[0].volts[0]);
    // Without a torque the carried volts fade in AUTHORITY_S from the limit at most, and nothing is
    // left.
    let faded = (AUTHORITY_S * 500.0) as usize + 1;
    assert_eq!((given[faded].volts[0], given[faded].ramping), (0.0, 0));
    let pushed = run(&mut law, &mut now, 200, 2.0, free);
    close(pushed[199].volts[0], 0.333 + 1.5);
    let taken =
        run(&mut law, &mut now, 1, 2.0, |now| setpoint(now, Mode::Hold, [0.5, 0.0, 0.0, 0.0]));
    assert!((taken[0].volts[0] - pushed[199].volts[0]).abs() < 1e-9, "{:?}", taken[0].volts);
    assert_eq!(taken[0].reference_position[0], 0.5, "from where the hand is");
}

#[test]
fn without_a_torque_there_is_no_force_control() {
    for broken in 0..4 {
        let mut axis = axis_law();
        if broken == 0 {
            axis.control.force = None;
        }
        let mut law = Law::new(config(axis, 500));
        let mut now = SECOND;
        run(&mut law, &mut now, 100, 2.0, free);
        now += 2_000_000;
        let (mut sample, mut aim) = (sample(now, 0.5), free(now));
        sample.slave_torque[0] = 2.0;
        match broken {
            1 => sample.torque_present = 0,
            2 => sample.slave_torque[0] = f64::NAN,
            3 => aim.damping[4] = f64::INFINITY,
            _ => {}
        }
        let command = law.step(now, &sample, Some(&aim), true);
        if broken == 3 {
            // A field that is no field is no setpoint: the hand is held.
            assert_eq!((command.lapsed, command.mode), (1, Mode::Hold.code()), "{command:?}");
        } else {
            assert_eq!(
                (command.volts[0], command.limited, command.mode),
                (0.0, 1, Mode::Passive.code()),
                "{command:?}"
            );
        }
    }
}

/// A spring that the hand is pulled away from: the law works for the spring until the hand holds
/// it.
#[test]
fn a_field_drives_the_handle_until_the_hand_holds_against_it() {
    let mut law = Law::new(config(axis_law(), 500));
    let mut now = SECOND;
    let spring = |now| {
        let mut aim = free(now);
        aim.stiffness[0] = 4.0;
        aim
    };
    let alone = run(&mut law, &mut now, 100, 0.0, spring);
    // At 0.5 rad the spring pulls with 2 N·m towards 0.
    close(alone[99].volts[0], -0.333 - 1.5);
    let held = run(&mut law, &mut now, 100, 2.0, spring);
    assert!(held[99].volts[0].abs() < 1e-9, "{}", held[99].volts[0]);
}
