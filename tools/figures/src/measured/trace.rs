//! The movement of one axis during a segment, measured or simulated.

use std::ops::Range;

use anyhow::{Context as _, Result, bail};
use identify::spectral::Spectrum;
use lock_step::LockStepRig;
use recorder::{AxisColumns, Samples, rows_of};
use rig::RigFile;
use rig::protocol::trajectory::min_jerk;
use rig::protocol::{Envelope, Movement};

/// Corner above which the noise of the encoders is taken out of position and speed, Hz: a decade
/// above a rhythm of the hand.
const SMOOTH_HZ: f64 = 40.0;
/// Time in which the model moves to where the segment begins, and rests there, s.
const APPROACH_S: f64 = 2.0;

/// The movement of an axis, on an even grid.
#[derive(Clone, Debug)]
pub(super) struct Trace {
    /// Sampling rate, Hz.
    pub(super) rate_hz: f64,
    /// Turns of the motor for a turn of the handle.
    pub(super) gear: f64,
    /// Position of the motor, as that of the handle that it moves, rad.
    pub(super) master: Vec<f64>,
    /// Position of the handle, rad; `None` where it is not measured.
    pub(super) slave: Option<Vec<f64>>,
    /// Torque of the motor on its own shaft, N·m.
    pub(super) motor_nm: Vec<f64>,
    /// Torque of the hand on the handle, N·m; `None` where it is not measured.
    pub(super) hand_nm: Option<Vec<f64>>,
    /// Position and speed of the motor without the noise of its encoder, rad and rad/s.
    pub(super) smooth: [Vec<f64>; 2],
    /// Samples that were missing, and are those before them.
    pub(super) missing: u64,
}

impl Trace {
    /// What was measured in a stretch of time (ns, CLOCK_MONOTONIC); `torque_per_volt` is the
    /// motor's (N·m/V).
    ///
    /// # Errors
    /// Where it has less than a second of samples.
    pub(super) fn measured(
        samples: &Samples,
        axis: usize,
        times_ns: &Range<u64>,
        torque_per_volt: f64,
    ) -> Result<Self> {
        let rate_hz = f64::from(samples.rig.rates.acquisition_hz);
        let Some(AxisColumns { master, slave, torque, motor_v }) = samples.of_axis(axis) else {
            bail!("axis {axis} is not in the recording");
        };
        let from = samples.times_ns.partition_point(|at_ns| *at_ns < times_ns.start);
        let to = samples.times_ns.partition_point(|at_ns| *at_ns < times_ns.end);
        let ticks = samples.ticks.get(from..to).unwrap_or_default();
        let (Some(&first), Some(&last)) = (ticks.first(), ticks.last()) else {
            bail!("no samples of it were recorded");
        };
        let rows = last.saturating_sub(first).saturating_add(1);
        if rows / 2 > ticks.len() as u64 || rows < ticks.len() as u64 {
            bail!(
                "it has {} samples with ticks from {first} to {last}: more than half are missing, \
                 or they run backwards",
                ticks.len()
            );
        }
        if (rows as f64) < rate_hz {
            bail!("it has {rows} samples, less than a second");
        }
        let even = |column: &[f64]| evenly(ticks, column.get(from..to).unwrap_or_default());
        let master = even(master);
        Ok(Self {
            rate_hz,
            gear: samples.rig.axes.get(axis).map_or(1.0, |axis| axis.master.turns_per_handle_turn),
            smooth: smooth(&master, rate_hz).context("its positions cannot be transformed")?,
            master,
            slave: slave.map(even),
            motor_nm: even(motor_v).into_iter().map(|volts| volts * torque_per_volt).collect(),
            hand_nm: torque.map(even),
            missing: rows - ticks.len() as u64,
        })
    }

    /// The same movement of the declared machine under its controller, without a clock: from rest,
    /// it first moves to where the recorded one began. Recorded once a control cycle.
    ///
    /// # Errors
    /// Where the rig cannot be simulated.
    pub(super) fn simulated(
        &self,
        rig: &RigFile,
        movement: &Movement,
        torque_per_volt: f64,
    ) -> Result<Self> {
        let mut system = LockStepRig::new(rig, &[])?;
        let start = self.master.first().copied().unwrap_or(0.0);
        let peak = movement.feedforward_speed();
        let end_s = APPROACH_S + movement.duration_s();
        let columns = || Vec::with_capacity((end_s * f64::from(rig.rates.control_hz)) as usize);
        let (mut master, mut slave) = (columns(), columns());
        let (mut motor_nm, mut hand_nm) = (columns(), columns());
        let half_s = 0.5 / f64::from(rig.rates.control_hz);
        while system.time_s() < end_s - half_s {
            let time_s = system.time_s();
            let aim = match time_s < APPROACH_S {
                // The second half of the time is rest.
                true => min_jerk(0.0, start, (2.0 * time_s).min(APPROACH_S), APPROACH_S),
                false => movement.at(start, time_s - APPROACH_S, peak),
            };
            let sample = system.follow(&aim)?.sample;
            if time_s >= APPROACH_S - half_s {
                master.push(sample.master_position[0]);
                slave.push(sample.slave_position[0]);
                motor_nm.push(sample.motor_v[0] * torque_per_volt);
                hand_nm.push(sample.slave_torque[0]);
            }
        }
        let rate_hz = f64::from(rig.rates.control_hz);
        Ok(Self {
            rate_hz,
            gear: self.gear,
            smooth: smooth(&master, rate_hz).context("the model's positions")?,
            master,
            slave: self.slave.as_ref().map(|_| slave),
            motor_nm,
            hand_nm: self.hand_nm.as_ref().map(|_| hand_nm),
            missing: 0,
        })
    }

    /// Time from the first sample to the last, s.
    pub(super) fn duration_s(&self) -> f64 {
        self.master.len().saturating_sub(1) as f64 / self.rate_hz
    }

    /// The handle's position, or the motor's where the handle's is not measured, rad.
    pub(super) fn handle(&self) -> &[f64] {
        self.slave.as_deref().unwrap_or(&self.master)
    }

    /// The samples between the fades of a movement.
    pub(super) fn settled(&self, envelope: &Envelope) -> Range<usize> {
        let at = |time_s: f64| ((time_s * self.rate_hz) as usize).min(self.master.len());
        let begin = at(envelope.fade_in_s);
        begin..at(self.duration_s() - envelope.fade_out_s).max(begin)
    }
}

/// A column on an even grid of ticks: a sample that is missing, or not finite, is the one before.
fn evenly(ticks: &[u64], values: &[f64]) -> Vec<f64> {
    let mut before = values.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
    let even = rows_of(ticks).map(|index| {
        let value = index.and_then(|index| values.get(index)).copied();
        before = value.filter(|value| value.is_finite()).unwrap_or(before);
        before
    });
    even.collect()
}

/// Position and speed without noise.
fn smooth(position: &[f64], rate_hz: f64) -> Option<[Vec<f64>; 2]> {
    let spectrum = Spectrum::of(position)?;
    let weight = |hertz: f64| 1.0 / (1.0 + (hertz / SMOOTH_HZ).powi(8));
    Some([spectrum.wave(1, 0, rate_hz, weight)?, spectrum.wave(1, 1, rate_hz, weight)?])
}
