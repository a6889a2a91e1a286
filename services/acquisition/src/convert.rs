//! Counts and volts to SI, by the rig file's channel map.

use ipc_types::{AXES, Sample, Zeros};
use rig::{Axis, RigFile};
use runtime::daq::Scan;

/// Converts scans of a rig. Allocates nothing.
#[derive(Clone, Debug)]
pub struct Converter {
    axes: Vec<Axis>,
}

impl Converter {
    /// The converter of a rig.
    pub fn new(rig: &RigFile) -> Self {
        Self { axes: rig.axes.iter().take(AXES).cloned().collect() }
    }

    /// What the scan says, in a sample, with positions from these zeros; gate and identity are left
    /// to the caller. Where a record holds a value in SI units already it is taken over to the last
    /// bit.
    pub fn convert(&self, scan: &Scan, zeros: &Zeros) -> Sample {
        let mut sample = Sample {
            tick: scan.tick,
            scan_time_ns: scan.time_ns,
            record_time_s: scan.record_time_s,
            master_counts: scan.master_counts,
            slave_counts: scan.slave_counts,
            analog_v: scan.analog_v,
            motor_v: scan.motor_v,
            digital_in: scan.digital_in,
            digital_out: scan.digital_out,
            analog_present: scan.present.analog,
            axes: self.axes.len() as u8,
            motor_present: scan.present.motor,
            motor_power: u8::from(scan.motor_power),
            filled_in: u8::from(scan.filled_in),
            master_zero: zeros.master,
            slave_zero: zeros.slave,
            homed: zeros.homed,
            homing_sequence: zeros.sequence,
            ..Sample::default()
        };
        for (index, map) in self.axes.iter().enumerate() {
            let bit = 1u8 << index;
            let physical = &scan.physical;
            if physical.master & bit != 0 {
                sample.master_position[index] = physical.master_position[index];
                sample.master_counts[index] =
                    map.master.counts(sample.master_position[index]).round() as i64;
                sample.master_present |= bit;
            } else if scan.present.master & bit != 0 {
                sample.master_position[index] = map
                    .master
                    .position(scan.master_counts[index].wrapping_sub(zeros.master[index]));
                sample.master_present |= bit;
            }
            if physical.slave & bit != 0 {
                sample.slave_position[index] = physical.slave_position[index];
                sample.slave_present |= bit;
            } else if let Some(slave) = map.slave
                && scan.present.slave & bit != 0
            {
                sample.slave_position[index] =
                    slave.position(scan.slave_counts[index].wrapping_sub(zeros.slave[index]));
                sample.slave_present |= bit;
            }
            if physical.torque & bit != 0 {
                sample.slave_torque[index] = physical.slave_torque[index];
                sample.torque_present |= bit;
            } else if let Some(torque) = map.torque
                && let Some(volts) = scan.analog_v.get(torque.channel)
                && scan.present.analog & 1 << torque.channel != 0
            {
                sample.slave_torque[index] = torque.torque(*volts);
                sample.torque_present |= bit;
            }
        }
        sample
    }
}
