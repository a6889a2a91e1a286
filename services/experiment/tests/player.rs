//! The player: its clock is an argument, so every test drives time by hand.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::Arc;

use experiment::player::{Change, Output, Permission, Player, Program, Reason, ResumeError};
use experiment::state::PlayerState;
use ipc_types::{AXES, Mode, Setpoint};
use proptest::prelude::*;
use rig::RigFile;
use rig::protocol::Protocol;

const MS: u64 = 1_000_000;
const PERIOD: u64 = 2 * MS;
/// The enable epoch that protocols are started under, and the number of their client.
const EPOCH: u64 = 7;
const CLIENT: u64 = 5;

const TEXT: &str = r#"
[protocol]
name = "test"

[[segments]]
kind = "rest"
duration_s = 0.5

[[segments]]
kind = "guided_sine"
label = "guided"
amplitude_deg = 30
frequency_hz = 1
duration_s = 4
fade_in_s = 1

[[segments]]
kind = "steps"
positions_deg = [20, -20]
dwell_s = 0.5
rise_s = 0.6

[[segments]]
kind = "multisine"
frequencies_hz = [0.5, 1.3, 2.9]
amplitude_deg = 25
centre_deg = 10
duration_s = 3
"#;

/// The state with which another process would resume.
fn state(player: &Player, session: u64, client: u64) -> PlayerState {
    let (segment, running) = (player.status().segment, !player.is_ending());
    let begun = player.program().unwrap().state(session, player.epoch(), client);
    PlayerState { segment, running, scan: player.scan_state(), ..begun }
}

fn rig() -> RigFile {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
    RigFile::load(path).unwrap_or_else(|error| panic!("{error}"))
}

fn program(text: &str) -> Arc<Program> {
    let protocol = Protocol::parse(text, "test.toml").unwrap_or_else(|error| panic!("{error}"));
    Arc::new(Program::new(&protocol, &rig()).unwrap_or_else(|error| panic!("{error}")))
}

fn player(text: &str) -> Player {
    let mut player = Player::default();
    player.start(program(text), EPOCH);
    player
}

fn mode(setpoint: &Setpoint) -> Mode {
    Mode::from_code(setpoint.mode).unwrap()
}

/// Steps until `until_ns`; a handle that follows perfectly. Returns the setpoints and the changes
/// with their times.
fn play(player: &mut Player, from_ns: u64, until_ns: u64) -> (Vec<Setpoint>, Vec<(u64, Change)>) {
    let (mut setpoints, mut changes) = (Vec::new(), Vec::new());
    let mut measured = [0.0; AXES];
    for now in (from_ns..until_ns).step_by(PERIOD as usize) {
        let Output { setpoint, change } = player.step(now, &measured);
        let setpoint = setpoint.unwrap();
        measured = setpoint.position;
        setpoints.push(setpoint);
        changes.extend(change.map(|change| (now, change)));
    }
    (setpoints, changes)
}

/// Neighbours are as close as velocity and acceleration allow.
fn assert_smooth(setpoints: &[Setpoint]) {
    for pair in setpoints.windows(2) {
        let dt = (pair[1].at_ns - pair[0].at_ns) as f64 * 1e-9;
        let expected = pair[0].position[0] + 0.5 * dt * (pair[0].velocity[0] + pair[1].velocity[0]);
        let error = (pair[1].position[0] - expected).abs();
        assert!(error < 1e-5, "position jumps by {error} at {:?}", pair[1]);
        let expected = 0.5 * dt * (pair[0].acceleration[0] + pair[1].acceleration[0]);
        let error = (pair[1].velocity[0] - pair[0].velocity[0] - expected).abs();
        assert!(error < 1e-2, "velocity jumps by {error} at {:?}", pair[1]);
    }
}

#[test]
fn says_nothing_before_the_first_protocol() {
    let mut player = Player::default();
    assert_eq!(player.step(0, &[0.0; AXES]), Output { setpoint: None, change: None });
    assert!(!player.is_running());
}

