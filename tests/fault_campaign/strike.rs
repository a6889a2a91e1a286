//! One injection: what is done, what is seen of it, and the verdict.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use ipc_types::{
    LoggerRequest, Profile, SIMULATOR_COMMANDS, SimulatorAnswer, SimulatorRequest, TripCause,
};
use launch::{ProcessIdentity, UnitState};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use runtime::clock::now_ns;
use serde::{Deserialize, Serialize};

use crate::common::monitor::{LIMIT, Monitor, Seen, Sender, TICK_NS, tick_of};
use crate::common::{Signal, TestRig, kill, pulse_of, told, wait_for};
use crate::forgeries::{Forgery, LATER, Newest};
use crate::host_stalls::HostStalls;
use crate::host_troubles::PrivateDisks;
use crate::kinds::{Expected, Injection, Kind, Victims, machine_fault, of_death, processes};
use crate::recordings;

/// Ticks observed after an injection, and again once everything is back.
const WATCHED: u64 = 300;
/// The same for a fault that shows where a limit is passed: a period of the movement.
const WATCHED_LONG: u64 = 1500;
/// The topics of the loops that power the motor, with the processes without which each pauses.
const FAST: [(&str, &[&str]); 4] = [
    ("card_scan", &["simulator"]),
    ("sample", &["acquisition", "simulator"]),
    ("command", &["control", "acquisition", "simulator"]),
    ("token", &["watchdog"]),
];
/// How long after its start a successor is killed (ms), at most.
const YOUNG_MS: u64 = 50;

/// What became of one injection.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Outcome {
    pub kind: String,
    pub verdict: Verdict,
    /// Ticks from the fault to the first scan without volts; `None` where the motor kept its power.
    pub off_ticks: Option<u64>,
    /// The bound, where there is one (ticks).
    pub bound_ticks: Option<u64>,
    /// From the end of the fault until every process was ready again and published (ms).
    pub back_ms: f64,
    /// Longest stall of the host meanwhile, by bare loops and by those of the rig that were left
    /// alone (ms).
    pub stall_ms: f64,
    /// Cause of the trip, if any.
    pub cause: Option<String>,
    /// Whether the DACs kept holding volts that did not reach the motor any more.
    pub held: bool,
    /// The timing profile.
    pub profile: String,
}

/// Whether what must be was so.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// As expected.
    Held,
    /// Not as expected, by a stall of the host that was measured beside it.
    HostStalled(String),
    /// Not as expected.
    Failed(String),
}

/// A rig that is under power, and what is needed to break it.
pub struct Target {
    pub rig: TestRig,
    pub monitor: Monitor,
    pub record: PathBuf,
    pub disks: Option<PrivateDisks>,
    pub stalls: HostStalls,
    pub random: StdRng,
}

/// The state before an injection.
struct Before {
    processes: BTreeMap<String, ProcessIdentity>,
    pulses: BTreeMap<&'static str, Sender>,
    epoch: u64,
}

/// What an injection did.
struct Injected {
    /// Processes that it ended or stopped.
    victims: Vec<&'static str>,
    /// Card tick from which on the bound counts.
    from: u64,
    expected: Expected,
    /// What must stay alive until it has been received.
    _kept: Option<Box<dyn std::any::Any>>,
}

impl Target {
    pub fn new(rig: TestRig, disks: Option<PrivateDisks>, seed: u64) -> Self {
        let record = rig.path("run.mcap");
        let text = rig.absolute_rig("hydrostatic");
        let path = record.to_str().unwrap();
        let up = rig.run(["up", "--simulate", "--rig", &text, "--record", path]);
        assert!(up.status.success(), "{}", told(&up));
        let mut monitor = Monitor::join(rig.name());
        monitor.load(2);
        let random = StdRng::seed_from_u64(seed);
        Self { rig, monitor, record, disks, stalls: HostStalls::watch(), random }
    }

    pub fn profile(&self) -> Profile {
        self.monitor.profile()
    }

