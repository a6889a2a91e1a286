//! Mistakes of users and failures of machines, through the real command line: a clear error that
//! says where, what was expected and what was found; nothing left running, nothing half-written,
//! shared memory clean.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::fmt::Write as _;
use std::path::Path;
use std::process::Output;
use std::time::Duration;

use ipc_types::{Message, SAMPLE, Sample};
use recording::mcap_read::Recording;
use recording::mcap_write::{Start, Writer};
use serde_json::Value;

use common::{TestRig, assert_refused, told, wait_for};

const RIG: &str = include_str!("../launch/rigs/hydrostatic.toml");

/// A wrong file is a failure (exit code 1), not wrong usage (2).
const WRONG_FILE: i32 = 1;

/// One edit of the shipped rig: text, and the line of the edit.
fn edited(from: &str, to: &str) -> (String, usize) {
    assert_eq!(RIG.matches(from).count(), 1, "the edit must hit one place: {from}");
    let line = RIG[..RIG.find(from).unwrap()].matches('\n').count() + 1;
    (RIG.replace(from, to), line)
}

/// Edits of the shipped rig that make it invalid: name, old text, new text, lines from the edit to
/// the reported line, and parts of the error.
type WrongEdit = (&'static str, &'static str, &'static str, usize, &'static [&'static str]);
const WRONG_EDITS: &[WrongEdit] = &[
    (
        "an unknown key",
        "seed = 1\n",
        "seed = 1\ncolour = 3\n",
        1,
        &["simulation.colour", "expected one of", "found an unknown key"],
    ),
    (
        "a missing channel",
        "channel = 0  ",
        "channel = 9  ",
        0,
        &[
            "axes.0.torque.channel",
            "expected the index of one of [[channels]]",
            "found the missing channel 9",
        ],
    ),
    (
        "limits the wrong way round",
        "position_min_deg = -120.0",
        "position_min_deg = 120.0",
        1,
        &[
            "axes.0.limits.position_max_deg",
            "expected more than",
            "found limits the wrong way round",
        ],
    ),
    (
        "a rate that does not divide",
        "control_hz = 500",
        "control_hz = 600",
        0,
        &["rates.control_hz", "expected a rate that divides", "found 600"],
    ),
    (
        "overlapping phases",
        "watchdog = 350",
        "watchdog = 690",
        0,
        &["phases_us.watchdog", "expected at least 20 µs", "found overlapping phases"],
    ),
    (
        "no TOML",
        "name = \"hydrostatic\"",
        "name = hydrostatic",
        0,
        &["expected valid TOML", "found"],
    ),
];

#[test]
fn wrong_rig_files_are_refused_with_line_and_key_before_anything_starts() {
    let rig = TestRig::patient("file");
    for (what, from, to, further, parts) in WRONG_EDITS {
        let (text, line) = edited(from, to);
        let path = rig.path("bench.toml");
        std::fs::write(&path, text).unwrap();
        let place = format!("bench.toml:{}: ", line + further);
        let parts: Vec<&str> = parts.iter().copied().chain([place.as_str()]).collect();
        let record = rig.path("run.mcap");
        let output = rig
            .farreach(["up", "--simulate", "--rig"])
            .arg(&path)
            .arg("--record")
            .arg(&record)
            .output()
            .unwrap();
        eprintln!("{what}: {}", String::from_utf8_lossy(&output.stderr));
        assert_refused(&rig, &output, WRONG_FILE, &parts);
        assert!(!record.exists(), "{what}: a recording was begun");
    }
    let output = rig.run(["up", "--simulate", "--rig", "/nowhere/bench.toml"]);
    assert_refused(
        &rig,
        &output,
        WRONG_FILE,
        &["/nowhere/bench.toml", "cannot be read", "No such file"],
    );
    let output = rig.run(["up", "--simulate", "--effect", "gremlins"]);
    assert_refused(&rig, &output, WRONG_FILE, &["gremlins"]);
    let output = rig.run(["up"]);
    assert_refused(&rig, &output, 2, &["--simulate", "--replay"]);
}

/// A valid record of 8 s at 2 kHz, except for what `edit` does to a row (from 0).
fn record(edit: impl Fn(usize, &mut Vec<String>)) -> String {
    let mut text = "t_s,master_rad,motor_v\n".to_owned();
    for row in 0..16_000 {
        let t = row as f64 * 5e-4;
        let mut cells = vec![
            format!("{t:.4}"),
            format!("{:.6}", 0.5 * (6.0 * t).sin()),
            format!("{:.5}", (6.0 * t).cos()),
        ];
        edit(row, &mut cells);
        if !cells.is_empty() {
            writeln!(text, "{}", cells.join(",")).unwrap();
        }
    }
    text
}

/// The same with one cell replaced.
fn with_cell(at: usize, column: usize, to: &'static str) -> String {
    record(move |row, cells| {
        if row == at {
            cells[column] = to.to_owned();
        }
    })
}

/// Invalid tables: name, text, and parts of the error.
fn unusable_tables() -> Vec<(&'static str, String, Vec<&'static str>)> {
    vec![
        (
            "NaN",
            with_cell(1000, 2, "NaN"),
            vec!["row 1002", "column `motor_v`", "expected a finite number", "found `NaN`"],
        ),
        (
            "text",
            with_cell(7, 1, "off"),
            vec!["row 9", "column `master_rad`", "expected a finite number", "found `off`"],
        ),
        (
            "a hole",
            with_cell(7, 1, ""),
            vec!["row 9", "column `master_rad`", "found an empty cell"],
        ),
        (
            "a gap",
            record(|row, cells| {
                if (500..600).contains(&row) {
                    cells.clear();
                }
            }),
            vec!["row 502", "column `t_s`", "100 samples are missing", "0.2495 s", "0.3 s"],
        ),
        (
            "time running backwards",
            with_cell(2000, 0, "0.5"),
            vec!["row 2002", "column `t_s`", "expected a time after 0.9995 s", "found 0.5 s"],
        ),
        (
            "another width",
            record(|row, cells| {
                if row == 11 {
                    cells.pop();
                }
            }),
            vec!["row 13", "expected 3 cells", "found 2"],
        ),
        (
            "no header",
            "0,1,2\n0.1,1,2\n".to_owned(),
            vec!["row 1", "expected a header", "found the number 0"],
        ),
        ("no time", "a,b\n1,2\n".to_owned(), vec!["column `t_s` is missing", "found a, b"]),
        ("nothing", String::new(), vec!["row 1", "expected a header", "found an empty file"]),
        (
            "a header only",
            "t_s,master_rad,motor_v\n".to_owned(),
            vec!["expected at least 10 rows", "found 0"],
        ),
        (
            "another rate",
            record(|row, cells| {
                if row % 2 == 1 {
                    cells.clear()
                }
            }),
            vec!["1000.000 Hz", "2000 Hz", "rates.acquisition_hz"],
        ),
        (
            "no position",
            record(|_, cells| {
                cells.remove(1);
            })
            .replace("t_s,master_rad,motor_v", "t_s,motor_v"),
            vec!["no column \"master_rad\"", "the record has: motor_v"],
        ),
    ]
}

#[test]
fn unusable_tables_are_refused_with_row_and_column_before_anything_starts() {
    let rig = TestRig::patient("csv");
    for (what, text, mut parts) in unusable_tables() {
        let path = rig.path("bench.csv");
        std::fs::write(&path, text).unwrap();
        parts.push("bench.csv");
        let out = rig.path("run.mcap");
        let output =
            rig.farreach(["up", "--replay"]).arg(&path).arg("--record").arg(&out).output().unwrap();
        eprintln!("{what}: {}", String::from_utf8_lossy(&output.stderr));
        assert_refused(&rig, &output, WRONG_FILE, &parts);
        assert!(!out.exists(), "{what}: a recording was begun");
    }
    let output = rig.run(["up", "--replay", "/nowhere/bench.csv"]);
    assert_refused(&rig, &output, WRONG_FILE, &["/nowhere/bench.csv", "No such file"]);

    // `identify` uses the same reader; there an invalid record ends with exit code 1.
    let emps = Path::new(env!("CARGO_MANIFEST_DIR")).join("launch/rigs/emps.toml");
    let path = rig.path("drive.csv");
    std::fs::write(&path, with_cell(1000, 2, "NaN").replace("master_rad", "position_m")).unwrap();
    let json = rig.path("out.json");
    let output = rig
        .farreach(["identify", "--rig"])
        .arg(&emps)
        .arg(&path)
        .arg("--json")
        .arg(&json)
        .output()
        .unwrap();
    assert_refused(
        &rig,
        &output,
        1,
        &["drive.csv", "row 1002", "motor_v", "expected a finite number", "NaN"],
    );
    let said = std::fs::read_to_string(&json).unwrap();
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert!(said["verdict"].is_null() && said.get("parameters").is_none(), "a result of bad data");
    assert_eq!(said["refused"]["kind"], "unusable");
}

/// A recording as the logger writes it: `samples` samples at 2 kHz, ended regularly.
fn write_recording(path: &Path, samples: u64) {
    let mut writer = Writer::create(path, &Start::default(), 0).unwrap();
    for index in 0..samples {
        let mut sample = Sample {
            tick: 1000 + index,
            scan_time_ns: (1000 + index) * 500_000,
            axes: 1,
            master_present: 1,
            motor_present: 1,
            ..Sample::default()
        };
        sample.master_position[0] = (index as f64 * 3e-3).sin();
        sample.motor_v[0] = (index as f64 * 3e-3).cos();
        let now = sample.scan_time_ns + 10_000;
        sample.stamp(1, 2, index, now);
        writer.write_message(&SAMPLE, &sample).unwrap();
        writer.tick(now).unwrap();
    }
    writer.finish(&[]).unwrap();
}

#[test]
fn truncated_and_empty_recordings_are_refused_and_can_be_recovered() {
    let rig = TestRig::patient("mcap");
    let whole = rig.path("whole.mcap");
    write_recording(&whole, 8_000);
    let bytes = std::fs::read(&whole).unwrap();
    let replay = |path: &Path| rig.farreach(["up", "--replay"]).arg(path).output().unwrap();

    let empty = rig.path("empty.mcap");
    std::fs::write(&empty, b"").unwrap();
    assert_refused(
        &rig,
        &replay(&empty),
        WRONG_FILE,
        &["empty.mcap", "the file is empty", "expected an MCAP recording"],
    );
    let other = rig.path("other.mcap");
    std::fs::write(&other, "t_s,master_rad\n0,1\n").unwrap();
    assert_refused(
        &rig,
        &replay(&other),
        WRONG_FILE,
        &["other.mcap", "not an MCAP file", "found 74 5f 73"],
    );
    for command in ["info", "verify"] {
        let output = rig.farreach(["rec", command]).arg(&empty).output().unwrap();
        assert_refused(&rig, &output, 1, &["empty.mcap", "the file is empty"]);
    }

    // As after a power cut.
    let torn = rig.path("torn.mcap");
    std::fs::write(&torn, &bytes[..bytes.len() / 2]).unwrap();
    assert_refused(
        &rig,
        &replay(&torn),
        WRONG_FILE,
        &["torn.mcap", "ends", "farreach rec recover"],
    );
    let verified = rig.farreach(["rec", "verify"]).arg(&torn).output().unwrap();
    assert_eq!(verified.status.code(), Some(3), "{}", told(&verified));
    assert!(String::from_utf8_lossy(&verified.stdout).contains("DATA LOST"), "{}", told(&verified));
    let mended = rig.path("mended.mcap");
    // Exit code 3: done, with data loss.
    let recovered =
        rig.farreach(["rec", "recover"]).arg(&torn).arg("-o").arg(&mended).output().unwrap();
    assert_eq!(recovered.status.code(), Some(3), "{}", told(&recovered));
    assert!(Recording::open(&mended).unwrap().tail.complete);
    let output = replay(&mended);
    assert!(output.status.success(), "a recovered recording is replayed: {}", told(&output));
    rig.down();
}

/// Runs a shell script with private mounts; `$FARREACH` is the binary, `$DIRECTORY` the rig's
/// directory.
fn scripted(rig: &TestRig, script: &str) -> Option<Output> {
    let mut command = common::private_mounts()?;
    command
        .args(["sh", "-uc", script])
        .env("FARREACH_RIG_NAME", rig.name().as_str())
        .env("FARREACH", common::farreach().get_program())
        .env("DIRECTORY", rig.path(""));
    Some(command.output().unwrap())
}

#[test]
fn full_or_read_only_shared_memory_is_reported_and_left_as_it_was() {
    let rig = TestRig::patient("shm");
    // Up, then list what is left; the rig's name distinguishes its files from the filler.
    let up = "\"$FARREACH\" up --simulate; code=$?; find /dev/shm -name '*farreach*'; exit $code";
    let cases = [
        (
            "nothing free",
            "mount -t tmpfs -o size=4k tmpfs /dev/shm && head -c 4096 /dev/zero > /dev/shm/filler",
            "full",
        ),
        ("64 KiB", "mount -t tmpfs -o size=64k tmpfs /dev/shm", "full"),
        ("1 MiB", "mount -t tmpfs -o size=1m tmpfs /dev/shm", "full"),
        ("8 MiB", "mount -t tmpfs -o size=8m tmpfs /dev/shm", "full"),
        (
            "8 MiB of 256 MiB left",
            "mount -t tmpfs -o size=256m tmpfs /dev/shm && \
             head -c 248M /dev/zero > /dev/shm/filler",
            "full",
        ),
        ("read only", "mount -t tmpfs -o ro tmpfs /dev/shm", "writable"),
    ];
    for (what, mount, told_as) in cases {
        let Some(output) = scripted(&rig, &format!("{mount} && {{ {up}; }}")) else { return };
        eprintln!("{what}: {}", String::from_utf8_lossy(&output.stderr));
        assert_refused(&rig, &output, 1, &["/dev/shm", told_as]);
    }
}

#[test]
fn a_full_disk_is_reported_and_its_losses_counted_while_the_rig_runs_on() {
    let rig = TestRig::patient("disk");
    let script = r#"
        mkdir "$DIRECTORY/disk" && mount -t tmpfs -o size=2m tmpfs "$DIRECTORY/disk" || exit 90
        "$FARREACH" up --simulate --record "$DIRECTORY/disk/run.mcap" || exit 91
        for look in $(seq 60); do
            "$FARREACH" status --json > "$DIRECTORY/status.json" || exit 92
            grep -q 'the disk is full' "$DIRECTORY/status.json" && break
        done
        # It goes on, and goes on counting.
        "$FARREACH" status --json > "$DIRECTORY/later.json" || exit 93
        "$FARREACH" status > "$DIRECTORY/status.txt" || exit 94
        "$FARREACH" down > "$DIRECTORY/down.txt" || exit 95
        cp "$DIRECTORY"/disk/* "$DIRECTORY/" || exit 96
        ls /dev/shm | grep -F -- "-$FARREACH_RIG_NAME" && echo LEFT
        exit 0
    "#;
    let Some(output) = scripted(&rig, script) else { return };
    assert!(output.status.success(), "{}", told(&output));
    assert!(
        output.stdout.ends_with(b"") && !String::from_utf8_lossy(&output.stdout).contains(".node"),
        "{}",
        told(&output)
    );
    let read = |name: &str| -> Value {
        serde_json::from_slice(&std::fs::read(rig.path(name)).unwrap()).unwrap()
    };
    let (status, later) = (read("status.json"), read("later.json"));
    let error = status["recording"]["error"].as_str().unwrap();
    assert!(error.contains("run.mcap") && error.contains("the disk is full"), "{status:#}");
    let lost = |status: &Value| status["recording"]["lost"].as_u64().unwrap();
    assert!(lost(&later) > lost(&status), "{} then {}", lost(&status), lost(&later));
    let sample =
        later["losses"].as_array().unwrap().iter().find(|loss| loss["topic"] == "sample").unwrap();
    assert!(sample["refused"].as_u64().unwrap() > 0, "{later:#}");
    for process in later["processes"].as_array().unwrap() {
        assert_eq!(
            (&process["state"], &process["restarts"]),
            (&"ready".into(), &0.into()),
            "{later:#}"
        );
    }
    let text = std::fs::read_to_string(rig.path("status.txt")).unwrap();
    assert!(text.contains("the disk is full") && text.contains("sample"), "{text}");

    // Data flushed before are readable from the first sample on, without a gap.
    let path = rig.path("run.mcap");
    let recording = Recording::open(&path).unwrap();
    assert!(!recording.ended_cleanly());
    let samples: Vec<Sample> = recording
        .messages::<Sample>(SAMPLE.topic.name)
        .unwrap()
        .map_while(|sample| Some(sample.ok()?.message))
        .collect();
    let all = recording.check().unwrap().messages();
    println!("{} messages before the disk was full, {} of them samples", all, samples.len());
    assert!(samples.len() > 1000, "{}", samples.len());
    // The reported number of written messages counts what a flush brought to the disk; a chunk
    // completed since then reads back beyond it.
    let written = later["recording"]["written"].as_u64().unwrap();
    assert!(written > 0 && written <= all, "{written} reported as written, {all} read back");
    assert!(samples.iter().zip(0..).all(|(sample, sequence)| sample.sequence == sequence));
    let verified = rig.farreach(["rec", "verify"]).arg(&path).output().unwrap();
    assert_eq!(verified.status.code(), Some(3), "{}", told(&verified));
    let mended = rig.path("mended.mcap");
    let recovered =
        rig.farreach(["rec", "recover"]).arg(&path).arg("-o").arg(&mended).output().unwrap();
    assert_eq!(recovered.status.code(), Some(3), "{}", told(&recovered));
    let kept = Recording::open(&mended).unwrap();
    assert_eq!(
        kept.messages::<Sample>(SAMPLE.topic.name).unwrap().flatten().count(),
        samples.len()
    );
    assert!(
        wait_for(Duration::from_secs(5), || rig.processes().is_empty()),
        "{:?}",
        rig.processes()
    );
}
