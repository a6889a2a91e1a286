//! A time after which a search ends with the best answer so far.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};

/// A time after which a search begins nothing more and gives its best answer so far.
///
/// A search has no clock of its own: it asks [`Self::has_passed`] before each unit of work (a fit,
/// a Jacobian, the simulation of a starting point).
pub struct Deadline {
    clock: Option<Box<dyn Fn() -> bool + Send + Sync>>,
    passed: AtomicBool,
}

/// No time limit.
pub static NEVER: Deadline = Deadline { clock: None, passed: AtomicBool::new(false) };

impl Deadline {
    /// Passes as soon as `clock` returns true; all threads ask it.
    pub fn when(clock: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self { clock: Some(Box::new(clock)), passed: AtomicBool::new(false) }
    }

    /// Whether nothing more is to be begun. Once true, it stays so.
    pub fn has_passed(&self) -> bool {
        let Some(clock) = &self.clock else { return false };
        if !self.passed.load(Ordering::Relaxed) && !clock() {
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
}
