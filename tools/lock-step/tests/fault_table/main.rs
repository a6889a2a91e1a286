//! Every kind of fault in the middle of a movement, with the cores of all processes on the time
//! grid: what the rig notices of it, by which interlock, and after how many card ticks the motor
//! has 0 V. `docs/faults.md` has the list and the figures:
//!
//! `UPDATE_PAGES=1 cargo test -p lock-step --test fault_table` writes it anew.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../cores/mod.rs"]
mod cores;

mod page;

use acquisition::homing::{Homing, HomingState};
use cores::{MOVEMENT, Rig, SECOND, SESSION, Timeline};
use ipc_types::{AXES, GateState, TripCause, Verb, WatchdogState, Zeros};
use plant::transmission_kinds::Kind;
use rig::RigFile;
use simulator::faults::{Fault, FaultInjector, LIST, Promise};
use watchdog::interlock::Refusal;

const RIGS: [(Kind, &str); 2] = [
    (Kind::Hydrostatic, include_str!("../../../../launch/rigs/hydrostatic.toml")),
    (Kind::Cable, include_str!("../../../../launch/rigs/cable.toml")),
];

/// From the first scan to the fault: power and fade-in are over, and the handle moves.
const BEFORE: u64 = 2 * SECOND + 600;
/// For so long the rig is watched after it.
const WATCHED: u64 = 4 * SECOND;

/// The shipped rig, a scanner's pulses included where it has a trigger channel.
fn rig(text: &str) -> RigFile {
    let text = text.replace("trigger_repetition_s = 0.0", "trigger_repetition_s = 2.0");
    RigFile::parse(&text, "faults.toml").unwrap()
}

/// A homed rig under power that moves its handle to and fro.
struct Bench {
    live: Rig,
    timeline: Timeline,
    injector: FaultInjector,
    tick: u64,
    /// Last tick in which volts acted on the motor.
    last_volts: Option<u64>,
    /// First tick of the fault.
    begun: Option<u64>,
}

impl Bench {
    fn new(rig: &RigFile) -> Self {
        let mut live = Rig::new(rig, MOVEMENT);
        let zeros = Zeros { homed: 1, sequence: 1, ..Zeros::default() };
        let kept = HomingState { session: SESSION, power_up: 0, zeros };
        live.homing = Homing::new(rig, SESSION, Some(&kept));
        let timeline = Timeline::new(rig);
        let tick = timeline.first;
        let injector = FaultInjector::new(rig, &[]);
        Self { live, timeline, injector, tick, last_volts: None, begun: None }
    }

    fn run(&mut self, ticks: u64) {
        for _ in 0..ticks {
            self.timeline.run(&mut self.live, self.tick);
            if self.live.card.applied_v() != [0.0; AXES] {
                self.last_volts = Some(self.tick);
            }
            while let Some(notice) = self.live.card.fault_notice() {
                self.begun.get_or_insert(notice.tick);
            }
            self.tick += 1;
        }
    }

    fn begin(&mut self, text: &str) {
        let fault = Fault::parse(text, None, None, self.injector.rig()).unwrap();
        let (injection, plant) = self.injector.prepare(&fault).unwrap();
        assert!(self.live.card.begin_fault(&injection, plant).0);
    }
}

/// What became of a fault.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Outcome {
    /// Cause of the trip; `None` where nothing tripped.
    trip: Option<TripCause>,
    /// Card ticks from the first scan with the fault to the first in which the motor has 0 V for
    /// good; `None` where it has volts to the end.
    to_zero: Option<u64>,
}

fn outcome(rig: &RigFile, text: &str) -> Outcome {
    let mut bench = Bench::new(rig);
    bench.run(BEFORE);
    assert_eq!(bench.live.machine.state(), WatchdogState::Enabled);
    assert!(bench.last_volts.is_some(), "the motor moves");
    bench.live.may_trip = true;
    bench.begin(text);
    bench.run(WATCHED);
    let begun = bench.begun.unwrap();
    let tripped = bench.live.machine.state() == WatchdogState::Tripped;
    let next = bench.last_volts.unwrap() + 1;
    Outcome {
        trip: tripped.then(|| bench.live.machine.cause()),
        to_zero: (next < bench.tick).then(|| next.saturating_sub(begun)),
    }
}

/// One row of the table of figures: a kind at one of its places.
struct Row {
    text: String,
    promise: Promise,
    /// By transmission, in the order of [`RIGS`]; `None` where it cannot have the fault.
    outcomes: [Option<Outcome>; 2],
}

fn rows() -> Vec<Row> {
    let rigs = RIGS.map(|(kind, text)| (kind, rig(text)));
    let mut rows = Vec::new();
    for kind in LIST {
        for (text, &promise) in kind.texts("torque").into_iter().zip(kind.promises) {
            let outcomes = [0, 1].map(|index| {
                let (transmission, rig) = &rigs[index];
                let has = kind.only.is_none_or(|only| only == *transmission)
                    && Fault::parse(&text, None, None, rig).is_ok();
                has.then(|| outcome(rig, &text))
            });
            rows.push(Row { text, promise, outcomes });
        }
    }
    rows
}

