//! What can be done at present: which buttons of the operator's page are active.

use ipc_types::WatchdogState;
use serde::Serialize;

/// Something that an operator does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Action {
    /// Clears a fault that is over.
    Reset,
    /// Makes ready.
    Arm,
    /// Powers the motor.
    Enable,
    /// Takes power away in good order.
    Disarm,
    /// Cuts power.
    Estop,
    /// Reads and checks a protocol.
    Build,
    /// Finds the stops.
    Initialise,
    /// Plays the protocol that was built.
    Start,
    /// Ends the running protocol.
    Stop,
    /// Begins a recording.
    Record,
    /// Ends it.
    EndRecording,
    /// Writes a note into the recording.
    Note,
}

/// What the possible actions depend on.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Situation {
    /// State of the watchdog; `None` where it is silent.
    pub(crate) watchdog: Option<WatchdogState>,
    /// Whether a protocol runs, whoever started it.
    pub(crate) running: bool,
    /// Whether a protocol was built.
    pub(crate) built: bool,
    /// Whether the logger records.
    pub(crate) recording: bool,
}

impl Situation {
    /// Whether an action makes sense now. What it would come to, the processes decide.
    pub(crate) fn permits(&self, action: Action) -> bool {
        use WatchdogState::{Armed, Disarmed, Enabled, Faulted, Tripped};
        let is = |states: &[WatchdogState]| self.watchdog.is_some_and(|it| states.contains(&it));
        match action {
            // Stopping is never out of place: what is known of other programs may be old.
            Action::Estop | Action::Stop | Action::Note => true,
            Action::Reset => is(&[Faulted, Tripped]),
            Action::Arm => is(&[Disarmed]),
            Action::Enable => is(&[Armed]),
            Action::Disarm => is(&[Armed, Enabled]),
            Action::Build => !self.running,
            Action::Initialise => !self.running && is(&[Armed, Enabled]),
            Action::Start => !self.running && self.built && is(&[Armed, Enabled]),
            Action::Record => !self.recording,
            Action::EndRecording => self.recording && !self.running,
        }
    }

    /// The actions that make sense now.
    pub(crate) fn permitted(&self) -> Vec<Action> {
        ALL.iter().copied().filter(|action| self.permits(*action)).collect()
    }
}

const ALL: &[Action] = &[
    Action::Reset,
    Action::Arm,
    Action::Enable,
    Action::Disarm,
    Action::Estop,
    Action::Build,
    Action::Initialise,
    Action::Start,
    Action::Stop,
    Action::Record,
    Action::EndRecording,
    Action::Note,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stop_and_emergency_stop_are_always_there() {
        for watchdog in WatchdogState::ALL.iter().map(|state| Some(*state)).chain([None]) {
            for running in [false, true] {
                let situation = Situation { watchdog, running, ..Situation::default() };
                assert!(situation.permits(Action::Estop) && situation.permits(Action::Stop));
            }
        }
    }

    #[test]
    fn nothing_moves_before_a_person_has_armed_the_rig() {
        let all = Situation { built: true, ..Situation::default() };
        for state in [WatchdogState::Faulted, WatchdogState::Disarmed, WatchdogState::Tripped] {
            let situation = Situation { watchdog: Some(state), ..all };
            assert!(!situation.permits(Action::Start) && !situation.permits(Action::Initialise));
        }
        let armed = Situation { watchdog: Some(WatchdogState::Armed), ..all };
        assert!(armed.permits(Action::Start) && armed.permits(Action::Initialise));
        assert!(!Situation { built: false, ..armed }.permits(Action::Start));
        assert!(!Situation { running: true, ..armed }.permits(Action::Build));
        assert!(!all.permits(Action::Arm), "nobody knows the watchdog's state");
    }
}
