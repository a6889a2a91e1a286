//! The digital lines of the wiring: inputs of the samples, outputs for other instruments, and what
//! tells of the motor's power and of faults of sensors.

use comedi::{ComediError, Errno, OUTPUTS, Subdevice, expect_input};
use ipc_types::AXES;
use rig::{ComediCard, RigFile, SignalLine};
use runtime::daq::Present;

use super::boards::{Board, Boards, Lines};

/// Digital lines that are set.
#[derive(Debug)]
struct SetLines {
    board: usize,
    subdevice: Subdevice,
    first: u32,
    mask: u32,
}

/// An input that says yes or no.
#[derive(Debug)]
struct Signal {
    key: String,
    line: Lines,
    wired: SignalLine,
}

impl Signal {
    fn check(
        boards: &mut Boards,
        card: &ComediCard,
        key: String,
        wired: &SignalLine,
    ) -> Result<Self, ComediError> {
        let line = boards.read(card, &key, &wired.line)?;
        Ok(Self { key, line, wired: wired.clone() })
    }

    /// Whether it says yes in the last reading.
    fn is_active(&self, boards: &[Board]) -> bool {
        self.wired.is_active(self.line.levels(boards) == 1)
    }
}

/// A line by which a sensor reports a fault.
#[derive(Debug)]
struct Fault {
    signal: Signal,
    /// The sensor.
    of: Present,
}

/// All digital lines but the enable line, which is the watchdog's.
#[derive(Debug)]
pub(super) struct Digital {
    motor_power: Option<Signal>,
    faults: Vec<Fault>,
    inputs: Option<Lines>,
    outputs: Option<SetLines>,
}

impl Digital {
    /// Finds the lines on their devices. Changes nothing.
    pub(super) fn check(
        rig: &RigFile,
        card: &ComediCard,
        boards: &mut Boards,
    ) -> Result<Self, ComediError> {
        if let Some(line) = &card.enable_line {
            boards.lines(card, "comedi.enable_line", line, OUTPUTS)?;
        }
        let motor_power = match &card.motor_power {
            Some(wired) => {
                Some(Signal::check(boards, card, "comedi.motor_power".to_owned(), wired)?)
            }
            None => None,
        };
        let inputs = match &card.digital_inputs {
            Some(lines) => Some(boards.read(card, "comedi.digital.inputs", lines)?),
            None => None,
        };
        let outputs = match &card.digital_outputs {
            Some(lines) => {
                let (board, subdevice) =
                    boards.lines(card, "comedi.digital.outputs", lines, OUTPUTS)?;
                let mask = lines.mask();
                Some(SetLines { board, subdevice, first: lines.first, mask })
            }
            None => None,
        };
        Ok(Self { motor_power, faults: faults(rig, card, boards)?, inputs, outputs })
    }

    /// Makes outputs of the lines that are to be such, and checks that no input became one with
    /// them.
    pub(super) fn set_directions(&self, boards: &[Board]) -> Result<(), ComediError> {
        let channels = |mask: u32| (0..32).filter(move |channel| mask >> channel & 1 == 1);
        if let Some(lines) = &self.outputs {
            let device = &boards[lines.board].device;
            for channel in channels(lines.mask) {
                device
                    .make_output(&lines.subdevice, channel)
                    .map_err(device.refused("making a digital line an output"))?;
            }
        }
        let faults = self.faults.iter().map(|fault| &fault.signal);
        let signals = self.motor_power.iter().chain(faults);
        let signals = signals.map(|signal| (signal.key.as_str(), &signal.line));
        let inputs = self.inputs.iter().map(|lines| ("comedi.digital.inputs", lines));
        for (key, lines) in signals.chain(inputs) {
            let device = &boards[lines.board].device;
            for channel in channels(lines.mask) {
                expect_input(device, key, &lines.subdevice, channel)?;
            }
        }
        Ok(())
    }

    /// Levels of the digital inputs in the last reading, one bit each.
    pub(super) fn levels(&self, boards: &[Board]) -> u32 {
        self.inputs.as_ref().map_or(0, |lines| lines.levels(boards))
    }

    /// Whether an input sees if the motor has power.
    pub(super) const fn sees_motor_power(&self) -> bool {
        self.motor_power.is_some()
    }

    /// Whether the motor has power in the last reading.
    pub(super) fn motor_power(&self, boards: &[Board]) -> bool {
        self.motor_power.as_ref().is_some_and(|signal| signal.is_active(boards))
    }

    /// What is left of `present` without the sensors that report a fault in the last reading.
    pub(super) fn without_faults(&self, boards: &[Board], present: Present) -> Present {
        let active = self.faults.iter().filter(|fault| fault.signal.is_active(boards));
        active.fold(present, |left, fault| left.without(fault.of))
    }

    /// Number of the digital outputs.
    pub(super) fn outputs(&self) -> u32 {
        self.outputs.as_ref().map_or(0, |lines| lines.mask.count_ones())
    }

    /// Sets the digital outputs, one bit each.
    pub(super) fn set(&self, boards: &[Board], levels: u32) -> Result<(), Errno> {
        let Some(lines) = &self.outputs else { return Ok(()) };
        let device = &boards[lines.board].device;
        let levels = levels.checked_shl(lines.first).unwrap_or_default();
        device.bits(lines.subdevice.number, lines.mask, levels & lines.mask).map(drop)
    }
}

/// The fault lines of all axes, each with its sensor.
fn faults(
    rig: &RigFile,
    card: &ComediCard,
    boards: &mut Boards,
) -> Result<Vec<Fault>, ComediError> {
    let mut faults = Vec::new();
    for (at, (axis, wiring)) in rig.axes.iter().zip(&card.axes).enumerate().take(AXES) {
        let none = Present::default();
        let cell = axis.torque.map_or(0, |cell| 1 << cell.channel);
        let sensors = [
            Present { master: 1 << at, ..none },
            Present { slave: 1 << at, ..none },
            Present { analog: cell, ..none },
        ];
        for ((name, wired), of) in wiring.fault_lines().into_iter().zip(sensors) {
            if let Some(wired) = wired {
                let key = format!("comedi.axes.{at}.{name}");
                faults.push(Fault { signal: Signal::check(boards, card, key, wired)?, of });
            }
        }
    }
    Ok(faults)
}
