//! Loss by sequence number: the one rule, for live subscribers and for files.
//!
//! A sender counts from 0 at each start and draws a new incarnation. The first message of the first
//! incarnation says nothing about what came before it: the reader may have joined late. Any later
//! incarnation began while the reader was listening, so whatever is missing before its first
//! message is lost. An earlier incarnation may come back (a process that wakes from SIGSTOP) and
//! continues where it stopped.
//!
//! A reader that continues what an earlier one began (a logger that was restarted, the next part of
//! a recording) calls [`SequenceTracker::resume`] for each of the earlier one's
//! [`SequenceTracker::positions`]; the messages between the two are then counted as lost.

/// How many incarnations of one topic are remembered; the least recently heard is forgotten first.
const REMEMBERED: usize = 8;

#[derive(Clone, Copy, Debug, Default)]
struct Known {
    incarnation: u64,
    /// the sequence number expected next
    next: u64,
    /// value of `received` when it was last heard
    heard: u64,
}

/// Counts what is missing on one topic. Allocates nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct SequenceTracker {
    known: [Known; REMEMBERED],
    used: usize,
    latest: usize,
    received: u64,
    gaps: u64,
    gap_places: u64,
    duplicates: u64,
    incarnations: u64,
}

/// How a message follows those received before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// In order.
    Next,
    /// This many messages before it are missing.
    Gap(u64),
    /// Its sequence number repeated or went backwards.
    Duplicate,
}

impl SequenceTracker {
    /// Counts one message.
    pub fn observe(&mut self, incarnation: u64, sequence: u64) -> Arrival {
        self.received += 1;
        if let Some(known) =
            self.known.get(self.latest).filter(|k| self.used > 0 && k.incarnation == incarnation)
        {
            return self.advance(self.latest, known.next, sequence);
        }
        if let Some(index) =
            self.known[..self.used].iter().position(|k| k.incarnation == incarnation)
        {
            return self.advance(index, self.known[index].next, sequence);
        }
        let first_of_all = self.incarnations == 0;
        let index = self.remember(incarnation, 0);
        self.advance(index, if first_of_all { sequence } else { 0 }, sequence)
    }

    /// Expects `next` as the next sequence number of `incarnation`, as an earlier reader left it.
    pub fn resume(&mut self, incarnation: u64, next: u64) {
        self.latest = self.remember(incarnation, next);
    }

    /// The incarnations remembered, each with the sequence number expected next.
    pub fn positions(&self) -> impl Iterator<Item = (u64, u64)> + '_ {
        self.known[..self.used].iter().map(|known| (known.incarnation, known.next))
    }

    fn remember(&mut self, incarnation: u64, next: u64) -> usize {
        self.incarnations += 1;
        let index = if self.used < REMEMBERED {
            self.used += 1;
            self.used - 1
        } else {
            (0..REMEMBERED).min_by_key(|&i| self.known[i].heard).unwrap_or(0)
        };
        self.known[index] = Known { incarnation, next, heard: self.received };
        index
    }

    fn advance(&mut self, index: usize, expected: u64, sequence: u64) -> Arrival {
        self.latest = index;
        self.known[index].heard = self.received;
        if sequence < expected {
            self.duplicates += 1;
            return Arrival::Duplicate;
        }
        self.known[index].next = sequence.saturating_add(1);
        if sequence == expected {
            return Arrival::Next;
        }
        let missing = sequence - expected;
        self.gaps = self.gaps.saturating_add(missing);
        self.gap_places += 1;
        Arrival::Gap(missing)
    }

    /// Messages received.
    pub fn received(&self) -> u64 {
        self.received
    }
    /// Messages missing.
    pub fn gaps(&self) -> u64 {
        self.gaps
    }
    /// Number of gaps that the missing messages make.
    pub fn gap_places(&self) -> u64 {
        self.gap_places
    }
    /// Messages whose sequence number repeated or went backwards.
    pub fn duplicates(&self) -> u64 {
        self.duplicates
    }
    /// Incarnations of the sender seen.
    pub fn incarnations(&self) -> u64 {
        self.incarnations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joining_late_is_no_loss_but_a_gap_is() {
        let mut t = SequenceTracker::default();
        assert_eq!(t.observe(7, 500), Arrival::Next);
        assert_eq!(t.observe(7, 501), Arrival::Next);
        assert_eq!(t.observe(7, 505), Arrival::Gap(3));
        assert_eq!(t.observe(7, 505), Arrival::Duplicate);
        assert_eq!(t.observe(7, 502), Arrival::Duplicate);
        assert_eq!(t.observe(7, 506), Arrival::Next);
        assert_eq!((t.received(), t.gaps(), t.gap_places(), t.duplicates()), (6, 3, 1, 2));
    }

    #[test]
    fn a_new_incarnation_must_begin_at_zero() {
        let mut t = SequenceTracker::default();
        t.observe(1, 10);
        assert_eq!(t.observe(2, 0), Arrival::Next);
        assert_eq!(t.observe(2, 1), Arrival::Next);
        assert_eq!(t.observe(3, 4), Arrival::Gap(4));
        assert_eq!(t.incarnations(), 3);
    }

    #[test]
    fn an_earlier_incarnation_continues_where_it_stopped() {
        let mut t = SequenceTracker::default();
        t.observe(1, 10);
        t.observe(2, 0);
        assert_eq!(t.observe(1, 11), Arrival::Next);
        assert_eq!(t.observe(2, 1), Arrival::Next);
        assert_eq!(t.incarnations(), 2);
    }

    #[test]
    fn only_the_least_recently_heard_incarnation_is_forgotten() {
        let mut t = SequenceTracker::default();
        for incarnation in 1..=20 {
            assert_eq!(t.observe(incarnation, 0), Arrival::Next);
        }
        assert_eq!(t.observe(20, 1), Arrival::Next);
        assert_eq!(t.observe(14, 1), Arrival::Next);
        assert_eq!(t.incarnations(), 20);
    }

    #[test]
    fn a_reader_that_resumes_counts_what_was_missed_in_between() {
        let mut before = SequenceTracker::default();
        before.observe(1, 500);
        before.observe(1, 501);
        let mut after = SequenceTracker::default();
        before.positions().for_each(|(incarnation, next)| after.resume(incarnation, next));
        assert_eq!(after.observe(1, 1190), Arrival::Gap(688));
        // The sender was restarted as well.
        assert_eq!(after.observe(2, 3), Arrival::Gap(3));
        assert_eq!((after.received(), after.gaps(), after.incarnations()), (2, 691, 2));
    }
}
