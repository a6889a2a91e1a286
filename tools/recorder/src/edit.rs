//! `recover`, `cut`, `merge`.

use std::collections::BTreeMap;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use recording::mcap_edit::{EditReport, check_one_session, rewrite};
use recording::mcap_read::{Recording, Selection};
use recording::mcap_write::key;

use crate::all_parts::open_all;
use crate::inspect::grouped;
use crate::progress::Progress;
use crate::replacements::note_for_copy;
use crate::{DATA_LOST, DONE, exit_code_of_tail};

pub(crate) fn recover(
    file: &Path,
    to: &Path,
    json: bool,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    let recording = Recording::open_damaged(file)?;
    let notes = with_replaced(how("recover", &[file]), &recording, None)?;
    let progress = Progress::of([&recording], &Selection::default(), 1, json);
    let report = rewrite(&[&recording], None, None, &notes, to)?;
    drop(progress);
    report_edit(&report, to, json, true, out)?;
    for damage in &recording.damage {
        eprintln!("{}: damaged at byte {}: {}", file.display(), damage.offset, damage.what);
    }
    let sound = report.damaged_chunks == 0 && recording.damage.is_empty();
    Ok(if sound { exit_code_of_tail(&recording) } else { DATA_LOST })
}

pub(crate) fn cut(
    file: &Path,
    from: Option<f64>,
    until: Option<f64>,
    to: &Path,
    json: bool,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    for (name, value) in [("--from", from), ("--to", until)] {
        if let Some(value) = value.filter(|value| !value.is_finite() || *value < 0.0) {
            bail!("{name} {value}: expected seconds since the first message, 0 or more");
        }
    }
    if let (Some(from), Some(until)) = (from, until)
        && from >= until
    {
        bail!("--from {from} --to {until}: expected an end after the beginning");
    }
    let recording = Recording::open(file)?;
    let contents = recording.contents_or_check()?;
    let (Some(first), Some((_, last))) = (contents.origin_ns, contents.span_ns()) else {
        bail!("{}: there are no messages to cut", file.display());
    };
    let at = |seconds: f64| first.saturating_add((seconds * 1e9).round() as u64);
    if let Some(from) = from.filter(|&from| at(from) > last) {
        bail!(
            "--from {from}: {} ends {} s after its first message",
            file.display(),
            (last - first) as f64 * 1e-9
        );
    }
    let mut notes = with_replaced(how("cut", &[file]), &recording, from.map(at))?;
    for (name, value) in [("from_s", from), ("to_s", until)] {
        notes.extend(value.map(|value| (name.to_owned(), value.to_string())));
    }
    let (from_ns, until_ns) = (from.map(at), until.map(at));
    let selection = Selection { channels: None, from_ns, until_ns };
    let progress = Progress::of([&recording], &selection, 1, json);
    let report = rewrite(&[&recording], from_ns, until_ns, &notes, to)?;
    drop(progress);
    report_edit(&report, to, json, report.damaged_chunks > 0, out)?;
    Ok(if report.damaged_chunks > 0 { DATA_LOST } else { DONE })
}

pub(crate) fn merge(
    files: &[PathBuf],
    force: bool,
    to: &Path,
    json: bool,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    let recordings = open_all(files)?;
    let sources: Vec<&Recording> = recordings.iter().collect();
    if !force {
        check_one_session(&sources)?;
    }
    let progress = Progress::of(&recordings, &Selection::default(), 1, json);
    let names: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    let report = rewrite(&sources, None, None, &how("merge", &names), to)?;
    drop(progress);
    let lost = report.damaged_chunks > 0
        || recordings.iter().any(|recording| exit_code_of_tail(recording) == DATA_LOST);
    report_edit(&report, to, json, lost, out)?;
    Ok(if lost { DATA_LOST } else { DONE })
}

/// A part of a recording.
#[derive(Clone, Debug)]
pub struct Part {
    /// What it is called.
    pub name: PathBuf,
    /// Where it is read.
    pub at: PathBuf,
}

/// What was copied out of the parts of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Copied {
    /// How many messages there were.
    pub messages: u64,
    /// The interval that they make [ns, CLOCK_MONOTONIC].
    pub times_ns: Range<u64>,
    /// Whether messages are missing: one of the parts was cut off or is damaged, or the copy has
    /// gaps.
    pub lost: bool,
}

