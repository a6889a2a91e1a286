//! BIDS datasets: what is in their files; the validators of BIDS are asked by `.ci/readers`.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::fs;
use std::io::Read;
use std::path::Path;

use common::experiment::{
    FIRST_TICK, FIRST_VOLUME_NS, MISSING, REPETITION_NS, SEGMENTS, TICK_NS, VOLUMES, performance,
    sample, write, write_samples,
};
use common::{Folder, fails, rec};
use recorder::{DATA_LOST, DONE};
use serde_json::Value;

/// Samples from the run's beginning to its end, with those that are missing.
const RUN: usize = 8620;
/// Tick of the first.
const FIRST: u64 = 1180;
const STEM: &str = "sub-S07_task-forcematching_run-1";

fn export(folder: &Folder, more: &[&str]) -> (i32, String) {
    let (run, dataset) = (folder.text("run.mcap"), folder.text("study"));
    let mut words = vec!["export", &run, "--to", "bids", "-o", &dataset];
    words.extend(more);
    rec(&words)
}

fn refused(folder: &Folder, more: &[&str]) -> String {
    let (run, dataset) = (folder.text("run.mcap"), folder.text("study"));
    let mut words = vec!["export", &run, "--to", "bids", "-o", &dataset];
    words.extend(more);
    fails(&words)
}

fn recorded(subject: &str, scan: bool) -> Folder {
    let folder = Folder::new();
    write(&folder.path("run.mcap"), subject, scan);
    folder
}

fn rows(text: &str) -> Vec<Vec<String>> {
    text.lines().map(|line| line.split('\t').map(str::to_owned).collect()).collect()
}

