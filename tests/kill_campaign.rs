//! Every process of a powered rig is killed (`kill -9`) again and again, in the real-time profile
//! under load. Requirements: SR-01, SR-07, SR-19, SR-20, whole-system; hazards H1, H2, H3, H8 of
//! the safety case.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::{Duration, Instant};

use common::monitor::{LIMIT, Monitor, SLACK, Sender, TICK_NS, off_bound, tick_of};
use common::{Footprint, TestRig, WORKERS, told, wait_for};
use ipc_types::{LOGGER_COMMANDS, LoggerAnswer, LoggerRequest, TripCause, WatchdogState};
use launch::{ProcessIdentity, UnitState};

/// Rounds; in each, every process is killed once. `FARREACH_KILL_ROUNDS` asks for another number.
const ROUNDS: usize = 20;
const VICTIMS: [&str; 8] = [
    "keeper",
    "logger",
    "simulator",
    "acquisition",
    "control",
    "experiment",
    "watchdog",
    "launcher",
];
/// What each process publishes all the time, as its pulse.
const PULSES: [(&str, &str); 6] = [
    ("simulator", "card_scan"),
    ("acquisition", "sample"),
    ("control", "command"),
    ("watchdog", "token"),
    ("logger", "heartbeat/logger"),
    ("experiment", "heartbeat/experiment"),
];
/// Attempts at a kill that a stall of the machine spoils.
const ATTEMPTS: usize = 12;
/// The loops between the motor and its power.
const FAST: [&str; 4] = ["card_scan", "sample", "command", "token"];
/// Ticks that are watched after each kill, and again after the restart.
const WATCHED: u64 = 400;
/// What a kill came to.
struct Struck {
    /// Ticks from the kill, or the victim's last word if that came later, to the first scan from
    /// which on no volts reached the motor. `None` where the motor kept its power.
    off_ticks: Option<u64>,
}

struct Campaign {
    rig: TestRig,
    record: PathBuf,
    monitor: Option<Monitor>,
    stalls: Vec<String>,
    /// Deaths of acquisition after which the DACs went on holding volts.
    held: usize,
    off: BTreeMap<&'static str, Vec<u64>>,
    causes: BTreeMap<&'static str, BTreeMap<TripCause, usize>>,
}

impl Campaign {
    fn monitor(&self) -> &Monitor {
        self.monitor.as_ref().unwrap()
    }

    fn up(&self) -> Output {
        self.rig.run(["up", "--simulate", "--record", self.record.to_str().unwrap()])
    }

    fn processes(&self) -> BTreeMap<String, ProcessIdentity> {
        let status = self.rig.launcher_status();
        let mut found: BTreeMap<_, _> = status
            .units
            .iter()
            .filter(|unit| unit.state == UnitState::Ready)
            .filter_map(|unit| Some((unit.name.clone(), unit.process?)))
            .collect();
        found.insert("launcher".to_owned(), status.launcher);
        found
    }

    fn pulse(&self, process: &str) -> Option<Sender> {
        let (_, topic) = PULSES.iter().find(|(name, _)| *name == process)?;
        Some(self.monitor().seen().streams.get(topic)?.newest())
    }

