//! Timing of the loops, and the effects of a kill.

use std::collections::BTreeMap;

use ipc_types::{EnableToken, LoopTiming, Message, MotorCommand, Process, Profile, WatchdogState};
use serde::Serialize;

use super::recorded_messages::Trace;
use super::{Kill, Percentiles};

/// One incarnation of control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// Which.
    pub incarnation: u64,
    /// Commands that it published a second, from its first to its last.
    pub hz: f64,
}

/// Rate of each incarnation of control, in the order in which they appeared. Counted by sequence,
/// so that commands that were lost on their way to the disk do not lower it. One that published a
/// single command has no rate.
pub fn command_rates(commands: &[MotorCommand]) -> Vec<Rate> {
    let mut spans: Vec<(MotorCommand, MotorCommand)> = Vec::new();
    for command in commands {
        match spans.iter_mut().find(|(first, _)| first.incarnation == command.incarnation) {
            Some((_, last)) => *last = *command,
            None => spans.push((*command, *command)),
        }
    }
    let rate = |(first, last): (MotorCommand, MotorCommand)| {
        let seconds = last.time_ns.saturating_sub(first.time_ns) as f64 * 1e-9;
        let count = last.sequence.saturating_sub(first.sequence) as f64;
        (seconds > 0.0).then_some(Rate { incarnation: first.incarnation, hz: count / seconds })
    };
    spans.into_iter().filter_map(rate).collect()
}

/// Time from the scan of a sample to the first command that is computed from it. Further commands
/// from the same sample are left out: while acquisition is down, control goes on with its last
/// sample, which the outage shows.
pub fn sample_to_command(commands: &[MotorCommand]) -> Option<Percentiles> {
    let mut newest: BTreeMap<u64, u64> = BTreeMap::new();
    let mut times = Vec::with_capacity(commands.len());
    for command in commands {
        let before = newest.insert(command.incarnation, command.sample_tick);
        if command.sample_time_ns > 0 && before != Some(command.sample_tick) {
            times.push(command.time_ns.saturating_sub(command.sample_time_ns));
        }
    }
    Percentiles::of_ns(times)
}

/// Periods that each process skipped because it woke late, over all its incarnations. The last
/// `LoopTiming` may be a second old when a process is killed; its samples, commands and tokens
/// carry the count too.
pub fn missed_periods(trace: &Trace) -> BTreeMap<Process, u64> {
    let mut missed: BTreeMap<(Process, u64), u64> = BTreeMap::new();
    let mut note = |process, incarnation, count: u64| {
        let entry = missed.entry((process, incarnation)).or_default();
        *entry = count.max(*entry);
    };
    for timing in &trace.timings {
        if let Some(process) = Process::from_code(timing.source) {
            note(process, timing.incarnation, timing.missed_periods);
        }
    }
    for sample in &trace.samples {
        note(Process::Acquisition, sample.incarnation, sample.cycles_missed);
    }
    for command in &trace.commands {
        note(Process::Control, command.incarnation, command.cycles_missed);
    }
    for token in &trace.tokens {
        note(Process::Watchdog, token.incarnation, token.cycles_missed);
    }
    let mut by_process = BTreeMap::new();
    for ((process, _), count) in missed {
        *by_process.entry(process).or_default() += count;
    }
    by_process
}

/// A time that every loop measures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct OfLoops {
    /// The worst of all processes, percentile by percentile.
    #[serde(flatten)]
    pub worst: Percentiles,
    /// Each process; where it ran more than once, the worst of its incarnations, percentile by
    /// percentile.
    pub by_process: BTreeMap<Process, Percentiles>,
}

