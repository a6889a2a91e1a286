//! Segmentation of a long recording of a transmission into segments of movement that fit, select
//! and report.
//!
//! Rest carries no information and is left out, and so are segments in which the slave sticks.
//! Movement is cut into segments of about
//! [`LENGTH_S`], each at the end of a stroke on the same side: there the unknown initial speed is
//! smallest, and segments of a periodic movement repeat one another, which gives the noise floor.
//! Roles alternate among segments of similar frequency content, so that slow and fast movement fit,
//! select and report.

use crate::equation_error::block_roles::Role;
use crate::error::{IdentifyError, Result};
use crate::input::{Series, step_of};
use crate::naming;
use crate::prediction_error::record::uninformative;

/// Nominal length of a segment (s).
pub(super) const LENGTH_S: f64 = 3.0;
/// Shortest segment (s).
const SHORTEST_S: f64 = 2.2;
/// Largest shift of a cut to the end of a stroke (s).
const REACH_S: f64 = 0.75;
/// Window in which movement is detected (s), and its least range (rad).
const WINDOW_S: f64 = 1.0;
const LEAST_RAD: f64 = 0.05;
/// Fewest segments: one per role.
const FEWEST: usize = 3;
/// Most segments: the duration of a search grows with its records, and repetition adds little.
const MOST: usize = 40;
/// Most segments that a note names.
const MOST_NAMED: usize = 3;
/// Roles, in turn.
const TURN: [Role; 4] = [Role::Fit, Role::Select, Role::Fit, Role::Report];

/// Cuts records into segments if there are too few of them; `None` if they suffice or have roles.
///
/// # Errors
/// If the records are too few and too short to be cut.
pub(super) fn segment(records: &[Series], notes: &mut Vec<String>) -> Result<Option<Vec<Series>>> {
    if records.len() >= FEWEST || records.iter().any(|record| record.role.is_some()) {
        return Ok(None);
    }
    let mut segments = Vec::new();
    for record in records {
        let (time, (_, master)) = (record.time()?, record.any(&["master_rad"])?);
        record.finite("master_rad")?;
        let Some(step_s) = step_of(time) else { continue };
        segments
            .extend(cuts(master, step_s).into_iter().map(|rows| segment_of(record, rows, step_s)));
    }
    let still = leave_out_still(&mut segments);
    if segments.len() < FEWEST {
        let (found, moved) = (records.len(), segments.len());
        let beside = still.map_or(String::new(), |still| format!(" ({still})"));
        return Err(IdentifyError::Unusable(format!(
            "expected three records of a transmission, or one that moves for {:.0} s or more; \
             found {found} with {moved} {} of movement of {LENGTH_S} s{beside}; whole records fit, \
             select and report: give more of them, with movements that differ, or a longer one",
            FEWEST as f64 * LENGTH_S,
            noun(moved)
        )));
    }
    notes.extend(still);
    // Roles alternate within each class of frequency content.
    let mut order: Vec<usize> = (0..segments.len()).collect();
    let quick: Vec<f64> = segments.iter().map(mean_frequency).collect();
    order.sort_by(|a, b| bucket(quick[*a]).cmp(&bucket(quick[*b])).then(a.cmp(b)));
    let found = segments.len();
    if found > MOST {
        // Evenly over frequency content, and over time within a class.
        order = (0..MOST).map(|turn| order[turn * found / MOST]).collect();
        notes.push(format!(
            "{found} segments of movement found, {MOST} of them used, evenly over fast and slow \
             ones and over time"
        ));
    }
    for (turn, at) in order.into_iter().enumerate() {
        segments[at].role = Some(TURN[turn % TURN.len()]);
    }
    notes.push(format!(
        "{} cut into {} segments of movement of about {LENGTH_S} s, which fit, select and report \
         in turn: they cannot show day-to-day variation",
        records.iter().map(|record| record.file.as_str()).collect::<Vec<_>>().join(" and "),
        segments.iter().filter(|segment| segment.role.is_some()).count()
    ));
    segments.retain(|segment| segment.role.is_some());
    Ok(Some(segments))
}

const fn noun(segments: usize) -> &'static str {
    if segments == 1 { "segment" } else { "segments" }
}

/// Leaves out segments that tell nothing, and returns a note on them: the master moves in every
/// segment, but the slave may stick, or the motor be off.
fn leave_out_still(segments: &mut Vec<Series>) -> Option<String> {
    let mut why = Vec::new();
    segments.retain(|segment| match uninformative(segment) {
        Some(still) => {
            why.push(format!("{}: {}: {}", segment.file, still.column, still.found));
            false
        }
        None => true,
    });
    let (count, more) = (why.len(), why.len().saturating_sub(MOST_NAMED));
    why.truncate(MOST_NAMED);
    if more > 0 {
        why.push(format!("and {more} more"));
    }
    (count > 0).then(|| format!("{count} {} left out: {}", noun(count), why.join("; ")))
}

