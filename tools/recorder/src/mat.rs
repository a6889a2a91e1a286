//! `export --to mat`: MATLAB files of version 5, one for each session.
//!
//! As in the thesis, `time` is a column of seconds since the session began and `output` has a
//! column for each signal. Beside them: `names` and `units` of the columns, `info` (who, what,
//! when, how it ended, and the texts of rig and protocol), `events`, and `bar`, every update of the
//! subject's bar.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use ipc_types::{
    BARS, Event, EventKind, Message, PERFORMANCE, PROCESSES, Performance, SAMPLE, Sample,
    SessionOutcome, event_topic,
};
use recording::mcap_read::{ReadError, Recording};
use recording::mcap_write::key;

use crate::ended_sessions::{EndedSession, ended_sessions};
use crate::mat_file::{Value, encode};
use crate::output::write_new;
use crate::signals::{Signal, rig_file, signals};
use crate::{DATA_LOST, DONE};

/// A stretch of a recording.
struct Stretch<'a> {
    begun_ns: u64,
    ended_ns: u64,
    session: Option<&'a EndedSession>,
}

/// Writes `NAME1.mat`, `NAME2.mat`, … for the sessions of a recording, or `NAME.mat` for one
/// without; nothing where one of the files is there already.
pub(crate) fn export(file: &Path, name: &Path, out: &mut dyn Write) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let sessions = ended_sessions(&recording)?;
    let last_of = |number: u32| sessions.iter().rev().find(|session| session.number() == number);
    let mut numbers: Vec<u32> = sessions.iter().map(EndedSession::number).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let mut stretches: Vec<(PathBuf, Stretch<'_>)> = numbers
        .into_iter()
        .filter_map(|number| Some((path_of(name, Some(number)), Stretch::of(last_of(number)?))))
        .collect();
    if stretches.is_empty() {
        let whole = Stretch { begun_ns: 0, ended_ns: u64::MAX, session: None };
        stretches.push((path_of(name, None), whole));
    }
    if let Some((taken, _)) = stretches.iter().find(|(path, _)| path.exists()) {
        bail!("{}: it is there already; files are never overwritten", taken.display());
    }
    let mut code = crate::exit_code_of_tail(&recording);
    for (path, stretch) in &stretches {
        let samples = write(&recording, stretch, path)?;
        writeln!(out, "{}: {samples} samples", path.display())?;
        let lost = |session: &EndedSession| session.result.samples_missed > 0;
        if stretch.session.is_some_and(lost) {
            code = DATA_LOST;
        }
    }
    if code == DONE && sessions.len() > stretches.len() {
        writeln!(out, "of sessions that were repeated the last one")?;
    }
    Ok(code)
}

/// Writes the file of one session, the last of that number that ended; returns its path, and `None`
/// where the recording does not have the session yet.
///
/// # Errors
/// Where the recording cannot be read, or the file is there already.
pub fn write_session(file: &Path, number: u32, name: &Path) -> anyhow::Result<Option<PathBuf>> {
    let recording = Recording::open(file)?;
    let sessions = ended_sessions(&recording)?;
    let Some(session) = sessions.iter().rev().find(|session| session.number() == number) else {
        return Ok(None);
    };
    let path = path_of(name, Some(number));
    write(&recording, &Stretch::of(session), &path)?;
    Ok(Some(path))
}

/// The file of a session: `NAME` with its number and `.mat`.
pub fn session_path(name: &Path, number: u32) -> PathBuf {
    path_of(name, Some(number))
}

/// `NAME` or `NAME.mat` with a number before the extension.
fn path_of(name: &Path, number: Option<u32>) -> PathBuf {
    let mut text = name.as_os_str().to_owned();
    if name.extension().is_some_and(|extension| extension == "mat") {
        text = name.with_extension("").into_os_string();
    }
    if let Some(number) = number {
        text.push(number.to_string());
    }
    text.push(".mat");
    text.into()
}

impl<'a> Stretch<'a> {
    const fn of(session: &'a EndedSession) -> Self {
        let (begun_ns, ended_ns) = (session.result.begun_ns, session.result.ended_ns);
        Self { begun_ns, ended_ns, session: Some(session) }
    }

    const fn holds(&self, at_ns: u64) -> bool {
        self.begun_ns <= at_ns && at_ns < self.ended_ns
    }
}

/// Writes one file; returns the number of samples.
fn write(recording: &Recording, stretch: &Stretch<'_>, path: &Path) -> anyhow::Result<usize> {
    let rig = rig_file(recording)?;
    let signals = signals(&rig);
    let (mut times_ns, mut columns) = (Vec::new(), vec![Vec::new(); signals.len()]);
    for message in recording.messages::<Sample>(SAMPLE.topic.name)? {
        let sample = message?.message;
        let repeated = times_ns.last().is_some_and(|last| sample.scan_time_ns <= *last);
        if repeated || !stretch.holds(sample.scan_time_ns) {
            continue;
        }
        times_ns.push(sample.scan_time_ns);
        for (column, signal) in columns.iter_mut().zip(&signals) {
            column.push(signal.value(&sample));
        }
    }
    let Some(first_ns) = times_ns.first().copied() else {
        bail!("{}: no samples in it", recording.path().display());
    };
    let begun_ns = if stretch.session.is_some() { stretch.begun_ns } else { first_ns };
    let seconds = |at_ns: u64| (at_ns as f64 - begun_ns as f64) * 1e-9;
    let time: Vec<f64> = times_ns.iter().map(|at_ns| seconds(*at_ns)).collect();
    let samples = time.len();
    let texts = |of: fn(&Signal) -> &str| Value::texts(signals.iter().map(of).map(str::to_owned));
    let variables = [
        ("time", Value::column(time)),
        ("output", Value::Matrix(samples, columns)),
        ("names", texts(|signal| &signal.name)),
        ("units", texts(|signal| &signal.unit)),
        ("info", info(recording, stretch, rig.rates.acquisition_hz, begun_ns)),
        ("events", events(recording, stretch, seconds)?),
        ("bar", bar(recording, stretch, seconds)?),
    ];
    let version = recording.metadata(key::VERSION).unwrap_or("?");
    let description = format!("MATLAB 5.0 MAT-file, written by farreach {version}");
    write_new(path, encode(&description, &variables)?)?;
    Ok(samples)
}

