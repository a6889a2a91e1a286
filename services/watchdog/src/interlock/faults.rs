//! Sets of faults, what each does, and which one names a trip when several come at once.

use ipc_types::TripCause;

/// A set of [`TripCause`]s: one bit for each code, as in the token's `faults`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultSet(u64);

/// What an active fault causes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultAction {
    /// Trips from Armed and Enabled, faults from Disarmed, refuses `reset` while active.
    Trips,
    /// Trips from Armed and Enabled and refuses `arm`; changes nothing in Disarmed, where it is no
    /// danger.
    TripsWhenArmed,
    /// Refuses `arm` and `enable`; trips nothing.
    Blocks,
}

/// Every fault, most specific first: the first active one in this list is the cause of a trip.
/// Root causes come before their consequences.
pub const PRIORITY: &[TripCause] = &[
    TripCause::EmergencyStop,
    TripCause::WatchdogLate,
    TripCause::SessionMismatch,
    TripCause::AcquisitionChanged,
    TripCause::ControlChanged,
    TripCause::SampleBackwards,
    TripCause::CommandBackwards,
    TripCause::ProgramFlow,
    TripCause::TooFast,
    TripCause::SensorInvalid,
    TripCause::SensorRailed,
    TripCause::SensorStuck,
    TripCause::EncoderJump,
    TripCause::HomingLost,
    TripCause::PositionLimit,
    TripCause::RangeOfMotion,
    TripCause::SpeedLimit,
    TripCause::TorqueLimit,
    TripCause::VoltageLimit,
    TripCause::EncoderStuck,
    TripCause::Disagreement,
    TripCause::ReadBack,
    TripCause::FollowingError,
    TripCause::Saturated,
    TripCause::MotorOverload,
    TripCause::MotorPowered,
    TripCause::PowerMissing,
    TripCause::HomingTime,
    TripCause::AcquisitionLost,
    TripCause::ControlLost,
    TripCause::LauncherLost,
    TripCause::CommandStale,
    TripCause::GateLatched,
    TripCause::GateNotOpen,
    TripCause::EchoLost,
    TripCause::NotRealtime,
    TripCause::NoOutput,
    TripCause::KeeperLost,
    TripCause::LoggerLost,
];

/// What `cause` leads to while it is active.
pub const fn action_of(cause: TripCause) -> FaultAction {
    match cause {
        TripCause::NotRealtime | TripCause::NoOutput => FaultAction::TripsWhenArmed,
        // The keeper only holds services open: those that run go on, and its restart brings it
        // back.
        TripCause::KeeperLost => FaultAction::Blocks,
        // Unless the rig file says that it trips; without a word there it is no fault.
        TripCause::LoggerLost => FaultAction::Blocks,
        _ => FaultAction::Trips,
    }
}

impl FaultSet {
    /// No fault.
    pub const NONE: Self = Self(0);

    /// The bits, as in the token.
    pub const fn bits(self) -> u64 {
        self.0
    }

    /// Whether `cause` is in the set.
    pub const fn contains(self, cause: TripCause) -> bool {
        self.0 & (1 << cause.code()) != 0
    }

    /// Adds `cause`.
    pub const fn insert(&mut self, cause: TripCause) {
        self.0 |= 1 << cause.code();
    }

    /// Adds `cause` where `active`.
    pub const fn insert_if(&mut self, active: bool, cause: TripCause) {
        if active {
            self.insert(cause);
        }
    }

    /// Adds all of `other`.
    pub const fn merge(&mut self, other: Self) {
        self.0 |= other.0;
    }

    /// The most specific fault for which `counts` holds.
    pub fn first(self, counts: impl Fn(TripCause) -> bool) -> Option<TripCause> {
        PRIORITY.iter().copied().find(|&cause| self.contains(cause) && counts(cause))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cause_has_its_place() {
        for &cause in TripCause::ALL {
            let places = PRIORITY.iter().filter(|&&other| other == cause).count();
            let expected = usize::from(!matches!(cause, TripCause::None | TripCause::Started));
            assert_eq!(places, expected, "{cause}");
        }
    }

    #[test]
    fn a_fault_that_is_found_twice_is_there_once() {
        let mut set = FaultSet::NONE;
        set.insert(TripCause::SpeedLimit);
        let once = set;
        set.insert(TripCause::SpeedLimit);
        set.merge(once);
        assert_eq!(set, once);
        assert_eq!(set.bits(), 1 << TripCause::SpeedLimit.code());
    }
}
