//! The gradient artefact in a recording, from the volumes before and after.

use crate::artefact_template::ArtefactTemplate;
use crate::signal::Signal;

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
    let place = |at: usize| Ok(places.get(at).copied().flatten());
    let Ok(found) = offline_artefact_of(volumes, rate_hz, repetition_s, &values.to_vec(), place);
    found.into_iter().map(|value| Some(value).filter(|value| !value.is_nan())).collect()
}

/// As [`offline_artefact`], of a signal that may be longer than the memory: NaN where there is
/// none. `place` is asked for the place of each value.
///
/// # Errors
/// Those of the signal and of `place`.
pub fn offline_artefact_of<S: Signal>(
    volumes: u32,
    rate_hz: f64,
    repetition_s: f64,
    values: &S,
    mut place: impl FnMut(usize) -> Result<Option<InVolume>, S::Error>,
) -> Result<S, S::Error> {
    let found = |template: &mut ArtefactTemplate, value: f64, since_s: Option<f64>| {
        let Some(since_s) = since_s.filter(|_| value.is_finite()) else {
            template.skip();
            return f64::NAN;
        };
        let clean = template.update(value, since_s, repetition_s);
        if template.is_ready() { value - clean } else { f64::NAN }
    };
    let length = values.length();
    let mut before = values.empty();
    let mut template = ArtefactTemplate::new(volumes, rate_hz);
    let mut read = values.reader();
    for at in 0..length {
        let since_s = place(at)?.map(|place| place.since_s);
        before.push(found(&mut template, read(at)?, since_s))?;
    }
    // Time runs backward: a volume begins where the next one does.
    let mut after = values.empty();
    let mut template = ArtefactTemplate::new(volumes, rate_hz);
    for at in (0..length).rev() {
        let until_s = place(at)?.map(|place| place.until_s);
        after.push(found(&mut template, read(at)?, until_s))?;
    }
    let mut both = values.empty();
    {
        let (mut before, mut after) = (before.reader(), after.reader());
        for at in 0..length {
            both.push(match (before(at)?, after(length - 1 - at)?) {
                (before, after) if before.is_nan() => after,
                (before, after) if after.is_nan() => before,
                (before, after) => 0.5 * (before + after),
            })?;
        }
    }
    Ok(both)
}
