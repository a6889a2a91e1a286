//! Follows the scanner through a protocol: the pulse that a wait is for, the numbers of the
//! volumes, and segments that keep to the scanner's clock.

mod kept;

use std::collections::VecDeque;

use ipc_types::{LineEvent, ScanProgress, Volume, VolumeSource};
use rig::protocol::WaitForScanner;
use scanner::{Counted, VolumeClock, between};
use serde::{Deserialize, Serialize};

use crate::scan_plan::{Pulses, ScanPlan};
pub use crate::scan_report::{ScanReport, WaitState};

/// Reports that wait to be published. Pulses are taken while there is room for twice as many as one
/// can make.
const REPORTS: usize = 256;
/// Pulses of an emulated scanner, or of an open gate, that are taken in one cycle.
const PULSES_AT_ONCE: u32 = 1000;
/// Volumes without a pulse that are reported one by one; what is beyond is in the counts.
const INTERPOLATED: usize = 64;
/// Time after a resumption in which the pulses since the segment's beginning arrive (ns); until
/// then nothing is concluded from their absence.
const CATCH_UP_NS: u64 = 1_500_000_000;
/// A scanner that has sent no pulse for so many volumes has stopped.
const SILENT_VOLUMES: f64 = 4.0;
/// An open gate is believed to be open as long ago as this, beyond the least width of a level (ns).
const GATE_DELAY_NS: u64 = 20_000_000;
/// Time from the beginning of a wait, or of a protocol without one, to the first pulse of the
/// emulated scanner (ns).
const EMULATED_START_NS: u64 = 1_000_000_000;
/// A segment's end is at most so much earlier or later than planned, and this share of its duration
/// (s). What is more is left for the segments after it; an early end cuts the movement short.
const EARLIER_S: f64 = 0.002;
const LATER_S: f64 = 0.02;
const SLACK_SHARE: f64 = 1e-3;

/// A wait for a pulse.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Wait {
    /// The segment that waits.
    segment: u32,
    since_ns: u64,
    /// Number of the pulse that is waited for, from 1.
    pulse: u64,
    /// Pulses that have come.
    pulses: u64,
    start_up_ns: u64,
    /// End of the start-up time, once the pulse has come.
    ends_ns: Option<u64>,
}

/// Where the plan lies on the scanner's clock.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Anchor {
    /// Volumes, and the fraction of one, that had passed at the anchor.
    volume: f64,
    /// Planned time since then, at the beginning of the running segment (s).
    planned_s: f64,
}

/// How far the emulated scanner has come.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Emulation {
    /// First volume; negative where the computer has been started since.
    first_ns: i64,
    /// The newest pulse, from the first volume (s); `None` before the first one.
    newest_s: Option<f64>,
}

/// The part of [`ScanTracker`] that outlives the process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScanState {
    clock: Option<VolumeClock>,
    in_step: bool,
    /// How long ago a gate must have been open for its volumes to count (ns); `None`: no gate.
    gate_delay_ns: Option<u64>,
    /// Pulses before this are none of this protocol's; `None`: it does not count yet.
    counts_since_ns: Option<u64>,
    /// The newest pulse that was taken.
    newest_ns: u64,
    /// When the newest volume began, and where that is known from.
    volume_ns: u64,
    volume_source: u8,
    /// When the next volume of an open gate begins.
    gate_next: Option<f64>,
    /// The emulated scanner, once it is started.
    emulation: Option<Emulation>,
    wait: Option<Wait>,
    anchor: Option<Anchor>,
}

impl ScanState {
    /// The newest pulse that was taken (ns, CLOCK_MONOTONIC); 0 before the first.
    pub const fn newest_ns(&self) -> u64 {
        self.newest_ns
    }

