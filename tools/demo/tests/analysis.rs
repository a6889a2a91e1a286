//! Recordings of scripted runs give exactly the numbers that were scripted.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{KILL_ACQUISITION_NS, KILL_CONTROL_NS, Script, write};
use demo::analysis::{Analysis, Kill, Percentiles, Trace, analyse};
use demo::{ClosedLoop, IdentifyResult, Naming, Outcome, Run, Summary, page};
use identify::outcome::Verdict;
use ipc_types::{Process, Profile, Sample};
use rig::RigFile;

const KILLS: [Kill; 2] = [
    Kill { process: Process::Control, at_ns: KILL_CONTROL_NS },
    Kill { process: Process::Acquisition, at_ns: KILL_ACQUISITION_NS },
];

fn rig() -> RigFile {
    RigFile::parse(include_str!("../../../launch/rigs/hydrostatic.toml"), "hydrostatic.toml")
        .unwrap()
}

fn run(script: Script) -> Analysis {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run.mcap");
    write(&path, script);
    analyse(Trace::read(&path).unwrap(), &KILLS, &rig()).unwrap()
}

fn close(found: Option<f64>, expected: f64) {
    assert!((found.unwrap() - expected).abs() < 1e-6, "found {found:?}, expected {expected}");
}

#[test]
fn a_run_that_meets_all_requirements() {
    let analysis = run(Script::default());
    let losses = &analysis.losses;
    assert_eq!((losses.samples, losses.samples_lost, losses.samples_missed), (4000, 0, 0));
    assert!(losses.sound && !losses.any(), "{losses:?}");

    let [control, acquisition] = &analysis.outages[..] else { panic!() };
    close(control.trip_ms, 505.5 - 500.3);
    close(control.tripped_ms, 508.35 - 500.3);
    close(control.restart_ms, 600.2 - 500.3);
    close(control.enabled_ms, 800.35 - 500.3);
    close(control.powered_ms, 800.5 - 500.3);
    assert!((control.volts_before - common::volts(500.0)).abs() < 1e-12);
    close(acquisition.trip_ms, 1213.0 - 1200.1);
    close(acquisition.restart_ms, 1300.2 - 1200.1);
    close(acquisition.powered_ms, 1600.5 - 1200.1);

    let rates = &analysis.timing.command_rates;
    assert_eq!(rates.iter().map(|rate| rate.incarnation).collect::<Vec<_>>(), [11, 12]);
    assert!(rates.iter().all(|rate| (rate.hz - 500.0).abs() < 1e-6), "{rates:?}");
    // repeated answers to the last sample before the kill are left out
    let us = Percentiles { p50: 200.0, p99: 200.0, p99_9: 200.0, max: 200.0 };
    assert_eq!(analysis.timing.sample_to_command, us);
    // samples of the second incarnation say 5, its LoopTiming 2
    assert_eq!(analysis.timing.missed_periods[&Process::Acquisition], 1 + 5);
    assert_eq!(analysis.timing.missed_periods[&Process::Control], 0);
    let late = &analysis.timing.wake_late;
    assert_eq!(
        late.by_process[&Process::Acquisition],
        Percentiles { p50: 10.0, p99: 25.0, p99_9: 30.0, max: 90.0 }
    );
    assert_eq!(late.worst, Percentiles { p50: 11.0, p99: 25.0, p99_9: 30.0, max: 90.0 });
    assert_eq!(analysis.timing.profile, Profile::Realtime);
    assert_eq!(Outcome::of(&analysis), Outcome::Kept);
}

#[test]
fn samples_that_never_reached_the_disk_are_lost_not_missed() {
    let analysis = run(Script { lost: (700, 710), ..Script::default() });
    let losses = &analysis.losses;
    assert_eq!((losses.samples, losses.samples_lost, losses.samples_missed), (3990, 10, 0));
    assert_eq!(Outcome::of(&analysis).exit_code(), 3);
    assert!(Outcome::of(&analysis).reasons()[0].contains("10 messages of topic sample"));
}

#[test]
fn a_recording_that_begins_too_late_lost_its_head() {
    let losses = run(Script { lost: (0, 30), ..Script::default() }).losses;
    assert_eq!((losses.samples_lost, losses.samples_missed), (30, 0));
}