fn table(folder: &Folder, name: &str) -> Vec<Vec<String>> {
    let path = folder.path("study").join(name);
    let bytes = fs::read(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
    let mut text = String::new();
    if name.ends_with(".gz") {
        flate2::read::GzDecoder::new(&bytes[..]).read_to_string(&mut text).unwrap();
    } else {
        text = String::from_utf8(bytes).unwrap();
    }
    rows(&text)
}

fn json(folder: &Folder, name: &str) -> Value {
    let path = folder.path("study").join(name);
    serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap()
}

fn same(cell: &str, value: f64) -> bool {
    cell.parse::<f64>().is_ok_and(|read| read == value)
}

#[test]
fn onsets_are_counted_from_the_first_stored_volume() {
    let folder = recorded("S07", true);
    let (code, text) = export(&folder, &[]);
    assert_eq!(code, DATA_LOST, "samples are missing");
    let expected = format!("{STEM} (func, motion, emg): 8620 samples, 20 MISSING\n");
    assert!(text.ends_with(&expected), "{text}");
    let events = table(&folder, &format!("sub-S07/func/{STEM}_events.tsv"));
    let columns = "onset duration trial_type text session outcome value target a b c";
    assert_eq!(events[0].join(" "), columns);
    let ends = SEGMENTS.iter().skip(1).map(|(_, _, begun_ns)| *begun_ns).chain([4_900_000_001]);
    for ((kind, label, begun_ns), end_ns) in SEGMENTS.into_iter().zip(ends) {
        let row = events.iter().find(|row| row[3] == label).unwrap();
        assert_eq!(row[2], kind);
        let onset = (begun_ns as f64 - FIRST_VOLUME_NS as f64) * 1e-9;
        assert!((row[0].parse::<f64>().unwrap() - onset).abs() < 1e-9, "{row:?}");
        assert!((row[1].parse::<f64>().unwrap() - (end_ns - begun_ns) as f64 * 1e-9).abs() < 1e-9);
        let session = label.starts_with("session");
        let told: Vec<&str> = row[4..8].iter().map(String::as_str).collect();
        let value = (1.0f64 / 7.0).to_string();
        let expected = if session { ["1", "whole", &value, "n/a"] } else { ["n/a"; 4] };
        assert_eq!(told, expected);
    }
    let beat = events.iter().find(|row| row[2] == "beat").unwrap();
    assert!(same(&beat[8], 1.0 / 3.0));
    let note = events.iter().find(|row| row[2] == "note").unwrap();
    assert_eq!(note[3], "'sat up and slept, 5 µV", "no tab or quotation mark");
    let about = json(&folder, &format!("sub-S07/func/{STEM}_events.json"));
    assert!(about["trial_type"]["Levels"]["rhythm"].is_string(), "{about}");
}

#[test]
fn every_row_is_a_tick_and_every_value_the_recorded_one() {
    let folder = recorded("S07", true);
    export(&folder, &[]);
    let name = |suffix: &str| format!("sub-S07/func/{STEM}_recording-{suffix}");
    let physio = table(&folder, &name("handle_physio.tsv.gz"));
    let about = json(&folder, &name("handle_physio.json"));
    let columns = ["handle_torque", "handle_motor", "trigger", "volume"];
    assert_eq!(about["Columns"], serde_json::json!(columns));
    assert_eq!(about["handle_torque"]["Units"], "N·m");
    assert_eq!(about["Farreach"]["Protocol"], "force-matching");
    let motion_stem = "sub-S07/motion/sub-S07_task-forcematching_tracksys-encoders_run-1";
    let motion = table(&folder, &format!("{motion_stem}_motion.tsv"));
    let stim = table(&folder, &name("screen_stim.tsv.gz"));
    let first = FIRST;
    assert_eq!(physio.len(), RUN);
    assert_eq!([motion.len(), stim.len()], [physio.len(), physio.len()]);
    let start_s = about["StartTime"].as_f64().unwrap();
    let expected_s = ((first * TICK_NS) as f64 - FIRST_VOLUME_NS as f64) * 1e-9;
    assert!((start_s - expected_s).abs() < 1e-9, "{start_s}, expected {expected_s}");
    for (row, (physio, motion)) in physio.iter().zip(&motion).enumerate() {
        let tick = first + row as u64;
        if MISSING.contains(&(tick - FIRST_TICK)) {
            assert!(physio[..3].iter().chain(motion).all(|cell| cell == "n/a"));
            continue;
        }
        let of = sample(tick);
        assert!(same(&physio[0], of.slave_torque[0]) && same(&physio[2], of.analog_v[7]));
        let volts = (of.motor_present != 0).then_some(of.motor_v[0]);
        assert!(volts.map_or(physio[1] == "n/a", |volts| same(&physio[1], volts)));
        assert!(same(&motion[0], of.master_position[0]) && same(&motion[1], of.slave_position[0]));
        let since = (tick * TICK_NS).checked_sub(FIRST_VOLUME_NS);
        let volume = since.map(|since| (since / REPETITION_NS).min(VOLUMES - 1));
        assert_eq!(physio[3], volume.map_or("n/a".to_owned(), |volume| volume.to_string()));
        let update = (tick * TICK_NS).checked_sub(2_000_000_000).map(|since| since / 20_000_000);
        let shown = update.map(|update| performance(update.min(99) as u32));
        assert_eq!(stim[row][0], shown.map_or("n/a", |_| "1"));
        match shown.filter(|shown| shown.bars > 0) {
            Some(shown) => assert!(same(&stim[row][2], shown.height[0])),
            None => assert_eq!(stim[row][2], "n/a"),
        }
    }
    let channels = table(&folder, &format!("{motion_stem}_channels.tsv"));
    assert_eq!(channels[1][..5].join(" "), "handle_master n/a JNTANG handle_motor rad");
    let scans = table(&folder, "sub-S07/sub-S07_scans.tsv");
    assert_eq!(scans.len(), 3);
    assert!(scans[1][1].starts_with("2023-11-14T22:13:20.71"), "{scans:?}");
}

/// The header of a BDF file, and the samples of a signal in steps.
fn bdf(bytes: &[u8], signal: usize) -> (String, Vec<i32>) {
    let header: String = bytes[..256].iter().map(|byte| char::from(*byte)).collect();
    let number = |range: std::ops::Range<usize>| header[range].trim().parse::<usize>().unwrap();
    // The first byte is 0xff, two bytes as text.
    let (start, records, signals) = (number(185..193), number(237..245), number(253..257));
    let of_signal = |at: usize| {
        let field = 256 + signals * (16 + 80 + 5 * 8 + 80) + at * 8;
        let text = std::str::from_utf8(&bytes[field..field + 8]).unwrap();
        text.trim().parse::<usize>().unwrap()
    };
    let record: usize = (0..signals).map(of_signal).sum::<usize>() * 3;
    let before: usize = (0..signal).map(of_signal).sum::<usize>() * 3;
    assert_eq!(bytes.len(), start + records * record, "the file is as long as it says");
    let samples = (0..records).flat_map(|at| {
        let begin = start + at * record + before;
        let wide = |three: &[u8]| i32::from_le_bytes([0, three[0], three[1], three[2]]) >> 8;
        bytes[begin..begin + of_signal(signal) * 3].chunks(3).map(wide).collect::<Vec<i32>>()
    });
    (header, samples.collect())
}

#[test]
fn electrodes_are_in_a_bdf_file() {
    let folder = recorded("S07", true);
    export(&folder, &[]);
    let path = folder.path("study").join(format!("sub-S07/emg/{STEM}_emg.bdf"));
    let bytes = fs::read(path).unwrap();
    let (header, steps) = bdf(&bytes, 1);
    assert!(header.contains("BIOSEMIS07 X X X"), "{header}");
    assert!(header.contains("Startdate 14-NOV-2023 X X farreach"), "{header}");
    assert!(header.contains("14.11.2322.13.20"), "{header}");
    // Five seconds begin, filled up with zeros.
    assert_eq!(steps.len(), 5 * 2000);
    // ±5 V at the input, in mV of the muscle for a volt.
    for (row, step) in steps.iter().enumerate().take(RUN) {
        let tick = FIRST + row as u64;
        let value = match MISSING.contains(&(tick - FIRST_TICK)) {
            true => 0.0,
            false => sample(tick).analog_v[2],
        };
        assert!((f64::from(*step) * 5.0 / 8_388_607.0 - value).abs() <= 0.5 * 5.0 / 8_388_607.0);
    }
    assert!(steps[RUN..].iter().all(|step| *step == 0));
    let text = String::from_utf8_lossy(&bytes);
    for note in ["rhythm: session 1 of 4: rhythm", "samples missing", "after the end", "5 µV"] {
        assert!(text.contains(note), "{note}");
    }
    // The events beside the data are counted from its first sample.
    for events in [
        format!("sub-S07/emg/{STEM}_events.tsv"),
        "sub-S07/motion/sub-S07_task-forcematching_tracksys-encoders_run-1_events.tsv".to_owned(),
    ] {
        let rows = table(&folder, &events);
        let begun: Vec<f64> = SEGMENTS
            .iter()
            .map(|(_, label, _)| rows.iter().find(|row| row[3] == *label).unwrap())
            .map(|row| row[0].parse().unwrap())
            .collect();
        for (onset_s, (_, _, begun_ns)) in begun.iter().zip(SEGMENTS) {
            let expected_s = (begun_ns as f64 - (FIRST * TICK_NS) as f64) * 1e-9;
            assert!((onset_s - expected_s).abs() < 1e-9, "{events}: {onset_s}, {expected_s}");
        }
    }
    let channels = table(&folder, &format!("sub-S07/emg/{STEM}_channels.tsv"));
    assert_eq!(channels.len(), 8);
    assert_eq!(channels[7][..3].join(" "), "scanner_trigger TRIG V");
}

#[test]
fn without_a_scan_onsets_are_counted_from_the_first_sample() {
    let folder = recorded("S07", false);
    let (_, text) = export(&folder, &["--task", "pilot", "--session", "2"]);
    assert!(text.contains("sub-S07_ses-2_task-pilot_run-1 (beh, motion, emg)"), "{text}");
    let stem = "sub-S07/ses-2/beh/sub-S07_ses-2_task-pilot_run-1";
    let events = table(&folder, &format!("{stem}_events.tsv"));
    assert_eq!(events[1][..3].join(" "), "0.010000000 0.000000000 protocol_started");
    let about = json(&folder, &format!("{stem}_recording-handle_physio.json"));
    assert_eq!(about["StartTime"], 0.0);
    // An option for scans concerns no run without one.
    let (_, text) = export(&folder, &["--run", "02", "--first-volume", "2"]);
    assert!(text.contains("sub-S07_task-forcematching_run-02 (beh"), "{text}");
}

#[test]
fn dummy_volumes_are_skipped() {
    let folder = recorded("S07", true);
    export(&folder, &["--first-volume", "2"]);
    let events = table(&folder, &format!("sub-S07/func/{STEM}_events.tsv"));
    let onset = (600_000_000.0 - (FIRST_VOLUME_NS + 2 * REPETITION_NS) as f64) * 1e-9;
    assert!((events[1][0].parse::<f64>().unwrap() - onset).abs() < 1e-9);
    let physio = table(&folder, &format!("sub-S07/func/{STEM}_recording-handle_physio.tsv.gz"));
    let last = physio.last().unwrap();
    assert_eq!(last[3], (VOLUMES - 3).to_string(), "stored volumes are numbered from 0");
    assert!(refused(&folder, &["--run", "2", "--first-volume", "9"]).contains("5 volumes were"));
}

#[test]
fn a_dataset_that_cannot_be_completed_stays_as_it_was() {
    let folder = recorded("S07", true);
    let dataset = folder.path("study");
    fs::create_dir_all(dataset.join("sub-S07/emg")).unwrap();
    fs::write(dataset.join("dataset_description.json"), "{}").unwrap();
    fs::write(dataset.join("README"), "ours").unwrap();
    // A file whose contents were not fetched is there all the same.
    let absent = dataset.join(format!("sub-S07/emg/{STEM}_emg.bdf"));
    std::os::unix::fs::symlink("../../.git/annex/none", &absent).unwrap();
    assert!(refused(&folder, &[]).contains("it is there already"));
    fs::remove_file(&absent).unwrap();
    // So is a table that is locked.
    let participants = dataset.join("participants.tsv");
    std::os::unix::fs::symlink(".git/annex/none", &participants).unwrap();
    assert!(refused(&folder, &[]).contains("it is a link"));
    fs::remove_file(&participants).unwrap();
    fs::write(&participants, "age\n33\n").unwrap();
    assert!(refused(&folder, &[]).contains("participant_id"));
    let found: Vec<String> = contents(&dataset).into_iter().map(|(name, _)| name).collect();
    assert_eq!(found.len(), 3, "{found:?}");
    assert!(!dataset.join("sub-S07/func").exists(), "a folder is left");
    // What a killed export left goes with the next one.
    let left = dataset.join(".farreach-killed");
    fs::create_dir(&left).unwrap();
    fs::write(left.join("lock"), "").unwrap();
    fs::write(&participants, "\u{feff}participant_id\n").unwrap();
    export(&folder, &[]);
    assert!(!left.exists());
    assert!(!dataset.join("README.md").exists(), "it has a README");
    assert_eq!(fs::read_to_string(participants).unwrap(), "\u{feff}participant_id\nsub-S07\n");
}

#[test]
fn what_is_missing_at_an_edge_or_on_one_channel_is_told() {
    // The first fifty samples of the run, and the last ten.
    let folder = Folder::new();
    let kept = |tick: &u64| !(FIRST..FIRST + 50).contains(tick) && !(9790..9800).contains(tick);
    let samples = (1000..10_000u64).filter(kept).map(|tick| {
        let mut sample = sample(tick);
        if (3000..4000).contains(&tick) {
            sample.analog_present &= !(1 << 2);
        }
        sample
    });
    write_samples(&folder.path("run.mcap"), "S07", true, samples);
    let (code, text) = export(&folder, &[]);
    assert_eq!(code, DATA_LOST);
    // The sample after the end, of tick 9800, was taken late: it is not of this run.
    assert!(text.contains("8560 samples, 60 MISSING"), "{text}");
    let bdf = folder.path("study").join(format!("sub-S07/emg/{STEM}_emg.bdf"));
    let bytes = fs::read(bdf).unwrap();
    assert!(String::from_utf8_lossy(&bytes).contains("emg_2 not read"));
}

/// Every file of a folder, with its contents.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else {
            found.push((path.to_str().unwrap().to_owned(), fs::read(&path).unwrap()));
        }
    }
    found.sort();
    found
}

