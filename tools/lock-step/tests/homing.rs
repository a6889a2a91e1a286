//! Homing, with the cores of all processes on the time grid: power-up anywhere, with any counts;
//! the stops are found, the encoders get their zeros, the handle goes to the centre. The truth is
//! the simulated card's own.
#![allow(clippy::unwrap_used)]

mod cores;

use acquisition::homing::Homing;
use cores::{PROFILE, Rig, SESSION, Timeline, WATCHDOG};
use experiment::player::{Change, Reason};
use ipc_types::{Mode, TripCause, WatchdogState};
use rig::{RangeOfMotion, RigFile};
use simulator::PowerUp;
use watchdog::interlock::{Config, Interlock};

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const HOME: &str = include_str!("../../../launch/protocols/home.toml");

/// The shipped rig with its stops elsewhere, in the simulation and in the rig file.
fn rig_with(stops_deg: (f64, f64), declared_deg: (f64, f64)) -> RigFile {
    let text = RIG
        .replace("end_stop_min_deg = -85.0", &format!("end_stop_min_deg = {:?}", stops_deg.0))
        .replace("end_stop_max_deg = 85.0", &format!("end_stop_max_deg = {:?}", stops_deg.1))
        .replace("lower_stop_deg = -85.0", &format!("lower_stop_deg = {:?}", declared_deg.0))
        .replace("upper_stop_deg = 85.0", &format!("upper_stop_deg = {:?}", declared_deg.1));
    let mut rig = RigFile::parse(&text, "homing.toml").unwrap();
    rig.channels.retain(|channel| channel.kind == rig::ChannelKind::Torque);
    rig
}

/// A rig that was just powered up.
struct Bench {
    live: Rig,
    timeline: Timeline,
    power_up: PowerUp,
    tick: u64,
}

impl Bench {
    fn new(rig: &RigFile, protocol: &str, seed: u64) -> Self {
        let power_up = PowerUp::random(rig, seed);
        let mut live = Rig::new(rig, protocol);
        live.homing = Homing::new(rig, SESSION, None);
        live.card = simulator::Card::new(rig, &[], 5_000_000).unwrap().with_power_up(power_up);
        let timeline = Timeline::new(rig);
        let tick = timeline.first;
        Self { live, timeline, power_up, tick }
    }

    /// Runs until the protocol ends, for so many seconds at most; the last change.
    fn play(&mut self, seconds: u64) -> Option<Change> {
        for _ in 0..seconds * 2000 {
            self.timeline.run(&mut self.live, self.tick);
            self.tick += 1;
            if let Some(last @ (Change::Done | Change::Aborted(..))) = self.live.changes.last() {
                return Some(*last);
            }
        }
        self.live.changes.last().copied()
    }

    /// By how much the zeros differ from the truth (counts).
    fn error(&self) -> (i64, i64) {
        let zeros = self.live.homing.zeros();
        let (master, slave) = (self.power_up.master_zero[0], self.power_up.slave_zero[0]);
        (zeros.master[0] - master, zeros.slave[0] - slave)
    }
}

/// From 200 random positions and counts, on the shipped rig.
#[test]
fn sr_30_random_power_ups_are_homed_to_within_a_count() {
    let rig = rig_with((-85.0, 85.0), (-85.0, 85.0));
    let workers: Vec<_> = (0..2)
        .map(|worker| {
            let rig = rig.clone();
            std::thread::spawn(move || {
                (0..100u64).map(|case| homed(&rig, 2 * case + worker)).collect::<Vec<_>>()
            })
        })
        .collect();
    let errors: Vec<_> = workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect();
    assert_eq!(errors.len(), 200);
    let worst = |of: fn(&(i64, i64)) -> i64| errors.iter().map(of).max().unwrap();
    println!(
        "largest error: master {} counts, slave {} counts",
        worst(|e| e.0.abs()),
        worst(|e| e.1.abs())
    );
    for (seed, (master, slave)) in errors.iter().enumerate() {
        assert!(master.abs() <= 1 && slave.abs() <= 1, "{seed}: {master} and {slave} counts");
    }
}

