//! Whether a state that was kept can be gone on with.

use super::{Emulation, ScanState, Wait};

/// Latest time and highest count of a state (ns): 146 years after the computer's start.
const LATEST: u64 = 1 << 62;
/// Furthest from the first pulse of an emulated scanner (s).
const FURTHEST_S: f64 = 4e9;

impl ScanState {
    /// Whether a tracker can have kept it: its times and counts leave room to go on, and its clock
    /// runs. From any other state the counts would overflow, or the loop would not end.
    pub fn is_possible(&self) -> bool {
        let times = [self.newest_ns, self.volume_ns];
        let optional = [self.gate_delay_ns, self.counts_since_ns];
        let gate = self.gate_next.is_none_or(|next| (0.0..=LATEST as f64).contains(&next));
        let anchor = self.anchor.is_none_or(|anchor| {
            anchor.volume.abs() <= FURTHEST_S && anchor.planned_s.abs() <= FURTHEST_S
        });
        times.into_iter().chain(optional.into_iter().flatten()).all(|at| at <= LATEST)
            && self.clock.is_none_or(|clock| clock.is_possible())
            && gate
            && anchor
            && self.wait.is_none_or(|wait| wait.is_possible())
            && self.emulation.is_none_or(|emulation| emulation.is_possible())
    }
}

impl Emulation {
    fn is_possible(&self) -> bool {
        self.first_ns.unsigned_abs() <= LATEST
            && self.newest_s.is_none_or(|newest_s| newest_s.abs() <= FURTHEST_S)
    }
}

impl Wait {
    fn is_possible(&self) -> bool {
        let Self { since_ns, pulse, pulses, start_up_ns, ends_ns, .. } = *self;
        let all = [since_ns, pulse, pulses, start_up_ns, ends_ns.unwrap_or(0)];
        all.into_iter().all(|value| value <= LATEST)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use ipc_types::{LineEvent, PulseSource};
    use rig::protocol::Scan;
    use scanner::Series;

    use super::*;
    use crate::scan_plan::{Pulses, ScanPlan};
    use crate::scan_tracker::ScanTracker;

    const SECOND_NS: u64 = 1_000_000_000;

    /// The states of a tracker through a scan that is missed, doubled and started anew.
    fn states(source: &str) -> Vec<ScanState> {
        let source: PulseSource = source.parse().unwrap();
        let plan = ScanPlan {
            scan: Some(Scan { series: Series::new(2.0, None), in_step: true }),
            gate_width_s: Some(0.01),
            pulses: Pulses::of(&source).unwrap(),
            ..ScanPlan::default()
        };
        let mut tracker = ScanTracker::default();
        tracker.begin(&plan, 100 * SECOND_NS);
        let mut states = vec![tracker.state()];
        for at_ms in [1000, 3001, 2999, 7000, 7100, 12_345, 14_345, 99_000, 101_000, 500_000] {
            let at_ns = 100 * SECOND_NS + at_ms * 1_000_000;
            tracker.see(LineEvent::Pulse, at_ns);
            tracker.see_key(at_ns);
            tracker.advance(at_ns + 1_000_000);
            while tracker.take_report().is_some() {}
            states.push(tracker.state());
        }
        states
    }

    #[test]
    fn what_a_tracker_keeps_is_possible_also_by_another_clock() {
        for source in ["line", "key", "2,jitter=0.001,missing=3,spurious=4.5"] {
            for state in states(source) {
                assert!(state.is_possible(), "{source}: {state:?}");
                for by_s in [-1_000_000_i64, 0, 1_000_000] {
                    let shifted = state.shifted(by_s * SECOND_NS.cast_signed());
                    assert!(shifted.is_possible(), "{source}, {by_s} s later: {shifted:?}");
                }
            }
        }
    }

    #[test]
    fn what_would_never_end_or_overflow_is_impossible() {
        let [.., line] = &states("line")[..] else { panic!("no states") };
        let [.., emulated] = &states("2")[..] else { panic!("no states") };
        let beat = |first_ns, newest_s| Some(Emulation { first_ns, newest_s });
        let impossible = [
            ScanState { emulation: beat(i64::MIN, None), ..*emulated },
            ScanState { emulation: beat(0, Some(f64::NAN)), ..*emulated },
            ScanState { emulation: beat(0, Some(1e300)), ..*emulated },
            // A gate whose next volume never comes nearer.
            ScanState { gate_next: Some(-1e300), ..*line },
            ScanState { gate_next: Some(f64::NAN), ..*line },
            ScanState { newest_ns: u64::MAX, ..*line },
            ScanState { counts_since_ns: Some(u64::MAX), ..*line },
        ];
        for state in impossible {
            assert!(!state.is_possible(), "{state:?}");
        }
    }
}
