//! The scanner in a protocol, with pulses and time driven by hand.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::Arc;

use experiment::player::{Change, Player, Program, Reason};
use experiment::scan_plan::{Pulses, ScanPlan};
use experiment::scan_tracker::{ScanReport, ScanTracker, WaitState};
use ipc_types::{AXES, LineEvent, Mode, Volume, VolumeSource};
use rig::RigFile;
use rig::protocol::{Protocol, Scan, WaitForScanner};
use scanner::Series;

const MS: u64 = 1_000_000;
const SECOND: u64 = 1_000 * MS;
const PERIOD: u64 = 2 * MS;
const START: u64 = 1_000 * SECOND;
const WAIT: WaitForScanner = WaitForScanner { timeout_s: 60.0, pulse: 1, start_up_s: 10.0 };

fn plan(repetition_s: f64, volumes: Option<u64>) -> ScanPlan {
    let scan = Some(Scan { series: Series::new(repetition_s, volumes), in_step: true });
    ScanPlan { scan, waits: true, ..ScanPlan::default() }
}

fn at(seconds: f64) -> u64 {
    START + (seconds * 1e9).round() as u64
}

fn reports(tracker: &mut ScanTracker) -> Vec<ScanReport> {
    std::iter::from_fn(|| tracker.take_report()).collect()
}

fn volumes(reports: &[ScanReport]) -> Vec<Volume> {
    let volume = |report: &ScanReport| match report {
        ScanReport::Volume(volume) => Some(*volume),
        _ => None,
    };
    reports.iter().filter_map(volume).collect()
}

#[test]
fn the_start_up_time_counts_from_the_pulse() {
    let mut tracker = ScanTracker::default();
    tracker.begin(&plan(2.0, None), at(0.0));
    tracker.see(LineEvent::Pulse, at(0.5));
    tracker.begin_wait(&WAIT, 3, at(1.0));
    assert_eq!(tracker.wait(&WAIT, at(1.5)), WaitState::Waiting, "that pulse came before the wait");
    tracker.see(LineEvent::Glitch, at(1.6));
    tracker.see(LineEvent::Pulse, at(4.3));
    tracker.see(LineEvent::Pulse, at(6.3));
    assert_eq!(tracker.wait(&WAIT, at(14.29)), WaitState::Waiting);
    assert_eq!(tracker.wait(&WAIT, at(14.31)), WaitState::Over(at(14.3)));
    let reports = reports(&mut tracker);
    let started = |report: &ScanReport| match report {
        ScanReport::Started { after_s } => (after_s - 3.3).abs() < 1e-9,
        _ => false,
    };
    assert!(reports.iter().any(started), "{reports:?}");
    assert_eq!(volumes(&reports).iter().map(|volume| volume.index).collect::<Vec<_>>(), [0, 1]);
}

#[test]
fn dummy_volumes_are_waited_for_and_a_wait_ends_without_a_pulse() {
    let third = WaitForScanner { pulse: 3, start_up_s: 0.0, ..WAIT };
    let mut tracker = ScanTracker::default();
    tracker.begin(&plan(2.0, None), at(0.0));
    tracker.begin_wait(&third, 0, at(0.0));
    for pulse in [1.0, 3.0] {
        tracker.see(LineEvent::Pulse, at(pulse));
    }
    assert_eq!(tracker.wait(&third, at(4.9)), WaitState::Waiting);
    assert_eq!(tracker.wait(&third, at(60.0)), WaitState::TimedOut);
    tracker.see(LineEvent::Pulse, at(5.0));
    assert_eq!(tracker.wait(&third, at(5.0)), WaitState::Over(at(5.0)));
}

