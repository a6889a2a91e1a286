//! `resim`: control, gate, watchdog and experiment once more on the recorded inputs.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use ipc_types::{Process, Profile};
use recording::mcap_read::Recording;
use recording::mcap_write::{START_RECORD, key};
use resim::{CoreReport, Difference, Foreign, OtherGains, Replay, Report, Rigs, Runs, Trip, Used};
use rig::RigFile;
use serde::Serialize;

use crate::all_parts::AllParts;
use crate::inspect::grouped;
use crate::replacements::Replacements;
use crate::{DATA_LOST, DONE};

/// What was found, as `rec resim --json` prints it.
#[derive(Debug, Serialize)]
struct Found<'a> {
    /// Whether all that was compared is the same.
    same: bool,
    /// Damaged chunks of the recording, whose messages are missing.
    damaged_chunks: u64,
    #[serde(flatten)]
    report: &'a Report,
}

pub(crate) fn resim(
    file: &Path,
    control: Option<&Path>,
    json: bool,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    let other = control.map(rig::load_rig).transpose()?;
    let recording = AllParts::open(file)?;
    let rigs = rigs(&recording).with_context(|| file.display().to_string())?;
    let mut replay = Replay::new(rigs, Runs::of(&recording), other.as_ref(), foreign(&recording)?)?;
    let damaged_chunks = resim::read(&recording, |message| replay.take(message))
        .with_context(|| file.display().to_string())?;
    let report = replay.report();
    let found = Found { same: report.agrees(), damaged_chunks, report: &report };
    let code = if found.same && damaged_chunks == 0 { DONE } else { DATA_LOST };
    if json {
        writeln!(out, "{}", serde_json::to_string_pretty(&found)?)?;
        return Ok(code);
    }
    print(file, &found, out)?;
    if let (Some(path), Some(gains)) = (control, &report.other_gains) {
        print_other_gains(path, gains, out)?;
    }
    Ok(code)
}

/// The rig files that the recording holds, and its profile.
fn rigs(recording: &Recording) -> anyhow::Result<Rigs> {
    let text = recording.metadata(key::PROFILE).context(
        "expected the rig's timing profile in the metadata, found none: farreach did not write it",
    )?;
    let profile =
        Profile::ALL.iter().copied().find(|profile| profile.text() == text).with_context(|| {
            format!("expected the timing profile realtime or best-effort, found {text}")
        })?;
    let starts = recording.metadata_records.iter().filter(|(name, _)| name == START_RECORD);
    let (mut rigs, mut newest): (Option<Rigs>, &str) = (None, "");
    for (_, start) in starts {
        let Some(text) = start.get(key::RIG_FILE).filter(|text| *text != newest) else { continue };
        newest = text;
        let rig = RigFile::parse(text, "rig file of the recording")?;
        let from_ns = start.get(key::STARTED_NS).and_then(|time| time.parse().ok()).unwrap_or(0);
        match &mut rigs {
            Some(rigs) => rigs.push(from_ns, rig),
            None => rigs = Some(Rigs::new(rig, profile, recording.began_monotonic_ns())),
        }
    }
    rigs.context("expected a rig file in the metadata, found none: no gains and no limits")
}

/// Where programs of somebody else's ran in place of processes.
fn foreign(recording: &Recording) -> anyhow::Result<Vec<Foreign>> {
    let replacements = Replacements::read(recording)?;
    let foreign = replacements.spans().filter_map(|(name, from_s, until_s)| {
        let process = Process::ALL.iter().copied().find(|process| process.text() == name)?;
        Some(Foreign { process, from_s, until_s })
    });
    Ok(foreign.collect())
}

fn print(file: &Path, found: &Found<'_>, out: &mut dyn Write) -> anyhow::Result<()> {
    let compared: u64 = found.report.cores.iter().map(|core| core.compared).sum();
    let verdict = match (found.same, compared) {
        (_, 0) => "nothing could be compared",
        (true, _) => "run again, all that was compared is the same to the last bit",
        (false, _) => "run again, NOT THE SAME",
    };
    writeln!(out, "{}: {verdict}", file.display())?;
    if found.damaged_chunks > 0 {
        let chunks = grouped(found.damaged_chunks);
        writeln!(out, "  {chunks} damaged chunks, whose messages are missing")?;
    }
    for core in &found.report.cores {
        print_core(core, out)?;
    }
    for trip in &found.report.trips {
        print_trip(trip, out)?;
    }
    Ok(())
}

fn print_core(core: &CoreReport, out: &mut dyn Write) -> anyhow::Result<()> {
    let [messages, compared] = [core.messages, core.compared].map(grouped);
    let result = match (core.compared, core.differing) {
        (0, _) => String::new(),
        (_, 0) => ", all the same".to_owned(),
        (_, differing) => format!(", {} DIFFER", grouped(differing)),
    };
    let (name, topic) = (core.core, core.topic);
    writeln!(out, "  {name}: {messages} messages ({topic}), {compared} compared{result}")?;
    for begin in &core.begins {
        let incarnation = begin.incarnation;
        writeln!(out, "    from {:.3} s on: {} {incarnation:016x}", begin.at_s, begin.from)?;
    }
    for (why, count) in &core.not_compared {
        writeln!(out, "    {} not compared: {}", grouped(*count), why.text())?;
    }
    core.first_difference.iter().try_for_each(|difference| print_difference(difference, out))
}

fn print_difference(difference: &Difference, out: &mut dyn Write) -> anyhow::Result<()> {
    let Difference { topic, sequence, tick, at_s, field, inputs, .. } = difference;
    writeln!(
        out,
        "    first difference: {topic} {sequence}, tick {tick}, {at_s:.4} s: {}: recorded {}, \
         computed again {}",
        field.field, field.recorded, field.recomputed
    )?;
    print_used(inputs, out)
}

fn print_used(inputs: &[Used], out: &mut dyn Write) -> anyhow::Result<()> {
    inputs.iter().try_for_each(|used| Ok(writeln!(out, "      {}", used.line())?))
}

fn print_trip(trip: &Trip, out: &mut dyn Write) -> anyhow::Result<()> {
    let Trip { at_s, sequence, state, recorded, recomputed, faults, inputs, .. } = trip;
    let again = match recomputed {
        Some(again) if again == recorded => "computed again: the same".to_owned(),
        Some(again) => format!("COMPUTED AGAIN: {again}"),
        None => "not computed again".to_owned(),
    };
    writeln!(out, "  {state} at {at_s:.4} s, token {sequence}: {recorded} ({again})")?;
    writeln!(out, "    active: {}", faults.join("; "))?;
    print_used(inputs, out)
}

fn print_other_gains(path: &Path, gains: &OtherGains, out: &mut dyn Write) -> anyhow::Result<()> {
    writeln!(
        out,
        "  with the gains of {} on the recorded inputs ({} commands, {} of them under power).\n    \
         Open loop: the machine would have moved differently, and the volts been others again.",
        path.display(),
        grouped(gains.commands),
        grouped(gains.powered)
    )?;
    for axis in &gains.volts {
        writeln!(
            out,
            "    axis {}: the volts differ by {:.4} V rms, at most by {:.4} V, at {:.4} s",
            axis.axis, axis.rms_v, axis.largest_v, axis.largest_at_s
        )?;
    }
    Ok(())
}
