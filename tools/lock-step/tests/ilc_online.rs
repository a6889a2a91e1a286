//! Learning as the experiment process does it, without the process: player, trials and updater on
//! the lock-step rig, in lock step.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::Arc;

use experiment::ilc_trial::{IlcResult, Returned};
use experiment::ilc_update::{IlcState, IlcUpdater};
use experiment::player::{IlcJob, Player, Program};
use ipc_types::{AXES, Event, EventKind, Mode};
use learning::LearningLaw;
use learning::store::LearntReference;
use lock_step::LockStepRig;
use lock_step::ilc::{IlcSimulation, IlcTask, PUBLISHED, feedback_only, model_based};
use rig::RigFile;
use rig::protocol::Protocol;

fn rig() -> RigFile {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
    feedback_only(RigFile::load(path).unwrap())
}

fn program(keys: &str, rig: &RigFile) -> Arc<Program> {
    let text = format!(
        "[protocol]\nname = \"ilc\"\n[[segments]]\nkind = \"learn\"\namplitude_deg = 20\n\
         frequency_hz = 1\n{keys}\n"
    );
    let protocol = Protocol::parse(&text, "ilc.toml").unwrap_or_else(|error| panic!("{error}"));
    Arc::new(Program::new(&protocol, rig).unwrap_or_else(|error| panic!("{error}")))
}

/// The experiment process without its threads. The updater answers `late` steps after it was asked.
struct Live {
    system: LockStepRig,
    player: Player,
    updater: Option<IlcUpdater>,
    loaded: Option<LearntReference>,
    saved: Option<IlcState>,
    late: usize,
    results: Vec<(usize, IlcResult)>,
    events: Vec<Event>,
    steps: usize,
    /// Seconds in which the motor counts as unpowered.
    unpowered: std::ops::Range<f64>,
    modes: Vec<Mode>,
    last_position: Option<f64>,
    largest_jump: f64,
}

impl Live {
    fn new(rig: &RigFile, program: &Arc<Program>) -> Self {
        let mut player = Player::default();
        player.start(Arc::clone(program), 1);
        Self {
            system: LockStepRig::new(rig, &[]).unwrap(),
            player,
            updater: None,
            loaded: None,
            saved: None,
            late: 3,
            results: Vec::new(),
            events: Vec::new(),
            steps: 0,
            unpowered: 0.0..0.0,
            modes: Vec::new(),
            last_position: None,
            largest_jump: 0.0,
        }
    }

    /// One cycle of control; the loop of the process wakes a while after the scan.
    fn step(&mut self, wakes_late_ns: u64) {
        let scan_ns = self.system.scan_ns();
        let output = self.player.step(scan_ns + wakes_late_ns, &[0.0; AXES]);
        let setpoint = output.setpoint.unwrap();
        let moment = self.system.cycle(&setpoint).unwrap();
        self.modes.push(Mode::from_code(setpoint.mode).unwrap());
        if let Some(before) = self.last_position.replace(setpoint.position[0]) {
            self.largest_jump = self.largest_jump.max((setpoint.position[0] - before).abs());
        }
        let powered = !self.unpowered.contains(&moment.time_s);
        self.player.record(moment.sample.scan_time_ns, &moment.sample.slave_position, powered);
        self.results.iter_mut().for_each(|result| result.0 = result.0.saturating_sub(1));
        while let Some(at) = self.results.iter().position(|result| result.0 == 0) {
            let result = self.results.remove(at).1;
            self.player.receive(result);
        }
        while let Some(job) = self.player.job() {
            self.run_job(job);
        }
        self.steps += 1;
    }

    fn run_job(&mut self, job: IlcJob) {
        let result = match job {
            IlcJob::Begin { run_id, program, segment, .. } => {
                let plan = program.plan(segment as usize).unwrap().as_ref().clone();
                let updater =
                    IlcUpdater::new(plan, segment, self.loaded.take(), self.saved.take()).unwrap();
                let result = updater.ready(run_id);
                self.updater = Some(updater);
                result
            }
            IlcJob::Returned(Returned::Record(record)) => {
                let updated = self.updater.as_mut().unwrap().update(&record);
                self.events.extend(updated.event.into_iter().chain(updated.ended));
                if updated.failed {
                    self.results.push((self.late, IlcResult::failed(record.run_id)));
                }
                IlcResult::updated(record, updated.reference)
            }
            IlcJob::Returned(Returned::Reference(_)) | IlcJob::End(_) => return,
        };
        self.results.push((self.late, result));
    }

    fn run(&mut self) {
        while self.player.is_running() || self.steps == 0 {
            self.step(420_000);
            assert!(self.steps < 500_000);
        }
    }

    /// Error of each block (°).
    fn errors(&self) -> Vec<f64> {
        let blocks = self
            .events
            .iter()
            .filter(|event| event.kind == EventKind::BlockLearnt.code() && event.a > 0.0);
        blocks.map(|event| event.b.to_degrees()).collect()
    }

