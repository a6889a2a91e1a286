//! Times of scans that the card takes by its own clock, and the kernel does not stamp.

/// How fast the card's clock may run behind the computer's: crystals are within 100 ppm each.
const DRIFT: f64 = 200e-6;

/// Estimates when each scan of a stream was taken.
///
/// Scan n was taken at offset + n · period. It is delivered later, never earlier: the offset is the
/// least that any delivery allows, and rises by 200 ppm of the time that passes, so that a card
/// whose clock is slow does not leave it behind. A time is late by as much as the promptest
/// delivery of the last while was, and never in the future.
#[derive(Clone, Copy, Debug)]
pub struct ScanClock {
    period_ns: u64,
    /// Estimated time of scan 0 (ns), and the delivery that it is of.
    estimate: Option<(f64, u64)>,
    base_ns: u64,
    scans: u64,
    last_ns: u64,
}

impl ScanClock {
    /// A stream of this period (ns) that has not begun.
    pub const fn new(period_ns: u64) -> Self {
        Self { period_ns, estimate: None, base_ns: 0, scans: 0, last_ns: 0 }
    }

    /// The stream begins anew. Times go on rising.
    pub fn restart(&mut self) {
        *self = Self { last_ns: self.last_ns, ..Self::new(self.period_ns) };
    }

    /// `scans` more were delivered by `now_ns` (CLOCK_MONOTONIC), which is read after the delivery.
    pub fn delivered(&mut self, scans: u64, now_ns: u64) {
        if scans == 0 {
            return;
        }
        if self.estimate.is_none() {
            self.base_ns = now_ns;
        }
        // Relative to the first delivery, so that a float holds it.
        let newest = (self.scans + scans - 1) * self.period_ns;
        let allowed = now_ns.saturating_sub(self.base_ns) as f64 - newest as f64;
        let offset = match self.estimate {
            Some((offset, at_ns)) => {
                let passed = now_ns.saturating_sub(at_ns) as f64;
                allowed.min(offset + DRIFT * passed)
            }
            None => allowed,
        };
        self.estimate = Some((offset, now_ns));
    }

    /// Time of the next scan of those that were delivered (ns, CLOCK_MONOTONIC). Rises strictly.
    pub fn next_ns(&mut self) -> u64 {
        let (offset, at_ns) = self.estimate.unwrap_or((0.0, self.base_ns));
        let since_base = (offset + (self.scans * self.period_ns) as f64) as i64;
        let estimated = self.base_ns.saturating_add_signed(since_base).min(at_ns);
        self.scans += 1;
        self.last_ns = estimated.max(self.last_ns + 1);
        self.last_ns
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use proptest::prelude::*;

    use super::*;

    const PERIOD: u64 = 500_000;

    /// A scan: when it was taken, when it was delivered, and the estimate (ns).
    struct Delivered {
        truth: i64,
        now: i64,
        estimate: i64,
    }

    impl Delivered {
        fn error(&self) -> i64 {
            self.estimate - self.truth
        }
    }

    /// Delivers the scans of a card whose clock is off by `ppm` in bursts of `burst`, each late by
    /// what `late_ns` gives.
    fn run(ppm: f64, burst: u64, late_ns: impl Fn(u64) -> u64, count: u64) -> Vec<Delivered> {
        let mut clock = ScanClock::new(PERIOD);
        let truth =
            |n: u64| 1_000_000_000_000 + ((n * PERIOD) as f64 * (1.0 + ppm * 1e-6)).round() as u64;
        let (mut all, mut now) = (Vec::new(), 0);
        for first in (0..count).step_by(burst as usize) {
            let newest = first + burst - 1;
            now = (truth(newest) + late_ns(newest)).max(now + 1_000);
            clock.delivered(burst, now);
            all.extend((first..=newest).map(|n| Delivered {
                truth: truth(n) as i64,
                now: now as i64,
                estimate: clock.next_ns() as i64,
            }));
        }
        all
    }

    #[test]
    fn prompt_deliveries_tell_the_time_and_late_ones_change_nothing() {
        let late = |n| if n % 7 == 0 { 10_000 } else { 400_000 };
        for scan in &run(0.0, 1, late, 2_000)[100..] {
            assert!((0..12_000).contains(&scan.error()), "{}", scan.error());
        }
    }

    #[test]
    fn a_card_with_another_clock_is_followed() {
        for ppm in [-100.0, -50.0, 50.0, 100.0] {
            // half an hour
            let all = run(ppm, 1, |n| 20_000 + 1_000 * (n % 13), 3_600_000);
            let errors = all[4_000..].iter().map(Delivered::error);
            let (least, most) = (errors.clone().min().unwrap(), errors.max().unwrap());
            assert!(least >= 0 && most < 40_000, "{ppm} ppm: {least} to {most} ns");
        }
    }

    #[test]
    fn times_rise_over_a_restart() {
        let mut clock = ScanClock::new(PERIOD);
        clock.delivered(1, 1_000_000_000);
        let before = clock.next_ns();
        clock.restart();
        clock.delivered(2, 1_000_200_000);
        assert!(clock.next_ns() > before);
        assert!(clock.next_ns() <= 1_000_200_000);
    }

    proptest! {
        #[test]
        fn times_rise_and_are_never_in_the_future(
            ppm in -100.0..100.0f64,
            burst in 1u64..20,
            late in prop::collection::vec(0u64..9_000_000, 1..50),
        ) {
            let late_of = |n: u64| late[(n / burst) as usize % late.len()];
            let all = run(ppm, burst, late_of, 400);
            prop_assert!(all.windows(2).all(|pair| pair[1].estimate > pair[0].estimate));
            for scan in &all {
                prop_assert!(scan.estimate <= scan.now, "{} {}", scan.estimate, scan.now);
            }
        }
    }
}
