//! Whether what became of the motor is what must become of it.

use std::collections::BTreeSet;

use ipc_types::{Profile, TripCause, WatchdogState};
use runtime::Timeouts;
use serde::{Deserialize, Serialize};

use crate::common::monitor::{Seen, TICK_NS, tick_of};
use crate::expected::Expected;
use crate::kinds::{Injection, Kind, Victims};

/// Whether what must be was so.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// As expected.
    Held,
    /// Not as expected, by a stall of the host that was measured beside it.
    HostStalled(String),
    /// Not as expected, each time, by stalls of the host that come without a rig as well.
    Undecided(String),
    /// Not as expected.
    Failed(String),
}

/// What an injection did.
pub struct Injected {
    /// Processes that it ended or stopped.
    pub victims: Vec<&'static str>,
    /// Card tick from which on the bound counts.
    pub from: u64,
    pub expected: Expected,
    /// What must stay alive until it has been received.
    pub _kept: Option<Box<dyn std::any::Any>>,
}

/// What became of the motor.
#[derive(Debug)]
pub struct Judgement {
    /// What was not as expected; `None` where all was.
    pub miss: Option<Miss>,
    /// Ticks to 0 V; `None` where it kept its power.
    pub off_ticks: Option<u64>,
    /// Cause of the trip, if any.
    pub cause: Option<String>,
}

/// What was not as expected.
#[derive(Debug)]
pub struct Miss {
    why: String,
    /// A stall of the host as long as this would explain it (ns). `None`: no stall does.
    stall_ns: Option<u64>,
}

impl Miss {
    /// With the longest stall that was measured (ms).
    pub fn verdict(self, stall_ms: f64) -> Verdict {
        match self.stall_ns {
            Some(needed) if stall_ms * 1e6 >= needed as f64 => Verdict::HostStalled(self.why),
            _ => Verdict::Failed(self.why),
        }
    }
}

/// Judges what was seen since an injection, which found the motor powered in this epoch.
pub fn judge(
    profile: Profile,
    kind: &Kind,
    epoch: u64,
    injected: &Injected,
    seen: &Seen,
) -> Judgement {
    let permitted = seen.tokens.iter().all(|token| token.enabled && token.epoch == epoch);
    let causes = seen.causes();
    let cause = causes.iter().next().map(|cause| cause.text().to_owned());
    let (off_ticks, miss) = if permitted && seen.scans.last().is_some_and(|scan| scan.power) {
        (None, of_power_kept(kind, injected, seen))
    } else {
        let acts = kind.name == "amplifier_rail";
        let last = if acts { seen.last_power() } else { seen.last_volts() };
        let off = last.map_or(0, |last| (last + 1).saturating_sub(injected.from));
        let miss = never_allowed(profile, kind, injected, &causes, seen)
            .or_else(|| unless_stalled(profile, kind, injected.expected, off, &causes));
        (Some(off), miss)
    };
    let miss = miss.map(|it| Miss { why: format!("{}\n{}", it.why, seen.account()), ..it });
    Judgement { miss, off_ticks, cause }
}

fn of_power_kept(kind: &Kind, injected: &Injected, seen: &Seen) -> Option<Miss> {
    let why = match injected.expected {
        Expected::Off(_) | Expected::OffUnbounded => "it kept its power".to_owned(),
        Expected::Stays | Expected::Either => {
            let flowing = seen.scans.iter().filter(|scan| scan.volts).count();
            // The volts of a sine pass through 0 V where friction compensation changes sign.
            if !is_kill(kind) || flowing * 10 > seen.scans.len() * 9 {
                return None;
            }
            format!("volts in {flowing} of {} scans", seen.scans.len())
        }
    };
    Some(Miss { why, stall_ns: None })
}

/// What no stall explains.
fn never_allowed(
    profile: Profile,
    kind: &Kind,
    injected: &Injected,
    causes: &BTreeSet<TripCause>,
    seen: &Seen,
) -> Option<Miss> {
    let launcher = injected.victims.contains(&"launcher");
    let why = if seen.tokens.iter().skip_while(|token| token.enabled).any(|token| token.enabled) {
        "enabled again by itself".to_owned()
    } else if kind.name != "relay_stuck" && outlives_line(profile, seen) {
        "power without a toggling enable line".to_owned()
    } else if is_kill(kind) && !launcher && causes.contains(&TripCause::LauncherLost) {
        "the launcher, which was left alone, counts as lost".to_owned()
    } else if let Injection::Kill(Victims::One(victim)) = kind.injection
        && injected.expected != Expected::Stays
        && seen.state() != Some(state_after(victim))
    {
        format!("{:?} after the death of {victim}", seen.state())
    } else {
        return None;
    };
    Some(Miss { why, stall_ns: None })
}

/// What a stall of the host explains that is long enough.
fn unless_stalled(
    profile: Profile,
    kind: &Kind,
    expected: Expected,
    off: u64,
    causes: &BTreeSet<TripCause>,
) -> Option<Miss> {
    // Longer than what makes the watchdog pause the enable line.
    let pause_ns = Timeouts::of(profile).enable_line_pause_ns + 1;
    let (why, stall_ns) = match expected {
        Expected::Stays => (format!("it lost its power: {causes:?}"), pause_ns),
        Expected::Off(bound) if off > bound => {
            (format!("off after {off} ticks"), (off - bound) * TICK_NS)
        }
        Expected::Off(_) | Expected::OffUnbounded if !is_named(kind, causes) => {
            (format!("another cause than promised: {causes:?}"), pause_ns)
        }
        _ => return None,
    };
    Some(Miss { why, stall_ns: Some(stall_ns) })
}

const fn is_kill(kind: &Kind) -> bool {
    matches!(kind.injection, Injection::Kill(_) | Injection::KillSuccessor)
}

fn state_after(victim: &str) -> WatchdogState {
    if victim == "watchdog" { WatchdogState::Faulted } else { WatchdogState::Tripped }
}

/// Whether the motor had power after the card's timeout of the enable line, to the tick.
fn outlives_line(profile: Profile, seen: &Seen) -> bool {
    let died = tick_of(seen.toggled.0 + Timeouts::of(profile).enable_line_ns) + 1;
    seen.last_power().is_some_and(|power| power > died)
}

/// Whether the watchdog has named one of the causes, where there are any.
fn is_named(kind: &Kind, causes: &BTreeSet<TripCause>) -> bool {
    let promised = kind.injection.causes();
    // The gate may see a fault of the machine before the watchdog does.
    let machine = matches!(kind.injection, Injection::Machine(..));
    let gate = machine && causes.contains(&TripCause::GateLatched);
    promised.is_empty() || gate || promised.iter().any(|cause| causes.contains(cause))
}