    /// The same where all times are later by this (ns): by the clock of another start of the
    /// computer. A wait begins anew, as does the plan.
    pub(crate) fn shifted(self, by_ns: i64) -> Self {
        let later = |at_ns: u64| at_ns.saturating_add_signed(by_ns);
        Self {
            clock: self.clock.map(|clock| clock.shifted(by_ns)),
            counts_since_ns: self.counts_since_ns.map(later),
            newest_ns: later(self.newest_ns),
            volume_ns: later(self.volume_ns),
            gate_next: None,
            emulation: self.emulation.map(|emulation| Emulation {
                first_ns: emulation.first_ns.saturating_add(by_ns),
                ..emulation
            }),
            wait: None,
            anchor: None,
            ..self
        }
    }
}

/// Follows the scanner through one run of a protocol. Allocates only when it is made.
#[derive(Clone, Debug)]
pub struct ScanTracker {
    state: ScanState,
    pulses: Pulses,
    /// Pulses of the time before may still arrive until then (ns).
    catches_up_until_ns: u64,
    reports: VecDeque<ScanReport>,
    dropped: u64,
}

impl Default for ScanTracker {
    /// One that follows nothing.
    fn default() -> Self {
        Self::resume(ScanState::default(), Pulses::default())
    }
}

impl ScanTracker {
    /// Goes on where an earlier process stopped.
    pub fn resume(state: ScanState, pulses: Pulses) -> Self {
        let reports = VecDeque::with_capacity(REPORTS);
        Self { state, pulses, catches_up_until_ns: 0, reports, dropped: 0 }
    }

    /// Forgets the protocol before; what was dropped stays counted. Allocates nothing.
    pub fn clear(&mut self) {
        self.state = ScanState::default();
        self.pulses = Pulses::default();
        self.catches_up_until_ns = 0;
        self.dropped += self.reports.len() as u64;
        self.reports.clear();
    }

    /// Goes on with a protocol that was interrupted: what the scanner did meanwhile, nobody has
    /// seen. Allocates nothing.
    pub fn go_on(&mut self, state: ScanState, pulses: &Pulses, now_ns: u64) {
        self.clear();
        (self.state, self.pulses) = (state, pulses.clone());
        // Where the computer's clock was set back, what is past by all that is known lies ahead.
        let state = &mut self.state;
        state.newest_ns = state.newest_ns.min(now_ns);
        state.volume_ns = state.volume_ns.min(now_ns);
        state.counts_since_ns = state.counts_since_ns.map(|since_ns| since_ns.min(now_ns));
        if let Some(emulation) = &mut state.emulation {
            emulation.first_ns = emulation.first_ns.min(now_ns.cast_signed());
            let passed_ns = now_ns.cast_signed().saturating_sub(emulation.first_ns);
            emulation.newest_s = Some(passed_ns as f64 * 1e-9);
        }
    }

    /// Begins a protocol at `now_ns` (CLOCK_MONOTONIC), as all times here.
    pub fn begin(&mut self, plan: &ScanPlan, now_ns: u64) {
        self.pulses = plan.pulses.clone();
        self.state = ScanState {
            clock: plan.scan.map(|scan| VolumeClock::new(scan.series)),
            in_step: plan.scan.is_some_and(|scan| scan.in_step),
            gate_delay_ns: plan
                .gate_width_s
                .filter(|_| self.pulses == Pulses::Line)
                .map(|width_s| (1e9 * width_s).round() as u64 + GATE_DELAY_NS),
            ..ScanState::default()
        };
        if !plan.waits {
            self.count_from(now_ns);
        }
    }

    fn count_from(&mut self, since_ns: u64) {
        if self.state.counts_since_ns.is_none() {
            self.state.counts_since_ns = Some(since_ns);
            if matches!(self.pulses, Pulses::Emulated(_)) {
                let first_ns = (since_ns + EMULATED_START_NS).cast_signed();
                self.state.emulation = Some(Emulation { first_ns, newest_s: None });
            }
        }
    }

