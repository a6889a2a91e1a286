//! Why a verb was refused.

use ipc_types::{TripCause, WatchdogState};
use thiserror::Error;

/// Why the watchdog refuses a verb, in words a person can act on (its `Display`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Refusal {
    /// A fault is active.
    #[error("fault active: {0}; clear it, then `reset`")]
    FaultActive(TripCause),
    /// The verb needs another state first.
    #[error(
        "the watchdog is {found}, expected {expected}; {} first",
        first_verb(*expected, *found)
    )]
    State {
        /// State that the verb needs.
        expected: WatchdogState,
        /// Present state.
        found: WatchdogState,
    },
    /// The machine moves.
    #[error("the machine moves; let it come to rest, then `arm`")]
    Moving,
    /// The speed is not known yet.
    #[error("the speed is not known yet: too few samples since acquisition started; try again")]
    SpeedUnknown,
    /// The gate is open without our permission.
    #[error(
        "acquisition's gate is open without permission from this watchdog; is there a second one?"
    )]
    GateOpen,
    /// A card without an enable line, and nobody who cuts power otherwise.
    #[error(
        "the card has no enable line, and the rig file does not say who cuts the motor's power \
         otherwise ([safety] power_cut_by)"
    )]
    NoEnableLine,
    /// No higher epoch is left.
    #[error("no higher enable epoch is left (a forged one was seen); take the rig down and up")]
    EpochExhausted,
}

/// The verb that leads to the expected state.
const fn first_verb(expected: WatchdogState, found: WatchdogState) -> &'static str {
    match (expected, found) {
        (_, WatchdogState::Faulted | WatchdogState::Tripped) => "`reset`",
        (WatchdogState::Armed, _) => "`arm`",
        _ => "`disarm`",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_names_the_verb_that_leads_on() {
        use WatchdogState::{Armed, Disarmed, Enabled, Faulted, Tripped};
        for (expected, found, verb) in [
            (Disarmed, Faulted, "`reset`"),
            (Armed, Tripped, "`reset`"),
            (Armed, Disarmed, "`arm`"),
            (Disarmed, Enabled, "`disarm`"),
            (Tripped, Armed, "`disarm`"),
        ] {
            let text = Refusal::State { expected, found }.to_string();
            assert_eq!(text, format!("the watchdog is {found}, expected {expected}; {verb} first"));
        }
    }
}
