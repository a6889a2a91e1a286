//! What must become of the motor: the bounds of the safety case for each kind of fault.

use std::time::Duration;

use ipc_types::Profile;
use runtime::Timeouts;
use runtime::clock::MILLISECOND_NS;
use simulator::faults::{Action, FaultKind, Promise};

use crate::common::monitor::{SLACK, TICK_NS, off_bound};

/// What must become of the motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    /// No volts later than so many card ticks after the fault, and not again by itself.
    Off(u64),
    /// No volts, and not again by itself; nothing bounds when it is learnt of.
    OffUnbounded,
    /// It keeps its power.
    Stays,
    /// Either: the fault shows only where a limit is passed, or is as short as the timeouts. Once
    /// off, not again by itself.
    Either,
}

/// Processes whose silence takes the volts away.
pub const LOOPS: [&str; 4] = ["acquisition", "control", "watchdog", "simulator"];

/// Ticks within which the gate ends what control last said.
pub fn gate_bound(profile: Profile) -> u64 {
    Timeouts::of(profile).token_ns / TICK_NS + SLACK
}

/// Ticks after a process's last message within which the motor must be at 0 V. Of control it is the
/// gate's: where the gate itself was late, the stall that made it so is measured here.
fn bound_of(process: &str, profile: Profile) -> Option<u64> {
    match process {
        "control" => Some(gate_bound(profile)),
        _ => off_bound(process, profile),
    }
}

/// Of the death of a process.
pub fn of_death(process: &str, profile: Profile) -> Expected {
    match (bound_of(process, profile), process) {
        (Some(bound), _) => Expected::Off(bound),
        (None, "launcher") => Expected::OffUnbounded,
        (None, _) => Expected::Stays,
    }
}

/// Of a stop that lasted so long.
pub fn of_stop(process: &str, lasted: Duration, profile: Profile) -> Expected {
    if !LOOPS.contains(&process) {
        return Expected::Stays;
    }
    // A card that is stopped gives no samples.
    let silent = if process == "simulator" { "acquisition" } else { process };
    let Some(bound) = bound_of(silent, profile) else { return Expected::Stays };
    let lasted_ns = lasted.as_nanos() as u64;
    if lasted_ns / TICK_NS > bound + SLACK {
        Expected::Off(bound)
    } else if 2 * lasted_ns < Timeouts::of(profile).enable_line_pause_ns {
        Expected::Stays
    } else {
        Expected::Either
    }
}

/// Of a fault of the simulated card or machine.
pub fn of_machine(fault: &FaultKind, place: usize, profile: Profile) -> Expected {
    match (fault.promises[place], profile) {
        (Promise::Trips(_, ticks), Profile::Realtime) => Expected::Off(ticks),
        // 100 scans that are lost are 50 ms, which without real-time scheduling are no timeout.
        (Promise::Trips(..), Profile::BestEffort) if fault.action == Action::FifoOverflow => {
            Expected::Either
        }
        (Promise::Trips(..), Profile::BestEffort) if fault.action == Action::LineBroken => {
            Expected::Off(Timeouts::of(profile).enable_line_ns / TICK_NS + SLACK)
        }
        (Promise::Trips(_, ticks), Profile::BestEffort) => Expected::Off(ticks + SLACK),
        (Promise::AtALimit(_), _) => Expected::Either,
        (Promise::NotNoticed, _) => Expected::Stays,
    }
}

/// Of what one message shows: the gate and the watchdog each end it in one cycle.
pub const ONE_MESSAGE: Expected = Expected::Off(4 * MILLISECOND_NS / TICK_NS + SLACK);
