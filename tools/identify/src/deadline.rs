//! A time after which a search ends with the best answer so far.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A time after which a search begins nothing more and gives its best answer so far.
///
/// A search has no clock of its own: it asks [`Self::has_passed`] before each unit of work (a fit,
/// a Jacobian, the simulation of a starting point).
pub struct Deadline {
    clock: Option<Clock>,
    /// The share of the time limit at which it passes.
    at: f64,
    passed: AtomicBool,
}

/// Returns the share of the time limit that has been used.
type Clock = Arc<dyn Fn() -> f64 + Send + Sync>;

/// No time limit.
pub static NEVER: Deadline = Deadline { clock: None, at: 1.0, passed: AtomicBool::new(false) };

impl Deadline {
    /// Passes as soon as `clock` returns true; all threads ask it.
    pub fn when(clock: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self::after(move || f64::from(clock()))
    }

    /// Passes as soon as the share of the time limit that `used` returns has come to 1.
    pub fn after(used: impl Fn() -> f64 + Send + Sync + 'static) -> Self {
        Self { clock: Some(Arc::new(used)), at: 1.0, passed: AtomicBool::new(false) }
    }

    /// A deadline at a share of this one's time. What it leaves out counts as left out by it alone.
    #[must_use]
    pub fn part(&self, share: f64) -> Self {
        let passed = AtomicBool::new(false);
        Self { clock: self.clock.clone(), at: share * self.at, passed }
    }

    /// Whether nothing more is to be begun. Once true, it stays so.
    pub fn has_passed(&self) -> bool {
        let Some(clock) = &self.clock else { return false };
        if !self.passed.load(Ordering::Relaxed) && clock() < self.at {
            return false;
        }
        self.passed.store(true, Ordering::Relaxed);
        true
    }

    /// Whether work was left out: [`Self::has_passed`] has returned true. Does not ask the clock.
    pub fn left_work_out(&self) -> bool {
        self.passed.load(Ordering::Relaxed)
    }
}

impl fmt::Debug for Deadline {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Deadline").field("passed", &self.passed).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    #[test]
    fn a_deadline_that_has_passed_stays_so_and_leaves_work_out_only_if_asked() {
        let asked = AtomicUsize::new(0);
        // True at the third question only.
        let deadline = Deadline::when(move || asked.fetch_add(1, Ordering::Relaxed) == 2);
        assert!(!deadline.has_passed() && !deadline.has_passed());
        assert!(!deadline.left_work_out());
        assert!(deadline.has_passed() && deadline.has_passed());
        assert!(deadline.left_work_out());
        assert!(!NEVER.has_passed() && !NEVER.left_work_out());
    }

    #[test]
    fn a_part_passes_earlier_and_leaves_out_nothing_of_the_whole() {
        let percent = Arc::new(AtomicUsize::new(30));
        let used = Arc::clone(&percent);
        let whole = Deadline::after(move || used.load(Ordering::Relaxed) as f64 / 100.0);
        let part = whole.part(0.5);
        assert!(!whole.has_passed() && !part.has_passed());
        percent.store(50, Ordering::Relaxed);
        assert!(part.has_passed() && !whole.has_passed());
        assert!(part.left_work_out() && !whole.left_work_out());
        percent.store(100, Ordering::Relaxed);
        assert!(whole.has_passed() && !NEVER.part(0.5).has_passed());
    }
}
