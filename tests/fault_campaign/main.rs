//! The fault campaign: every kind of fault, in a rig of real processes under power, with what
//! becomes of the motor, of the other processes and of the recording. Requirements: SR-01, SR-04,
//! SR-07, SR-19, SR-20, whole-system; hazards H1 to H6, H8, H12 of the safety case.
//!
//! In a test run each kind comes once, in the profile that the host can keep. The whole campaign,
//! whose result is `docs/fault-campaign.md` (46 minutes; 50 injections, nearly three hours):
//!
//! ```sh
//! FARREACH_INJECTIONS=14 FARREACH_PROFILES="realtime best-effort" UPDATE_PAGES=1 \
//!     cargo test --release --test fault_campaign -- --nocapture
//! ```
//!
//! `FARREACH_KINDS=TEXT` leaves out the kinds whose names do not contain it.
#![allow(clippy::unwrap_used, clippy::expect_used, unreachable_pub)]

mod alone;
#[path = "../common/mod.rs"]
mod common;
mod expected;
mod forgeries;
mod host_stalls;
mod host_troubles;
mod kinds;
mod recordings;
mod strike;
mod table;
mod verdict;

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use alone::Alone;
use common::TestRig;
use expected::gate_bound;
use host_troubles::PrivateDisks;
use ipc_types::Profile;
use kinds::{Injection, Kind};
use rand::seq::SliceRandom;
use runtime::realtime::{PROFILE_VARIABLE, chosen_profile};
use strike::{Outcome, Target};
use verdict::Verdict;

/// Injections of each kind in a test run.
const INJECTIONS: usize = 1;
/// Attempts at one injection. A stall of the host spoils one; what spoils all is no stall.
const ATTEMPTS: usize = 24;
/// The same where the host stalls too long without a rig, too.
const ATTEMPTS_ALONE: usize = 3;
/// Where the inner process writes its outcomes.
const TO: &str = "FARREACH_CAMPAIGN_TO";
/// Leaves out the kinds whose names do not contain it.
const KINDS: &str = "FARREACH_KINDS";
/// Its private disks.
const DISKS: &str = "FARREACH_CAMPAIGN_DISKS";
const TEST: &str = "sr_19_every_kind_of_fault_leaves_the_motor_off_in_time_and_the_others_running";

fn injections() -> usize {
    std::env::var("FARREACH_INJECTIONS").map_or(INJECTIONS, |text| text.parse().unwrap())
}

#[test]
fn sr_19_every_kind_of_fault_leaves_the_motor_off_in_time_and_the_others_running() {
    if let Some(to) = std::env::var_os(TO) {
        return campaign(Path::new(&to));
    }
    // `None`: the profile that the host can keep.
    let profiles: Vec<Option<Profile>> = std::env::var("FARREACH_PROFILES").map_or_else(
        |_| vec![None],
        |text| text.split_whitespace().map(|name| Some(profile_of(name))).collect(),
    );
    let directory = tempfile::tempdir().unwrap();
    let to = directory.path().join("outcomes.jsonl");
    for profile in profiles {
        run_inner(directory.path(), &to, profile);
    }
    let text = std::fs::read_to_string(&to).unwrap();
    let outcomes: Vec<Outcome> =
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    println!("{}", table::text(&outcomes));
    if std::env::var_os("UPDATE_PAGES").is_some() {
        table::write_page(&outcomes);
    }
    let failed: Vec<&Outcome> =
        outcomes.iter().filter(|it| matches!(it.verdict, Verdict::Failed(_))).collect();
    assert!(failed.is_empty(), "{} of {}: {failed:#?}", failed.len(), outcomes.len());
    assert_quick_and_held(&outcomes);
}

fn profile_of(name: &str) -> Profile {
    let found = Profile::ALL.iter().find(|profile| profile.text() == name);
    *found.unwrap_or_else(|| panic!("FARREACH_PROFILES: expected {:?}, found {name}", Profile::ALL))
}

/// What each way to 0 V must have shown of itself.
fn assert_quick_and_held(outcomes: &[Outcome]) {
    if std::env::var_os(KINDS).is_some() {
        return;
    }
    let of = |process: &str| {
        let kinds = [
            format!("kill {process}"),
            format!("stop {process} for 300 ms"),
            format!("stop {process} for 2000 ms"),
        ];
        outcomes.iter().filter(|it| kinds.contains(&it.kind)).collect::<Vec<_>>()
    };
    // The kill of acquisition tests the enable line only if the DACs kept holding volts that no
    // longer reached the motor. (If the host stalls at that moment, the gate closes first.)
    assert!(of("acquisition").iter().any(|it| it.held), "{:#?}", of("acquisition"));
    // The gate is the faster and usual way to 0 V as long as acquisition is alive.
    for &profile in Profile::ALL {
        let mut own = of("control");
        own.retain(|it| it.profile == profile);
        let quick = |it: &&Outcome| it.off_ticks.is_some_and(|off| off <= gate_bound(profile));
        assert!(own.is_empty() || own.iter().any(quick), "{own:#?}");
    }
}