    fn ending(&self) -> String {
        let ended = self.events.iter().find(|event| event.kind == EventKind::LearningEnded.code());
        ended.map(|event| event.text().to_owned()).unwrap_or_default()
    }
}

fn offline(rig: &RigFile, law: LearningLaw, blocks: usize) -> Vec<f64> {
    let mut simulation = IlcSimulation::new(rig, &[], &IlcTask::of_the_thesis(law)).unwrap();
    (0..blocks).map(|_| simulation.block(None).unwrap().settled.unwrap().to_degrees()).collect()
}

/// The live task fades in where the simulation begins at once, and changes references smoothly
/// where the simulation changes them from one step to the next: from the second block on they agree
/// within a twentieth, or 0.15°.
fn assert_alike(live: &[f64], offline: &[f64]) {
    assert_eq!(live.len(), offline.len());
    for (block, (live, offline)) in live.iter().zip(offline).enumerate() {
        let allowed = f64::max(0.15, 0.05 * offline);
        assert!(
            (live - offline).abs() < allowed,
            "block {}: {live}° live, {offline}° offline",
            block + 1
        );
    }
}

#[test]
fn the_published_law_comes_to_the_same_as_offline() {
    let rig = rig();
    let program = program("blocks = 30\nlaw = \"published\"", &rig);
    let mut live = Live::new(&rig, &program);
    live.run();
    let offline = offline(&rig, LearningLaw::Published(PUBLISHED), 30);
    eprintln!("live {:.2?}\noffline {offline:.2?}", live.errors());
    assert_alike(&live.errors(), &offline);
    assert!(live.ending().starts_with("all blocks are done"), "{}", live.ending());
    assert_eq!(live.modes[100], Mode::Learning);
    // The reference moves by no more in a step than twice what the movement itself asks for at its
    // fastest.
    assert!(
        live.largest_jump < 2.0 * 20f64.to_radians() * std::f64::consts::TAU / 500.0 * 1.5,
        "{}",
        live.largest_jump
    );
}

#[test]
fn the_model_based_law_identifies_for_itself() {
    let rig = rig();
    let program = program("blocks = 10\nlaw = \"model-based\"\nidentify_amplitude_deg = 40", &rig);
    let mut live = Live::new(&rig, &program);
    live.run();
    let task = IlcTask::of_the_thesis(LearningLaw::Published(PUBLISHED));
    let law = model_based(&rig, &[], &task).unwrap();
    let offline = offline(&rig, LearningLaw::ModelBased(law), 10);
    eprintln!("live {:.2?}\noffline {offline:.2?}", live.errors());
    let least = |errors: &[f64]| errors.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(
        least(&live.errors()) < 1.2 * least(&offline),
        "{:?}, offline {offline:?}",
        live.errors()
    );
}

fn deg(value: f64) -> f64 {
    value.to_degrees()
}

/// Control dies in the middle: the blocks without power are told and not learnt from, the others go
/// on from where the learner was.
#[test]
fn blocks_without_power_are_not_learnt_from() {
    let rig = rig();
    let program = program("blocks = 20\nlaw = \"published\"", &rig);
    let mut live = Live::new(&rig, &program);
    // Fade of 2 s, blocks of 3 s: within block 10 and up to block 11.
    live.unpowered = 30.5..32.5;
    live.run();
    let texts: Vec<_> =
        live.events.iter().map(|event| (event.a, event.text().to_owned())).collect();
    for block in 1..=20usize {
        let broken = block == 10 || block == 11;
        let text = &texts.iter().find(|(a, _)| *a == block as f64).unwrap().1;
        assert_eq!(text.contains("no power"), broken, "{block}: {text}");
    }
    let unbroken = offline(&rig, LearningLaw::Published(PUBLISHED), 18);
    // Two blocks less were learnt from, and the law has lost the error before.
    let last = *live.errors().last().unwrap();
    assert!(
        (last - unbroken[17]).abs() < 0.05 * unbroken[17],
        "{last}°, {}° after 18 blocks",
        unbroken[17]
    );
}

/// An update that takes most of a block: the new reference waits for the next block, the block
/// between is not learnt from.
#[test]
fn a_slow_update_costs_blocks_and_nothing_else() {
    let rig = rig();
    let program = program("blocks = 40\nlaw = \"published\"", &rig);
    let mut live = Live::new(&rig, &program);
    live.late = 1200;
    live.run();
    let errors = live.errors();
    let late = live.events.iter().filter(|event| event.text().contains("too late")).count();
    assert!((18..=21).contains(&late), "{late} of 40 blocks");
    let offline = offline(&rig, LearningLaw::Published(PUBLISHED), 20);
    assert!(
        (errors[38] - offline[19]).abs() < 0.1 * offline[19],
        "{}°, {}°",
        errors[38],
        offline[19]
    );
}