    fn processes(&self) -> BTreeMap<String, ProcessIdentity> {
        let status = self.rig.launcher_status();
        let mut found: BTreeMap<_, _> = status
            .units
            .iter()
            .filter(|unit| unit.state == UnitState::Ready)
            .filter_map(|unit| Some((unit.name.clone(), unit.process?)))
            .collect();
        if status.launcher.is_alive() {
            found.insert("launcher".to_owned(), status.launcher);
        }
        found
    }

    fn pulse(&self, process: &str) -> Option<Sender> {
        Some(self.monitor.seen().streams.get(pulse_of(process)?)?.newest())
    }

    /// The last word of these processes' present incarnations (ns).
    fn last_word_ns(&self, process: &str, known: &BTreeMap<&'static str, Sender>) -> u64 {
        let Some(known) = known.get(process) else { return 0 };
        let seen = self.monitor.seen();
        let topic = pulse_of(process).unwrap();
        let mut senders = seen.streams[topic].senders.iter();
        senders.find(|it| it.incarnation == known.incarnation).map_or(0, |it| it.last_ns)
    }

    /// Injects once, and has everything back and under power afterwards.
    pub fn strike(&mut self, kind: &Kind) -> Outcome {
        self.ready();
        // Any moment of the movement.
        let pause = Duration::from_millis(self.random.random_range(0..400));
        std::thread::sleep(pause);
        if !self.monitor.volts_flow() {
            self.ready();
        }
        let before = self.before();
        let began_ns = self.monitor.mark();
        let injected = self.inject(kind, &before);
        let long = injected.expected == Expected::Either;
        self.monitor.pass_or_time(if long { WATCHED_LONG } else { WATCHED });
        self.end_fault(kind);
        let ended = Instant::now();
        let missing = self.come_back(&before, &injected);
        let back_ms = ended.elapsed().as_secs_f64() * 1e3;
        self.monitor.pass_ticks(WATCHED);
        let verdict_of = |seen: &Seen| judge(self.profile(), kind, &before, &injected, seen);
        let (mut verdict, off_ticks, cause) = verdict_of(&self.monitor.seen());
        if let (Verdict::Held, Some(missing)) = (&verdict, missing) {
            verdict = Verdict::Failed(missing);
        }
        let held = self.monitor.seen().scans.iter().any(|scan| scan.dac && !scan.volts);
        let stall_ms = self.stall_ms(began_ns, &injected);
        if let Verdict::Failed(why) = &verdict
            && self.explains(stall_ms, off_ticks, injected.expected)
        {
            verdict = Verdict::HostStalled(why.clone());
        }
        if off_ticks.is_some() && matches!(injected.expected, Expected::Off(_)) {
            let enabled = self.rig.run(["enable"]);
            if enabled.status.success() {
                verdict = Verdict::Failed("enabled without reset and arm".to_owned());
            }
        }
        self.mend(kind);
        let bound_ticks = match injected.expected {
            Expected::Off(bound) => Some(bound),
            _ => None,
        };
        let (kind, profile) = (kind.name.clone(), self.profile().text().to_owned());
        Outcome { kind, verdict, off_ticks, bound_ticks, back_ms, stall_ms, cause, held, profile }
    }

    /// Under power, with all processes ready.
    fn ready(&self) {
        let all = || self.processes().len() == processes().len();
        assert!(wait_for(LIMIT, all), "not all ready: {:?}", self.rig.launcher_status());
        while !self.monitor.volts_flow() {
            self.monitor.power_up(&self.rig);
        }
    }

    fn before(&self) -> Before {
        let pulses = processes()
            .into_iter()
            .filter_map(|process| Some((process, self.pulse(process)?)))
            .collect();
        let epoch = self.monitor.seen().newest_token.unwrap().epoch;
        Before { processes: self.processes(), pulses, epoch }
    }

