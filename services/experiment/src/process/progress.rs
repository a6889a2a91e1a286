//! Progress of the protocol, from the real-time loop to the request thread, in atomics: neither
//! waits for the other.

use ipc_types::{AXES, ExperimentAnswer, ScanProgress};

use crate::sync::{AtomicU64, Ordering};

/// Progress of the protocol, written by the loop. `elapsed_s_bits`, `sample_ns` and each word of
/// `scan` may belong to a neighbouring cycle.
#[derive(Debug, Default)]
pub(super) struct Progress {
    /// Bits 0 to 31: segment; 32: running; 33: completed; 34: enabled; 35 to 37: homed axes; 38:
    /// volumes are counted; 39 to 41: axes beyond their range of motion; 42: power was lost; 43 to
    /// 63: newest order accepted.
    packed: AtomicU64,
    /// Time played (s), as the bits of an `f64`.
    elapsed_s_bits: AtomicU64,
    /// Time of the newest sample (ns, CLOCK_MONOTONIC); 0 before the first.
    sample_ns: AtomicU64,
    /// Volumes and their expected number; missed and spurious; surplus and overdue: a half each.
    scan: [AtomicU64; 3],
    /// When the client last renewed its lease (ns): written by the request thread, and by the loop
    /// where a protocol begins; the only field that the loop reads.
    renewed_ns: AtomicU64,
}

const RUNNING: u64 = 1 << 32;
const COMPLETED: u64 = 1 << 33;
const ENABLED: u64 = 1 << 34;
const HOMED_SHIFT: u32 = 35;
const AXES_MASK: u64 = (1 << AXES) - 1;
const SCAN_SHIFT: u32 = 38;
const SCAN: u64 = 1 << SCAN_SHIFT;
const BEYOND_SHIFT: u32 = 39;
const LOST_SHIFT: u32 = 42;
const PERMISSION_LOST: u64 = 1 << LOST_SHIFT;
const ORDER_SHIFT: u32 = 43;
const _: () = assert!(HOMED_SHIFT as usize + AXES <= SCAN_SHIFT as usize);
const _: () = assert!(BEYOND_SHIFT as usize + AXES <= LOST_SHIFT as usize);

/// What the newest sample shows of the axes, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct AxisBits {
    /// Homed.
    pub(super) homed: u8,
    /// The handle is beyond its range of motion.
    pub(super) beyond_range: u8,
}

/// A snapshot of [`Progress`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ProgressSnapshot {
    pub(super) order: u32,
    pub(super) running: bool,
    pub(super) completed: bool,
    /// Whether the protocol ended because the motor lost its power.
    pub(super) permission_lost: bool,
    /// Whether the motor is enabled.
    pub(super) enabled: bool,
    /// Homed axes, one bit each.
    pub(super) homed: u8,
    /// Axes whose handle is beyond its range of motion, one bit each.
    pub(super) beyond_range: u8,
    pub(super) segment: u32,
    /// Time played (s).
    pub(super) elapsed_s: f64,
    /// Time of the newest sample (ns, CLOCK_MONOTONIC); 0 before the first.
    pub(super) sample_ns: u64,
    /// The volumes of the scan; `None` for a protocol that counts none.
    pub(super) scan: Option<ScanProgress>,
}

impl Progress {
    /// Largest order number that fits (21 bits).
    pub(super) const ORDER_MAX: u32 = (1 << (64 - ORDER_SHIFT)) - 1;

