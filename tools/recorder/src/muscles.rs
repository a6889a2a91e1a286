//! The electrodes of a stretch of a recording, filtered without delay.

use std::io;
use std::ops::Range;

use anyhow::Context;
use emg::{InVolume, Signal, ZeroPhase, offline_artefact_of};
use ipc_types::{ANALOG, EMG_MAXIMUM, EmgMaximum};
use recording::column::{Column, Storage};
use recording::mcap_read::Recording;
use rig::{Channel, ChannelKind, RigFile};
use scanner::{TimingLine, VolumeTime};

use crate::samples::StoredSamples;
use crate::signals::Source;
use crate::volumes::volume_times;

/// Volumes beyond those of the average that are read on each side of a stretch: the first one may
/// not be whole, and three are needed for any.
const MORE_VOLUMES: u32 = 4;
/// Intervals between volumes that differ by more from the usual one are pauses, as a share.
const REGULAR: f64 = 0.01;
/// Pulses that lie farther from a regular scanner are not jitter: the scanner paused (s).
const JITTER_S: f64 = 0.02;

/// The muscles' signals; a column for each electrode.
#[derive(Default)]
pub(crate) struct Muscles {
    /// Names and units of the channels, the muscles and their groups.
    pub(crate) names: Vec<String>,
    pub(crate) units: Vec<String>,
    pub(crate) muscles: Vec<String>,
    pub(crate) groups: Vec<&'static str>,
    /// After suppression of the gradient artefact, band-pass and notch.
    pub(crate) filtered: Vec<Column>,
    /// Envelopes of their magnitudes.
    pub(crate) envelope: Vec<Column>,
    /// Maxima in voluntary contractions; NaN where there are none.
    pub(crate) maximum: Vec<f64>,
    /// For each electrode the share of the samples from which an artefact was subtracted.
    pub(crate) suppressed: Vec<f64>,
}

/// The volumes of a scan about a stretch of samples.
struct Scan {
    repetition_s: f64,
    /// When each began (ns, CLOCK_MONOTONIC).
    volumes: Vec<u64>,
}

impl Scan {
    /// The place of an instant in its volume.
    fn place(&self, at_ns: u64) -> Option<InVolume> {
        let next = self.volumes.partition_point(|volume| *volume <= at_ns);
        let begun_ns = *self.volumes.get(next.checked_sub(1)?)?;
        let since_s = (at_ns - begun_ns) as f64 * 1e-9;
        // After the last volume, and before a pause, one is as long as the others.
        let length_s = self.volumes.get(next).map(|end_ns| (end_ns - begun_ns) as f64 * 1e-9);
        let regular = |length_s: &f64| (length_s / self.repetition_s - 1.0).abs() < REGULAR;
        let until_s = length_s.filter(regular).unwrap_or(self.repetition_s) - since_s;
        (until_s > 0.0).then_some(InVolume { since_s, until_s })
    }
}

/// A signal whose values are in a column.
struct Kept(Column);

impl Signal for Kept {
    type Error = io::Error;

    fn empty(&self) -> Self {
        Self(self.0.another())
    }

    fn length(&self) -> usize {
        self.0.len()
    }

    fn push(&mut self, value: f64) -> io::Result<()> {
        self.0.push(value)
    }

    fn reader(&self) -> impl FnMut(usize) -> io::Result<f64> {
        let mut cursor = self.0.cursor();
        move |at| cursor.at(at)
    }
}

