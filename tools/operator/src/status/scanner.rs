//! The scanner in the status: its trigger line, and the volumes of the running protocol.

use ipc_types::{ScanProgress, ScannerPulse};
use serde::Serialize;

/// The scanner's trigger line, and the volumes of the running protocol.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ScannerStatus {
    /// Pulses since acquisition started.
    pub pulses: u64,
    /// Levels since then that were too short for a pulse.
    pub glitches: u64,
    /// Time since the newest pulse or glitch (s); `null` before the first.
    pub age_s: Option<f64>,
    /// The volumes of the running protocol; `null` if it counts none.
    pub scan: Option<ScanProgress>,
}

impl ScannerStatus {
    /// From the newest message of the line, and the running protocol's volumes; `None` where
    /// nothing was ever seen of the scanner.
    pub(super) fn new(
        pulse: Option<&ScannerPulse>,
        scan: Option<ScanProgress>,
        now_ns: u64,
    ) -> Option<Self> {
        if pulse.is_none() && scan.is_none() {
            return None;
        }
        Some(Self {
            pulses: pulse.map_or(0, |pulse| pulse.pulses),
            glitches: pulse.map_or(0, |pulse| pulse.glitches),
            age_s: pulse.map(|pulse| now_ns.saturating_sub(pulse.at_ns) as f64 * 1e-9),
            scan,
        })
    }

    /// The line of the status.
    pub(super) fn line(&self) -> String {
        let mut line = match (self.pulses, self.age_s) {
            (0, _) | (_, None) => "scanner   no pulse".to_owned(),
            (pulses, Some(age_s)) => {
                format!("scanner   {pulses} pulses, the last {age_s:.1} s ago")
            }
        };
        if self.glitches > 0 {
            line += &format!(", {} too SHORT to count", self.glitches);
        }
        if let Some(scan) = &self.scan {
            line += &format!("; {scan}");
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_NS: u64 = 100_000_000_000;

    fn line(pulse: Option<ScannerPulse>, scan: Option<ScanProgress>) -> Option<String> {
        let status = ScannerStatus::new(pulse.as_ref(), scan, NOW_NS);
        status.map(|status| status.line())
    }

    #[test]
    fn the_line_tells_pulses_volumes_and_what_is_wrong() {
        assert_eq!(line(None, None), None);
        let pulse =
            ScannerPulse { pulses: 12, at_ns: NOW_NS - 400_000_000, ..ScannerPulse::default() };
        let text = "scanner   12 pulses, the last 0.4 s ago";
        assert_eq!(line(Some(pulse), None).as_deref(), Some(text));
        let scan = ScanProgress { volumes: 12, expected: 300, ..ScanProgress::default() };
        let expected = format!("{text}; 12 of 300 volumes");
        assert_eq!(line(Some(pulse), Some(scan)), Some(expected));
        let worse = ScanProgress { missed: 2, spurious: 1, overdue: 3, ..scan };
        let expected =
            format!("{text}; 14 of 300 volumes, 2 without a pulse, 1 spurious pulses, 3 OVERDUE");
        assert_eq!(line(Some(pulse), Some(worse)), Some(expected));
        let short = ScannerPulse { pulses: 0, glitches: 7, ..pulse };
        let expected = "scanner   no pulse, 7 too SHORT to count";
        assert_eq!(line(Some(short), None).as_deref(), Some(expected));
        let emulated = ScanProgress { volumes: 5, ..ScanProgress::default() };
        let expected = "scanner   no pulse; 5 volumes";
        assert_eq!(line(None, Some(emulated)).as_deref(), Some(expected));
    }
}
