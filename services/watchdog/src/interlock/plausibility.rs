//! Whether the machine answers its control as a machine can: what its two sides, its output and
//! its read-back tell about each other while it has power.

use std::ops::Range;

use ipc_types::{AXES, Mode, MotorCommand, Sample, TripCause};
use rig::Axis;

use super::config::{Config, LimitsNow};
use super::faults::FaultSet;
use super::message_monitor::{reports_power, takes_volts};

/// The output counts as at its limit from this share of it on.
const SATURATED: f64 = 0.995;
/// Volts that are read back may differ from those written by this share of the limit.
const READ_BACK_SHARE: f64 = 0.05;
/// Number of past samples whose outputs may explain the volts that are read back.
const OUTPUTS: usize = 16;
/// How long motor power may take from the first sample that shows the gate open (ns). The circuit
/// of the enable line needs a few edges, each within its timeout, and its relay some ten
/// milliseconds to close.
const POWER_COMES_NS: u64 = 100_000_000;

/// What an axis is supervised by.
#[derive(Clone, Copy, Debug)]
struct AxisMonitor {
    /// Master less slave when power was given, or the zeros changed (rad or m).
    difference: Option<f64>,
    /// The master, then the slave.
    sides: [Side; 2],
    /// Since when the output is at its limit (ns).
    saturated_since_ns: Option<u64>,
    /// Since when the volts that are read back are none of those written (ns).
    unexplained_since_ns: Option<u64>,
    /// Volts written with the last samples.
    outputs_v: [f64; OUTPUTS],
    /// Mean square of the volts, by a first-order lag (V²).
    heat_v2: f64,
}

/// One encoder.
#[derive(Clone, Copy, Debug, Default)]
struct Side {
    counts: i64,
    /// Position of the other side when the count last changed (rad or m).
    other: f64,
}

impl AxisMonitor {
    const fn new() -> Self {
        Self {
            difference: None,
            sides: [Side { counts: 0, other: 0.0 }; 2],
            saturated_since_ns: None,
            unexplained_since_ns: None,
            outputs_v: [0.0; OUTPUTS],
            heat_v2: 0.0,
        }
    }

    /// Forgets all that began with this power or these zeros. The motor stays as warm as it is.
    fn begin(&mut self) {
        *self = Self { heat_v2: self.heat_v2, ..Self::new() };
    }
}

/// A sample as one axis sees it.
struct Reading<'a> {
    sample: &'a Sample,
    axis: usize,
    entry: &'a Axis,
}

impl Reading<'_> {
    const fn has(&self, present: u8) -> bool {
        present & 1 << self.axis != 0
    }

    /// Position of the slave; `None` without one.
    fn slave(&self) -> Option<f64> {
        self.has(self.sample.slave_present).then(|| self.sample.slave_position[self.axis])
    }

    /// What neither control nor the gate goes beyond now (V).
    fn output_limit_v(&self) -> f64 {
        let limits = LimitsNow::of(self.entry, self.has(self.sample.homed));
        limits.volts.min(self.entry.control.output_limit_v)
    }
}

/// The supervision of all axes.
#[derive(Clone, Debug)]
pub(super) struct PlausibilityMonitor {
    axes: [AxisMonitor; AXES],
    powered: bool,
    /// Whether the card has reported motor power since it was permitted.
    power_seen: bool,
    /// Since when the motor is without the power that it is permitted (ns).
    power_missing_since_ns: Option<u64>,
    homing_sequence: u64,
    sample_ns: Option<u64>,
}

impl PlausibilityMonitor {
    pub(super) const fn new() -> Self {
        Self {
            axes: [AxisMonitor::new(); AXES],
            powered: false,
            power_seen: false,
            power_missing_since_ns: None,
            homing_sequence: 0,
            sample_ns: None,
        }
    }

