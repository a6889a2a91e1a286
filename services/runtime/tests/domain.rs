//! The domain in one process: keeper, ports, history, requests. (One rig: the library's
//! configuration is process-wide.)
#![allow(clippy::unwrap_used)]

use std::fs;
use std::sync::{Arc, Barrier};
use std::time::Duration;

use ipc_types::*;
use runtime::{Domain, DomainError, Keeper, RequestError, RigName, Server, Service, call};

fn segments(name: &RigName) -> Vec<String> {
    let mark = name.directory().file_name().unwrap().to_string_lossy().into_owned() + ".";
    fs::read_dir("/dev/shm")
        .unwrap()
        .filter_map(|entry| entry.unwrap().file_name().into_string().ok())
        .filter(|file| file.starts_with(&mark))
        .collect()
}

fn samples_arrive_in_order_and_losses_are_counted(service: &Service) {
    let mut samples = service.subscriber(SAMPLE).unwrap();
    let mut publisher = service.publisher(SAMPLE).unwrap();
    for tick in 0..100 {
        publisher.send(Sample { tick, ..Sample::default() }).unwrap();
    }
    for tick in 0..100 {
        let sample = samples.take().unwrap().unwrap();
        assert_eq!(
            (sample.tick, sample.sequence, sample.incarnation),
            (tick, tick, service.identity().incarnation)
        );
    }
    assert!(samples.take().unwrap().is_none());

    // a full buffer drops the oldest, and the gap is counted
    let extra = 10;
    for tick in 0..(SAMPLE.topic.buffer as u64 + extra) {
        publisher.send(Sample { tick, ..Sample::default() }).unwrap();
    }
    let newest = samples.latest().unwrap().unwrap();
    assert_eq!(newest.tick, SAMPLE.topic.buffer as u64 + extra - 1);
    assert_eq!(samples.counters().lost, extra);
}

/// A process that is restarted again and again loses nothing of what it sent, although its reader
/// is slow.
fn what_ended_publishers_sent_is_still_read(service: &Service) {
    const RESTARTS: u64 = 8;
    const EACH: u64 = 16;
    let mut commands = service.subscriber(COMMAND).unwrap();
    let mut seen = Vec::new();
    let mut take = |most: u64| {
        for _ in 0..most {
            seen.extend(commands.take().unwrap().map(|command| command.sample_tick));
        }
    };
    for restart in 0..RESTARTS {
        let mut publisher = service.publisher(COMMAND).unwrap();
        for index in 0..EACH {
            let tick = restart * EACH + index;
            publisher.send(MotorCommand { sample_tick: tick, ..MotorCommand::default() }).unwrap();
        }
        take(1);
    }
    take(RESTARTS * EACH);
    seen.sort_unstable();
    assert_eq!(seen, (0..RESTARTS * EACH).collect::<Vec<_>>());
}

fn card_fifo_outlives_its_reader_and_tokens_do_not(service: &Service) {
    let mut scans = service.publisher(CARD_SCAN).unwrap();
    let mut tokens = service.publisher(TOKEN).unwrap();
    for tick in 0..700 {
        scans.send(CardScan { tick, ..CardScan::default() }).unwrap();
    }
    tokens.send(EnableToken::default()).unwrap();
    let mut late_scans = service.subscriber(CARD_SCAN).unwrap();
    let mut late_tokens = service.subscriber(TOKEN).unwrap();
    scans.refresh();
    tokens.refresh();
    let first = late_scans.take().unwrap().unwrap();
    assert_eq!(first.tick, 700 - CARD_FIFO as u64);
    assert!(late_tokens.take().unwrap().is_none());
}

fn requests_are_answered(service: &Service, rig: &str) {
    let ask = |limit| call::<_, VerbAnswer>(service.node(), &WATCHDOG_COMMANDS, &Verb::Arm, limit);
    assert!(matches!(ask(Duration::from_millis(50)), Err(RequestError::NobodyServes(..))));
    let domain_name = rig.to_owned();
    let (ready, wait) = std::sync::mpsc::channel();
    let (finish, finished) = std::sync::mpsc::channel::<()>();
    let server = std::thread::spawn(move || {
        let domain = Domain::open(&domain_name.parse().unwrap()).unwrap();
        let node = domain.node("server").unwrap();
        let server = Server::new(&node, &WATCHDOG_COMMANDS).unwrap();
        ready.send(()).unwrap();
        while finished.try_recv().is_err() {
            let answer = |verb: Verb| VerbAnswer {
                done: verb == Verb::Arm,
                state: WatchdogState::Armed,
                reason: "r".repeat(500),
            };
            server.poll(answer, |error| panic!("{error}")).unwrap();
            // A step of the client's own period, so that answers come at all of its instants.
            std::thread::sleep(Duration::from_micros(730));
        }
    });
    wait.recv().unwrap();
    // Often: an answer may come, and its connection end, at any instant of the client's turn.
    for _ in 0..1000 {
        let answer = ask(Duration::from_secs(10)).unwrap();
        assert!(answer.done && answer.reason.len() == 500);
    }
    more_ask_at_once_than_a_service_has_clients(rig);
    finish.send(()).unwrap();
    server.join().unwrap();
    one_request_is_answered_at_a_time(service, rig);
}

