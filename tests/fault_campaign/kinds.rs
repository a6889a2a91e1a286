//! The kinds of faults of the campaign: the one list, made of the rig's processes, of the simulated
//! card's faults, and of what is listed here.

use std::time::Duration;

use ipc_types::TripCause;
use simulator::faults::{Action, FaultKind, LIST, Promise};

use crate::common::workers;
use crate::expected::LOOPS;
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
        for (place, text) in fault.texts("torque").into_iter().enumerate() {
            kinds.push(kind(text, Injection::Machine(fault, place)));
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

impl Injection {
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