#[test]
fn a_dataset_grows_and_nothing_of_it_is_overwritten() {
    let folder = recorded("S07", true);
    export(&folder, &[]);
    let dataset = folder.path("study");
    let participants = dataset.join("participants.tsv");
    fs::write(&participants, "participant_id\tage\nsub-S07\t33\n").unwrap();
    fs::write(dataset.join("README.md"), "our study").unwrap();
    let before = contents(&dataset);
    let error = refused(&folder, &[]);
    assert!(error.contains("it is there already") && error.contains("--run"), "{error}");
    assert_eq!(contents(&dataset), before, "nothing is half written");
    let (_, text) = export(&folder, &["--run", "2"]);
    assert!(text.contains("_run-2 "), "{text}");
    export(&folder, &["--subject", "S-08"]);
    let expected = "participant_id\tage\nsub-S07\t33\nsub-S08\tn/a\n";
    assert_eq!(fs::read_to_string(participants).unwrap(), expected);
    assert_eq!(fs::read_to_string(dataset.join("README.md")).unwrap(), "our study");
    assert_eq!(table(&folder, "sub-S07/sub-S07_scans.tsv").len(), 5);
    for (name, bytes) in before.iter().filter(|(name, _)| !name.ends_with("scans.tsv")) {
        if !name.ends_with("participants.tsv") {
            assert_eq!(&fs::read(name).unwrap(), bytes, "{name}");
        }
    }
}

