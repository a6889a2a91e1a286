//! Statistics of one topic.

use hdrhistogram::Histogram;
use recording::word;
use serde::Serialize;

use crate::stream::{Arrived, Stamp, Stream};

/// Largest value of the histograms (ns).
const LONGEST_NS: u64 = 60_000_000_000;

/// A distribution of times.
#[derive(Clone, Debug)]
pub(crate) struct Times(Histogram<u64>);

impl Times {
    fn new() -> anyhow::Result<Self> {
        Ok(Self(Histogram::new_with_bounds(100, LONGEST_NS, 2)?))
    }

    fn record(&mut self, from_ns: u64, to_ns: u64) {
        self.0.saturating_record(to_ns.saturating_sub(from_ns));
    }

    /// Number of times.
    pub(crate) fn count(&self) -> u64 {
        self.0.len()
    }

    /// p50, p99, p99.9 and max (µs).
    pub(crate) fn microseconds(&self) -> [f64; 4] {
        let quantile = |quantile| self.0.value_at_quantile(quantile) as f64 * 1e-3;
        [quantile(0.5), quantile(0.99), quantile(0.999), self.0.max() as f64 * 1e-3]
    }
}

/// Measures one topic.
#[derive(Clone, Debug)]
pub(crate) struct Meter {
    /// From publishing to receiving; a recording does not tell.
    pub(crate) latency: Times,
    /// From the scan that a message answers to its publishing, if it names one.
    pub(crate) answer: Option<Times>,
    answer_offset: usize,
    /// Messages since the last [`Meter::reset`].
    pub(crate) count: u64,
    /// When the first and the last message came (ns, by the clock of [`Stamp`]).
    came_ns: Option<(u64, u64)>,
    last: Option<(u64, u64)>,
    intervals: u64,
    mean_ns: f64,
    squares: f64,
    least_ns: u64,
    most_ns: u64,
}

/// Intervals between messages of one incarnation (ms).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Intervals {
    pub(crate) mean: f64,
    pub(crate) min: f64,
    pub(crate) max: f64,
    /// Standard deviation.
    pub(crate) std: f64,
}

impl Meter {
    pub(crate) fn new(stream: &Stream) -> anyhow::Result<Self> {
        let answered = stream.field("scan_time_ns").or_else(|| stream.field("sample_time_ns"));
        Ok(Self {
            latency: Times::new()?,
            answer: answered.map(|_| Times::new()).transpose()?,
            answer_offset: answered.map_or(0, |field| field.offset),
            count: 0,
            came_ns: None,
            last: None,
            intervals: 0,
            mean_ns: 0.0,
            squares: 0.0,
            least_ns: u64::MAX,
            most_ns: 0,
        })
    }

    /// Adds a message.
    pub(crate) fn observe(&mut self, message: &Arrived<'_>) {
        let (incarnation, time_ns) = (message.sent.incarnation, message.sent.time_ns);
        self.count += 1;
        if let Stamp::Received(received_ns) = message.stamp {
            self.latency.record(time_ns, received_ns);
        }
        let came_ns = message.stamp.ns();
        self.came_ns = Some((self.came_ns.map_or(came_ns, |(first, _)| first), came_ns));
        let answered_ns = word(message.bytes, self.answer_offset);
        if let Some(answer) = self.answer.as_mut().filter(|_| answered_ns > 0) {
            answer.record(answered_ns, time_ns);
        }
        if let Some((_, last_ns)) = self.last.filter(|(known, _)| *known == incarnation) {
            let interval = time_ns.saturating_sub(last_ns);
            self.intervals += 1;
            // Welford's recurrence avoids differences of large sums.
            let distance = interval as f64 - self.mean_ns;
            self.mean_ns += distance / self.intervals as f64;
            self.squares += distance * (interval as f64 - self.mean_ns);
            self.least_ns = self.least_ns.min(interval);
            self.most_ns = self.most_ns.max(interval);
        }
        self.last = Some((incarnation, time_ns));
    }

    /// Messages a second between the first and the last one (Hz); `None` with fewer than two, or no
    /// time between them.
    pub(crate) fn rate_hz(&self) -> Option<f64> {
        let (first_ns, last_ns) = self.came_ns?;
        let between_ns = last_ns.checked_sub(first_ns).filter(|ns| *ns > 0)?;
        (self.count > 1).then(|| (self.count - 1) as f64 / (between_ns as f64 * 1e-9))
    }

    /// The intervals; `None` if there is none yet.
    pub(crate) fn intervals(&self) -> Option<Intervals> {
        (self.intervals > 0).then(|| Intervals {
            mean: self.mean_ns * 1e-6,
            min: self.least_ns as f64 * 1e-6,
            max: self.most_ns as f64 * 1e-6,
            std: (self.squares / self.intervals as f64).sqrt() * 1e-6,
        })
    }

    /// Resets the count and the latencies.
    pub(crate) fn reset(&mut self) {
        self.count = 0;
        self.came_ns = None;
        self.latency.0.reset();
        if let Some(answer) = &mut self.answer {
            answer.0.reset();
        }
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::{COMMAND, LOSS, Message, MotorCommand};

    use super::*;
    use crate::stream::tests::arrived;

    fn command(incarnation: u64, sample_time_ns: u64, time_ns: u64) -> MotorCommand {
        let mut command = MotorCommand { sample_time_ns, ..MotorCommand::default() };
        command.stamp(1, incarnation, 0, time_ns);
        command
    }

    #[test]
    fn times_and_intervals_are_those_of_the_messages() {
        let mut streams = [Stream::of_topic(&COMMAND.topic)];
        let mut meter = Meter::new(&streams[0]).unwrap();
        assert_eq!(meter.intervals(), None);
        // intervals of 1, 2 and 3 ms; a restart in between is no interval
        for (incarnation, time_ms) in [(1, 100), (1, 101), (2, 500), (2, 502), (2, 505)] {
            let time_ns = time_ms * 1_000_000;
            let message = command(incarnation, time_ns - 120_000, time_ns);
            let (bytes, received_ns) = (message.as_bytes(), time_ns + 50_000);
            meter.observe(&arrived(&mut streams, 0, bytes, received_ns));
        }
        let intervals = meter.intervals().unwrap();
        assert!((intervals.mean - 2.0).abs() < 1e-9, "{intervals:?}");
        assert!((intervals.std - (2.0f64 / 3.0).sqrt()).abs() < 1e-9, "{intervals:?}");
        assert_eq!((intervals.min, intervals.max), (1.0, 3.0));
        assert!((meter.latency.microseconds()[3] - 50.0).abs() < 1.0);
        assert!((meter.answer.as_ref().unwrap().microseconds()[0] - 120.0).abs() < 1.5);
        assert_eq!(meter.count, 5);
        assert!((meter.rate_hz().unwrap() - 4.0 / 0.405).abs() < 1e-6);
        meter.reset();
        assert_eq!((meter.count, meter.latency.count(), meter.rate_hz()), (0, 0, None));
        assert!(Meter::new(&Stream::of_topic(&LOSS.topic)).unwrap().answer.is_none());
    }
}
