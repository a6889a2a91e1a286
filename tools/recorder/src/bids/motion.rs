//! The positions of a run.

use std::io::Write;

use serde_json::json;

use super::continuous::{indices, write_rows};
use super::events::{self, number};
use super::names::Names;
use super::run::Run;
use super::staged::Staged;
use crate::signals::{Signal, Source};

/// Name of the tracking system: the encoders at motor and handle.
const SYSTEM: &str = "encoders";

/// Writes the positions of motors and handles; returns whether the rig has any.
pub(super) fn write(run: &Run<'_>, names: &Names, staged: &mut Staged) -> anyhow::Result<bool> {
    let positions =
        indices(run, |signal, _| matches!(signal.source, Source::Master(_) | Source::Slave(_)));
    if positions.is_empty() {
        return Ok(false);
    }
    let mut table = staged.create(names.tracking(SYSTEM, "motion.tsv"))?;
    write_rows(run, &positions, &mut table, |_, values, cells| {
        cells.extend(values.iter().map(|value| number(*value)));
    })?;
    table.flush()?;
    let mut channels = staged.create(names.tracking(SYSTEM, "channels.tsv"))?;
    let header = "name\tcomponent\ttype\ttracked_point\tunits\tplacement\tdescription";
    writeln!(channels, "{header}")?;
    let mut angles = 0;
    for at in &positions {
        let signal = &run.samples.signals[*at];
        angles += usize::from(signal.unit == "rad");
        writeln!(channels, "{}", channel(run, signal))?;
    }
    channels.flush()?;
    let mut about = json!({
        "TaskName": run.protocol,
        "TaskDescription": run.description,
        "TrackingSystemName": SYSTEM,
        "SamplingFrequency": run.rate_hz(),
        "SamplingFrequencyEffective": run.effective_hz(),
        "RecordingDuration": run.duration_s(),
        "MissingValues": "n/a",
        "MotionChannelCount": positions.len(),
        "JNTANGChannelCount": angles,
        "POSChannelCount": positions.len() - angles,
        "TrackedPointsCount": positions.len(),
        "SoftwareVersions": format!("farreach {}", run.version()),
    });
    for other in ["ACCEL", "ANGACCEL", "GYRO", "LATENCY", "MAGN", "MISC", "ORNT", "VEL"] {
        about[format!("{other}ChannelCount")] = 0.into();
    }
    staged.json(names.tracking(SYSTEM, "motion.json"), &about)?;
    events::write(run, &names.tracking(SYSTEM, "events"), run.first_ns, staged)?;
    super::dataset::note_file(run, names, &names.tracking(SYSTEM, "motion.tsv"), staged);
    Ok(true)
}

/// A row of the table of channels.
fn channel(run: &Run<'_>, signal: &Signal) -> String {
    let (axis, point, placement) = match signal.source {
        Source::Slave(axis) => (axis, "handle", "hand"),
        Source::Master(axis) => (axis, "motor", "n/a"),
        Source::Torque(axis) | Source::MotorVolts(axis) => (axis, "n/a", "n/a"),
        Source::Analog(..) | Source::Sync(_) => (0, "n/a", "n/a"),
    };
    let name = run.samples.rig.axes.get(axis).map_or("", |axis| axis.name.as_str());
    let (kind, component) = match signal.unit.as_str() {
        "rad" => ("JNTANG", "n/a"),
        _ => ("POS", ["x", "y", "z"].get(axis).copied().unwrap_or("n/a")),
    };
    let unit = &signal.unit;
    format!(
        "{}\t{component}\t{kind}\t{name}_{point}\t{unit}\t{placement}\tPosition of the {point} of \
         axis {name}, from its zero; events of type axis_homed change that",
        signal.name
    )
}
