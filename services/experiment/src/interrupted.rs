//! A protocol with sessions that did not run to its end, kept on disk: it can be continued with the
//! session that was interrupted, also after the whole computer has died.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use files::{Format, FormatError};
use runtime::clock::ClockPair;
use serde::{Deserialize, Serialize};

use crate::scan_tracker::ScanState;
use crate::session_state::SessionState;
use crate::state::PlayerState;

const FORMAT: Format = Format { what: "interrupted protocol", mark: *b"FRPI", version: 2 };
/// Where the two clocks differ by less from before, the computer has not been started since (ns).
const SAME_START_NS: u64 = 1_000_000_000;

/// Where a protocol is continued.
#[derive(Clone, Debug, PartialEq)]
pub struct Continuation {
    /// Index of the segment.
    pub segment: u32,
    /// The scanner, as far as it was followed, in times of this start of the computer.
    pub scan: ScanState,
    /// The sessions so far.
    pub sessions: SessionState,
}

/// A protocol that was interrupted, with the clocks by which its times can be understood after
/// another start of the computer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interrupted {
    /// What was being played.
    pub state: PlayerState,
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC` then (ns).
    offset_ns: i64,
}

impl Interrupted {
    /// What is being played now.
    pub fn new(state: PlayerState, clocks: &ClockPair) -> Self {
        Self { state, offset_ns: clocks.offset_ns() }
    }

    /// What is in the bytes of a file.
    fn decode(bytes: &[u8]) -> Result<Self, FormatError> {
        let Self { state, offset_ns } = FORMAT.decode(bytes)?;
        Ok(Self { state: state.checked(FORMAT.what)?, offset_ns })
    }

    /// Where it is continued, by the clocks of now. As the scanner may have gone on, its volumes
    /// are counted on.
    pub fn continuation(&self, clocks: &ClockPair) -> Continuation {
        let by_ns = self.offset_ns.saturating_sub(clocks.offset_ns());
        let same_start = by_ns.unsigned_abs() < SAME_START_NS;
        Continuation {
            segment: self.state.segment,
            scan: self.state.scan.shifted(if same_start { 0 } else { by_ns }),
            sessions: self.state.sessions.clone(),
        }
    }
}

/// The file of a rig's interrupted protocol.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InterruptedFile(PathBuf);

impl InterruptedFile {
    /// In the folder of what outlasts the rig.
    pub fn new(folder: &Path, rig_name: &str) -> Self {
        Self(folder.join(format!("{rig_name}.interrupted")))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Keeps a protocol, whole or not at all.
    ///
    /// # Errors
    /// In words.
    pub fn keep(&self, interrupted: &Interrupted) -> Result<(), String> {
        let told = |error: &dyn std::fmt::Display| format!("{}: {error}", self.0.display());
        let bytes = FORMAT.encode(interrupted).map_err(|error| told(&error))?;
        if let Some(folder) = self.0.parent() {
            fs::create_dir_all(folder).map_err(|error| told(&error))?;
        }
        files::replace(&self.0, bytes).map_err(|error| told(&error))
    }

    /// Removes it: the protocol ran to its end.
    ///
    /// # Errors
    /// In words.
    pub fn remove(&self) -> Result<(), String> {
        match fs::remove_file(&self.0) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(format!("{}: {error}", self.0.display()))
            }
            _ => Ok(()),
        }
    }

    /// The protocol that was interrupted; `None` where there is none.
    ///
    /// # Errors
    /// In words: it cannot be read, is damaged, or of another version.
    pub fn read(&self) -> Result<Option<Interrupted>, String> {
        let path = self.0.display();
        match fs::read(&self.0) {
            Ok(bytes) => Interrupted::decode(&bytes).map(Some).map_err(|error| {
                format!("{path}: {error}; delete the file and start the protocol anew")
            }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(format!("{path}: {error}")),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use ipc_types::{LineEvent, PulseSource};
    use rig::protocol::Scan;
    use scanner::Series;

    use super::*;
    use crate::scan_plan::{Pulses, ScanPlan};
    use crate::scan_tracker::{ScanReport, ScanTracker};

    fn interrupted() -> Interrupted {
        let state = PlayerState {
            session: 7,
            name: "demo".to_owned(),
            text: "[protocol]\n".to_owned(),
            protocol: 9,
            segment: 4,
            running: true,
            epoch: 2,
            client: 11,
            pulses: PulseSource::Key,
            scan: ScanState::default(),
            keys: vec![3, 5],
            sessions: SessionState { over: 2, target: [0.25, 0.5], ..SessionState::default() },
        };
        let clocks = ClockPair {
            monotonic_ns: 1_000_000_000_000,
            realtime_ns: 1_700_000_000_000_000_000,
            uncertainty_ns: 0,
        };
        Interrupted::new(state, &clocks)
    }

    #[test]
    fn it_is_kept_read_and_removed() {
        let folder = tempfile::tempdir().unwrap();
        let file = InterruptedFile::new(&folder.path().join("state"), "rig-a");
        assert_eq!(file.read(), Ok(None));
        file.keep(&interrupted()).unwrap();
        assert_eq!(file.read().unwrap().unwrap(), interrupted());
        let mut bytes = fs::read(file.path()).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        fs::write(file.path(), bytes).unwrap();
        assert!(file.read().unwrap_err().contains("delete the file"));
        file.remove().unwrap();
        assert_eq!((file.read(), file.remove()), (Ok(None), Ok(())));
    }

    /// The computer was started again, 100 s before now by its new clock, 1000 s after the first
    /// volume: the volumes are counted on from that one.
    #[test]
    fn the_scanner_is_followed_across_a_start_of_the_computer() {
        const SECOND: u64 = 1_000_000_000;
        let plan = ScanPlan {
            scan: Some(Scan { series: Series::new(2.0, None), in_step: true }),
            ..ScanPlan::default()
        };
        let clocks = |monotonic_s: u64, realtime_s: u64| ClockPair {
            monotonic_ns: monotonic_s * SECOND,
            realtime_ns: realtime_s * SECOND,
            uncertainty_ns: 0,
        };
        let mut tracker = ScanTracker::default();
        tracker.begin(&plan, 5_000 * SECOND);
        (0..20).for_each(|volume| tracker.see(LineEvent::Pulse, (5_001 + 2 * volume) * SECOND));
        let state = PlayerState { scan: tracker.state(), ..interrupted().state };
        let interrupted = Interrupted::new(state, &clocks(5_040, 1_700_000_040));
        let now = clocks(100, 1_700_001_001);
        let from = interrupted.continuation(&now);
        tracker.go_on(from.scan, &Pulses::Line, now.monotonic_ns);
        tracker.catch_up(now.monotonic_ns);
        while tracker.take_report().is_some() {}
        // The first pulse was at 1,700,000,001 s; this one is 1002 s later.
        tracker.see(LineEvent::Pulse, 102 * SECOND);
        tracker.see(LineEvent::Pulse, 104 * SECOND);
        let reports: Vec<_> = std::iter::from_fn(|| tracker.take_report()).collect();
        let volume = |report: &ScanReport| match report {
            ScanReport::Volume(volume) => Some((volume.index, volume.at_ns)),
            _ => None,
        };
        let volumes: Vec<_> = reports.iter().filter_map(volume).collect();
        assert_eq!(volumes, [(501, 102 * SECOND), (502, 104 * SECOND)], "{reports:?}");
        assert!(reports.contains(&ScanReport::Missed { first: 20, count: 481 }), "{reports:?}");
        // Within the same start of the computer the clocks may drift apart a little.
        let same = interrupted.continuation(&clocks(5_100, 1_700_000_100));
        assert_eq!(same.scan, interrupted.state.scan.shifted(0));
    }
}