    /// Begins to wait in a segment; goes on if it does so already.
    pub fn begin_wait(&mut self, how: &WaitForScanner, segment: u32, since_ns: u64) {
        if self.state.wait.is_some_and(|wait| wait.segment == segment) {
            return;
        }
        self.count_from(since_ns);
        let start_up_ns = (1e9 * how.start_up_s).round() as u64;
        let (pulse, pulses, ends_ns) = (how.pulse, 0, None);
        self.state.wait = Some(Wait { segment, since_ns, pulse, pulses, start_up_ns, ends_ns });
    }

    /// What the wait has come to; `Waiting` where none is under way.
    pub fn wait(&self, how: &WaitForScanner, now_ns: u64) -> WaitState {
        let Some(wait) = &self.state.wait else { return WaitState::Waiting };
        match wait.ends_ns {
            Some(ends_ns) if now_ns >= ends_ns => WaitState::Over(ends_ns),
            None if now_ns >= self.catches_up_until_ns
                && now_ns.saturating_sub(wait.since_ns) as f64 >= 1e9 * how.timeout_s =>
            {
                WaitState::TimedOut
            }
            _ => WaitState::Waiting,
        }
    }

    /// Takes a pulse that was typed as the key 5; not where pulses come from elsewhere.
    pub fn see_key(&mut self, at_ns: u64) {
        if self.pulses == Pulses::Key {
            self.pulse(at_ns, VolumeSource::Key);
        }
    }

    /// Takes an event of the trigger line; not where pulses come from elsewhere.
    pub fn see(&mut self, event: LineEvent, at_ns: u64) {
        if self.pulses != Pulses::Line {
            return;
        }
        match event {
            LineEvent::Pulse => {
                self.pulse(at_ns, VolumeSource::Pulse);
                if let (Some(_), Some(clock)) = (self.state.gate_delay_ns, &self.state.clock) {
                    self.state.gate_next = Some(at_ns as f64 + 1e9 * clock.series().repetition_s);
                }
            }
            LineEvent::GateEnd => {
                self.gate_volumes(at_ns);
                self.state.gate_next = None;
            }
            LineEvent::Glitch => {}
        }
    }

    /// Takes the pulses of the emulated scanner, and the volumes of an open gate, up to now.
    pub fn advance(&mut self, now_ns: u64) {
        let mut left = PULSES_AT_ONCE;
        while left > 0
            && self.has_room()
            && let Pulses::Emulated(emulator) = &self.pulses
            && let Some(emulation) = &mut self.state.emulation
            && let newest_s = emulation.newest_s.unwrap_or(f64::NEG_INFINITY)
            && let Some(next_s) = emulator.next_pulse_s(newest_s)
            && let at_ns = emulation.first_ns.saturating_add((1e9 * next_s).round() as i64)
            && at_ns <= now_ns.cast_signed()
        {
            left -= 1;
            emulation.newest_s = Some(next_s);
            self.pulse(at_ns.max(0).cast_unsigned(), VolumeSource::Emulated);
        }
        if let Some(delay_ns) = self.state.gate_delay_ns
            && now_ns >= self.catches_up_until_ns
        {
            self.gate_volumes(now_ns.saturating_sub(delay_ns));
        }
    }

    /// Takes the volumes of an open gate that begin before `until_ns`.
    fn gate_volumes(&mut self, until_ns: u64) {
        let mut left = PULSES_AT_ONCE;
        while left > 0
            && self.has_room()
            && let (Some(next), Some(clock)) = (self.state.gate_next, &self.state.clock)
            && next < until_ns as f64
        {
            left -= 1;
            self.state.gate_next = Some(next + 1e9 * clock.series().repetition_s);
            self.pulse(next.round() as u64, VolumeSource::Gate);
        }
    }

