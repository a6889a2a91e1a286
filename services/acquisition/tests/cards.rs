//! The cards behind acquisition: conformance, and the conversion of their scans.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use acquisition::homing::Homing;
use acquisition::{CardOptions, Converter, DRIVERS, Driver, ReplayDaq, ReplayError, SimulatedDaq};
use ipc_types::{CARD_OUTPUT, CARD_SCAN, CardKind, CardOutput, CardScan, Process};
use recording::record::Record;
use rig::RigFile;
use runtime::daq::{Daq, Present, Scan};
use runtime::{Keeper, Publisher, RigName, Service, Subscriber};
use simulator::Card;

mod conformance;

use conformance::Bench;

fn rig(name: &str) -> RigFile {
    RigFile::load(format!("{}/../../launch/rigs/{name}.toml", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn record(rows: usize) -> Record {
    let time_s: Vec<f64> = (0..rows).map(|row| row as f64 * 1e-3).collect();
    let column = |f: fn(f64) -> f64| time_s.iter().map(|t| f(*t)).collect::<Vec<f64>>();
    let columns = BTreeMap::from([
        ("position_m".to_owned(), column(|t| 0.1 * (3.0 * t).sin())),
        ("motor_v".to_owned(), column(|t| (7.0 * t).cos() / 3.0)),
    ]);
    Record { name: "made.csv".to_owned(), time_s, columns, sampling_s: 1e-3, findings: Vec::new() }
}

/// A card that takes its time from the caller, opened by its driver.
struct DriverBench<'a> {
    driver: &'a Driver,
    options: CardOptions,
    rig: &'a RigFile,
    service: &'a Service,
    daq: Box<dyn Daq>,
    tick: u64,
}

impl<'a> DriverBench<'a> {
    fn new(driver: &'a Driver, record: &Path, rig: &'a RigFile, service: &'a Service) -> Self {
        let replay = Some(record.to_path_buf());
        let options = CardOptions { kind: driver.kind, replay, looped: true };
        let daq = (driver.open)(&options, rig).unwrap()(service, rig).unwrap();
        Self { driver, options, rig, service, daq, tick: 1000 }
    }
}

impl Bench for DriverBench<'_> {
    fn reset(&mut self) {
        let opened = (self.driver.open)(&self.options, self.rig).unwrap();
        self.daq = opened(self.service, self.rig).unwrap();
        self.tick = 1000;
    }
    fn advance(&mut self, ticks: u64) {
        self.tick += ticks;
    }
    fn now_ns(&self) -> u64 {
        self.tick * self.rig.rates.acquisition_period_ns() + 80_000
    }
    fn daq(&mut self) -> &mut dyn Daq {
        &mut *self.daq
    }
}

/// A record of 5 s at 1 kHz as a file.
fn record_file(directory: &Path) -> PathBuf {
    let record = record(5000);
    let rows = (0..record.len()).map(|row| {
        let [position, volts] = ["position_m", "motor_v"].map(|name| record.columns[name][row]);
        format!("{},{position},{volts}\n", record.time_s[row])
    });
    let path = directory.join("record.csv");
    std::fs::write(&path, format!("t_s,position_m,motor_v\n{}", rows.collect::<String>())).unwrap();
    path
}

#[test]
fn a_record_is_replayed_to_the_last_bit_and_once() {
    let record = record(1200);
    let emps = rig("emps");
    let converter = Converter::new(&emps);
    let mut daq = ReplayDaq::new(&record, &emps, false).unwrap();
    let mut now = 77_000_500_000;
    let mut row = 0;
    while !daq.finished() {
        for scan in daq.read_due(now).unwrap() {
            let sample = converter.convert(scan, Homing::absolute(&emps).zeros());
            assert_eq!(
                sample.master_position[0].to_bits(),
                record.columns["position_m"][row].to_bits()
            );
            assert_eq!(sample.motor_v[0].to_bits(), record.columns["motor_v"][row].to_bits());
            assert_eq!(sample.record_time_s.to_bits(), record.time_s[row].to_bits());
            assert_eq!(
                (sample.master_present, sample.slave_present, sample.torque_present),
                (1, 0, 0)
            );
            row += 1;
        }
        now += 3_700_000;
    }
    assert_eq!(row, 1200);
    assert!(daq.read_due(now + 1_000_000_000).unwrap().is_empty());
}

#[test]
fn a_record_of_another_rate_or_without_position_is_refused() {
    let error = ReplayDaq::new(&record(100), &rig("hydrostatic"), false).unwrap_err();
    assert!(matches!(error, ReplayError::Rate { .. }), "{error}");
    assert!(
        error.to_string().contains("1000.000 Hz") && error.to_string().contains("2000"),
        "{error}"
    );
    let mut nameless = record(100);
    let position = nameless.columns.remove("position_m").unwrap();
    nameless.columns.insert("x".to_owned(), position);
    let error = ReplayDaq::new(&nameless, &rig("emps"), false).unwrap_err();
    assert!(matches!(error, ReplayError::NoPosition { .. }), "{error}");
}

#[test]
fn the_rig_file_says_which_column_is_time() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("record.csv");
    let rows: String = (0..20)
        .map(|row| format!("{},{},0.5\n", f64::from(row) * 1e-3, f64::from(row) * 1e-6))
        .collect();
    std::fs::write(&path, format!("seconds,position_m,motor_v\n{rows}")).unwrap();
    let mut emps = rig("emps");
    let error = ReplayDaq::open(&path, &emps, false).unwrap_err();
    assert!(error.to_string().contains("t_s"), "{error}");
    emps.replay.time = "seconds".to_owned();
    let mut daq = ReplayDaq::open(&path, &emps, false).unwrap();
    let first = daq.read_due(77_000_000_000).unwrap().len();
    assert_eq!(first + daq.read_due(77_100_000_000).unwrap().len(), 20);
}

