//! The simulated card: conformance, and what a real card does when the others die.
#![allow(clippy::unwrap_used)]

use rig::RigFile;
use runtime::daq::Daq;
use simulator::{Card, LockStepDaq};

#[path = "../../acquisition/tests/conformance/mod.rs"]
mod conformance;

use conformance::Bench;

const LINE_NS: u64 = 5_000_000;
const TICK_NS: u64 = 500_000;

fn shipped(name: &str) -> RigFile {
    RigFile::load(format!("{}/../../launch/rigs/{name}.toml", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn rig() -> RigFile {
    shipped("hydrostatic")
}

/// The shipped hydrostatic rig with some of its keys' values changed.
fn edited(edits: &[(&str, &str)]) -> RigFile {
    let mut text = rig().text().to_owned();
    for (from, to) in edits {
        assert_eq!(text.matches(from).count(), 1, "the edit must hit one place: {from}");
        text = text.replace(from, to);
    }
    RigFile::parse(&text, "rig.toml").unwrap()
}

/// The scans of a card without power.
fn scans(rig: &RigFile, count: u64) -> Vec<ipc_types::CardScan> {
    let mut card = Card::new(rig, &[], LINE_NS).unwrap();
    (1000..1000 + count).map(|tick| card.clock(tick, tick * TICK_NS)).collect()
}

struct LockStepBench(LockStepDaq, RigFile);

impl Bench for LockStepBench {
    fn reset(&mut self) {
        self.0 = LockStepDaq::new(&self.1, &[], LINE_NS, true).unwrap();
    }
    fn advance(&mut self, ticks: u64) {
        self.0.advance(ticks);
    }
    fn now_ns(&self) -> u64 {
        self.0.now_ns()
    }
    fn daq(&mut self) -> &mut dyn Daq {
        &mut self.0
    }
    fn has_power(&self) -> bool {
        true
    }
}

#[test]
fn the_lock_step_card_conforms() {
    for name in ["hydrostatic", "cable"] {
        let rig = shipped(name);
        let mut feedback_only =
            LockStepBench(LockStepDaq::new(&rig, &[], LINE_NS, true).unwrap(), rig);
        conformance::check(&mut feedback_only).unwrap_or_else(|error| panic!("{name}: {error:?}"));
    }
}

#[test]
fn the_motor_has_power_only_while_the_line_toggles() {
    let mut card = Card::new(&rig(), &[], LINE_NS).unwrap();
    card.write([2.0, 0.0, 0.0], 1, 7);
    let time = |tick: u64| tick * TICK_NS;
    // never toggled
    assert_eq!(card.clock(100, time(100)).motor_power, 0);
    // one message with any count is no edge yet; it takes a change
    card.enable_line(1, 8, time(100));
    assert_eq!(card.clock(101, time(101)).motor_power, 0);
    // nor is one edge a sign of life: a watchdog that starts again makes one
    card.enable_line(1, 0, time(102));
    for tick in 102..130 {
        assert_eq!(card.clock(tick, time(tick)).motor_power, 0);
    }
    // two are, where they follow each other soon
    card.enable_line(1, 1, time(130));
    assert_eq!(card.clock(130, time(130)).motor_power, 0, "the edge before is long ago");
    for tick in 131..140 {
        card.enable_line(1, tick, time(tick));
        let scan = card.clock(tick, time(tick));
        assert_eq!((scan.motor_power, scan.motor_v[0], scan.dac_v[0]), (1, 2.0, 2.0));
    }
    // the line stops (held level repeats the same count): power lasts 5 ms = 10 ticks from the last
    // edge, no longer
    let dead: Vec<u64> = (140..170)
        .filter(|tick| {
            card.enable_line(1, 139, time(*tick));
            let scan = card.clock(*tick, time(*tick));
            assert_eq!(scan.dac_v[0], 2.0, "the DAC holds whoever dies");
            assert_eq!(scan.motor_v[0], if scan.motor_power == 1 { 2.0 } else { 0.0 });
            scan.motor_power == 0
        })
        .collect();
    assert_eq!(dead, (150..170).collect::<Vec<_>>());
}

#[test]
fn volts_move_the_handle_and_counts_say_so() {
    let mut card = Card::new(&rig(), &[], LINE_NS).unwrap();
    card.write([2.5, 0.0, 0.0], 1, 7);
    let mut scan = None;
    for tick in 1..=1000 {
        card.enable_line(1, tick, tick * TICK_NS);
        scan = Some(card.clock(tick, tick * TICK_NS));
    }
    let scan = scan.unwrap();
    let state = card.motion();
    assert!(state.master_position_rad > 0.1, "{}", state.master_position_rad);
    let master = rig().axes[0].master.position(scan.master_counts[0]);
    // the scan is of the state one period before, at most one count and the noise away
    let slack =
        3.0 / rig().axes[0].master.counts_per_unit + state.master_velocity_rad_s.abs() * 0.5e-3;
    assert!(
        (master - state.master_position_rad).abs() <= slack,
        "{master} against {}",
        state.master_position_rad
    );
}

#[test]
fn an_effect_changes_the_plant_and_an_unknown_one_is_refused() {
    let travel = |effects: &[String]| {
        let mut card = Card::new(&rig(), effects, LINE_NS).unwrap();
        card.write([2.5, 0.0, 0.0], 1, 7);
        // Not so long that either comes to the hard stop.
        for tick in 1..=250 {
            card.enable_line(1, tick, tick * TICK_NS);
            card.clock(tick, tick * TICK_NS);
        }
        card.motion().master_position_rad
    };
    let plain = travel(&[]);
    let rubbing = travel(&["coulomb_friction@master=1.0".to_owned()]);
    assert!(rubbing < 0.8 * plain, "{rubbing} against {plain}");
    let error = Card::new(&rig(), &["gremlins".to_owned()], LINE_NS).unwrap_err().to_string();
    assert!(error.contains("gremlins") && error.contains("backlash"), "{error}");
}

#[test]
fn not_finite_volts_are_written_as_zero() {
    let mut card = Card::new(&rig(), &[], LINE_NS).unwrap();
    card.write([f64::NAN, f64::INFINITY, 1.0], 1, 7);
    assert_eq!(card.clock(1, TICK_NS).dac_v, [0.0, 0.0, 1.0]);
}

#[test]
fn volts_move_the_cables_handle_and_both_encoders_say_so() {
    let rig = shipped("cable");
    let mut card = Card::new(&rig, &[], LINE_NS).unwrap();
    card.write([4.0, 0.0, 0.0], 1, 7);
    let mut scan = card.clock(1, TICK_NS);
    for tick in 2..=400 {
        card.enable_line(1, tick, tick * TICK_NS);
        scan = card.clock(tick, tick * TICK_NS);
    }
    let motion = card.motion();
    assert!(motion.slave_position_rad > 0.1, "{motion:?}");
    assert!(motion.slave_position_rad < motion.master_position_rad / 6.0, "{motion:?}");
    let axis = &rig.axes[0];
    let slack = |counts_per_unit: f64, speed: f64| 3.0 / counts_per_unit + speed.abs() * 0.5e-3;
    let (master, slave) = (axis.master, axis.slave.unwrap());
    // The motor's angle is read over the gear.
    let gear = master.turns_per_handle_turn;
    let error = master.position(scan.master_counts[0]) - motion.master_position_rad / gear;
    assert!(
        error.abs() <= slack(master.counts_per_unit, motion.master_velocity_rad_s / gear),
        "{error}"
    );
    let error = slave.position(scan.slave_counts[0]) - motion.slave_position_rad;
    assert!(error.abs() <= slack(slave.counts_per_unit, motion.slave_velocity_rad_s), "{error}");
}

#[test]
fn the_hands_inertia_slows_the_cables_handle() {
    let travel = |inertia: &str| {
        let text =
            shipped("cable").text().replace("inertia = 0.0 ", &format!("inertia = {inertia} "));
        let mut card =
            Card::new(&RigFile::parse(&text, "cable.toml").unwrap(), &[], LINE_NS).unwrap();
        card.write([6.0, 0.0, 0.0], 1, 7);
        for tick in 1..=200 {
            card.enable_line(1, tick, tick * TICK_NS);
            card.clock(tick, tick * TICK_NS);
        }
        card.motion().slave_position_rad
    };
    let (light, heavy) = (travel("0.0"), travel("0.05"));
    assert!(heavy > 0.0 && heavy < 0.7 * light, "{heavy} against {light}");
}

#[test]
fn an_effect_acts_in_the_cables_and_one_of_fluids_is_refused() {
    let rig = shipped("cable");
    let travel = |effects: &[String]| {
        let mut card = Card::new(&rig, effects, LINE_NS).unwrap();
        card.write([4.0, 0.0, 0.0], 1, 7);
        for tick in 1..=400 {
            card.enable_line(1, tick, tick * TICK_NS);
            card.clock(tick, tick * TICK_NS);
        }
        card.motion().master_position_rad
    };
    let (plain, rubbing) = (travel(&[]), travel(&["coulomb_friction@master=0.3".to_owned()]));
    assert!(rubbing < 0.9 * plain, "{rubbing} against {plain}");
    let error = Card::new(&rig, &["leakage".to_owned()], LINE_NS).unwrap_err().to_string();
    assert!(
        error.contains("`leakage`") && error.contains("does not act on a cable transmission"),
        "{error}"
    );
}

#[test]
fn a_machine_without_a_plant_is_refused() {
    let error = Card::new(&shipped("emps"), &[], LINE_NS).unwrap_err().to_string();
    assert!(error.contains("\"hydrostatic\" and \"cable\"; found kind \"drive\""), "{error}");
}

#[test]
fn the_torque_cells_zero_drifts_as_declared() {
    let torque =
        |rig: &RigFile| scans(rig, 4000).iter().map(|scan| scan.analog_v[0]).collect::<Vec<_>>();
    let mean = |volts: &[f64]| volts.iter().sum::<f64>() / volts.len() as f64;
    let still = torque(&rig());
    assert!(mean(&still[3000..]).abs() < 3e-4, "{}", mean(&still[3000..]));
    let ramp = torque(&edited(&[("torque_drift_v_per_s = 0.0", "torque_drift_v_per_s = 0.1")]));
    // the last of two seconds: 0.175 V in the mean of its second half
    assert!((mean(&ramp[3000..]) - 0.175).abs() < 1e-3, "{}", mean(&ramp[3000..]));
    let walk =
        torque(&edited(&[("torque_walk_v_per_sqrt_s = 0.0", "torque_walk_v_per_sqrt_s = 0.1")]));
    // drift leaves the noise as it was: what is left is the walk, of 0.1 V after a second
    let steps: Vec<f64> = walk.iter().zip(&still).map(|(walk, still)| walk - still).collect();
    let squares: f64 = steps.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    assert!((squares / 2.0 / 0.01 - 1.0).abs() < 0.1, "{squares}");
}

#[test]
fn a_narrow_torque_cell_smooths_and_lags() {
    let after = |bandwidth: &str| {
        let rig = edited(&[
            ("torque_bandwidth_hz = 200.0", bandwidth),
            ("torque_noise_v = 0.002", "torque_noise_v = 0.0"),
            ("stiffness = 0.3 ", "stiffness = 10.0 "),
        ]);
        let mut card = Card::new(&rig, &[], LINE_NS).unwrap();
        card.write([6.0, 0.0, 0.0], 1, 7);
        let mut volts = 0.0;
        for tick in 1..=200 {
            card.enable_line(1, tick, tick * TICK_NS);
            volts = card.clock(tick, tick * TICK_NS).analog_v[0];
        }
        volts
    };
    let (wide, narrow) = (after("torque_bandwidth_hz = 200.0"), after("torque_bandwidth_hz = 1.0"));
    assert!(wide < -0.1 && narrow < 0.0 && narrow > 0.7 * wide, "{narrow} against {wide}");
}

#[test]
fn the_scanner_pulses_on_its_channel_once_a_volume() {
    assert!(scans(&rig(), 200).iter().all(|scan| scan.analog_v[7] == 0.0), "no scanner runs");
    let scanner = edited(&[
        ("trigger_repetition_s = 0.0", "trigger_repetition_s = 0.5"),
        ("analog_noise_v = 0.001", "analog_noise_v = 0.0"),
    ]);
    let volts: Vec<f64> = scans(&scanner, 3500).iter().map(|scan| scan.analog_v[7]).collect();
    for (index, volts) in volts.iter().enumerate() {
        // every 1,000 scans, 20 of them long, the first with the first scan
        let expected = if index % 1000 < 20 { 0.0 } else { 5.0 };
        assert_eq!(*volts, expected, "scan {index}");
    }
    let noisy = edited(&[("trigger_repetition_s = 0.0", "trigger_repetition_s = 0.5")]);
    assert!(scans(&noisy, 100)[50..].iter().any(|scan| (scan.analog_v[7] - 5.0).abs() > 1e-4));
}

#[test]
fn two_watchdogs_that_hold_the_line_do_not_keep_it_alive_between_them() {
    let mut card = Card::new(&rig(), &[], LINE_NS).unwrap();
    let time = |tick: u64| tick * TICK_NS;
    for tick in 100..120 {
        card.enable_line(1, tick, time(tick));
        let powered = card.clock(tick, time(tick)).motor_power == 1;
        assert_eq!(powered, tick >= 102, "tick {tick}");
    }
    // The one that toggled holds its last level, and another one beside it, which has never
    // toggled.
    let dead: Vec<u64> = (120..160)
        .filter(|tick| {
            card.enable_line(1, 119, time(*tick));
            card.enable_line(2, 0, time(*tick));
            card.clock(*tick, time(*tick)).motor_power == 0
        })
        .collect();
    assert_eq!(
        dead,
        (130..160).collect::<Vec<_>>(),
        "power ends with the last edge that one of them made"
    );
    // Once there is one again that toggles, there is power again.
    for tick in 160..170 {
        card.enable_line(2, tick, time(tick));
    }
    assert_eq!(card.clock(170, time(170)).motor_power, 1);
}
