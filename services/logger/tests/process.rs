//! The process on a rig of its own: what is published is on disk, and a restart goes on. (One rig a
//! test binary: the library's configuration is process-wide.)
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::Duration;

use ipc_types::*;
use logger::{Logger, LoggerError, Options};
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use recording::{part_path, parts_of};
use rig::RigFile;
use runtime::{Keeper, Publisher, RigName, Service, call};

/// Far beyond anything that a working machine needs; it only keeps a broken test from hanging.
const LONG: Duration = Duration::from_secs(60);

struct Running {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<(), LoggerError>>,
}

impl Running {
    fn end(self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap().unwrap();
    }
}

fn rig() -> RigFile {
    RigFile::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch/rigs/hydrostatic.toml"))
        .unwrap()
}

fn launch(rig_name: &RigName, options: &Options) -> Result<Running, LoggerError> {
    let (rig_name, options) = (rig_name.clone(), options.clone());
    let (ready, wait) = mpsc::channel();
    let thread = std::thread::spawn(move || {
        let service = Service::start(Process::Logger, rig_name.as_str()).unwrap();
        let logger = Logger::new(service, &rig(), &options)?;
        ready.send(logger.stop_flag()).unwrap();
        logger.run()
    });
    match wait.recv() {
        Ok(stop) => Ok(Running { stop, thread }),
        Err(_) => Err(thread.join().unwrap().unwrap_err()),
    }
}

fn ticks(path: &Path) -> Vec<u64> {
    let recording = Recording::open(path).unwrap();
    recording
        .messages::<Sample>("sample")
        .unwrap()
        .map(|message| message.unwrap().message.tick)
        .collect()
}

fn events(path: &Path) -> Vec<(EventKind, String)> {
    let recording = Recording::open(path).unwrap();
    let events = recording.messages::<Event>("event/logger").unwrap();
    events
        .map(|event| event.unwrap().message)
        .map(|event| (EventKind::from_code(event.kind).unwrap(), event.text().to_owned()))
        .collect()
}

/// A rig without a card: its domain, and a process that publishes samples.
struct Bench {
    name: RigName,
    keeper: Keeper,
    service: Service,
    samples: Publisher<Sample>,
    directory: tempfile::TempDir,
    options: Options,
}

