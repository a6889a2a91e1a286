//! `export --to mat`: MATLAB files of version 5, one for each session.
//!
//! As in the thesis, `time` is a column of seconds since the session began and `output` has a
//! column for each signal. Beside them: `names` and `units` of the columns, `info` (who, what,
//! when, how it ended, and the texts of rig and protocol), `events`, `bar`, every update of the
//! subject's bar, and `emg`, the electrodes filtered without delay.

use std::collections::BTreeMap;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::bail;
use ipc_types::{BARS, Event, EventKind, Performance, SessionOutcome};
use recording::column::{Column, Storage};
use recording::mcap_read::{Recording, Selection};
use recording::mcap_write::key;

use crate::DATA_LOST;
use crate::all_parts::AllParts;
use crate::ended_sessions::{EndedSession, bar_updates, ended_sessions};
use crate::mat_file::{Value, write_mat};
use crate::muscles::{Muscles, muscles};
use crate::output::{beside, new_file, none_exists};
use crate::progress::Progress;
use crate::recorded_events::recorded_events;
use crate::samples::StoredSamples;
use crate::signals::Signal;

/// Files of a session that was stopped again and again are numbered up to here.
const LAST_NUMBER: u32 = 99;

/// A stretch of a recording.
struct Stretch<'a> {
    begun_ns: u64,
    ended_ns: u64,
    session: Option<&'a EndedSession>,
}

/// Writes `NAME1.mat`, `NAME2.mat`, … for the sessions of a recording, `NAME1_1.mat`, … where it
/// has several runs, `NAME2_stopped.mat` for one that was stopped, or `NAME.mat` where it has
/// none; nothing where one of the files is there already.
pub(crate) fn export(file: &Path, name: &Path, out: &mut dyn Write) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let sessions = ended_sessions(&recording)?;
    let chosen = one_of_each(&sessions);
    let several = sessions.last().is_some_and(|last| last.run > 1);
    let mut stretches: Vec<(PathBuf, Stretch<'_>)> = chosen
        .into_iter()
        .map(|session| {
            let run = several.then_some(session.run);
            (path_of(name, run, Some(session.number()), &unfinished(session)), Stretch::of(session))
        })
        .collect();
    if stretches.is_empty() {
        let whole = Stretch { begun_ns: 0, ended_ns: u64::MAX, session: None };
        stretches.push((path_of(name, None, None, ""), whole));
    }
    let paths: Vec<&Path> = stretches.iter().map(|(path, _)| path.as_path()).collect();
    none_exists(&paths)?;
    let mut code = crate::exit_code_of_tail(&recording);
    let all = Selection::default();
    let progress = Progress::of([&recording], &all, 1, false);
    let storage = Storage::Folder(beside(name).to_owned());
    let times = stretches.iter().map(|(_, stretch)| stretch.times()).collect();
    let read = StoredSamples::read_each(&recording, times, &storage)?;
    for ((path, stretch), data) in stretches.iter().zip(read) {
        let samples = data.len();
        write(&recording, stretch, data, &storage, path)?;
        progress.beside(|| writeln!(out, "{}: {samples} samples", path.display()))?;
        let lost = |session: &EndedSession| session.result.samples_missed > 0;
        if stretch.session.is_some_and(lost) {
            code = DATA_LOST;
        }
    }
    drop(progress);
    let left_out = sessions.len().saturating_sub(stretches.len());
    if left_out > 0 {
        writeln!(out, "{left_out} left out, as they were interrupted and begun again")?;
    }
    Ok(code)
}

/// One session of each number in each run: the whole one, else the last.
fn one_of_each(sessions: &[EndedSession]) -> Vec<&EndedSession> {
    let mut chosen: Vec<&EndedSession> = Vec::new();
    for session in sessions {
        match chosen.last_mut() {
            Some(last) if (last.run, last.number()) == (session.run, session.number()) => {
                *last = session;
            }
            _ => chosen.push(session),
        }
    }
    chosen
}

