//! `volumes`: the scans of a recording.

use std::collections::BTreeMap;
use std::io::Write;
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, bail};
use ipc_types::{LineEvent, SCANNER, SCANNER_KEY, ScannerPulse, VOLUME, Volume, VolumeSource};
use recording::mcap_read::Recording;
use report::{Colour, Figure};
use scanner::{Counts, REPETITION_S, Series, TimingLine, VolumeTime, between, reconcile};
use serde::Serialize;

use crate::inspect::grouped;
use crate::output::{none_exists, write_new};
use crate::{DATA_LOST, DONE};

/// Files to write beside the result.
pub(crate) struct Files<'a> {
    pub(crate) table: Option<&'a Path>,
    pub(crate) figure: Option<&'a Path>,
}

/// One scan: its volumes, from the first to the last that was seen.
#[derive(Serialize)]
struct Scan {
    /// Volumes expected; 0 where nobody said.
    expected: u64,
    #[serde(flatten)]
    counts: Counts,
    /// Whether the scanner was emulated.
    emulated: bool,
    /// Mean repetition time (s); `null` for less than two volumes, or a scanner that was started
    /// anew.
    repetition_s: Option<f64>,
    /// Root mean square of the pulses' distances from a regular scanner (s).
    jitter_s: Option<f64>,
    rows: Vec<Row>,
    #[serde(skip)]
    times: Vec<VolumeTime>,
}

/// One volume.
#[derive(Serialize)]
struct Row {
    volume: u64,
    /// Time since the recording began (s).
    t_s: f64,
    /// How much later it began than with a regular scanner (s); `null` for less than two volumes.
    deviation_s: Option<f64>,
    source: &'static str,
}

pub(crate) fn volumes(
    file: &Path,
    anew: Option<(Series, Option<PulseInput>)>,
    files: &Files<'_>,
    json: bool,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let (shortest, longest) = REPETITION_S;
    let scans = match anew {
        Some((series, input)) if (shortest..=longest).contains(&series.repetition_s) => {
            numbered_anew(&recording, series, input)?
        }
        Some((series, _)) => bail!(
            "--repetition: expected a time from {shortest} to {longest} s, found {}; it is the \
             scanner's TR",
            series.repetition_s
        ),
        None => counted(&recording)?,
    };
    if scans.is_empty() {
        let [line, keys] = PulseInput::ALL.map(|input| pulses(&recording, input));
        let pulses = line?.len() + keys?.len();
        bail!(
            "{}: no protocol counted volumes, and {pulses} pulses of the scanner were recorded; \
             number them with `--repetition TR`",
            file.display()
        );
    }
    let paths: Vec<&Path> = files.table.into_iter().chain(files.figure).collect();
    none_exists(&paths)?;
    if let Some(path) = files.table {
        write_new(path, table(&scans)?)?;
    }
    if let Some(path) = files.figure {
        write_new(path, figure(&scans).render_svg()?)?;
    }
    let incomplete = |scan: &Scan| scan.counts.missed > 0 || scan.counted() < scan.expected;
    let code = if scans.iter().any(incomplete) { DATA_LOST } else { DONE };
    if json {
        writeln!(out, "{}", serde_json::to_string_pretty(&scans)?)?;
        return Ok(code);
    }
    for (at, scan) in scans.iter().enumerate() {
        tell(file, at, scan, out)?;
    }
    Ok(code)
}

/// Where recorded pulses came in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum PulseInput {
    /// The trigger line.
    Line,
    /// The key 5.
    Key,
}

impl PulseInput {
    const ALL: [Self; 2] = [Self::Line, Self::Key];
}

/// The pulses of an input, in the order of their times; none where the topic is missing.
fn pulses(recording: &Recording, input: PulseInput) -> anyhow::Result<Vec<u64>> {
    let topic = match input {
        PulseInput::Line => &SCANNER.topic,
        PulseInput::Key => &SCANNER_KEY.topic,
    };
    let mut times = Vec::new();
    for message in recording.messages_if_any::<ScannerPulse>(topic.name)? {
        let pulse = message?.message;
        if pulse.kind == LineEvent::Pulse.code() {
            times.push(pulse.at_ns);
        }
    }
    times.sort_unstable();
    times.dedup();
    Ok(times)
}

/// Numbers the pulses of an input; of the only one that has some where none is named.
fn numbered_anew(
    recording: &Recording,
    series: Series,
    input: Option<PulseInput>,
) -> anyhow::Result<Vec<Scan>> {
    let times = match input {
        Some(input) => pulses(recording, input)?,
        None => match [pulses(recording, PulseInput::Line)?, pulses(recording, PulseInput::Key)?] {
            [line, keys] if line.is_empty() => keys,
            [line, keys] if keys.is_empty() => line,
            [line, keys] => bail!(
                "{}: {} pulses of the trigger line and {} keys were recorded: choose with \
                 `--pulses line` or `--pulses key`",
                recording.path().display(),
                line.len(),
                keys.len()
            ),
        },
    };
    let found = reconcile(times, series);
    if found.volumes.is_empty() {
        return Ok(Vec::new());
    }
    let row = |volume: &VolumeTime| match volume.interpolated {
        true => (volume.at_ns, VolumeSource::Interpolated),
        false => (volume.at_ns, VolumeSource::Pulse),
    };
    let rows: Vec<_> = found.volumes.iter().map(row).collect();
    let expected = series.volumes.unwrap_or(0);
    Ok(vec![Scan::new(expected, found.counts, 0, &rows, recording.began_monotonic_ns())])
}

