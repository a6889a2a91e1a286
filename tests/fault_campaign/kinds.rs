//! The kinds of faults of the campaign: the one list, made of the rig's processes, of the simulated
//! card's faults, and of what is listed here.

use std::time::Duration;

use ipc_types::{Profile, TripCause};
use runtime::Timeouts;
use runtime::clock::MILLISECOND_NS;
use simulator::faults::{Action, FaultKind, LIST, Place, Promise};

use crate::common::monitor::{SLACK, TICK_NS, off_bound};
use crate::common::workers;
use crate::forgeries::Forgery;
use crate::host_troubles::HostTrouble;

/// A kind of fault.
#[derive(Clone, Debug)]
pub struct Kind {
    /// Its name in the table.
    pub name: String,
    /// What is done.
    pub injection: Injection,
}

/// What is done to the rig.
#[derive(Clone, Copy, Debug)]
pub enum Injection {
    /// Processes are killed at once (`SIGKILL`).
    Kill(Victims),
    /// Any process is killed, and its successor 0 to 50 ms after its start.
    KillSuccessor,
    /// A process is stopped for a time, and continued, if nobody has replaced it meanwhile.
    Stop(&'static str, Duration),
    /// A fault of the simulated card or machine, at one of its places.
    Machine(&'static FaultKind, usize),
    /// Messages that nobody of the rig has sent.
    Forge(Forgery),
    /// The computer lacks something.
    Host(HostTrouble),
    /// A verb of the command line.
    Verb(&'static str),
    /// Nobody sends setpoints any more.
    SetpointsEnd,
}

/// Processes that are killed at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Victims {
    One(&'static str),
    /// Any two, the launcher included.
    Two,
    /// All but any one, the launcher included.
    AllButOne,
}

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
const LOOPS: [&str; 4] = ["acquisition", "control", "watchdog", "simulator"];
/// Longer than any timeout; shorter than the launcher's watchdog timeout.
const STOPPED: Duration = Duration::from_millis(300);

/// Every kind.
pub fn list() -> Vec<Kind> {
    let kind = |name: String, injection| Kind { name, injection };
    let mut kinds: Vec<Kind> = processes()
        .into_iter()
        .map(|process| kind(format!("kill {process}"), Injection::Kill(Victims::One(process))))
        .collect();
    kinds.push(kind("kill any two processes".to_owned(), Injection::Kill(Victims::Two)));
    let all_but_one = Injection::Kill(Victims::AllButOne);
    kinds.push(kind("kill all processes but any one".to_owned(), all_but_one));
    let name = "kill any process, and its successor 0-50 ms after its start";
    kinds.push(kind(name.to_owned(), Injection::KillSuccessor));
    for process in processes() {
        for milliseconds in [3, 30, 300, 2000] {
            let time = Duration::from_millis(milliseconds);
            // The launcher replaces what was silent for 2 s; nothing of the others is that quick.
            if time == STOPPED || LOOPS.contains(&process) && process != "simulator" {
                let name = format!("stop {process} for {milliseconds} ms");
                kinds.push(kind(name, Injection::Stop(process, time)));
            }
        }
    }
    for fault in LIST.iter().filter(|fault| is_of_this_rig(fault)) {
        for place in 0..fault.places.len().max(1) {
            let injection = Injection::Machine(fault, place);
            kinds.push(kind(machine_fault(fault, place), injection));
        }
    }
    kinds.extend(Forgery::ALL.iter().map(|&it| kind(it.name().to_owned(), Injection::Forge(it))));
    kinds
        .extend(HostTrouble::ALL.iter().map(|&it| kind(it.name().to_owned(), Injection::Host(it))));
    for verb in ["estop", "disarm"] {
        kinds.push(kind(format!("verb {verb}"), Injection::Verb(verb)));
    }
    kinds.push(kind("setpoints end".to_owned(), Injection::SetpointsEnd));
    kinds
}

/// All processes of the rig.
pub fn processes() -> Vec<&'static str> {
    [workers(), vec!["launcher"]].concat()
}

/// The shipped hydrostatic rig without a scanner.
fn is_of_this_rig(fault: &FaultKind) -> bool {
    fault.only.is_none_or(|only| only.name() == "hydrostatic")
        && fault.action != Action::TriggerLost
}

/// As the command line takes it.
pub fn machine_fault(fault: &FaultKind, place: usize) -> String {
    match fault.places.get(place) {
        None => fault.name.to_owned(),
        Some(Place::Channel) => format!("{}@torque", fault.name),
        Some(place) => format!("{}@{}", fault.name, place.word()),
    }
}

impl Injection {
    /// What must become of the motor in this profile. `lasted`: how long the victim was really
    /// stopped.
    pub fn expected(&self, profile: Profile, lasted: Duration) -> Expected {
        match *self {
            // Judged by their victims, which are drawn: see `Strike`.
            Self::Kill(_) | Self::KillSuccessor => Expected::OffUnbounded,
            Self::Stop(process, _) => of_stop(process, lasted, profile),
            Self::Machine(fault, place) => of_machine(fault, place, profile),
            Self::Forge(forgery) => {
                if forgery.is_refused() {
                    Expected::Stays
                } else {
                    one_message(profile)
                }
            }
            Self::Host(trouble) => trouble.expected(profile),
            // From the answer on, with which the watchdog has executed it.
            Self::Verb(_) => one_message(profile),
            Self::SetpointsEnd => Expected::Stays,
        }
    }

    /// Causes of which the watchdog must name one, where it tells who is at fault.
    pub fn causes(&self) -> &'static [TripCause] {
        match *self {
            Self::Machine(fault, place) => match fault.promises[place] {
                Promise::Trips(causes, _) | Promise::AtALimit(causes) => causes,
                Promise::NotNoticed => &[],
            },
            Self::Verb("estop") => &[TripCause::EmergencyStop],
            Self::Kill(Victims::One("launcher")) => &[TripCause::LauncherLost],
            Self::Kill(Victims::One("watchdog")) => &[TripCause::Started],
            _ => &[],
        }
    }
}

/// Of the death of a process.
pub fn of_death(process: &str, profile: Profile) -> Expected {
    match (off_bound(process, profile), process) {
        (Some(bound), _) => Expected::Off(bound),
        (None, "launcher") => Expected::OffUnbounded,
        (None, _) => Expected::Stays,
    }
}

fn of_stop(process: &str, lasted: Duration, profile: Profile) -> Expected {
    if !LOOPS.contains(&process) {
        return Expected::Stays;
    }
    // A card that is stopped gives no samples.
    let silent = if process == "simulator" { "acquisition" } else { process };
    let Some(bound) = off_bound(silent, profile) else { return Expected::Stays };
    let lasted_ns = lasted.as_nanos() as u64;
    if lasted_ns / TICK_NS > bound + SLACK {
        Expected::Off(bound)
    } else if 2 * lasted_ns < Timeouts::of(profile).enable_line_pause_ns {
        Expected::Stays
    } else {
        Expected::Either
    }
}

fn of_machine(fault: &FaultKind, place: usize, profile: Profile) -> Expected {
    match (fault.promises[place], profile) {
        (Promise::Trips(_, ticks), Profile::Realtime) => Expected::Off(ticks),
        // 100 scans that are lost are 50 ms, which without real-time scheduling are no timeout.
        (Promise::Trips(..), Profile::BestEffort) if fault.action == Action::FifoOverflow => {
            Expected::Either
        }
        // What is read back differs by too little while the movement passes 0 V, for as long as the
        // watchdog then waits.
        (Promise::Trips(..), Profile::BestEffort) if fault.action == Action::LineBroken => {
            Expected::Either
        }
        (Promise::Trips(..), Profile::BestEffort) => one_message(profile),
        (Promise::AtALimit(_), _) => Expected::Either,
        (Promise::NotNoticed, _) => Expected::Stays,
    }
}

/// Of what one message shows: the gate and the watchdog each end it in one cycle; without
/// real-time scheduling a loop may be late by as much as the timeouts allow.
fn one_message(profile: Profile) -> Expected {
    let bound_ns = match profile {
        Profile::Realtime => 4 * MILLISECOND_NS,
        Profile::BestEffort => {
            let timeouts = Timeouts::of(profile);
            timeouts.peer_lost_ns + timeouts.enable_line_ns
        }
    };
    Expected::Off(bound_ns / TICK_NS + SLACK)
}