#[test]
fn what_the_logger_dropped_at_the_end_is_lost_too() {
    assert_eq!(run(Script { dropped_at_end: 3, ..Script::default() }).losses.samples_lost, 3);
    // a gap in the file that the logger knows of is not counted twice
    let both = Script { dropped_at_end: 10, lost: (700, 710), ..Script::default() };
    assert_eq!(run(both).losses.samples_lost, 10);
}

#[test]
fn ticks_that_the_card_dropped_are_missed_not_lost() {
    // over the restart of acquisition: the FIFO ran over
    let analysis = run(Script { missed: (2401, 2421), ..Script::default() });
    let losses = &analysis.losses;
    assert_eq!((losses.samples, losses.samples_lost, losses.samples_missed), (3980, 0, 20));
    assert_eq!(Outcome::of(&analysis).exit_code(), 3);
}

#[test]
fn a_scan_published_twice_is_no_second_tick() {
    let analysis = run(Script { again: true, missed: (2401, 2403), ..Script::default() });
    assert_eq!(analysis.losses.samples, 3999);
    assert_eq!(analysis.losses.samples_missed, 2);
    assert_eq!(analysis.model.unwrap().time_s.len(), 3998);
}

#[test]
fn voltage_before_the_enable_is_a_failure_or_moves_the_trip() {
    let analysis = run(Script { flicker_ms: 700, ..Script::default() });
    close(analysis.outages[0].trip_ms, 700.5 - 500.3);
    // at the last scan before the enable the motor has volts: it was never safe
    let analysis = run(Script { flicker_ms: 800, ..Script::default() });
    assert_eq!(analysis.outages[0].trip_ms, None);
    let outcome = Outcome::of(&analysis);
    assert_eq!(outcome.exit_code(), 1);
    assert!(outcome.reasons()[0].contains("not at 0 V"), "{outcome:?}");
}

#[test]
fn a_full_disk_loses_data_and_still_has_a_page() {
    let analysis = run(Script { full_at_ms: 900, ..Script::default() });
    let outcome = Outcome::of(&analysis);
    assert_eq!(outcome.exit_code(), 3, "{outcome:?}");
    assert!(outcome.reasons()[0].contains("acquisition killed: the recording ends"), "{outcome:?}");
    let summary = Summary::new(&analysis, None);
    let html = page(&analysis, &summary, &outcome, &kills_alone(), &rig()).unwrap();
    assert!(html.contains("Kill 2: acquisition") && html.contains("The recording ends before"));
}

#[test]
fn a_process_that_stays_dead_is_no_restart() {
    let analysis = run(Script { control_stays_dead: true, ..Script::default() });
    assert_eq!(analysis.outages[0].restart_ms, None);
    assert_eq!(analysis.timing.command_rates.len(), 1);
    assert_eq!(Outcome::of(&analysis).exit_code(), 1);
}

#[test]
fn the_model_is_run_on_the_recorded_volts() {
    let analysis = run(Script::default());
    let model = analysis.model.unwrap();
    assert_eq!(
        model.channels.iter().map(|channel| channel.name).collect::<Vec<_>>(),
        ["master_rad", "slave_rad", "slave_torque_nm"]
    );
    assert_eq!(model.time_s.len(), 4000);
    let master = &model.channels[0];
    // at rest until the volts come at 100 ms, then it moves the way that they push
    assert!(master.declared[..200].iter().all(|position| position.abs() < 1e-9));
    assert!(master.declared[1000] > 0.05, "{}", master.declared[1000]);
    let squares: f64 =
        master.measured.iter().zip(&master.declared).map(|(m, d)| (m - d).powi(2)).sum();
    assert!((master.error - (squares / 4000.0).sqrt()).abs() < 1e-12);
}

#[test]
fn a_machine_that_is_as_declared_leaves_only_its_sensors_resolution() {
    leaves_only_the_resolution(&rig(), 2.0, "coulomb_friction@slave=0.3");
}

