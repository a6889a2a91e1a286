//! Faults of the simulated card and machine: the list is walked, and each does what it says between
//! plant and sample, or between what is written and the motor.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use ipc_types::{ABSENT_COUNT, CardScan};
use proptest::prelude::*;
use rig::RigFile;
use runtime::daq::Daq as _;
use simulator::faults::{
    Action, Acts, Fault, FaultError, FaultFilter, FaultInjector, FaultKind, FaultNotice, LIST,
    MOST_FAULTS, kind,
};
use simulator::{Card, LockStepDaq};

const LINE_NS: u64 = 5_000_000;
const TICK_NS: u64 = 500_000;

fn shipped(name: &str) -> RigFile {
    let path = format!("{}/../../launch/rigs/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    let text = text.replace("trigger_repetition_s = 0.0", "trigger_repetition_s = 0.1");
    RigFile::parse(&text, "rig.toml").unwrap()
}

/// A rig that can have the kind of fault.
fn rig_for(kind: &FaultKind) -> RigFile {
    shipped(kind.only.map_or("hydrostatic", |only| only.name()))
}

/// `KIND@PLACE` for each of its places.
fn everywhere(kind: &FaultKind) -> Vec<String> {
    let word = |word: &str| if word == "CHANNEL" { "torque".to_owned() } else { word.to_owned() };
    match kind.places {
        [] => vec![kind.name.to_owned()],
        places => places.iter().map(|at| format!("{}@{}", kind.name, word(at.word()))).collect(),
    }
}

/// A card under power on which the same volts are written with and without faults.
struct Bench {
    card: Card,
    injector: FaultInjector,
    tick: u64,
    toggles: bool,
    volts: f64,
}

impl Bench {
    fn new(rig: &RigFile) -> Self {
        let card = Card::new(rig, &[], LINE_NS).unwrap();
        let injector = FaultInjector::new(rig, &[]);
        Self { card, injector, tick: 1000, toggles: true, volts: 2.5 }
    }

    /// One period: to and fro with the bench's volts.
    fn scan(&mut self) -> CardScan {
        self.tick += 1;
        let forth = (self.tick / 300).is_multiple_of(2);
        let volts = if forth { self.volts } else { -self.volts };
        self.card.write([volts, 0.0, 0.0], self.tick, 7);
        if self.toggles {
            self.card.enable_line(1, self.tick, self.tick * TICK_NS);
        }
        self.card.clock(self.tick, self.tick * TICK_NS)
    }

    fn run(&mut self, scans: u64) -> Vec<CardScan> {
        (0..scans).map(|_| self.scan()).collect()
    }

    /// Begins a fault with the next scan; its number.
    fn begin(&mut self, text: &str, ticks: Option<u64>) -> u64 {
        let for_s = ticks.map(|ticks| ticks as f64 * 0.5e-3);
        let fault = Fault::parse(text, None, for_s, self.injector.rig()).unwrap();
        let (injection, plant) = self.injector.prepare(&fault).unwrap();
        assert!(self.card.begin_fault(&injection, plant).0, "{text}");
        injection.number
    }

    fn notices(&mut self) -> Vec<FaultNotice> {
        std::iter::from_fn(|| self.card.fault_notice()).collect()
    }
}

#[test]
fn every_kind_is_read_begun_told_and_cleared_everywhere() {
    for kind in LIST {
        let rig = rig_for(kind);
        for text in everywhere(kind) {
            let fault = Fault::parse(&text, Some("0"), None, &rig).unwrap();
            let size = kind.size.map_or(String::new(), |size| format!("={}", size.default));
            assert_eq!(fault.to_string(), format!("{text}{size}"));
            let filter = FaultFilter::parse(Some(&text), None, &rig).unwrap();
            assert!(filter.means(&fault), "{text}");
            assert!(FaultFilter::parse(None, None, &rig).unwrap().means(&fault));

            let mut bench = Bench::new(&rig);
            bench.run(500);
            let number = bench.begin(&text, None);
            assert!(bench.notices().is_empty(), "it begins with a scan");
            bench.scan();
            let tick = bench.tick;
            assert_eq!(bench.notices(), [FaultNotice { number, tick, over: false }], "{text}");
            bench.run(50);
            bench.card.end_fault(number);
            bench.scan();
            let tick = bench.tick;
            assert_eq!(bench.notices(), [FaultNotice { number, tick, over: true }], "{text}");
            // The motor gets power by two edges of the line.
            let scan = bench.run(4)[3];
            assert!(!bench.card.scan_is_lost());
            assert_eq!((scan.motor_power, scan.dac_v[0].abs()), (1, 2.5), "{text}");
            assert!(bench.card.motion().slave_position_rad.is_finite());
        }
    }
}

#[test]
fn a_fault_for_a_time_ends_at_its_tick() {
    let mut bench = Bench::new(&shipped("hydrostatic"));
    bench.run(20);
    let number = bench.begin("encoder_dropout@slave", Some(40));
    let scans = bench.run(60);
    let absent: Vec<u64> = scans
        .iter()
        .filter(|scan| scan.slave_counts[0] == ABSENT_COUNT)
        .map(|scan| scan.tick)
        .collect();
    assert_eq!(absent, (1021..1061).collect::<Vec<_>>());
    let over = FaultNotice { number, tick: 1061, over: true };
    assert_eq!(bench.notices(), [FaultNotice { number, tick: 1021, over: false }, over]);
}

/// Counts and volts of the scans with a fault in force for a while, and those without it.
fn pair(text: &str, rig: &RigFile, begin: u64, ticks: u64) -> (Vec<CardScan>, Vec<CardScan>) {
    let (mut with, mut without) = (Bench::new(rig), Bench::new(rig));
    let mut faulty = with.run(begin);
    with.begin(text, Some(ticks));
    faulty.extend(with.run(ticks + 300));
    (faulty, without.run(begin + ticks + 300))
}

fn encoders(scan: &CardScan) -> [i64; 2] {
    [scan.master_counts[0], scan.slave_counts[0]]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// A fault of a card's input that comes and goes leaves the readings as continuous as they are
    /// without: counts change by no more than the encoder turned, analog inputs are afterwards
    /// those of a card without it. Only what jumps jumps, by its size.
    #[test]
    fn an_input_that_fails_for_a_while_reads_on_without_a_jump(
        which in 0usize..64,
        begin in 1u64..900,
        ticks in 1u64..400,
    ) {
        let rig = shipped("hydrostatic");
        let inputs: Vec<String> = LIST
            .iter()
            .filter(|kind| kind.acts == Acts::CardInput && kind.action != Action::FifoOverflow)
            .flat_map(everywhere)
            .collect();
        let text = &inputs[which % inputs.len()];
        let (faulty, whole) = pair(text, &rig, begin, ticks);
        let jumps = text.starts_with("encoder_jump");
        let (mut last, mut before) = (encoders(&faulty[0]), encoders(&whole[0]));
        for (at, (scan, true_scan)) in faulty.iter().zip(&whole).enumerate() {
            let (now, truth) = (encoders(scan), encoders(true_scan));
            for (side, name) in ["master", "slave"].into_iter().enumerate() {
                if now[side] == ABSENT_COUNT {
                    continue;
                }
                let (step, turned) = (now[side] - last[side], truth[side] - before[side]);
                let jump = jumps && at as u64 == begin && text.ends_with(name);
                let expected = if jump { 1000 } else { 0 };
                // After a drop-out the counts go on from the last that was read.
                prop_assert!(
                    (step - expected).abs() <= turned.abs(),
                    "{text}, scan {at}: {step} counts of {turned}"
                );
                last[side] = now[side];
            }
            before = truth;
            let in_force = (begin..begin + ticks).contains(&(at as u64));
            if !in_force {
                prop_assert_eq!(scan.analog_v, true_scan.analog_v, "{}, scan {}", text, at);
                prop_assert_eq!(scan.motor_v, true_scan.motor_v);
            }
        }
    }

    /// Whatever is asked for is read or refused with words, never a panic.
    #[test]
    fn any_text_is_read_or_refused(text in "[a-z_]{0,16}(@[a-z0-9]{0,6})?(=[-0-9.e]{0,6})?",
        which in 0usize..64, for_s in proptest::option::of(any::<f64>())) {
        let rig = shipped("hydrostatic");
        for text in [text.clone(), format!("{}{text}", LIST[which % LIST.len()].name)] {
            if let Err(error) = Fault::parse(&text, None, for_s, &rig) {
                prop_assert!(error.to_string().len() > 10);
            }
        }
    }
}

#[test]
fn each_input_reads_what_its_fault_says() {
    let rig = shipped("hydrostatic");
    let during = |text: &str| {
        let (faulty, whole) = pair(text, &rig, 700, 100);
        (faulty[699..800].to_vec(), whole[699..800].to_vec())
    };
    let (stuck, _) = during("encoder_stuck@master");
    assert!(stuck.iter().all(|scan| scan.master_counts[0] == stuck[0].master_counts[0]));
    let (reversed, whole) = during("encoder_reversed@slave");
    for (scan, truth) in reversed.iter().zip(&whole) {
        let turned = truth.slave_counts[0] - whole[0].slave_counts[0];
        assert_eq!(scan.slave_counts[0] - reversed[0].slave_counts[0], -turned);
    }
    let (jumped, whole) = during("encoder_jump@master=-77");
    assert!(
        jumped[1..]
            .iter()
            .zip(&whole[1..])
            .all(|(scan, truth)| { scan.master_counts[0] == truth.master_counts[0] - 77 })
    );
    for (text, volts) in [("adc_rail@torque=-1", -10.0), ("adc_rail@emg_2", 5.0)] {
        let (railed, _) = during(text);
        let channel = if text.contains("emg") { 2 } else { 0 };
        assert!(railed[1..].iter().all(|scan| scan.analog_v[channel] == volts), "{text}");
    }
    let (invalid, _) = during("adc_invalid");
    assert!(invalid[1..].iter().all(|scan| scan.analog_v[0].is_nan()));
    let (held, whole) = during("adc_stuck@emg_1");
    assert!(held[1..].iter().all(|scan| scan.analog_v[1] == held[0].analog_v[1]));
    assert!(whole.iter().any(|scan| scan.analog_v[1] != whole[0].analog_v[1]));
    let trigger = |scans: &[CardScan]| scans.iter().any(|scan| scan.analog_v[7] < 2.0);
    let (lost, whole) = {
        let (faulty, whole) = pair("trigger_lost", &rig, 700, 600);
        (faulty[700..1300].to_vec(), whole[700..1300].to_vec())
    };
    assert!(trigger(&whole) && !trigger(&lost));
}

#[test]
fn a_card_whose_fifo_overflows_counts_what_it_lost() {
    let rig = shipped("hydrostatic");
    let mut daq = LockStepDaq::new(&rig, &[], LINE_NS, true).unwrap();
    daq.advance(10);
    let fault = Fault::parse("fifo_overflow=25", None, None, &rig).unwrap();
    let (injection, _) = FaultInjector::new(&rig, &[]).prepare(&fault).unwrap();
    daq.card().begin_fault(&injection, None);
    daq.advance(60);
    let ticks: Vec<u64> = daq.read_due(0).unwrap().iter().map(|scan| scan.tick).collect();
    assert_eq!(daq.scans_missed(), 25);
    assert_eq!(ticks.len(), 45);
    let gaps = ticks.windows(2).map(|pair| pair[1] - pair[0] - 1);
    assert_eq!(gaps.filter(|gap| *gap > 0).collect::<Vec<_>>(), [25]);
}

/// Neither the gate nor a restart takes a stuck DAC's volts away: the enable line does, and the
/// read-back shows both.
#[test]
fn the_enable_line_drops_a_motor_whose_dac_is_stuck() {
    let mut bench = Bench::new(&shipped("hydrostatic"));
    bench.run(100);
    bench.begin("dac_stuck", None);
    bench.scan();
    let held = bench.scan().dac_v[0];
    assert_eq!(held.abs(), 2.5);
    bench.volts = 0.0;
    for scan in bench.run(50) {
        assert_eq!((scan.dac_v[0], scan.motor_v[0], scan.motor_power), (held, held, 1));
        assert_eq!(bench.card.applied_v()[0], held);
    }
    bench.toggles = false;
    let dropped = bench.run(20);
    for scan in &dropped[10..] {
        assert_eq!((scan.dac_v[0], scan.motor_v[0], scan.motor_power), (held, 0.0, 0));
    }
    assert_eq!(bench.card.applied_v()[0], 0.0);
}

#[test]
fn a_broken_line_drops_the_motor_and_a_stuck_relay_keeps_it() {
    let mut bench = Bench::new(&shipped("hydrostatic"));
    bench.run(100);
    let number = bench.begin("enable_line_broken", None);
    let powered = bench.run(30).iter().filter(|scan| scan.motor_power == 1).count();
    assert_eq!(powered, 10, "the last edge was before, and counts for 5 ms");
    bench.card.end_fault(number);
    assert!(bench.run(10)[9].motor_power == 1);

    bench.begin("relay_stuck", None);
    bench.scan();
    bench.toggles = false;
    assert!(bench.run(100).iter().all(|scan| scan.motor_power == 1 && scan.motor_v[0] != 0.0));
    // One that never closed stays open.
    let mut open = Bench::new(&shipped("hydrostatic"));
    open.toggles = false;
    open.begin("relay_stuck", None);
    assert!(open.run(20).iter().all(|scan| scan.motor_power == 0));
}

#[test]
fn the_drive_fails_behind_the_read_back() {
    let applied = |text: &str| {
        let mut bench = Bench::new(&shipped("hydrostatic"));
        bench.run(20);
        bench.begin(text, None);
        let scan = bench.scan();
        (scan.motor_v[0], bench.card.applied_v()[0])
    };
    assert_eq!(applied("amplifier_dead"), (-2.5, 0.0));
    assert_eq!(applied("amplifier_rail=-10"), (-2.5, -10.0));
    assert_eq!(applied("motor_reversed"), (-2.5, 2.5));
    let mut bench = Bench::new(&shipped("hydrostatic"));
    bench.begin("amplifier_rail", None);
    bench.toggles = false;
    bench.run(20);
    assert_eq!(bench.card.applied_v()[0], 0.0, "its relay is open");
}

#[test]
fn the_newer_of_two_alike_takes_the_place_of_the_other_and_too_many_are_refused() {
    let mut bench = Bench::new(&shipped("hydrostatic"));
    let first = bench.begin("amplifier_rail=3", None);
    bench.scan();
    let second = bench.begin("amplifier_rail=-4", None);
    bench.run(2);
    assert_eq!(bench.card.applied_v()[0], -4.0);
    let over: Vec<u64> =
        bench.notices().iter().filter(|notice| notice.over).map(|it| it.number).collect();
    assert_eq!(over, [first]);
    let others = LIST.iter().filter(|kind| kind.only.is_none()).flat_map(everywhere);
    let (mut begun, mut refused) = (0, 0);
    for text in others.filter(|text| !text.starts_with("amplifier_rail")) {
        let fault = Fault::parse(&text, None, None, bench.injector.rig()).unwrap();
        let (injection, plant) = bench.injector.prepare(&fault).unwrap();
        match bench.card.begin_fault(&injection, plant) {
            (true, _) => begun += 1,
            (false, unused) => {
                refused += 1;
                assert_eq!(unused.is_some(), fault.kind.action.breakdown().is_some());
            }
        }
    }
    assert_eq!(begun, MOST_FAULTS - 1);
    assert!(refused > 0 && second == 2);
}

/// Another change of the machine keeps what has broken in it.
#[test]
fn a_change_of_effects_keeps_a_seized_slave_seized() {
    let mut bench = Bench::new(&shipped("hydrostatic"));
    bench.run(300);
    let number = bench.begin("seized", None);
    bench.run(100);
    let stands = bench.card.motion().slave_position_rad;
    let effects = vec!["coulomb_friction@master=0.1".to_owned()];
    let plant = bench.injector.change_effects(effects).unwrap();
    bench.card.replace_plant(plant);
    bench.run(300);
    assert_eq!(bench.card.motion().slave_position_rad, stands);
    bench.card.end_fault(number);
    bench.run(300);
    assert!((bench.card.motion().slave_position_rad - stands).abs() > 1e-3);
    assert!(bench.injector.change_effects(vec!["rust".to_owned()]).is_err());
    assert_eq!(bench.injector.effects(), ["coulomb_friction@master=0.1"]);
}

#[test]
fn what_the_rig_does_not_have_is_refused_with_words() {
    let hydrostatic = shipped("hydrostatic");
    let cable = shipped("cable");
    let text = hydrostatic.text().replace("[axes.slave]\ncounts_per_turn = 4000\n", "");
    let blind = RigFile::parse(&text, "blind.toml").unwrap();
    let refused = |text: &str, axis: Option<&str>, for_s: Option<f64>, rig: &RigFile| {
        Fault::parse(text, axis, for_s, rig).unwrap_err().to_string()
    };
    for (told, parts) in [
        (refused("gremlins", None, None, &cable), &["gremlins", "encoder_stuck", "seized"][..]),
        (refused("dac_stuck@master", None, None, &cable), &["@master"]),
        (refused("encoder_stuck@line", None, None, &cable), &["line", "master, slave"]),
        (refused("encoder_stuck@slave", None, None, &blind), &["handle", "no slave encoder"]),
        (refused("encoder_stuck=3", None, None, &cable), &["no size", "=3"]),
        (refused("encoder_jump=1.5", None, None, &cable), &["whole number", "1.5", "counts"]),
        (refused("adc_rail=0", None, None, &cable), &["1 or -1", "`0`"]),
        (refused("adc_stuck@emg_1", None, None, &cable), &["emg_1", "torque"]),
        (refused("hose_rupture", None, None, &cable), &["cable", "hydrostatic"]),
        (refused("cable_slip", None, None, &hydrostatic), &["cable", "hydrostatic"]),
        (refused("trigger_lost", None, None, &cable), &["trigger_repetition_s"]),
        (refused("dac_stuck", Some("wrist"), None, &cable), &["wrist", "name or number"]),
        (refused("dac_stuck", None, Some(-1.0), &cable), &["-1 s", "above 0"]),
        (refused("dac_stuck", None, Some(f64::NAN), &cable), &["NaN"]),
        (refused("fifo_overflow=3", None, Some(1.0), &cable), &["size", "leave out the time"]),
        (refused("seized=-1", None, None, &cable), &["from 0", "N·m"]),
    ] {
        for part in parts {
            assert!(told.contains(part), "`{part}` in: {told}");
        }
    }
    let unknown = FaultFilter::parse(Some("gremlins"), None, &cable).unwrap_err();
    assert!(matches!(unknown, FaultError::Unknown { .. }));
    assert!(FaultFilter::parse(Some("encoder_jump=3"), None, &cable).is_err());
    assert!(kind("gremlins").is_none());
}
