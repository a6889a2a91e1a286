//! The clock of a page against the rig's, and the time from a sample to the page's frame.

use std::collections::VecDeque;

/// Exchanges that are kept: about half a minute.
const EXCHANGES: usize = 32;
/// Frames that are kept.
const FRAMES: usize = 256;

/// One exchange of times.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Exchange {
    round_trip_ms: f64,
    offset_ms: f64,
}

/// Estimates the offset of a page's clock from exchanges of times, as NTP does: of the latest
/// exchanges the one with the shortest round trip counts.
#[derive(Clone, Debug, Default)]
pub(crate) struct PageClock {
    exchanges: VecDeque<Exchange>,
    /// From the instant of a bar to its frame (ms).
    delays_ms: VecDeque<f64>,
}

/// An estimate of a page's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimate {
    /// The page's clock minus `CLOCK_MONOTONIC` (ms).
    pub(crate) offset_ms: f64,
    /// Round trip of the exchange it comes from: the offset is off by half of it at most (ms).
    pub(crate) round_trip_ms: f64,
}

/// The time from the instant that a bar shows to the frame of the page that shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Delay {
    /// Median (ms).
    pub(crate) median_ms: f64,
    /// The longest (ms).
    pub(crate) longest_ms: f64,
    /// Frames.
    pub(crate) frames: usize,
}

impl PageClock {
    /// A page had at `page_ms` of its clock what was sent at `sent_ms`; its answer came at
    /// `now_ms`. An exchange that cannot have been is not taken.
    pub(crate) fn exchange(&mut self, sent_ms: f64, page_ms: f64, now_ms: f64) {
        let round_trip_ms = now_ms - sent_ms;
        if !page_ms.is_finite() || !(0.0..60_000.0).contains(&round_trip_ms) {
            return;
        }
        if self.exchanges.len() == EXCHANGES {
            self.exchanges.pop_front();
        }
        let offset_ms = page_ms - (sent_ms + round_trip_ms / 2.0);
        self.exchanges.push_back(Exchange { round_trip_ms, offset_ms });
    }

    /// The present estimate; `None` before the first exchange.
    pub(crate) fn estimate(&self) -> Option<Estimate> {
        let best =
            self.exchanges.iter().min_by(|a, b| a.round_trip_ms.total_cmp(&b.round_trip_ms))?;
        Some(Estimate { offset_ms: best.offset_ms, round_trip_ms: best.round_trip_ms })
    }

    /// An instant of the page's clock as `CLOCK_MONOTONIC` (ns); `None` before the first exchange.
    pub(crate) fn monotonic_ns(&self, page_ms: f64) -> Option<u64> {
        // A number beyond the range becomes its end, NaN 0: neither is near the present.
        self.estimate().map(|estimate| (1e6 * (page_ms - estimate.offset_ms)).round() as u64)
    }

    /// From `at_ms` (CLOCK_MONOTONIC) to `page_ms` of the page's clock (ms); `None` before the
    /// first exchange, and for what cannot have been.
    pub(crate) fn delay_ms(&self, at_ms: f64, page_ms: f64) -> Option<f64> {
        let delay_ms = page_ms - self.estimate()?.offset_ms - at_ms;
        (-1000.0..60_000.0).contains(&delay_ms).then_some(delay_ms)
    }

    /// A frame drawn at `page_ms` shows the bar of `at_ms`.
    pub(crate) fn shown(&mut self, at_ms: f64, page_ms: f64) {
        let Some(delay_ms) = self.delay_ms(at_ms, page_ms) else { return };
        if self.delays_ms.len() == FRAMES {
            self.delays_ms.pop_front();
        }
        self.delays_ms.push_back(delay_ms);
    }

    /// The delays of the latest frames; `None` before the first.
    pub(crate) fn delay(&self) -> Option<Delay> {
        let mut sorted: Vec<f64> = self.delays_ms.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        Some(Delay {
            median_ms: *sorted.get(sorted.len() / 2)?,
            longest_ms: *sorted.last()?,
            frames: sorted.len(),
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn the_shortest_round_trip_gives_the_offset() {
        let mut clock = PageClock::default();
        assert_eq!(clock.estimate(), None);
        // A page whose clock is 5000 ms ahead; its answers take 1 ms, and 20 ms once.
        clock.exchange(100.0, 5100.5 + 15.0, 120.0);
        clock.exchange(200.0, 5200.5, 201.0);
        clock.exchange(300.0, 5300.5 + 3.0, 306.0);
        assert_eq!(clock.estimate(), Some(Estimate { offset_ms: 5000.0, round_trip_ms: 1.0 }));
        assert_eq!(clock.monotonic_ns(5123.25), Some(123_250_000));
        assert_eq!(clock.monotonic_ns(-1e300), Some(0));
        for at in 0..10 {
            clock.shown(f64::from(at), 5000.0 + f64::from(at) + 20.0 + f64::from(at));
        }
        let delay = clock.delay().unwrap();
        assert_eq!((delay.median_ms, delay.longest_ms, delay.frames), (25.0, 29.0, 10));
    }

    #[test]
    fn old_exchanges_go_and_impossible_ones_do_not_come() {
        let mut clock = PageClock::default();
        clock.exchange(0.0, 1000.0, 0.5);
        for second in 1..=EXCHANGES {
            let sent_ms = second as f64 * 1000.0;
            clock.exchange(sent_ms, sent_ms + 2002.0, sent_ms + 4.0);
        }
        assert_eq!(clock.estimate().unwrap().offset_ms, 2000.0);
        let before = clock.clone().estimate();
        clock.exchange(10.0, f64::NAN, 11.0);
        clock.exchange(10.0, 10.0, 9.0);
        clock.exchange(f64::NAN, 10.0, 9.0);
        assert_eq!(clock.estimate(), before);
        clock.shown(f64::INFINITY, 0.0);
        assert_eq!(clock.delay(), None);
    }
}