    fn inject(&mut self, kind: &Kind, before: &Before) -> Injected {
        let now = tick_of(now_ns());
        let simple = |from, expected| Injected { victims: Vec::new(), from, expected, _kept: None };
        match kind.injection {
            Injection::Kill(victims) => self.kill(victims, before),
            Injection::KillSuccessor => self.kill_successor(before),
            Injection::Stop(victim, time) => self.stop(kind, victim, time, before),
            Injection::Machine(fault, place) => {
                let text = machine_fault(fault, place);
                let request = SimulatorRequest::Fault { fault: text, axis: None, for_s: None };
                let answer = self.ask_simulator(&request);
                assert!(answer.error.is_empty(), "{}", answer.error);
                let expected = kind.injection.expected(self.profile(), Duration::ZERO);
                simple(answer.faults[0].begun_tick, expected)
            }
            Injection::Forge(forgery) => {
                if let Forgery::TokenOfLaterEpoch | Forgery::TokenOfSecondWatchdog = forgery {
                    self.monitor.ignore_epoch(before.epoch + LATER);
                }
                let newest = || Newest::of(&self.monitor.seen()).expect("all have spoken");
                let sent = forgery.send(&self.monitor.node(), &newest);
                let expected = kind.injection.expected(self.profile(), Duration::ZERO);
                Injected { _kept: Some(sent.kept), ..simple(tick_of(sent.sent_ns), expected) }
            }
            Injection::Host(trouble) => {
                let disks = self.disks.as_ref().expect("left out without");
                trouble.make(&self.rig, &self.monitor, disks);
                simple(now, trouble.expected(self.profile()))
            }
            Injection::Verb(verb) => {
                self.rig.ok([verb]);
                let expected = kind.injection.expected(self.profile(), Duration::ZERO);
                simple(tick_of(now_ns()), expected)
            }
            Injection::SetpointsEnd => {
                self.monitor.lead(false);
                simple(now, Expected::Stays)
            }
        }
    }

    fn kill(&mut self, victims: Victims, before: &Before) -> Injected {
        let mut all = processes();
        let victims = match victims {
            Victims::One(victim) => vec![victim],
            Victims::Two => {
                let one = all.swap_remove(self.random.random_range(0..all.len()));
                vec![one, all[self.random.random_range(0..all.len())]]
            }
            Victims::AllButOne => {
                let _survivor = all.swap_remove(self.random.random_range(0..all.len()));
                all
            }
        };
        let struck_ns = now_ns();
        for victim in &victims {
            kill(before.processes[*victim].pid, Signal::KILL);
        }
        self.monitor.pass_or_time(WATCHED);
        self.after_death(victims, struck_ns, before)
    }

