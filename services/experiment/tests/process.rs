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

/// Far beyond anything that a working machine needs; it only keeps a broken test from hanging.
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
            let runner = Runner::new(service, &rig())?;
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

/// A part of the rig that the test plays, in a thread, until it is dropped.
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

fn ask(service: &Service, request: &ExperimentRequest) -> ExperimentAnswer {
    call(service.node(), &EXPERIMENT_COMMANDS, request, LONG).unwrap()
}

fn run(service: &Service, protocol: &str) -> ExperimentAnswer {
    ask(
        service,
        &ExperimentRequest::Run {
            protocol: protocol.to_owned(),
            name: "short.toml".to_owned(),
            client: CLIENT,
        },
    )
}

/// Polls until `done`; what was taken on the way.
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

#[test]
fn a_protocol_is_played_stopped_and_taken_up_again() {
    let text = format!("ex-{}", std::process::id());
    let name: RigName = text.parse().unwrap();
    let keeper = Keeper::start(&name).unwrap();
    let service = Service::start(Process::Operator, &text).unwrap();
    let mut setpoints = service.subscriber(SETPOINT).unwrap();
    let mut events = service.subscriber(event_topic(Process::Experiment).unwrap()).unwrap();
    let mut heartbeats = service.subscriber(heartbeat_topic(Process::Experiment).unwrap()).unwrap();
    let process = Running::launch(&text);
    collect(&mut events, has(EventKind::ProcessStarted));
    // a late joiner gets the events before, although none follows
    let mut late = service.subscriber(event_topic(Process::Experiment).unwrap()).unwrap();
    collect(&mut late, has(EventKind::ProcessStarted));
    drop(late);

    // nothing is played against a handle of which nobody knows where it is
    let answer = run(&service, PROTOCOL);
    assert!(!answer.running && answer.error.contains("no samples"), "{answer:?}");
    let acquisition = Background::acquisition(&text);
    collect(&mut heartbeats, |beats| beats.len() > 4);

    // nor without permission
    let epoch = Arc::new(AtomicU64::new(0));
    let watchdog = Background::watchdog(&text, &epoch);
    let client = Background::client(&text);
    let answer = run(&service, PROTOCOL);
    assert!(!answer.running && answer.error.contains("not enabled"), "{answer:?}");
    epoch.store(3, Ordering::Relaxed);

    // the whole protocol, from where the handle is
    assert!(run(&service, "[protocol]\nname = 3").error.contains("name"));
    let answer = run(&service, PROTOCOL);
    assert_eq!((answer.running, answer.segments, answer.error.as_str()), (true, 2, ""));
    assert!((answer.duration_s - 0.9).abs() < 1e-9);
    let mut told = collect(&mut events, has(EventKind::ProtocolDone));
    // A machine that stalls for longer than the lease makes a segment begin again, as it should.
    told.retain(|event| event.kind != EventKind::ProtocolResumed.code());
    let expected = [
        EventKind::ProtocolStarted,
        EventKind::SegmentStarted,
        EventKind::SegmentStarted,
        EventKind::ProtocolDone,
    ];
    assert_eq!(kinds(&told), expected);
    assert_eq!((told[1].text(), told[2].text(), told[2].segment), ("here", "ten degrees", 1));
    let played = collect(&mut setpoints, |all| all.iter().any(|s| s.mode == Mode::Passive.code()));
    assert_eq!((played[0].position[0], played[0].mode), (0.1, Mode::Hold.code()));
    let reached = played.iter().rfind(|s| s.mode == Mode::Hold.code()).unwrap();
    assert!((reached.position[0] - 10f64.to_radians()).abs() < 1e-9, "{reached:?}");
    for pair in played.windows(2) {
        assert!(pair[1].at_ns > pair[0].at_ns && pair[1].sequence == pair[0].sequence + 1);
        assert!(pair[1].lease_until_ns > pair[1].at_ns);
        // minimum jerk: at most 1.875 × distance / duration
        let most = 1.875 * (10f64.to_radians() - 0.1) / 0.4
            * (pair[1].at_ns - pair[0].at_ns) as f64
            * 1e-9;
        let passive = pair[1].mode == Mode::Passive.code();
        let stalled = pair[1].at_ns > pair[0].lease_until_ns;
        assert!(
            passive || stalled || (pair[1].position[0] - pair[0].position[0]).abs() <= most + 1e-12
        );
    }
    let status = ask(&service, &ExperimentRequest::Status);
    assert!(!status.running && status.completed, "{status:?}");

    // stopped by a person
    let long = PROTOCOL.replace("duration_s = 0.3", "duration_s = 600.0");
    assert!(run(&service, &long).running);
    assert!(run(&service, &long).error.contains("short is running"));
    collect(&mut heartbeats, |beats| beats.iter().any(|beat| beat.state == 1));
    let answer = ask(&service, &ExperimentRequest::Stop { client: None });
    assert_eq!((answer.running, answer.completed, answer.error.as_str()), (false, false, ""));
    collect(&mut events, has(EventKind::ProtocolStopped));
    assert!(
        ask(&service, &ExperimentRequest::Stop { client: None })
            .error
            .contains("no protocol is running")
    );

    // ended by a trip; a later enable starts nothing
    assert!(run(&service, &long).running);
    collect(&mut heartbeats, |beats| beats.iter().any(|beat| beat.state == 1));
    epoch.store(0, Ordering::Relaxed);
    let told = collect(&mut events, has(EventKind::ProtocolStopped));
    assert!(told.last().unwrap().text().contains("a trip"), "{told:?}");
    epoch.store(4, Ordering::Relaxed);
    let status = ask(&service, &ExperimentRequest::Status);
    assert!(!status.running && status.permission_lost, "{status:?}");

    // ended by the silence of its client
    assert!(run(&service, &long).running);
    drop(client);
    let told = collect(&mut events, has(EventKind::ProtocolStopped));
    assert!(told.last().unwrap().text().contains("client has gone"), "{told:?}");
    let client = Background::client(&text);

    // a process that ends while it plays is followed by one that goes on at the segment's edge
    let second_long = PROTOCOL.replace("dwell_s = 0.2", "dwell_s = 600.0");
    assert!(run(&service, &second_long).running);
    collect(&mut events, |all| all.iter().any(|e| e.segment == 1));
    process.end();
    drop(acquisition);
    while setpoints.take().unwrap().is_some() {}
    let process = Running::launch(&text);
    let status = ask(&service, &ExperimentRequest::Status);
    assert!(status.running && status.segments == 2, "{status:?}");
    collect(&mut heartbeats, |beats| beats.len() > 10);
    assert!(setpoints.take().unwrap().is_none(), "played without samples");
    let acquisition = Background::acquisition(&text);
    let told = collect(&mut events, has(EventKind::ProtocolResumed));
    assert_eq!(
        told.iter().find(|e| e.kind == EventKind::ProtocolResumed.code()).unwrap().segment,
        1
    );
    let played = collect(&mut setpoints, |all| !all.is_empty());
    assert!(
        (played[0].position[0] - 0.1).abs() < 1e-6 && played[0].segment == 1,
        "{:?}",
        played[0]
    );

    // samples that fail: nothing is published, and it goes on where the handle is when they come
    // back
    drop(acquisition);
    std::thread::sleep(Duration::from_millis(300));
    while setpoints.take().unwrap().is_some() {}
    collect(&mut heartbeats, |beats| beats.len() > 4);
    assert!(setpoints.take().unwrap().is_none(), "played without samples");
    let acquisition = Background::acquisition(&text);
    collect(&mut events, has(EventKind::ProtocolResumed));
    // a stop is carried out even without them
    drop(acquisition);
    std::thread::sleep(Duration::from_millis(300));
    assert!(!ask(&service, &ExperimentRequest::Stop { client: None }).running);
    process.end();
    drop(client);

    // a damaged state is told of once, and nothing is played
    let file = name.run_directory().join("experiment.state");
    let mut bytes = std::fs::read(&file).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&file, bytes).unwrap();
    while events.take().unwrap().is_some() {}
    for damaged in [true, false] {
        let process = Running::launch(&text);
        let told = collect(&mut events, has(EventKind::ProcessStarted));
        assert_eq!(has(EventKind::ProtocolStopped)(&told), damaged, "{told:?}");
        let status = ask(&service, &ExperimentRequest::Status);
        assert_eq!((status.running, status.segments), (false, 0));
        process.end();
    }

    drop(watchdog);
    drop((setpoints, events, heartbeats));
    drop(service);
    assert!(keeper.end().unwrap(), "nothing else is alive");
    assert!(name.remove().unwrap());
}