#[test]
fn every_volume_is_reported_with_its_time_and_what_was_wrong() {
    let mut tracker = ScanTracker::default();
    tracker.begin(&plan(2.0, Some(6)), at(0.0));
    tracker.begin_wait(&WAIT, 0, at(0.0));
    for pulse in [1.0, 3.0, 3.7, 9.0, 11.0, 13.0] {
        tracker.see(LineEvent::Pulse, at(pulse));
    }
    let reports = reports(&mut tracker);
    let volumes = volumes(&reports);
    let found: Vec<_> =
        volumes.iter().map(|volume| (volume.index, volume.at_ns, volume.source)).collect();
    let [pulse, between] =
        [VolumeSource::Pulse, VolumeSource::Interpolated].map(VolumeSource::code);
    let expected = [
        (0, at(1.0), pulse),
        (1, at(3.0), pulse),
        // Between the volumes: the spurious pulse is none of them.
        (2, at(5.0), between),
        (3, at(7.0), between),
        (4, at(9.0), pulse),
        (5, at(11.0), pulse),
    ];
    // The last of each: where a count changes, the newest volume is reported again.
    let mut last = found.clone();
    last.reverse();
    last.sort_by_key(|(index, ..)| *index);
    last.dedup_by_key(|(index, ..)| *index);
    assert_eq!(last, expected);
    assert_eq!(found.len(), 8);
    let counts: Vec<_> =
        volumes.iter().map(|volume| (volume.spurious, volume.missed, volume.surplus)).collect();
    assert_eq!(counts[2], (1, 0, 0), "after the pulse at 3.7 s");
    assert_eq!(counts[7], (1, 2, 1), "after the pulse at 13 s");
    assert!(reports.contains(&ScanReport::Missed { first: 2, count: 2 }));
    assert!(reports.contains(&ScanReport::Spurious { after: 1 }));
    let progress = tracker.progress(at(13.0)).unwrap();
    assert_eq!(
        (progress.volumes, progress.expected, progress.missed, progress.spurious, progress.surplus),
        (4, 6, 2, 1, 1)
    );
}

#[test]
fn a_gate_makes_volumes_while_it_is_open() {
    let mut tracker = ScanTracker::default();
    let plan = ScanPlan { gate_width_s: Some(0.05), ..plan(2.0, None) };
    tracker.begin(&plan, at(0.0));
    tracker.begin_wait(&WAIT, 0, at(0.0));
    tracker.see(LineEvent::Pulse, at(1.0));
    // It may have closed at 5 s: a level of less than 50 ms is not told yet.
    tracker.advance(at(5.06));
    let times = |tracker: &mut ScanTracker| -> Vec<u64> {
        volumes(&reports(tracker)).iter().map(|volume| volume.at_ns).collect()
    };
    assert_eq!(times(&mut tracker), [at(1.0), at(3.0)]);
    let mut resumed = ScanTracker::resume(tracker.state(), Pulses::Line);
    // This process was not run in time; another takes its place.
    resumed.catch_up(at(9.5));
    resumed.advance(at(9.6));
    for tracker in [&mut tracker, &mut resumed] {
        tracker.see(LineEvent::GateEnd, at(7.1));
        tracker.advance(at(20.0));
        assert_eq!(times(tracker), [at(5.0), at(7.0)]);
    }
}

fn pulses_of(source: &str) -> Pulses {
    Pulses::of(&source.parse().unwrap()).unwrap()
}

#[test]
fn the_emulated_scanner_takes_the_place_of_the_line() {
    let mut tracker = ScanTracker::default();
    tracker.begin(&ScanPlan { pulses: pulses_of("2"), ..plan(2.0, None) }, at(0.0));
    tracker.begin_wait(&WAIT, 0, at(5.0));
    tracker.see(LineEvent::Pulse, at(5.2));
    tracker.see_key(at(5.3));
    for step in 0..5_000 {
        tracker.advance(at(5.0) + step * PERIOD);
    }
    let volumes = volumes(&reports(&mut tracker));
    let times: Vec<_> = volumes.iter().map(|volume| volume.at_ns).collect();
    assert_eq!(times, [at(6.0), at(8.0), at(10.0), at(12.0), at(14.0)]);
    assert!(volumes.iter().all(|volume| volume.source == VolumeSource::Emulated.code()));
}

/// The faults are those that were asked for, also where another process goes on in between.
#[test]
fn the_emulated_scanner_has_the_faults_that_were_asked_for() {
    let pulses = pulses_of("2,jitter=0.002,missing=3,missing=4,missing=30,spurious=20.7,seed=5");
    let mut tracker = ScanTracker::default();
    tracker.begin(&ScanPlan { pulses: pulses.clone(), ..plan(2.0, Some(60)) }, at(0.0));
    tracker.begin_wait(&WAIT, 0, at(0.0));
    let mut all = Vec::new();
    for step in 0..60_000 {
        tracker.advance(at(0.0) + step * PERIOD);
        all.extend(reports(&mut tracker));
        if step % 10_007 == 0 {
            tracker = ScanTracker::resume(tracker.state(), pulses.clone());
        }
    }
    let progress = tracker.progress(at(120.0)).unwrap();
    assert_eq!((progress.volumes, progress.missed, progress.spurious), (57, 3, 1));
    let volumes = volumes(&all);
    let late: Vec<f64> = volumes
        .iter()
        .filter(|volume| volume.source == VolumeSource::Emulated.code())
        .map(|volume| (volume.at_ns as f64 - at(1.0) as f64) * 1e-9 - 2.0 * volume.index as f64)
        .collect();
    let rms = (late.iter().map(|s| s * s).sum::<f64>() / late.len() as f64).sqrt();
    assert!((0.0012..0.0028).contains(&rms), "{rms}");
    assert!(late.iter().all(|s| s.abs() <= 0.006 + 1e-9), "{late:?}");
}