/// Which session [`write_session`] writes.
#[derive(Clone, Copy, Debug)]
pub struct WantedSession {
    /// Its number in its protocol, from 1.
    pub number: u32,
    /// It began at this time or later (ns, CLOCK_MONOTONIC).
    pub since_ns: u64,
    /// Whether it ran to its end; otherwise one that was stopped will do.
    pub whole: bool,
}

/// Writes the file of one session of a recording, of which any part may be named; returns its path,
/// and `None` where the recording does not have the session, or all of its samples, yet.
///
/// # Errors
/// Where the recording cannot be read, or the file is there already.
pub fn write_session(
    file: &Path,
    wanted: WantedSession,
    name: &Path,
) -> anyhow::Result<Option<PathBuf>> {
    let recording = AllParts::open(file)?;
    let sessions = ended_sessions(&recording)?;
    let fits = |session: &&EndedSession| {
        session.number() == wanted.number
            && session.result.begun_ns >= wanted.since_ns
            && (session.is(SessionOutcome::Whole)
                || session.is(SessionOutcome::Stopped) && !wanted.whole)
    };
    let Some(session) = sessions.iter().find(fits) else { return Ok(None) };
    let stretch = Stretch::of(session);
    let storage = Storage::Folder(beside(name).to_owned());
    let data = StoredSamples::read(&recording, stretch.times(), &storage)?;
    if !data.beyond {
        return Ok(None);
    }
    let path = free_path(name, session);
    write(&recording, &stretch, data, &storage, &path)?;
    Ok(Some(path))
}

/// The file of a session: `NAME` with its number and `.mat`.
pub fn session_path(name: &Path, number: u32) -> PathBuf {
    path_of(name, None, Some(number), "")
}

/// What the name of a session's file says of one that did not run to its end, so that the file of
/// the whole session can stand beside it.
fn unfinished(session: &EndedSession) -> String {
    if session.is(SessionOutcome::Whole) {
        String::new()
    } else {
        format!("_{}", session.outcome())
    }
}

/// The path of a session's file; of one that was stopped and may be stopped again, one that is
/// free.
fn free_path(name: &Path, session: &EndedSession) -> PathBuf {
    let (number, ended) = (Some(session.number()), unfinished(session));
    let path = path_of(name, None, number, &ended);
    if ended.is_empty() {
        return path;
    }
    let others = (2..=LAST_NUMBER).map(|at| path_of(name, None, number, &format!("{ended}{at}")));
    std::iter::once(path.clone()).chain(others).find(|path| !path.exists()).unwrap_or(path)
}

/// `NAME` or `NAME.mat` with the numbers of run and session, and how it ended, before the
/// extension.
fn path_of(name: &Path, run: Option<usize>, number: Option<u32>, ended: &str) -> PathBuf {
    let mut text = name.as_os_str().to_owned();
    if name.extension().is_some_and(|extension| extension == "mat") {
        text = name.with_extension("").into_os_string();
    }
    if let Some(run) = run {
        text.push(format!("{run}_"));
    }
    if let Some(number) = number {
        text.push(number.to_string());
    }
    text.push(ended);
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

    const fn times(&self) -> Range<u64> {
        self.begun_ns..self.ended_ns
    }
}

