//! A laboratory's folder of recordings, made by the lock-step rig: the trend finds the recording
//! from which a parameter is another one, and no change where there is none.
//!
//! `TREND=/tmp/trend cargo test -p identify --test trend` keeps the folders, to look at pages.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use identify::study::StudyOptions;
use identify::trend::assembly;
use identify::trend::fits::{Fitting, fit_all};
use identify::trend::folder::recordings;
use identify::trend::quantity::Movement;
use identify::trend::result::{Standing, Trend, Verdict};
use ipc_types::SAMPLE;
use lock_step::{Aim, LockStepRig};
use recording::mcap_write::{Start, Writer, key};
use rig::{HandKind, RigFile};

/// Number of recordings.
const COUNT: usize = 12;
/// Length of a recording (s).
const LENGTH_S: f64 = 13.0;
/// 2026-03-03 09:30 (UTC), in ns since 1970.
const FIRST_NS: i64 = 1_772_530_200_000_000_000;
const DAY_NS: i64 = 86_400_000_000_000;

fn rig() -> RigFile {
    RigFile::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml"))
        .unwrap()
}

/// The movement: slow and quick sines.
fn aim(t: f64) -> Aim {
    let rise = (t / 0.5).min(1.0);
    let mut aim = Aim::at_rest(0.0);
    for (size, hz, phase) in [(0.45, 0.6, 0.7), (0.25, 1.7, 1.4), (0.06, 5.3, 0.0)] {
        let (w, angle) = (TAU * hz, TAU * hz * t + phase);
        aim.position += rise * size * angle.sin();
        aim.velocity += rise * size * w * angle.cos();
        aim.acceleration -= rise * size * w * w * angle.sin();
    }
    aim.peak_speed = 3.0;
    aim
}

/// Writes the recording of a day; `of_plant` changes the machine, of which the rig file in the
/// recording knows nothing.
fn record(path: &Path, day: usize, of_plant: &[(&str, f64)]) {
    let declared = rig();
    let mut machine = declared.clone();
    machine.simulation.seed = 100 + day as u64;
    machine.simulation.hand.kind = HandKind::Moving;
    machine.simulation.hand.stiffness = 2.0;
    machine.simulation.hand.frequency_hz = 0.9;
    for (name, factor) in of_plant {
        let parameters = &mut machine.model.parameters;
        parameters.iter_mut().find(|own| own.name == *name).unwrap().value *= factor;
    }
    let mut system = LockStepRig::new(&machine, &[]).unwrap();
    let start =
        Start { realtime_offset_ns: FIRST_NS + 3 * DAY_NS * day as i64, ..Start::default() }
            .with(key::RIG, &declared.name)
            .with(key::RIG_FILE, declared.text());
    let mut writer = Writer::create(path, &start, 0).unwrap();
    let mut sequence = 0;
    while system.time_s() < LENGTH_S {
        let setpoint = system.setpoint(&aim(system.time_s()));
        let mut samples = Vec::new();
        system.cycle_seeing(Some(&setpoint), true, &mut |sample| samples.push(*sample)).unwrap();
        for mut sample in samples {
            let at_ns = sample.scan_time_ns;
            ipc_types::Message::stamp(&mut sample, 1, 2, sequence, at_ns);
            sequence += 1;
            writer.write_message(&SAMPLE, &sample).unwrap();
            writer.tick(at_ns).unwrap();
        }
    }
    writer.finish(&[]).unwrap();
}

/// A folder of recordings, a parameter of whose machine has another value from one recording on.
/// Their names are not in the order in which they were made.
fn folder(name: &str, from: usize, of_plant: &[(&str, f64)]) -> (tempfile::TempDir, PathBuf) {
    let temporary = tempfile::tempdir().unwrap();
    let kept = std::env::var_os("TREND").map(PathBuf::from);
    let folder = kept.map_or_else(|| temporary.path().to_owned(), |kept| kept.join(name));
    std::fs::create_dir_all(&folder).unwrap();
    for day in 0..COUNT {
        let number = (day + 5) % COUNT;
        let path = folder.join(format!("run-{number}.mcap"));
        if path.exists() {
            std::fs::remove_file(&path).unwrap();
        }
        record(&path, day, if day < from { &[] } else { of_plant });
    }
    (temporary, folder)
}

