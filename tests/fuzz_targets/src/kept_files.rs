//! Files that a process keeps for a restart, and reports that are kept.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, LazyLock};

use acquisition::homing::HomingState;
use experiment::contraction;
use experiment::ilc_update::{IlcState, IlcUpdater, Plan};
use experiment::interrupted::{Interrupted, InterruptedFile};
use experiment::player::{Permission, Player, Program};
use experiment::scan_tracker::ScanState;
use experiment::session_state::SessionState;
use experiment::state::PlayerState;
use experiment::trial_record::TrialRecord;
use ipc_types::{AXES, PulseSource, Zeros};
use learning::store::{LearntReference, ReferenceScope};
use logger::state::{StartRequest, load, save};
use rig::RigFile;
use rig::protocol::Protocol;
use runtime::clock::ClockPair;
use runtime::machine_report::{CheckResult, ExaminedRig, MachineReport, Verdict, objection};

use crate::{Outcome, texts};

fn told(error: impl std::fmt::Display) -> String {
    error.to_string()
}

thread_local! {
    static FOLDER: RefCell<Option<tempfile::TempDir>> = const { RefCell::new(None) };
}

/// Does something with a folder in which a file has these contents.
fn with_file<T>(name: &str, bytes: &[u8], act: impl FnOnce(&Path) -> T) -> T {
    FOLDER.with_borrow_mut(|folder| {
        let folder = folder.get_or_insert_with(|| tempfile::tempdir().expect("a folder"));
        std::fs::write(folder.path().join(name), bytes).expect("it is written");
        act(folder.path())
    })
}

/// The zeros of the encoders.
pub(crate) fn homing(bytes: &[u8]) -> Outcome {
    let state = HomingState::decode(bytes).map_err(told)?;
    let again = HomingState::decode(&state.encode().map_err(told)?).map_err(told)?;
    assert!(again == state, "{state:?} is kept as {again:?}");
    Ok(())
}

pub(crate) fn homing_seeds() -> Vec<Vec<u8>> {
    let zeros = Zeros { master: [-4, 5, i64::MAX], homed: 1, sequence: 9, ..Zeros::default() };
    let state = HomingState { session: 7, power_up: 8, zeros };
    vec![state.encode().expect("it can be written")]
}

/// A protocol that was being played: it is resumed and goes on, as after a restart.
pub(crate) fn experiment(bytes: &[u8]) -> Outcome {
    let state = PlayerState::decode(bytes).map_err(told)?;
    let again = state.encode().map_err(told)?;
    let twice = PlayerState::decode(&again).and_then(|state| state.encode()).map_err(told)?;
    assert!(again == twice, "the state changes when it is kept");
    let mut player = Player::default();
    player.resume(&state, Arc::new(program(&state)?)).map_err(told)?;
    play(&mut player, state.epoch, state.scan.newest_ns());
    Ok(())
}

const CLOCKS: ClockPair = ClockPair {
    monotonic_ns: 1_000_000_000_000,
    realtime_ns: 1_700_000_000_000_000_000,
    uncertainty_ns: 0,
};

fn rig() -> &'static RigFile {
    &texts::rigs()[0]
}

fn program(state: &PlayerState) -> Result<Program, String> {
    let protocol = Protocol::parse(&state.text, &state.name).map_err(told)?;
    Program::new(&protocol, rig()).map_err(told)?.with_pulses(&state.pulses)
}

/// Plays some steps from now, and some later.
fn play(player: &mut Player, epoch: u64, newest_ns: u64) {
    let now_ns = CLOCKS.monotonic_ns.max(newest_ns.min(1 << 62));
    for step in 0..40_u64 {
        let at_ns = now_ns + step * 2_000_000 + (step / 20) * 10_000_000_000;
        player.supervise(at_ns, Permission::Enabled(epoch), at_ns);
        let output = player.step(at_ns, &[0.01; AXES]);
        let setpoint = output.setpoint.map(|setpoint| setpoint.position);
        let positions = setpoint.into_iter().flatten();
        assert!(positions.into_iter().all(|position| !position.is_infinite()));
    }
    let _shown = format!("{:?}", player.status());
}

/// A protocol that was interrupted.
pub(crate) fn interrupted(bytes: &[u8]) -> Outcome {
    let read = |bytes: &[u8]| {
        with_file("rig.interrupted", bytes, |folder| {
            let file = InterruptedFile::new(folder, "rig");
            (file.read(), file)
        })
    };
    let (state, file) = read(bytes);
    let state = state?.expect("the file is there");
    file.keep(&state)?;
    let again = file.read()?.expect("it was kept");
    assert!(format!("{again:?}") == format!("{state:?}"), "it changes when it is kept");
    let later = ClockPair { realtime_ns: CLOCKS.realtime_ns + 3_600_000_000_000, ..CLOCKS };
    for clocks in [CLOCKS, later] {
        let program = program(&state.state)?.continuing(state.continuation(&clocks))?;
        let mut player = Player::default();
        player.start(Arc::new(program), 1);
        play(&mut player, 1, clocks.monotonic_ns);
    }
    Ok(())
}