    /// Takes a sample. `powered`: the gate is open with our permission. `command` is the newest
    /// one.
    pub(super) fn observe(
        &mut self,
        sample: &Sample,
        command: Option<&MotorCommand>,
        powered: bool,
        config: &Config,
    ) -> FaultSet {
        let mut faults = FaultSet::NONE;
        let now_ns = sample.scan_time_ns;
        let elapsed_ns = self.sample_ns.map_or(0, |last| now_ns.saturating_sub(last));
        self.sample_ns = Some(now_ns);
        let missing = self.power_missing(sample, powered, config);
        faults.insert_if(missing, TripCause::PowerMissing);
        let begins = powered && !self.powered || sample.homing_sequence != self.homing_sequence;
        (self.powered, self.homing_sequence) = (powered, sample.homing_sequence);
        for (at, (axis, entry)) in self.axes.iter_mut().zip(&config.axes).enumerate() {
            let reading = Reading { sample, axis: at, entry };
            if begins {
                axis.begin();
            }
            faults.insert_if(axis.overloaded(&reading, elapsed_ns), TripCause::MotorOverload);
            if !powered {
                continue;
            }
            faults.insert_if(axis.saturated(&reading), TripCause::Saturated);
            faults.insert_if(axis.read_back(&reading, config.echo_lost_ns), TripCause::ReadBack);
            let command = command.filter(|command| command.epoch == sample.epoch);
            // A search for the stops holds the slave and winds up the line.
            let searches = command.is_some_and(|command| command.mode == Mode::Initialise.code());
            if let Some(cause) = axis.moved_apart(&reading).filter(|_| !searches) {
                faults.insert(cause);
            }
            let lost = command.is_some_and(|command| left_behind(&reading, command));
            faults.insert_if(lost, TripCause::FollowingError);
        }
        faults
    }
}

impl PlausibilityMonitor {
    /// Whether the motor has been without power for too long, although it is permitted: a button,
    /// plug or relay beside the card keeps it away, and would give it back with the volts of that
    /// moment. Power that the card had reported may be gone for as long as a relay bounces; power
    /// that has not come yet has the time of the relay, where the card reports power at all.
    fn power_missing(&mut self, sample: &Sample, powered: bool, config: &Config) -> bool {
        let on = sample.motor_power == 1;
        self.power_seen = powered && (self.power_seen || on);
        let expected = self.power_seen || (powered && reports_power(sample, config));
        let longest_ns = if self.power_seen { config.echo_lost_ns } else { POWER_COMES_NS };
        let missing = expected && !on;
        lasts(&mut self.power_missing_since_ns, missing, sample.scan_time_ns, longest_ns)
    }
}

impl AxisMonitor {
    /// Whether motor and amplifier have had more than they bear for long.
    fn overloaded(&mut self, reading: &Reading<'_>, elapsed_ns: u64) -> bool {
        let Some(rating) = &reading.entry.plausibility.thermal else { return false };
        let (sample, axis) = (reading.sample, reading.axis);
        // Those of a replayed record reach no motor.
        let live = reading.has(sample.motor_present) && takes_volts(sample);
        let read_back = if live { sample.motor_v[axis].abs() } else { 0.0 };
        let volts = sample.output_v[axis].abs().max(read_back);
        if volts.is_finite() {
            let share = 1.0 - (-(elapsed_ns as f64 * 1e-9) / rating.time_constant_s).exp();
            self.heat_v2 += share * (volts * volts - self.heat_v2);
        }
        self.heat_v2 > rating.continuous_v * rating.continuous_v
    }

    /// Whether the output was at its limit for too long.
    fn saturated(&mut self, reading: &Reading<'_>) -> bool {
        let at_limit =
            reading.sample.output_v[reading.axis].abs() >= SATURATED * reading.output_limit_v();
        lasts(
            &mut self.saturated_since_ns,
            at_limit,
            reading.sample.scan_time_ns,
            (reading.entry.plausibility.saturation_time_s * 1e9) as u64,
        )
    }

