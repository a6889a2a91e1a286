//! The gradient artefact in a recording, from the volumes before and after.

use crate::artefact_template::ArtefactTemplate;

/// Where a sample lies in its volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InVolume {
    /// Time since the volume began (s).
    pub since_s: f64,
    /// Time until the next one begins (s).
    pub until_s: f64,
}

/// The gradient artefact at each sample of a recording, to be subtracted: the mean of an average
/// over the volumes before the sample and of one over those after it. Where one of them is not
/// ready, at the edges of a scan, it is the other alone; `None` where neither is, outside the scan,
/// and where a value is not finite.
///
/// `volumes` is how many are averaged on each side, `rate_hz` the sampling rate, `repetition_s` the
/// scan's mean repetition time. `places` has the place of each value; `None` outside the scan.
pub fn offline_artefact(
    volumes: u32,
    rate_hz: f64,
    repetition_s: f64,
    values: &[f64],
    places: &[Option<InVolume>],
) -> Vec<Option<f64>> {
    let mut templates = [(); 2].map(|()| ArtefactTemplate::new(volumes, rate_hz));
    let [forward, backward] = &mut templates;
    let at = |template: &mut ArtefactTemplate, value: f64, since_s: Option<f64>| {
        let Some(since_s) = since_s.filter(|_| value.is_finite()) else {
            template.skip();
            return None;
        };
        let clean = template.update(value, since_s, repetition_s);
        template.is_ready().then_some(value - clean)
    };
    let samples = || values.iter().copied().zip(places.iter().copied());
    let before: Vec<Option<f64>> = samples()
        .map(|(value, place)| at(forward, value, place.map(|place| place.since_s)))
        .collect();
    // Time runs backward: a volume begins where the next one does.
    let mut after: Vec<Option<f64>> = samples()
        .rev()
        .map(|(value, place)| at(backward, value, place.map(|place| place.until_s)))
        .collect();
    after.reverse();
    let both = |(before, after): (Option<f64>, Option<f64>)| match (before, after) {
        (Some(before), Some(after)) => Some(0.5 * (before + after)),
        (one, other) => one.or(other),
    };
    before.into_iter().zip(after).map(both).collect()
}
