//! Whether a rig's loops are fast enough for the timeouts of a timing profile.
//!
//! All loops wake on one grid ([`Rates`], [`Phases`]), so that rates and phases alone say how old
//! each message is when it is looked at. Where an age exceeds its timeout on a grid that is never
//! late, gate or watchdog trips for ever.

use std::fmt;

use ipc_types::{Profile, Timeouts};

use crate::rates::{Phases, Rates};

/// How late a loop may wake where nothing is wrong (ns): `farreach doctor` passes a computer whose
/// 99th percentile is that.
const LATE_NS: u64 = 120_000;
/// A time at which every grid begins a period (ns): all periods divide it.
const BEGIN_NS: u64 = 1_000_000_000;

/// An age that exceeds its timeout on the grid of a rig: it cannot be armed in that profile, or
/// trips as soon as the motor has power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MissedTimeout {
    /// Key of the rate that is too low, with its section.
    pub key: &'static str,
    /// What is too old.
    pub what: &'static str,
    /// How old it becomes (ns).
    pub oldest_ns: u64,
    /// How old it may become: the timeout, less the lateness that is tolerated (ns).
    pub limit_ns: u64,
    /// Whose timeout it is.
    pub profile: Profile,
}

impl fmt::Display for MissedTimeout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} is too low for the profile {}: {} at most {} ms, found {} ms",
            self.key,
            self.profile,
            self.what,
            milliseconds(self.limit_ns),
            milliseconds(self.oldest_ns)
        )
    }
}

fn milliseconds(ns: u64) -> String {
    format!("{:.2}", ns as f64 * 1e-6)
}

impl MissedTimeout {
    /// What was expected, for a message about the key.
    pub(crate) fn expected(&self) -> String {
        let (limit, profile) = (milliseconds(self.limit_ns), self.profile);
        format!("{} at most {limit} ms (timeouts of the profile {profile})", self.what)
    }

    /// What was found, for a message about the key.
    pub(crate) fn found(&self, rates: &Rates) -> String {
        format!("{} ms at {} Hz", milliseconds(self.oldest_ns), rates.of_key(self.key))
    }
}

/// A loop that wakes on the grid.
#[derive(Clone, Copy)]
struct Loop {
    period_ns: u64,
    phase_ns: u64,
}

impl Loop {
    /// Its newest wake before a time. No two loops wake at once ([`Phases::check`]).
    const fn before(&self, time_ns: u64) -> u64 {
        (time_ns - 1 - self.phase_ns) / self.period_ns * self.period_ns + self.phase_ns
    }

    /// Its wakes within that long.
    fn wakes(self, span_ns: u64) -> impl Iterator<Item = u64> {
        (0..span_ns / self.period_ns).map(move |at| BEGIN_NS + at * self.period_ns + self.phase_ns)
    }
}

/// The loops between which messages pass.
struct Loops {
    card: Loop,
    acquisition: Loop,
    control: Loop,
    watchdog: Loop,
}

impl Loops {
    fn new(rates: &Rates, phases: &Phases) -> Self {
        let of = |period_ns, phase_ns| Loop { period_ns, phase_ns };
        Self {
            card: of(rates.acquisition_period_ns(), phases.simulator_ns),
            acquisition: of(rates.acquisition_period_ns(), phases.acquisition_ns),
            control: of(rates.control_period_ns(), phases.control_ns),
            watchdog: of(rates.watchdog_period_ns(), phases.watchdog_ns),
        }
    }

    /// Time of the scan in the newest sample.
    const fn scan_before(&self, time_ns: u64) -> u64 {
        self.card.before(self.acquisition.before(time_ns))
    }

    /// Time of the scan that the newest command answers.
    const fn answered_before(&self, time_ns: u64) -> u64 {
        self.scan_before(self.control.before(time_ns))
    }

    /// The time after which the whole pattern repeats: the slower of any two periods is a multiple
    /// of the faster.
    fn span_ns(&self) -> u64 {
        let periods = [self.acquisition, self.control, self.watchdog].map(|own| own.period_ns);
        periods.into_iter().max().unwrap_or(BEGIN_NS)
    }