#[test]
fn what_has_no_label_or_no_dataset_is_refused() {
    let folder = recorded("Jürgen", true);
    let error = refused(&folder, &[]);
    assert!(error.contains("give --subject") && error.contains("'ü'"), "{error}");
    assert!(!folder.path("study").exists());
    assert!(refused(&folder, &["--subject", "S1", "--task", "?"]).contains("--task"));
    let run = folder.text("run.mcap");
    let error = fails(&["export", &run, "--to", "bids", "--subject", "S1", "-o", &run]);
    assert!(error.contains("expected a folder"), "{error}");
    let error = fails(&["export", &run, "--to", "csv", "--first-volume", "1"]);
    assert!(error.contains("--first-volume"), "{error}");
    let error = fails(&["export", &run, "--to", "bids", "--topic", "sample", "-o", &run]);
    assert!(error.contains("--topic"), "{error}");
    let pictures = folder.path("pictures");
    fs::create_dir(&pictures).unwrap();
    fs::write(pictures.join("a.png"), "a").unwrap();
    let error = fails(&[
        "export",
        &run,
        "--to",
        "bids",
        "--subject",
        "S1",
        "-o",
        pictures.to_str().unwrap(),
    ]);
    assert!(error.contains("dataset_description.json"), "{error}");
    let (code, _) = export(&folder, &["--subject", "S1"]);
    assert_ne!(code, DONE);
    // A subject's code that became another label is told.
    let hyphen = recorded("S-9", true);
    let (_, text) = export(&hyphen, &["--run", "none"]);
    assert!(text.contains("subject \"S-9\" is sub-S9 here"), "{text}");
    assert!(text.contains("sub-S9_task-forcematching (func"), "{text}");
    let left: Vec<_> = fs::read_dir(folder.path("")).unwrap().collect();
    assert_eq!(left.len(), 3, "no temporary folder is left: {left:?}");
}
