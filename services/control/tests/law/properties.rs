//! Properties of the law over arbitrary samples and setpoints.

use control::law::{AUTHORITY_S, AxisLaw, Law, SWITCH_STEP_V};
use ipc_types::{AXES, Message, Mode, MotorCommand, Sample, Setpoint};
use proptest::prelude::*;

use super::options::{VARIANTS, variant, with_settings};
use super::{SECOND, config, sample, setpoint, sine};

/// Bytes that hold either message.
const LONGEST: usize = if size_of::<Sample>() > size_of::<Setpoint>() {
    size_of::<Sample>()
} else {
    size_of::<Setpoint>()
};

/// What may happen to a law over some cycles.
#[derive(Clone, Debug)]
enum Act {
    Sine(f64),
    Jump(f64, f64),
    Hold(f64),
    Passive,
    Nothing,
    Lapse,
    Restart,
    Owner(u8),
    /// The axis is homed from now on, or is not.
    Homed(bool),
    /// Torque of the hand, stiffness, damping.
    Free(f64, f64, f64),
    /// Any mode with any field, and the torque of the hand.
    Any(Box<Fields>, f64),
}

/// What a setpoint may say.
#[derive(Clone, Debug)]
struct Fields {
    mode: Mode,
    position: f64,
    velocity: f64,
    acceleration: f64,
    peak_speed: f64,
    output_limit_v: f64,
    stiffness: f64,
    damping: f64,
    wall: f64,
}

fn fields() -> impl Strategy<Value = Fields> {
    let limit =
        prop_oneof![2 => Just(0.0), 4 => 0.05..6.0f64, 1 => -3.0..0.0f64, 1 => Just(f64::NAN)];
    let motion = (-2.0..2.0f64, -3.0..3.0f64, -20.0..20.0f64, 0.0..20.0f64);
    let field = (-5.0..10.0f64, -0.5..2.0f64, 0.0..20.0f64);
    (prop::sample::select(Mode::ALL), motion, limit, field).prop_map(
        |(mode, motion, output_limit_v, field)| Fields {
            mode,
            position: motion.0,
            velocity: motion.1,
            acceleration: motion.2,
            peak_speed: motion.3,
            output_limit_v,
            stiffness: field.0,
            damping: field.1,
            wall: field.2,
        },
    )
}

fn acts() -> impl Strategy<Value = Vec<(Act, u16)>> {
    let act = prop_oneof![
        3 => (0.1..2.0f64).prop_map(Act::Sine),
        2 => (-2.0..2.0f64, -3.0..3.0f64).prop_map(|(x, v)| Act::Jump(x, v)),
        2 => (-2.0..2.0f64).prop_map(Act::Hold),
        1 => Just(Act::Passive),
        1 => Just(Act::Nothing),
        1 => Just(Act::Lapse),
        1 => Just(Act::Restart),
        1 => any::<u8>().prop_map(Act::Owner),
        1 => any::<bool>().prop_map(Act::Homed),
        3 => (-8.0..8.0f64, -5.0..10.0f64, -0.5..2.0f64)
            .prop_map(|(torque, k, d)| Act::Free(torque, k, d)),
        8 => (fields(), -8.0..8.0f64)
            .prop_map(|(fields, torque)| Act::Any(Box::new(fields), torque)),
    ];
    prop::collection::vec((act, 1u16..200), 1..12)
}

/// The setpoint of an act at a time.
fn aim(act: &Act, owner: u8, now: u64, begin: u64) -> Option<Setpoint> {
    let mut aim = match *act {
        Act::Sine(hertz) => setpoint(now, Mode::Position, sine(now, hertz)),
        Act::Jump(position, velocity) => {
            let t = (now - begin) as f64 * 1e-9;
            setpoint(now, Mode::Position, [position + velocity * t, velocity, 0.0, velocity.abs()])
        }
        Act::Hold(position) => setpoint(now, Mode::Hold, [position, 0.0, 0.0, 0.0]),
        Act::Passive => setpoint(now, Mode::Passive, [0.0; 4]),
        Act::Lapse => {
            Setpoint { lease_until_ns: begin, ..setpoint(begin, Mode::Position, sine(begin, 1.0)) }
        }
        Act::Owner(_) | Act::Homed(_) => setpoint(now, Mode::Position, sine(now, 0.5)),
        Act::Free(_, stiffness, damping) => {
            let mut free = setpoint(now, Mode::Impedance, [0.3, 0.0, 0.0, 0.0]);
            (free.stiffness[0], free.damping[0]) = (stiffness, damping);
            (free.inertia[0], free.velocity_table[0], free.table_speed[0]) =
                (0.1 * damping, stiffness, 1.0);
            (free.wall_min[0], free.wall_max[0], free.wall_stiffness[0]) = (-1.0, 1.0, 20.0);
            free
        }
        Act::Any(ref fields, _) => {
            let Fields { mode, position, velocity, acceleration, peak_speed, .. } = **fields;
            let moved = Fields {
                position: position + velocity * (now - begin) as f64 * 1e-9,
                ..(**fields).clone()
            };
            let position = if mode.moves() { moved.position } else { position };
            let mut any = setpoint(now, mode, [position, velocity, acceleration, peak_speed]);
            (any.stiffness[0], any.damping[0], any.output_limit_v[0]) =
                (fields.stiffness, fields.damping, fields.output_limit_v);
            (any.wall_min[0], any.wall_max[0], any.wall_stiffness[0]) = (-1.0, 1.0, fields.wall);
            any
        }
        Act::Nothing | Act::Restart => return None,
    };
    aim.owner = owner;
    Some(aim)
}