/// Filters the electrodes as the rig file says, in the samples that were taken in `times` (ns,
/// CLOCK_MONOTONIC), and these alone are returned. A value that is not finite is NaN, and in the
/// filters the one before it; a sample that is missing is left out.
///
/// # Errors
/// Where samples or volumes cannot be read, or a filter not be made, and those of the storage.
pub(crate) fn muscles(
    recording: &Recording,
    samples: &StoredSamples,
    times: &Range<u64>,
    storage: &Storage,
) -> anyhow::Result<Muscles> {
    let how = &samples.rig.emg;
    let scan = match how.artefact_volumes {
        0 => None,
        volumes => around(recording, samples, times, volumes + MORE_VOLUMES, storage)?,
    };
    let (samples, scan) = match &scan {
        Some((wide, scan)) => (wide, Some(scan)),
        None => (samples, None),
    };
    let kept = samples.first_at(times.start)?..samples.first_at(times.end)?;
    let rate_hz = f64::from(samples.rig.rates.acquisition_hz);
    let maxima = maxima(recording, times.end)?;
    let mut found = Muscles::default();
    for (signal, column) in samples.signals.iter().zip(&samples.columns) {
        let Source::Analog(input, _) = signal.source else { continue };
        let Some(channel) = electrode(&samples.rig, input) else { continue };
        let filters = ZeroPhase::new(how, rate_hz).context("[emg] of the rig file")?;
        let artefact = scan.map(|scan| artefact(samples, scan, column, rate_hz)).transpose()?;
        let (values, suppressed) = without(column, artefact.as_ref(), &kept)?;
        drop(artefact);
        let (filtered, envelope) = filters.run(&values)?;
        drop(values);
        found.filtered.push(where_read(&filtered.0, column, &kept)?);
        found.envelope.push(where_read(&envelope.0, column, &kept)?);
        found.suppressed.push(suppressed as f64 / kept.len().max(1) as f64);
        let maximum = maxima.get(input).copied().filter(|maximum| *maximum > 0.0);
        found.maximum.push(maximum.unwrap_or(f64::NAN));
        found.names.push(channel.name.clone());
        found.units.push(channel.unit.clone());
        found.muscles.push(channel.muscle.clone());
        found.groups.push(channel.group.map_or("", emg::Group::word));
    }
    Ok(found)
}

/// The scanner's artefact in a column; NaN where there is none.
fn artefact(
    samples: &StoredSamples,
    scan: &Scan,
    column: &Column,
    rate_hz: f64,
) -> io::Result<Kept> {
    let mut times = samples.times.cursor();
    let place = |at| -> io::Result<Option<InVolume>> {
        Ok(scan.place(samples.first.at_ns + times.at(at)? as u64))
    };
    let values = Kept(copy(column)?);
    let volumes = samples.rig.emg.artefact_volumes;
    offline_artefact_of(volumes, rate_hz, scan.repetition_s, &values, place)
}

fn copy(column: &Column) -> io::Result<Column> {
    let mut copied = column.another();
    let mut values = column.cursor();
    for at in 0..column.len() {
        copied.push(values.at(at)?)?;
    }
    Ok(copied)
}

/// A column without its artefact, each value that is not finite being the one before it; and the
/// number of those of the `kept` ones from which an artefact was subtracted.
fn without(
    column: &Column,
    artefact: Option<&Kept>,
    kept: &Range<usize>,
) -> io::Result<(Kept, usize)> {
    let (mut values, mut artefact) = (column.cursor(), artefact.map(|own| own.0.cursor()));
    let (mut clean, mut before, mut suppressed) = (column.another(), 0.0, 0);
    for at in 0..column.len() {
        let mut value = values.at(at)?;
        if let Some(artefact) = &mut artefact {
            let own = artefact.at(at)?;
            if !own.is_nan() {
                value -= own;
                suppressed += usize::from(kept.contains(&at));
            }
        }
        if value.is_finite() {
            before = value;
        }
        clean.push(before)?;
    }
    Ok((Kept(clean), suppressed))
}

/// The kept values; NaN where the card's was not finite.
fn where_read(values: &Column, card: &Column, kept: &Range<usize>) -> io::Result<Column> {
    let mut found = values.another();
    let (mut values, mut card) = (values.cursor(), card.cursor());
    for at in kept.clone() {
        let value = values.at(at)?;
        found.push(if card.at(at)?.is_finite() { value } else { f64::NAN })?;
    }
    Ok(found)
}

