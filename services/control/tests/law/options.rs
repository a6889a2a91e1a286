//! Compensation from the identified model, disturbance observer, loop on the slave.

use control::law::{AxisLaw, Law};
use ipc_types::Mode;
use plant::reflected_dynamics::{FrictionCurve, ReflectedDynamics};
use rig::{AxisControl, Compensation, CompensationKind, ControlOptions, Observer, SlaveLoop};

use super::{Mass, SECOND, axis_law, config, sample, setpoint, sine};

/// Numbers of [`variant`].
pub(super) const VARIANTS: usize = 6;

/// 0.6 V of friction at the motor, 0.9 V that falls with speed beyond a soft line.
fn model() -> ReflectedDynamics {
    ReflectedDynamics {
        inertia_v: 0.011,
        master_friction: FrictionCurve::new(25.0, |_| 0.6),
        slave_friction: FrictionCurve::new(25.0, |speed| 0.9 - 0.02 * speed),
        windup: FrictionCurve::new(25.0, |speed| 0.9 - 0.02 * speed),
        line_v: 8.0,
        ratio: 0.854,
    }
}

fn compensation(kind: CompensationKind) -> Compensation {
    Compensation { kind, ..Compensation::default() }
}

fn observer() -> Observer {
    Observer { cutoff_hz: 3.0, share: 1.0, limit_v: 1.5 }
}

fn slave() -> SlaveLoop {
    SlaveLoop {
        limit: 0.35,
        windup_share: 1.0,
        proportional_gain: 0.3,
        integral_gain: 2.0,
        filter_hz: 3.0,
        lead_s: 0.03,
    }
}

fn with(options: ControlOptions) -> AxisLaw {
    let control = AxisControl { options, ..axis_law().control };
    AxisLaw { control, model: Some(model()), ..axis_law() }
}

/// The law with each of its options, and with all of them.
pub(super) fn variant(number: usize) -> AxisLaw {
    let identified = compensation(CompensationKind::Identified);
    let none = compensation(CompensationKind::None);
    match number {
        0 => axis_law(),
        1 => with(ControlOptions { compensation: identified, ..ControlOptions::default() }),
        2 => with(ControlOptions { observer: Some(observer()), ..ControlOptions::default() }),
        3 => with(ControlOptions { slave: Some(slave()), ..ControlOptions::default() }),
        4 => with(ControlOptions {
            compensation: none,
            observer: Some(observer()),
            slave: Some(slave()),
        }),
        _ => with(ControlOptions {
            compensation: identified,
            observer: Some(observer()),
            slave: Some(slave()),
        }),
    }
}

/// A law with settings of any kind in its options and its model.
pub(super) fn with_settings(
    law: AxisLaw,
    [first, second, third, fourth, fifth]: [f64; 5],
) -> AxisLaw {
    let control = &law.control.options;
    let options = ControlOptions {
        compensation: Compensation { share: first, reversal_speed: second, ..control.compensation },
        observer: control.observer.map(|_| Observer {
            cutoff_hz: first,
            share: second,
            limit_v: third,
        }),
        slave: control.slave.map(|_| SlaveLoop {
            limit: third,
            windup_share: first,
            proportional_gain: second,
            integral_gain: fourth,
            filter_hz: fifth,
            lead_s: fourth,
        }),
    };
    let model = law.model.map(|model| ReflectedDynamics {
        inertia_v: first,
        master_friction: FrictionCurve::new(second, |_| third),
        line_v: fourth,
        ratio: fifth,
        ..model
    });
    AxisLaw { control: AxisControl { options, ..law.control }, model, ..law }
}

/// Root mean square of the master's error on a mass with friction over the last two of four seconds
/// (rad).
fn rms(law: AxisLaw, friction_v: f64) -> f64 {
    let mut controller = Law::new(config(law, 500));
    let mut mass = Mass { friction_v, ..Mass::default() };
    let (mut sum, mut written_v) = (0.0, 0.0);
    for cycle in 0..2000u64 {
        let now = SECOND + cycle * SECOND / 500;
        let mut sample = sample(now, mass.position);
        (sample.motor_v[0], sample.motor_present) = (written_v, 1);
        let aim = sine(now, 0.5);
        let command =
            controller.step(now, &sample, Some(&setpoint(now, Mode::Position, aim)), true);
        written_v = command.volts[0];
        if cycle >= 1000 {
            sum += (aim[0] - mass.position).powi(2);
        }
        mass.advance(written_v, law.control.feedforward.inertia_v, 2e-3);
    }
    (sum / 1000.0).sqrt()
}

