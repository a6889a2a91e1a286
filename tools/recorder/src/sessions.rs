//! `sessions`: the sessions of an experiment.

use std::io::Write;
use std::path::Path;

use anyhow::bail;
use ipc_types::{AXES, COMMAND, Mode, MotorCommand, SAMPLE, Sample, SessionOutcome};
use recording::mcap_read::Recording;
use serde::Serialize;

use crate::all_parts::AllParts;
use crate::ended_sessions::{EndedSession, ended_sessions};
use crate::inspect::grouped;
use crate::output::{none_exists, write_new};
use crate::sessions_figure;
use crate::{DATA_LOST, DONE};

/// Sums that differ by more than this from those over the recorded samples are told, as a share.
const ROUNDING: f64 = 1e-9;

/// A session that has ended, as `rec sessions --json` prints it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SessionReport {
    /// Its number in its protocol, from 1.
    pub number: u32,
    /// How many the protocol has.
    pub of: u32,
    /// Name of its segment.
    pub label: String,
    /// How it ended: `whole`, `stopped` or `interrupted`.
    pub outcome: &'static str,
    /// When it began, since the recording began (s).
    pub t_s: f64,
    /// How long it took (s).
    pub duration_s: f64,
    /// How long it was to take (s).
    pub planned_s: f64,
    /// Samples in its sums.
    pub samples: u64,
    /// Samples of it that are missing in the sums.
    pub samples_missed: u64,
    /// Mean magnitude of the hand's torque on each axis (N·m or N).
    pub mean_torque: Vec<f64>,
    /// What the next session has to match; `null` where they match nothing.
    pub value: Option<Vec<f64>>,
    /// What it had to match itself; `null` for the first.
    pub target: Option<Vec<f64>>,
    /// Root mean square of the master's distance from its reference, per axis (rad or m); `null`
    /// where the hand moved freely, or nothing of it was recorded.
    pub tracking_error: Option<Vec<f64>>,
    /// Largest difference of its sums from those over the recorded samples, as a share of the
    /// larger; `null` where no samples were recorded.
    pub sums_differ_by: Option<f64>,
}

/// A session while the recording is read.
struct Reading {
    ended: EndedSession,
    /// References of the master, with the ticks of their samples.
    references: Vec<(u64, [f64; AXES])>,
    matched: usize,
    errors: [f64; AXES],
    axes: usize,
    samples: u64,
    torque_sum: [f64; AXES],
}

pub(crate) fn sessions(
    file: &Path,
    table: Option<&Path>,
    figure: Option<&Path>,
    json: bool,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let paths: Vec<&Path> = table.into_iter().chain(figure).collect();
    none_exists(&paths)?;
    let ended = ended_sessions(&recording)?;
    let figure = match figure {
        Some(path) if !ended.is_empty() => {
            Some((path, sessions_figure::figure(&recording, &ended)?.render_svg()?))
        }
        _ => None,
    };
    if ended.is_empty() {
        bail!(
            "{}: no session has ended in it; `[matching]` and segments with `session = true` make \
             sessions",
            file.display()
        );
    }
    let sessions = reports_of(&recording, ended)?;
    if let Some(path) = table {
        write_new(path, as_csv(&sessions)?)?;
    }
    if let Some((path, figure)) = figure {
        write_new(path, figure)?;
    }
    let incomplete = |session: &SessionReport| {
        session.samples_missed > 0
            || session.outcome != SessionOutcome::Whole.text()
            || session.sums_differ_by.is_some_and(|share| share > ROUNDING)
    };
    let code = if sessions.iter().any(incomplete) { DATA_LOST } else { DONE };
    if json {
        writeln!(out, "{}", serde_json::to_string_pretty(&sessions)?)?;
        return Ok(code);
    }
    tell(file, &sessions, out)?;
    Ok(code)
}

/// The sessions that have ended in a recording, also one that is being written, in the order of
/// their beginnings. Any of its parts may be named.
///
/// # Errors
/// Those of reading.
pub fn session_reports(recording: &Path) -> anyhow::Result<Vec<SessionReport>> {
    let recording = AllParts::open(recording)?;
    let ended = ended_sessions(&recording)?;
    reports_of(&recording, ended)
}

fn reports_of(
    recording: &Recording,
    ended: Vec<EndedSession>,
) -> anyhow::Result<Vec<SessionReport>> {
    let mut readings: Vec<Reading> = ended.into_iter().map(Reading::new).collect();
    add_references(recording, &mut readings)?;
    add_samples(recording, &mut readings)?;
    let began_ns = recording.began_monotonic_ns();
    Ok(readings.iter().map(|reading| reading.session(began_ns)).collect())
}