    /// The longest pause between two toggles of the enable line, which the watchdog leaves out
    /// where the newest sample is older than `pause_ns`; `None` where it never toggles (ns).
    fn line_gap_ns(&self, pause_ns: u64) -> Option<u64> {
        let toggles: Vec<u64> = self
            .watchdog
            .wakes(2 * self.span_ns())
            .filter(|now| now - self.scan_before(*now) <= pause_ns)
            .collect();
        toggles.windows(2).map(|pair| pair[1] - pair[0]).max()
    }
}

/// The first timeout of a profile that rates and phases do not keep, which were checked by
/// themselves; `None` where they keep all.
pub(crate) fn missed_timeout(
    rates: &Rates,
    phases: &Phases,
    profile: Profile,
) -> Option<MissedTimeout> {
    let (loops, timeouts) = (Loops::new(rates, phases), Timeouts::of(profile));
    let span_ns = loops.span_ns();
    let oldest = |at: Loop, made: &dyn Fn(u64) -> u64| {
        at.wakes(span_ns).map(|now| now - made(now)).max().unwrap_or(0)
    };
    let at_gate = |made: &dyn Fn(u64) -> u64| oldest(loops.acquisition, made);
    let at_watchdog = |made: &dyn Fn(u64) -> u64| oldest(loops.watchdog, made);
    let (control, watchdog) = (loops.control, loops.watchdog);
    let (acquisition_hz, control_hz, watchdog_hz) =
        ("rates.acquisition_hz", "rates.control_hz", "rates.watchdog_hz");
    let Timeouts { token_ns, peer_lost_ns, enable_line_pause_ns, .. } = timeouts;
    let echo_ns = timeouts.echo_lost_ns();
    let line_ns = timeouts.enable_line_gap_ns();
    let checks = [
        (acquisition_hz, "a period of the gate of", loops.acquisition.period_ns, token_ns),
        (watchdog_hz, "a period of the watchdog of", watchdog.period_ns, token_ns.min(line_ns)),
        (watchdog_hz, "tokens at the gate of", at_gate(&|now| watchdog.before(now)), token_ns),
        (control_hz, "commands at the gate of", at_gate(&|now| control.before(now)), token_ns),
        (
            control_hz,
            "samples that commands at the gate answer of",
            at_gate(&|now| loops.answered_before(now)),
            timeouts.answered_sample_ns(),
        ),
        (
            acquisition_hz,
            "samples at the watchdog of",
            at_watchdog(&|now| loops.scan_before(now)),
            peer_lost_ns,
        ),
        (
            control_hz,
            "commands at the watchdog of",
            at_watchdog(&|now| control.before(now)),
            peer_lost_ns,
        ),
        (
            control_hz,
            "samples that commands at the watchdog answer of",
            at_watchdog(&|now| loops.answered_before(now)),
            echo_ns,
        ),
        (
            acquisition_hz,
            "tokens that samples echo of",
            at_watchdog(&|now| watchdog.before(loops.acquisition.before(now))),
            echo_ns,
        ),
        (
            control_hz,
            "tokens that commands echo of",
            at_watchdog(&|now| watchdog.before(control.before(now))),
            echo_ns,
        ),
        match loops.line_gap_ns(enable_line_pause_ns - LATE_NS) {
            Some(gap_ns) => {
                (acquisition_hz, "pauses of the enable line for samples of", gap_ns, line_ns)
            }
            None => (
                acquisition_hz,
                "samples with which the enable line toggles of",
                at_watchdog(&|now| loops.scan_before(now)),
                enable_line_pause_ns,
            ),
        },
    ];
    checks.into_iter().find_map(|(key, what, oldest_ns, timeout_ns)| {
        let limit_ns = timeout_ns - LATE_NS;
        (oldest_ns > limit_ns).then_some(MissedTimeout { key, what, oldest_ns, limit_ns, profile })
    })
}