/// The maxima of the electrodes before a time (ns, CLOCK_MONOTONIC), by input: those that a
/// protocol used last, or the largest of the last run that measured; 0 where there are none.
fn maxima(recording: &Recording, until_ns: u64) -> anyhow::Result<[f64; ANALOG]> {
    let mut newest = [0.0_f64; ANALOG];
    let mut last = 0;
    for message in recording.messages_if_any::<EmgMaximum>(EMG_MAXIMUM.topic.name)? {
        let found = message?.message;
        if found.ended_ns > until_ns {
            continue;
        }
        // Those that are used, and each run that measures, take the place of what was before.
        if found.used != 0 || found.number <= last {
            newest = [0.0; ANALOG];
        }
        last = if found.used != 0 { u32::MAX } else { found.number };
        let measured = |at: &usize| found.inputs & 1 << at != 0;
        for at in (0..ANALOG).filter(measured) {
            newest[at] = newest[at].max(found.maximum[at]);
        }
    }
    Ok(newest)
}

fn electrode(rig: &RigFile, input: usize) -> Option<&Channel> {
    rig.channel_at(input).filter(|channel| channel.kind == ChannelKind::Emg)
}

/// The samples of a stretch and of so many volumes before and after it, with the scan; `None` where
/// there is no scan, or no electrode.
fn around(
    recording: &Recording,
    samples: &StoredSamples,
    times: &Range<u64>,
    more: u32,
    storage: &Storage,
) -> anyhow::Result<Option<(StoredSamples, Scan)>> {
    if samples.rig.channels.iter().all(|channel| channel.kind != ChannelKind::Emg) {
        return Ok(None);
    }
    let widest_ns = (f64::from(more) * emg::LONGEST_REPETITION_S * 1e9) as u64;
    let wide = |by_ns: u64| times.start.saturating_sub(by_ns)..times.end.saturating_add(by_ns);
    let volumes = regular(
        volume_times(recording, &wide(widest_ns))?.into_iter().map(|(_, at_ns)| at_ns).collect(),
    );
    let Some(repetition_s) = repetition_s(&volumes) else { return Ok(None) };
    let margin_ns = (f64::from(more) * repetition_s * 1e9) as u64;
    let wide = StoredSamples::read(recording, wide(margin_ns), storage)?;
    Ok(Some((wide, Scan { repetition_s, volumes })))
}

/// The beginnings of volumes without the jitter of their pulses, where all of them lie along a
/// line: the scanner's own clock is regular.
fn regular(volumes: Vec<u64>) -> Vec<u64> {
    let times: Vec<VolumeTime> =
        volumes.iter().map(|at_ns| VolumeTime { at_ns: *at_ns, interpolated: false }).collect();
    let Some(line) = TimingLine::through(&times) else { return volumes };
    let off_s = |(at, time): (usize, &VolumeTime)| line.deviation_s(at, time);
    if times.iter().enumerate().map(off_s).any(|off_s| off_s.abs() > JITTER_S) {
        return volumes;
    }
    let begun = |(at, time): (usize, &VolumeTime)| {
        time.at_ns.saturating_add_signed((-1e9 * line.deviation_s(at, time)).round() as i64)
    };
    times.iter().enumerate().map(begun).collect()
}

/// The mean of the intervals between volumes that are as long as the usual one (s).
fn repetition_s(volumes: &[u64]) -> Option<f64> {
    let mut intervals: Vec<f64> =
        volumes.windows(2).map(|pair| pair[1].saturating_sub(pair[0]) as f64 * 1e-9).collect();
    let middle = intervals.len().checked_sub(1)? / 2;
    let usual = *intervals.select_nth_unstable_by(middle, f64::total_cmp).1;
    let regular = |interval: &&f64| (**interval / usual - 1.0).abs() < REGULAR;
    let (sum, count) = intervals
        .iter()
        .filter(regular)
        .fold((0.0, 0.0), |(sum, count), interval| (sum + interval, count + 1.0));
    (count > 0.0).then(|| sum / count)
}