#[test]
fn each_option_takes_friction_away_that_the_feedback_leaves() {
    let none = with(ControlOptions {
        compensation: compensation(CompensationKind::None),
        ..ControlOptions::default()
    });
    let mut identified = variant(1);
    if let Some(model) = &mut identified.model {
        // A mass without a line: all of its friction is the motor's.
        model.master_friction = FrictionCurve::new(25.0, |_| 1.5);
        model.slave_friction = FrictionCurve::new(25.0, |_| 0.0);
    }
    let observed = with(ControlOptions { observer: Some(observer()), ..none.control.options });
    let [alone, identified, observed] = [none, identified, observed].map(|law| rms(law, 1.5));
    assert!(alone > 0.2, "{alone}");
    assert!(identified < 0.1 * alone, "{identified} of {alone}");
    assert!(observed < 0.3 * alone, "{observed} of {alone}");
}

#[test]
fn without_a_model_the_options_are_silent() {
    let mut law = variant(5);
    law.model = None;
    let none = with(ControlOptions {
        compensation: compensation(CompensationKind::None),
        ..ControlOptions::default()
    });
    assert_eq!(rms(law, 1.0), rms(none, 1.0));
}

/// The law with a loop on the slave, held at a position for `cycles`, the slave standing `behind`
/// (rad); the master's reference.
fn held(behind: Option<f64>, cycles: u64) -> Vec<f64> {
    let mut law = Law::new(config(variant(3), 500));
    (0..cycles)
        .map(|cycle| {
            let now = SECOND + cycle * SECOND / 500;
            let mut sample = sample(now, 0.0);
            if let Some(behind) = behind {
                (sample.slave_position[0], sample.slave_present) = (-behind, 1);
            }
            let aim = setpoint(now, Mode::Hold, [0.0; 4]);
            law.step(now, &sample, Some(&aim), true).reference_position[0]
        })
        .collect()
}

#[test]
fn at_rest_the_loop_on_the_slave_leads_by_its_gain_and_integrates_nothing() {
    let references = held(Some(0.09), 5000);
    assert_eq!(references[0].abs(), references[0].abs().min(1e-3), "begins where the master is");
    let (middle, last) = (references[2500], references[4999]);
    assert!((middle - 0.027).abs() < 1e-6 && (last - middle).abs() < 1e-9, "{middle} {last}");
    assert!(
        references.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 2e-3 * 2.0 + 1e-12),
        "no faster than 2 rad/s"
    );
}

#[test]
fn what_friction_cannot_hold_between_master_and_slave_at_power_on_stays_between_them() {
    // 0.9 V hold 0.1125 rad of the line; the ratio of the pistons is 0.854.
    let leaked = 0.25 / 0.854 - 0.1125;
    let references = held(Some(0.25), 2500);
    assert!((references[2499] - leaked - 0.3 * 0.25).abs() < 1e-6, "{}", references[2499]);
}

#[test]
fn the_loop_on_the_slave_stays_within_its_limit_and_does_without_the_slave() {
    // Twice: the constant has the same limit again.
    assert!(held(Some(50.0), 3000).iter().all(|reference| *reference <= 0.7 + 1e-9));
    assert!(held(None, 100).iter().all(|reference| *reference == 0.0));
}

/// Mean error of the slave over the seventh and eighth of eight seconds of 0.5 Hz, where it stands
/// `shifted` from the master's reference (rad), as a line that has leaked shifts it.
fn mean_error(integral_gain: f64, shifted: f64) -> f64 {
    let loop_on_slave = SlaveLoop { integral_gain, windup_share: 0.0, ..slave() };
    let law = with(ControlOptions { slave: Some(loop_on_slave), ..ControlOptions::default() });
    let mut law = AxisLaw { model: Some(ReflectedDynamics { ratio: 1.0, ..model() }), ..law };
    law.control.output_limit_v = 1e3;
    let mut controller = Law::new(config(law, 500));
    let (mut sum, mut reference) = (0.0, 0.0);
    for cycle in 0..4000u64 {
        let now = SECOND + cycle * SECOND / 500;
        let mut sample = sample(now, reference);
        (sample.slave_position[0], sample.slave_present) = (reference + shifted, 1);
        let aim = sine(now, 0.5);
        let command =
            controller.step(now, &sample, Some(&setpoint(now, Mode::Position, aim)), true);
        reference = command.reference_position[0];
        if cycle >= 3000 {
            sum += aim[0] - sample.slave_position[0];
        }
    }
    sum / 1000.0
}

#[test]
fn a_constant_offset_of_the_slave_is_integrated_while_it_moves() {
    let [proportional, integrated] = [0.0, 2.0].map(|gain| mean_error(gain, -0.1));
    // The proportional part alone leaves 1/1.3 of the offset.
    assert!((proportional - 0.1 / 1.3).abs() < 5e-3, "{proportional}");
    assert!(integrated.abs() < 2e-3, "{integrated}");
    assert!(mean_error(2.0, 0.1).abs() < 2e-3);
    assert!(mean_error(2.0, -2.0) > 1.2, "no more than its limits");
}