/// Copies what parts of a recording, all of which have ended, hold of an interval of time [ns,
/// CLOCK_MONOTONIC] into a new file, with `notes`. The parts are given in their order.
///
/// # Errors
/// Where they hold nothing of it or cannot be read, or the file is there already.
pub fn copy_interval(
    parts: &[Part],
    times_ns: Range<u64>,
    notes: BTreeMap<String, String>,
    to: &Path,
) -> anyhow::Result<Copied> {
    let mut found = Vec::with_capacity(parts.len());
    let mut offset_ns = 0;
    for Part { name, at } in parts {
        let recording = Recording::open(at).with_context(|| name.display().to_string())?;
        offset_ns = recording.realtime_offset_ns().unwrap_or(offset_ns);
        let contents = recording.contents_or_check();
        let span_ns = contents.with_context(|| name.display().to_string())?.span_ns();
        found.push((recording, name.as_path(), span_ns));
    }
    let [from_ns, until_ns] =
        [times_ns.start, times_ns.end].map(|at_ns| at_ns.saturating_add_signed(offset_ns));
    let mut used: Vec<(&Recording, &Path)> = Vec::new();
    let mut lost = false;
    let mut next_ns = u64::MAX;
    for &(ref recording, name, span_ns) in found.iter().rev() {
        let torn = exit_code_of_tail(recording) == DATA_LOST;
        let began_ns = recording.began_ns().unwrap_or(0);
        let (first_ns, last_ns) = span_ns.unwrap_or((began_ns, began_ns));
        // What a torn part lacks reaches to the next one's beginning.
        let end_ns = if torn { last_ns.max(next_ns.saturating_sub(1)) } else { last_ns };
        if (torn || span_ns.is_some()) && first_ns < until_ns && end_ns >= from_ns {
            used.push((recording, name));
            lost |= torn;
        }
        if span_ns.is_some() {
            next_ns = first_ns;
        }
    }
    used.reverse();
    let (sources, names): (Vec<&Recording>, Vec<&Path>) = used.into_iter().unzip();
    let Some(first) = sources.first() else {
        bail!("the ring holds nothing of this time");
    };
    let mut how = with_replaced(how("snapshot", &names), first, Some(from_ns))?;
    how.extend(notes);
    // The parts are read by other names than theirs.
    let report = check_one_session(&sources)
        .and_then(|()| rewrite(&sources, Some(from_ns), Some(until_ns), &how, to))
        .with_context(|| format!("copying out of {}", how["sources"]))?;
    // A logger that was ended for a while, or a queue that was full, leave parts that are whole.
    let check = Recording::open(to)?.check()?;
    let (first_ns, last_ns) = check.span_ns().unwrap_or((from_ns, from_ns));
    let [first_ns, last_ns] =
        [first_ns, last_ns].map(|at_ns| at_ns.saturating_add_signed(-offset_ns));
    Ok(Copied {
        messages: report.messages,
        times_ns: first_ns..last_ns,
        lost: lost || report.damaged_chunks > 0 || check.data_lost(),
    })
}

/// Notes for the new file: what was done to which files. Names without folders, which say nothing
/// to others.
fn how(verb: &str, files: &[&Path]) -> BTreeMap<String, String> {
    let names: Vec<_> = files
        .iter()
        .filter_map(|file| file.file_name())
        .map(|name| name.to_string_lossy())
        .collect();
    BTreeMap::from([("edit".to_owned(), verb.to_owned()), ("sources".to_owned(), names.join(", "))])
}

/// The notes for a copy of one file, with the processes that were replaced where it begins.
fn with_replaced(
    mut notes: BTreeMap<String, String>,
    recording: &Recording,
    from_ns: Option<u64>,
) -> anyhow::Result<BTreeMap<String, String>> {
    let noted = note_for_copy(recording, from_ns)?;
    notes.extend(noted.map(|noted| (key::REPLACED.to_owned(), noted)));
    Ok(notes)
}

fn report_edit(
    report: &EditReport,
    to: &Path,
    json: bool,
    losses: bool,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    if json {
        let mut value = serde_json::to_value(report)?;
        if let Some(map) = value.as_object_mut() {
            map.insert("file".to_owned(), to.to_string_lossy().into());
        }
        writeln!(out, "{value}")?;
        return Ok(());
    }
    write!(out, "{}: {} messages", to.display(), grouped(report.messages))?;
    if losses {
        write!(
            out,
            "; {} damaged chunks and {} bytes at the end left out",
            grouped(report.damaged_chunks),
            grouped(report.tail_bytes_lost)
        )?;
    }
    writeln!(out)?;
    if report.repeated > 0 {
        eprintln!("{} messages that several files hold were copied once", grouped(report.repeated));
    }
    if report.attachments_left_out > 0 {
        eprintln!("{} attachments were not copied", report.attachments_left_out);
    }
    Ok(())
}