    /// What is expected of the deaths of these processes: the quickest bound among them counts. The
    /// victim may have published once more between the reading of the clock and the signal.
    fn after_death(&self, victims: Vec<&'static str>, struck_ns: u64, before: &Before) -> Injected {
        let bound = |victim: &&'static str| {
            let word = self.last_word_ns(victim, &before.pulses);
            let from = tick_of(struck_ns.max(word));
            (of_death(victim, self.profile()), from)
        };
        let bounds: Vec<(Expected, u64)> = victims.iter().map(bound).collect();
        let quickest = bounds.iter().filter_map(|(expected, from)| match expected {
            Expected::Off(ticks) => Some((from + ticks, *from, *expected)),
            _ => None,
        });
        let (from, expected) = match quickest.min_by_key(|(until, ..)| *until) {
            Some((_, from, expected)) => (from, expected),
            None => {
                let unbounded = bounds.iter().any(|(it, _)| *it == Expected::OffUnbounded);
                let expected = if unbounded { Expected::OffUnbounded } else { Expected::Stays };
                (tick_of(struck_ns), expected)
            }
        };
        Injected { victims, from, expected, _kept: None }
    }

    fn kill_successor(&mut self, before: &Before) -> Injected {
        let mut all = processes();
        // Nobody starts a launcher again but a person.
        all.retain(|process| *process != "launcher");
        let victim = all[self.random.random_range(0..all.len())];
        let first = before.processes[victim];
        let struck_ns = now_ns();
        kill(first.pid, Signal::KILL);
        let successor = || {
            let status = self.rig.launcher_status();
            status.unit(victim).and_then(|unit| unit.process).filter(|process| *process != first)
        };
        let mut found = None;
        let started = wait_for(LIMIT, || {
            found = successor();
            found.is_some()
        });
        assert!(started, "{victim} was not started again: {}", self.rig.why(victim));
        std::thread::sleep(Duration::from_millis(self.random.random_range(0..=YOUNG_MS)));
        kill(found.unwrap().pid, Signal::KILL);
        self.after_death(vec![victim], struck_ns, before)
    }

    fn stop(&self, kind: &Kind, victim: &'static str, time: Duration, before: &Before) -> Injected {
        let process = before.processes[victim];
        let struck = Instant::now();
        let struck_ns = now_ns();
        kill(process.pid, Signal::STOP);
        std::thread::sleep(time);
        let word_ns = self.last_word_ns(victim, &before.pulses);
        let lasted = struck.elapsed();
        // Unless the launcher has replaced it.
        if process.is_alive() {
            kill(process.pid, Signal::CONT);
        }
        let expected = kind.injection.expected(self.profile(), lasted);
        let from = tick_of(struck_ns.max(word_ns));
        Injected { victims: vec![victim], from, expected, _kept: None }
    }

    fn ask_simulator(&self, request: &SimulatorRequest) -> SimulatorAnswer {
        runtime::call(&self.monitor.node(), &SIMULATOR_COMMANDS, request, LIMIT).unwrap()
    }

    fn end_fault(&self, kind: &Kind) {
        match kind.injection {
            Injection::Machine(..) => {
                let request = SimulatorRequest::ClearFaults { fault: None, axis: None };
                let _cleared = self.ask_simulator(&request);
            }
            Injection::SetpointsEnd => self.monitor.lead(true),
            _ => {}
        }
    }

    /// Waits until every process is ready and publishes; what is missing otherwise.
    fn come_back(&self, before: &Before, injected: &Injected) -> Option<String> {
        if injected.victims.contains(&"launcher") && !before.processes["launcher"].is_alive() {
            let text = self.rig.absolute_rig("hydrostatic");
            let path = self.record.to_str().unwrap();
            let up = self.rig.run(["up", "--simulate", "--rig", &text, "--record", path]);
            if !up.status.success() {
                return Some(format!("`up` after the launcher's death: {}", told(&up)));
            }
        }
        let all = || self.processes().len() == processes().len();
        if !wait_for(LIMIT, all) {
            return Some(format!("not all came back: {:?}", self.rig.launcher_status()));
        }
        self.monitor.open_all();
        let now = self.processes();
        for (process, identity) in &before.processes {
            let struck = injected.victims.contains(&process.as_str());
            if !struck && now.get(process) != Some(identity) {
                return Some(format!("{process}, left alone: {}", self.rig.why(process)));
            }
        }
        for (process, pulse) in &before.pulses {
            let speaks = || {
                let replaced = self.processes().get(*process) != before.processes.get(*process);
                self.pulse(process).is_some_and(|now| {
                    let same = now.incarnation == pulse.incarnation;
                    same != replaced && (replaced || now.sequence > pulse.sequence)
                })
            };
            if !wait_for(LIMIT, speaks) {
                return Some(format!("{process} publishes nothing"));
            }
        }
        None
    }

    fn stall_ms(&self, began_ns: u64, injected: &Injected) -> f64 {
        let seen = self.monitor.seen();
        let struck = |process: &&str| injected.victims.contains(process);
        let own = FAST.iter().filter(|(_, needs)| !needs.iter().any(struck));
        let pause = own.filter_map(|(topic, _)| Some(seen.streams.get(topic)?.pause_ns)).max();
        drop(seen);
        self.stalls.longest_ms(began_ns).max(pause.unwrap_or(0) as f64 * 1e-6)
    }

    /// Whether a stall of the host explains what was not as expected.
    fn explains(&self, stall_ms: f64, off_ticks: Option<u64>, expected: Expected) -> bool {
        let stall_ticks = stall_ms * 1e6 / TICK_NS as f64;
        match (expected, off_ticks) {
            (Expected::Off(bound), Some(off)) => (off - bound.min(off)) as f64 <= stall_ticks,
            (Expected::Stays, Some(_)) => {
                stall_ms * 1e6 > self.monitor.timeouts().enable_line_pause_ns as f64
            }
            _ => false,
        }
    }

    /// What an injection leaves behind that a person would put in order: the zero of an encoder, a
    /// recording that was ended.
    fn mend(&self, kind: &Kind) {
        match kind.injection {
            Injection::Machine(fault, _) if fault.after != "nothing" => {
                // A new card has a new machine.
                let simulator = self.processes()["simulator"];
                kill(simulator.pid, Signal::KILL);
                let back = || self.processes().get("simulator").is_some_and(|it| *it != simulator);
                assert!(wait_for(LIMIT, back), "{}", self.rig.why("simulator"));
            }
            Injection::Host(_) => {
                let answer = recordings::ask(&self.monitor, &LoggerRequest::Status);
                if answer.recording.is_none() {
                    let path = self.record.with_file_name(format!("run-{}.mcap", now_ns()));
                    self.rig.ok(["rec", "start", path.to_str().unwrap()]);
                }
            }
            _ => {}
        }
    }
}

