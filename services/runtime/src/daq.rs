//! The card as acquisition sees it: batched, so that a late wake yields late samples and not holes.

use ipc_types::{ABSENT_COUNT, ANALOG, AXES, Capabilities, CardKind, CardScan};
use thiserror::Error;

use crate::timing::Losses;

/// One scan of a card.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scan {
    /// Tick of the acquisition grid.
    pub tick: u64,
    /// When the card took it [ns, CLOCK_MONOTONIC].
    pub time_ns: u64,
    /// Time within the replayed record (s); 0 for a live card.
    pub record_time_s: f64,
    /// Encoder counts of the master.
    pub master_counts: [i64; AXES],
    /// Encoder counts of the slave.
    pub slave_counts: [i64; AXES],
    /// Analog inputs (V).
    pub analog_v: [f64; ANALOG],
    /// Volts at the motor when the scan was taken (V).
    pub motor_v: [f64; AXES],
    /// Values that a record holds in SI units already.
    pub physical: Physical,
    /// Digital inputs, one bit each.
    pub digital_in: u32,
    /// Digital outputs, one bit each.
    pub digital_out: u32,
    /// What of the above is there.
    pub present: Present,
    /// Whether the card reports the motor power on.
    pub motor_power: bool,
    /// Whether the simulated card filled it in, late ([`ipc_types::is_filled_in`]).
    pub filled_in: bool,
    /// Which power-up of the card its counts began with: another number, and the encoders may have
    /// moved unseen.
    pub power_up: u64,
}

/// Values in SI units, from a record: they take the place of counts and volts where present.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Physical {
    /// Position of the master (rad or m).
    pub master_position: [f64; AXES],
    /// Position of the slave (rad or m).
    pub slave_position: [f64; AXES],
    /// Torque (or force) of the hand on the slave (N·m or N).
    pub slave_torque: [f64; AXES],
    /// One bit an axis: the position of the master is there.
    pub master: u8,
    /// One bit an axis: the position of the slave is there.
    pub slave: u8,
    /// One bit an axis: the torque is there.
    pub torque: u8,
}

impl Scan {
    /// A scan of the simulated card; `present` is what its rig has. An encoder that does not answer
    /// is absent, with a count of 0.
    pub fn of_card(scan: &CardScan, mut present: Present) -> Self {
        let (mut master_counts, mut slave_counts) = (scan.master_counts, scan.slave_counts);
        for (counts, bits) in
            [(&mut master_counts, &mut present.master), (&mut slave_counts, &mut present.slave)]
        {
            for (axis, count) in counts.iter_mut().enumerate() {
                if *count == ABSENT_COUNT {
                    *count = 0;
                    *bits &= !(1 << axis);
                }
            }
        }
        Self {
            tick: scan.tick,
            time_ns: scan.scan_time_ns,
            master_counts,
            slave_counts,
            analog_v: scan.analog_v,
            motor_v: scan.motor_v,
            digital_in: scan.digital_in,
            digital_out: u32::from(scan.digital_out),
            present,
            motor_power: scan.motor_power == 1,
            power_up: scan.incarnation,
            ..Self::default()
        }
    }
}

/// Presence, one bit per axis or channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Present {
    /// Master encoders.
    pub master: u8,
    /// Slave encoders.
    pub slave: u8,
    /// Motor volts read back.
    pub motor: u8,
    /// Analog channels.
    pub analog: u16,
}

impl Present {
    /// What is there in both.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self {
            master: self.master & other.master,
            slave: self.slave & other.slave,
            motor: self.motor & other.motor,
            analog: self.analog & other.analog,
        }
    }

    /// What is there, but for some.
    #[must_use]
    pub const fn without(self, gone: Self) -> Self {
        Self {
            master: self.master & !gone.master,
            slave: self.slave & !gone.slave,
            motor: self.motor & !gone.motor,
            analog: self.analog & !gone.analog,
        }
    }
}

/// What a card refused. Carries no text of its own, so that it can be made in a real-time loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum DaqError {
    /// The link to the card is broken.
    #[error("the link to the card is broken ({0})")]
    Link(&'static str),
    /// A value that is not finite was to be written; 0 V was written instead.
    #[error("volts that are not finite were refused, 0 V was written")]
    NotFinite,
    /// The card has no outputs.
    #[error("this card has no outputs; only 0 V can be written")]
    NoOutput,
}

/// A data acquisition card.
pub trait Daq {
    /// Which kind of card it is.
    fn kind(&self) -> CardKind;

    /// What it can do.
    fn capabilities(&self) -> Capabilities {
        self.kind().capabilities()
    }

    /// Every scan that the card clocked since the last call, oldest first; empty when none is due.
    /// The ticks rise strictly, from call to call as well.
    fn read_due(&mut self, now_ns: u64) -> Result<&[Scan], DaqError>;

    /// Tells the card that all scans up to `tick` are published, so that a successor goes on behind
    /// them.
    fn taken(&mut self, tick: u64);

    /// Writes volts to the outputs; they hold until the next write.
    fn write(&mut self, volts: [f64; AXES]) -> Result<(), DaqError>;

    /// Sets the digital outputs, one bit each; they hold until the next write, and show at the
    /// latest once volts are written. A card without digital outputs accepts none that is high.
    fn write_digital(&mut self, levels: u32) -> Result<(), DaqError> {
        if levels == 0 { Ok(()) } else { Err(DaqError::NoOutput) }
    }

    /// Scans that were dropped before they could be read, since this object was made.
    fn scans_missed(&self) -> u64;

    /// What was lost between the card and here, where messages stand between.
    fn losses(&self) -> Losses {
        Losses::default()
    }

    /// Whether no scan will ever come again (a record at its end).
    fn finished(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presence_is_taken_away_bit_by_bit() {
        let all = Present { master: 0b11, slave: 0b101, motor: 0b111, analog: 0x8001 };
        let some = Present { master: 0b10, slave: 0b100, motor: 0b001, analog: 0x8000 };
        let rest = Present { master: 0b01, slave: 0b001, motor: 0b110, analog: 0x0001 };
        assert_eq!((all.without(some), all.without(rest)), (rest, some));
        assert_eq!(
            (all.and(some), some.and(all), some.and(rest)),
            (some, some, Present::default())
        );
        assert_eq!(all.without(Present::default()), all);
    }
}
