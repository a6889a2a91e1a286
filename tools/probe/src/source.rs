//! Opens what a probe reads: a running rig or a recording.

use std::path::Path;

use recorder::DATA_LOST;
use recording::mcap_read::Recording;
use runtime::RigName;

use crate::attach::{self, Attached};
use crate::recorded::Recorded;
use crate::stream::Source;

/// Runs a probe on these topics (all if none is given) of a recording, or else of the running rig,
/// polled every `period_ns`; returns the exit code, which also tells what a recording lacks.
///
/// # Errors
/// If there is no such rig, recording or topic; what the probe says.
pub(crate) fn observe(
    file: Option<&Path>,
    rig: &RigName,
    topics: &[String],
    period_ns: u64,
    probe: impl FnOnce(&mut dyn Source) -> anyhow::Result<i32>,
) -> anyhow::Result<i32> {
    let Some(file) = file else {
        let topics = attach::topics(topics)?;
        return probe(&mut Attached::new(rig, &topics, period_ns)?);
    };
    let recording = Recording::open(file)?;
    let mut source = Recorded::new(&recording, topics)?;
    let code = probe(&mut source)?;
    let missing = source.exit_code();
    if missing == DATA_LOST && !recording.tail.complete && !recording.tail.being_written {
        eprintln!("{}: {}", file.display(), recording.tail.reason);
    }
    Ok(if missing == DATA_LOST { missing } else { code })
}
