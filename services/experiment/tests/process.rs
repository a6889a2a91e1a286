//! The process on a rig of its own. (One rig a test binary: the library's configuration is
//! process-wide.)
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use experiment::{ExperimentError, Runner};
use ipc_types::*;
use rig::RigFile;
use runtime::{Keeper, RigName, Service, Subscriber, call};

/// Keeps a broken test from hanging; far longer than any step takes.
const LONG: Duration = Duration::from_secs(60);

/// The number of the test as a client.
const CLIENT: u64 = 5;

const PROTOCOL: &str = r#"
[protocol]
name = "short"

[[segments]]
kind = "hold"
label = "here"
duration_s = 0.3

[[segments]]
kind = "steps"
label = "ten degrees"
positions_deg = [10.0]
rise_s = 0.4
dwell_s = 0.2
"#;

fn rig() -> RigFile {
    RigFile::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch/rigs/hydrostatic.toml"))
        .unwrap()
}

struct Running {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<(), ExperimentError>>,
}

impl Running {
    fn launch(name: &str) -> Self {
        let name = name.to_owned();
        let (ready, wait) = mpsc::channel();
        let thread = std::thread::spawn(move || {
            let service = Service::start(Process::Experiment, &name).unwrap();
            let runner = Runner::new(service, &rig(), None)?;
            ready.send(runner.stop_flag()).unwrap();
            runner.run()
        });
        Self { stop: wait.recv().unwrap(), thread }
    }

    fn end(self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap().unwrap();
    }
}

/// A simulated process in a thread; ends when dropped.
struct Background {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Background {
    fn launch(
        name: &str,
        process: Process,
        work: impl FnOnce(Service, &AtomicBool) + Send + 'static,
    ) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (name, ending) = (name.to_owned(), Arc::clone(&stop));
        let thread =
            std::thread::spawn(move || work(Service::start(process, &name).unwrap(), &ending));
        Self { stop, thread: Some(thread) }
    }

    /// Publishes samples at 500 Hz or so, the handle at rest at 0.1 rad.
    fn acquisition(name: &str) -> Self {
        Self::launch(name, Process::Acquisition, |service, ending| {
            let mut samples = service.publisher(SAMPLE).unwrap();
            let sample = Sample {
                master_position: [0.1, 0.0, 0.0],
                master_present: 1,
                homed: 1,
                axes: 1,
                ..Sample::default()
            };
            while !ending.load(Ordering::Relaxed) {
                samples.send(sample).unwrap();
                std::thread::sleep(Duration::from_millis(2));
            }
        })
    }

    /// Publishes tokens: enabled in this epoch, or tripped where it is 0.
    fn watchdog(name: &str, epoch: &Arc<AtomicU64>) -> Self {
        let epoch = Arc::clone(epoch);
        Self::launch(name, Process::Watchdog, move |service, ending| {
            let mut tokens = service.publisher(TOKEN).unwrap();
            while !ending.load(Ordering::Relaxed) {
                let epoch = epoch.load(Ordering::Relaxed);
                let state =
                    if epoch == 0 { WatchdogState::Tripped } else { WatchdogState::Enabled };
                tokens
                    .send(EnableToken { epoch, state: state.code(), ..EnableToken::default() })
                    .unwrap();
                std::thread::sleep(Duration::from_millis(1));
            }
        })
    }

