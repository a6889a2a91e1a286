//! Gives a pulse on a digital output when a session begins.

use ipc_types::SyncOrder;
use rig::SyncOutput;

/// A session that began longer ago has no pulse: an instrument that takes it for the beginning
/// would be wrong by more than it is worth (ns).
const LATEST_NS: u64 = 100_000_000;

/// What became of an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ordered {
    /// The pulse begins now, this long after the session (ns).
    Begins(u64),
    /// It came too late, this long after the session (ns): there is no pulse.
    TooLate(u64),
}

/// The state of the output. Allocates nothing.
#[derive(Clone, Copy, Debug)]
pub struct SyncPulse {
    output: SyncOutput,
    /// When the pulse in progress ends (ns, CLOCK_MONOTONIC).
    until_ns: Option<u64>,
}

impl SyncPulse {
    /// The output between two pulses.
    pub const fn new(output: SyncOutput) -> Self {
        Self { output, until_ns: None }
    }

    /// Takes an order at `now_ns` (CLOCK_MONOTONIC). One that comes during a pulse makes it longer.
    pub fn order(&mut self, order: &SyncOrder, now_ns: u64) -> Ordered {
        let after_ns = now_ns.saturating_sub(order.at_ns);
        if after_ns > LATEST_NS {
            return Ordered::TooLate(after_ns);
        }
        self.until_ns = Some(now_ns + (1e9 * self.output.width_s).round() as u64);
        Ordered::Begins(after_ns)
    }

    /// Which output it is.
    pub const fn output(&self) -> u32 {
        self.output.output
    }

    /// Levels of the card's digital outputs between two pulses, one bit each.
    pub const fn idle_levels(&self) -> u32 {
        self.output.levels(false)
    }

    /// Levels of the card's digital outputs at `now_ns`, one bit each.
    pub fn levels(&mut self, now_ns: u64) -> u32 {
        self.until_ns = self.until_ns.filter(|until_ns| now_ns < *until_ns);
        self.output.levels(self.until_ns.is_some())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OUTPUT: SyncOutput = SyncOutput { output: 3, width_s: 0.01, active_low: false };
    const MS: u64 = 1_000_000;

    fn order(at_ns: u64) -> SyncOrder {
        SyncOrder { at_ns, ..SyncOrder::default() }
    }

    #[test]
    fn a_pulse_has_its_width() {
        let mut pulse = SyncPulse::new(OUTPUT);
        assert_eq!(pulse.levels(1000 * MS), 0);
        assert_eq!(pulse.order(&order(998 * MS), 1000 * MS), Ordered::Begins(2 * MS));
        let levels: Vec<u32> = (0..30).map(|step| pulse.levels((1000 + step) * MS)).collect();
        assert_eq!(levels[..10], [8; 10]);
        assert_eq!(levels[10..], [0; 20]);
        let mut low = SyncPulse::new(SyncOutput { active_low: true, ..OUTPUT });
        assert_eq!(low.levels(0), 8);
        low.order(&order(0), 0);
        assert_eq!((low.levels(5 * MS), low.levels(10 * MS)), (0, 8));
    }

    #[test]
    fn a_pulse_that_would_come_too_late_does_not_come() {
        let mut pulse = SyncPulse::new(OUTPUT);
        let late = pulse.order(&order(0), 101 * MS);
        assert_eq!((late, pulse.levels(101 * MS)), (Ordered::TooLate(101 * MS), 0));
        // An order of the future, by a clock that is none: now.
        assert_eq!(pulse.order(&order(500 * MS), 200 * MS), Ordered::Begins(0));
        assert_eq!(pulse.levels(200 * MS), 8);
    }
}