/// Whoever serves looks at everything else between two requests.
fn one_request_is_answered_at_a_time(service: &Service, rig: &str) {
    let server = Server::new(service.node(), &WATCHDOG_COMMANDS).unwrap();
    let (sent, all_sent) = std::sync::mpsc::channel();
    let ask = |number: usize| {
        let (name, sent) = (rig.to_owned(), sent.clone());
        std::thread::spawn(move || {
            let domain = Domain::open(&name.parse().unwrap()).unwrap();
            let node = domain.node(&format!("asking-{number}")).unwrap();
            sent.send(()).unwrap();
            let limit = Duration::from_secs(60);
            call::<_, VerbAnswer>(&node, &WATCHDOG_COMMANDS, &Verb::Arm, limit).unwrap();
        })
    };
    let asking: Vec<_> = (0..3).map(ask).collect();
    asking.iter().for_each(|_| all_sent.recv().unwrap());
    // Requests gather meanwhile; should one come later, it is answered alone all the same.
    std::thread::sleep(Duration::from_millis(200));
    let mut answered = 0;
    while answered < asking.len() {
        let mut now = 0;
        let state = WatchdogState::Armed;
        let answer = |_: Verb| {
            now += 1;
            VerbAnswer { done: true, state, reason: String::new() }
        };
        let found = server.poll(answer, |error| panic!("{error}")).unwrap();
        assert_eq!(now, usize::from(found));
        answered += now;
    }
    for each in asking {
        each.join().unwrap();
    }
}

/// Each waits for its turn: an emergency stop is not refused because eight others ask.
fn more_ask_at_once_than_a_service_has_clients(rig: &str) {
    let together = Arc::new(Barrier::new(10));
    let ask = |number: usize| {
        let (name, together) = (rig.to_owned(), Arc::clone(&together));
        std::thread::spawn(move || {
            let domain = Domain::open(&name.parse().unwrap()).unwrap();
            let node = domain.node(&format!("client-{number}")).unwrap();
            together.wait();
            for _ in 0..50 {
                let limit = Duration::from_secs(60);
                call::<_, VerbAnswer>(&node, &WATCHDOG_COMMANDS, &Verb::Arm, limit).unwrap();
            }
        })
    };
    let asking: Vec<_> = (0..10).map(ask).collect();
    for each in asking {
        each.join().unwrap();
    }
}

#[test]
fn a_rig_from_cold_start_to_clean_end() {
    let text = format!("rt-{}", std::process::id());
    let name: RigName = text.parse().unwrap();

    // remains of an earlier rig of that name are wiped
    fs::create_dir(name.directory()).unwrap();
    fs::set_permissions(name.directory(), std::os::unix::fs::PermissionsExt::from_mode(0o700))
        .unwrap();
    let remains =
        format!("/dev/shm/{}.old.data", name.directory().file_name().unwrap().to_string_lossy());
    fs::write(&remains, "x").unwrap();

    let mut keeper = Keeper::start(&name).unwrap();
    assert!(keeper.is_cold());
    assert!(!fs::exists(&remains).unwrap());
    assert_eq!(keeper.services(), TOPICS.len() + COMMAND_SERVICES.len());
    assert!(matches!(Keeper::start(&name), Err(DomainError::AlreadyKept(_))));
    assert!(!name.remove().unwrap(), "a living rig is not removed");

    // nothing of it is open to others
    for file in segments(&name) {
        let mode = std::os::unix::fs::PermissionsExt::mode(
            &fs::metadata(format!("/dev/shm/{file}")).unwrap().permissions(),
        );
        assert_eq!(mode & 0o077, 0, "{file} has mode {mode:o}");
    }

    let service = Service::start(Process::Control, &text).unwrap();
    assert_eq!(service.identity().session, keeper.session());
    samples_arrive_in_order_and_losses_are_counted(&service);
    what_ended_publishers_sent_is_still_read(&service);
    card_fifo_outlives_its_reader_and_tokens_do_not(&service);
    requests_are_answered(&service, &text);

    drop(service);
    keeper.clean(Duration::ZERO);
    // An observer (a probe that was left open) does not hold the session of a rig that goes down.
    let observer = Domain::observe(&name).unwrap();
    assert!(observer.is_current());
    assert!(keeper.end().unwrap(), "nothing else is alive");
    assert!(!observer.is_current());
    assert_eq!(segments(&name), Vec::<String>::new());
    assert!(name.remove().unwrap());
    assert!(!name.directory().exists());
}
