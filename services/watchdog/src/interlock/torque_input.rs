//! Whether the analog inputs of the torque cells read what a live sensor can.

use ipc_types::{AXES, Sample, TripCause};

use super::faults::FaultSet;
use crate::since::Since;

/// A reading counts as at the end of its range from this share of it on.
const RAILED: f64 = 0.995;
/// How long it may be there (ns): 40 scans at 2 kHz, so that a spike of the amplifier is none.
const RAILED_NS: u64 = 20_000_000;

/// The input of one axis's torque cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueInput {
    /// Index of the analog input.
    pub channel: usize,
    /// Its range is ± this (V).
    pub range_v: f64,
    /// Longest time without a change of one bit (ns); `None` where it may be any.
    pub stuck_ns: Option<u64>,
}

impl TorqueInput {
    /// The inputs of a rig's torque cells, by axis.
    pub fn of_rig(rig: &rig::RigFile) -> [Option<Self>; AXES] {
        std::array::from_fn(|axis| {
            let cell = rig.axes.get(axis)?.torque?;
            let channel = rig.channel_at(cell.channel)?;
            Some(Self {
                channel: cell.channel,
                range_v: channel.range_v,
                stuck_ns: cell.stuck_time_s.map(|seconds| (seconds * 1e9) as u64),
            })
        })
    }
}

/// Since when an input reads the same, and the end of its range.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct InputMonitor {
    volts: f64,
    same: Since,
    railed: Since,
}

impl InputMonitor {
    /// Takes the input's reading in a sample.
    pub(super) fn observe(&mut self, sample: &Sample, input: &TorqueInput) -> FaultSet {
        let mut faults = FaultSet::NONE;
        let present = sample.analog_present & 1 << input.channel != 0;
        let Some(&volts) = sample.analog_v.get(input.channel).filter(|_| present) else {
            // An absent channel is a fault of its own.
            *self = Self::default();
            return faults;
        };
        let now_ns = sample.scan_time_ns;
        let railed = volts.abs() >= RAILED * input.range_v;
        let railed_ns = self.railed.elapsed_ns(!railed, now_ns);
        faults.insert_if(railed && railed_ns > RAILED_NS, TripCause::SensorRailed);
        let same = volts.to_bits() == self.volts.to_bits();
        let same_ns = self.same.elapsed_ns(!same, now_ns);
        faults.insert_if(
            same && input.stuck_ns.is_some_and(|longest| same_ns > longest),
            TripCause::SensorStuck,
        );
        self.volts = volts;
        faults
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::ANALOG;

    use super::*;

    #[test]
    fn the_inputs_are_those_of_the_rig_file() {
        let mut rig = rig::load_rig("hydrostatic".as_ref()).unwrap();
        let cell = rig.axes[0].torque.as_mut().unwrap();
        cell.stuck_time_s = Some(0.25);
        let channel = cell.channel;
        let range_v = rig.channel_at(channel).unwrap().range_v;
        let input = TorqueInput { channel, range_v, stuck_ns: Some(250_000_000) };
        assert_eq!(TorqueInput::of_rig(&rig), [Some(input), None, None]);
    }

    #[test]
    fn a_reading_is_stuck_after_more_than_its_time() {
        let input = TorqueInput { channel: 1, range_v: 10.0, stuck_ns: Some(1000) };
        let mut monitor = InputMonitor::default();
        let mut faults_at = |scan_time_ns, volts| {
            let mut sample = Sample { scan_time_ns, analog_present: 0b10, ..Sample::default() };
            sample.analog_v[1] = volts;
            monitor.observe(&sample, &input)
        };
        let mut stuck = FaultSet::NONE;
        stuck.insert(TripCause::SensorStuck);
        assert_eq!(faults_at(0, 1.0), FaultSet::NONE);
        assert_eq!(faults_at(1000, 1.0), FaultSet::NONE);
        assert_eq!(faults_at(1001, 1.0), stuck);
        assert_eq!(faults_at(1002, 1.5), FaultSet::NONE);
        assert_eq!(faults_at(2002, 1.5), FaultSet::NONE);
        assert_eq!(faults_at(2003, 1.5), stuck);
        // An absent input reads nothing, and begins anew when it is back.
        let absent = Sample { scan_time_ns: 2004, analog_v: [1.5; ANALOG], ..Sample::default() };
        assert_eq!(monitor.observe(&absent, &input), FaultSet::NONE);
    }
}
