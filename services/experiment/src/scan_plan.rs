//! What a protocol says of the scanner, and where its pulses come from.

use std::sync::Arc;

use ipc_types::{EmulatedScanner, PulseSource};
use plant::sensors::{ScannerEmulator, ScannerTrigger, TriggerFaults};
use rig::protocol::Scan;
use scanner::REPETITION_S;

/// What a protocol says of the scanner, and how the rig reads it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScanPlan {
    /// What is expected of the scan.
    pub scan: Option<Scan>,
    /// Whether a segment waits for the scanner; volumes count from the first such wait.
    pub waits: bool,
    /// Least width of a level of the trigger line, if that is a gate (s).
    pub gate_width_s: Option<f64>,
    /// Where its pulses come from.
    pub pulses: Pulses,
}

/// Where the pulses of the scanner come from.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Pulses {
    /// The trigger line.
    #[default]
    Line,
    /// The key 5.
    Key,
    /// An emulated scanner.
    Emulated(Arc<ScannerEmulator>),
}

impl Pulses {
    /// The pulses of a source.
    ///
    /// # Errors
    /// What is wrong with an emulated scanner, in words.
    pub fn of(source: &PulseSource) -> Result<Self, String> {
        match source {
            PulseSource::Line => Ok(Self::Line),
            PulseSource::Key => Ok(Self::Key),
            PulseSource::Emulated(scanner) => emulator(scanner)
                .map(|emulator| Self::Emulated(Arc::new(emulator)))
                .map_err(|error| format!("--emulate-scanner: {error}")),
        }
    }
}

/// The model of an emulated scanner.
fn emulator(scanner: &EmulatedScanner) -> Result<ScannerEmulator, String> {
    let EmulatedScanner { repetition_s, jitter_s, missing, spurious_s, seed } = scanner;
    let (shortest, longest) = REPETITION_S;
    if !(shortest..=longest).contains(repetition_s) {
        return Err(format!(
            "expected a repetition time from {shortest} to {longest} s, found {repetition_s}"
        ));
    }
    let trigger = ScannerTrigger { repetition_s: *repetition_s, ..ScannerTrigger::default() };
    let faults = TriggerFaults {
        jitter_s: *jitter_s,
        missing: missing.clone(),
        spurious_s: spurious_s.clone(),
        seed: *seed,
    };
    ScannerEmulator { trigger, faults }.checked().map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn an_emulated_scanner_is_checked() {
        for (text, part) in [
            ("0.01", "from 0.02 to 60 s"),
            ("61", "from 0.02 to 60 s"),
            // Two pulses would meet.
            ("1,jitter=0.5", "jitter_s"),
        ] {
            let error = Pulses::of(&text.parse().unwrap()).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
        assert!(Pulses::of(&"0.02".parse().unwrap()).is_ok());
    }
}
