//! Suppression of the gradient artefact in a recording, from the volumes before and after.

use crate::artefact_template::ArtefactTemplate;

/// A signal without what repeats with every volume: half of an average over the volumes before each
/// is subtracted, and half of one over those after it. Where one of them is not ready, at the edges
/// of a scan, the other is subtracted alone.
///
/// `volumes` is how many are averaged on each side, `rate_hz` the sampling rate. `in_volume` has
/// for each value the time since its volume began and that volume's repetition time (s); `None`
/// outside the scan. Values that are not finite stay as they are.
pub fn without_artefact(
    volumes: u32,
    rate_hz: f64,
    values: &[f64],
    in_volume: &[Option<(f64, f64)>],
) -> Vec<f64> {
    let samples = || values.iter().copied().zip(in_volume.iter().copied());
    let before = artefacts(volumes, rate_hz, samples());
    // Time runs backward: a volume begins where it ends.
    let backward = samples().rev().map(|(value, place)| {
        (value, place.map(|(since_s, repetition_s)| (repetition_s - since_s, repetition_s)))
    });
    let after = artefacts(volumes, rate_hz, backward);
    let clean = |((value, before), after): ((&f64, Option<f64>), Option<f64>)| {
        let artefact = match (before, after) {
            (Some(before), Some(after)) => 0.5 * (before + after),
            (one, other) => one.or(other).unwrap_or(0.0),
        };
        value - artefact
    };
    values.iter().zip(before).zip(after.into_iter().rev()).map(clean).collect()
}

/// The artefact at each sample; `None` where it is not known.
fn artefacts(
    volumes: u32,
    rate_hz: f64,
    samples: impl Iterator<Item = (f64, Option<(f64, f64)>)>,
) -> Vec<Option<f64>> {
    let mut template = ArtefactTemplate::new(volumes, rate_hz);
    let of = |(value, place): (f64, Option<(f64, f64)>)| match place {
        Some((since_s, repetition_s)) if value.is_finite() => {
            let clean = template.update(value, since_s, repetition_s);
            template.is_ready().then_some(value - clean)
        }
        _ => {
            template.skip();
            None
        }
    };
    samples.map(of).collect()
}