#[test]
fn so_do_the_cables() {
    let cable =
        RigFile::parse(include_str!("../../../launch/rigs/cable.toml"), "cable.toml").unwrap();
    leaves_only_the_resolution(&cable, 3.0, "coulomb_friction@slave=0.3");
}

/// Plays a sine of volts on the simulated card, as declared and with an effect of slave friction.
fn leaves_only_the_resolution(rig: &RigFile, peak_v: f64, effect: &str) {
    let mut rig = rig.clone();
    // Volts without feedback drive the handle far: no stop shall end that.
    rig.simulation.end_stops = None;
    let rig = &rig;
    let axis = &rig.axes[0];
    let slave = axis.slave.unwrap();
    let card = |effects: &[String]| {
        let mut card = simulator::Card::new(rig, effects, u64::MAX).unwrap();
        (0..3).for_each(|toggles| card.enable_line(1, toggles, 0));
        let row = |tick: u64| {
            let time_s = tick as f64 * 5e-4;
            card.write([peak_v * (std::f64::consts::TAU * time_s).sin(), 0.0, 0.0], tick, 1);
            let scan = card.clock(1000 + tick, 1 + tick * common::PERIOD_NS);
            Sample {
                tick: scan.tick,
                master_present: 1,
                master_position: [axis.master.position(scan.master_counts[0]), 0.0, 0.0],
                slave_present: 1,
                slave_position: [slave.position(scan.slave_counts[0]), 0.0, 0.0],
                torque_present: 1,
                slave_torque: [scan.analog_v[0] / 0.5, 0.0, 0.0],
                motor_v: scan.motor_v,
                ..Default::default()
            }
        };
        let rows: Vec<_> = (0..8000).map(row).collect();
        demo::analysis::model(&rows, rig).unwrap().unwrap().errors()
    };
    let declared = card(&[]);
    // a count of the hydrostatic rig is 1.6 mrad; the torque cell has 2 mV of noise at 0.5 V/N·m,
    // and its bandwidth
    assert!(declared["master_rad"] < 1.6e-3 && declared["slave_rad"] < 1.6e-3, "{declared:?}");
    assert!(declared["slave_torque_nm"] < 0.05, "{declared:?}");
    let other = card(&[effect.to_owned()]);
    assert!(other["slave_rad"] > 10.0 * declared["slave_rad"], "{other:?}");
}

#[test]
fn trips_that_no_kill_explains_are_named() {
    assert_eq!(run(Script::default()).unprovoked, []);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run.mcap");
    write(&path, Script::default());
    let analysis = analyse(Trace::read(&path).unwrap(), &KILLS[..1], &rig()).unwrap();
    let [trip] = analysis.unprovoked[..] else { panic!("{:?}", analysis.unprovoked) };
    assert_eq!((trip.time_ns, trip.cause), (common::BEGIN_NS + 1_208_350_000, 4));
    let spans_ns = demo::analysis::unpowered_spans(&analysis.trace.tokens);
    let us = |time_ns: u64| (time_ns - common::BEGIN_NS) / 1000;
    let spans: Vec<_> = spans_ns.iter().map(|(from, until)| (us(*from), us(*until))).collect();
    assert_eq!(spans, [(508_350, 800_350), (1_208_350, 1_600_350)]);
}

/// A demo whose loop was not closed.
fn kills_alone() -> Run {
    Run {
        kills: Vec::new(),
        hidden: None,
        identified: IdentifyResult::Skipped,
        closed_loop: ClosedLoop::Skipped,
    }
}