/// Writes one file.
fn write(
    recording: &Recording,
    stretch: &Stretch<'_>,
    data: StoredSamples,
    storage: &Storage,
    path: &Path,
) -> anyhow::Result<()> {
    let muscles = muscles(recording, &data, &stretch.times(), storage)?;
    let samples = data.len();
    if samples == 0 {
        bail!("{}: no samples for {}", recording.path().display(), path.display());
    }
    let StoredSamples { rig, signals, first, times, columns, .. } = data;
    let begun_ns = if stretch.session.is_some() { stretch.begun_ns } else { first.at_ns };
    let seconds = |at_ns: u64| (at_ns as f64 - begun_ns as f64) * 1e-9;
    let mut time = Column::new(storage);
    let mut since_first = times.cursor();
    for row in 0..samples {
        time.push(seconds(first.at_ns + since_first.at(row)? as u64))?;
    }
    let texts = |of: fn(&Signal) -> &str| Value::texts(signals.iter().map(of).map(str::to_owned));
    let variables = [
        ("time", Value::Matrix(samples, vec![time])),
        ("output", Value::Matrix(samples, columns)),
        ("names", texts(|signal| &signal.name)),
        ("units", texts(|signal| &signal.unit)),
        ("info", info(recording, stretch, rig.rates.acquisition_hz, begun_ns)),
        ("events", events(recording, stretch, seconds)?),
        ("bar", bar(recording, stretch, seconds)?),
        ("emg", emg(muscles, samples)),
    ];
    let version = recording.metadata(key::VERSION).unwrap_or("?");
    let description = format!("MATLAB 5.0 MAT-file, written by farreach {version}");
    new_file(path, |out| write_mat(&description, &variables, out))
}

/// Who, what, when, and how it ended.
fn info(recording: &Recording, stretch: &Stretch<'_>, rate_hz: u32, begun_ns: u64) -> Value {
    // The protocol that was begun last before the stretch.
    let begun_before = |run: &&BTreeMap<String, String>| {
        let at_ns = run.get(key::TIME_NS).and_then(|at_ns| at_ns.parse::<u64>().ok());
        stretch.session.is_none() || at_ns.is_none_or(|at_ns| at_ns <= stretch.begun_ns)
    };
    let run = recording.runs().filter(begun_before).last();
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
        fields.extend([
            ("session", f64::from(result.number).into()),
            ("sessions", f64::from(result.sessions).into()),
            ("label", session.label.as_str().into()),
            ("outcome", session.outcome().into()),
            ("planned_s", result.planned_s.into()),
            ("samples_missed", (result.samples_missed as f64).into()),
            ("value", Value::column(result.value[..bars].to_vec())),
            ("target", Value::column(result.target[..bars].to_vec())),
        ]);
    }
    Value::Structure(fields)
}

/// The events of all processes in the stretch, in the order of time.
fn events(
    recording: &Recording,
    stretch: &Stretch<'_>,
    seconds: impl Fn(u64) -> f64,
) -> anyhow::Result<Value> {
    let found = recorded_events(recording, stretch.begun_ns..stretch.ended_ns)?;
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
    let mut updates = bar_updates(recording)?;
    // The last update coincides with the end of its session.
    updates.retain(|shown| match stretch.session {
        Some(_) => shown.begun_ns == stretch.begun_ns && shown.at_ns <= stretch.ended_ns,
        None => stretch.holds(shown.at_ns),
    });
    let bars = stretch.session.map_or(BARS, |session| usize::from(session.result.bars)).min(BARS);
    let of = |values: fn(&Performance) -> &[f64; BARS]| {
        let one = |at: usize| updates.iter().map(|shown| values(shown)[at]).collect::<Vec<_>>();
        Value::Matrix(updates.len(), (0..bars).map(|at| one(at).into()).collect())
    };
    let times = updates.iter().map(|shown| seconds(shown.at_ns)).collect();
    Ok(Value::Structure(vec![
        ("time", Value::column(times)),
        ("value", of(|shown| &shown.value)),
        ("target", of(|shown| &shown.target)),
        ("height", of(|shown| &shown.height)),
    ]))
}

/// The electrodes, as the rig file has them filtered, without delay; a column for each.
fn emg(muscles: Muscles, samples: usize) -> Value {
    Value::Structure(vec![
        ("names", Value::texts(muscles.names)),
        ("units", Value::texts(muscles.units)),
        ("muscles", Value::texts(muscles.muscles)),
        ("groups", Value::texts(muscles.groups)),
        ("filtered", Value::Matrix(samples, muscles.filtered)),
        ("envelope", Value::Matrix(samples, muscles.envelope)),
        ("maximum", Value::column(muscles.maximum)),
        ("artefact_suppressed", Value::column(muscles.suppressed)),
    ])
}
