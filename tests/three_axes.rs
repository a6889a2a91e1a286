//! Three axes at 1 kHz with the real processes: a protocol moves all of them at once, and nothing
//! is lost. Latencies are printed but not asserted, since a loaded host determines them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;
use std::process::Stdio;

use demo::analysis::Percentiles;
use ipc_types::{
    AXES, COMMAND, GateState, LoopTiming, Mode, MotorCommand, Process, SAMPLE, Sample, timing_topic,
};
use recording::mcap_read::Recording;

use common::{TestRig, told};

const PROTOCOL: &str = r#"[protocol]
name = "together"

[[segments]]
kind = "guided_sine"
axes = [0, 1, 2]
phases_deg = [0.0, 120.0, 240.0]
amplitude_deg = 20.0
frequency_hz = 0.5
duration_s = 5.0
fade_in_s = 1.0
"#;
const AMPLITUDE_DEG: f64 = 20.0;

/// Powers up and plays to the end. On a loaded host a best-effort rig may trip, rightly; the test
/// then starts again.
fn play(rig: &TestRig, protocol: &str) {
    let mut last = String::new();
    for attempt in 1..=20 {
        rig.power_up();
        let mut command = rig.farreach(["run", protocol]);
        let output = command.stdout(Stdio::piped()).stderr(Stdio::piped()).output().unwrap();
        if output.status.success() {
            println!("attempt {attempt}: {}", String::from_utf8_lossy(&output.stdout).trim());
            return;
        }
        last = told(&output);
        assert!(
            last.contains("watchdog is tripped") || last.contains("the rig is tripped"),
            "{last}"
        );
    }
    panic!("never played to its end: {last}");
}

#[test]
fn three_axes_move_together_and_nothing_is_lost() {
    let rig = TestRig::patient("axes");
    let (file, protocol) = (rig.path("run.mcap"), rig.path("together.toml"));
    std::fs::write(&protocol, PROTOCOL).unwrap();
    let file = file.to_str().unwrap();
    rig.ok(["up", "--simulate", "--rig", &rig.absolute_rig("three-axis"), "--record", file]);
    play(&rig, protocol.to_str().unwrap());
    rig.down();

    let verified = rig.run(["rec", "verify", file]);
    assert_eq!(verified.status.code(), Some(0), "{}", told(&verified));
    let recording = Recording::open(Path::new(file)).unwrap();
    let samples: Vec<Sample> = recording
        .messages::<Sample>(SAMPLE.topic.name)
        .unwrap()
        .map(|sample| sample.unwrap().message)
        .collect();
    let lost: u64 = samples
        .windows(2)
        .map(|pair| (pair[1].sequence - pair[0].sequence - 1) + (pair[1].tick - pair[0].tick - 1))
        .sum();
    assert_eq!((lost, samples[samples.len() - 1].scans_missed), (0, 0));
    assert!(samples.iter().all(|sample| (
        sample.axes,
        sample.master_present,
        sample.torque_present
    ) == (3, 7, 7)));

    let commands: Vec<MotorCommand> = recording
        .messages::<MotorCommand>(COMMAND.topic.name)
        .unwrap()
        .map(|command| command.unwrap().message)
        .collect();
    let ends = [&samples[0], &samples[samples.len() - 1]].map(|sample| sample.tick);
    println!("{} samples, {} commands, ticks {ends:?}", samples.len(), commands.len());
    for axis in 0..AXES {
        let open = samples.iter().filter(|sample| sample.gate_state == GateState::Open.code());
        let reached = |of: fn(&Sample) -> [f64; AXES]| {
            let values = open.clone().map(|sample| of(sample)[axis].to_degrees());
            (values.clone().fold(f64::MAX, f64::min), values.fold(f64::MIN, f64::max))
        };
        let (master, slave) =
            (reached(|sample| sample.master_position), reached(|sample| sample.slave_position));
        println!(
            "axis {axis}: motor {:.1}° to {:.1}°, handle {:.1}° to {:.1}°",
            master.0, master.1, slave.0, slave.1
        );
        assert!(
            master.0 < -0.7 * AMPLITUDE_DEG && master.1 > 0.7 * AMPLITUDE_DEG,
            "axis {axis}: {master:?}"
        );
        assert!(slave.1 - slave.0 > 0.7 * AMPLITUDE_DEG, "axis {axis}: {slave:?}");
        assert!(samples.iter().any(|sample| sample.output_v[axis].abs() > 0.5));
    }
    assert!(
        commands.iter().any(|command| command.mode == Mode::Position.code() && command.axes == 3)
    );

    let answers: Vec<u64> = commands
        .windows(2)
        .filter(|pair| pair[1].sample_tick != pair[0].sample_tick && pair[1].sample_time_ns > 0)
        .map(|pair| pair[1].time_ns.saturating_sub(pair[1].sample_time_ns))
        .collect();
    let answers = Percentiles::of_ns(answers).unwrap();
    println!(
        "sample to command: p50 {:.0} µs, p99 {:.0} µs, most {:.0} µs",
        answers.p50, answers.p99, answers.max
    );
    for &process in Process::ALL {
        let Some(topic) = timing_topic(process) else { continue };
        let timings = recording.messages::<LoopTiming>(topic.topic.name).unwrap();
        let missed =
            timings.flatten().map(|timing| timing.message.missed_periods).max().unwrap_or_default();
        println!("{process}: {missed} missed periods");
    }
}