#[test]
fn summary_and_page_are_complete() {
    let analysis = run(Script::default());
    let summary = Summary::new(&analysis, Some("backlash@slave=0.01"));
    let json = serde_json::to_value(&summary).unwrap();
    let keys = [
        "revision",
        "profile",
        "injected",
        "samples",
        "samples_lost",
        "samples_missed",
        "command_hz",
        "missed_periods",
        "wake_late_us",
        "cycle_us",
        "sample_to_command_us",
        "trip_ms",
        "restart_ms",
        "recording_bytes",
        "model_error",
        "identify",
        "closed_loop",
        "identify_refused",
    ];
    let found: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
    let mut expected = keys.to_vec();
    expected.sort_unstable();
    let mut sorted = found.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, expected);
    assert_eq!(json["revision"], "0123abcd");
    assert_eq!(json["profile"], "realtime");
    assert_eq!(json["trip_ms"].as_array().unwrap().len(), 2);
    assert_eq!(json["wake_late_us"]["by_process"]["acquisition"]["max"], 90.0);
    assert_eq!(json["wake_late_us"]["p99_9"], 30.0);
    assert!(json["identify"].is_null() && json["identify_refused"].is_null());
    assert!(json["model_error"]["slave_rad"].as_f64().unwrap() > 0.0);

    let html = page(&analysis, &summary, &Outcome::of(&analysis), &kills_alone(), &rig()).unwrap();
    assert!(!html.contains("What the declared model lacks"));
    // overview, three a kill, three channels
    assert_eq!(html.matches("<svg").count(), 1 + 2 * 3 + 3);
    assert!(
        html.contains("The control process was killed")
            && html.contains("The acquisition process was killed")
    );
    assert!(html.contains("backlash@slave=0.01"));
}

#[test]
fn a_recording_without_samples_says_so() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run.mcap");
    let writer =
        recording::mcap_write::Writer::create(&path, &recording::mcap_write::Start::default(), 1)
            .unwrap();
    writer.finish(&[]).unwrap();
    let error = Trace::read(&path).unwrap_err();
    assert!(error.to_string().contains("expected samples of acquisition"), "{error}");
}

#[test]
fn a_recording_that_identify_cannot_use_is_no_reason_to_have_no_page() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run.mcap");
    let writer =
        recording::mcap_write::Writer::create(&path, &recording::mcap_write::Start::default(), 1)
            .unwrap();
    writer.finish(&[]).unwrap();
    let identify_result = IdentifyResult::of(&path, &rig());
    assert!(
        matches!(&identify_result, IdentifyResult::Failed(reason) if reason.contains("run.mcap")),
        "{identify_result:?}"
    );
    assert_eq!(identify_result.value(), None);
}

#[test]
fn a_loop_that_was_not_closed_says_why() {
    let analysis = run(Script::default());
    let summary = Summary::new(&analysis, None);
    let closed_loop = ClosedLoop::Failed("the gains have no margin".to_owned());
    let run = Run { closed_loop, ..kills_alone() };
    let summary = summary.with_closed_loop(&run.closed_loop, None);
    assert!(summary.closed_loop.is_none());
    let html = page(&analysis, &summary, &Outcome::of(&analysis), &run, &rig()).unwrap();
    assert!(html.contains("The loop could not be closed: the gains have no margin."));
}

#[test]
fn a_name_is_judged_by_what_was_hidden() {
    let hidden = Some("backlash@slave=0.05");
    let of = |named: &[(&str, &str)], rivals: &[(&str, &str)], verdict| {
        Naming::judge(
            &named.iter().map(|(id, site)| format!("{id}@{site}")).collect::<Vec<_>>(),
            &rivals.iter().map(|(id, site)| format!("{id}@{site}")).collect::<Vec<_>>(),
            (verdict, verdict != Verdict::None),
            hidden,
        )
    };
    let backlash = ("backlash", "slave");
    assert_eq!(of(&[backlash], &[], Verdict::Effect), Naming::Right);
    assert_eq!(of(&[backlash], &[("leakage", "line")], Verdict::Ambiguous), Naming::Ambiguous);
    assert_eq!(of(&[("leakage", "line")], &[backlash], Verdict::Ambiguous), Naming::Ambiguous);
    assert_eq!(of(&[("leakage", "line")], &[], Verdict::Effect), Naming::Wrong);
    assert_eq!(of(&[backlash, ("leakage", "line")], &[], Verdict::Effect), Naming::Wrong);
    assert_eq!(of(&[], &[], Verdict::Unlisted), Naming::Unlisted);
    assert_eq!(of(&[], &[], Verdict::None), Naming::WithinTolerances);
    assert_eq!(Naming::judge(&[], &[], (Verdict::None, false), None), Naming::Right);
    assert_eq!(Naming::judge(&[], &[], (Verdict::Unlisted, true), None), Naming::Wrong);
}