impl Bench {
    fn new() -> Self {
        let text = format!("lg-{}", std::process::id());
        let name: RigName = text.parse().unwrap();
        let keeper = Keeper::start(&name).unwrap();
        let service = Service::start(Process::Acquisition, &text).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let options = Options {
            record: Some(directory.path().join("run.mcap")),
            metadata: BTreeMap::from([
                ("subject".to_owned(), "s01".to_owned()),
                (key::PROFILE.to_owned(), "not for others to say".to_owned()),
            ]),
            doctor: None,
        };
        let samples = service.publisher(SAMPLE).unwrap();
        Self { name, keeper, service, samples, directory, options }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn publish(&mut self, ticks: std::ops::Range<u64>) {
        for tick in ticks {
            self.samples.send(Sample { tick, axes: 1, ..Sample::default() }).unwrap();
        }
    }

    /// Writes which processes run other programs, as the launcher does.
    fn replace(&self, replaced: &str) {
        let text = format!(r#"{{"rig_name": "bench", "replaced": {replaced}}}"#);
        std::fs::write(self.name.run_directory().join("launch.json"), text).unwrap();
    }

    fn ask(&self, request: &LoggerRequest) -> LoggerAnswer {
        call(self.service.node(), &LOGGER_COMMANDS, request, LONG).unwrap()
    }
}

/// Recorded from the start; the file ends cleanly when the process ends.
fn records_from_the_start(bench: &mut Bench) {
    let first = bench.path("run.mcap");
    // a recording that cannot be begun keeps the logger from starting, and says why
    std::fs::write(&first, "somebody's data").unwrap();
    let error = launch(&bench.name, &bench.options).err().unwrap();
    assert!(matches!(error, LoggerError::NotBegun { .. }), "{error}");
    assert!(error.to_string().contains("never overwritten"), "{error}");
    std::fs::remove_file(&first).unwrap();

    let logger = launch(&bench.name, &bench.options).unwrap();
    bench.publish(0..300);
    let status = bench.ask(&LoggerRequest::Status);
    assert_eq!(status.recording.as_deref(), Some(first.to_str().unwrap()));
    logger.end();
    assert_eq!(ticks(&first), (0..300).collect::<Vec<_>>());
    let recording = Recording::open(&first).unwrap();
    let check = recording.check().unwrap();
    assert!(check.ended_cleanly && !check.data_lost(), "{check:?}");
    for (key, value) in [
        ("subject", "s01"),
        (key::RIG, "hydrostatic"),
        (key::RIG_FILE, rig().text()),
        (key::PROFILE, bench.service.domain().profile().text()),
        (key::PART, "1"),
        ("rig_name", bench.name.as_str()),
        ("session", &format!("{:016x}", bench.keeper.session())),
    ] {
        assert_eq!(recording.metadata(key), Some(value), "{key}");
    }
    assert!(recording.metadata(key::REVISION).is_some());
    // No launcher has started this rig.
    assert!(recording.metadata(key::REPLACED).unwrap().starts_with("not known: "));
    // its own topics are in it, the last words included
    for topic in ["loss", "clock", "heartbeat/logger", "event/logger"] {
        assert!(
            check.topics.iter().any(|found| found.topic == topic && found.count > 0),
            "{topic}"
        );
    }
    let kinds: Vec<_> = events(&first).into_iter().map(|(kind, _)| kind).collect();
    assert_eq!(
        kinds,
        [EventKind::RecordingStarted, EventKind::ProcessStarted, EventKind::ProcessEnding]
    );
}

/// Started again in the same session, the logger continues with the next part.
fn continues_with_the_next_part(bench: &mut Bench) -> Running {
    // Also where it was killed before it could note that it had begun.
    let begun = bench.name.run_directory().join("recording.begun");
    std::fs::remove_file(&begun).unwrap();
    bench.replace(r#"{"control": ["/bin/a", "-x"]}"#);
    let logger = launch(&bench.name, &bench.options).unwrap();
    let second = bench.path("run.part2.mcap");
    assert!(
        begun.exists(),
        "once this part is ended, a logger that starts again must not ask for part 1"
    );
    assert_eq!(
        bench.ask(&LoggerRequest::Status).recording.as_deref(),
        Some(second.to_str().unwrap())
    );
    bench.publish(300..350);
    // the answer to a stop means that everything published before is on disk
    let answer = bench.ask(&LoggerRequest::Stop);
    assert_eq!((answer.recording, answer.lost, answer.error.as_str()), (None, 0, ""));
    assert!(answer.written >= 50, "{}", answer.written);
    assert_eq!(ticks(&second), (300..350).collect::<Vec<_>>());
    let recording = Recording::open(&second).unwrap();
    assert_eq!(recording.metadata("subject"), Some("s01"));
    // What happened while no logger ran is told, and what holds from this part's beginning.
    assert_eq!(recording.metadata(key::REPLACED), Some(r#"{"control":["/bin/a","-x"]}"#));
    let replaced = (EventKind::ProcessReplaced, "control: /bin/a -x".to_owned());
    assert!(events(&second).contains(&replaced), "{:?}", events(&second));
    let answer = bench.ask(&LoggerRequest::Stop);
    assert!(answer.error.contains("nothing is being recorded"), "{}", answer.error);
    let answer = bench.ask(&tag("nobody reads this"));
    assert!(answer.error.contains("nothing is being recorded"), "{}", answer.error);
    logger
}

fn tag(text: &str) -> LoggerRequest {
    LoggerRequest::Tag { author: "anna".to_owned(), text: text.to_owned() }
}

/// A recording that a person begins and ends; a gap in it is reported and counted.
fn records_on_request(bench: &mut Bench) {
    // what is published before it is not in it
    bench.publish(350..360);
    let third = bench.path("third.mcap");
    let request = |path: &Path| LoggerRequest::Start {
        path: path.to_str().unwrap().to_owned(),
        metadata: vec![("subject".to_owned(), "s02".to_owned())],
        split: Split::default(),
    };
    std::thread::sleep(Duration::from_millis(200)); // the loop takes it before the start
    let answer = bench.ask(&request(&third));
    assert_eq!((answer.recording.as_deref(), answer.error.as_str()), (third.to_str(), ""));
    let answer = bench.ask(&request(&bench.path("fourth.mcap")));
    assert!(answer.error.contains("already recording"), "{}", answer.error);
    let metadata = vec![(key::PROTOCOL.to_owned(), "guided".to_owned())];
    assert_eq!(bench.ask(&LoggerRequest::Run { metadata }).error, "");
    assert_eq!(bench.ask(&tag("elbow moved")).error, "");
    let answer = bench.ask(&tag(&"a".repeat(200)));
    assert!(answer.error.contains("found 206") && answer.recording.is_some(), "{answer:?}");
    bench.replace("{}");
    bench.publish(360..400);
    std::thread::sleep(Duration::from_millis(200));
    // a hole in the sequence is told of and counted
    let buffer = SAMPLE.topic.buffer as u64;
    bench.publish(400..400 + 40 * buffer);
    std::thread::sleep(Duration::from_millis(1_300)); // losses are told of once a second
    let answer = bench.ask(&LoggerRequest::Stop);
    let written = ticks(&third);
    let recording = Recording::open(&third).unwrap();
    assert_eq!(
        recording.runs().map(|run| run[key::PROTOCOL].as_str()).collect::<Vec<_>>(),
        ["guided"]
    );
    assert_eq!(recording.metadata("axis.0.unit"), Some("rad"));
    assert_eq!(recording.metadata(key::REPLACED), Some(r#"{"control":["/bin/a","-x"]}"#));
    let notes: Vec<_> =
        events(&third).into_iter().filter(|(kind, _)| *kind == EventKind::Note).collect();
    assert_eq!(notes, [(EventKind::Note, "anna: elbow moved".to_owned())]);
    let restored = (EventKind::ProcessRestored, "control".to_owned());
    let told = events(&third).into_iter().filter(|event| *event == restored).count();
    assert_eq!(told, 1, "{:?}", events(&third));
    assert_eq!(written[0], 360);
    assert_eq!(answer.lost, 40 + 40 * buffer - written.len() as u64);
    assert!(answer.lost > 0, "the buffer was never full: the test says nothing");
    let lost: Vec<_> =
        events(&third).into_iter().filter(|(kind, _)| *kind == EventKind::DataLost).collect();
    assert!(
        !lost.is_empty() && lost.iter().all(|(_, text)| text.starts_with("sample: ")),
        "{lost:?}"
    );
    assert!(Recording::open(&third).unwrap().check().unwrap().data_lost());
    let answer = bench.ask(&request(&third));
    assert!(answer.error.contains("never overwritten") && answer.recording.is_none(), "{answer:?}");
}

/// A recording in parts of a second: the seams cost nothing.
fn records_in_parts(bench: &mut Bench) {
    let path = bench.path("parts.mcap");
    let split = Split { every_ns: Some(1_000_000_000), ..Split::default() };
    let text = path.to_str().unwrap().to_owned();
    let start = LoggerRequest::Start { path: text, metadata: Vec::new(), split };
    assert_eq!(bench.ask(&start).error, "");
    let mut tick = 100_000;
    // Until the loop knows of it: what tells of a part's beginning is recorded in the part.
    let third = bench.path("parts.part3.mcap").to_str().map(str::to_owned);
    while bench.ask(&LoggerRequest::Status).recording != third {
        bench.publish(tick..tick + 10);
        tick += 10;
        std::thread::sleep(Duration::from_millis(50));
        assert!(tick < 200_000, "no third part");
    }
    let answer = bench.ask(&LoggerRequest::Stop);
    assert_eq!((answer.lost, answer.error.as_str()), (0, ""));
    let parts = parts_of(&path);
    assert!(parts.len() >= 3, "{parts:?}");
    let written: Vec<u64> = parts.iter().flat_map(|part| ticks(part)).collect();
    assert_eq!(written, (100_000..tick).collect::<Vec<_>>());
    for (number, part) in parts.iter().enumerate() {
        let recording = Recording::open(part).unwrap();
        assert!(!recording.check().unwrap().data_lost(), "part {}", number + 1);
        assert_eq!(recording.metadata(key::RIG_FILE), Some(rig().text()));
        // That it has begun is told in the part itself.
        let begun = (EventKind::RecordingStarted, part.to_str().unwrap().to_owned());
        assert!(events(part).contains(&begun), "{:?}", events(part));
    }
}

/// A ring keeps the newest parts alone, and ends one on request.
fn records_a_ring(bench: &mut Bench) {
    let answer = bench.ask(&LoggerRequest::NextPart);
    assert!(answer.error.contains("no ring") && answer.ring.is_none(), "{answer:?}");
    let path = bench.path("ring.mcap");
    let second = Some(1_000_000_000);
    let split = Split { every_ns: second, keep_ns: second, every_bytes: None };
    let text = path.to_str().unwrap().to_owned();
    let start = LoggerRequest::Start { path: text.clone(), metadata: Vec::new(), split };
    let answer = bench.ask(&start);
    assert_eq!((answer.error.as_str(), answer.ring.unwrap().parts), ("", vec![1]));
    let mut tick = 200_000;
    while path.exists() {
        bench.publish(tick..tick + 10);
        tick += 10;
        std::thread::sleep(Duration::from_millis(50));
        assert!(tick < 300_000, "the first part stays");
    }
    let answer = bench.ask(&LoggerRequest::NextPart);
    assert_eq!(answer.error, "");
    let ring = answer.ring.unwrap();
    assert_eq!((ring.first, ring.keep_ns, ring.not_removed), (text, 1_000_000_000, 0));
    assert!(ring.removed >= 1 && ring.bytes > 0);
    // Everything published before the request is in parts that have ended.
    let (_, ended) = ring.parts.split_last().unwrap();
    let ended: Vec<PathBuf> = ended.iter().map(|number| part_path(&path, *number)).collect();
    let written: Vec<u64> = ended.iter().flat_map(|part| ticks(part)).collect();
    assert_eq!(written, (written[0]..tick).collect::<Vec<_>>());
    assert!(ended.iter().all(|part| Recording::open(part).unwrap().ended_cleanly()));
    let first = Recording::open(&ended[0]).unwrap();
    assert_eq!(first.metadata(key::RING), Some("1 s"));
    let answer = bench.ask(&LoggerRequest::Stop);
    assert_eq!((answer.lost, answer.error.as_str(), answer.ring), (0, "", None));
}

#[test]
fn the_logger_from_first_message_to_second_part() {
    let mut bench = Bench::new();
    records_from_the_start(&mut bench);
    let logger = continues_with_the_next_part(&mut bench);
    records_on_request(&mut bench);
    records_in_parts(&mut bench);
    records_a_ring(&mut bench);
    logger.end();

    // a person ended the recording of this session: a restart does not begin it again
    let logger = launch(&bench.name, &bench.options).unwrap();
    assert_eq!(bench.ask(&LoggerRequest::Status).recording, None);
    logger.end();

    let Bench { name, keeper, service, samples, .. } = bench;
    drop(samples);
    drop(service);
    assert!(keeper.end().unwrap(), "nothing else is alive");
    assert!(name.remove().unwrap());
}