    /// Time since the beginning of the volume at `at_ns` and the repetition time that was planned
    /// (s), by the scanner's clock. `None` where no scanner measures, or an emulated one, and for
    /// pulses from a keyboard: they come some milliseconds late, now more and now less, and what is
    /// subtracted in step with them would not fit.
    pub fn since_volume_s(&self, at_ns: u64) -> Option<(f64, f64)> {
        let clock = self.state.clock.as_ref().filter(|_| self.pulses == Pulses::Line)?;
        let (volume, last) = (clock.volume_at(at_ns)?, clock.index()? as f64);
        let repetition_s = clock.series().repetition_s;
        (0.0..SILENT_VOLUMES)
            .contains(&(volume - last))
            .then(|| (volume.fract() * repetition_s, repetition_s))
    }

    /// Whether a pulse could be taken now, with all that it may make known.
    pub fn has_room(&self) -> bool {
        self.reports.len() + 2 * INTERPOLATED < REPORTS
    }

    fn pulse(&mut self, at_ns: u64, source: VolumeSource) {
        let counts = self.state.counts_since_ns.is_some_and(|since_ns| at_ns >= since_ns);
        if !counts || at_ns <= self.state.newest_ns {
            return;
        }
        self.state.newest_ns = at_ns;
        self.count_for_wait(at_ns);
        let Some(clock) = &mut self.state.clock else { return };
        let last = clock.index().unwrap_or(0);
        match clock.pulse(at_ns) {
            Counted::Volume { index, missed } => {
                self.interpolate(index, missed, at_ns);
                self.report_volume(index, at_ns, source);
            }
            Counted::Replaces { index } => {
                self.report_volume(index, at_ns, source);
                self.report(ScanReport::Spurious { after: last });
            }
            Counted::Restarted { index, first_ns } => {
                // The plan goes on from here, by whatever clock.
                self.state.anchor = None;
                self.report(ScanReport::Restarted { first: index - 1 });
                self.report_volume(index - 1, first_ns, source);
                self.report_volume(index, at_ns, source);
                self.restart_wait(first_ns, at_ns);
            }
            Counted::Spurious => {
                self.report(ScanReport::Spurious { after: last });
                self.report_counts(last);
            }
            Counted::Surplus => self.report_counts(last),
        }
    }

    /// Reports the newest volume again, for the counts that have changed.
    fn report_counts(&mut self, last: u64) {
        let source = VolumeSource::from_code(self.state.volume_source);
        let (at_ns, source) = (self.state.volume_ns, source.unwrap_or(VolumeSource::Pulse));
        self.report_volume(last, at_ns, source);
    }

    /// Reports volumes without a pulse, before volume `index`.
    fn interpolate(&mut self, index: u64, missed: u64, at_ns: u64) {
        if missed == 0 {
            return;
        }
        let first = index - missed;
        self.report(ScanReport::Missed { first, count: missed });
        if self.state.volume_ns == 0 {
            // The volume before was in another life of the computer.
            return;
        }
        let times = between(self.state.volume_ns, at_ns, missed);
        for (index, between_ns) in (first..).zip(times.take(INTERPOLATED)) {
            self.report_volume(index, between_ns, VolumeSource::Interpolated);
        }
    }

    fn report_volume(&mut self, index: u64, at_ns: u64, source: VolumeSource) {
        (self.state.volume_ns, self.state.volume_source) = (at_ns, source.code());
        let Some(clock) = &self.state.clock else { return };
        let counts = clock.counts();
        self.report(ScanReport::Volume(Volume {
            index,
            at_ns,
            expected: clock.series().volumes.unwrap_or(0),
            volumes: counts.volumes,
            missed: counts.missed,
            spurious: counts.spurious,
            surplus: counts.surplus,
            restarts: counts.restarts,
            repetition_s: clock.repetition_s(),
            source: source.code(),
            ..Volume::default()
        }));
    }

    fn report(&mut self, report: ScanReport) {
        if self.reports.len() < REPORTS {
            self.reports.push_back(report);
        } else {
            self.dropped += 1;
        }
    }

    /// Counts a pulse for the wait: whatever it is, the scanner has sent it.
    fn count_for_wait(&mut self, at_ns: u64) {
        let Some(wait) = &mut self.state.wait else { return };
        if wait.ends_ns.is_some() || at_ns < wait.since_ns {
            return;
        }
        wait.pulses += 1;
        if wait.pulses >= wait.pulse {
            self.end_wait(at_ns);
        }
    }