/// A time of the loops (lateness of the wake, execution), since the start of each process, up to
/// its last `LoopTiming`.
pub fn of_loops(timings: &[LoopTiming], time_ns: impl Fn(&LoopTiming) -> [u64; 4]) -> OfLoops {
    let mut last: BTreeMap<(u8, u64), &LoopTiming> = BTreeMap::new();
    for timing in timings {
        last.insert((timing.source, timing.incarnation), timing);
    }
    let mut by_process: BTreeMap<Process, Percentiles> = BTreeMap::new();
    for ((source, _), timing) in last {
        let Some(process) = Process::from_code(source) else { continue };
        let found = Percentiles::from(time_ns(timing));
        by_process
            .entry(process)
            .and_modify(|before| *before = before.worst(found))
            .or_insert(found);
    }
    let worst = by_process.values().copied().reduce(Percentiles::worst).unwrap_or_default();
    OfLoops { worst, by_process }
}

/// The profile of a run: real-time only when every process was granted it throughout.
pub fn profile(trace: &Trace) -> Profile {
    let (samples, commands) = (trace.samples.iter(), trace.commands.iter());
    let realtime = samples
        .map(|sample| sample.profile)
        .chain(commands.map(|command| command.profile))
        .chain(trace.tokens.iter().map(|token| token.profile))
        .chain(trace.scans.iter().map(|scan| scan.profile))
        .all(|code| Profile::from_code(code) == Some(Profile::Realtime));
    if realtime { Profile::Realtime } else { Profile::BestEffort }
}

/// Timing of the processes.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    /// Profile that the host granted.
    pub profile: Profile,
    /// Control, by incarnation.
    pub command_rates: Vec<Rate>,
    /// Skipped periods by process.
    pub missed_periods: BTreeMap<Process, u64>,
    /// Wake lateness.
    pub wake_late: OfLoops,
    /// How long the loops took for a cycle.
    pub cycle: OfLoops,
    /// Sample to command; all 0 where there was no command.
    pub sample_to_command: Percentiles,
}

impl Timing {
    /// Of a run.
    pub fn of(trace: &Trace) -> Self {
        Self {
            profile: profile(trace),
            command_rates: command_rates(&trace.commands),
            missed_periods: missed_periods(trace),
            wake_late: of_loops(&trace.timings, |timing| timing.total_wake_late_ns),
            cycle: of_loops(&trace.timings, |timing| timing.total_execution_ns),
            sample_to_command: sample_to_command(&trace.commands).unwrap_or_default(),
        }
    }
}

/// Effects of one kill. Times are ms since the kill.
#[derive(Clone, Debug, PartialEq)]
pub struct Outage {
    /// The kill.
    pub kill: Kill,
    /// Volts at the motor in the card's last scan before it; not finite where there was none.
    pub volts_before: f64,
    /// To the card's first scan at 0 V, if it then stayed at 0 V until power was enabled again.
    pub trip_ms: Option<f64>,
    /// To the watchdog's first token that says tripped.
    pub tripped_ms: Option<f64>,
    /// Why, a `TripCause`.
    pub cause: u8,
    /// To the first valid message of the next incarnation.
    pub restart_ms: Option<f64>,
    /// To the first token of a higher epoch.
    pub enabled_ms: Option<f64>,
    /// To the card's first scan with volts at the motor after that.
    pub powered_ms: Option<f64>,
}

/// The effects of a kill; `until_ns` is the time of the next kill.
pub fn outage(trace: &Trace, kill: Kill, until_ns: Option<u64>) -> Outage {
    let end = until_ns.unwrap_or(u64::MAX);
    let after = |time_ns: u64| time_ns >= kill.at_ns && time_ns < end;
    let ms = |time_ns: u64| (time_ns - kill.at_ns) as f64 * 1e-6;

    let before = |token: &&EnableToken| token.time_ns < kill.at_ns;
    let epoch = trace.tokens.iter().filter(before).map(|token| token.epoch).max().unwrap_or(0);
    let tokens = || trace.tokens.iter().filter(|token| after(token.time_ns));
    let tripped = tokens().find(|token| token.state == WatchdogState::Tripped.code());
    let enabled_ns =
        tokens().find(|token| token.enabled == 1 && token.epoch > epoch).map(|token| token.time_ns);

    let unpowered_until = enabled_ns.unwrap_or(end);
    let scans = || trace.scans.iter().filter(|scan| after(scan.scan_time_ns));
    let mut trip_ns = None;
    for scan in scans().filter(|scan| scan.scan_time_ns < unpowered_until) {
        if scan.motor_v[0] == 0.0 {
            trip_ns = trip_ns.or(Some(scan.scan_time_ns));
        } else {
            trip_ns = None;
        }
    }
    let mut scans = scans();
    let powered = scans.find(|scan| scan.scan_time_ns >= unpowered_until && scan.motor_v[0] != 0.0);
    let before = trace.scans.iter().rev().find(|scan| scan.scan_time_ns < kill.at_ns);
    Outage {
        kill,
        volts_before: before.map_or(f64::NAN, |scan| scan.motor_v[0]),
        trip_ms: trip_ns.map(ms),
        tripped_ms: tripped.map(|token| ms(token.time_ns)),
        cause: tripped.map_or(0, |token| token.cause),
        restart_ms: restart_ns(trace, kill, end).map(ms),
        enabled_ms: enabled_ns.map(ms),
        powered_ms: powered.map(|scan| ms(scan.scan_time_ns)),
    }
}