/// Rows of the segments of one record.
fn cuts(master: &[f64], step_s: f64) -> Vec<std::ops::Range<usize>> {
    let rows = |seconds: f64| (seconds / step_s).round().max(1.0) as usize;
    let mut found = Vec::new();
    for run in moving(master, rows(WINDOW_S)) {
        let mut from = stroke_end(master, run.start, &run, rows(REACH_S)).unwrap_or(run.start);
        while from + rows(SHORTEST_S) < run.end {
            let left = run.end - from;
            let pieces = ((left as f64 * step_s / LENGTH_S).round() as usize).max(1);
            // The last two share the remainder.
            let due = if pieces > 2 { from + rows(LENGTH_S) } else { from + left / pieces };
            let to = stroke_end(master, due, &run, rows(REACH_S)).unwrap_or(due);
            if to >= from + rows(SHORTEST_S) {
                found.push(from..to);
            }
            from = to.max(from + 1);
            if pieces == 1 {
                break;
            }
        }
    }
    found
}

/// Runs of windows in which the machine moves.
fn moving(master: &[f64], window: usize) -> Vec<std::ops::Range<usize>> {
    let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
    let mut start = 0;
    for piece in master.chunks(window) {
        let (low, high) = piece
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let end = start + piece.len();
        if high - low >= LEAST_RAD {
            match runs.last_mut().filter(|run| run.end == start) {
                Some(run) => run.end = end,
                None => runs.push(start..end),
            }
        }
        start = end;
    }
    runs
}

/// Returns the row of the highest position within reach, if it is a stroke end and not the edge of
/// the search interval.
fn stroke_end(
    master: &[f64],
    due: usize,
    run: &std::ops::Range<usize>,
    reach: usize,
) -> Option<usize> {
    let (low, high) = (due.saturating_sub(reach).max(run.start), (due + reach).min(run.end));
    let at = (low..high).max_by(|a, b| master[*a].total_cmp(&master[*b]))?;
    // The middle of the rows with equal counts.
    let last = (at..high).take_while(|row| master[*row] >= master[at]).last()?;
    let first = (low..=at).rev().take_while(|row| master[*row] >= master[at]).last()?;
    let middle = usize::midpoint(first, last);
    (low < first && last + 1 < high).then_some(middle)
}

/// Rms displacement in 20 ms over the rms position about its mean: proportional to a mean
/// frequency.
fn mean_frequency(segment: &Series) -> f64 {
    let (Some(master), Some(time)) = (segment.column("master_rad"), segment.column("t_s")) else {
        return 0.0;
    };
    let width = step_of(time).map_or(1, |step| (0.02 / step).round().max(1.0) as usize);
    let mean = master.iter().sum::<f64>() / master.len().max(1) as f64;
    let way: f64 = master.windows(width + 1).map(|rows| (rows[width] - rows[0]).powi(2)).sum();
    let size: f64 = master.iter().map(|position| (position - mean).powi(2)).sum();
    (way / size.max(f64::MIN_POSITIVE)).sqrt()
}

/// Class of frequency content, in logarithmic steps of a quarter, so that repeats stay in time
/// order.
fn bucket(mean_frequency: f64) -> i64 {
    (mean_frequency.max(1e-9).ln() / 0.25f64.ln_1p()).round() as i64
}

