//! Gives every volume of a recorded scan a time.

use crate::volume_clock::{Counted, Counts, Series, VolumeClock};

/// When a volume began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VolumeTime {
    /// Time of its pulse, or the interpolated time (ns).
    pub at_ns: u64,
    /// Whether it had no pulse, so that its time lies between those of its neighbours.
    pub interpolated: bool,
}

/// The volumes of a scan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reconciliation {
    /// The volumes, from the first to the last that had a pulse.
    pub volumes: Vec<VolumeTime>,
    /// Pulses that belong to no volume (ns).
    pub spurious_ns: Vec<u64>,
    /// What was counted.
    pub counts: Counts,
    /// The line through the pulses; `None` for less than two, and for a scanner that was started
    /// anew.
    pub timing: Option<TimingLine>,
}

/// Numbers the pulses of a scan, in the order of their times, and interpolates the volumes that had
/// none. The volumes after the last pulse stay unknown.
pub fn reconcile(pulses: impl IntoIterator<Item = u64>, series: Series) -> Reconciliation {
    let mut clock = VolumeClock::new(series);
    let mut volumes: Vec<VolumeTime> = Vec::new();
    let mut spurious_ns = Vec::new();
    let measured = |at_ns| VolumeTime { at_ns, interpolated: false };
    for at_ns in pulses {
        match clock.pulse(at_ns) {
            Counted::Volume { missed, .. } => {
                let before_ns = volumes.last().map_or(at_ns, |volume| volume.at_ns);
                let interpolated = between(before_ns, at_ns, missed);
                volumes.extend(interpolated.map(|at_ns| VolumeTime { at_ns, interpolated: true }));
                volumes.push(measured(at_ns));
            }
            Counted::Replaces { .. } => {
                if let Some(last) = volumes.last_mut() {
                    spurious_ns.push(last.at_ns);
                    *last = measured(at_ns);
                }
            }
            Counted::Restarted { index, first_ns } => {
                spurious_ns.retain(|spurious| *spurious != first_ns);
                if index == 1 {
                    spurious_ns.extend(volumes.drain(..).map(|volume| volume.at_ns));
                }
                volumes.extend([measured(first_ns), measured(at_ns)]);
            }
            Counted::Spurious => spurious_ns.push(at_ns),
            Counted::Surplus => {}
        }
    }
    spurious_ns.sort_unstable();
    // A line through two starts of the scanner would tell nothing.
    let timing = TimingLine::through(&volumes).filter(|_| clock.counts().restarts == 0);
    Reconciliation { volumes, spurious_ns, counts: clock.counts(), timing }
}

/// Times of so many volumes without a pulse, evenly between two that have one (ns).
pub fn between(before_ns: u64, next_ns: u64, missed: u64) -> impl Iterator<Item = u64> {
    let apart = next_ns.saturating_sub(before_ns) as f64 / (missed as f64 + 1.0);
    (1..=missed).map(move |step| before_ns + (apart * step as f64).round() as u64)
}

/// The least-squares line through the pulses over the numbers of their volumes: the scanner's clock
/// as the rig's shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimingLine {
    /// Time of volume 0 on the line (ns).
    start_ns: f64,
    /// Its slope: the mean repetition time (s).
    pub repetition_s: f64,
    /// Root mean square of the pulses' distances from it (s).
    pub jitter_s: f64,
}

impl TimingLine {
    /// The line through the volumes that had a pulse, of which the first is volume 0; `None` for
    /// less than two.
    pub fn through(volumes: &[VolumeTime]) -> Option<Self> {
        let origin_ns = volumes.first()?.at_ns as f64;
        let points = || {
            let numbered = volumes.iter().enumerate();
            let measured = numbered.filter(|(_, volume)| !volume.interpolated);
            measured.map(|(at, volume)| (at as f64, (volume.at_ns as f64 - origin_ns) * 1e-9))
        };
        let count = points().count() as f64;
        if count < 2.0 {
            return None;
        }
        let (x, y) = points().fold((0.0, 0.0), |(x, y), point| (x + point.0, y + point.1));
        let (x, y) = (x / count, y / count);
        let (xx, xy) = points().fold((0.0, 0.0), |(xx, xy), point| {
            (xx + (point.0 - x).powi(2), xy + (point.0 - x) * (point.1 - y))
        });
        let slope = xy / xx;
        let off = |point: (f64, f64)| point.1 - y - slope * (point.0 - x);
        let squares: f64 = points().map(|point| off(point).powi(2)).sum();
        Some(Self {
            start_ns: origin_ns + 1e9 * (y - slope * x),
            repetition_s: slope,
            jitter_s: (squares / count).sqrt(),
        })
    }

    /// How much later a volume began than the line says (s).
    pub fn deviation_s(&self, index: usize, volume: &VolumeTime) -> f64 {
        (volume.at_ns as f64 - self.start_ns) * 1e-9 - self.repetition_s * index as f64
    }
}