#[test]
fn the_key_5_takes_the_place_of_the_line() {
    let plan = ScanPlan { pulses: Pulses::Key, gate_width_s: Some(0.05), ..plan(2.0, None) };
    let mut tracker = ScanTracker::default();
    tracker.begin(&plan, at(0.0));
    tracker.begin_wait(&WAIT, 0, at(5.0));
    // From the page's clock: before the wait, later than the time it is taken at, and twice.
    for s in [4.9, 6.0, 6.0, 8.004, 9.998] {
        tracker.see(LineEvent::Pulse, at(s - 0.3));
        tracker.see_key(at(s));
        tracker.advance(at(s));
    }
    assert_eq!(tracker.wait(&WAIT, at(16.0)), WaitState::Over(at(16.0)));
    let volumes = volumes(&reports(&mut tracker));
    let key = VolumeSource::Key.code();
    let seen: Vec<_> = volumes.iter().map(|volume| (volume.at_ns, volume.source)).collect();
    assert_eq!(seen, [(at(6.0), key), (at(8.004), key), (at(9.998), key)]);
    assert_eq!(tracker.since_volume_s(at(11.0)), None, "no artefact is subtracted by them");
}

#[test]
fn another_process_goes_on_from_the_state_and_the_pulses_since() {
    let pulses: Vec<u64> = (0..40).map(|at_volume| at(1.0 + 2.0 * f64::from(at_volume))).collect();
    let mut tracker = ScanTracker::default();
    tracker.begin(&plan(2.0, None), at(0.0));
    tracker.begin_wait(&WAIT, 0, at(0.0));
    pulses[..4].iter().for_each(|pulse| tracker.see(LineEvent::Pulse, *pulse));
    tracker.pass_edge(at(11.0), None);
    tracker.pass_edge(at(13.0), Some(2.0));
    // A spurious pulse before, and missing ones across, the kill.
    tracker.see(LineEvent::Pulse, at(8.2));
    pulses[4..10].iter().for_each(|pulse| tracker.see(LineEvent::Pulse, *pulse));
    let mut resumed = ScanTracker::resume(tracker.state(), Pulses::Line);
    // The topic's history brings pulses that were counted before, too.
    pulses[5..10].iter().for_each(|pulse| resumed.see(LineEvent::Pulse, *pulse));
    for tracker in [&mut tracker, &mut resumed] {
        pulses[12..].iter().for_each(|pulse| tracker.see(LineEvent::Pulse, *pulse));
        let progress = tracker.progress(at(80.0)).unwrap();
        assert_eq!((progress.volumes, progress.missed, progress.spurious), (38, 2, 1));
    }
    assert_eq!(resumed.state(), tracker.state());
    // The plan is kept as well: 30 s after the anchor at 11 s, which was 2 s before the edge.
    let planned = at(43.003);
    assert!(tracker.edge_ns(planned, 30.0).abs_diff(at(43.0)) < MS, "in step");
    resumed.catch_up(at(80.0));
    assert_eq!(resumed.edge_ns(planned, 30.0), planned, "its segment begins again");
}

#[test]
fn a_process_that_takes_over_a_wait_gives_the_pulse_time_to_arrive() {
    let mut tracker = ScanTracker::default();
    tracker.begin(&plan(2.0, None), at(0.0));
    tracker.begin_wait(&WAIT, 0, at(0.0));
    let mut resumed = ScanTracker::resume(tracker.state(), Pulses::Line);
    resumed.catch_up(at(60.5));
    assert_eq!(resumed.wait(&WAIT, at(61.0)), WaitState::Waiting);
    assert_eq!(resumed.wait(&WAIT, at(62.1)), WaitState::TimedOut);
    resumed.see(LineEvent::Pulse, at(59.0));
    assert_eq!(resumed.wait(&WAIT, at(69.0)), WaitState::Over(at(69.0)));
}