/// Who, what, when, and how it ended.
fn info(recording: &Recording, stretch: &Stretch<'_>, rate_hz: u32, begun_ns: u64) -> Value {
    let run = recording.runs().last();
    let of = |name: &str| {
        let entry = run.and_then(|run| run.get(name).map(String::as_str));
        entry.or_else(|| recording.metadata(name)).unwrap_or_default()
    };
    let offset_ns = recording.realtime_offset_ns().unwrap_or(0);
    let began = begun_ns.checked_add_signed(offset_ns).map(|at_ns| {
        let at = std::time::UNIX_EPOCH + std::time::Duration::from_nanos(at_ns);
        humantime::format_rfc3339_millis(at).to_string()
    });
    let mut fields = vec![
        ("rig", of(key::RIG).into()),
        ("subject", of(key::SUBJECT).into()),
        ("protocol", of(key::PROTOCOL).into()),
        ("began", began.unwrap_or_default().as_str().into()),
        ("sample_rate_hz", f64::from(rate_hz).into()),
        ("version", of(key::VERSION).into()),
        ("rig_file", of(key::RIG_FILE).into()),
        ("protocol_file", of(key::PROTOCOL_FILE).into()),
    ];
    if let Some(session) = stretch.session {
        let result = &session.result;
        let bars = usize::from(result.bars).min(result.value.len());
        let outcome = SessionOutcome::from_code(result.outcome).map_or("unknown", |o| o.text());
        fields.extend([
            ("session", f64::from(result.number).into()),
            ("sessions", f64::from(result.sessions).into()),
            ("label", session.label.as_str().into()),
            ("outcome", outcome.into()),
            ("planned_s", result.planned_s.into()),
            ("samples_missed", (result.samples_missed as f64).into()),
            ("value", Value::column(result.value[..bars].to_vec())),
            ("target", Value::column(result.target[..bars].to_vec())),
        ]);
    }
    Value::Structure(fields)
}

/// The messages of a topic, where the recording has it.
fn each<T: Message>(
    recording: &Recording,
    topic: &str,
    mut take: impl FnMut(T),
) -> anyhow::Result<()> {
    let messages = match recording.messages::<T>(topic) {
        Err(ReadError::NoTopic { .. }) => return Ok(()),
        messages => messages?,
    };
    for message in messages {
        take(message?.message);
    }
    Ok(())
}

/// The events of all processes in the stretch, in the order of time.
fn events(
    recording: &Recording,
    stretch: &Stretch<'_>,
    seconds: impl Fn(u64) -> f64,
) -> anyhow::Result<Value> {
    let mut found: Vec<Event> = Vec::new();
    for topic in PROCESSES.iter().filter_map(|entry| event_topic(entry.process)) {
        each(recording, topic.topic.name, |event: Event| {
            if stretch.holds(event.time_ns) {
                found.push(event);
            }
        })?;
    }
    found.sort_by_key(|event| event.time_ns);
    found.dedup_by_key(|event| (event.incarnation, event.sequence, event.source));
    let kind = |event: &Event| EventKind::from_code(event.kind).map_or("unknown", |k| k.text());
    let numbers = |of: &dyn Fn(&Event) -> f64| Value::column(found.iter().map(of).collect());
    Ok(Value::Structure(vec![
        ("time", numbers(&|event| seconds(event.time_ns))),
        ("kind", Value::texts(found.iter().map(kind))),
        ("text", Value::texts(found.iter().map(Event::text))),
        ("a", numbers(&|event| event.a)),
        ("b", numbers(&|event| event.b)),
        ("c", numbers(&|event| event.c)),
    ]))
}

/// Every update of the bar in the stretch; a column for each bar.
fn bar(
    recording: &Recording,
    stretch: &Stretch<'_>,
    seconds: impl Fn(u64) -> f64,
) -> anyhow::Result<Value> {
    let mut updates: Vec<Performance> = Vec::new();
    each(recording, PERFORMANCE.topic.name, |shown: Performance| {
        let same =
            |last: &Performance| (last.begun_ns, last.update) == (shown.begun_ns, shown.update);
        // The last update coincides with the end of its session.
        let within = match stretch.session {
            Some(_) => shown.begun_ns == stretch.begun_ns && shown.at_ns <= stretch.ended_ns,
            None => stretch.holds(shown.at_ns),
        };
        if within && shown.update > 0 && !updates.last().is_some_and(same) {
            updates.push(shown);
        }
    })?;
    let bars = stretch.session.map_or(BARS, |session| usize::from(session.result.bars)).min(BARS);
    let of = |values: fn(&Performance) -> &[f64; BARS]| {
        let one = |at: usize| updates.iter().map(|shown| values(shown)[at]).collect();
        Value::Matrix(updates.len(), (0..bars).map(one).collect())
    };
    let times = updates.iter().map(|shown| seconds(shown.at_ns)).collect();
    Ok(Value::Structure(vec![
        ("time", Value::column(times)),
        ("value", of(|shown| &shown.value)),
        ("target", of(|shown| &shown.target)),
        ("height", of(|shown| &shown.height)),
    ]))
}
