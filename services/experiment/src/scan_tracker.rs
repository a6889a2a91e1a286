//! Follows the scanner through a protocol: the pulse that a wait is for, the numbers of the
//! volumes, and segments that keep to the scanner's clock.

use std::collections::VecDeque;

use ipc_types::{LineEvent, ScanProgress, Volume, VolumeSource};
use rig::protocol::{Scan, WaitForScanner};
use scanner::{Counted, VolumeClock, between};
use serde::{Deserialize, Serialize};

/// Reports that wait to be published. Pulses are taken while there is room for twice as many as one
/// can make.
const REPORTS: usize = 256;
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

/// What a protocol says of the scanner, and how the rig reads it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanPlan {
    /// What is expected of the scan.
    pub scan: Option<Scan>,
    /// Whether a segment waits for the scanner; volumes count from the first such wait.
    pub waits: bool,
    /// Least width of a level of the trigger line, if that is a gate (s).
    pub gate_width_s: Option<f64>,
    /// Repetition time of the emulated scanner, which then takes the place of the line (s).
    pub emulated_s: Option<f64>,
}

/// What is to be published.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ScanReport {
    /// A volume began.
    Volume(Volume),
    /// The pulse that a wait was for came, this long after the wait began (s).
    Started {
        /// Time since the wait began (s).
        after_s: f64,
    },
    /// Volumes had no pulse.
    Missed {
        /// Number of the first of them.
        first: u64,
        /// How many.
        count: u64,
    },
    /// A pulse belongs to no volume.
    Spurious {
        /// Number of the last volume.
        after: u64,
    },
    /// The scanner was started anew.
    Restarted {
        /// Number of the first volume since.
        first: u64,
    },
}

/// What a wait has come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitState {
    /// The pulse, or the end of the start-up time, has not come.
    Waiting,
    /// The start-up time was over at that time (ns).
    Over(u64),
    /// No pulse came in time.
    TimedOut,
}

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

/// The emulated scanner.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Emulation {
    repetition_ns: f64,
    /// First pulse; `None` before it is started.
    first_ns: Option<u64>,
    next: u64,
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
    emulation: Option<Emulation>,
    wait: Option<Wait>,
    anchor: Option<Anchor>,
}

/// Follows the scanner through one run of a protocol. Allocates only when it is made.
#[derive(Clone, Debug)]
pub struct ScanTracker {
    state: ScanState,
    /// Pulses of the time before may still arrive until then (ns).
    catches_up_until_ns: u64,
    reports: VecDeque<ScanReport>,
    dropped: u64,
}

impl Default for ScanTracker {
    /// One that follows nothing.
    fn default() -> Self {
        Self::resume(ScanState::default())
    }
}

impl ScanTracker {
    /// Goes on where an earlier process stopped.
    pub fn resume(state: ScanState) -> Self {
        let reports = VecDeque::with_capacity(REPORTS);
        Self { state, catches_up_until_ns: 0, reports, dropped: 0 }
    }

    /// Forgets the protocol before; what was dropped stays counted. Allocates nothing.
    pub fn clear(&mut self) {
        self.state = ScanState::default();
        self.catches_up_until_ns = 0;
        self.dropped += self.reports.len() as u64;
        self.reports.clear();
    }

    /// Begins a protocol at `now_ns` (CLOCK_MONOTONIC), as all times here.
    pub fn begin(&mut self, plan: &ScanPlan, now_ns: u64) {
        let emulation = plan.emulated_s.map(|repetition_s| Emulation {
            repetition_ns: 1e9 * repetition_s,
            first_ns: None,
            next: 0,
        });
        self.state = ScanState {
            clock: plan.scan.map(|scan| VolumeClock::new(scan.series)),
            in_step: plan.scan.is_some_and(|scan| scan.in_step),
            gate_delay_ns: plan
                .gate_width_s
                .map(|width_s| (1e9 * width_s).round() as u64 + GATE_DELAY_NS),
            emulation,
            ..ScanState::default()
        };
        if !plan.waits {
            self.count_from(now_ns);
        }
    }

    fn count_from(&mut self, since_ns: u64) {
        if self.state.counts_since_ns.is_none() {
            self.state.counts_since_ns = Some(since_ns);
            if let Some(emulation) = &mut self.state.emulation {
                emulation.first_ns = Some(since_ns + EMULATED_START_NS);
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

    /// Takes an event of the trigger line; not where the scanner is emulated.
    pub fn see(&mut self, event: LineEvent, at_ns: u64) {
        if self.state.emulation.is_some() {
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
        while self.has_room()
            && let Some(emulation) = &mut self.state.emulation
            && let Some(first_ns) = emulation.first_ns
            && let after_ns = emulation.next as f64 * emulation.repetition_ns
            && let at_ns = first_ns + after_ns.round() as u64
            && at_ns <= now_ns
        {
            emulation.next += 1;
            self.pulse(at_ns, VolumeSource::Emulated);
        }
        if let Some(delay_ns) = self.state.gate_delay_ns
            && now_ns >= self.catches_up_until_ns
        {
            self.gate_volumes(now_ns.saturating_sub(delay_ns));
        }
    }

    /// Takes the volumes of an open gate that begin before `until_ns`.
    fn gate_volumes(&mut self, until_ns: u64) {
        while self.has_room()
            && let (Some(next), Some(clock)) = (self.state.gate_next, &self.state.clock)
            && next < until_ns as f64
        {
            self.state.gate_next = Some(next + 1e9 * clock.series().repetition_s);
            self.pulse(next.round() as u64, VolumeSource::Gate);
        }
    }

    /// Time since the beginning of the volume at `at_ns` and the repetition time that was planned
    /// (s), by the scanner's clock; `None` where no scanner measures, or an emulated one.
    pub fn since_volume_s(&self, at_ns: u64) -> Option<(f64, f64)> {
        let clock = self.state.clock.as_ref().filter(|_| self.state.emulation.is_none())?;
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