static STATES: LazyLock<Vec<PlayerState>> = LazyLock::new(|| {
    let names = ["home", "force-matching", "block-design", "guided-1hz", "learning", "mvc"];
    let shipped = rig::PROTOCOLS.iter().filter(|shipped| names.contains(&shipped.name));
    let emulated = "2,jitter=0.001,missing=3,spurious=4.5".parse().expect("a scanner");
    let sources = [PulseSource::Line, PulseSource::Key, emulated];
    let state = |(index, shipped): (usize, &rig::Shipped)| PlayerState {
        session: 7,
        name: format!("{}.toml", shipped.name),
        text: shipped.text.to_owned(),
        protocol: rig::identity(shipped.text),
        segment: (index % 2) as u32,
        running: true,
        epoch: 2,
        client: 11,
        pulses: sources[index % sources.len()].clone(),
        scan: played(shipped, &sources[index % sources.len()]),
        keys: vec![3, 5],
        sessions: SessionState { over: 2, target: [0.25, 0.5], ..SessionState::default() },
    };
    shipped.enumerate().map(state).collect()
});

/// The scanner as far as a protocol followed it.
fn played(shipped: &rig::Shipped, source: &PulseSource) -> ScanState {
    use ipc_types::LineEvent;
    let followed = || -> Result<ScanState, String> {
        let protocol = Protocol::parse(shipped.text, shipped.name).map_err(told)?;
        let plan = experiment::scan_plan::ScanPlan {
            scan: protocol.scan,
            gate_width_s: Some(0.01),
            pulses: experiment::scan_plan::Pulses::of(source)?,
            ..Default::default()
        };
        let mut tracker = experiment::scan_tracker::ScanTracker::default();
        tracker.begin(&plan, CLOCKS.monotonic_ns);
        for volume in 0..5 {
            let at_ns = CLOCKS.monotonic_ns + 2_000_000_000 * volume;
            tracker.see(LineEvent::Pulse, at_ns);
            tracker.see_key(at_ns);
            tracker.advance(at_ns);
        }
        Ok(tracker.state())
    };
    followed().unwrap_or_default()
}

pub(crate) fn experiment_seeds() -> Vec<Vec<u8>> {
    STATES.iter().map(|state| state.encode().expect("it can be written")).collect()
}

pub(crate) fn interrupted_seeds() -> Vec<Vec<u8>> {
    let kept = |state: &PlayerState| {
        with_file("seed", b"", |folder| {
            let file = InterruptedFile::new(folder, "seed");
            file.keep(&Interrupted::new(state.clone(), &CLOCKS)).expect("it is kept");
            std::fs::read(file.path()).expect("it is there")
        })
    };
    STATES.iter().map(kept).collect()
}

/// A learning run: it goes on with the next block, as after a restart.
pub(crate) fn learning(bytes: &[u8]) -> Outcome {
    let state = IlcState::decode(bytes).map_err(told)?;
    let again = state.encode().map_err(told)?;
    let twice = IlcState::decode(&again).and_then(|state| state.encode()).map_err(told)?;
    assert!(again == twice, "the state changes when it is kept");
    let plan = PLAN.clone();
    let mut record = TrialRecord::new(&plan.schedule);
    record.block = state.done.saturating_add(1);
    let mut updater = IlcUpdater::new(plan, 0, None, Some(state)).map_err(told)?;
    let reference = updater.ready(1).reference;
    let points = reference.map_or_else(Vec::new, |reference| reference.points);
    assert!(points.iter().all(|point| point.position.is_finite()));
    let updated = updater.update(&record);
    let _told = (updated.event.map(|event| event.a), updater.best(), updater.stop());
    Ok(())
}

static PLAN: LazyLock<Plan> = LazyLock::new(|| {
    let shipped = rig::PROTOCOLS.iter().find(|shipped| shipped.name == "learning");
    let text = shipped.map_or("", |shipped| shipped.text);
    // A short cycle, so that a state is short.
    let text = text.replace("frequency_hz = 1.0 ", "frequency_hz = 2.5 ");
    let text = text.replace("amplitude_deg = 20.0 ", "amplitude_deg = 5.0 ");
    let protocol = Protocol::parse(&text, "learning.toml").expect("it is shipped");
    let program = Program::new(&protocol, rig()).expect("it fits the rig");
    Plan::clone(program.plan(0).expect("it learns"))
});

pub(crate) fn learning_seeds() -> Vec<Vec<u8>> {
    let updater = IlcUpdater::new(PLAN.clone(), 0, None, None).expect("it begins");
    let first = updater.state(7, 9).expect("it has a learner");
    let mut later = first.clone();
    later.done = 3;
    later.learner.blocks = 3;
    later.learner.best = Some((0.01, first.learner.reference.clone()));
    later.learner.previous_error = Some(vec![0.001; first.learner.reference.len()]);
    later.response = vec![None, Some((1.0, -0.5))];
    [first, later].map(|state| state.encode().expect("it can be written")).to_vec()
}

