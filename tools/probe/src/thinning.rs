//! Thins messages out: at most one in a period.

/// Decides which messages are printed.
#[derive(Clone, Debug)]
pub struct Thinning {
    /// ns; 0: all are printed
    period_ns: u64,
    /// from when on the next one is printed, and when the one before was published (ns)
    due: Option<(u64, u64)>,
    skipped: u64,
}

impl Thinning {
    /// One message in `period_ns` at most; all if that is 0.
    pub const fn new(period_ns: u64) -> Self {
        Self { period_ns, due: None, skipped: 0 }
    }

    /// Whether a message that was published at this time is printed: the first one, and the first
    /// of each further period, counted from it.
    pub fn takes(&mut self, time_ns: u64) -> bool {
        if self.period_ns == 0 {
            return true;
        }
        // Where time goes back (a recording of several parts, a computer that was started again),
        // the periods are counted anew.
        let due_ns = match self.due {
            Some((due_ns, before_ns)) if time_ns >= before_ns => due_ns,
            _ => time_ns,
        };
        if time_ns < due_ns {
            self.due = Some((due_ns, time_ns));
            self.skipped += 1;
            return false;
        }
        let periods = (time_ns - due_ns) / self.period_ns + 1;
        self.due = Some((due_ns.saturating_add(periods * self.period_ns), time_ns));
        true
    }

    /// Messages that were not printed.
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(period_ns: u64, times: &[u64]) -> (Vec<u64>, u64) {
        let mut thinning = Thinning::new(period_ns);
        let taken = times.iter().copied().filter(|time| thinning.takes(*time)).collect();
        (taken, thinning.skipped())
    }

    #[test]
    fn one_message_in_a_period_and_the_rest_is_counted() {
        let times: Vec<u64> = (0..20).map(|at| 1000 + 5 * at).collect();
        assert_eq!(taken(20, &times), (vec![1000, 1020, 1040, 1060, 1080], 15));
        assert_eq!(taken(0, &times), (times.clone(), 0));
        assert_eq!(taken(1, &times), (times.clone(), 0));
    }

    #[test]
    fn periods_follow_from_the_first_message_however_late_the_others_are() {
        assert_eq!(taken(10, &[7, 19, 26, 27, 30, 68, 70, 77]), (vec![7, 19, 27, 68, 77], 3));
    }

    #[test]
    fn a_clock_that_begins_anew_does_not_silence_it() {
        assert_eq!(taken(100, &[5000, 5050, 20, 60, 120]), (vec![5000, 20, 120], 2));
    }
}
