//! Protocols on the lock-step rig: what tuning predicts, and tuning without a clock.

use identify::input::Series;
use ipc_types::Sample;
use lock_step::{LockStepError, LockStepRig};
use rig::RigFile;
use rig::protocol::Protocol;

use crate::tracking::Followed;

/// A movement that was played, and what was measured of it.
#[derive(Clone, Debug, Default)]
pub struct Played {
    /// Desired and measured positions of the first axis.
    pub followed: Followed,
    /// Every sample, in the columns of a record of the axis.
    pub record: Series,
}

/// A machine under a control law: the rig file of control, and that of the machine, with effects
/// that neither file has.
#[derive(Clone, Copy, Debug)]
pub struct Machine<'a> {
    /// Constants and effects of the machine.
    pub rig: &'a RigFile,
    /// Further effects, each `ID[@SITE][=SIZE]`.
    pub effects: &'a [String],
}

/// Plays a protocol from rest on a rig whose control has the rig file `control`.
///
/// # Errors
/// [`LockStepError`] where the machine cannot be simulated.
pub fn play(
    control: &RigFile,
    machine: Machine<'_>,
    protocol: &Protocol,
) -> Result<Played, LockStepError> {
    let mut columns: [Vec<f64>; 5] = std::array::from_fn(|_| Vec::new());
    let followed = run(control, machine, protocol, &mut |sample| {
        let values = [
            sample.tick as f64 / f64::from(control.rates.acquisition_hz),
            sample.motor_v[0],
            sample.master_position[0],
            sample.slave_position[0],
            sample.slave_torque[0],
        ];
        for (column, value) in columns.iter_mut().zip(values) {
            column.push(value);
        }
    })?;
    let names = ["t_s", "motor_v", "master_rad", "slave_rad", "slave_torque_nm"];
    let slave = control.axes.first().is_some_and(|axis| axis.slave.is_some());
    let torque = control.axes.first().is_some_and(|axis| axis.torque.is_some());
    let kept = |name: &&str| match *name {
        "slave_rad" => slave,
        "slave_torque_nm" => torque,
        _ => true,
    };
    let columns = names
        .iter()
        .zip(columns)
        .filter(|(name, _)| kept(name))
        .map(|(name, values)| ((*name).to_owned(), values))
        .collect();
    let record = Series { file: protocol.name.clone(), columns, ..Series::default() };
    Ok(Played { followed, record })
}

/// The samples of a protocol that is played so.
///
/// # Errors
/// As [`play`].
pub fn samples(
    control: &RigFile,
    machine: Machine<'_>,
    protocol: &Protocol,
) -> Result<Vec<Sample>, LockStepError> {
    let mut samples = Vec::new();
    run(control, machine, protocol, &mut |sample| samples.push(*sample))?;
    Ok(samples)
}

/// Plays a protocol; `see` is called with every sample.
fn run(
    control: &RigFile,
    machine: Machine<'_>,
    protocol: &Protocol,
    see: &mut dyn FnMut(&Sample),
) -> Result<Followed, LockStepError> {
    let mut system = LockStepRig::new(control, &[])?;
    system.change_effects(machine.rig, machine.effects)?;
    let period_s = 1.0 / f64::from(control.rates.control_hz);
    let mut followed = Followed::default();
    let mut start = 0.0;
    for (_, segment) in protocol.sequence() {
        let movement = &segment.movement;
        let peak_speed = movement.feedforward_speed();
        let cycles = (movement.duration_s() / period_s).round() as u64;
        let mut last = start;
        for cycle in 0..cycles {
            let aim = movement.at(start, cycle as f64 * period_s, peak_speed);
            let setpoint = system.setpoint(&aim);
            let result = system.cycle_seeing(Some(&setpoint), true, see)?;
            let sample = &result.sample;
            let measured = match sample.slave_present & 1 {
                1 => sample.slave_position[0],
                _ => sample.master_position[0],
            };
            followed.push(result.time_s, aim.position, measured);
            last = aim.position;
        }
        start = last;
    }
    Ok(followed)
}
