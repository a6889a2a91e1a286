//! The newest samples of the channels of one topic, in a ring of fixed size.

use std::collections::VecDeque;

/// Most rows that a ring holds: 131 s of a topic of 2 kHz.
pub(crate) const ROWS: usize = 1 << 18;

/// One sample of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point {
    /// When (ns).
    pub(crate) time_ns: u64,
    /// In the channel's unit; NaN where the sample does not have it.
    pub(crate) value: f64,
    /// `Some` where the samples before it are interrupted: how many are missing; 0 where their
    /// sender was started anew.
    pub(crate) gap: Option<u64>,
}

/// Samples of several channels that come together, in the order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Rows {
    /// Channels.
    pub(crate) width: usize,
    times: VecDeque<u64>,
    gaps: VecDeque<Option<u64>>,
    /// row by row
    values: VecDeque<f64>,
}

impl Rows {
    /// No rows yet, of that many channels.
    pub(crate) fn new(width: usize) -> Self {
        Self { width, ..Self::default() }
    }

    /// Rows.
    pub(crate) fn len(&self) -> usize {
        self.times.len()
    }

    /// Time and values of a row.
    pub(crate) fn row(&self, at: usize) -> Option<(u64, Option<u64>, impl Iterator<Item = f64>)> {
        let (time_ns, gap) = (*self.times.get(at)?, *self.gaps.get(at)?);
        let values = self.values.range(at * self.width..(at + 1) * self.width).copied();
        Some((time_ns, gap, values))
    }

    /// The samples of one channel.
    pub(crate) fn points(&self, channel: usize) -> impl Iterator<Item = Point> {
        let values = self.values.iter().skip(channel).step_by(self.width.max(1));
        self.times.iter().zip(&self.gaps).zip(values).map(|((&time_ns, &gap), &value)| Point {
            time_ns,
            value,
            gap,
        })
    }

    /// Messages that are missing between the rows.
    pub(crate) fn lost(&self) -> u64 {
        self.gaps.iter().flatten().sum()
    }

    fn push(&mut self, time_ns: u64, gap: Option<u64>, values: &[f64]) {
        self.times.push_back(time_ns);
        self.gaps.push_back(gap);
        self.values.extend(values);
    }

    fn pop(&mut self) {
        self.times.pop_front();
        self.gaps.pop_front();
        self.values.drain(..self.width.min(self.values.len()));
    }
}

/// The newest rows.
#[derive(Clone, Debug)]
pub(crate) struct Ring {
    capacity: usize,
    rows: Rows,
    /// time of the newest row that had to make place (ns)
    overwritten_ns: Option<u64>,
    out_of_order: u64,
    /// a gap before a row that was refused: it is before the next one
    pending: Option<u64>,
}

impl Ring {
    /// An empty ring of that many rows and channels.
    pub(crate) fn new(capacity: usize, width: usize) -> Self {
        Self {
            capacity: capacity.max(1),
            rows: Rows::new(width),
            overwritten_ns: None,
            out_of_order: 0,
            pending: None,
        }
    }

    /// Adds a row, and says whether it comes after a gap. `None`: it is not later than the one
    /// before, as those of a process that wakes up beside its successor; it is counted.
    pub(crate) fn push(&mut self, time_ns: u64, gap: Option<u64>, values: &[f64]) -> Option<bool> {
        let before = std::mem::take(&mut self.pending);
        let gap = match (before, gap) {
            (Some(before), Some(gap)) => Some(before.saturating_add(gap)),
            (before, gap) => before.or(gap),
        };
        if self.newest_ns().is_some_and(|newest| time_ns <= newest) {
            self.out_of_order += 1;
            self.pending = gap;
            return None;
        }
        if self.rows.len() >= self.capacity {
            self.overwritten_ns = self.rows.times.front().copied();
            self.rows.pop();
        }
        self.rows.push(time_ns, gap, values);
        Some(gap.is_some())
    }

    /// Time of the newest row (ns).
    pub(crate) fn newest_ns(&self) -> Option<u64> {
        self.rows.times.back().copied()
    }

    /// Whether it reaches back to that time (ns), or did before newer rows took the place.
    pub(crate) fn reaches(&self, time_ns: u64) -> bool {
        let oldest = self.rows.times.front();
        self.overwritten_ns.is_some() || oldest.is_some_and(|oldest| *oldest <= time_ns)
    }

    /// Rows that were refused.
    pub(crate) const fn out_of_order(&self) -> u64 {
        self.out_of_order
    }

    /// Whether rows from that time on had to make place for newer ones.
    pub(crate) fn has_overwritten(&self, from_ns: u64) -> bool {
        self.overwritten_ns.is_some_and(|newest| newest >= from_ns)
    }

    /// The rows of an interval, both ends included.
    pub(crate) fn between(&self, begin_ns: u64, end_ns: u64) -> Rows {
        let from = self.rows.times.partition_point(|time| *time < begin_ns);
        let until = self.rows.times.partition_point(|time| *time <= end_ns).max(from);
        let width = self.rows.width;
        Rows {
            width,
            times: self.rows.times.range(from..until).copied().collect(),
            gaps: self.rows.gaps.range(from..until).copied().collect(),
            values: self.rows.values.range(from * width..until * width).copied().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(rows: &Rows, channel: usize) -> Vec<(u64, f64)> {
        rows.points(channel).map(|point| (point.time_ns, point.value)).collect()
    }

    #[test]
    fn a_ring_holds_the_newest_rows_and_tells_what_it_overwrote() {
        let mut ring = Ring::new(4, 2);
        for at in 1..=6u64 {
            assert_eq!(ring.push(at * 10, None, &[at as f64, -(at as f64)]), Some(false));
        }
        let all = ring.between(0, 100);
        assert_eq!(points(&all, 0), [(30, 3.0), (40, 4.0), (50, 5.0), (60, 6.0)]);
        assert_eq!(points(&ring.between(40, 50), 1), [(40, -4.0), (50, -5.0)]);
        assert_eq!(ring.between(41, 49).len(), 0);
        assert!(ring.has_overwritten(20) && !ring.has_overwritten(21));
        assert!(ring.reaches(15), "it did");
        let (time_ns, gap, values) = all.row(1).unwrap();
        assert_eq!((time_ns, gap, values.collect::<Vec<_>>()), (40, None, vec![4.0, -4.0]));
        assert!(all.row(4).is_none());
    }

    #[test]
    fn rows_that_go_back_in_time_are_counted_and_their_gap_stays() {
        let mut ring = Ring::new(8, 1);
        assert_eq!(ring.push(10, None, &[1.0]), Some(false));
        assert!(ring.reaches(10) && !ring.reaches(9));
        assert_eq!(ring.push(10, Some(2), &[2.0]), None);
        assert_eq!(ring.push(7, Some(3), &[3.0]), None);
        assert_eq!(ring.push(11, None, &[4.0]), Some(true));
        assert_eq!(ring.push(12, None, &[5.0]), Some(false));
        let rows = ring.between(0, 20);
        let gaps: Vec<_> = rows.points(0).map(|point| point.gap).collect();
        assert_eq!((gaps, rows.lost()), (vec![None, Some(5), None], 5));
        assert_eq!((ring.out_of_order(), ring.newest_ns()), (2, Some(12)));
    }
}