#[test]
fn plays_every_segment_in_time_then_holds_then_lets_go() {
    let mut player = player(TEXT);
    let start = 10_000 * MS;
    let (setpoints, changes) = play(&mut player, start, start + 12_000 * MS);
    assert_eq!(
        changes,
        [
            (start, Change::Started),
            (start + 500 * MS, Change::Segment(1)),
            (start + 4_500 * MS, Change::Segment(2)),
            (start + 6_700 * MS, Change::Segment(3)),
            (start + 9_700 * MS, Change::Done),
        ]
    );
    let at = |ms: u64| &setpoints[(ms * MS / PERIOD) as usize];
    assert_eq!(mode(at(100)), Mode::Passive);
    assert_eq!(mode(at(600)), Mode::Position);
    assert_eq!(mode(at(9_800)), Mode::Hold);
    assert!(
        (at(9_800).position[0] - 10.0_f64.to_radians()).abs() < 1e-9,
        "ends at the last centre"
    );
    assert_eq!(mode(at(10_300)), Mode::Passive);
    assert_smooth(&setpoints);
    let guided = at(2_000);
    assert!((guided.peak_speed[0] - 30.0_f64.to_radians() * std::f64::consts::TAU).abs() < 1e-9);
    assert_eq!((guided.segment, guided.segments, guided.axes), (1, 4, 1));
    assert_eq!(guided.lease_until_ns - guided.at_ns, 100 * MS);
    let status = player.status();
    assert!(status.completed && !status.running);
    assert!((status.elapsed_s - 9.7).abs() < 1e-9 && (status.duration_s - 9.7).abs() < 1e-9);
}

#[test]
fn a_movement_after_a_rest_begins_where_the_handle_was_left() {
    let mut player = player(TEXT);
    let measured = [0.4, 0.0, 0.0];
    let mut first = None;
    for now in (0..520 * MS).step_by(PERIOD as usize) {
        let output = player.step(now, &measured);
        if output.change == Some(Change::Segment(1)) {
            first = output.setpoint;
        }
    }
    let first = first.unwrap();
    assert!((first.position[0] - 0.4).abs() < 1e-6, "{first:?}");
    assert!(first.velocity[0].abs() < 1e-3);
}

#[test]
fn a_handle_beyond_the_limits_is_led_back_from_the_limit() {
    let mut player = player(TEXT);
    for now in (0..520 * MS).step_by(PERIOD as usize) {
        let setpoint = player.step(now, &[9.0, f64::NAN, 0.0]).setpoint.unwrap();
        assert!(setpoint.position[0] <= 120.0_f64.to_radians() && setpoint.position[1] == 0.0);
    }
}

#[test]
fn a_stop_in_full_movement_comes_to_rest_holds_and_lets_go() {
    let mut player = player(TEXT);
    let (mut setpoints, _) = play(&mut player, 0, 2_500 * MS);
    assert!(setpoints.last().unwrap().velocity[0].abs() > 1.0, "in full movement");
    player.stop();
    let (after, changes) = play(&mut player, 2_500 * MS, 4_000 * MS);
    assert_eq!(changes, [(2_500 * MS, Change::Stopped(1))]);
    let hold = after[0].position[0];
    setpoints.extend(&after);
    assert_smooth(&setpoints);
    let at = |ms: u64| &after[(ms * MS / PERIOD) as usize];
    assert_eq!(mode(at(200)), Mode::Position);
    assert_eq!(mode(at(700)), Mode::Hold);
    assert_eq!((at(700).position[0], at(700).velocity[0]), (hold, 0.0));
    assert_eq!(mode(at(1_100)), Mode::Passive);
    assert!(!player.status().completed && !state(&player, 1, CLIENT).running);
}

#[test]
fn a_stop_at_rest_lets_go_at_once_and_a_stop_of_nothing_does_nothing() {
    let mut player = player(TEXT);
    play(&mut player, 0, 100 * MS);
    player.stop();
    let output = player.step(100 * MS, &[0.0; AXES]);
    assert_eq!(output.change, Some(Change::Stopped(0)));
    assert_eq!(mode(&output.setpoint.unwrap()), Mode::Passive);
    player.stop();
    assert_eq!(player.step(102 * MS, &[0.0; AXES]).change, None);
}

