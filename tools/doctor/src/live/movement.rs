//! A small movement of each axis: directions of encoders and motor, sign of the torque.

use std::fmt::Write as _;

use ipc_types::{COMMAND, MotorCommand, SAMPLE, Sample, Verb};
use operator::{ChosenProtocol, RunOutcome, reset_and_arm, run_protocol, verb};
use rig::protocol::Protocol;
use rig::{Axis, AxisUnit, RigFile};
use runtime::Verdict;

use super::connection::RunningRig;
use super::moved::{Moved, Movement};
use super::rest::no_file;
use crate::bench::Bench;
use crate::outcome::{Outcome, worse};

/// Amplitude, as a share of the way between the position limits: enough for the handle to follow
/// through the windup of a line of 10 m.
const AMPLITUDE_SHARE: f64 = 0.05;
/// Largest amplitude, as a share of the range of motion where that is narrow.
const LARGEST_SHARE: f64 = 0.25;
/// Time of each movement, and rest after it (s).
const RISE_S: f64 = 1.0;
const DWELL_S: f64 = 0.3;
/// Share of the reference that master and handle must follow, in its direction: tens of counts, and
/// more than play. Friction and the windup of a line take the greater part of so small a movement
/// (of the shipped hydrostatic rig the handle follows 0.2).
const FOLLOWED: f64 = 0.05;
/// A hand's torque counts where it is this many standard deviations of the sensor's noise at rest.
const HAND: f64 = 3.0;

/// What is kept of a sample and the command that is newest with it.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    time_s: f64,
    reference: f64,
    master: f64,
    slave: f64,
    motor_v: f64,
    torque: f64,
}

pub(crate) fn examine_encoders(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    Ok(match movement(bench)? {
        Movement::Made(moved) => judge_encoders(&moved).measured(&moved),
        Movement::Not(why) => why,
    })
}

pub(crate) fn examine_torque(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    Ok(match movement(bench)? {
        Movement::Made(moved) => judge_torque(&moved).measured(&moved),
        Movement::Not(Outcome { verdict: Verdict::Fail, value, .. }) => {
            Outcome::skipped(value, "see encoder-directions")
        }
        Movement::Not(why) => why,
    })
}

/// The movement, made once.
fn movement(bench: &mut Bench<'_>) -> anyhow::Result<Movement> {
    if let Some(made) = &bench.movement {
        return Ok(made.clone());
    }
    let made = make(bench)?;
    bench.movement = Some(made.clone());
    Ok(made)
}

/// Moves every axis a little to and fro, within the limits of the rig file.
fn make(bench: &mut Bench<'_>) -> anyhow::Result<Movement> {
    let stop = bench.stop;
    let rig = bench.rig()?;
    let Some(file) = rig.file.clone() else { return Ok(Movement::Not(no_file())) };
    let observed = rig.observed()?.samples.clone();
    let Some(last) = observed.last() else {
        return Ok(Movement::Not(Outcome::skipped("no samples come", "see card")));
    };
    let homed = (0..file.axes.len()).all(|axis| last.homed & 1 << axis != 0);
    if !homed {
        let remedy = format!("farreach run {}, then again", rig::home_protocol(file.axes.len()));
        return Ok(Movement::Not(Outcome::skipped("the rig is not homed", remedy)));
    }
    let protocol = Protocol::parse(&text_of(&file, last), "the doctor's movement")?;
    if let Err(error) = reset_and_arm(&rig.link, stop, &mut |_| {}) {
        let text = format!("the rig could not be armed: {error}");
        return Ok(Movement::Not(Outcome::new(Verdict::Fail, text)));
    }
    let played = play(rig, protocol, file.axes.len(), stop);
    // Whatever came of it: no motor stays under power.
    let disarmed = verb(&rig.link, Verb::Disarm);
    let (outcome, rows) = played?;
    disarmed?;
    Ok(match outcome {
        RunOutcome::Completed { .. } => {
            let axes = file.axes.iter().enumerate();
            let moved = axes.map(|(at, axis)| moved(at, axis, &rows[at], noise(&observed, at)));
            Movement::Made(moved.collect())
        }
        RunOutcome::Stopped { .. } => {
            Movement::Not(Outcome::skipped("the movement was stopped", "look again"))
        }
        RunOutcome::Tripped { cause, .. } => Movement::Not(
            Outcome::new(Verdict::Fail, format!("the rig tripped while it moved: {cause}")).remedy(
                "an encoder that counts against its motor makes the loop run away: `inverted` in \
                 [axes.master], or the motor's two wires",
            ),
        ),
    })
}