/// Killed between two blocks, another process goes on with the next; what it comes to is what one
/// process would have come to.
#[test]
fn a_restart_goes_on_with_the_next_block() {
    let rig = rig();
    let program = program("blocks = 24\nlaw = \"published\"", &rig);
    let mut whole = Live::new(&rig, &program);
    whole.run();
    let mut first = Live::new(&rig, &program);
    while first.errors().len() < 12 {
        first.step(420_000);
    }
    let saved = first.updater.as_ref().unwrap().state(1, program.identity()).unwrap();
    assert_eq!(saved.done, 12);
    let mut second = Live::new(&rig, &program);
    second.saved = Some(saved);
    second.run();
    let numbers: Vec<_> = second.events.iter().map(|event| event.a).collect();
    assert_eq!(numbers[0], 13.0);
    assert_eq!(second.errors().len(), 12);
    // A fade of two seconds again, and half of the blocks.
    assert!(
        (second.steps as f64 - (2.0 + 36.0 + 1.0) * 500.0).abs() < 20.0,
        "{} steps",
        second.steps
    );
    let (ends, end) = (second.errors()[11], whole.errors()[23]);
    assert!((ends - end).abs() < 0.05 * end, "{ends}° after a restart, {end}° without");
}

/// The error grows: learning ends, and the best reference goes on.
#[test]
fn learning_ends_when_the_error_grows() {
    let rig = rig();
    // So high a cut-off and so little delay feed what the transmission turns round.
    let keys = "blocks = 60\nlaw = \"published\"\ngamma_p = 0.5\ngamma_d = 0.0\ncutoff_hz = 40\n\
                delay_s = 0.0\ngrowth = 1.2\npatience = 3";
    let program = program(keys, &rig);
    let mut live = Live::new(&rig, &program);
    live.run();
    let errors = live.errors();
    assert!(live.ending().starts_with("the error grew"), "{} {errors:.2?}", live.ending());
    assert_eq!(errors.len(), 60, "the best reference goes on to the end");
    let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
    let tail = errors[55..].iter().sum::<f64>() / 5.0;
    assert!(tail < 1.5 * best + 0.2, "{tail}° at the end, {best}° at best");
}

/// What was learnt comes back from its file: the first block is as good as the last was. `law =
/// "none"` changes nothing about it.
#[test]
fn a_kept_reference_is_played_again() {
    let rig = rig();
    let mut live =
        Live::new(&rig, &program("blocks = 40\nlaw = \"published\"\nsave = \"sine\"", &rig));
    live.run();
    let best = live.updater.as_ref().unwrap().best().unwrap().unwrap();
    let folder = std::env::temp_dir().join(format!("farreach-task-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    best.save(folder.join("sine.learnt")).unwrap();
    let again = program("blocks = 4\nlaw = \"none\"\nload = \"sine\"", &rig);
    let loaded =
        LearntReference::load(folder.join("sine.learnt"), &again.plan(0).unwrap().scope).unwrap();
    let other = program("blocks = 4\nlaw = \"none\"\nload = \"sine\"\ncentre_deg = 5", &rig);
    assert!(
        LearntReference::load(folder.join("sine.learnt"), &other.plan(0).unwrap().scope).is_err()
    );
    std::fs::remove_dir_all(&folder).unwrap();
    let mut second = Live::new(&rig, &again);
    second.loaded = Some(loaded);
    second.run();
    let saved = deg(best.error);
    assert_eq!(second.errors().len(), 4);
    assert!(
        second.errors().iter().all(|error| (error - saved).abs() < 0.3),
        "{:?}, saved {saved}°",
        second.errors()
    );
}

/// Without power there is no response, and the protocol stops by itself.
#[test]
fn an_identification_without_power_stops_the_protocol() {
    let rig = rig();
    let program = program("blocks = 5\nlaw = \"model-based\"\nharmonics = 3", &rig);
    let mut live = Live::new(&rig, &program);
    live.unpowered = 0.0..1e9;
    live.run();
    assert!(live.ending().contains("no power"), "{}", live.ending());
    assert!((live.steps as f64) < 13.0 * 500.0, "{} steps", live.steps);
    for _ in 0..600 {
        live.step(420_000);
    }
    assert_eq!(*live.modes.last().unwrap(), Mode::Passive);
}

/// Lateness of the loop, up to the limit of the best-effort profile, enters neither reference nor
/// record.
#[test]
fn a_late_loop_learns_the_same() {
    let rig = rig();
    let program = program("blocks = 15\nlaw = \"published\"", &rig);
    let mut live = Live::new(&rig, &program);
    let mut random = 1u64;
    while live.player.is_running() || live.steps == 0 {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        live.step(random >> 41);
    }
    let offline = offline(&rig, LearningLaw::Published(PUBLISHED), 15);
    assert_alike(&live.errors(), &offline);
}