/// The session in which an instant lies (ns, CLOCK_MONOTONIC).
fn at(readings: &mut [Reading], at_ns: u64) -> Option<&mut Reading> {
    let after = readings.partition_point(|reading| reading.ended.result.begun_ns <= at_ns);
    readings[..after].last_mut().filter(|reading| at_ns < reading.ended.result.ended_ns)
}

/// Adds the references that position control followed.
fn add_references(recording: &Recording, readings: &mut [Reading]) -> anyhow::Result<()> {
    let messages = recording.messages_if_any::<MotorCommand>(COMMAND.topic.name)?;
    for message in messages {
        let command = message?.message;
        let followed = Mode::from_code(command.mode).is_some_and(Mode::moves);
        if followed && let Some(reading) = at(readings, command.sample_time_ns) {
            reading.references.push((command.sample_tick, command.reference_position));
        }
    }
    for reading in readings {
        reading.references.sort_by_key(|(tick, _)| *tick);
        reading.references.dedup_by_key(|(tick, _)| *tick);
    }
    Ok(())
}

/// Adds the samples: sums of the torque again, and errors against the references.
fn add_samples(recording: &Recording, readings: &mut [Reading]) -> anyhow::Result<()> {
    let messages = recording.messages_if_any::<Sample>(SAMPLE.topic.name)?;
    let mut last_tick = None;
    for message in messages {
        let sample = message?.message;
        // A merged recording may hold a sample twice.
        if last_tick.is_some_and(|last| sample.tick <= last) {
            continue;
        }
        last_tick = Some(sample.tick);
        let Some(reading) = at(readings, sample.scan_time_ns) else { continue };
        reading.axes = usize::from(sample.axes).min(AXES);
        if let Some(torques) = sample.hand_torques() {
            reading.samples += 1;
            for (sum, torque) in reading.torque_sum.iter_mut().zip(torques) {
                *sum += torque.abs();
            }
        }
        let found = reading.references.binary_search_by_key(&sample.tick, |(tick, _)| *tick);
        if let Ok(found) = found {
            let (_, reference) = reading.references[found];
            reading.matched += 1;
            for (axis, error) in reading.errors.iter_mut().enumerate() {
                *error += (sample.master_position[axis] - reference[axis]).powi(2);
            }
        }
    }
    Ok(())
}

impl Reading {
    const fn new(ended: EndedSession) -> Self {
        Self {
            ended,
            references: Vec::new(),
            matched: 0,
            errors: [0.0; AXES],
            axes: 0,
            samples: 0,
            torque_sum: [0.0; AXES],
        }
    }

    fn session(&self, began_ns: u64) -> SessionReport {
        let result = &self.ended.result;
        let axes = if self.axes > 0 { self.axes } else { 1 };
        let bars = usize::from(result.bars).min(result.value.len());
        let mean = |sum: f64| if result.samples > 0 { sum / result.samples as f64 } else { 0.0 };
        let rms = |sum: f64| (sum / self.matched as f64).sqrt();
        SessionReport {
            number: result.number,
            of: result.sessions,
            label: self.ended.label.clone(),
            outcome: self.ended.outcome(),
            t_s: (result.begun_ns as f64 - began_ns as f64) * 1e-9,
            duration_s: result.ended_ns.saturating_sub(result.begun_ns) as f64 * 1e-9,
            planned_s: result.planned_s,
            samples: result.samples,
            samples_missed: result.samples_missed,
            mean_torque: result.torque_sum[..axes].iter().map(|sum| mean(*sum)).collect(),
            value: (bars > 0).then(|| result.value[..bars].to_vec()),
            target: (bars > 0 && result.number > 1).then(|| result.target[..bars].to_vec()),
            tracking_error: (self.matched > 0)
                .then(|| self.errors[..axes].iter().map(|sum| rms(*sum)).collect()),
            sums_differ_by: (self.samples > 0).then(|| self.difference()),
        }
    }

    /// Largest difference of the sums and the number of samples, as a share of the larger.
    fn difference(&self) -> f64 {
        let told = &self.ended.result;
        let pairs = self.torque_sum.iter().zip(&told.torque_sum);
        let samples = (self.samples as f64, told.samples as f64);
        pairs.map(|(again, told)| (*again, *told)).chain([samples]).fold(
            0.0,
            |largest: f64, (again, told)| {
                let scale = again.abs().max(told.abs());
                if scale > 0.0 { largest.max((again - told).abs() / scale) } else { largest }
            },
        )
    }
}