    /// Kills once. An error is a stall of the machine, shown by loops that nobody touched: the kill
    /// is then made again.
    fn strike(&mut self, victim: &'static str) -> Result<Struck, String> {
        if !self.monitor().volts_flow() {
            let causes = self.monitor().seen().causes();
            let why = self.monitor().stalled(&FAST);
            self.monitor().power_up(&self.rig);
            return Err(why
                .unwrap_or_else(|| panic!("before {victim}: tripped without a kill: {causes:?}")));
        }
        let before = self.processes();
        assert_eq!(before.len(), VICTIMS.len(), "not all ready before {victim}: {before:?}");
        let pulses: BTreeMap<&str, Sender> = PULSES
            .iter()
            .filter_map(|(process, _)| Some((*process, self.pulse(process)?)))
            .collect();
        let epoch = self.monitor().seen().newest_token.unwrap().epoch;
        let struck_ns = self.monitor().mark();
        common::kill(before[victim].pid, libc::SIGKILL);
        self.monitor().pass_ticks(WATCHED);
        self.monitor().open_all();

        if victim == "launcher" {
            let adopted = self.up();
            assert!(adopted.status.success(), "adopting: {}", told(&adopted));
        }
        let come_back = |now: &BTreeMap<String, ProcessIdentity>| {
            now.len() == VICTIMS.len()
                && now.get(victim).is_some_and(|process| *process != before[victim])
        };
        let back = wait_for(LIMIT, || come_back(&self.processes()));
        assert!(back, "{victim} did not come back: {:?}", self.rig.launcher_status());
        if let Some(pulse) = pulses.get(victim) {
            let speaks = wait_for(LIMIT, || {
                self.pulse(victim).is_some_and(|now| now.incarnation != pulse.incarnation)
            });
            assert!(speaks, "{victim} says nothing");
        }
        self.monitor().pass_ticks(WATCHED);

        // The others are who they were, and go on.
        let after = self.processes();
        for (process, identity) in &before {
            if process != victim {
                let same = after.get(process) == Some(identity);
                assert!(same, "{process} after the kill of {victim}: {}", self.rig.why(process));
            }
        }
        for (process, pulse) in &pulses {
            if *process != victim {
                let came =
                    wait_for(LIMIT, || self.pulse(process).unwrap().sequence > pulse.sequence);
                let now = self.pulse(process).unwrap();
                assert_eq!(
                    now.incarnation, pulse.incarnation,
                    "{process} after the kill of {victim}"
                );
                assert!(came, "{process} stands still after the kill of {victim}");
            }
        }
        self.judge(victim, struck_ns, epoch, pulses.get(victim).copied())
    }

    fn judge(
        &mut self,
        victim: &'static str,
        struck_ns: u64,
        epoch: u64,
        pulse: Option<Sender>,
    ) -> Result<Struck, String> {
        let timeouts = self.monitor().timeouts();
        if matches!(victim, "keeper" | "logger" | "experiment") {
            let seen = self.monitor().seen();
            let powered = seen.scans.iter().all(|scan| scan.power)
                && seen.tokens.iter().all(|token| token.enabled && token.epoch == epoch);
            let flowing = seen.scans.iter().filter(|scan| scan.volts).count();
            let (causes, scans, account) = (seen.causes(), seen.scans.len(), seen.account());
            drop(seen);
            if powered {
                // A sine's volts pass through 0 V when the friction's changes its sign.
                assert!(flowing * 10 > scans * 9, "{victim}: volts in {flowing} of {scans} scans");
                return Ok(Struck { off_ticks: None });
            }
            let why = self.monitor().stalled(&FAST);
            self.monitor().power_up(&self.rig);
            return Err(why.unwrap_or_else(|| {
                panic!("{victim}'s death cut the power: {causes:?}\n{account}")
            }));
        }
        let tripped = self.monitor().seen();
        // The others' word of state: no leave after the first token without, whoever came back
        // meanwhile.
        let first_without =
            tripped.tokens.iter().position(|token| !token.enabled).expect("no trip");
        assert!(
            tripped.tokens[first_without..].iter().all(|token| !token.enabled),
            "{victim}: enabled again by itself: {:?}",
            tripped.tokens
        );
        let state = tripped.state().unwrap();
        let expected =
            if victim == "watchdog" { WatchdogState::Faulted } else { WatchdogState::Tripped };
        assert_eq!(state, expected, "{victim}: {:?}", tripped.causes());
        let causes = tripped.causes();
        if victim == "launcher"
            && causes.contains(&TripCause::WatchdogLate)
            && !causes.contains(&TripCause::LauncherLost)
        {
            // The machine stood still first. Off is off, but it is no answer to this death.
            drop(tripped);
            self.monitor().power_up(&self.rig);
            return Err("the watchdog ran late before it heard of the death".to_owned());
        }
        match victim {
            "launcher" => assert!(causes.contains(&TripCause::LauncherLost), "{causes:?}"),
            "watchdog" => assert!(causes.contains(&TripCause::Started), "{causes:?}"),
            _ => assert!(!causes.contains(&TripCause::LauncherLost), "{victim}: {causes:?}"),
        }
        // The enable line, whoever died: the card keeps to its life exactly.
        if let Some(power) = tripped.last_power() {
            let line_died = tick_of(tripped.toggled.0 + timeouts.line_ns) + 1;
            assert!(
                power <= line_died,
                "{victim}: powered until tick {power}, the line died at {line_died}"
            );
        }
        // Its last word may have come after the clock was read, before the signal reached it.
        let last_word_ns = pulse.map_or(0, |pulse| {
            let topic = PULSES.iter().find(|(process, _)| *process == victim).unwrap().1;
            let mut senders = tripped.streams[topic].senders.iter();
            senders.find(|sender| sender.incarnation == pulse.incarnation).unwrap().last_ns
        });
        let from = tick_of(struck_ns.max(last_word_ns));
        let off_ticks = tripped.last_volts().map_or(0, |last| (last + 1).saturating_sub(from));
        // When the watchdog's attendant learns of the launcher's death has no bound.
        if let Some(bound) = off_bound(victim, self.monitor().profile()) {
            assert!(off_ticks <= bound, "{victim}: off after {off_ticks} ticks, bound {bound}");
        }
        let held = tripped.scans.iter().any(|scan| scan.dac && !scan.volts);
        drop(tripped);
        self.held += usize::from(victim == "acquisition" && held);
        for cause in causes {
            *self.causes.entry(victim).or_default().entry(cause).or_default() += 1;
        }
        Ok(Struck { off_ticks: Some(off_ticks) })
    }