    /// The client: renews its lease, whether anything is running or not.
    fn client(name: &str) -> Self {
        Self::launch(name, Process::Operator, |service, ending| {
            while !ending.load(Ordering::Relaxed) {
                let request = ExperimentRequest::Renew { client: CLIENT };
                let _away: Result<ExperimentAnswer, _> = call(
                    service.node(),
                    &EXPERIMENT_COMMANDS,
                    &request,
                    Duration::from_millis(500),
                );
                std::thread::sleep(Duration::from_millis(20));
            }
        })
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

/// Polls until `done`; returns all messages received.
fn collect<T: Message>(
    subscriber: &mut Subscriber<T>,
    mut done: impl FnMut(&[T]) -> bool,
) -> Vec<T> {
    let begun = Instant::now();
    let mut all = Vec::new();
    while !done(&all) {
        assert!(begun.elapsed() < LONG, "waited for long; got {} messages", all.len());
        while let Some(message) = subscriber.take().unwrap() {
            all.push(message);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    all
}

fn has(kind: EventKind) -> impl Fn(&[Event]) -> bool {
    move |events| events.iter().any(|event| event.kind == kind.code())
}

fn kinds(events: &[Event]) -> Vec<EventKind> {
    events.iter().map(|event| EventKind::from_code(event.kind).unwrap()).collect()
}

/// The rig, and the test's ports on it.
struct Fixture {
    text: String,
    name: RigName,
    service: Service,
    setpoints: Subscriber<Setpoint>,
    events: Subscriber<Event>,
    heartbeats: Subscriber<Heartbeat>,
    epoch: Arc<AtomicU64>,
}

impl Fixture {
    fn new() -> Self {
        let text = format!("ex-{}", std::process::id());
        let service = Service::start(Process::Operator, &text).unwrap();
        Self {
            name: text.parse().unwrap(),
            setpoints: service.subscriber(SETPOINT).unwrap(),
            events: service.subscriber(event_topic(Process::Experiment).unwrap()).unwrap(),
            heartbeats: service.subscriber(heartbeat_topic(Process::Experiment).unwrap()).unwrap(),
            epoch: Arc::default(),
            text,
            service,
        }
    }

    fn run(&self, protocol: &str) -> ExperimentAnswer {
        let (protocol, name) = (protocol.to_owned(), "short.toml".to_owned());
        self.ask(&ExperimentRequest::Run {
            protocol,
            name,
            client: CLIENT,
            pulses: PulseSource::Line,
        })
    }

    fn check(&self, protocol: &str) -> ExperimentAnswer {
        let (protocol, name) = (protocol.to_owned(), "short.toml".to_owned());
        self.ask(&ExperimentRequest::Check { protocol, name, pulses: PulseSource::Line })
    }

    fn ask(&self, request: &ExperimentRequest) -> ExperimentAnswer {
        call(self.service.node(), &EXPERIMENT_COMMANDS, request, LONG).unwrap()
    }

    /// Waits for the event, and returns it with those before it.
    fn wait_for(&mut self, kind: EventKind) -> Vec<Event> {
        collect(&mut self.events, has(kind))
    }

    fn wait_until_running(&mut self) {
        collect(&mut self.heartbeats, |beats| beats.iter().any(|beat| beat.state == 1));
    }

    fn assert_nothing_published(&mut self, heartbeats: usize) {
        collect(&mut self.heartbeats, |beats| beats.len() > heartbeats);
        assert!(self.setpoints.take().unwrap().is_none(), "setpoints without samples");
    }

    fn discard_setpoints(&mut self) {
        while self.setpoints.take().unwrap().is_some() {}
    }
}

#[test]
fn a_protocol_is_played_stopped_and_resumed() {
    let name: RigName = format!("ex-{}", std::process::id()).parse().unwrap();
    let keeper = Keeper::start(&name).unwrap();
    let mut rig = Fixture::new();
    let process = Running::launch(&rig.text);
    rig.wait_for(EventKind::ProcessStarted);
    // A late subscriber receives the earlier events.
    let topic = event_topic(Process::Experiment).unwrap();
    collect(&mut rig.service.subscriber(topic).unwrap(), has(EventKind::ProcessStarted));

    // A protocol needs samples and an enabled motor.
    let answer = rig.run(PROTOCOL);
    assert!(!answer.running && answer.error.contains("no samples"), "{answer:?}");
    let acquisition = Background::acquisition(&rig.text);
    collect(&mut rig.heartbeats, |beats| beats.len() > 4);
    let watchdog = Background::watchdog(&rig.text, &rig.epoch);
    let client = Background::client(&rig.text);
    let answer = rig.run(PROTOCOL);
    assert!(!answer.running && answer.error.contains("not enabled"), "{answer:?}");
    rig.epoch.store(3, Ordering::Relaxed);

    plays_the_whole_protocol(&mut rig);
    let client = ends_by_stop_trip_and_lost_client(&mut rig, client);
    resumes_after_a_restart_and_lost_samples(&mut rig, process, acquisition);
    drop(client);
    reports_a_damaged_state_once(&mut rig);

    drop(watchdog);
    let Fixture { service, setpoints, events, heartbeats, .. } = rig;
    drop((setpoints, events, heartbeats));
    drop(service);
    assert!(keeper.end().unwrap(), "a process is still alive");
    assert!(name.remove().unwrap());
}

fn plays_the_whole_protocol(rig: &mut Fixture) {
    assert!(rig.run("[protocol]\nname = 3").error.contains("name"));
    let answer = rig.run(PROTOCOL);
    assert_eq!((answer.running, answer.segments, answer.error.as_str()), (true, 2, ""));
    assert!((answer.duration_s - 0.9).abs() < 1e-9);
    let mut events = rig.wait_for(EventKind::ProtocolDone);
    // On a host that stalls for longer than the lease a segment starts again, as it should.
    events.retain(|event| event.kind != EventKind::ProtocolResumed.code());
    let expected = [
        EventKind::ProtocolStarted,
        EventKind::SegmentStarted,
        EventKind::SegmentStarted,
        EventKind::ProtocolDone,
    ];
    assert_eq!(kinds(&events), expected);
    let labels = (events[1].text(), events[2].text(), events[2].segment);
    assert_eq!(labels, ("here", "ten degrees", 1));
    let passive = Mode::Passive.code();
    let played = collect(&mut rig.setpoints, |all| all.iter().any(|s| s.mode == passive));
    assert_eq!((played[0].position[0], played[0].mode), (0.1, Mode::Hold.code()));
    let reached = played.iter().rfind(|s| s.mode == Mode::Hold.code()).unwrap();
    assert!((reached.position[0] - 10f64.to_radians()).abs() < 1e-9, "{reached:?}");
    for pair in played.windows(2) {
        assert!(pair[1].at_ns > pair[0].at_ns && pair[1].sequence == pair[0].sequence + 1);
        assert!(pair[1].lease_until_ns > pair[1].at_ns);
        // The peak speed of a minimum-jerk movement is 1.875 × distance / duration.
        let elapsed_s = (pair[1].at_ns - pair[0].at_ns) as f64 * 1e-9;
        let most = 1.875 * (10f64.to_radians() - 0.1) / 0.4 * elapsed_s;
        let stalled = pair[1].at_ns > pair[0].lease_until_ns;
        let moved = (pair[1].position[0] - pair[0].position[0]).abs();
        assert!(pair[1].mode == passive || stalled || moved <= most + 1e-12);
    }
    let status = rig.ask(&ExperimentRequest::Status);
    assert!(!status.running && status.completed, "{status:?}");
}

/// Returns the client that is alive afterwards.
fn ends_by_stop_trip_and_lost_client(rig: &mut Fixture, client: Background) -> Background {
    let long = PROTOCOL.replace("duration_s = 0.3", "duration_s = 600.0");
    let stop = ExperimentRequest::Stop { client: None };
    assert!(rig.run(&long).running);
    assert!(rig.run(&long).error.contains("short is running"));
    assert!(rig.check(&long).error.contains("short is running"));
    rig.wait_until_running();
    let answer = rig.ask(&stop);
    assert_eq!((answer.running, answer.completed, answer.error.as_str()), (false, false, ""));
    rig.wait_for(EventKind::ProtocolStopped);
    assert!(rig.ask(&stop).error.contains("no protocol is running"));

    // A trip ends the protocol; enabling again starts nothing.
    assert!(rig.run(&long).running);
    rig.wait_until_running();
    rig.epoch.store(0, Ordering::Relaxed);
    let events = rig.wait_for(EventKind::ProtocolStopped);
    assert!(events.last().unwrap().text().contains("a trip"), "{events:?}");
    rig.epoch.store(4, Ordering::Relaxed);
    let status = rig.ask(&ExperimentRequest::Status);
    assert!(!status.running && status.permission_lost, "{status:?}");
    // What ended the last protocol is no reason against the next.
    assert!(status.error.contains("a trip"), "{status:?}");
    assert_eq!(rig.check(&long).error, "");
    assert!(rig.check("[protocol]\nname = 3").error.contains("name"));

    assert!(rig.run(&long).running);
    drop(client);
    let events = rig.wait_for(EventKind::ProtocolStopped);
    assert!(events.last().unwrap().text().contains("client is gone"), "{events:?}");
    Background::client(&rig.text)
}

fn resumes_after_a_restart_and_lost_samples(
    rig: &mut Fixture,
    process: Running,
    acquisition: Background,
) {
    let second_long = PROTOCOL.replace("dwell_s = 0.2", "dwell_s = 600.0");
    assert!(rig.run(&second_long).running);
    collect(&mut rig.events, |all| all.iter().any(|event| event.segment == 1));
    process.end();
    drop(acquisition);
    rig.discard_setpoints();
    let process = Running::launch(&rig.text);
    let status = rig.ask(&ExperimentRequest::Status);
    assert!(status.running && status.segments == 2, "{status:?}");
    rig.assert_nothing_published(10);
    let acquisition = Background::acquisition(&rig.text);
    let events = rig.wait_for(EventKind::ProtocolResumed);
    let resumed = events.iter().find(|e| e.kind == EventKind::ProtocolResumed.code()).unwrap();
    assert_eq!(resumed.segment, 1);
    let first = collect(&mut rig.setpoints, |all| !all.is_empty())[0];
    assert!((first.position[0] - 0.1).abs() < 1e-6 && first.segment == 1, "{first:?}");

    // Without samples no setpoint is published; the segment starts again when they return.
    drop(acquisition);
    std::thread::sleep(Duration::from_millis(300));
    rig.discard_setpoints();
    rig.assert_nothing_published(4);
    let acquisition = Background::acquisition(&rig.text);
    rig.wait_for(EventKind::ProtocolResumed);
    // A stop needs no samples.
    drop(acquisition);
    std::thread::sleep(Duration::from_millis(300));
    assert!(!rig.ask(&ExperimentRequest::Stop { client: None }).running);
    process.end();
}

fn reports_a_damaged_state_once(rig: &mut Fixture) {
    let file = rig.name.run_directory().join("experiment.state");
    let mut bytes = std::fs::read(&file).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&file, bytes).unwrap();
    while rig.events.take().unwrap().is_some() {}
    for damaged in [true, false] {
        let process = Running::launch(&rig.text);
        let events = rig.wait_for(EventKind::ProcessStarted);
        assert_eq!(has(EventKind::ProtocolStopped)(&events), damaged, "{events:?}");
        let status = rig.ask(&ExperimentRequest::Status);
        assert_eq!((status.running, status.segments), (false, 0));
        process.end();
    }
}
