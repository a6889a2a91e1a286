//! What a dataset says of itself, its subjects and its files.

use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

use anyhow::bail;
use serde_json::json;

use super::names::Names;
use super::run::Run;
use super::staged::Staged;

/// Version of BIDS; EMG came with 1.11.
const BIDS_VERSION: &str = "1.11.1";
const DESCRIPTION: &str = "dataset_description.json";
const NOT_STATED: &str = "Not stated by the rig file: to be completed here";

/// Refuses a folder with files that is no dataset.
pub(super) fn check(folder: &Path) -> anyhow::Result<()> {
    let name = folder.display();
    if folder.exists() && !folder.is_dir() {
        bail!("{name}: expected a folder, found a file");
    }
    let used = folder.read_dir().is_ok_and(|mut entries| entries.next().is_some());
    if used && !folder.join(DESCRIPTION).exists() {
        bail!("{name}: it has files, but no {DESCRIPTION}: name a dataset, or a new folder");
    }
    Ok(())
}

/// Adds what a dataset needs beside the files of a run.
pub(super) fn describe(run: &Run<'_>, names: &Names, staged: &mut Staged) {
    let about = json!({
        "Name": format!("Recordings of the rig {}", run.samples.rig.name),
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "farreach", "Version": env!("CARGO_PKG_VERSION")}],
    });
    staged.default(DESCRIPTION, format!("{about:#}\n"));
    let entries = staged.root().read_dir().into_iter().flatten().flatten();
    let mut present = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    if !present.any(|name| name.starts_with("README")) {
        staged.default("README.md", README.to_owned());
    }
    staged.row("participants.tsv", "participant_id", &format!("sub-{}", names.subject));
}

/// Adds what the rig file does not say of the electrodes, for the laboratory to complete.
pub(super) fn describe_electrodes(run: &Run<'_>, names: &Names, staged: &mut Staged) {
    let mains = run.samples.rig.emg.notch_hz;
    let about = json!({
        "EMGPlacementScheme": "Other",
        "EMGPlacementSchemeDescription": NOT_STATED,
        "EMGReference": NOT_STATED,
        "PowerLineFrequency": mains.map_or_else(|| json!("n/a"), |hz| json!(hz)),
    });
    staged.default(&format!("task-{}_emg.json", names.task), format!("{about:#}\n"));
}

/// Notes when a file of data begins.
pub(super) fn note_file(run: &Run<'_>, names: &Names, file: &Path, staged: &mut Staged) {
    let at = UNIX_EPOCH + Duration::from_nanos(run.wall_clock_ns(run.first_ns));
    let began = humantime::format_rfc3339_micros(at);
    let file = file.strip_prefix(names.folder()).unwrap_or(file);
    let row = format!("{}\t{began}", file.display());
    staged.row(names.scans(), "filename\tacq_time", &row);
}

const README: &str = "\
# Recordings of a master-slave haptic interface

Written by `farreach rec export --to bids`. Each run of a protocol is a run here:

- `func` (with a scan) or `beh`: events; torque, the card's other inputs and the number of the
  volume (`recording-handle_physio`); bar and light (`recording-screen_stim`). Onset 0 is the
  beginning of the first stored volume, or without a scan the first sample.
- `motion`: positions of the motor and the handle, from the zeros of the axes, with the events from
  its first sample on.
- `emg`: the electrodes as read, unfiltered, with the events from the first sample on.

`StartTime` in the JSON beside `physio`, `stim` and `emg` is the time of the first sample after
onset 0 (s); `motion` begins with the same sample. Times of day, in `_scans.tsv` and in the BDF
file, are UTC. The texts of rig file and protocol are in `Farreach` of each `physio.json`. What the
rig file does not say of the electrodes is to be completed in `task-*_emg.json`.
";
