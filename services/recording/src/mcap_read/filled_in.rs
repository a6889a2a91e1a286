//! Ticks that the simulated card filled in: it was not run in time, and simulated them in a burst.

use ipc_types::{CARD_SCAN, CardKind, SAMPLE, is_filled_in};

use crate::schema::{Layout, LayoutField, unsigned};

/// The scans that the simulated card took too late.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct FilledIn {
    /// Scans that were filled in.
    pub ticks: u64,
    /// Ticks of the longest stretch of them.
    pub longest: u64,
    /// Length of the longest stretch (ns).
    pub longest_ns: u64,
}

/// Follows the scans of one topic.
#[derive(Debug, Default)]
struct Stretches {
    seen: bool,
    found: FilledIn,
    newest_tick: Option<u64>,
    /// Ticks filled in without a pause up to the newest scan.
    running: u64,
}

impl Stretches {
    /// Takes a scan; `filled_in` is asked with the period of the grid (ns).
    fn take(&mut self, tick: u64, time_ns: u64, filled_in: impl Fn(u64) -> bool) {
        self.seen = true;
        let follows = self.newest_tick.is_some_and(|newest| newest.checked_add(1) == Some(tick));
        self.newest_tick = Some(tick);
        // Ticks are times divided by the period; the phase, at most a period, is lost in a million
        // of them.
        let period_ns = time_ns.checked_div(tick).unwrap_or(0);
        let filled = period_ns > 0 && filled_in(period_ns);
        self.running = match (filled, follows) {
            (false, _) => 0,
            (true, true) => self.running + 1,
            (true, false) => 1,
        };
        self.found.ticks += u64::from(filled);
        if self.running > self.found.longest {
            self.found.longest = self.running;
            self.found.longest_ns = self.running * period_ns;
        }
    }
}

/// When a message says that it was taken.
#[derive(Clone, Copy, Debug)]
pub(super) enum Taken {
    /// A scan of the simulated card.
    Scan { tick: u64, scan_ns: u64, published_ns: u64 },
    /// A sample of it, and whether it says that it was filled in; those of older builds do not.
    Sample { tick: u64, scan_ns: u64, mark: Option<u64> },
}

/// The fields of a channel by which scans are followed.
#[derive(Debug)]
pub(super) struct TakenFields<'a> {
    is_scan: bool,
    tick: &'a LayoutField,
    scan_ns: &'a LayoutField,
    published_ns: Option<&'a LayoutField>,
    backend: Option<&'a LayoutField>,
    mark: Option<&'a LayoutField>,
}

impl<'a> TakenFields<'a> {
    /// `None` for topics that are not followed.
    pub(super) fn of(topic: &str, layout: &'a Layout) -> Option<Self> {
        let is_scan = topic == CARD_SCAN.topic.name;
        if !is_scan && topic != SAMPLE.topic.name {
            return None;
        }
        Some(Self {
            is_scan,
            tick: layout.field("tick")?,
            scan_ns: layout.field("scan_time_ns")?,
            published_ns: layout.field("time_ns"),
            backend: layout.field("backend"),
            mark: layout.field("filled_in"),
        })
    }

    /// Reads them from a message; `None` where it is not of the simulated card.
    pub(super) fn read(&self, body: &[u8]) -> Option<Taken> {
        let read = |field: Option<&LayoutField>| unsigned(field?, body);
        let (tick, scan_ns) = (unsigned(self.tick, body)?, unsigned(self.scan_ns, body)?);
        if self.is_scan {
            let published_ns = read(self.published_ns).unwrap_or(scan_ns);
            return Some(Taken::Scan { tick, scan_ns, published_ns });
        }
        let simulated = read(self.backend) == Some(u64::from(CardKind::Simulated.code()));
        simulated.then(|| Taken::Sample { tick, scan_ns, mark: read(self.mark) })
    }
}

/// Follows the scans and the samples of a recording.
#[derive(Debug, Default)]
pub(super) struct FilledInFollower {
    scans: Stretches,
    samples: Stretches,
    /// Whether samples of the simulated card do not say it, as those of older builds.
    unmarked: bool,
}

impl FilledInFollower {
    /// Takes a scan or a sample.
    pub(super) fn take(&mut self, taken: Taken) {
        match taken {
            Taken::Scan { tick, scan_ns, published_ns } => {
                let late = |period| is_filled_in(published_ns, scan_ns, period);
                self.scans.take(tick, scan_ns, late);
            }
            Taken::Sample { tick, scan_ns, mark } => {
                self.unmarked |= mark.is_none();
                self.samples.take(tick, scan_ns, |_| mark == Some(1));
            }
        }
    }

    /// Whether there was a simulated card.
    pub(super) const fn simulated(&self) -> bool {
        self.scans.seen || self.samples.seen
    }

    /// What was found: by the card's own scans where they were recorded, else by the samples.
    /// `None` where there was no simulated card, or nothing tells.
    pub(super) fn found(&self) -> Option<FilledIn> {
        match (self.scans.seen, self.samples.seen && !self.unmarked) {
            (true, _) => Some(self.scans.found),
            (false, true) => Some(self.samples.found),
            (false, false) => None,
        }
    }
}
