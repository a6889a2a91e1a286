//! `innovations`: the model beside the machine, once more along the recorded samples.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use anyhow::Context;
use ipc_types::{INNOVATION, Innovation, NewestModel, SAMPLE, Sample};
use monitor::{Report, RigMonitor};
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use rig::RigFile;
use serde::Serialize;

use crate::all_parts::AllParts;
use crate::innovations_page::{Course, RowSeen, page};
use crate::inspect::grouped;
use crate::monitored::{Happened, Sites};
use crate::output::{none_exists, write_new};
use crate::replacements::replaced_lines;
use crate::{DATA_LOST, DONE};

/// Samples after a row's first that it is made of, and a few that make no further one.
const OF_A_ROW: u64 = 12;

/// A stretch in which the monitor of the recording took every sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stretch {
    incarnation: u64,
    began: u64,
    last: u64,
}

/// What the samples show, as `rec innovations --json` prints it.
#[derive(Debug, Serialize)]
struct Replay<'a> {
    /// Rows of innovations, of all axes.
    rows: u64,
    /// Rows that were published live; 0 where no monitor ran.
    live: u64,
    /// Those of them that are the same to the last bit.
    same: u64,
    /// What happened, at the times of the samples.
    events: &'a [Happened],
}

/// What else is written.
pub(crate) struct Files<'a> {
    /// The rows as CSV.
    pub(crate) table: Option<&'a Path>,
    /// The page.
    pub(crate) page: Option<&'a Path>,
}

pub(crate) fn innovations(
    file: &Path,
    files: &Files<'_>,
    json: bool,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    let recording = AllParts::open(file)?;
    none_exists(&files.table.into_iter().chain(files.page).collect::<Vec<_>>())?;
    let text = recording.metadata(key::RIG_FILE).with_context(|| {
        format!("{}: the recording has no rig file, and so no model", file.display())
    })?;
    let rig = RigFile::parse(text, "rig file of the recording")?;
    let live = live_rows(&recording)?;
    let course = replay(&recording, &rig, &live)?;
    let replay = Replay::new(&course, &live);
    if let Some(path) = files.table {
        write_new(path, as_csv(&course.rows)?)?;
    }
    if let Some(path) = files.page {
        let subtitle = subtitle(file, &rig, &replay);
        write_new(path, page(&course, &replaced_lines(&recording)?, &subtitle).render()?)?;
    }
    let code = if replay.same == replay.live { DONE } else { DATA_LOST };
    if json {
        writeln!(out, "{}", serde_json::to_string_pretty(&replay)?)?;
        return Ok(code);
    }
    writeln!(out, "{}: {} rows of innovations", file.display(), grouped(replay.rows))?;
    if replay.live > 0 {
        let (same, live) = (grouped(replay.same), grouped(replay.live));
        writeln!(out, "  {same} of {live} that were published live are the same to the last bit")?;
    }
    for event in replay.events {
        writeln!(out, "  {}", event.line())?;
    }
    Ok(code)
}

/// The rows that the monitor published.
fn live_rows(recording: &Recording) -> anyhow::Result<Vec<Innovation>> {
    let messages = recording.messages_if_any::<Innovation>(INNOVATION.topic.name)?;
    messages.map(|message| Ok(message?.message)).collect()
}

/// The stretches in which a monitor took every sample, by its rows.
fn stretches(live: &[Innovation]) -> Vec<Stretch> {
    let mut stretches: Vec<Stretch> = Vec::new();
    for row in live {
        match stretches.last_mut() {
            Some(newest)
                if (newest.incarnation, newest.began) == (row.incarnation, row.began_tick) =>
            {
                newest.last = newest.last.max(row.tick);
            }
            _ => stretches.push(Stretch {
                incarnation: row.incarnation,
                began: row.began_tick,
                last: row.tick,
            }),
        }
    }
    stretches
}