    /// The scanner was started anew during the wait, or its first pulse was none: the wait counts
    /// from the two pulses that showed it.
    fn restart_wait(&mut self, first_ns: u64, at_ns: u64) {
        let Some(wait) = &mut self.state.wait else { return };
        if first_ns < wait.since_ns {
            return;
        }
        (wait.pulses, wait.ends_ns) = (2, None);
        match wait.pulse {
            1 => self.end_wait(first_ns),
            2 => self.end_wait(at_ns),
            _ => {}
        }
    }

    /// The pulse that the wait is for came at `at_ns`.
    fn end_wait(&mut self, at_ns: u64) {
        let Some(wait) = &mut self.state.wait else { return };
        wait.ends_ns = Some(at_ns + wait.start_up_ns);
        let after_s = at_ns.saturating_sub(wait.since_ns) as f64 * 1e-9;
        self.report(ScanReport::Started { after_s });
    }

    /// When the running segment ends that is planned to end at `planned_ns` after `duration_s`: by
    /// the scanner's clock, if the protocol keeps in step with it.
    pub fn edge_ns(&self, planned_ns: u64, duration_s: f64) -> u64 {
        let (Some(anchor), Some(clock)) = (&self.state.anchor, &self.state.clock) else {
            return planned_ns;
        };
        let passed = (anchor.planned_s + duration_s) / clock.series().repetition_s;
        let Some(at_ns) = clock.time_ns(anchor.volume + passed) else { return planned_ns };
        let slack_ns = |most_s: f64| (1e9 * (most_s + SLACK_SHARE * duration_s)) as u64;
        let earliest_ns = planned_ns.saturating_sub(slack_ns(EARLIER_S));
        at_ns.clamp(earliest_ns, planned_ns.saturating_add(slack_ns(LATER_S)))
    }

    /// A segment has ended at `edge_ns`; `planned_s` is its duration where it had all of it.
    pub fn pass_edge(&mut self, edge_ns: u64, planned_s: Option<f64>) {
        self.state.wait = None;
        let ScanState { clock: Some(clock), in_step: true, .. } = &self.state else { return };
        self.state.anchor = match (self.state.anchor, planned_s) {
            (Some(anchor), Some(planned_s)) => {
                Some(Anchor { planned_s: anchor.planned_s + planned_s, ..anchor })
            }
            _ => clock.volume_at(edge_ns).map(|volume| Anchor { volume, planned_s: 0.0 }),
        };
    }

    /// The segment begins again: the plan goes on from its next edge.
    pub const fn pause(&mut self) {
        self.state.anchor = None;
    }

    /// The segment begins again in another process, which the pulses since its beginning are still
    /// to reach.
    pub const fn catch_up(&mut self, now_ns: u64) {
        self.pause();
        self.catches_up_until_ns = now_ns + CATCH_UP_NS;
    }

    /// Whether reports wait to be published.
    pub fn has_reports(&self) -> bool {
        !self.reports.is_empty()
    }

    /// Takes the oldest report.
    pub fn take_report(&mut self) -> Option<ScanReport> {
        self.reports.pop_front()
    }

    /// Reports that were lost because too many waited.
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// What an interrupted protocol needs to go on.
    pub const fn state(&self) -> ScanState {
        self.state
    }

    /// The volumes so far; `None` for a protocol that counts none.
    pub fn progress(&self, now_ns: u64) -> Option<ScanProgress> {
        let clock = self.state.clock.as_ref()?;
        let counts = clock.counts();
        Some(ScanProgress {
            volumes: counts.volumes,
            expected: clock.series().volumes.unwrap_or(0),
            missed: counts.missed,
            spurious: counts.spurious,
            surplus: counts.surplus,
            overdue: clock.overdue(now_ns),
        })
    }
}