fn segment_of(record: &Series, rows: std::ops::Range<usize>, step_s: f64) -> Series {
    let columns = record.columns.iter().map(|(name, values)| {
        let part = values.get(rows.clone()).unwrap_or_default();
        (name.clone(), part.to_vec())
    });
    let (from, to) = (rows.start as f64 * step_s, rows.end as f64 * step_s);
    Series {
        file: naming::segment(&record.file, from, to),
        columns: columns.collect(),
        ..Series::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 1e-3;

    /// A second of rest, 22 s of a sine of 1 Hz, 8 s of a sum of quicker ones, a second of rest.
    fn recording() -> Series {
        let time: Vec<f64> = (0..32_000).map(|row| f64::from(row) * STEP_S).collect();
        let tau = std::f64::consts::TAU;
        let position = |t: f64| match t {
            t if !(1.0..31.0).contains(&t) => 0.0,
            t if t < 23.0 => 0.5 * (tau * (t - 1.0)).sin(),
            t => 0.2 * (tau * 1.25 * (t - 23.0)).sin() + 0.1 * (tau * 4.25 * (t - 23.0)).sin(),
        };
        let count = |position: f64| (position / 1.57e-3).round() * 1.57e-3;
        let master = time.iter().map(|t| count(position(*t))).collect();
        let columns = vec![("t_s".to_owned(), time), ("master_rad".to_owned(), master)];
        Series { file: "run.mcap".into(), columns, role: None, notes: Vec::new() }
    }

    #[test]
    fn segments_of_a_long_recording_share_all_movements_among_all_roles() {
        let mut notes = Vec::new();
        let segments = segment(&[recording()], &mut notes).unwrap().unwrap();
        assert_eq!(notes.len(), 1);
        for segment in &segments {
            let time = segment.column("t_s").unwrap();
            let (first, last) = (time[0], time[time.len() - 1]);
            assert!(first >= 0.99 && last < 31.1, "{first} to {last}: rest is left out");
            assert!((2.1..5.0).contains(&(last - first)), "{first} to {last}");
            assert_eq!(segment.column("master_rad").unwrap().len(), time.len());
        }
        for pair in segments.windows(2) {
            assert!(
                pair[0].column("t_s").unwrap().last() < pair[1].column("t_s").unwrap().first(),
                "none overlaps"
            );
        }
        let of = |role| segments.iter().filter(|segment| segment.role == Some(role)).count();
        assert!(
            of(Role::Fit) >= 3 && of(Role::Select) >= 2 && of(Role::Report) >= 1,
            "{segments:?}"
        );
        let quick: Vec<_> = segments
            .iter()
            .filter(|s| s.column("t_s").unwrap()[0] > 22.5)
            .map(|s| s.role)
            .collect();
        assert!(quick.contains(&Some(Role::Fit)) && quick.len() >= 2, "{quick:?}");
    }

    #[test]
    fn a_periodic_movement_is_cut_at_the_same_place_of_its_period() {
        let segments = segment(&[recording()], &mut Vec::new()).unwrap().unwrap();
        let whole: Vec<_> =
            segments.iter().filter(|s| s.column("t_s").unwrap()[0] < 18.0).collect();
        assert!(whole.len() >= 4);
        for segment in whole {
            let start = segment.column("t_s").unwrap()[0];
            let phase = (start - 1.25).rem_euclid(1.0);
            assert!(phase.min(1.0 - phase) < 0.03, "{start} s is no upper end of a stroke");
            assert!(segment.column("master_rad").unwrap()[0] > 0.49);
        }
    }

    #[test]
    fn of_many_segments_some_are_taken_evenly() {
        // Ten times the same, one after another.
        let once = recording();
        let mut long = once.clone();
        for turn in 1..10 {
            let later = f64::from(turn) * 32.0;
            for ((name, column), (_, own)) in long.columns.iter_mut().zip(&once.columns) {
                column.extend(
                    own.iter().map(|value| if name == "t_s" { value + later } else { *value }),
                );
            }
        }
        let mut notes = Vec::new();
        let segments = segment(&[long], &mut notes).unwrap().unwrap();
        assert_eq!(segments.len(), MOST);
        assert!(
            notes[0].contains("40 of them used") && notes[1].contains("into 40 segments"),
            "{notes:?}"
        );
        for role in [Role::Fit, Role::Select, Role::Report] {
            let starts: Vec<f64> = segments
                .iter()
                .filter(|segment| segment.role == Some(role))
                .map(|segment| segment.column("t_s").unwrap()[0])
                .collect();
            assert!(starts.len() >= 9, "{role:?}: {}", starts.len());
            let (first, last) = (
                starts.iter().copied().fold(f64::INFINITY, f64::min),
                starts.iter().copied().fold(0.0, f64::max),
            );
            assert!(first < 64.0 && last > 256.0, "{role:?}: {first} to {last} s");
        }
    }

    #[test]
    fn segments_in_which_the_slave_sticks_are_left_out_and_noted() {
        let with_slave = |sticks_from_s: f64| {
            let mut long = recording();
            let own = |name| long.column(name).unwrap().to_vec();
            let (time, master) = (own("t_s"), own("master_rad"));
            // Less than 20 mrad, where it sticks.
            let slave = time.iter().zip(&master).map(|(t, master)| match *t < sticks_from_s {
                true => 0.8 * master,
                false => 0.01 * master,
            });
            let slave = slave.collect();
            long.columns.push(("slave_rad".to_owned(), slave));
            long
        };
        let mut notes = Vec::new();
        let segments = segment(&[with_slave(20.0)], &mut notes).unwrap().unwrap();
        assert!(segments.len() >= 6, "{}", segments.len());
        for segment in &segments {
            assert!(segment.column("t_s").unwrap()[0] < 20.0, "{}", segment.file);
        }
        for role in [Role::Fit, Role::Select, Role::Report] {
            assert!(segments.iter().any(|segment| segment.role == Some(role)), "{role:?}");
        }
        assert!(
            notes[0].contains("segments left out: run.mcap[") && notes[0].contains("slave_rad"),
            "{notes:?}"
        );
        // Too few remain.
        let text = segment(&[with_slave(5.0)], &mut Vec::new()).unwrap_err().to_string();
        assert!(text.contains("found 1 with 2 segments of") && text.contains("left out"), "{text}");
    }

    #[test]
    fn sufficient_records_are_not_segmented_and_short_ones_are_refused() {
        let three = vec![recording(), recording(), recording()];
        assert!(segment(&three, &mut Vec::new()).unwrap().is_none());
        let fixed = Series { role: Some(Role::Fit), ..recording() };
        assert!(segment(&[fixed], &mut Vec::new()).unwrap().is_none());
        let mut short = recording();
        short.columns.iter_mut().for_each(|column| column.1.truncate(7_000));
        let text = segment(&[short], &mut Vec::new()).unwrap_err().to_string();
        assert!(text.contains("moves for 9 s or more; found 1 with"), "{text}");
    }
}
