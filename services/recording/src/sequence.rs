//! What the sequence numbers of a topic say about loss: gaps and duplicates, per incarnation.
//!
//! A sender counts from 0 at each start, and draws a new incarnation. The first message of the
//! first incarnation tells nothing about what came before it (the reader may have joined late). An
//! incarnation that turns up later began while the reader was listening, so a first sequence above
//! 0 is a loss. An old incarnation may come back (a process that wakes from SIGSTOP): it goes on
//! where it stood.

/// How many incarnations of one topic are remembered; the one unheard for longest is forgotten
/// first.
const REMEMBERED: usize = 8;

#[derive(Clone, Copy, Debug, Default)]
struct Known {
    incarnation: u64,
    /// the sequence that comes next
    next: u64,
    /// when it was last heard, in messages
    heard: u64,
}

/// Follows one topic. Allocates nothing.
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

/// What one message told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// In order.
    Next,
    /// So many messages before it never came.
    Gap(u64),
    /// It came before, or comes out of order.
    Duplicate,
}

impl SequenceTracker {
    /// Takes note of one message.
    pub fn observe(&mut self, incarnation: u64, sequence: u64) -> Step {
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
        self.incarnations += 1;
        let index = if self.used < REMEMBERED {
            self.used += 1;
            self.used - 1
        } else {
            (0..REMEMBERED).min_by_key(|&i| self.known[i].heard).unwrap_or(0)
        };
        self.known[index] = Known { incarnation, next: 0, heard: self.received };
        self.advance(index, if first_of_all { sequence } else { 0 }, sequence)
    }

    fn advance(&mut self, index: usize, expected: u64, sequence: u64) -> Step {
        self.latest = index;
        self.known[index].heard = self.received;
        if sequence < expected {
            self.duplicates += 1;
            return Step::Duplicate;
        }
        self.known[index].next = sequence.saturating_add(1);
        if sequence == expected {
            return Step::Next;
        }
        let missing = sequence - expected;
        self.gaps = self.gaps.saturating_add(missing);
        self.gap_places += 1;
        Step::Gap(missing)
    }

    /// Messages seen.
    pub fn received(&self) -> u64 {
        self.received
    }
    /// Messages that never came.
    pub fn gaps(&self) -> u64 {
        self.gaps
    }
    /// How many holes they make.
    pub fn gap_places(&self) -> u64 {
        self.gap_places
    }
    /// Messages that came twice or out of order.
    pub fn duplicates(&self) -> u64 {
        self.duplicates
    }
    /// Starts of the sender that were seen.
    pub fn incarnations(&self) -> u64 {
        self.incarnations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joining_late_is_no_loss_but_a_hole_is() {
        let mut t = SequenceTracker::default();
        assert_eq!(t.observe(7, 500), Step::Next);
        assert_eq!(t.observe(7, 501), Step::Next);
        assert_eq!(t.observe(7, 505), Step::Gap(3));
        assert_eq!(t.observe(7, 505), Step::Duplicate);
        assert_eq!(t.observe(7, 502), Step::Duplicate);
        assert_eq!(t.observe(7, 506), Step::Next);
        assert_eq!((t.received(), t.gaps(), t.gap_places(), t.duplicates()), (6, 3, 1, 2));
    }

    #[test]
    fn a_new_incarnation_must_begin_at_zero() {
        let mut t = SequenceTracker::default();
        t.observe(1, 10);
        assert_eq!(t.observe(2, 0), Step::Next);
        assert_eq!(t.observe(2, 1), Step::Next);
        assert_eq!(t.observe(3, 4), Step::Gap(4));
        assert_eq!(t.incarnations(), 3);
    }

    #[test]
    fn an_old_incarnation_that_wakes_goes_on_where_it_stood() {
        let mut t = SequenceTracker::default();
        t.observe(1, 10);
        t.observe(2, 0);
        assert_eq!(t.observe(1, 11), Step::Next);
        assert_eq!(t.observe(2, 1), Step::Next);
        assert_eq!(t.incarnations(), 2);
    }

    #[test]
    fn many_incarnations_forget_the_oldest_only() {
        let mut t = SequenceTracker::default();
        for incarnation in 1..=20 {
            assert_eq!(t.observe(incarnation, 0), Step::Next);
        }
        assert_eq!(t.observe(20, 1), Step::Next);
        assert_eq!(t.observe(14, 1), Step::Next);
        assert_eq!(t.incarnations(), 20);
    }
}
