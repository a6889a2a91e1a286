//! Numbers the volumes of a scan, one pulse at a time.

use serde::{Deserialize, Serialize};

/// What is known of a scan in advance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// Repetition time TR, by the scanner's protocol (s).
    pub repetition_s: f64,
    /// Number of volumes; `None` where it is not known.
    pub volumes: Option<u64>,
    /// Largest distance of a pulse from the time at which its volume is due (s).
    pub tolerance_s: f64,
}

/// Share of the repetition time that a pulse may be off, where nothing else is said.
const TOLERANCE_SHARE: f64 = 0.05;
/// Least tolerance where nothing else is said (s).
const TOLERANCE_LEAST_S: f64 = 0.005;

impl Series {
    /// A scan with the usual tolerance: 5 % of the repetition time, and 5 ms at least.
    pub fn new(repetition_s: f64, volumes: Option<u64>) -> Self {
        let tolerance_s = (TOLERANCE_SHARE * repetition_s).max(TOLERANCE_LEAST_S);
        Self { repetition_s, volumes, tolerance_s }
    }
}

/// What a pulse was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counted {
    /// The pulse of a volume.
    Volume {
        /// Number of the volume, from 0.
        index: u64,
        /// Number of volumes before it, up to the last one with a pulse, that had none.
        missed: u64,
    },
    /// The pulse of a volume that an earlier pulse was taken for, which was further off and so
    /// belongs to none.
    Replaces {
        /// Number of the volume, from 0.
        index: u64,
    },
    /// The second of two pulses at the distance of volumes, but out of step with those before: the
    /// scanner was started anew, or the pulses before belonged to none. The first of the two is
    /// volume `index - 1`.
    Restarted {
        /// Number of the volume, from 0.
        index: u64,
        /// When the first of the two came (ns).
        first_ns: u64,
    },
    /// A pulse that belongs to no volume.
    Spurious,
    /// A pulse after the last volume.
    Surplus,
}

/// What was counted so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Volumes with a pulse.
    pub volumes: u64,
    /// Volumes without one, between two that have one.
    pub missed: u64,
    /// Pulses that belong to no volume.
    pub spurious: u64,
    /// Pulses after the last volume.
    pub surplus: u64,
    /// How often the scanner was started anew.
    pub restarts: u64,
}

/// Shortest and longest repetition time of a scan (s).
pub const REPETITION_S: (f64, f64) = (0.02, 60.0);

/// Highest count, and latest time (ns), of a state that was kept.
const MOST: u64 = 1 << 62;
/// Least repetition time that the pulses of a scan can have shown (ns).
const LEAST_REPETITION_NS: f64 = 1e6;

/// Gains of the alpha-beta filter that follows the scanner's clock, in the long run: white jitter
/// of the pulses reaches its phase at 0.4 of its size. By the Benedict-Bordner relation the second
/// would be 0.022.
const GAINS: (f64, f64) = (0.2, 0.02);
/// At the beginning they are those of the expanding-memory filter, which fits a line through all
/// pulses so far, as if the nominal repetition time were known from this many pulses: of a wrong
/// one, no later pulse is further off than the first.
const PULSES_BEFORE: u32 = 3;

/// Gains for the pulse of that number.
fn gains(pulse: u32) -> (f64, f64) {
    let k = f64::from(pulse.saturating_add(PULSES_BEFORE));
    let (alpha, beta) = (2.0 * (2.0 * k - 1.0) / (k * (k + 1.0)), 6.0 / (k * (k + 1.0)));
    (alpha.max(GAINS.0), beta.max(GAINS.1))
}

/// The scanner's clock, as its pulses show it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Phase {
    /// Number of the last volume with a pulse.
    index: u64,
    /// When it was due, before its pulse came (ns from the origin).
    due_ns: f64,
    /// How far its pulse was from that (ns).
    off_ns: f64,
    /// When it began, by the filter (ns from the origin).
    at_ns: f64,
    /// Repetition time by the rig's clock (ns).
    repetition_ns: f64,
    /// Number of pulses that it was learnt from, after the first.
    pulses: u32,
}

impl Phase {
    /// The phase that begins with a pulse.
    const fn begin(index: u64, at_ns: f64, repetition_ns: f64) -> Self {
        Self { index, due_ns: at_ns, off_ns: 0.0, at_ns, repetition_ns, pulses: 0 }
    }