    /// Publishes the progress. The packed word is stored last, with release ordering.
    pub(super) fn update(
        &self,
        order: u32,
        status: &ExperimentAnswer,
        sample_ns: u64,
        enabled: bool,
        axes: AxisBits,
    ) {
        let flag = |set, bit| if set { bit } else { 0 };
        let packed = u64::from(status.segment)
            | flag(status.running, RUNNING)
            | flag(status.completed, COMPLETED)
            | flag(status.permission_lost, PERMISSION_LOST)
            | flag(enabled, ENABLED)
            | flag(status.scan.is_some(), SCAN)
            | (u64::from(axes.homed) & AXES_MASK) << HOMED_SHIFT
            | (u64::from(axes.beyond_range) & AXES_MASK) << BEYOND_SHIFT
            | u64::from(order) << ORDER_SHIFT;
        self.elapsed_s_bits.store(status.elapsed_s.to_bits(), Ordering::Relaxed);
        self.sample_ns.store(sample_ns, Ordering::Relaxed);
        let scan = status.scan.unwrap_or_default();
        let pairs = [
            (scan.volumes, scan.expected),
            (scan.missed, scan.spurious),
            (scan.surplus, scan.overdue),
        ];
        for (place, (high, low)) in self.scan.iter().zip(pairs) {
            place.store(half(high) << 32 | half(low), Ordering::Relaxed);
        }
        self.packed.store(packed, Ordering::Release);
    }

    /// Renews the client's lease.
    pub(super) fn renew(&self, now_ns: u64) {
        self.renewed_ns.store(now_ns, Ordering::Relaxed);
    }

    /// When the client last renewed its lease (ns, CLOCK_MONOTONIC); 0: not yet.
    pub(super) fn renewed_ns(&self) -> u64 {
        self.renewed_ns.load(Ordering::Relaxed)
    }

    pub(super) fn read(&self) -> ProgressSnapshot {
        let packed = self.packed.load(Ordering::Acquire);
        let [(volumes, expected), (missed, spurious), (surplus, overdue)] =
            self.scan.each_ref().map(|place| {
                let both = place.load(Ordering::Relaxed);
                (both >> 32, both & u64::from(u32::MAX))
            });
        let scan = ScanProgress { volumes, expected, missed, spurious, surplus, overdue };
        ProgressSnapshot {
            order: (packed >> ORDER_SHIFT) as u32,
            running: packed & RUNNING != 0,
            completed: packed & COMPLETED != 0,
            permission_lost: packed & PERMISSION_LOST != 0,
            enabled: packed & ENABLED != 0,
            homed: (packed >> HOMED_SHIFT & AXES_MASK) as u8,
            beyond_range: (packed >> BEYOND_SHIFT & AXES_MASK) as u8,
            segment: packed as u32,
            elapsed_s: f64::from_bits(self.elapsed_s_bits.load(Ordering::Relaxed)),
            sample_ns: self.sample_ns.load(Ordering::Relaxed),
            scan: (packed & SCAN != 0).then_some(scan),
        }
    }
}

/// A count in half a word.
fn half(count: u64) -> u64 {
    count.min(u64::from(u32::MAX))
}

#[cfg(test)]
#[cfg(not(loom))]
mod tests {
    use super::*;

    #[test]
    fn progress_is_read_back_as_written() {
        let progress = Progress::default();
        let scan = ScanProgress {
            volumes: 7,
            expected: 9,
            missed: 1,
            spurious: 2,
            surplus: 3,
            overdue: u64::from(u32::MAX),
        };
        for (order, segment, running, completed, permission_lost, enabled) in [
            (0, 0, false, false, true, true),
            (1, u32::MAX, true, false, false, false),
            (Progress::ORDER_MAX, 7, false, true, false, true),
        ] {
            let scan = running.then_some(scan);
            let status = ExperimentAnswer {
                running,
                segment,
                elapsed_s: 1.25,
                completed,
                permission_lost,
                scan,
                ..ExperimentAnswer::default()
            };
            let axes = AxisBits { homed: 5, beyond_range: 6 };
            progress.update(order, &status, 42, enabled, axes);
            let expected = ProgressSnapshot {
                order,
                running,
                completed,
                permission_lost,
                enabled,
                homed: 5,
                beyond_range: 6,
                segment,
                elapsed_s: 1.25,
                sample_ns: 42,
                scan,
            };
            assert_eq!(progress.read(), expected);
        }
    }
}