/// Runs this test in a process of its own, because a process joins one rig only; with private
/// mounts where the host allows them.
fn run_inner(directory: &Path, to: &Path, profile: Option<Profile>) {
    let program = std::env::current_exe().unwrap();
    let disks = directory.join("disks");
    for name in ["tiny", "read-only"] {
        std::fs::create_dir_all(disks.join(name)).unwrap();
    }
    let mut command = match common::private_mounts() {
        Some(mut command) => {
            let script = r#"
                mount -t tmpfs -o size=512m tmpfs /dev/shm &&
                mount -t tmpfs -o size=256k tmpfs "$1/tiny" &&
                mount -t tmpfs -o ro tmpfs "$1/read-only" && shift && exec "$@""#;
            command.args(["sh", "-c", script, "sh"]).arg(&disks).arg(program);
            command.env(DISKS, &disks);
            command
        }
        None => Command::new(program),
    };
    command.args([TEST, "--exact", "--nocapture"]).env(TO, to).stdin(Stdio::null());
    if let Some(profile) = profile {
        command.env(PROFILE_VARIABLE, profile.text());
    }
    let status = command.status().unwrap();
    assert!(status.success(), "the campaign in profile {profile:?}: {status}");
}

fn target(only: &str) -> Target {
    let rig = match chosen_profile() {
        Some(profile) => TestRig::of_profile("campaign", profile),
        None => TestRig::new("campaign"),
    };
    let disks = std::env::var_os(DISKS).map(PathBuf::from);
    let disks =
        disks.map(|at| PrivateDisks { tiny: at.join("tiny"), read_only: at.join("read-only") });
    Target::new(rig, disks, only, 20)
}

fn campaign(to: &Path) {
    let only = std::env::var(KINDS).unwrap_or_default();
    let mut target = target(&only);
    let mut kinds: Vec<Kind> =
        kinds::list().into_iter().filter(|kind| kind.name.contains(&only)).collect();
    kinds.retain(|kind| match kind.injection {
        Injection::Host(trouble) if !trouble.is_possible(target.disks.as_ref()) => {
            eprintln!("SKIPPED: {}: needs private mounts, or a second user", kind.name);
            false
        }
        _ => true,
    });
    let mut file = OpenOptions::new().create(true).append(true).open(to).unwrap();
    let began = Instant::now();
    let mut settled = None;
    for round in 0..injections() {
        kinds.shuffle(&mut target.random);
        for kind in &kinds {
            let outcome = struck(&mut target, kind, &mut file);
            if let Verdict::Failed(why) = &outcome.verdict {
                eprintln!("FAILED: {}: {why}", outcome.kind);
            }
        }
        let (profile, elapsed) = (target.profile(), began.elapsed());
        eprintln!("{profile}: round {} of {} kinds, {elapsed:.0?}", round + 1, kinds.len());
        let parts = recordings::verify_all_and_go_on(&mut target);
        // Each kill of the logger begins a new part.
        assert!(!only.is_empty() || parts > 1, "{parts} parts after a kill of the logger");
        if round == 0 {
            settled = Some(recordings::lowest_footprint(target.rig.name()));
        }
    }
    // Shared memory does not grow; the keeper gets time to clean up.
    if let Some(settled) = settled {
        recordings::assert_no_growth(target.rig.name(), &settled);
    }
    let Target { rig, monitor, .. } = target;
    drop(monitor);
    rig.down();
}

/// Injects until the host did not spoil it, [`ATTEMPTS`] times at most; every attempt is written.
fn struck(target: &mut Target, kind: &Kind, file: &mut std::fs::File) -> Outcome {
    let alone = target.alone.get(kind.name.as_str()).filter(|alone| alone.takes_power());
    let alone = alone.map(Alone::text);
    let attempts = if alone.is_some() { ATTEMPTS_ALONE } else { ATTEMPTS };
    let mut attempt = 1;
    loop {
        let mut outcome = target.strike(kind);
        if attempt == attempts
            && let Verdict::HostStalled(why) = &outcome.verdict
        {
            outcome.verdict = match &alone {
                Some(text) => Verdict::Undecided(text.clone()),
                None => Verdict::Failed(format!("{attempts} times in a row: {why}")),
            };
        }
        writeln!(file, "{}", serde_json::to_string(&outcome).unwrap()).unwrap();
        match &outcome.verdict {
            Verdict::HostStalled(why) => {
                let first = why.lines().next().unwrap_or_default();
                let stall_ms = outcome.stall_ms;
                eprintln!("repeated: {}: {first}; stall {stall_ms:.1} ms", kind.name);
                attempt += 1;
            }
            _ => return outcome,
        }
    }
}