/// The scans that protocols counted, in the order of time.
fn counted(recording: &Recording) -> anyhow::Result<Vec<Scan>> {
    let messages = recording.messages_if_any::<Volume>(VOLUME.topic.name)?;
    // After a restart of the experiment process the newer message of a volume is right, and where
    // a later pulse took the place of an earlier one.
    let mut scans: Vec<BTreeMap<u64, Volume>> = Vec::new();
    for message in messages {
        let volume = message?.message;
        let begins = volume.index == 0 && volume.volumes == 1;
        match scans.last_mut().filter(|scan| !begins || repeats(scan, &volume)) {
            Some(scan) => scan.insert(volume.index, volume),
            None => {
                scans.push(BTreeMap::new());
                scans.last_mut().and_then(|scan| scan.insert(volume.index, volume))
            }
        };
    }
    let began_ns = recording.began_monotonic_ns();
    let scan = |volumes: &BTreeMap<u64, Volume>| -> anyhow::Result<Option<Scan>> {
        let Some(newest) = volumes.values().max_by_key(|volume| volume.time_ns) else {
            return Ok(None);
        };
        let counts = Counts {
            volumes: newest.volumes,
            missed: newest.missed,
            spurious: newest.spurious,
            surplus: newest.surplus,
            restarts: newest.restarts,
        };
        let (first, rows) = without_holes(volumes)
            .with_context(|| format!("{}: topic volume", recording.path().display()))?;
        Ok(Some(Scan::new(newest.expected, counts, first, &rows, began_ns)))
    };
    scans.iter().filter_map(|volumes| scan(volumes).transpose()).collect()
}

/// Number and beginning (ns, CLOCK_MONOTONIC) of each volume that a protocol counted in `times`.
///
/// # Errors
/// Those of reading.
pub(crate) fn volume_times(
    recording: &Recording,
    times: &Range<u64>,
) -> anyhow::Result<Vec<(u64, u64)>> {
    let scans = counted(recording)?;
    let all = scans.iter().flat_map(|scan| scan.rows.iter().zip(&scan.times));
    let volumes = all.map(|(row, time)| (row.volume, time.at_ns));
    Ok(volumes.filter(|(_, at_ns)| times.contains(at_ns)).collect())
}

/// The volumes from the first on, with its number: of many without a pulse in a row not each has a
/// message.
fn without_holes(
    volumes: &BTreeMap<u64, Volume>,
) -> anyhow::Result<(u64, Vec<(u64, VolumeSource)>)> {
    let first = volumes.keys().next().copied().unwrap_or(0);
    let mut rows: Vec<(u64, VolumeSource)> = Vec::with_capacity(volumes.len());
    for (index, volume) in volumes {
        let hole = index - first - rows.len() as u64;
        let before_ns = rows.last().map_or(volume.at_ns, |(at_ns, _)| *at_ns);
        let (shortest_s, _) = REPETITION_S;
        let possible = volume.at_ns.saturating_sub(before_ns) as f64 * 1e-9 / shortest_s;
        if hole as f64 > possible {
            bail!("volume {index}: {hole} volumes cannot lie between it and the one before it");
        }
        let times = between(before_ns, volume.at_ns, hole);
        rows.extend(times.map(|at_ns| (at_ns, VolumeSource::Interpolated)));
        let source = VolumeSource::from_code(volume.source).unwrap_or(VolumeSource::Pulse);
        rows.push((volume.at_ns, source));
    }
    Ok((first, rows))
}

/// Whether a first volume is one that the scan has already.
fn repeats(scan: &BTreeMap<u64, Volume>, volume: &Volume) -> bool {
    scan.get(&0).is_some_and(|first| first.at_ns == volume.at_ns)
}

impl Scan {
    /// Volumes up to the last one with a pulse.
    const fn counted(&self) -> u64 {
        self.counts.volumes + self.counts.missed
    }