fn homed(rig: &RigFile, seed: u64) -> (i64, i64) {
    let mut bench = Bench::new(rig, HOME, seed);
    let ended = bench.play(30);
    assert_eq!(ended, Some(Change::Done), "seed {seed}: {:?}", bench.live.machine.cause());
    assert_eq!(bench.live.machine.state(), WatchdogState::Enabled);
    assert_eq!(bench.live.homing.zeros().homed, 1);
    let limit_v = rig.axes[0].stop_search().unwrap().volts_max;
    let mut homed = false;
    for cycle in &bench.live.cycles {
        let volts = cycle.command.volts[0].abs();
        assert!(cycle.sample.homed == 1 || volts <= limit_v, "seed {seed}: {volts} V unhomed");
        assert!(!homed || cycle.sample.homed == 1, "it stays homed");
        homed |= cycle.sample.homed == 1;
        let mode = cycle.setpoint.map_or(Mode::Passive.code(), |setpoint| setpoint.mode);
        let quiet = [Mode::Passive, Mode::Hold, Mode::Initialise].map(Mode::code);
        assert!(homed || quiet.contains(&mode), "seed {seed}: mode {mode} while unhomed");
    }
    bench.error()
}

/// One to three axes, oil and cable, each with the protocol that is shipped for it. The handle's
/// zero is within a count everywhere. The motor's depends on how far its friction holds the line
/// wound at either stop: by less than a count on the oil rigs, by half a degree on the cable.
#[test]
fn sr_30_every_shipped_rig_is_homed() {
    for name in rig::RIGS.iter().map(|shipped| shipped.name) {
        let rig = rig::load_rig(name.as_ref()).unwrap();
        // The others are for records, and never get power.
        if rig.check_homing().is_err() {
            assert!(!rig.model.kind.is_transmission(), "{name}");
            continue;
        }
        let protocol = rig::home_protocol(rig.axes.len());
        let protocol = rig::load_protocol(protocol.as_ref(), &[]).unwrap();
        let mut bench = Bench::new(&rig, protocol.text(), 11);
        assert_eq!(bench.play(120), Some(Change::Done), "{name}: {:?}", bench.live.machine.cause());
        assert_eq!(bench.live.homing.zeros().homed, (1 << rig.axes.len()) - 1, "{name}");
        for axis in 0..rig.axes.len() {
            let zeros = bench.live.homing.zeros();
            let master = zeros.master[axis] - bench.power_up.master_zero[axis];
            let slave = zeros.slave[axis] - bench.power_up.slave_zero[axis];
            println!("{name}, axis {axis}: master {master}, slave {slave} counts");
            let most = if name == "cable" { 333 } else { 1 };
            assert!(master.abs() <= most, "{name}: {master} counts");
            assert!(slave.abs() <= 1, "{name}: {slave} counts");
        }
    }
}

/// Stops that lie unequally: the motor's zero depends on the ratio of the line as well, which is
/// measured to about 2 % on this short travel.
#[test]
fn sr_30_unequal_stops_are_homed_too() {
    let rig = rig_with((-40.0, 12.0), (-40.0, 12.0));
    for seed in 0..5 {
        let mut bench = Bench::new(&rig, HOME, seed);
        assert_eq!(bench.play(30), Some(Change::Done), "{:?}", bench.live.machine.cause());
        let (master, slave) = bench.error();
        println!("seed {seed}: master {master}, slave {slave} counts");
        assert!(master.abs() <= 5 && slave.abs() <= 1, "{master} and {slave} counts");
    }
}