#[test]
fn a_wait_counts_from_the_scan_and_not_from_a_spurious_pulse_before_it() {
    let mut tracker = ScanTracker::default();
    tracker.begin(&plan(2.0, None), at(0.0));
    tracker.begin_wait(&WAIT, 0, at(0.0));
    for pulse in [1.3, 2.0, 4.0, 6.0] {
        tracker.see(LineEvent::Pulse, at(pulse));
    }
    assert_eq!(tracker.wait(&WAIT, at(11.9)), WaitState::Waiting);
    assert_eq!(tracker.wait(&WAIT, at(12.0)), WaitState::Over(at(12.0)));
    let reports = reports(&mut tracker);
    assert!(reports.contains(&ScanReport::Restarted { first: 0 }), "{reports:?}");
    let progress = tracker.progress(at(6.1)).unwrap();
    assert_eq!((progress.volumes, progress.spurious), (3, 1));
}

#[test]
fn a_second_wait_is_for_the_next_scan_even_where_no_more_volumes_are_expected() {
    for volumes in [None, Some(4)] {
        let mut tracker = ScanTracker::default();
        tracker.begin(&plan(2.0, volumes), at(0.0));
        tracker.begin_wait(&WAIT, 0, at(0.0));
        for pulse in [1.0, 3.0, 5.0, 7.0] {
            tracker.see(LineEvent::Pulse, at(pulse));
        }
        tracker.pass_edge(at(11.0), None);
        tracker.pass_edge(at(21.0), Some(10.0));
        tracker.begin_wait(&WAIT, 2, at(21.0));
        // The scanner was stopped, and is started out of step with the first scan.
        for pulse in [30.8, 32.8, 34.8] {
            tracker.see(LineEvent::Pulse, at(pulse));
        }
        assert_eq!(tracker.wait(&WAIT, at(40.8)), WaitState::Over(at(40.8)), "{volumes:?}");
    }
}

#[test]
fn a_wait_needs_no_expectation_of_the_scan() {
    let mut tracker = ScanTracker::default();
    tracker.begin(&ScanPlan { waits: true, ..ScanPlan::default() }, at(0.0));
    tracker.begin_wait(&WAIT, 0, at(0.0));
    tracker.see(LineEvent::Pulse, at(2.0));
    assert_eq!(tracker.wait(&WAIT, at(12.0)), WaitState::Over(at(12.0)));
    assert_eq!(tracker.progress(at(12.0)), None);
    assert_eq!(reports(&mut tracker), [ScanReport::Started { after_s: 2.0 }]);
}

#[test]
fn all_pulses_of_the_history_at_once_lose_no_report() {
    let mut tracker = ScanTracker::default();
    tracker.begin(&plan(2.0, None), at(0.0));
    tracker.begin_wait(&WAIT, 0, at(0.0));
    let mut found = Vec::new();
    let mut pulses = (0..256).filter(|volume| volume % 5 != 3).peekable();
    // As the process does: pulses while there is room, then some reports.
    while pulses.peek().is_some() || tracker.has_reports() {
        while tracker.has_room()
            && let Some(volume) = pulses.next()
        {
            tracker.see(LineEvent::Pulse, at(1.0 + 2.0 * f64::from(volume)));
        }
        found.extend((0..16).map_while(|_| tracker.take_report()));
    }
    assert_eq!(tracker.dropped(), 0);
    let indices: Vec<_> = volumes(&found).iter().map(|volume| volume.index).collect();
    assert_eq!(indices, Vec::from_iter(0..256));
}

const BLOCKS: &str = r#"
[protocol]
name = "blocks"
repeat = 60

[scanner]
repetition_s = 2.0
IN_STEP

[[segments]]
kind = "rest"
duration_s = 20.0

[[segments]]
kind = "guided_sine"
amplitude_deg = 20.0
frequency_hz = 1.0
duration_s = 40.0
"#;

const WAITING: &str = r#"
[protocol]
name = "waiting"

[scanner]
repetition_s = 2.0

[[segments]]
kind = "wait_for_scanner"
timeout_s = 30.0
start_up_s = 10.0

[[segments]]
kind = "hold"
position_deg = 10.0
duration_s = 3.0
"#;

fn program(text: &str) -> Arc<Program> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
    let rig = RigFile::load(path).unwrap();
    Arc::new(Program::new(&Protocol::parse(text, "test.toml").unwrap(), &rig).unwrap())
}

/// Plays for a time in steps; pulses are told as the process would, with the step after them.
fn play(
    player: &mut Player,
    (from_ns, to_ns): (u64, u64),
    pulse: &mut dyn FnMut(u64) -> Option<u64>,
) -> Vec<(u64, Change)> {
    let mut changes = Vec::new();
    for now_ns in (from_ns..to_ns).step_by(PERIOD as usize) {
        if let Some(at_ns) = pulse(now_ns) {
            player.see_scanner(LineEvent::Pulse, at_ns);
        }
        let output = player.step(now_ns, &[0.0; AXES]);
        while player.take_scan_report().is_some() {}
        changes.extend(output.change.map(|change| (now_ns, change)));
    }
    changes
}