/// Runs the monitor along the samples: along all of them where none ran, else along those that each
/// monitor took.
fn replay(recording: &Recording, rig: &RigFile, live: &[Innovation]) -> anyhow::Result<Course> {
    let whole = Stretch { incarnation: 0, began: 0, last: u64::MAX - OF_A_ROW };
    let stretches = if live.is_empty() { vec![whole] } else { stretches(live) };
    let began_ns = recording.began_monotonic_ns();
    let mut monitor = RigMonitor::new(rig);
    let (mut course, mut newest, mut sites) =
        (Course::default(), NewestModel::default(), Sites::default());
    let mut at = 0;
    for message in recording.messages::<Sample>(SAMPLE.topic.name)? {
        let sample = message?.message;
        while let Some(stretch) = stretches.get(at)
            && sample.tick >= stretch.last + OF_A_ROW
        {
            at += 1;
            let next = stretches.get(at);
            if next.is_some_and(|next| next.incarnation != stretch.incarnation) {
                monitor = RigMonitor::new(rig);
            }
        }
        if stretches.get(at).is_none_or(|stretch| sample.tick < stretch.began) {
            continue;
        }
        let t_s = (sample.scan_time_ns as f64 - began_ns as f64) * 1e-9;
        monitor.see(&sample, &mut |report| -> anyhow::Result<()> {
            match report {
                Report::Innovation(row) => {
                    let position = sample.master_position.get(usize::from(row.axis)).copied();
                    let position_rad = position.unwrap_or(f64::NAN);
                    course.rows.push(RowSeen { t_s, position_rad, row });
                }
                Report::Event(event) => {
                    newest.see_event(&event);
                    course.events.push(Happened::new(&event, t_s, &sites));
                }
                Report::State(state) => {
                    sites.see(&state);
                    newest.see_state(&state);
                    course.states.push((t_s, state));
                }
            }
            Ok(())
        })?;
    }
    // Replayed states have no time of publication, and no age.
    course.last = newest.status(Some(rig.rates.acquisition_hz.into()), 0);
    Ok(course)
}

impl<'a> Replay<'a> {
    fn new(course: &'a Course, live: &[Innovation]) -> Self {
        let again: BTreeMap<(u64, u8), [u64; 2]> = course
            .rows
            .iter()
            .map(|RowSeen { row, .. }| {
                ((row.tick, row.axis), [row.master.to_bits(), row.slave.to_bits()])
            })
            .collect();
        let is_same = |row: &&Innovation| {
            again.get(&(row.tick, row.axis)) == Some(&[row.master.to_bits(), row.slave.to_bits()])
        };
        let same = live.iter().filter(is_same).count() as u64;
        let rows = course.rows.len() as u64;
        Self { rows, live: live.len() as u64, same, events: &course.events }
    }
}

/// What the page is of.
fn subtitle(file: &Path, rig: &RigFile, replay: &Replay<'_>) -> String {
    let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
    let compared = match (replay.live, replay.same == replay.live) {
        (0, _) => "",
        (_, true) => ", the same live and from the recording to the last bit",
        (_, false) => ", of which some differ from those that were published live",
    };
    format!("{name}, rig {}: {} rows of innovations{compared}.", rig.name, grouped(replay.rows))
}

/// The rows as CSV.
fn as_csv(rows: &[RowSeen]) -> anyhow::Result<Vec<u8>> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(["tick", "axis", "master_rad", "slave_rad"])?;
    for RowSeen { row, .. } in rows {
        let slave = if row.slave_present == 0 { String::new() } else { row.slave.to_string() };
        let fields = [row.tick.to_string(), row.axis.to_string(), row.master.to_string(), slave];
        table.write_record(fields)?;
    }
    Ok(table.into_inner()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_end_at_gaps_and_with_each_monitor() {
        let row = |incarnation, began_tick, tick| Innovation {
            incarnation,
            began_tick,
            tick,
            ..Innovation::default()
        };
        let live = [row(1, 10, 10), row(1, 10, 18), row(1, 90, 90), row(2, 200, 200)];
        let found: Vec<_> = stretches(&live).iter().map(|s| (s.began, s.last)).collect();
        assert_eq!(found, [(10, 18), (90, 90), (200, 200)]);
    }
}