    /// The phase after a pulse that came `off_ns` after its time, `passed` volumes later.
    fn follow(&self, passed: f64, off_ns: f64) -> Self {
        let pulses = self.pulses.saturating_add(1);
        let (alpha, beta) = gains(pulses);
        let due_ns = self.at_ns + passed * self.repetition_ns;
        Self {
            index: self.index + passed as u64,
            due_ns,
            off_ns,
            at_ns: due_ns + alpha * off_ns,
            repetition_ns: self.repetition_ns + beta * off_ns / passed,
            pulses,
        }
    }
}

/// Numbers the volumes of a scan.
///
/// The pulse of volume *k* is expected where an alpha-beta filter of the earlier pulses predicts
/// it; one that is off by more than the tolerance belongs to no volume. Volumes that are passed
/// over were missed. Times are those of `CLOCK_MONOTONIC`; the scanner's own clock may run at
/// another rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VolumeClock {
    series: Series,
    /// Time of the first pulse: other times are kept as distances from it (ns). Negative where the
    /// computer has been started since.
    origin_ns: i64,
    phase: Option<Phase>,
    /// The last spurious pulse, while nothing else has come since (ns).
    rejected_ns: Option<u64>,
    counts: Counts,
}

impl VolumeClock {
    /// The clock of a scan that has not begun.
    pub fn new(series: Series) -> Self {
        Self { series, origin_ns: 0, phase: None, rejected_ns: None, counts: Counts::default() }
    }

    /// Takes a pulse; pulses come in the order of their times.
    pub fn pulse(&mut self, at_ns: u64) -> Counted {
        let Some(phase) = self.phase else {
            self.origin_ns = at_ns.cast_signed();
            self.phase = Some(Phase::begin(0, 0.0, 1e9 * self.series.repetition_s));
            self.counts.volumes = 1;
            return Counted::Volume { index: 0, missed: 0 };
        };
        let since = self.since_origin(at_ns);
        let tolerance_ns = 1e9 * self.series.tolerance_s;
        let passed = ((since - phase.at_ns) / phase.repetition_ns).round().max(0.0);
        if passed == 0.0 {
            let off_ns = since - phase.due_ns;
            if off_ns.abs() <= tolerance_ns && off_ns.abs() < phase.off_ns.abs() {
                return self.replace(phase, off_ns);
            }
            return self.reject(at_ns);
        }
        let off_ns = since - (phase.at_ns + passed * phase.repetition_ns);
        if off_ns.abs() > tolerance_ns {
            return self.reject(at_ns);
        }
        let index = phase.index + passed as u64;
        if self.is_beyond(index) {
            self.counts.surplus += 1;
            return Counted::Surplus;
        }
        let missed = passed as u64 - 1;
        self.phase = Some(phase.follow(passed, off_ns));
        self.rejected_ns = None;
        self.counts.volumes += 1;
        self.counts.missed += missed;
        Counted::Volume { index, missed }
    }

    /// The last volume's pulse was another's: takes this one in its place.
    fn replace(&mut self, phase: Phase, off_ns: f64) -> Counted {
        let (alpha, _) = gains(phase.pulses);
        self.phase = Some(Phase { off_ns, at_ns: phase.due_ns + alpha * off_ns, ..phase });
        self.counts.spurious += 1;
        Counted::Replaces { index: phase.index }
    }

    /// A pulse out of step: the second of two at the distance of volumes sets the clock anew.
    fn reject(&mut self, at_ns: u64) -> Counted {
        let apart = |first_ns: u64| {
            let apart = (at_ns.saturating_sub(first_ns)) as f64 * 1e-9 - self.series.repetition_s;
            apart.abs() <= self.series.tolerance_s
        };
        let Some(first_ns) = self.rejected_ns.filter(|first_ns| apart(*first_ns)) else {
            self.rejected_ns = Some(at_ns);
            self.counts.spurious += 1;
            return Counted::Spurious;
        };
        let last = self.phase.map_or(0, |phase| phase.index);
        // A single pulse before was none of the scan's; more than one were of an earlier start.
        let alone = self.counts.volumes == 1;
        let index = if alone { 1 } else { last + 2 };
        if self.is_beyond(index) {
            self.rejected_ns = Some(at_ns);
            self.counts.surplus += 1;
            return Counted::Surplus;
        }
        if alone {
            // The pulse that came first is spurious in place of the one before this.
            self.counts.volumes = 2;
        } else {
            self.counts.volumes += 2;
            self.counts.spurious -= 1;
            self.counts.restarts += 1;
        }
        // The two pulses tell the repetition time: it may be another scan's.
        let (first, at) = (self.since_origin(first_ns), self.since_origin(at_ns));
        self.phase = Some(Phase { pulses: 1, ..Phase::begin(index, at, at - first) });
        self.rejected_ns = None;
        Counted::Restarted { index, first_ns }
    }