    /// Kills, and brings power back.
    fn kill(&mut self, victim: &'static str) {
        let mut attempts = 0;
        let struck = loop {
            attempts += 1;
            match self.strike(victim) {
                Ok(struck) => break struck,
                Err(stall) => {
                    eprintln!("again: {victim}: {stall}");
                    self.stalls.push(stall);
                    assert!(
                        attempts < ATTEMPTS,
                        "{victim}: whatever stalls, it does so each time: {:?}",
                        self.stalls
                    );
                }
            }
        };
        let Some(off_ticks) = struck.off_ticks else { return };
        self.off.entry(victim).or_default().push(off_ticks);
        let refused = self.rig.run(["enable"]);
        assert!(
            !refused.status.success(),
            "after {victim}'s death: `enable` without `reset` and `arm`"
        );
        self.monitor().power_up(&self.rig);
    }
}

#[test]
fn sr_19_whatever_is_killed_the_motor_is_off_in_time_and_the_others_go_on() {
    let rounds = std::env::var("FARREACH_KILL_ROUNDS").map_or(ROUNDS, |text| text.parse().unwrap());
    let rig = TestRig::new("kills");
    let record = rig.path("run.mcap");
    let mut campaign = Campaign {
        rig,
        record,
        monitor: None,
        stalls: Vec::new(),
        held: 0,
        off: BTreeMap::new(),
        causes: BTreeMap::new(),
    };
    let up = campaign.up();
    assert!(up.status.success(), "{}", told(&up));
    let mut monitor = Monitor::join(campaign.rig.name());
    monitor.load(2);
    eprintln!("profile {}", monitor.profile());
    campaign.monitor = Some(monitor);
    campaign.monitor().power_up(&campaign.rig);

    let name = campaign.rig.name().clone();
    let mut settled = None;
    let began = Instant::now();
    for round in 0..rounds {
        for turn in 0..VICTIMS.len() {
            // Another neighbour each time, and never the same unit twice within its healthy time.
            campaign.kill(VICTIMS[(turn + round) % VICTIMS.len()]);
        }
        if round == 1 {
            settled = Some(lowest_footprint(&name));
        }
    }
    eprintln!("{} kills, {:?}", rounds * VICTIMS.len(), began.elapsed());
    report(&campaign);

    // No growth: the keeper has its time to clean up.
    if let Some(settled) = settled {
        assert_no_growth(&name, &settled);
    }
    // The command plane works, too.
    {
        let domain = runtime::Domain::observe(&name).unwrap();
        let node = domain.node("asker").unwrap();
        let logger: LoggerAnswer =
            runtime::call(&node, &LOGGER_COMMANDS, &LoggerRequest::Status, Duration::from_secs(5))
                .unwrap();
        assert!(logger.recording.is_some() && logger.error.is_empty(), "{logger:?}");
    }
    let restarts: BTreeMap<String, u32> = campaign
        .rig
        .launcher_status()
        .units
        .iter()
        .map(|unit| (unit.name.clone(), unit.restarts))
        .collect();
    assert_eq!(restarts.len(), WORKERS.len());
    assert!(restarts.values().all(|&count| count as usize >= rounds), "{restarts:?}");
    assert!(
        campaign.stalls.len() <= rounds * VICTIMS.len() / 4,
        "too many stalls to conclude: {:?}",
        campaign.stalls
    );

    // What makes acquisition's death a test: the DACs went on holding volts, which no longer
    // reached the motor. (On a host that stalls just then the gate closes first.)
    assert!(
        campaign.held * 2 > rounds,
        "the card held its last volts after {} of {rounds} deaths",
        campaign.held
    );

    campaign.monitor = None;
    campaign.rig.down();
    let parts = verify_parts(&campaign.rig, &campaign.record);
    // Each death of the logger begins a part; a repeated kill begins one more.
    assert!(parts > rounds, "{parts} parts after {rounds} kills of the logger");
}

