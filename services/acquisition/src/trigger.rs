//! Finds the scanner's pulses in the samples.

use ipc_types::{Sample, ScannerPulse};
use rig::{RigFile, ScannerInput, ScannerLine};
use scanner::PulseDetector;

/// Finds the scanner's pulses in the samples of a rig. Allocates nothing.
#[derive(Clone, Debug)]
pub struct Trigger {
    line: ScannerLine,
    detector: PulseDetector,
}

impl Trigger {
    /// The trigger of a rig; `None` where it has no trigger line.
    pub fn new(rig: &RigFile) -> Option<Self> {
        let line = rig.scanner?;
        Some(Self { line, detector: PulseDetector::new(line.line) })
    }

    /// What the sample shows to have happened on the line; nothing where the card did not read it.
    pub fn observe(&mut self, sample: &Sample) -> Option<ScannerPulse> {
        if let ScannerInput::Analog(index) = self.line.input
            && sample.analog_present.checked_shr(index as u32).unwrap_or(0) & 1 == 0
        {
            return None;
        }
        let volts = self.line.volts(&sample.analog_v, sample.digital_in)?;
        let event = self.detector.observe(sample.scan_time_ns, volts)?;
        Some(ScannerPulse {
            at_ns: event.at_ns,
            tick: sample.tick,
            pulses: self.detector.pulses(),
            glitches: self.detector.glitches(),
            kind: event.kind.code(),
            ..ScannerPulse::default()
        })
    }
}