    fn new(
        expected: u64,
        counts: Counts,
        first: u64,
        volumes: &[(u64, VolumeSource)],
        began_ns: u64,
    ) -> Self {
        let time = |(at_ns, source): &(u64, VolumeSource)| VolumeTime {
            at_ns: *at_ns,
            interpolated: *source == VolumeSource::Interpolated,
        };
        let times: Vec<VolumeTime> = volumes.iter().map(time).collect();
        // A line through two starts of the scanner would tell nothing.
        let timing = TimingLine::through(&times).filter(|_| counts.restarts == 0);
        let row = |(at, (at_ns, source)): (usize, &(u64, VolumeSource))| Row {
            volume: first + at as u64,
            t_s: (*at_ns as f64 - began_ns as f64) * 1e-9,
            deviation_s: timing
                .zip(times.get(at))
                .map(|(timing, time)| timing.deviation_s(at, time)),
            source: source.text(),
        };
        Self {
            expected,
            counts,
            emulated: volumes.iter().any(|(_, source)| *source == VolumeSource::Emulated),
            repetition_s: timing.map(|timing| timing.repetition_s),
            jitter_s: timing.map(|timing| timing.jitter_s),
            rows: volumes.iter().enumerate().map(row).collect(),
            times,
        }
    }
}

fn tell(file: &Path, at: usize, scan: &Scan, out: &mut dyn Write) -> anyhow::Result<()> {
    let number = |count: u64, one: &str, many: &str| {
        format!("{} {}", grouped(count), if count == 1 { one } else { many })
    };
    let expected = match scan.expected {
        0 => String::new(),
        expected => format!(" of {}", grouped(expected)),
    };
    let has = |source: VolumeSource| scan.rows.iter().any(|row| row.source == source.text());
    let source = match (scan.emulated, has(VolumeSource::Key)) {
        (true, _) => " (emulated)",
        (_, true) => " (key 5)",
        _ => "",
    };
    writeln!(
        out,
        "{}: scan {}{source}: {}{expected} volumes",
        file.display(),
        at + 1,
        grouped(scan.counted())
    )?;
    if let (Some(first), Some(last)) = (scan.rows.first(), scan.rows.last()) {
        writeln!(out, "  from {:.4} s to {:.4} s", first.t_s, last.t_s)?;
    }
    if let (Some(repetition_s), Some(jitter_s)) = (scan.repetition_s, scan.jitter_s) {
        let jitter_ms = 1e3 * jitter_s;
        writeln!(out, "  repetition time {repetition_s:.6} s, jitter {jitter_ms:.3} ms rms")?;
    }
    if scan.counts.missed > 0 {
        let interpolated = VolumeSource::Interpolated.text();
        let which: Vec<String> = scan
            .rows
            .iter()
            .filter(|row| row.source == interpolated)
            .map(|row| row.volume.to_string())
            .collect();
        let what = number(scan.counts.missed, "volume had", "volumes had");
        writeln!(out, "  {what} no pulse, times interpolated: {}", which.join(", "))?;
    }
    for (count, what) in [
        (
            scan.counts.spurious,
            number(scan.counts.spurious, "pulse belongs", "pulses belong") + " to no volume",
        ),
        (
            scan.counts.surplus,
            number(scan.counts.surplus, "pulse", "pulses") + " after the last volume",
        ),
        (
            scan.counts.restarts,
            "the scanner was started anew: ".to_owned() + &grouped(scan.counts.restarts),
        ),
    ] {
        if count > 0 {
            writeln!(out, "  {what}")?;
        }
    }
    let end = scan.counted();
    if end < scan.expected {
        writeln!(out, "  {} at the end were not seen", grouped(scan.expected - end))?;
    }
    Ok(())
}

/// The volumes of all scans as CSV.
fn table(scans: &[Scan]) -> anyhow::Result<Vec<u8>> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(["scan", "volume", "t_s", "deviation_s", "source"])?;
    for (at, scan) in scans.iter().enumerate() {
        for row in &scan.rows {
            let deviation = row.deviation_s.map_or_else(String::new, |value| format!("{value:.9}"));
            table.write_record([
                (at + 1).to_string(),
                row.volume.to_string(),
                format!("{:.9}", row.t_s),
                deviation,
                row.source.to_owned(),
            ])?;
        }
    }
    Ok(table.into_inner()?)
}

/// How far each volume was off a regular scanner.
fn figure(scans: &[Scan]) -> Figure {
    let mut figure = Figure::new("Volumes against a regular scanner", "volume", "deviation / ms")
        .horizontal(Colour::Grey, "", 0.0);
    // Scans follow each other along the axis.
    let mut first = 0.0;
    for (at, scan) in scans.iter().enumerate() {
        let name = |what: &str| match scans.len() {
            1 => what.to_owned(),
            _ => format!("scan {}, {what}", at + 1),
        };
        for (interpolated, what, colour) in
            [(false, "pulse", Colour::Blue), (true, "no pulse", Colour::Vermillion)]
        {
            let rows = scan.rows.iter().zip(&scan.times);
            let (x, y): (Vec<f64>, Vec<f64>) = rows
                .filter(|(_, time)| time.interpolated == interpolated)
                .filter_map(|(row, _)| Some((first + row.volume as f64, 1e3 * row.deviation_s?)))
                .unzip();
            if !x.is_empty() {
                figure = figure.scatter(colour, name(what), &x, &y);
            }
        }
        first += scan.rows.len() as f64;
    }
    figure
}
