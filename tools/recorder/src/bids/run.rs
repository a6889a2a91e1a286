//! One run of a protocol, as a recording has it.

use std::io;

use anyhow::bail;
use ipc_types::Event;
use recording::column::{Column, Storage, nth};
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use rig::protocol::Protocol;

use crate::ended_sessions::{EndedSession, ended_sessions};
use crate::runs::Stretch;
use crate::samples::StoredSamples;
use crate::volumes::volume_times;

/// Longest gap between two samples that is filled with rows (s).
const LONGEST_GAP_S: f64 = 60.0;

/// A run with all that its files are made of.
pub(super) struct Run<'a> {
    pub(super) recording: &'a Recording,
    pub(super) protocol: &'a str,
    pub(super) protocol_text: &'a str,
    /// What the protocol says of itself.
    pub(super) description: String,
    pub(super) samples: StoredSamples,
    /// Where columns are kept.
    pub(super) storage: Storage,
    pub(super) events: Vec<Event>,
    pub(super) sessions: Vec<EndedSession>,
    /// The kind of each segment that was to be played; empty where the protocol cannot be read.
    pub(super) segment_kinds: Vec<&'static str>,
    /// When the volumes of the scan began, from the first stored one on (ns, CLOCK_MONOTONIC).
    pub(super) volumes: Vec<u64>,
    /// Whether there was a scan.
    pub(super) scan: bool,
    /// Instant from which the onsets are counted (ns, CLOCK_MONOTONIC).
    pub(super) zero_ns: u64,
    /// When the sample of the first row was taken, on an even grid (ns, CLOCK_MONOTONIC).
    pub(super) first_ns: u64,
    /// When the run ended (ns, CLOCK_MONOTONIC).
    pub(super) ended_ns: u64,
}

impl<'a> Run<'a> {
    /// `first_volume` is the number of the first volume that the scanner stored, from 0; columns
    /// are kept in `storage`.
    ///
    /// # Errors
    /// Where the stretch has no samples, or that volume was not counted.
    pub(super) fn read(
        recording: &'a Recording,
        stretch: Stretch<'a>,
        first_volume: Option<u64>,
        storage: &Storage,
    ) -> anyhow::Result<Self> {
        let samples = StoredSamples::read(recording, stretch.times_ns.clone(), storage)?;
        if samples.len() == 0 {
            bail!(
                "{}: no samples of {} were recorded",
                recording.path().display(),
                stretch.protocol
            );
        }
        let longest_s = samples.longest_gap as f64 / f64::from(samples.rig.rates.acquisition_hz);
        if longest_s > LONGEST_GAP_S {
            bail!(
                "{}: it has a gap of {longest_s:.0} s: cut the recording there (`farreach rec \
                 cut`) and export its parts",
                recording.path().display()
            );
        }
        let scan = volume_times(recording, &stretch.times_ns)?;
        let first_ns = even_grid(&samples)?;
        let wanted = first_volume.unwrap_or(0);
        let volumes: Vec<u64> =
            scan.iter().filter(|(number, _)| *number >= wanted).map(|(_, at_ns)| *at_ns).collect();
        let stored = scan.iter().find(|(number, _)| *number == wanted);
        let zero_ns = match stored {
            Some((_, at_ns)) => *at_ns,
            // An option for the scans concerns no run without one.
            None if scan.is_empty() => first_ns,
            None => bail!(
                "{}: volume {wanted} was not counted ({} volumes were): see --first-volume",
                recording.path().display(),
                scan.len()
            ),
        };
        let all = ended_sessions(recording)?.into_iter();
        // Only one that this version does not accept.
        let protocol = Protocol::parse(stretch.protocol_text, "protocol").ok();
        let segment_kinds =
            protocol.as_ref().map_or_else(Vec::new, |protocol| segment_kinds(protocol, &samples));
        Ok(Self {
            recording,
            protocol: stretch.protocol,
            protocol_text: stretch.protocol_text,
            description: protocol.map_or_else(String::new, |protocol| protocol.description),
            events: stretch.events,
            sessions: all
                .filter(|session| stretch.times_ns.contains(&session.result.begun_ns))
                .collect(),
            segment_kinds,
            scan: !scan.is_empty(),
            volumes,
            zero_ns,
            first_ns,
            // Where the protocol's end was not recorded, the last sample.
            ended_ns: match stretch.times_ns.end {
                u64::MAX => samples.last.at_ns + 1,
                end_ns => end_ns,
            },
            samples,
            storage: storage.clone(),
        })
    }