#[test]
fn a_restart_goes_on_at_the_edge_of_the_interrupted_segment() {
    let mut first = player(TEXT);
    play(&mut first, 0, 5_300 * MS);
    let kept = state(&first, 42, CLIENT).encode().unwrap();

    let state = PlayerState::decode(&kept).unwrap();
    assert_eq!((state.session, state.segment, state.running), (42, 2, true));
    let mut second = Player::default();
    second.resume(&state, program(&state.text)).unwrap();
    let measured = [0.2, 0.0, 0.0];
    second.supervise(60_000 * MS, Permission::Enabled(EPOCH), 60_000 * MS);
    let output = second.step(60_000 * MS, &measured);
    assert_eq!(output.change, Some(Change::Resumed(2)));
    let setpoint = output.setpoint.unwrap();
    assert_eq!((setpoint.segment, setpoint.position[0], setpoint.velocity[0]), (2, 0.2, 0.0));
    // the whole segment again, then the next
    let (_, changes) = play(&mut second, 60_002 * MS, 63_000 * MS);
    assert_eq!(changes[0], (62_200 * MS, Change::Segment(3)));
    assert!((second.status().elapsed_s - (6.7 + 0.798)).abs() < 1e-6);
}

#[test]
fn a_protocol_that_does_not_go_on_after_a_restart_ends_at_0_volts() {
    let text = TEXT.replacen("[protocol]", "[protocol]\nafter_restart = \"abort\"", 1);
    let mut first = player(&text);
    play(&mut first, 0, 5_300 * MS);
    let kept = state(&first, 42, CLIENT);
    assert!(kept.running, "as long as it is played, it is");
    let mut second = Player::default();
    second.resume(&kept, program(&text)).unwrap();
    // Samples are not waited for.
    assert!(second.is_ending());
    second.supervise(60_000 * MS, Permission::Enabled(EPOCH), 0);
    let output = second.step(60_000 * MS, &[0.2, 0.0, 0.0]);
    assert_eq!(output.change, Some(Change::Aborted(2, Reason::Restarted)));
    assert_eq!(mode(&output.setpoint.unwrap()), Mode::Passive);
    assert!(!second.is_running() && !state(&second, 42, CLIENT).running);
    assert!(Reason::Restarted.text().contains("after_restart"));
}

#[test]
fn a_state_that_does_not_fit_is_refused() {
    let mut player = player(TEXT);
    play(&mut player, 0, 700 * MS);
    let state = state(&player, 1, CLIENT);
    let mut fresh = Player::default();
    let other = TEXT.replace("amplitude_deg = 30", "amplitude_deg = 20");
    assert!(matches!(
        fresh.resume(&state, program(&other)),
        Err(ResumeError::OtherProtocol { .. })
    ));
    let beyond = PlayerState { segment: 4, ..state.clone() };
    assert_eq!(
        fresh.resume(&beyond, program(TEXT)),
        Err(ResumeError::NoSegment { found: 4, segments: 4 })
    );
    let stopped = PlayerState { running: false, ..state };
    assert_eq!(fresh.resume(&stopped, program(TEXT)), Err(ResumeError::NotRunning));
    assert_eq!(fresh.step(0, &[0.0; AXES]).setpoint, None);
}

#[test]
fn a_pause_longer_than_the_lease_begins_the_segment_again() {
    let mut player = player(TEXT);
    play(&mut player, 0, 2_000 * MS);
    let measured = [0.1, 0.0, 0.0];
    let output = player.step(3_000 * MS, &measured);
    assert_eq!(output.change, Some(Change::Resumed(1)));
    assert_eq!(output.setpoint.unwrap().position[0], 0.1);
    // a pause within the lease does not
    assert_eq!(player.step(3_090 * MS, &measured).change, None);
}

#[test]
fn a_pause_longer_than_the_lease_ends_a_protocol_that_does_not_go_on_after_a_restart() {
    let text = TEXT.replace("[protocol]\n", "[protocol]\nafter_restart = \"abort\"\n");
    let mut player = player(&text);
    play(&mut player, 0, 2_000 * MS);
    let measured = [0.1, 0.0, 0.0];
    // Within the lease the handle was not held.
    assert_eq!(player.step(2_098 * MS, &measured).change, None);
    let output = player.step(2_199 * MS, &measured);
    assert_eq!(output.change, Some(Change::Aborted(1, Reason::Restarted)));
    assert_eq!(output.setpoint.unwrap().mode, Mode::Passive.code());
    assert!(!player.status().running);
}

#[test]
fn time_that_goes_backwards_stands_still() {
    let mut player = player(TEXT);
    play(&mut player, 0, 2_000 * MS);
    let here = player.step(2_000 * MS, &[0.0; AXES]);
    assert_eq!(player.step(1_000 * MS, &[0.0; AXES]), here);
}

const FIND: &str = "[protocol]\nname = \"find\"\n[[segments]]\nkind = \"initialise\"\n\
                    speed_deg_s = 40\nvolts = 4\nduration_s = 60\n";