/// A reference that was learnt.
pub(crate) fn reference(bytes: &[u8]) -> Outcome {
    let reference = LearntReference::decode(bytes).map_err(told)?;
    let again = LearntReference::decode(&reference.encode().map_err(told)?).map_err(told)?;
    assert!(again == reference, "it changes when it is kept");
    reference.fits(&scope()).map_err(told)
}

fn scope() -> ReferenceScope {
    ReferenceScope {
        rig: 1,
        rig_name: "hydrostatic".to_owned(),
        axis: 0,
        rate_hz: 500,
        period_s: 0.1,
        amplitude: 0.5,
        centre: 0.0,
        feedforward: true,
    }
}

pub(crate) fn reference_seeds() -> Vec<Vec<u8>> {
    let positions = (0..50).map(|step| (f64::from(step) * 0.12).sin()).collect();
    let reference = LearntReference::new(&scope(), 0.01, positions).expect("it is whole");
    vec![reference.encode().expect("it can be written")]
}

/// What the logger is recording.
pub(crate) fn logger(bytes: &[u8]) -> Outcome {
    let read = |folder: &Path| load(folder, 7).map_err(told);
    with_file(logger::state::FILE, bytes, |folder| {
        let Some(state) = read(folder)? else { return Err("of another session".to_owned()) };
        save(folder, &state).map_err(told)?;
        assert!(read(folder) == Ok(Some(state)), "it changes when it is kept");
        Ok(())
    })
}

pub(crate) fn logger_seeds() -> Vec<Vec<u8>> {
    let request = |session| StartRequest {
        session,
        path: "/data/run.mcap".into(),
        part: 2,
        metadata: BTreeMap::from([("rig".to_owned(), "hydrostatic \"x\"\n".to_owned())]),
        realtime_offset_ns: -5,
        began_ns: 3,
        ..StartRequest::default()
    };
    [7, 8].map(|session| serde_json::to_vec_pretty(&request(session)).expect("JSON")).to_vec()
}

/// Maxima of the muscles' activity, for each rig.
pub(crate) fn maxima(bytes: &[u8]) -> Outcome {
    with_file("m.emg.json", bytes, |folder| {
        for rig in texts::rigs() {
            let maxima = contraction::load(folder, "m", rig)?;
            assert!(maxima.iter().all(|maximum| maximum.is_finite() && *maximum >= 0.0));
            if maxima.iter().any(|maximum| *maximum > 0.0) {
                contraction::save(folder, "again", rig, &maxima)?;
                assert!(contraction::load(folder, "again", rig)? == maxima, "kept otherwise");
            }
        }
        Ok(())
    })
}

pub(crate) fn maxima_seeds() -> Vec<Vec<u8>> {
    let kept = |rig: &RigFile| {
        with_file("seed", b"", |folder| {
            contraction::save(folder, "seed", rig, &[0.125; ipc_types::ANALOG]).ok()?;
            std::fs::read(folder.join("seed.emg.json")).ok()
        })
    };
    let mut seeds: Vec<Vec<u8>> = texts::rigs().iter().filter_map(kept).collect();
    seeds.push(br#"{"about":"","electrodes":[]}"#.to_vec());
    seeds
}

/// The doctor's report.
pub(crate) fn report(bytes: &[u8]) -> Outcome {
    let path = Path::new("bench.json");
    let report = MachineReport::parse(bytes, path).map_err(told)?;
    let text = serde_json::to_vec_pretty(&report).map_err(told)?;
    let again = MachineReport::parse(&text, path).map_err(told)?;
    assert!(again == report, "it changes when it is kept");
    for now_unix_ms in [0, 1_800_000_000_000, u64::MAX] {
        assert!(!report.summary(now_unix_ms).is_empty());
        let _why = objection(Some(&report), "b", now_unix_ms);
    }
    Ok(())
}

pub(crate) fn report_seeds() -> Vec<Vec<u8>> {
    let check = |verdict: Verdict| CheckResult {
        id: format!("check_{}", verdict.text()),
        title: "the clock".to_owned(),
        verdict,
        value: "1 µs".to_owned(),
        remedy: String::new(),
        measured: serde_json::json!({ "late_us": 1.5, "of": [1, 2], "name": "tsc" }),
    };
    let report = MachineReport {
        layout: runtime::machine_report::LAYOUT,
        taken_unix_ms: 1_800_000_000_000,
        host: "bench".to_owned(),
        boot_id: "b".to_owned(),
        user: 0,
        version: "0.1.0".to_owned(),
        revision: "unknown".to_owned(),
        rig_name: "bench".to_owned(),
        rig: Some(ExaminedRig {
            name: "hydrostatic".to_owned(),
            identity: "0123456789abcdef".to_owned(),
            card: "simulated".to_owned(),
            profile: "realtime".to_owned(),
        }),
        checks: Verdict::ALL.map(check).to_vec(),
    };
    vec![serde_json::to_vec_pretty(&report).expect("JSON")]
}
