//! Names of the codes that messages carry.

use ipc_types::{
    Backend, EventKind, GateCause, GateState, Mode, Process, Profile, Severity, TripCause,
    WatchdogState,
};

/// The name of a code in a field of a message type; `None` for fields that carry no code, and for
/// codes that this build does not know.
pub(crate) fn code_name(message: &str, field: &str, code: u64) -> Option<&'static str> {
    let code = u8::try_from(code).ok()?;
    match (message.rsplit('/').next()?, field) {
        (_, "gate_state") => GateState::from_code(code).map(GateState::text),
        (_, "gate_cause") => GateCause::from_code(code).map(GateCause::text),
        (_, "backend") => Backend::from_code(code).map(Backend::text),
        (_, "profile") => Profile::from_code(code).map(Profile::text),
        (_, "mode") => Mode::from_code(code).map(Mode::text),
        (_, "severity") => Severity::from_code(code).map(Severity::text),
        (_, "source" | "owner") => Process::from_code(code).map(Process::text),
        ("EnableToken", "state") => WatchdogState::from_code(code).map(WatchdogState::text),
        ("EnableToken", "cause") => TripCause::from_code(code).map(TripCause::text),
        ("Event", "kind") => EventKind::from_code(code).map(EventKind::text),
        _ => None,
    }
}