/// Verdict, ticks to 0 V, and the cause of the trip.
fn judge(
    profile: Profile,
    kind: &Kind,
    before: &Before,
    injected: &Injected,
    seen: &Seen,
) -> (Verdict, Option<u64>, Option<String>) {
    let permitted = seen.tokens.iter().all(|token| token.enabled && token.epoch == before.epoch);
    let causes = seen.causes();
    let cause = causes.iter().next().map(|cause| cause.text().to_owned());
    let failed = |why: String| Verdict::Failed(format!("{why}\n{}", seen.account()));
    if permitted && seen.scans.last().is_some_and(|scan| scan.power) {
        let verdict = match injected.expected {
            Expected::Off(_) | Expected::OffUnbounded => failed("it kept its power".to_owned()),
            Expected::Stays | Expected::Either => Verdict::Held,
        };
        return (verdict, None, cause);
    }
    let amplifier_acts = kind.name == "amplifier_rail";
    let last = if amplifier_acts { seen.last_power() } else { seen.last_volts() };
    let off = last.map_or(0, |last| (last + 1).saturating_sub(injected.from));
    let verdict = match injected.expected {
        Expected::Stays => failed(format!("it lost its power: {causes:?}")),
        Expected::Off(bound) if off > bound => failed(format!("off after {off} ticks")),
        _ if again(seen) => failed("enabled again by itself".to_owned()),
        _ if kind.name != "relay_stuck" && outlives_line(profile, seen) => {
            failed("power without a toggling enable line".to_owned())
        }
        Expected::Off(_) | Expected::OffUnbounded if !named(kind, &causes) => {
            failed(format!("another cause than promised: {causes:?}"))
        }
        _ => Verdict::Held,
    };
    (verdict, Some(off), cause)
}

/// Whether a permission followed its withdrawal.
fn again(seen: &Seen) -> bool {
    seen.tokens.iter().skip_while(|token| token.enabled).any(|token| token.enabled)
}

/// Whether the motor had power after the card's timeout of the enable line, to the tick.
fn outlives_line(profile: Profile, seen: &Seen) -> bool {
    let timeout_ns = runtime::Timeouts::of(profile).enable_line_ns;
    let died = tick_of(seen.toggled.0 + timeout_ns) + 1;
    seen.last_power().is_some_and(|power| power > died)
}

fn named(kind: &Kind, causes: &std::collections::BTreeSet<TripCause>) -> bool {
    let promised = kind.injection.causes();
    // The gate may be quicker than the watchdog.
    let gate = causes.contains(&TripCause::GateLatched);
    promised.is_empty() || gate || promised.iter().any(|cause| causes.contains(cause))
}
