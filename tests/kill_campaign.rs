//! Every process of a powered rig is killed (`kill -9`) repeatedly, under load. Requirements:
//! SR-01, SR-07, SR-19, SR-20, whole-system; hazards H1, H2, H3, H8 of the safety case.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::{Duration, Instant};

use common::monitor::{LIMIT, Monitor, SLACK, Sender, TICK_NS, off_bound, tick_of};
use common::{Footprint, Signal, TestRig, pulse_of, told, wait_for, workers};
use ipc_types::{LOGGER_COMMANDS, LoggerAnswer, LoggerRequest, TripCause, WatchdogState};
use launch::{ProcessIdentity, UnitState};

/// Rounds, each of which kills every process once; `FARREACH_KILL_ROUNDS` overrides the number. As
/// many rounds as processes, so that each process comes once at each place of the order.
const ROUNDS: usize = 8;
/// Attempts per kill; a stall of the host spoils an attempt.
const ATTEMPTS: usize = 12;
/// The topics of the loops that power the motor.
const FAST: [&str; 4] = ["card_scan", "sample", "command", "token"];
/// Ticks observed after each kill, and again after the restart.
const WATCHED: u64 = 400;
/// All processes of the rig.
fn victims() -> Vec<&'static str> {
    [workers(), vec!["launcher"]].concat()
}

/// Result of a kill.
struct Struck {
    /// Ticks from the kill, or from the victim's last message if that is later, to the first scan
    /// after the last volts at the motor. `None` if the motor kept its power.
    off_ticks: Option<u64>,
}

struct Campaign {
    rig: TestRig,
    record: PathBuf,
    monitor: Option<Monitor>,
    stalls: Vec<String>,
    /// Kills of acquisition after which the DACs kept holding volts.
    held: usize,
    off: BTreeMap<&'static str, Vec<u64>>,
    causes: BTreeMap<&'static str, BTreeMap<TripCause, usize>>,
}

impl Campaign {
    fn monitor(&self) -> &Monitor {
        self.monitor.as_ref().unwrap()
    }

    fn up(&self) -> Output {
        let (rig, record) = (self.rig.absolute_rig("hydrostatic"), self.record.to_str().unwrap());
        self.rig.run(["up", "--simulate", "--rig", &rig, "--record", record])
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
        Some(self.monitor().seen().streams.get(pulse_of(process)?)?.newest())
    }