/// Steps a search to its end, between stops; returns when that was (ns).
fn find(player: &mut Player) -> u64 {
    let (mut measured, mut now, mut done) = ([0.0; AXES], 0, None);
    while done.is_none() {
        let Output { setpoint, change } = player.step(now, &measured);
        measured[0] = setpoint.unwrap().position[0].clamp(-0.4, 0.4);
        done = change.filter(|change| *change == Change::Done);
        now += PERIOD;
    }
    now - PERIOD
}

#[test]
fn a_search_counts_the_time_that_it_took_not_its_limit() {
    let mut player = player(FIND);
    let took_s = find(&mut player) as f64 * 1e-9;
    let status = player.status();
    assert!(took_s < 20.0 && (status.elapsed_s - took_s).abs() < 1e-6, "{took_s} {status:?}");
}

#[test]
fn a_search_begins_where_the_handle_is_whatever_was_searched_before() {
    let mut player = player(FIND);
    let found_ns = find(&mut player);
    player.start(program(FIND), EPOCH);
    let (setpoints, _) = play(&mut player, found_ns + 1_000 * MS, found_ns + 1_020 * MS);
    for setpoint in &setpoints {
        assert!(setpoint.position[0].abs() < 0.01, "{setpoint:?}");
        assert_eq!(mode(setpoint), Mode::Initialise);
    }
}

#[test]
fn free_movement_needs_a_zero_on_an_axis_with_a_range_of_motion() {
    let of = |kind: &str| {
        let segment = format!("[[segments]]\nkind = \"{kind}\"\nduration_s = 5\n");
        Protocol::parse(&format!("[protocol]\nname = \"test\"\n\n{segment}"), "t.toml").unwrap()
    };
    let unhomed = |kind: &str, rig: &RigFile, homed: u8| {
        Program::new(&of(kind), rig).unwrap().first_unhomed(homed)
    };
    let mut rig = rig();
    assert_eq!(unhomed("free", &rig, 0), None);
    let range = rig::RangeOfMotion { min: -0.3, max: 0.4, tolerance: 0.03 };
    rig.axes[0].range_of_motion = Some(range);
    assert_eq!(unhomed("free", &rig, 0), Some((0, 0)));
    assert_eq!(unhomed("free", &rig, 1), None);
    assert_eq!(unhomed("rest", &rig, 0), None);
}

#[test]
fn repeats_are_written_out() {
    let text = TEXT
        .replace("name = \"test\"", "name = \"test\"\nrepeat = 2")
        .replace("kind = \"steps\"", "kind = \"steps\"\nrepeat = 3");
    let program = program(&text);
    assert_eq!(program.segments(), 2 * 6);
    assert_eq!(program.label(7), "guided");
    assert!((program.duration_s() - 2.0 * (0.5 + 4.0 + 3.0 * 2.2 + 3.0)).abs() < 1e-9);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn setpoints_stay_within_the_limits_and_smooth_whatever_the_wake_times(
        seed in 0..1000u64, stop_ms in prop::option::of(600..9_000u64), left in -2.0..2.0_f64,
    ) {
        let mut player = player(TEXT);
        let (mut now, mut random, mut stop) = (0, seed, stop_ms);
        let mut powered: Vec<Setpoint> = Vec::new();
        while now < 11_000 * MS {
            if stop.is_some_and(|ms| now >= ms * MS) {
                player.stop();
                stop = None;
            }
            let setpoint = player.step(now, &[left, 0.0, 0.0]).setpoint.unwrap();
            let limit = 120.0_f64.to_radians() + 1e-9;
            prop_assert!(setpoint.position[0].abs() <= limit);
            prop_assert!(setpoint.velocity[0].abs() <= 1500.0_f64.to_radians());
            if mode(&setpoint) != Mode::Passive {
                powered.push(setpoint);
            }
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            now += 200_000 + (random >> 40) % 4_000_000;
        }
        for pair in powered.windows(2) {
            let dt = (pair[1].at_ns - pair[0].at_ns) as f64 * 1e-9;
            let mean = 0.5 * (pair[0].velocity[0] + pair[1].velocity[0]);
            let error = (pair[1].position[0] - pair[0].position[0] - dt * mean).abs();
            prop_assert!(error < 2e-4, "position jumps by {error} after {:?}", pair[0]);
        }
    }
}