/// The options of a tuned control, which help it to follow, keep out of the search: on machines
/// with effects that wind the line up, or turn the handle, the search would else trip. On the way
/// to the centre, from where the handle lies at a stop, they do not take the motor to its limits.
#[test]
fn sr_30_a_tuned_rig_is_homed_whatever_its_machine_has() {
    for (id, site, parameter) in [
        ("backlash", "slave", "gap = 0.05"),
        ("coulomb_friction", "master", "level = 0.4"),
        ("viscous_friction", "slave", "coefficient = 0.12"),
        ("gravity_imbalance", "slave", "torque = 1.3"),
        ("line_compliance", "line", "compliance_ratio = 0.9"),
        ("torque_ripple", "drive", "amplitude = 0.25"),
        ("extra_inertia", "slave", "inertia = 4e-3"),
    ] {
        let rig = tuned(id, site, parameter);
        for seed in 0..4 {
            let mut bench = Bench::new(&rig, HOME, seed);
            let ended = bench.play(40);
            assert_eq!(ended, Some(Change::Done), "{id}@{site}, seed {seed}");
            let (master, slave) = bench.error();
            println!("{id}@{site}, seed {seed}: master {master}, slave {slave} counts");
            assert!(slave.abs() <= 1, "{id}@{site}, seed {seed}: {slave} counts");
        }
    }
}

/// A line that leaks so much does not come to rest against a stop.
#[test]
fn sr_30_a_line_that_leaks_gives_no_zero() {
    let mut bench = Bench::new(&tuned("leakage", "line", "conductance = 4e-12"), HOME, 0);
    bench.live.may_trip = true;
    assert!(matches!(bench.play(40), Some(Change::Aborted(..))));
    assert_eq!(bench.live.machine.cause(), TripCause::PositionLimit);
    assert_eq!(bench.live.homing.zeros().homed, 0);
}

/// The shipped rig with all options of position control, and with an effect, in the machine and in
/// the rig file.
fn tuned(id: &str, site: &str, parameter: &str) -> RigFile {
    let options = "[axes.control.observer]\n\n[axes.control.slave]\nlead_s = 0.03\n";
    let effect = format!("[[model.effects]]\nid = \"{id}\"\nsite = \"{site}\"\n");
    let text = RIG
        .replace("kind = \"printed\"", "kind = \"identified\"")
        .replacen("# Analog inputs,", &format!("{options}\n# Analog inputs,"), 1)
        .replacen("[replay]", &format!("{effect}parameters = {{ {parameter} }}\n\n[replay]"), 1);
    let rig = RigFile::parse(&text, "tuned.toml").unwrap();
    let options = rig.axes[0].control.options;
    assert!(options.observer.is_some() && options.slave.is_some());
    assert_eq!(options.compensation.kind, rig::CompensationKind::Identified);
    rig
}

#[test]
fn sr_30_a_travel_that_is_not_the_rig_files_gives_no_zero() {
    let rig = rig_with((-22.0, 10.0), (-22.0, 22.0));
    let mut bench = Bench::new(&rig, HOME, 3);
    assert_eq!(bench.play(30), Some(Change::Aborted(0, Reason::OtherTravel)));
    assert_eq!(bench.live.homing.zeros().homed, 0);
}

/// Only the search for the stops moves an axis that is not homed.
#[test]
fn sr_30_an_unhomed_axis_follows_no_movement() {
    let rig = rig_with((-22.0, 22.0), (-22.0, 22.0));
    let movement = "[protocol]\nname = \"move\"\n\n[[segments]]\nkind = \"steps\"\n\
                    positions_deg = [10.0, -10.0]\nrise_s = 0.5\ndwell_s = 0.5\n";
    let mut bench = Bench::new(&rig, movement, 5);
    let before = bench.power_up.handle[0];
    bench.play(6);
    let moved = bench.live.card.motion().slave_position_rad - before;
    assert!(moved.abs() < 0.01, "the handle moved by {moved} rad");
    assert!(bench.live.cycles.iter().all(|cycle| {
        cycle.setpoint.is_none_or(|setpoint| setpoint.mode == Mode::Passive.code())
    }));
}