/// The shared memory of the rig shrinks to what it was after the second round.
fn assert_no_growth(name: &runtime::RigName, settled: &Footprint) {
    let (files, bytes) = settled.size();
    let mut now = Footprint::default();
    let shrunk = wait_for(LIMIT, || {
        now = Footprint::of(name);
        now.size().0 <= files && now.size().1 <= bytes
    });
    eprintln!(
        "shared memory (entries, bytes) after round 2: {:?}, at the end: {:?}",
        settled.size(),
        now.size()
    );
    assert!(
        shrunk,
        "shared memory grew from {:?} {:?}\nto {:?} {:?}\n\
         of the dead, then: {:#?}\nof the dead, now: {:#?}",
        settled.size(),
        settled.kinds(),
        now.size(),
        now.kinds(),
        settled.of_the_dead(),
        now.of_the_dead()
    );
}

/// What is left after the keeper's time to clean up: the smallest of what was seen.
fn lowest_footprint(name: &runtime::RigName) -> Footprint {
    let mut lowest = Footprint::of(name);
    let _never = wait_for(Duration::from_secs(6), || {
        let now = Footprint::of(name);
        if now.size() < lowest.size() {
            lowest = now;
        }
        false
    });
    lowest
}

fn report(campaign: &Campaign) {
    let timeouts = campaign.monitor().timeouts();
    for (victim, off) in &campaign.off {
        let mut sorted = off.clone();
        sorted.sort_unstable();
        let median = sorted[sorted.len() / 2];
        eprintln!(
            "{victim:12} off after ticks: min {} median {median} max {}; causes {:?}",
            sorted[0],
            sorted[sorted.len() - 1],
            campaign.causes.get(victim)
        );
        // The gate is the quicker way wherever acquisition lives, and the usual one.
        if *victim == "control" {
            let gate = timeouts.token_ns / TICK_NS + SLACK;
            assert!(median <= gate, "the gate's way took {median} ticks, expected at most {gate}");
        }
    }
    eprintln!("stalls of the machine: {:?}", campaign.stalls);
}

/// Verifies every part. What was lost while the logger was down shows as gaps; nothing else may be
/// wrong.
fn verify_parts(rig: &TestRig, record: &Path) -> usize {
    let directory = record.parent().unwrap();
    let mut parts: Vec<PathBuf> = std::fs::read_dir(directory)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "mcap"))
        .collect();
    parts.sort();
    for part in &parts {
        let output = rig.run(["rec", "verify", "--json", part.to_str().unwrap()]);
        assert!(matches!(output.status.code(), Some(0 | 3)), "{}", told(&output));
        let check: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(check["damage"].as_array().unwrap().len(), 0, "{part:?}: {}", check["damage"]);
        // At most what one flush had not brought to the disk is cut off: a chunk and the head of
        // the next.
        assert!(
            check["tail"]["lost_bytes"].as_u64().unwrap() <= 2 << 20,
            "{part:?}: {}",
            check["tail"]
        );
        for topic in check["topics"].as_array().unwrap() {
            let none =
                |key: &str| assert_eq!(topic[key].as_u64(), Some(0), "{part:?}: {key}: {topic}");
            none("undecodable");
            none("duplicates");
            none("dropped");
        }
        let scans =
            check["topics"].as_array().unwrap().iter().find(|topic| topic["topic"] == "card_scan");
        assert!(
            scans.is_some_and(|scans| scans["count"].as_u64().unwrap() > 0),
            "{part:?} holds no scans"
        );
    }
    parts.len()
}