/// Numbers with four decimals, apart.
fn numbers(values: &[f64]) -> String {
    values.iter().map(|value| format!("{value:.4}")).collect::<Vec<_>>().join(" ")
}

fn tell(file: &Path, sessions: &[SessionReport], out: &mut dyn Write) -> anyhow::Result<()> {
    let whole = SessionOutcome::Whole.text();
    let complete = sessions.iter().filter(|session| session.outcome == whole).count();
    writeln!(out, "{}: {complete} whole sessions of {}", file.display(), sessions.len())?;
    writeln!(
        out,
        "  {:>7} {:>9} {:>9} {:>14} {:>14} {:>14} {:>9}  segment",
        "session", "begins s", "takes s", "mean torque", "to match", "value", "of it %"
    )?;
    for session in sessions {
        let of = |values: &Option<Vec<f64>>| values.as_deref().map_or("-".to_owned(), numbers);
        let share = match (&session.value, &session.target) {
            (Some(value), Some(target)) => {
                let share = |(value, target): (&f64, &f64)| match *target > 0.0 {
                    true => format!("{:.0}", 100.0 * value / target),
                    false => "-".to_owned(),
                };
                value.iter().zip(target).map(share).collect::<Vec<_>>().join(" ")
            }
            _ => "-".to_owned(),
        };
        writeln!(
            out,
            "  {:>7} {:>9.3} {:>9.3} {:>14} {:>14} {:>14} {:>9}  {}",
            session.number,
            session.t_s,
            session.duration_s,
            numbers(&session.mean_torque),
            of(&session.target),
            of(&session.value),
            share,
            session.label
        )?;
        for note in notes(session) {
            writeln!(out, "          {note}")?;
        }
    }
    Ok(())
}

/// What is to be said of a session beside its row.
fn notes(session: &SessionReport) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some(error) = &session.tracking_error {
        notes.push(format!("{} rms from the reference (rad or m)", numbers(error)));
    }
    if session.outcome != SessionOutcome::Whole.text() {
        let planned = session.planned_s;
        notes.push(format!("{}: planned were {planned:.3} s", session.outcome.to_uppercase()));
    }
    if session.samples_missed > 0 {
        let all = session.samples + session.samples_missed;
        notes.push(format!("{} of {} samples MISSING", session.samples_missed, grouped(all)));
    }
    if let Some(share) = session.sums_differ_by.filter(|share| *share > ROUNDING) {
        notes.push(format!(
            "its sums DIFFER from those of the recorded samples by {:.2} %: were some lost?",
            100.0 * share
        ));
    }
    notes
}

/// The table as CSV; the values of several axes or muscle groups have a column each.
fn as_csv(sessions: &[SessionReport]) -> anyhow::Result<Vec<u8>> {
    let mut table = csv::Writer::from_writer(Vec::new());
    let axes = sessions.iter().map(|session| session.mean_torque.len()).max().unwrap_or(1);
    let bars = sessions.iter().filter_map(|session| session.value.as_ref());
    let bars = bars.map(Vec::len).max().unwrap_or(0);
    let columns =
        |name: &str, count: usize| (0..count).map(|at| format!("{name}_{at}")).collect::<Vec<_>>();
    let mut header: Vec<String> =
        ["session", "of", "segment", "outcome", "t_s", "duration_s", "samples", "samples_missed"]
            .map(str::to_owned)
            .into();
    header.extend(columns("mean_torque", axes));
    header.extend(columns("target", bars));
    header.extend(columns("value", bars));
    header.extend(columns("tracking_error_rms", axes));
    table.write_record(&header)?;
    for session in sessions {
        let mut row = vec![
            session.number.to_string(),
            session.of.to_string(),
            session.label.clone(),
            session.outcome.to_owned(),
            format!("{:.9}", session.t_s),
            format!("{:.9}", session.duration_s),
            session.samples.to_string(),
            session.samples_missed.to_string(),
        ];
        let mut put = |values: Option<&Vec<f64>>, count: usize| {
            let value = |at: usize| values.and_then(|values| values.get(at));
            row.extend((0..count).map(|at| value(at).map_or_else(String::new, f64::to_string)));
        };
        put(Some(&session.mean_torque), axes);
        put(session.target.as_ref(), bars);
        put(session.value.as_ref(), bars);
        put(session.tracking_error.as_ref(), axes);
        table.write_record(&row)?;
    }
    Ok(table.into_inner()?)
}