/// The list promises what is true, and the page says what the list and the rig say.
#[test]
fn every_kind_is_noticed_as_promised_and_the_page_says_so() {
    let rows = rows();
    for Row { text, promise, outcomes } in &rows {
        assert!(outcomes.iter().any(Option::is_some), "{text}: no rig can have it");
        for outcome in outcomes.iter().flatten() {
            let what = format!("{text}: {outcome:?}; the list promises {promise:?}");
            match *promise {
                Promise::Trips(causes, within) => {
                    assert!(outcome.trip.is_some_and(|cause| causes.contains(&cause)), "{what}");
                    assert!(outcome.to_zero.is_some_and(|ticks| ticks <= within), "{what}");
                }
                Promise::AtALimit(causes) => {
                    assert!(outcome.trip.is_none_or(|cause| causes.contains(&cause)), "{what}");
                    assert!(outcome.trip.is_none() || outcome.to_zero.is_some(), "{what}");
                }
                Promise::NotNoticed => assert_eq!(outcome.trip, None, "{what}"),
            }
        }
    }
    page::check(&rows);
}

/// Both ways to 0 V against a DAC that is stuck: the gate's zeros do not reach the motor, the
/// enable line drops it.
#[test]
fn a_stuck_dac_is_dropped_by_the_enable_line() {
    for (_, text) in RIGS {
        let rig = rig(text);
        let mut bench = Bench::new(&rig);
        bench.run(BEFORE);
        bench.live.may_trip = true;
        bench.begin("dac_stuck");
        bench.run(20);
        let now_ns = bench.tick * rig.rates.acquisition_period_ns();
        bench.live.machine.command(Verb::Estop, now_ns).unwrap();
        let stopped = bench.tick;
        bench.run(200);
        let ticks = bench.last_volts.unwrap() + 1 - stopped;
        // The line's last edge, 5 ms, and a cycle of each process.
        assert!((2..=10 + 6).contains(&ticks), "{ticks} ticks after the emergency stop");
        let sample = bench.live.newest_sample.unwrap();
        assert_eq!((sample.motor_power, sample.motor_v[0], sample.output_v[0]), (0, 0.0, 0.0));
    }
}

/// A relay that sticks is not seen while the motor has power; once power is withdrawn the gate
/// writes 0 V, and the watchdog sees that the power stays.
#[test]
fn a_stuck_relay_is_seen_once_power_is_withdrawn() {
    let rig = rig(RIGS[0].1);
    let mut bench = Bench::new(&rig);
    bench.run(BEFORE);
    bench.begin("relay_stuck");
    bench.run(20);
    bench.live.may_trip = true;
    let period_ns = rig.rates.acquisition_period_ns();
    bench.live.machine.command(Verb::Estop, bench.tick * period_ns).unwrap();
    bench.run(SECOND);
    let sample = bench.live.newest_sample.unwrap();
    assert_eq!((sample.motor_power, sample.motor_v[0]), (1, 0.0), "the gate's 0 V reach the motor");
    let mut verb = |verb| bench.live.machine.command(verb, bench.tick * period_ns);
    assert_eq!(verb(Verb::Reset), Err(Refusal::FaultActive(TripCause::MotorPowered)));
}

/// A line that broke before `enable`, as a button that was pressed: power never comes.
#[test]
fn sr_43_motor_power_that_does_not_come_trips() {
    for (_, text) in RIGS {
        let mut bench = Bench::new(&rig(text));
        bench.live.may_trip = true;
        bench.begin("enable_line_broken");
        let mut opened = None;
        while bench.live.machine.state() != WatchdogState::Tripped {
            bench.run(1);
            let sample = bench.live.newest_sample;
            if sample.is_some_and(|sample| sample.gate_state == GateState::Open.code()) {
                opened.get_or_insert(bench.tick);
            }
            assert!(bench.tick < bench.timeline.first + SECOND, "it never trips");
        }
        // Where volts are written and read back, these tell it earlier.
        let cause = bench.live.machine.cause();
        assert!(matches!(cause, TripCause::PowerMissing | TripCause::ReadBack), "{cause:?}");
        // 100 ms, and a cycle of the watchdog.
        let ticks = bench.tick - opened.unwrap();
        let least = if cause == TripCause::PowerMissing { 200 } else { 0 };
        assert!((least..=200 + 6).contains(&ticks), "{ticks} ticks after the gate has opened");
        assert_eq!(bench.last_volts, None);
    }
}

/// A seized slave stands while the master winds up the line; let go, it springs back.
#[test]
fn a_seized_slave_stands_to_its_last_tick() {
    for (_, text) in RIGS {
        let rig = rig(text);
        let mut bench = Bench::new(&rig);
        bench.run(BEFORE);
        let fault = Fault::parse("seized", None, Some(0.5), &rig).unwrap();
        let (injection, plant) = bench.injector.prepare(&fault).unwrap();
        assert!(bench.live.card.begin_fault(&injection, plant).0);
        // So fast that the speed limit may trip.
        bench.live.may_trip = true;
        bench.run(2);
        let stands = bench.live.card.motion().slave_position_rad;
        for _ in 0..997 {
            bench.run(1);
            assert_eq!(bench.live.card.motion().slave_position_rad, stands);
        }
        let mut furthest = 0.0_f64;
        for _ in 0..SECOND {
            bench.run(1);
            let moved = bench.live.card.motion().slave_position_rad - stands;
            furthest = furthest.max(moved.abs());
        }
        assert!(furthest > 0.1, "it moves again: {furthest} rad");
    }
}