    fn since_origin(&self, at_ns: u64) -> f64 {
        at_ns.cast_signed().saturating_sub(self.origin_ns) as f64
    }

    /// The same clock where all times are later by this (ns): by those of another clock.
    #[must_use]
    pub fn shifted(self, by_ns: i64) -> Self {
        let origin_ns = self.origin_ns.saturating_add(by_ns);
        // A single pulse of another time tells nothing any more.
        Self { origin_ns, rejected_ns: None, ..self }
    }

    fn is_beyond(&self, index: u64) -> bool {
        self.series.volumes.is_some_and(|volumes| index >= volumes)
    }

    /// Whether a clock can have come to this state: one that was kept, and is read again, may be
    /// anything.
    pub fn is_possible(&self) -> bool {
        let Series { repetition_s, volumes, tolerance_s } = self.series;
        let Counts { volumes: counted, missed, spurious, surplus, restarts } = self.counts;
        let counts = [volumes.unwrap_or(0), counted, missed, spurious, surplus, restarts];
        let (shortest, longest) = REPETITION_S;
        let phase = self.phase.is_none_or(|phase| {
            let times = [phase.due_ns, phase.off_ns, phase.at_ns, phase.repetition_ns];
            times.iter().all(|time| time.abs() <= MOST as f64)
                && phase.repetition_ns >= LEAST_REPETITION_NS
                && phase.index <= MOST
                && counted > 0
        });
        (shortest..=longest).contains(&repetition_s)
            && (0.0..=longest).contains(&tolerance_s)
            && counts.into_iter().all(|count| count <= MOST)
            && self.origin_ns.unsigned_abs() <= MOST
            && self.rejected_ns.is_none_or(|at_ns| at_ns <= MOST && spurious > 0)
            && phase
    }

    /// What is known of the scan in advance.
    pub const fn series(&self) -> &Series {
        &self.series
    }

    /// What was counted so far.
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// Number of the last volume with a pulse; `None` before the first.
    pub fn index(&self) -> Option<u64> {
        self.phase.map(|phase| phase.index)
    }

    /// Repetition time by the rig's clock (s), as the pulses show it.
    pub fn repetition_s(&self) -> f64 {
        self.phase.map_or(self.series.repetition_s, |phase| 1e-9 * phase.repetition_ns)
    }

    /// When a volume begins, or a fraction of one has passed, by the scanner's clock
    /// (CLOCK_MONOTONIC, ns); `None` before the first pulse.
    pub fn time_ns(&self, volume: f64) -> Option<u64> {
        let phase = self.phase?;
        let at = phase.at_ns + (volume - phase.index as f64) * phase.repetition_ns;
        Some((self.origin_ns as f64 + at).max(0.0).round() as u64)
    }

    /// The number of volumes, and the fraction of one, that had passed at that time; `None` before
    /// the first pulse.
    pub fn volume_at(&self, at_ns: u64) -> Option<f64> {
        let phase = self.phase?;
        Some(phase.index as f64 + (self.since_origin(at_ns) - phase.at_ns) / phase.repetition_ns)
    }

    /// Number of volumes that are due and had no pulse yet: the last ones are missing, or the
    /// scanner has stopped.
    pub fn overdue(&self, now_ns: u64) -> u64 {
        let Some(phase) = self.phase else { return 0 };
        let since_ns = self.since_origin(now_ns) - 1e9 * self.series.tolerance_s - phase.at_ns;
        let overdue = (since_ns / phase.repetition_ns).floor().max(0.0) as u64;
        let left =
            self.series.volumes.map_or(u64::MAX, |volumes| volumes.saturating_sub(1 + phase.index));
        overdue.min(left)
    }
}