    /// Kills once. An error is a stall of the host, which loops that were not killed show; the kill
    /// is then repeated.
    fn strike(&mut self, victim: &'static str) -> Result<Struck, String> {
        if !self.monitor().volts_flow() {
            let causes = self.monitor().seen().causes();
            let why = self.monitor().stalled(&FAST);
            self.monitor().power_up(&self.rig);
            return Err(why
                .unwrap_or_else(|| panic!("before {victim}: tripped without a kill: {causes:?}")));
        }
        let before = self.processes();
        assert_eq!(before.len(), victims().len(), "not all ready before {victim}: {before:?}");
        let pulses: BTreeMap<&str, Sender> = workers()
            .into_iter()
            .filter_map(|process| Some((process, self.pulse(process)?)))
            .collect();
        let epoch = self.monitor().seen().newest_token.unwrap().epoch;
        let struck_ns = self.monitor().mark();
        common::kill(before[victim].pid, Signal::KILL);
        self.monitor().pass_ticks(WATCHED);
        self.monitor().open_all();

        if victim == "launcher" {
            let adopted = self.up();
            assert!(adopted.status.success(), "adopting: {}", told(&adopted));
        }
        let come_back = |now: &BTreeMap<String, ProcessIdentity>| {
            now.len() == victims().len()
                && now.get(victim).is_some_and(|process| *process != before[victim])
        };
        let back = wait_for(LIMIT, || come_back(&self.processes()));
        assert!(back, "{victim} did not come back: {:?}", self.rig.launcher_status());
        if let Some(pulse) = pulses.get(victim) {
            let speaks = wait_for(LIMIT, || {
                self.pulse(victim).is_some_and(|now| now.incarnation != pulse.incarnation)
            });
            assert!(speaks, "{victim} publishes nothing");
        }
        self.monitor().pass_ticks(WATCHED);

        // The other processes are the same as before, and keep running.
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
                assert!(came, "{process} stopped publishing after the kill of {victim}");
            }
        }
        self.verdict(victim, struck_ns, epoch, pulses.get(victim).copied())
    }

    fn verdict(
        &mut self,
        victim: &'static str,
        struck_ns: u64,
        epoch: u64,
        pulse: Option<Sender>,
    ) -> Result<Struck, String> {
        let timeouts = self.monitor().timeouts();
        let profile = self.monitor().profile();
        if victim != "launcher" && off_bound(victim, profile).is_none() {
            let seen = self.monitor().seen();
            let powered = seen.scans.iter().all(|scan| scan.power)
                && seen.tokens.iter().all(|token| token.enabled && token.epoch == epoch);
            let flowing = seen.scans.iter().filter(|scan| scan.volts).count();
            let (causes, scans, account) = (seen.causes(), seen.scans.len(), seen.account());
            drop(seen);
            if powered {
                // The volts of a sine pass through 0 V where friction compensation changes sign.
                assert!(flowing * 10 > scans * 9, "{victim}: volts in {flowing} of {scans} scans");
                return Ok(Struck { off_ticks: None });
            }
            let why = self.monitor().stalled(&FAST);
            self.monitor().power_up(&self.rig);
            return Err(why.unwrap_or_else(|| {
                panic!("the kill of {victim} cut the power: {causes:?}\n{account}")
            }));
        }
        let tripped = self.monitor().seen();
        // Once a token has withdrawn permission none grants it again, whichever process has
        // restarted meanwhile.
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
            // A stall of the host tripped the rig before the kill did: the motor is off, but this
            // is no measurement of the kill.
            drop(tripped);
            self.monitor().power_up(&self.rig);
            return Err("the watchdog ran late before it learnt of the launcher's death".to_owned());
        }
        match victim {
            "launcher" => assert!(causes.contains(&TripCause::LauncherLost), "{causes:?}"),
            "watchdog" => assert!(causes.contains(&TripCause::Started), "{causes:?}"),
            _ => assert!(!causes.contains(&TripCause::LauncherLost), "{victim}: {causes:?}"),
        }
        // Whichever process was killed: the card enforces the timeout of the enable line to the
        // tick.
        if let Some(power) = tripped.last_power() {
            let line_died = tick_of(tripped.toggled.0 + timeouts.enable_line_ns) + 1;
            assert!(
                power <= line_died,
                "{victim}: powered until tick {power}, the line died at {line_died}"
            );
        }
        // The victim may have published once more between the reading of the clock and the signal.
        let last_word_ns = pulse.map_or(0, |pulse| {
            let topic = pulse_of(victim).unwrap();
            let mut senders = tripped.streams[topic].senders.iter();
            senders.find(|sender| sender.incarnation == pulse.incarnation).unwrap().last_ns
        });
        let from = tick_of(struck_ns.max(last_word_ns));
        let off_ticks = tripped.last_volts().map_or(0, |last| (last + 1).saturating_sub(from));
        // There is no bound on when the watchdog's command thread learns of the launcher's death.
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

    /// Kills a process, and powers the rig up again.
    fn kill(&mut self, victim: &'static str) {
        let mut attempts = 0;
        let struck = loop {
            attempts += 1;
            match self.strike(victim) {
                Ok(struck) => break struck,
                Err(stall) => {
                    eprintln!("repeated: {victim}: {stall}");
                    self.stalls.push(stall);
                    assert!(
                        attempts < ATTEMPTS,
                        "{victim}: the host stalled in every attempt: {:?}",
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
fn sr_19_a_killed_process_leaves_the_motor_off_in_time_and_the_others_running() {
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
    let victims = victims();
    let mut settled = None;
    let began = Instant::now();
    for round in 0..rounds {
        for turn in 0..victims.len() {
            // A different order in each round, and no unit twice within the time after which a
            // restarted unit counts as healthy.
            campaign.kill(victims[(turn + round) % victims.len()]);
        }
        if round == 1 {
            settled = Some(lowest_footprint(&name));
        }
    }
    eprintln!("{} kills, {:?}", rounds * victims.len(), began.elapsed());
    report(&campaign);

    // Shared memory does not grow; the keeper gets time to clean up.
    if let Some(settled) = settled {
        assert_no_growth(&name, &settled);
    }
    // The command plane still works.
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
    assert_eq!(restarts.len(), workers().len());
    assert!(restarts.values().all(|&count| count as usize >= rounds), "{restarts:?}");
    assert!(
        campaign.stalls.len() <= rounds * victims.len() / 4,
        "too many stalls to conclude: {:?}",
        campaign.stalls
    );

    // The kill of acquisition tests the enable line only if the DACs kept holding volts that no
    // longer reached the motor. (If the host stalls at that moment, the gate closes first.)
    assert!(
        campaign.held * 2 > rounds,
        "the card held its last volts after {} of {rounds} deaths",
        campaign.held
    );

    campaign.monitor = None;
    campaign.rig.down();
    let parts = verify_parts(&campaign.rig, &campaign.record);
    // Each kill of the logger begins a new part; repeated kills begin more.
    assert!(parts > rounds, "{parts} parts after {rounds} kills of the logger");
}

/// Asserts that the rig's shared memory returns to its size after the second round.
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

/// The smallest footprint seen while the keeper cleans up.
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
        // The gate is the faster and usual way to 0 V as long as acquisition is alive.
        if *victim == "control" {
            let gate = timeouts.token_ns / TICK_NS + SLACK;
            assert!(median <= gate, "the gate took {median} ticks, expected at most {gate}");
        }
    }
    eprintln!("stalls of the machine: {:?}", campaign.stalls);
}

/// Verifies every part. Messages lost while the logger was down show as gaps; there must be no
/// other damage.
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
        // At most one unflushed chunk and the beginning of the next are cut off.
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