/// Plays acts to a law in front of a hand that does not move; `mirror` turns every position round.
fn play(
    axis: AxisLaw,
    acts: &[(Act, u16)],
    hand: f64,
    mirror: f64,
    mut look: impl FnMut(&Law, &MotorCommand, bool),
) {
    let mut law = Law::new(config(axis, 500));
    let mut now = SECOND;
    let mut owner = 0;
    let mut homed = true;
    let mut written_v = 0.0;
    for (act, cycles) in acts {
        let begin = now;
        let restart = matches!(act, Act::Restart);
        match act {
            Act::Restart => law = Law::new(config(axis, 500)),
            Act::Owner(by) => owner = *by,
            Act::Homed(now) => homed = *now,
            _ => {}
        }
        for cycle in 0..*cycles {
            now += 2_000_000;
            let mut setpoint = aim(act, owner, now, begin);
            if let Some(setpoint) = &mut setpoint {
                setpoint.position[0] *= mirror;
                setpoint.velocity[0] *= mirror;
                setpoint.acceleration[0] *= mirror;
            }
            let mut sample = sample(now, hand * mirror);
            sample.homed = u8::from(homed);
            if let Act::Free(torque, ..) | Act::Any(_, torque) = act {
                sample.slave_torque[0] = torque * mirror;
            }
            // The slave lags behind, and the card reads back what was put out before.
            (sample.slave_position[0], sample.slave_present) = (0.8 * hand * mirror, 1);
            (sample.motor_v[0], sample.motor_present) = (written_v, 1);
            let command = law.step(now, &sample, setpoint.as_ref(), true);
            written_v = command.volts[0];
            look(&law, &command, restart && cycle == 0);
        }
    }
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -3.0..3.0f64,
        2 => any::<f64>(),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(f64::MAX),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    /// Over restarts, changes of mode and owner, jumps and lapsed leases: the output changes by no
    /// more than the stated bound and what the reference's own movement asks for, and the reference
    /// never jumps.
    #[test]
    fn sr_21_nothing_makes_the_output_jump(
        acts in acts(), hand in -1.5..1.5f64, options in 0..VARIANTS,
    ) {
        let law = variant(options);
        let mut last: Option<MotorCommand> = None;
        let mut failed = None;
        play(law, &acts, hand, 1.0, |controller, command, restarted| {
            // A restarted law begins at 0 V: the gate has closed before.
            let before = last.filter(|_| !restarted);
            if let Some(before) = before {
                let moved = (command.reference_position[0] - before.reference_position[0]).abs();
                let sped = (command.reference_velocity[0] - before.reference_velocity[0]).abs();
                let mut bound = controller.step_bound_v(0, 2e-3)
                    + law.control.position_gain * moved
                    + law.control.velocity_gain * sped;
                let yields = |code| Mode::from_code(code).is_some_and(Mode::is_force_controlled);
                if yields(command.mode) || yields(before.mode) {
                    // Eq. 4.2.1 goes 0.4 of its way in a step, from limit to limit at most.
                    bound += 0.4 * 2.0 * law.control.output_limit_v;
                }
                let step = (command.volts[0] - before.volts[0]).abs();
                let mode = Mode::from_code(command.mode);
                // Two sines of 2 Hz in opposite phase, and the speed of catching up, once for the
                // reference and once for the slave's loop. Where the reference is held back, it is
                // drawn near as fast as the limit on the output may change.
                let drawn = match mode {
                    Some(Mode::Initialise) => law.control.output_limit_v * 2e-3 / AUTHORITY_S,
                    _ => 0.0,
                };
                let most =
                    2e-3 * 30.0 + (SWITCH_STEP_V + drawn) / law.control.position_gain;
                // Without position control the reference is where the hand is.
                let follows_hand = |mode: Mode| mode == Mode::Passive || mode.is_force_controlled();
                let jumped = moved > most && !mode.is_some_and(follows_hand);
                if step > bound || jumped {
                    failed = Some((step, bound, moved, *command));
                }
            } else if command.volts[0].abs() > 0.05 {
                failed = Some((command.volts[0], 0.0, 0.0, *command));
            }
            last = Some(*command);
        });
        prop_assert!(failed.is_none(), "{failed:?}");
    }

    #[test]
    fn sr_21_left_and_right_are_alike(
        acts in acts(), hand in -1.5..1.5f64, options in 0..VARIANTS,
    ) {
        let mut right = vec![];
        play(variant(options), &acts, hand, 1.0, |_, command, _| right.push(*command));
        let mut left = vec![];
        play(variant(options), &acts, hand, -1.0, |_, command, _| left.push(*command));
        for (right, left) in right.iter().zip(&left) {
            prop_assert!((right.volts[0] + left.volts[0]).abs() < 1e-12);
            prop_assert!((right.reference_position[0] + left.reference_position[0]).abs() < 1e-12);
            prop_assert_eq!((right.limited, right.ramping), (left.limited, left.ramping));
        }
    }

    /// Whatever is measured and asked for, by numbers of any kind: finite, within the limit.
    #[test]
    fn sr_22_any_input_gives_a_finite_output_within_the_limit(
        cycles in prop::collection::vec(
            (
                number(),
                [number(), number(), number(), number()],
                0u8..9,
                any::<bool>(),
                -1i64..20_000_000,
                number(),
                number(),
            ),
            1..80,
        ),
        options in 0..VARIANTS,
    ) {
        let mut law = Law::new(config(variant(options), 500));
        let mut now = SECOND;
        for (position, aim, mode, powered, step, torque, limit_v) in cycles {
            now = now.wrapping_add(step as u64);
            let mut aim = setpoint(now, Mode::Position, aim);
            aim.mode = mode;
            let mut sample = sample(now, position);
            sample.slave_torque[0] = torque;
            (sample.slave_position[0], sample.slave_present) = (torque, mode & 1);
            (sample.motor_v[0], sample.motor_present) = (torque, mode >> 1 & 1);
            aim.stiffness[0] = torque;
            aim.output_limit_v[0] = limit_v;
            let command = law.step(now, &sample, Some(&aim), powered);
            let values = [
                command.volts,
                command.feedforward_v,
                command.reference_position,
                command.reference_velocity,
            ];
            prop_assert!(values.iter().flatten().all(|value| value.is_finite()), "{command:?}");
            prop_assert!(command.volts[0].abs() <= 5.0);
            prop_assert!(powered || command.volts == [0.0; AXES]);
        }
    }

    #[test]
    fn sr_22_arbitrary_bytes_and_gains_are_harmless(
        bytes in prop::collection::vec(
            (prop::collection::vec(any::<u8>(), LONGEST), any::<u64>(), any::<bool>()), 1..40,
        ),
        gains in [number(), number(), number(), number(), number()],
        options in (0..VARIANTS, [number(), number(), number(), number(), number()]),
    ) {
        let [position_gain, velocity_gain, inertia_v, friction_peak_v, ramp_s] = gains;
        let mut axis = variant(options.0);
        let control = &mut axis.control;
        control.position_gain = position_gain;
        control.velocity_gain = velocity_gain;
        control.ramp_s = ramp_s;
        control.feedforward.inertia_v = inertia_v;
        control.feedforward.friction_peak_v = friction_peak_v;
        let axis = with_settings(axis, options.1);
        let mut law = Law::new(config(axis, 500));
        for (bytes, now, ours) in bytes {
            let mut sample = Sample::from_bytes(&bytes[..size_of::<Sample>()]).unwrap();
            let last = &bytes[bytes.len() - size_of::<Setpoint>()..];
            let mut setpoint = Setpoint::from_bytes(last).unwrap();
            if ours {
                sample.master_present = 1;
                sample.master_position[0] = 0.5;
                setpoint.lease_until_ns = u64::MAX;
                setpoint.mode %= Mode::ALL.len() as u8;
            }
            let command = law.step(now, &sample, Some(&setpoint), true);
            let bounded = command.volts.iter().all(|volts| volts.is_finite() && volts.abs() <= 5.0);
            prop_assert!(bounded, "{command:?}");
        }
    }
}