/// First valid message of the next incarnation: a command with finite volts that answers a sample,
/// a sample with a tick.
fn restart_ns(trace: &Trace, kill: Kill, end: u64) -> Option<u64> {
    fn next<T: Message>(rows: &[T], kill: Kill, end: u64, valid: fn(&T) -> bool) -> Option<u64> {
        let killed = rows.iter().rev().find(|row| row.time_ns() < kill.at_ns);
        let killed = killed.map(Message::incarnation);
        rows.iter()
            .filter(|row| row.time_ns() >= kill.at_ns && row.time_ns() < end)
            .find(|row| valid(row) && Some(row.incarnation()) != killed)
            .map(Message::time_ns)
    }
    match kill.process {
        Process::Control => next(&trace.commands, kill, end, |command| {
            command.volts[0].is_finite() && command.sample_time_ns > 0
        }),
        Process::Acquisition => next(&trace.samples, kill, end, |sample| sample.tick > 0),
        Process::Watchdog => next(&trace.tokens, kill, end, |_| true),
        // The others publish too seldom to measure a restart by.
        _ => None,
    }
}

/// A trip that no kill explains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trip {
    /// Time of the watchdog's first token that reports it (ns, CLOCK_MONOTONIC).
    pub time_ns: u64,
    /// Why, a `TripCause`.
    pub cause: u8,
}

/// A trip within this time after a kill is attributed to it; far above what either profile needs
/// (ns).
const PROVOKED_NS: u64 = 1_000_000_000;

/// Trips from enabled that are not the first after a kill.
pub fn unprovoked(tokens: &[EnableToken], kills: &[Kill]) -> Vec<Trip> {
    let mut open: Vec<u64> = kills.iter().map(|kill| kill.at_ns).collect();
    let mut trips = Vec::new();
    for pair in tokens.windows(2) {
        let [before, after] = pair else { continue };
        let lost =
            [WatchdogState::Tripped.code(), WatchdogState::Faulted.code()].contains(&after.state);
        if before.state != WatchdogState::Enabled.code() || !lost {
            continue;
        }
        let own = |at: &u64| *at <= after.time_ns && after.time_ns - *at <= PROVOKED_NS;
        match open.iter().position(own) {
            Some(index) => {
                open.remove(index);
            }
            None => trips.push(Trip { time_ns: after.time_ns, cause: after.cause }),
        }
    }
    trips
}

/// Intervals without permission to power the motor, from the first enable on (ns,
/// CLOCK_MONOTONIC).
pub fn unpowered_spans(tokens: &[EnableToken]) -> Vec<(u64, u64)> {
    let mut spans = Vec::new();
    let mut begun = None;
    for pair in tokens.windows(2) {
        let [before, after] = pair else { continue };
        match (before.enabled == 1, after.enabled == 1) {
            (true, false) => begun = Some(after.time_ns),
            (false, true) => spans.extend(begun.take().map(|from| (from, after.time_ns))),
            _ => {}
        }
    }
    if let (Some(from), Some(last)) = (begun, tokens.last()) {
        spans.push((from, last.time_ns));
    }
    spans
}