    /// Sampling rate (Hz).
    pub(super) const fn rate_hz(&self) -> u32 {
        self.samples.rig.rates.acquisition_hz
    }

    /// Samples that were recorded, for each second (Hz).
    pub(super) fn effective_hz(&self) -> f64 {
        f64::from(self.rate_hz()) * self.samples.len() as f64 / self.rows() as f64
    }

    /// Samples from the first to the last, with those that are missing.
    pub(super) const fn rows(&self) -> u64 {
        self.samples.last.tick - self.samples.first.tick + 1
    }

    /// Samples that are missing.
    pub(super) fn missing(&self) -> u64 {
        let longest = (LONGEST_GAP_S * f64::from(self.rate_hz())) as u64;
        // A longer gap lies between two recordings.
        let around = Some(self.samples.missing_around).filter(|around| *around <= longest);
        self.rows() - self.samples.len() as u64 + around.unwrap_or(0)
    }

    /// Goes through an even table: `row` gets the number of each row, whether its sample is there,
    /// and its values of these signals; NaN where it is missing.
    ///
    /// # Errors
    /// Those of the storage and of `row`.
    pub(super) fn each_row(
        &self,
        signals: &[usize],
        mut row: impl FnMut(u64, bool, &[f64]) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let columns = signals.iter().filter_map(|at| self.samples.columns.get(*at));
        let mut columns: Vec<_> = columns.map(Column::cursor).collect();
        let mut values = vec![f64::NAN; columns.len()];
        self.samples.rows(|number, index| {
            for (value, column) in values.iter_mut().zip(&mut columns) {
                *value = index.map_or(Ok(f64::NAN), |index| column.at(index))?;
            }
            row(number, index.is_some(), &values)
        })
    }

    /// From the first row to the end of the last one (s).
    pub(super) fn duration_s(&self) -> f64 {
        self.rows() as f64 / f64::from(self.rate_hz())
    }

    /// When the sample of a row was to be taken (ns, CLOCK_MONOTONIC).
    pub(super) fn time_of_row(&self, row: u64) -> u64 {
        self.first_ns + (row as f64 * 1e9 / f64::from(self.rate_hz())).round() as u64
    }

    /// An instant in seconds since another.
    pub(super) fn seconds(at_ns: u64, zero_ns: u64) -> f64 {
        (i128::from(at_ns) - i128::from(zero_ns)) as f64 * 1e-9
    }

    /// An instant by the wall clock (ns since 1970).
    pub(super) fn wall_clock_ns(&self, at_ns: u64) -> u64 {
        let offset_ns = self.recording.realtime_offset_ns().unwrap_or(0);
        at_ns.checked_add_signed(offset_ns).unwrap_or(0)
    }

    /// What wrote the recording.
    pub(super) fn version(&self) -> &str {
        self.recording.metadata(key::VERSION).unwrap_or_default()
    }
}

/// When the sample of the first tick was taken, by the median over all samples of how far each lies
/// from an even grid.
fn even_grid(samples: &StoredSamples) -> io::Result<u64> {
    let period_ns = 1e9 / f64::from(samples.rig.rates.acquisition_hz);
    let median = nth(samples.len() / 2, |take| {
        let (mut times, mut ticks) = (samples.times.cursor(), samples.ticks.cursor());
        for row in 0..samples.len() {
            take(times.at(row)? - ticks.at(row)? * period_ns);
        }
        Ok::<(), io::Error>(())
    })?;
    Ok(samples.first.at_ns.saturating_add_signed(median.round() as i64))
}

/// The kinds of a protocol's segments, in the order of playing.
fn segment_kinds(protocol: &Protocol, samples: &StoredSamples) -> Vec<&'static str> {
    let segments = protocol.segments_on(&samples.rig);
    protocol.sequence_of(&segments).map(|(_, segment)| segment.movement.kind()).collect()
}