fn trend(folder: &Path) -> Trend {
    let rig = rig();
    let reading = recording::record::Options { even_out: true, ..Default::default() };
    let fitting = Fitting { reading, how: StudyOptions::default(), effects: false };
    let paths = recordings(folder).unwrap();
    let (fits, left_out) = fit_all(&rig, &paths, &fitting, &mut |_| {}).unwrap();
    let trend = assembly::trend(&rig.axis_model(&rig.axes[0]), &fits, left_out);
    println!("{}", trend.sentence);
    trend.details.iter().for_each(|detail| println!("  {detail}"));
    for parameter in &trend.parameters {
        println!(
            "  {:36} {:?} {:?} told {} mean {:?} scatter {:?}",
            parameter.name,
            parameter.movement,
            parameter.standing,
            parameter.told.len(),
            parameter.mean,
            parameter.overdispersion
        );
    }
    println!("error ratio {:?} since {}", trend.error_ratio, trend.since_last_change);
    let seconds: f64 = fits.iter().map(|fit| fit.seconds).sum();
    println!("{:.2} s a recording", seconds / fits.len() as f64);
    trend
}

#[test]
fn a_step_is_found_at_its_recording_and_nowhere_else() {
    let from = 7;
    let (_temporary, folder) = folder("step", from, &[("motor_coulomb_nm", 1.18)]);
    // Neither a file that is torn at its beginning nor another machine's is fatal.
    std::fs::write(folder.join("torn.mcap"), b"\x89MCAP0\r\n").unwrap();
    let trend = trend(&folder);
    assert_eq!(trend.verdict, Verdict::Changed);
    assert_eq!(trend.recordings.len(), COUNT);
    // In the order in which they were made.
    assert_eq!(trend.recordings[0].file, "run-5.mcap");
    assert_eq!(trend.recordings[from].file, "run-0.mcap");
    assert_eq!(trend.left_out.len(), 1);
    assert_eq!(trend.left_out[0].file, "torn.mcap");
    let changed: Vec<&str> = trend
        .parameters
        .iter()
        .filter(|own| own.has_changed())
        .map(|own| own.name.as_str())
        .collect();
    assert_eq!(changed, ["motor_coulomb_nm"]);
    let own = trend.parameters.iter().find(|own| own.name == "motor_coulomb_nm").unwrap();
    assert_eq!(own.movement, Movement::Steps);
    let [change] = &own.changes[..] else { panic!("{:?}", own.changes) };
    assert_eq!((change.after.as_str(), change.since.as_str()), ("run-11.mcap", "run-0.mcap"));
    assert_eq!(change.between, Some(["2026-03-21".to_owned(), "2026-03-24".to_owned()]));
    let share = change.to.value / change.from.value;
    assert!((share - 1.18).abs() < 0.04, "{change:?}");
    assert_eq!(trend.since_last_change, COUNT - from);
    assert!(trend.error_ratio.unwrap() > 1.5, "{:?}", trend.error_ratio);
}

#[test]
fn a_machine_that_stays_the_same_is_that_of_the_rig_file() {
    let (_temporary, folder) = folder("same", COUNT, &[]);
    let trend = trend(&folder);
    assert_eq!(trend.verdict, Verdict::Same, "{:?}", trend.details);
    assert!(trend.parameters.iter().all(|own| !own.has_changed()));
    assert!(trend.parameters.iter().any(|own| own.standing == Standing::Agrees));
    assert!(trend.error_ratio.unwrap() < 1.2, "{:?}", trend.error_ratio);
    assert!(trend.sentence.contains("is that of the rig file"), "{}", trend.sentence);
}
