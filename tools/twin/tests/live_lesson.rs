//! Learning as the experiment process does it, without the process: player, lesson and teacher on the twin, in lock step.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::Arc;

use experiment::lesson::{Lecture, Spent, Take};
use experiment::player::{Homework, Player, Program, Settings};
use experiment::teacher::{Kept, Teacher};
use ipc_types::{AXES, Event, EventKind, Mode};
use learning::LearningLaw;
use learning::store::LearntReference;
use rig::RigFile;
use rig::protocol::Protocol;
use twin::Twin;
use twin::learning::{Lesson, PUBLISHED, Pupil, bench, model_based};

fn rig() -> RigFile {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
    bench(RigFile::load(path).unwrap())
}

fn program(keys: &str, rig: &RigFile) -> Arc<Program> {
    let text = format!(
        "[protocol]\nname = \"lesson\"\n[[segments]]\nkind = \"learn\"\namplitude_deg = 20\nfrequency_hz = 1\n{keys}\n"
    );
    let protocol = Protocol::parse(&text, "lesson.toml").unwrap_or_else(|error| panic!("{error}"));
    Arc::new(Program::new(&protocol, rig).unwrap_or_else(|error| panic!("{error}")))
}

/// The experiment process without its threads. The teacher answers `late` steps after it was asked.
struct Live {
    twin: Twin,
    player: Player,
    teacher: Option<Teacher>,
    loaded: Option<LearntReference>,
    kept: Option<Kept>,
    late: usize,
    lectures: Vec<(usize, Lecture)>,
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
        let mut player = Player::new(Settings::default());
        player.start(Arc::clone(program));
        Self {
            twin: Twin::new(rig, &[]).unwrap(),
            player,
            teacher: None,
            loaded: None,
            kept: None,
            late: 3,
            lectures: Vec::new(),
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
        let scan_ns = self.twin.scan_ns();
        let output = self.player.step(scan_ns + wakes_late_ns, &[0.0; AXES]);
        let setpoint = output.setpoint.unwrap();
        let moment = self.twin.cycle(&setpoint).unwrap();
        self.modes.push(Mode::from_code(setpoint.mode).unwrap());
        if let Some(before) = self.last_position.replace(setpoint.position[0]) {
            self.largest_jump = self.largest_jump.max((setpoint.position[0] - before).abs());
        }
        let powered = !self.unpowered.contains(&moment.time_s);
        self.player.record(moment.sample.scan_time_ns, &moment.sample.slave_position, powered);
        self.lectures.iter_mut().for_each(|lecture| lecture.0 = lecture.0.saturating_sub(1));
        while let Some(at) = self.lectures.iter().position(|lecture| lecture.0 == 0) {
            let lecture = self.lectures.remove(at).1;
            self.player.take_in(lecture);
        }
        while let Some(homework) = self.player.homework() {
            self.teach(homework);
        }
        self.steps += 1;
    }

    fn teach(&mut self, homework: Homework) {
        let lecture = match homework {
            Homework::Begin { ticket, program, segment, .. } => {
                let plan = program.plan(segment as usize).unwrap().as_ref().clone();
                let teacher = Teacher::new(plan, segment, self.loaded.take(), self.kept.take()).unwrap();
                let empty = || Box::new(Take::new(&teacher.plan().timetable));
                let lecture = Lecture::Ready {
                    ticket,
                    takes: [empty(), empty()],
                    reference: teacher.reference(),
                    done: teacher.done(),
                    identified: teacher.identified(),
                };
                self.teacher = Some(teacher);
                lecture
            }
            Homework::Spent(Spent::Take(mut take)) => {
                let marked = self.teacher.as_mut().unwrap().mark(&take);
                self.events.extend(marked.event.into_iter().chain(marked.ended));
                let ticket = take.ticket;
                take.clear();
                if marked.failed {
                    self.lectures.push((self.late, Lecture::Failed { ticket }));
                }
                Lecture::Marked { ticket, take, reference: marked.reference }
            }
            Homework::Spent(Spent::Reference(_)) | Homework::End(_) => return,
        };
        self.lectures.push((self.late, lecture));
    }

    fn run(&mut self) {
        while self.player.is_running() || self.steps == 0 {
            self.step(420_000);
            assert!(self.steps < 500_000);
        }
    }

    /// Error of each block (°).
    fn errors(&self) -> Vec<f64> {
        let blocks = self.events.iter().filter(|event| event.kind == EventKind::BlockLearnt.code() && event.a > 0.0);
        blocks.map(|event| event.b.to_degrees()).collect()
    }

    fn ending(&self) -> String {
        let ended = self.events.iter().find(|event| event.kind == EventKind::LearningEnded.code());
        ended.map(|event| event.text().to_owned()).unwrap_or_default()
    }
}

fn offline(rig: &RigFile, law: LearningLaw, blocks: usize) -> Vec<f64> {
    let mut pupil = Pupil::new(rig, &[], &Lesson::of_the_thesis(law)).unwrap();
    (0..blocks).map(|_| pupil.block(None).unwrap().settled.unwrap().mean_abs.to_degrees()).collect()
}

/// The live lesson fades in where the pupil begins at once, and changes references smoothly where the pupil changes them from one
/// step to the next: from the second block on they agree within a twentieth, or 0.15°.
fn assert_alike(live: &[f64], offline: &[f64]) {
    assert_eq!(live.len(), offline.len());
    for (block, (live, offline)) in live.iter().zip(offline).enumerate() {
        let allowed = f64::max(0.15, 0.05 * offline);
        assert!((live - offline).abs() < allowed, "block {}: {live}° live, {offline}° offline", block + 1);
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
    // The reference moves by no more in a step than twice what the movement itself asks for at its fastest.
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
    let lesson = Lesson::of_the_thesis(LearningLaw::Published(PUBLISHED));
    let law = model_based(&rig, &[], &lesson).unwrap();
    let offline = offline(&rig, LearningLaw::ModelBased(law), 10);
    eprintln!("live {:.2?}\noffline {offline:.2?}", live.errors());
    let least = |errors: &[f64]| errors.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(least(&live.errors()) < 1.2 * least(&offline), "{:?}, offline {offline:?}", live.errors());
}