/// An encoder's counter jumps in the middle of a movement: the motor loses power, and the axis its
/// zero.
#[test]
fn sr_30_a_counter_that_jumps_trips_and_unhomes() {
    let rig = rig_with((-22.0, 22.0), (-22.0, 22.0));
    let movement = format!(
        "{HOME}\n[[segments]]\nkind = \"guided_sine\"\namplitude_deg = 10.0\nfrequency_hz = 0.5\n\
         duration_s = 20.0\n"
    );
    for counts in [-100_000, 300] {
        let mut bench = Bench::new(&rig, &movement, 9);
        while !matches!(bench.live.changes.last(), Some(Change::Segment(2))) {
            bench.timeline.run(&mut bench.live, bench.tick);
            bench.tick += 1;
        }
        bench.play(3);
        bench.live.may_trip = true;
        bench.live.begin_fault(&format!("encoder_jump@master={counts}"), &rig);
        bench.play(1);
        assert_eq!(bench.live.machine.state(), WatchdogState::Tripped);
        assert_eq!(bench.live.machine.cause(), TripCause::EncoderJump);
        assert_eq!(bench.live.homing.zeros().homed, 0, "{counts} counts");
    }
}

/// From -20° to 25°, and 2° beyond.
fn range() -> RangeOfMotion {
    let [min, max, tolerance] = [-20.0, 25.0, 2.0].map(f64::to_radians);
    RangeOfMotion { min, max, tolerance }
}

/// The range of motion is far within the stops, and the search goes to both: it comes back without
/// a trip, and ends within the range.
#[test]
fn sr_44_a_search_for_the_stops_comes_back_into_the_range_of_motion() {
    let mut rig = rig_with((-85.0, 85.0), (-85.0, 85.0));
    rig.axes[0].range_of_motion = Some(range());
    for seed in 0..4 {
        let mut bench = Bench::new(&rig, HOME, seed);
        assert_eq!(bench.play(30), Some(Change::Done), "{:?}", bench.live.machine.cause());
        assert_eq!(bench.live.machine.state(), WatchdogState::Enabled);
        let handle = bench.live.card.motion().slave_position_rad;
        assert_eq!(range().excess(handle), 0.0, "seed {seed}: {handle} rad");
        let beyond = bench.live.cycles.iter().any(|cycle| {
            let volts = cycle.command.volts[0];
            rig.axes[0].leaves_range(0, &cycle.sample) && cycle.powered && volts != 0.0
        });
        assert!(beyond, "seed {seed}: homed beyond the range, it was driven back");
    }
}

/// A movement that should not be: the watchdog alone knows the range.
#[test]
fn sr_44_a_movement_beyond_the_range_of_motion_loses_its_power() {
    let rig = rig_with((-85.0, 85.0), (-85.0, 85.0));
    let mut narrow = rig.clone();
    narrow.axes[0].range_of_motion = Some(range());
    for (amplitude_deg, leaves) in [(15.0, false), (60.0, true)] {
        let movement = format!(
            "[protocol]\nname = \"move\"\n\n[[segments]]\nkind = \"guided_sine\"\n\
             amplitude_deg = {amplitude_deg:?}\nfrequency_hz = 0.5\nduration_s = 8.0\n"
        );
        let mut live = Rig::new(&rig, &movement);
        live.machine = Interlock::new(Config::for_profile(PROFILE, SESSION, WATCHDOG, &narrow));
        live.may_trip = leaves;
        let mut timeline = Timeline::new(&rig);
        let mut tick = timeline.first;
        let end = tick + 12 * 2000;
        while tick < end && live.machine.state() != WatchdogState::Tripped {
            timeline.run(&mut live, tick);
            tick += 1;
        }
        if !leaves {
            assert_eq!(live.changes.last(), Some(&Change::Done));
            continue;
        }
        assert_eq!(live.machine.cause(), TripCause::RangeOfMotion);
        let handle = live.newest_sample.unwrap().slave_position[0];
        let beyond = range().excess(handle) - range().tolerance;
        println!("{:.2} degrees beyond the tolerance", beyond.to_degrees());
        // A cycle of the watchdog at 190 degrees a second, twice over.
        assert!(beyond > 0.0 && beyond < 0.4f64.to_radians(), "{beyond} rad");
        for after in 0..20 {
            timeline.run(&mut live, tick + after);
        }
        assert_eq!(live.newest_sample.unwrap().output_v[0], 0.0);
    }
}
