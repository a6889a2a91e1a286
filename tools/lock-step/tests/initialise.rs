//! A search for the ends of the travel on the rig without a clock: the player's setpoints, the real
//! law, the simulated card.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::Arc;

use experiment::player::{Change, Notice, Player, Program, Reason};
use experiment::range_finder::Range;
use ipc_types::{AXES, Mode};
use lock_step::{CycleResult, LockStepRig};
use rig::RigFile;
use rig::protocol::Protocol;

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const SHIPPED: &str = include_str!("../../../launch/protocols/initialise.toml");

/// The rig with hard stops at the handle, or with none.
fn rig(stops_deg: Option<(f64, f64)>) -> RigFile {
    let kept: Vec<&str> = RIG.lines().filter(|line| !line.starts_with("end_stop_")).collect();
    let keys = stops_deg.map_or_else(String::new, |(lower, upper)| {
        format!("end_stop_min_deg = {lower:?}\nend_stop_max_deg = {upper:?}\n")
    });
    RigFile::parse(
        &kept.join("\n").replace("[simulation]", &format!("[simulation]\n{keys}")),
        "stops.toml",
    )
    .unwrap()
}

/// What came of a protocol.
#[derive(Default)]
struct Outcome {
    changes: Vec<(f64, Change)>,
    ranges: Vec<Range>,
    narrower: bool,
    beats: Vec<(f64, u32)>,
    /// Farthest positions of motor and handle (rad), largest output while initialising (V), largest
    /// step of the output (V).
    farthest: f64,
    largest_v: f64,
    largest_step_v: f64,
    end: Option<CycleResult>,
}

fn play(rig: &RigFile, text: &str, seconds: f64) -> Outcome {
    let protocol = Protocol::parse(text, "test.toml").unwrap_or_else(|error| panic!("{error}"));
    let mut player = Player::default();
    player
        .start(Arc::new(Program::new(&protocol, rig).unwrap_or_else(|error| panic!("{error}"))), 1);
    let mut system = LockStepRig::new(rig, &[]).unwrap();
    let mut outcome = Outcome::default();
    let (mut measured, mut handles) = ([0.0; AXES], [f64::NAN; AXES]);
    let mut last_v = 0.0;
    while system.time_s() < seconds {
        player.see_handles(handles);
        let step = player.step(system.scan_ns(), &measured);
        match player.take_notice() {
            Some(Notice::Range { range, narrower, .. }) => {
                outcome.ranges.push(range);
                outcome.narrower = narrower;
            }
            Some(Notice::Beat { position, number }) => outcome.beats.push((position, number)),
            None => {}
        }
        outcome.changes.extend(step.change.map(|change| (system.time_s(), change)));
        let setpoint = step.setpoint.unwrap();
        let moment = system.cycle(&setpoint).unwrap();
        (measured[0], handles[0]) =
            (moment.sample.master_position[0], moment.sample.slave_position[0]);
        let volts = moment.command.volts[0];
        if setpoint.mode == Mode::Initialise.code() {
            outcome.largest_v = outcome.largest_v.max(volts.abs());
        }
        outcome.largest_step_v = outcome.largest_step_v.max((volts - last_v).abs());
        last_v = volts;
        outcome.farthest = outcome.farthest.max(measured[0].abs()).max(handles[0].abs());
        outcome.end = Some(moment);
    }
    outcome
}

#[test]
fn the_shipped_protocol_finds_the_stops_of_the_handle() {
    let rig = rig(Some((-85.0, 78.0)));
    let outcome = play(&rig, SHIPPED, 72.0);
    println!("{:?}\n{:?}", outcome.changes, outcome.ranges);
    println!(
        "farthest {:.1}°, most {:.2} V while it initialises, largest step {:.2} V",
        outcome.farthest.to_degrees(),
        outcome.largest_v,
        outcome.largest_step_v
    );
    let [range] = outcome.ranges[..] else { panic!("{:?}", outcome.ranges) };
    assert_eq!(range.met, (true, true));
    assert!(
        (range.lower.handle.to_degrees() + 85.0).abs() < 1.0,
        "{}",
        range.lower.handle.to_degrees()
    );
    assert!(
        (range.upper.handle.to_degrees() - 78.0).abs() < 1.0,
        "{}",
        range.upper.handle.to_degrees()
    );
    assert!(
        range.lower.motor < range.lower.handle && range.upper.motor > range.upper.handle,
        "the line yields"
    );
    assert!(outcome.narrower, "the stops lie well within ±120°");
    assert!(outcome.largest_v <= 4.0 + 1e-9);
    assert!(outcome.farthest < 120f64.to_radians(), "the watchdog would trip");
    assert!(matches!(outcome.changes.last(), Some((_, Change::Done))), "{:?}", outcome.changes);
    let beats: Vec<u32> = outcome.beats.iter().map(|beat| beat.1).collect();
    assert_eq!(
        beats,
        (1..=19).collect::<Vec<u32>>(),
        "two a cycle, none at the end of the segment"
    );
    for (position, number) in &outcome.beats {
        let side = if number % 2 == 1 { 30f64 } else { -30.0 };
        assert!((position.to_degrees() - side).abs() < 1e-9);
    }
    assert!(outcome.end.unwrap().sample.master_position[0].abs() < 3f64.to_radians());
}

#[test]
fn without_stops_it_ends_at_the_limits_and_trips_nothing() {
    let outcome = play(&rig(None), SHIPPED, 40.0);
    println!(
        "{:?} {:?} farthest {:.1}°",
        outcome.changes,
        outcome.ranges,
        outcome.farthest.to_degrees()
    );
    let [range] = outcome.ranges[..] else { panic!("{:?}", outcome.ranges) };
    assert!(range.upper.motor.to_degrees() > 105.0 && range.lower.motor.to_degrees() < -105.0);
    assert!(outcome.farthest < 120f64.to_radians(), "the watchdog would trip");
}

#[test]
fn a_later_segment_beyond_the_range_is_refused_and_the_motor_let_go() {
    let rig = rig(Some((-40.0, 40.0)));
    let text = format!(
        "{SHIPPED}\n[[segments]]\nkind = \"guided_sine\"\namplitude_deg = 80\n\
         frequency_hz = 0.2\nduration_s = 20.0\nfade_in_s = 5.0\n"
    );
    let outcome = play(&rig, &text, 25.0);
    assert!(
        matches!(outcome.changes.last(), Some((_, Change::Aborted(0, Reason::OutOfRange)))),
        "{:?}",
        outcome.changes
    );
    assert_eq!(outcome.end.unwrap().command.volts, [0.0; AXES]);
    assert!(outcome.largest_step_v < 1.5, "{} V", outcome.largest_step_v);
}

#[test]
fn too_little_volts_find_nothing_and_say_so() {
    let text = SHIPPED
        .replace("volts = 4.0", "volts = 0.3")
        .replace("duration_s = 40.0", "duration_s = 28.0");
    let outcome = play(&rig(Some((-85.0, 85.0))), &text, 30.0);
    assert!(
        matches!(outcome.changes.last(), Some((_, Change::Aborted(0, Reason::Stuck)))),
        "{:?}",
        outcome.changes
    );
    assert!(outcome.ranges.is_empty());
    assert!(outcome.largest_v <= 0.3 + 1e-9);
}
