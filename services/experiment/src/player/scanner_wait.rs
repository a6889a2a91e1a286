//! The scanner in a protocol: segments that wait for its pulse.

use ipc_types::{AXES, LineEvent};
use rig::protocol::Movement;

use super::reports::Reason;
use super::{Change, LEASE_NS, Player, Program, seconds};
use crate::scan_tracker::{ScanReport, ScanState, WaitState};

impl Player {
    /// Takes an event of the scanner's trigger line before a step; `at_ns` is when it happened
    /// (CLOCK_MONOTONIC).
    pub fn see_scanner(&mut self, event: LineEvent, at_ns: u64) {
        if self.is_running() {
            self.scan.see(event, at_ns);
        }
    }

    /// Takes a pulse that was typed as the key 5, before a step; `at_ns` is when it was pressed
    /// (CLOCK_MONOTONIC).
    pub fn see_scanner_key(&mut self, at_ns: u64) {
        if self.is_running() {
            self.scan.see_key(at_ns);
        }
    }

    /// Whether another event of the line can be taken: there is room for what it makes known.
    pub fn can_see_scanner(&self) -> bool {
        self.scan.has_room()
    }

    /// Whether reports on the scan wait to be taken.
    pub fn has_scan_reports(&self) -> bool {
        self.scan.has_reports()
    }

    /// Takes the oldest report on the scan.
    pub fn take_scan_report(&mut self) -> Option<ScanReport> {
        self.scan.take_report()
    }

    /// Reports on the scan that were lost, as nobody took them.
    pub const fn scan_reports_dropped(&self) -> u64 {
        self.scan.dropped()
    }

    /// Time since the beginning of the scanner's volume at `at_ns`, and its repetition time (s);
    /// `None` where none measures.
    pub fn since_volume_s(&self, at_ns: u64) -> Option<(f64, f64)> {
        self.scan.since_volume_s(at_ns)
    }

    /// The scanner, as far as it was followed.
    pub const fn scan_state(&self) -> ScanState {
        self.scan.state()
    }

    /// Begins to follow the scanner, with a protocol or with the segment that goes on.
    pub(super) fn begin_scan(
        &mut self,
        program: &Program,
        segment: usize,
        change: Change,
        now_ns: u64,
    ) {
        match (change, program.continues()) {
            (Change::Started, _) => self.scan.begin(&program.scan, now_ns),
            (Change::Continued(_), Some(from)) => {
                self.scan.go_on(from.scan, &program.scan.pulses, now_ns);
                self.scan.catch_up(now_ns);
            }
            _ => self.scan.catch_up(now_ns),
        }
        self.begin_wait(program, segment, now_ns);
    }

    /// Begins to wait for the scanner, if that is what the segment does.
    pub(super) fn begin_wait(&mut self, program: &Program, segment: usize, begun_ns: u64) {
        if let Some(step) = program.steps.get(segment)
            && let Movement::WaitForScanner(how) = &step.track.movement
        {
            self.scan.begin_wait(how, segment as u32, begun_ns);
        }
    }

    /// What a wait has come to: `Ok` with the segment's end (ns), a change where the protocol ends;
    /// `None` for another segment.
    pub(super) fn await_scanner(
        &mut self,
        program: &Program,
        segment: usize,
        begun_ns: u64,
        now_ns: u64,
        measured: &[f64; AXES],
    ) -> Option<Result<u64, Option<Change>>> {
        let step = program.steps.get(segment)?;
        let Movement::WaitForScanner(how) = &step.track.movement else { return None };
        Some(match self.scan.wait(how, now_ns) {
            WaitState::Waiting => Err(None),
            WaitState::Over(edge_ns) => {
                // After a long pause the next segment begins now, and whole.
                let late = now_ns.saturating_sub(edge_ns) > LEASE_NS;
                let edge_ns = if late { now_ns } else { edge_ns };
                self.early_s += step.track.duration_s() - seconds(begun_ns, edge_ns);
                Ok(edge_ns)
            }
            WaitState::TimedOut => {
                Err(Some(self.let_go(program, segment, Reason::NoScanner, measured)))
            }
        })
    }
}