/// Amplitude of an axis's movement, and the middle of it, near where it is now (rad or m).
fn span(axis: &Axis, now: f64) -> (f64, f64) {
    let (min, max) = axis.movement_range();
    let limits = axis.limits.position_max - axis.limits.position_min;
    let amplitude = (AMPLITUDE_SHARE * limits).min(LARGEST_SHARE * (max - min));
    // Not near an end of its range, nor near the stops.
    let (low, high) = axis.stop_search().map_or((min, max), |search| (search.lower, search.upper));
    let (low, high) = (low.max(min) + 3.0 * amplitude, high.min(max) - 3.0 * amplitude);
    let middle = if low < high { now.clamp(low, high) } else { f64::midpoint(low, high) };
    (amplitude, middle)
}

/// The protocol: one axis after the other.
fn text_of(file: &RigFile, last: &Sample) -> String {
    let mut text = "[protocol]\nname = \"doctor\"\ndescription = \"A small movement\"\n".to_owned();
    for (at, axis) in file.axes.iter().enumerate() {
        let (amplitude, middle) = span(axis, last.master_position[at]);
        let (key, scale) = match axis.unit {
            AxisUnit::Radian => ("positions_deg", 1.0_f64.to_degrees()),
            AxisUnit::Metre => ("positions_m", 1.0),
        };
        let [a, b, c] = [middle, middle + amplitude, middle - amplitude].map(|at| at * scale);
        // A text in memory takes whatever is written.
        let _written = write!(
            text,
            "\n[[segments]]\nkind = \"steps\"\nlabel = \"axis {at}\"\naxis = {at}\n\
             {key} = [{a:.4}, {b:.4}, {c:.4}, {a:.4}]\nrise_s = {RISE_S}\ndwell_s = {DWELL_S}\n"
        );
    }
    text
}

fn play(
    rig: &RunningRig,
    protocol: Protocol,
    axes: usize,
    stop: &std::sync::atomic::AtomicBool,
) -> anyhow::Result<(RunOutcome, Vec<Vec<Row>>)> {
    let mut samples = rig.link.subscriber(SAMPLE)?;
    let mut commands = rig.link.subscriber(COMMAND)?;
    let mut rows = vec![Vec::new(); axes];
    let mut read = |rows: &mut Vec<Vec<Row>>| -> anyhow::Result<()> {
        let mut answered = Vec::new();
        while let Some(command) = commands.take()? {
            answered.push(command);
        }
        while let Some(sample) = samples.take()? {
            // The command that answers this sample; samples that none answers are not needed.
            let same = |command: &&MotorCommand| command.sample_tick == sample.tick;
            let Some(command) = answered.iter().find(same) else { continue };
            for (axis, rows) in rows.iter_mut().enumerate() {
                rows.push(row(axis, &sample, command));
            }
        }
        Ok(())
    };
    let mut failed = None;
    let outcome = run_protocol(&rig.link, &ChosenProtocol::of(protocol), stop, &mut |_| {
        failed = read(&mut rows).err();
    })?;
    failed.map_or(Ok(()), Err)?;
    Ok((outcome, rows))
}

fn row(axis: usize, sample: &Sample, command: &MotorCommand) -> Row {
    Row {
        time_s: sample.scan_time_ns as f64 * 1e-9,
        reference: command.reference_position[axis],
        master: sample.master_position[axis],
        slave: sample.slave_position[axis],
        motor_v: sample.motor_v[axis],
        torque: sample.slave_torque[axis],
    }
}

/// Standard deviation of an axis's torque at rest (N·m or N).
fn noise(observed: &[Sample], axis: usize) -> f64 {
    let count = observed.len().max(1) as f64;
    let mean = observed.iter().map(|sample| sample.slave_torque[axis]).sum::<f64>() / count;
    let squares = observed.iter().map(|sample| (sample.slave_torque[axis] - mean).powi(2));
    (squares.sum::<f64>() / count).sqrt()
}

/// What an axis did, from the rows of the whole protocol.
fn moved(axis: usize, of: &Axis, rows: &[Row], noise: f64) -> Moved {
    let column = |value: fn(&Row) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    let (reference, master, slave) =
        (column(|row| row.reference), column(|row| row.master), column(|row| row.slave));
    let speed: Vec<f64> = rows
        .windows(2)
        .map(|pair| (pair[1].slave - pair[0].slave) / (pair[1].time_s - pair[0].time_s).max(1e-4))
        .collect();
    let peak = RISE_PEAK * of_amplitude(&reference) / RISE_S;
    let drive = rows.windows(2).map(|pair| {
        let speed = (pair[1].master - pair[0].master) / (pair[1].time_s - pair[0].time_s).max(1e-4);
        pair[0].motor_v * speed
    });
    let torque = column(|row| row.torque);
    let amplitude = of_amplitude(&reference);
    let along = of.torque.map(|_| {
        let (stiffness, damping) = plane(&slave, &speed, &torque);
        stiffness * amplitude + damping * peak
    });
    Moved {
        axis,
        amplitude,
        master: slope(&reference, &master),
        slave: of.slave.as_ref().map(|_| slope(&reference, &slave)),
        drive: drive.sum::<f64>() / rows.len().max(1) as f64,
        torque: along,
        noise,
    }
}

