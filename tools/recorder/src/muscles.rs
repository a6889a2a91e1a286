//! The electrodes of a stretch of a recording, filtered without delay.

use anyhow::Context;
use emg::{without_artefact, zero_phase};
use recording::mcap_read::Recording;
use rig::{Channel, ChannelKind, RigFile};

use crate::samples::Samples;
use crate::signals::Source;
use crate::volumes::volume_times;

/// Longest time by which a volume may have begun before the stretch (ns).
const BEFORE_NS: u64 = (emg::LONGEST_REPETITION_S * 1e9) as u64;

/// The muscles' signals; a column for each electrode.
#[derive(Default)]
pub(crate) struct Muscles {
    /// Names and units of the channels, the muscles and their groups.
    pub(crate) names: Vec<String>,
    pub(crate) units: Vec<String>,
    pub(crate) muscles: Vec<String>,
    pub(crate) groups: Vec<&'static str>,
    /// After suppression of the gradient artefact, band-pass and notch.
    pub(crate) filtered: Vec<Vec<f64>>,
    /// Envelopes of their magnitudes.
    pub(crate) envelope: Vec<Vec<f64>>,
}

/// Filters the electrodes as the rig file says; a sample that is missing or not finite is NaN, and
/// in the filters the one before it.
///
/// # Errors
/// Where the volumes cannot be read, or a filter not be made.
pub(crate) fn muscles(recording: &Recording, samples: &Samples) -> anyhow::Result<Muscles> {
    let how = &samples.rig.emg;
    let rate_hz = f64::from(samples.rig.rates.acquisition_hz);
    let mut found = Muscles::default();
    let electrodes = samples.signals.iter().zip(&samples.columns).filter_map(|(signal, column)| {
        let Source::Analog(input, _) = signal.source else { return None };
        Some((electrode(&samples.rig, input)?, column))
    });
    let mut in_volume = None;
    for (channel, column) in electrodes {
        let mut values = column.clone();
        if how.artefact_volumes > 0 {
            let places = match &mut in_volume {
                Some(places) => places,
                none => none.insert(places_in_volumes(recording, samples)?),
            };
            values = without_artefact(how.artefact_volumes, rate_hz, &values, places);
        }
        let mut before = 0.0;
        for value in &mut values {
            if value.is_finite() {
                before = *value;
            }
            *value = before;
        }
        let activity = zero_phase(how, rate_hz, &values).context("[emg] of the rig file")?;
        let kept = |value: f64, raw: &f64| if raw.is_finite() { value } else { f64::NAN };
        let each = || activity.iter().zip(column);
        found.filtered.push(each().map(|(a, raw)| kept(a.filtered, raw)).collect());
        found.envelope.push(each().map(|(a, raw)| kept(a.envelope, raw)).collect());
        found.names.push(channel.name.clone());
        found.units.push(channel.unit.clone());
        found.muscles.push(channel.muscle.clone());
        found.groups.push(match channel.group {
            Some(emg::Group::Agonist) => "agonist",
            Some(emg::Group::Antagonist) => "antagonist",
            None => "",
        });
    }
    Ok(found)
}

fn electrode(rig: &RigFile, input: usize) -> Option<&Channel> {
    let channel = rig.channels.iter().find(|channel| channel.index == input)?;
    (channel.kind == ChannelKind::Emg).then_some(channel)
}

/// For each sample the time since its volume began, and to the next one (s); `None` outside a scan.
fn places_in_volumes(
    recording: &Recording,
    samples: &Samples,
) -> anyhow::Result<Vec<Option<(f64, f64)>>> {
    let (first_ns, last_ns) = match samples.times_ns.as_slice() {
        [first, .., last] => (*first, *last),
        _ => return Ok(vec![None; samples.times_ns.len()]),
    };
    let around = first_ns.saturating_sub(BEFORE_NS)..last_ns.saturating_add(BEFORE_NS);
    let volumes: Vec<u64> =
        volume_times(recording, &around)?.into_iter().map(|(_, at_ns)| at_ns).collect();
    let place = |at_ns: &u64| {
        let next = volumes.partition_point(|volume| volume <= at_ns);
        let begun_ns = *volumes.get(next.checked_sub(1)?)?;
        // The last volume is as long as the one before it.
        let length_ns =
            match (volumes.get(next), next.checked_sub(2).and_then(|at| volumes.get(at))) {
                (Some(end_ns), _) => end_ns - begun_ns,
                (None, Some(before_ns)) => begun_ns - before_ns,
                (None, None) => return None,
            };
        let since_ns = at_ns - begun_ns;
        (since_ns < length_ns).then_some((since_ns as f64 * 1e-9, length_ns as f64 * 1e-9))
    };
    Ok(samples.times_ns.iter().map(place).collect())
}
