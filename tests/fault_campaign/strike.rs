//! One injection: what is done, what is seen of it, and the verdict.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::{Duration, Instant};

use ipc_types::{LoggerRequest, Profile, SIMULATOR_COMMANDS, SimulatorAnswer, SimulatorRequest};
use launch::{ProcessIdentity, UnitState};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use runtime::clock::now_ns;
use serde::{Deserialize, Serialize};

use crate::alone::Alone;
use crate::common::monitor::{LIMIT, Monitor, Sender, tick_of};
use crate::common::{Signal, TestRig, kill, pulse_of, told, wait_for};
use crate::expected::{Expected, ONE_MESSAGE, of_death, of_machine, of_stop};
use crate::forgeries::{Forgery, LATER, Newest};
use crate::host_stalls::HostStalls;
use crate::host_troubles::PrivateDisks;
use crate::kinds::{Injection, Kind, Victims, processes};
use crate::recordings;
use crate::verdict::{Injected, Judgement, Verdict, judge};

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
/// Programs that take processor time meanwhile, in realtime.
pub const LOAD: usize = 2;
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
    pub profile: Profile,
}

/// A rig that is under power, and what is needed to break it.
pub struct Target {
    pub rig: TestRig,
    pub monitor: Monitor,
    pub record: PathBuf,
    pub disks: Option<PrivateDisks>,
    pub stalls: HostStalls,
    /// What the host's troubles do without a rig, by their names.
    pub alone: BTreeMap<&'static str, Alone>,
    pub random: StdRng,
}

/// The state before an injection.
struct Before {
    processes: BTreeMap<String, ProcessIdentity>,
    pulses: BTreeMap<&'static str, Sender>,
    epoch: u64,
}

/// Brings the rig up, or adopts what its launcher has left.
fn bring_up(rig: &TestRig, record: &Path) -> Output {
    let text = rig.absolute_rig("hydrostatic");
    rig.run(["up", "--simulate", "--rig", &text, "--record", record.to_str().unwrap()])
}

impl Target {
    pub fn new(rig: TestRig, disks: Option<PrivateDisks>, only: &str, seed: u64) -> Self {
        let record = rig.path("run.mcap");
        let alone = Alone::measure_all(rig.profile(), &rig.path("."), only);
        let up = bring_up(&rig, &record);
        assert!(up.status.success(), "{}", told(&up));
        let mut monitor = Monitor::join(rig.name());
        monitor.load(LOAD);
        let random = StdRng::seed_from_u64(seed);
        Self { rig, monitor, record, disks, stalls: HostStalls::watch(), alone, random }
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
            // The launcher may not have noticed yet.
            .filter(|(_, process)| process.is_alive())
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
        let held = self.monitor.seen().scans.iter().any(|scan| scan.dac && !scan.volts);
        let stall_ms = self.stall_ms(began_ns, &injected);
        let judgement = judge(self.profile(), kind, before.epoch, &injected, &self.monitor.seen());
        let Judgement { miss, off_ticks, cause } = judgement;
        let tried = off_ticks.is_some() && matches!(injected.expected, Expected::Off(_));
        let again = tried && self.rig.run(["enable"]).status.success();
        let again = again.then(|| "enabled without reset and arm".to_owned());
        let verdict = match missing.or(again) {
            Some(why) => Verdict::Failed(why),
            None => miss.map_or(Verdict::Held, |miss| miss.verdict(stall_ms)),
        };
        self.mend(kind);
        let bound_ticks = match injected.expected {
            Expected::Off(bound) => Some(bound),
            _ => None,
        };
        let (kind, profile) = (kind.name.clone(), self.profile());
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
        let profile = self.profile();
        let simple = |from, expected| Injected { victims: Vec::new(), from, expected, _kept: None };
        match kind.injection {
            Injection::Kill(victims) => self.kill(victims, before),
            Injection::KillSuccessor => self.kill_successor(before),
            Injection::Stop(victim, time) => self.stop(victim, time, before),
            Injection::Machine(fault, place) => {
                let fault_text = kind.name.clone();
                let request =
                    SimulatorRequest::Fault { fault: fault_text, axis: None, for_s: None };
                let answer = self.ask_simulator(&request);
                assert!(answer.error.is_empty(), "{}", answer.error);
                simple(answer.faults[0].begun_tick, of_machine(fault, place, profile))
            }
            Injection::Forge(forgery) => {
                if let Forgery::TokenOfLaterEpoch | Forgery::TokenOfSecondWatchdog = forgery {
                    self.monitor.ignore_epoch(before.epoch + LATER);
                }
                let newest = || Newest::of(&self.monitor.seen()).expect("all have spoken");
                let sent = forgery.send(&self.monitor.node(), &newest);
                let from = tick_of(sent.sent_ns);
                Injected { _kept: Some(sent.kept), ..simple(from, forgery.expected()) }
            }
            Injection::Host(trouble) => {
                trouble.make(&self.rig, &self.monitor, self.disks.as_ref());
                simple(now, trouble.expected(profile))
            }
            Injection::Verb(verb) => {
                self.rig.ok([verb]);
                // From the answer on, with which the watchdog has executed it.
                simple(tick_of(now_ns()), ONE_MESSAGE)
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

    fn stop(&self, victim: &'static str, time: Duration, before: &Before) -> Injected {
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
        let expected = of_stop(victim, lasted, self.profile());
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
            let up = bring_up(&self.rig, &self.record);
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