/// Peak speed of a movement of minimum jerk over its mean speed.
const RISE_PEAK: f64 = 1.875;

/// Half of the range of a column.
fn of_amplitude(column: &[f64]) -> f64 {
    let min = column.iter().copied().fold(f64::INFINITY, f64::min);
    let max = column.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if max > min { (max - min) / 2.0 } else { 0.0 }
}

fn mean(column: &[f64]) -> f64 {
    column.iter().sum::<f64>() / column.len().max(1) as f64
}

/// Slope of `y` over `x` by least squares; 0 where `x` does not vary.
fn slope(x: &[f64], y: &[f64]) -> f64 {
    let (mean_x, mean_y) = (mean(x), mean(y));
    let products = x.iter().zip(y).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>();
    let squares = x.iter().map(|x| (x - mean_x).powi(2)).sum::<f64>();
    if squares > 0.0 { products / squares } else { 0.0 }
}

/// Least squares of `z` = constant + a `x` + b `y`; columns may differ by a row in length. Zeros
/// where it is not determined.
fn plane(x: &[f64], y: &[f64], z: &[f64]) -> (f64, f64) {
    let rows = x.len().min(y.len()).min(z.len());
    let (x, y, z) = (&x[..rows], &y[..rows], &z[..rows]);
    let (mean_x, mean_y, mean_z) = (mean(x), mean(y), mean(z));
    let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for at in 0..rows {
        let (x, y, z) = (x[at] - mean_x, y[at] - mean_y, z[at] - mean_z);
        xx += x * x;
        xy += x * y;
        yy += y * y;
        xz += x * z;
        yz += y * z;
    }
    let determinant = xx * yy - xy * xy;
    if determinant <= 1e-12 * xx * yy {
        return (0.0, 0.0);
    }
    ((xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant)
}

fn judge_encoders(moved: &[Moved]) -> Outcome {
    let mut verdict = Verdict::Pass;
    let mut words = Vec::new();
    let mut advice = None;
    for &Moved { axis, master, slave, drive, .. } in moved {
        let handle = slave.unwrap_or(FOLLOWED);
        let wrong = [
            (master < FOLLOWED, "the master does not follow: is the motor connected?"),
            (drive <= 0.0, "the motor's voltage reads back with the wrong sign: check its channel"),
            (handle <= -FOLLOWED, "the handle's encoder counts down: `inverted` in [axes.slave]"),
            (handle < FOLLOWED, "the handle does not follow: is the line filled, the encoder on?"),
        ];
        let its = wrong.iter().find(|(wrong, _)| *wrong);
        if its.is_some() {
            verdict = Verdict::Fail;
        }
        advice = advice.or(its.map(|(_, advice)| *advice));
        let handle = slave.map_or_else(String::new, |slave| format!(", handle {slave:.2}"));
        words.push(format!("axis {axis}: master {master:.2}{handle} of the reference"));
    }
    let outcome = Outcome::new(verdict, words.join("; "));
    match advice {
        Some(advice) => outcome.remedy(advice),
        None => outcome,
    }
}

/// A relaxed hand opposes: it is passive. Without a hand there is no sign to see.
fn judge_torque(moved: &[Moved]) -> Outcome {
    let mut verdict = Verdict::Skipped;
    let mut words = Vec::new();
    for &Moved { axis, torque, noise, .. } in moved {
        let Some(torque) = torque else { continue };
        let its = if torque < -HAND * noise {
            Verdict::Pass
        } else if torque > HAND * noise {
            Verdict::Fail
        } else {
            Verdict::Skipped
        };
        verdict = worse(verdict, its);
        let what = match its {
            Verdict::Pass => "opposes the movement",
            Verdict::Fail => "drives the movement",
            _ => "no hand at the handle",
        };
        words.push(format!("axis {axis}: {torque:+.3}, noise {noise:.3}, {what}"));
    }
    match verdict {
        Verdict::Skipped if words.is_empty() => {
            Outcome::skipped("no axis has a torque sensor", "nothing to do")
        }
        Verdict::Skipped => {
            Outcome::skipped(words.join("; "), "rest a relaxed hand on the handle, and look again")
        }
        _ => Outcome::new(verdict, words.join("; ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> Moved {
        Moved {
            axis: 0,
            amplitude: 0.2,
            master: 0.99,
            slave: Some(0.9),
            drive: 0.4,
            torque: Some(-0.05),
            noise: 0.004,
        }
    }

    #[test]
    fn directions_and_following_are_judged() {
        let told = |moved: Moved| judge_encoders(&[moved]);
        assert_eq!(told(good()).verdict, Verdict::Pass);
        assert_eq!(told(Moved { slave: None, ..good() }).verdict, Verdict::Pass);
        let least = told(Moved { slave: Some(0.05), master: 0.05, ..good() });
        assert_eq!(least.verdict, Verdict::Pass);
        let remedy = |moved: Moved| {
            let told = told(moved);
            assert_eq!(told.verdict, Verdict::Fail);
            told.remedy.unwrap()
        };
        assert!(remedy(Moved { slave: Some(-0.05), ..good() }).contains("[axes.slave]"));
        assert!(remedy(Moved { slave: Some(0.049), ..good() }).contains("does not follow"));
        assert!(remedy(Moved { master: 0.049, ..good() }).contains("the master"));
        assert!(remedy(Moved { drive: -0.1, ..good() }).contains("reads back"));
    }

    #[test]
    fn a_relaxed_hand_opposes_and_none_shows_nothing() {
        let verdict = |torque| judge_torque(&[Moved { torque, ..good() }]).verdict;
        assert_eq!(verdict(Some(-0.0121)), Verdict::Pass);
        assert_eq!(verdict(Some(-0.0119)), Verdict::Skipped);
        assert_eq!(verdict(Some(0.0119)), Verdict::Skipped);
        assert_eq!(verdict(Some(0.0121)), Verdict::Fail);
        assert_eq!(verdict(None), Verdict::Skipped);
    }

    #[test]
    fn what_an_axis_did_is_found_from_its_rows() {
        let rig = rig::load_rig(std::path::Path::new("hydrostatic")).unwrap();
        let rows = |sign: f64| -> Vec<Row> {
            (0..2000)
                .map(|at| {
                    let time_s = f64::from(at) * 2e-3;
                    let (sine, cosine) = (time_s * 3.0).sin_cos();
                    let slave = sign * 0.18 * sine;
                    Row {
                        time_s,
                        reference: 0.2 * sine,
                        master: 0.198 * sine,
                        slave,
                        motor_v: 1.5 * cosine.signum(),
                        torque: -0.3 * slave - 0.05 * sign * 0.54 * cosine + 0.1,
                    }
                })
                .collect()
        };
        let found = moved(0, &rig.axes[0], &rows(1.0), 0.004);
        assert!((found.master - 0.99).abs() < 1e-6, "{found:?}");
        assert!((found.slave.unwrap() - 0.9).abs() < 1e-6 && found.drive > 0.0, "{found:?}");
        // 0.3 N·m/rad at 0.2 rad, and 0.05 N·m·s/rad at the peak speed of the protocol.
        let expected = -0.3 * 0.2 - 0.05 * RISE_PEAK * 0.2;
        assert!((found.torque.unwrap() - expected).abs() < 1e-3, "{found:?}");
        assert!(moved(0, &rig.axes[0], &rows(-1.0), 0.004).slave.unwrap() < -0.8);
        let nothing = moved(0, &rig.axes[0], &[], 0.004);
        assert_eq!((nothing.master, nothing.torque), (0.0, Some(0.0)));
    }

    #[test]
    fn the_movement_stays_within_limits_and_away_from_the_stops() {
        for shipped in ["hydrostatic", "cable", "two-axis", "three-axis"] {
            let rig = rig::load_rig(std::path::Path::new(shipped)).unwrap();
            for at in [-9.0, 0.0, 0.3, 9.0] {
                let mut last = Sample::default();
                last.master_position.fill(at);
                let text = text_of(&rig, &last);
                let protocol = Protocol::parse(&text, "doctor").unwrap();
                protocol.check_against(&rig).unwrap_or_else(|error| panic!("{shipped}: {error}"));
                for axis in &rig.axes {
                    let (amplitude, middle) = span(axis, at);
                    assert!(amplitude > 0.0);
                    assert!(middle - 2.0 * amplitude > axis.limits.position_min);
                    assert!(middle + 2.0 * amplitude < axis.limits.position_max);
                }
            }
        }
    }

    #[test]
    fn the_movement_stays_within_the_range_of_motion() {
        let mut rig = rig::load_rig(std::path::Path::new("hydrostatic")).unwrap();
        for (min, max) in [(-0.35, 0.4), (-0.02, 0.06)] {
            let range = rig::RangeOfMotion { min, max, tolerance: 0.03 };
            rig.axes[0].range_of_motion = Some(range);
            for at in [-9.0, 0.0, 9.0] {
                let mut last = Sample::default();
                last.master_position.fill(at);
                let protocol = Protocol::parse(&text_of(&rig, &last), "doctor").unwrap();
                protocol.check_against(&rig).unwrap_or_else(|error| panic!("{min}: {error}"));
            }
        }
    }
}