#[test]
fn counts_and_volts_become_si() {
    let rig = rig("hydrostatic");
    let axis = &rig.axes[0];
    let torque = axis.torque.unwrap();
    let mut scan = Scan {
        tick: 5,
        master_counts: [1000, 0, 0],
        slave_counts: [-500, 0, 0],
        present: Present { master: 1, slave: 1, motor: 1, analog: 0xff },
        ..Scan::default()
    };
    scan.analog_v[torque.channel] = torque.volts(-1.5);
    let sample = Converter::new(&rig).convert(&scan, Homing::absolute(&rig).zeros());
    let quarter = std::f64::consts::FRAC_PI_2;
    assert!((sample.master_position[0] - quarter).abs() < 1e-12);
    assert!((sample.slave_position[0] + quarter / 2.0).abs() < 1e-12);
    assert!((sample.slave_torque[0] + 1.5).abs() < 1e-12);
    scan.present = Present::default();
    let absent = Converter::new(&rig).convert(&scan, Homing::absolute(&rig).zeros());
    assert_eq!((absent.master_present, absent.slave_present, absent.torque_present), (0, 0, 0));
}

/// The simulated card over shared memory, with the card's side driven by the bench.
struct SharedBench {
    daq: Option<SimulatedDaq>,
    card: Card,
    rig: RigFile,
    scans: Publisher<CardScan>,
    outputs: Subscriber<CardOutput>,
    tick: u64,
    service: Service,
}

impl SharedBench {
    fn time(&self) -> u64 {
        self.tick * 500_000
    }

    fn clock(&mut self) {
        self.tick += 1;
        let now = self.time();
        while let Some(output) = self.outputs.take().unwrap() {
            self.card.write(output.volts, output.sequence, output.incarnation);
            self.card.set_digital(output.digital_out);
            self.card.taken(output.taken_tick);
        }
        self.card.enable_line(1, self.tick, now);
        let scan = self.card.clock(self.tick, now);
        self.scans.send(scan).unwrap();
    }
}

impl Bench for SharedBench {
    fn reset(&mut self) {
        // What the reader before did not take stays in the card's FIFO: flush it, as a new session
        // would.
        for _ in 0..2 {
            self.clock();
        }
        let mut daq = SimulatedDaq::new(&self.service, &self.rig).unwrap();
        self.clock();
        let last = daq.read_due(0).unwrap().last().map(|scan| scan.tick);
        daq.taken(last.unwrap());
        daq.write([0.0; 3]).unwrap();
        self.clock();
        self.daq = Some(SimulatedDaq::new(&self.service, &self.rig).unwrap());
        self.clock();
        self.daq().read_due(0).unwrap();
        self.daq().write([0.0; 3]).unwrap();
    }
    fn advance(&mut self, ticks: u64) {
        for _ in 0..ticks {
            self.clock();
        }
    }
    fn now_ns(&self) -> u64 {
        self.time()
    }
    fn daq(&mut self) -> &mut dyn Daq {
        self.daq.as_mut().unwrap()
    }
    fn has_power(&self) -> bool {
        // Its enable line toggles all the time.
        true
    }
}

#[test]
fn every_card_conforms_and_the_simulated_cards_fifo_outlives_its_reader() {
    let text = format!("acq-{}", std::process::id());
    let name: RigName = text.parse().unwrap();
    let keeper = Keeper::start(&name).unwrap();
    let service = Service::start(Process::Acquisition, &text).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let record = record_file(directory.path());
    let emps = rig("emps");
    for driver in DRIVERS {
        let kind = driver.kind;
        if kind.capabilities().real {
            eprintln!("SKIPPED: card {kind} is a real one; run the suite where it is");
        } else if kind != CardKind::Simulated {
            let mut bench = DriverBench::new(driver, &record, &emps, &service);
            assert_eq!(bench.daq().kind(), kind);
            conformance::check(&mut bench).unwrap_or_else(|error| panic!("{kind}: {error}"));
        }
    }
    let rig = rig("hydrostatic");
    let mut bench = SharedBench {
        daq: None,
        card: Card::new(&rig, &[], 5_000_000).unwrap(),
        scans: service.publisher(CARD_SCAN).unwrap(),
        outputs: service.subscriber(CARD_OUTPUT).unwrap(),
        rig,
        tick: 1000,
        service,
    };
    conformance::check(&mut bench).unwrap();

    // a reader dies with scans unread; its successor gets them, and nothing that was published
    // before
    bench.reset();
    bench.advance(10);
    let last = bench.daq().read_due(0).unwrap().last().unwrap().tick;
    bench.daq().taken(last);
    bench.daq().write([0.0; 3]).unwrap();
    bench.advance(100);
    bench.daq = None;
    bench.daq = Some(SimulatedDaq::new(&bench.service, &bench.rig).unwrap());
    bench.advance(1);
    let ticks: Vec<u64> = bench.daq().read_due(0).unwrap().iter().map(|scan| scan.tick).collect();
    assert_eq!(ticks, (last + 1..=bench.tick).collect::<Vec<_>>());
    assert_eq!(bench.daq().scans_missed(), 0);

    drop(bench);
    assert!(keeper.end().unwrap());
    assert!(name.remove().unwrap());
}
