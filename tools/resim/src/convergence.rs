//! When the law's state follows from its inputs alone.
//!
//! Without power the law keeps nothing from step to step but its velocity estimates and the
//! latency, and both forget: each is a first-order filter, of which a larger state stays the
//! larger one. So a law that begins afresh is run beside two whose states are far beyond any that
//! can occur, on either side. Once all three are equal to the last bit, so is the one that ran
//! live, whatever it had in mind. That takes about 7 s, and a handle that has moved: estimates
//! that fade at rest come together only when it moves.

use control::cycle::Seen;
use control::law::{Law, LawConfig};
use ipc_types::{MotorCommand, Sample};

/// Distance that the handle seems to have come in a step, for an estimate beyond any that occurs
/// (rad or m).
const FAR: f64 = 1e3;
/// Age of a sample for a latency beyond any that occurs (ns).
const OLD_NS: u64 = 1_000_000_000_000;
/// Time between two steps (ns).
const STEP_NS: u64 = 2_000_000;

/// Three laws on the same inputs.
#[derive(Debug)]
pub(crate) struct Convergence {
    fresh: Law,
    apart: [Law; 2],
}

impl Convergence {
    /// Begins at a step without power.
    pub(crate) fn new(config: &LawConfig, seen: &Seen<'_>, now_ns: u64) -> Self {
        let apart = [FAR, -FAR].map(|far| {
            let mut law = Law::new(*config);
            let mut step = |before_ns: u64, scan_ns: u64, shift: f64| {
                let mut sample = Sample { scan_time_ns: scan_ns, ..*seen.sample };
                for positions in [&mut sample.master_position, &mut sample.slave_position] {
                    for position in positions.iter_mut() {
                        *position -= shift;
                    }
                }
                law.step(now_ns.saturating_sub(before_ns), &sample, None, false);
            };
            let scan_ns = seen.sample.scan_time_ns;
            step(3 * STEP_NS, scan_ns.saturating_sub(OLD_NS), 0.0);
            step(2 * STEP_NS, scan_ns.saturating_sub(2 * STEP_NS), far);
            step(STEP_NS, scan_ns.saturating_sub(STEP_NS), 0.0);
            law
        });
        Self { fresh: Law::new(*config), apart }
    }

    /// Runs a step of all; the command of the one that began afresh.
    pub(crate) fn step(&mut self, seen: &Seen<'_>, now_ns: u64) -> MotorCommand {
        for law in &mut self.apart {
            seen.step(law, now_ns);
        }
        seen.step(&mut self.fresh, now_ns)
    }

    /// The law, once its state does not depend on how it began.
    pub(crate) fn settled(&self) -> Option<&Law> {
        self.apart.iter().all(|law| *law == self.fresh).then_some(&self.fresh)
    }
}