/// Pulses of a scanner whose clock is slow by this share of the rig's.
fn scanner_of(first_ns: u64, slow: f64) -> impl FnMut(u64) -> Option<u64> {
    let mut next = 0_u32;
    move |now_ns| {
        let at_ns = first_ns + (2e9 * (1.0 + slow) * f64::from(next)).round() as u64;
        (at_ns <= now_ns).then(|| {
            next += 1;
            at_ns
        })
    }
}

#[test]
fn a_protocol_waits_at_zero_volts_and_begins_after_the_start_up_time() {
    let mut player = Player::default();
    player.start(program(WAITING), 1);
    let mut pulses = scanner_of(START + 7_300 * MS + 123_456, 0.0);
    for now_ns in (START..START + 17 * SECOND).step_by(PERIOD as usize) {
        if let Some(at_ns) = pulses(now_ns) {
            player.see_scanner(LineEvent::Pulse, at_ns);
        }
        let setpoint = player.step(now_ns, &[0.2; AXES]).setpoint.unwrap();
        assert_eq!(setpoint.mode, Mode::Passive.code());
    }
    let changes = play(&mut player, (START + 17 * SECOND, START + 25 * SECOND), &mut pulses);
    let edge = START + 17_300 * MS + 123_456;
    let (begun_ns, change) = changes[0];
    assert_eq!(change, Change::Segment(1));
    assert!((edge..edge + PERIOD).contains(&begun_ns), "{begun_ns}");
    // The segment itself counts from the pulse, not from the step.
    let (done_ns, change) = changes[1];
    assert_eq!(change, Change::Done);
    assert!((edge + 3 * SECOND..edge + 3 * SECOND + PERIOD).contains(&done_ns), "{done_ns}");
    assert!((player.status().elapsed_s - 20.3).abs() < 0.01, "{}", player.status().elapsed_s);
}

#[test]
fn an_end_is_corrected_by_little_and_the_rest_is_left_to_the_next() {
    let mut tracker = ScanTracker::default();
    tracker.begin(&plan(2.0, None), at(0.0));
    tracker.begin_wait(&WAIT, 0, at(0.0));
    // The scanner is 1 % faster than it should be.
    (0..60).for_each(|volume| tracker.see(LineEvent::Pulse, at(1.0 + 1.98 * f64::from(volume))));
    tracker.pass_edge(at(101.0), None);
    let (planned, early) = (at(121.0), 0.002 + 0.02);
    assert!(tracker.edge_ns(planned, 20.0).abs_diff(at(121.0 - early)) < 1_000);
    // Without a rate to follow, nothing is corrected.
    tracker.pause();
    assert_eq!(tracker.edge_ns(planned, 20.0), planned);
}

#[test]
fn a_protocol_without_a_pulse_ends_with_the_reason() {
    let mut player = Player::default();
    player.start(program(WAITING), 1);
    let changes = play(&mut player, (START, START + 31 * SECOND), &mut |_| None);
    let (at_ns, change) = changes[1];
    assert_eq!(change, Change::Aborted(0, Reason::NoScanner));
    assert_eq!(at_ns, START + 30 * SECOND);
}

/// How far an hour of blocks of 20 s and 40 s is off at its end, with a scanner whose clock is slow
/// by this share (s).
fn drift_s(in_step: &str, slow: f64) -> f64 {
    let mut player = Player::default();
    player.start(program(&BLOCKS.replace("IN_STEP", in_step)), 1);
    let first_ns = START + 300 * MS;
    let mut pulses = scanner_of(first_ns, slow);
    let changes = play(&mut player, (START, START + 3_602 * SECOND), &mut pulses);
    assert_eq!(changes.len(), 121);
    // The 118th segment begins 58 blocks after the second.
    let begun = |index| changes.iter().find(|(_, change)| *change == Change::Segment(index));
    let (first, last) = (begun(2).unwrap().0, begun(118).unwrap().0);
    let by_scanner = 58.0 * 60.0 * (1.0 + slow);
    (last - first) as f64 * 1e-9 - by_scanner
}

#[test]
fn an_hour_of_blocks_does_not_drift_against_the_scanner() {
    // 80 ppm are 288 ms in an hour.
    for slow in [80e-6, -80e-6] {
        let in_step = drift_s("in_step = true", slow);
        assert!(in_step.abs() < 0.005, "{in_step}");
        let by_the_rig = drift_s("in_step = false", slow);
        assert!((by_the_rig + 58.0 * 60.0 * slow).abs() < 0.005, "{by_the_rig}");
    }
}