    /// Whether the volts that are read back have differed from those written for too long. The
    /// motor gets them some scans later, and a batch of scans shows what was written after it.
    fn read_back(&mut self, reading: &Reading<'_>, longest_ns: u64) -> bool {
        let (sample, axis) = (reading.sample, reading.axis);
        self.outputs_v.rotate_left(1);
        self.outputs_v[OUTPUTS - 1] = sample.output_v[axis];
        if !reading.has(sample.motor_present) {
            return false;
        }
        let tolerance = READ_BACK_SHARE * reading.entry.limits.volts_max;
        let Range { start: least, end: most } = range(&self.outputs_v);
        let found = sample.motor_v[axis];
        let explained = (least - tolerance..=most + tolerance).contains(&found);
        lasts(&mut self.unexplained_since_ns, !explained, sample.scan_time_ns, longest_ns)
    }

    /// Whether one side has moved while the encoder of the other counted nothing, or both have
    /// moved apart by more than the line lets them.
    fn moved_apart(&mut self, reading: &Reading<'_>) -> Option<TripCause> {
        let (sample, axis) = (reading.sample, reading.axis);
        let plausibility = &reading.entry.plausibility;
        let master = sample.master_position[axis];
        let slave = reading.slave()?;
        if !master.is_finite() || !slave.is_finite() || !reading.has(sample.master_present) {
            // These are faults of their own.
            return None;
        }
        let counts = [sample.master_counts[axis], sample.slave_counts[axis]];
        let first = self.difference.is_none();
        for ((side, counts), other) in self.sides.iter_mut().zip(counts).zip([slave, master]) {
            if first || side.counts != counts {
                *side = Side { counts, other };
            }
        }
        let begin = *self.difference.get_or_insert(master - slave);
        let stuck =
            |side: &Side, other: f64| (other - side.other).abs() > plausibility.stuck_travel_max;
        if stuck(&self.sides[0], slave) || stuck(&self.sides[1], master) {
            return Some(TripCause::EncoderStuck);
        }
        let apart = (master - slave - begin).abs() > plausibility.disagreement_max;
        apart.then_some(TripCause::Disagreement)
    }
}

/// Whether both sides are far from the reference of a position-controlled axis. The law's
/// reference moves without a step, except that it gives way to the hand where it has no say.
fn left_behind(reading: &Reading<'_>, command: &MotorCommand) -> bool {
    let follows = matches!(
        Mode::from_code(command.mode),
        Some(Mode::Hold | Mode::Position | Mode::Centre | Mode::Learning)
    );
    let axis = reading.axis;
    let reference = command.reference_position[axis];
    if !follows || command.ramping == 1 || !reference.is_finite() {
        return false;
    }
    let plausibility = &reading.entry.plausibility;
    let most = plausibility.following_error_max
        + plausibility.following_error_time_s * command.reference_velocity[axis].abs();
    let error = |position: f64| (position - reference).abs();
    let master = error(reading.sample.master_position[axis]);
    master.min(reading.slave().map_or(f64::INFINITY, error)) > most
}

/// Follows since when a condition holds; whether that is for longer than `longest_ns`.
fn lasts(since_ns: &mut Option<u64>, holds: bool, now_ns: u64, longest_ns: u64) -> bool {
    if !holds {
        *since_ns = None;
        return false;
    }
    now_ns.saturating_sub(*since_ns.get_or_insert(now_ns)) > longest_ns
}

/// Least and greatest of some values.
fn range(values: &[f64]) -> Range<f64> {
    let fold = |f: fn(f64, f64) -> f64, from| values.iter().copied().fold(from, f);
    fold(f64::min, f64::INFINITY)..fold(f64::max, f64::NEG_INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_condition_lasts_when_it_has_held_for_more_than_its_time() {
        let mut since_ns = None;
        let mut at = |now_ns, holds| lasts(&mut since_ns, holds, now_ns, 1000);
        assert!(!at(0, false) && !at(5, true) && !at(1005, true) && at(1006, true));
        // It begins anew.
        assert!(!at(1007, false) && !at(1008, true) && !at(2008, true) && at(2009, true));
    }
}
