//! The activity of agonists and antagonists, from the electrodes of a rig.

use ipc_types::{ANALOG, BARS};

use crate::artefact_template::ArtefactTemplate;
use crate::conditioner::{Conditioner, Conditioning, ConditioningError};

/// The group to which a muscle belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// Muscles that make the movement in the positive direction.
    Agonist,
    /// Muscles against it.
    Antagonist,
}

impl Group {
    /// The word in files and tables.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Agonist => "agonist",
            Self::Antagonist => "antagonist",
        }
    }

    /// Index in the messages' pairs: agonists first.
    pub const fn index(self) -> usize {
        match self {
            Self::Agonist => 0,
            Self::Antagonist => 1,
        }
    }
}

/// An electrode whose muscle belongs to a group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Electrode {
    /// Analog input of the card, from 0.
    pub input: usize,
    /// The muscle's voltage, in the electrode's unit, for a volt at the input.
    pub per_v: f64,
    /// The group of its muscle.
    pub group: Group,
}

/// An electrode with its filters.
#[derive(Clone, Debug)]
struct Channel {
    electrode: Electrode,
    artefact: Option<ArtefactTemplate>,
    conditioner: Conditioner,
}

/// Filters the electrodes of a rig, sample by sample.
#[derive(Clone, Debug)]
pub struct MuscleActivity {
    channels: Vec<Channel>,
}

impl MuscleActivity {
    /// Filters at rest, for signals that are sampled at `rate_hz`.
    ///
    /// # Errors
    /// Those of [`Conditioner::new`].
    pub fn new(
        electrodes: &[Electrode],
        how: &Conditioning,
        rate_hz: f64,
    ) -> Result<Self, ConditioningError> {
        let conditioner = Conditioner::new(how, rate_hz)?;
        let artefact = (how.artefact_volumes > 0)
            .then(|| ArtefactTemplate::new(how.artefact_volumes, rate_hz));
        let channel = |electrode: &Electrode| Channel {
            electrode: *electrode,
            artefact: artefact.clone(),
            conditioner,
        };
        Ok(Self { channels: electrodes.iter().map(channel).collect() })
    }

    /// Forgets the artefact, before another scan.
    pub fn clear_artefact(&mut self) {
        self.channels
            .iter_mut()
            .filter_map(|channel| channel.artefact.as_mut())
            .for_each(ArtefactTemplate::clear);
    }

    /// Takes a sample of all inputs (V) and returns the mean rectified signal over the electrodes
    /// of each group, in their unit: 0 for a group without electrodes, NaN where an electrode's
    /// voltage is not finite. `volume` is the time since the scanner's volume began and its
    /// repetition time (s), while there is a scan.
    pub fn update(&mut self, analog_v: &[f64; ANALOG], volume: Option<(f64, f64)>) -> [f64; BARS] {
        let (mut sums, mut counts) = ([0.0; BARS], [0.0; BARS]);
        for Channel { electrode, artefact, conditioner } in &mut self.channels {
            let group = electrode.group.index();
            counts[group] += 1.0;
            let volts = analog_v.get(electrode.input).copied().unwrap_or(f64::NAN);
            if !volts.is_finite() {
                // The filters never see it: they would not forget it.
                sums[group] = f64::NAN;
                artefact.iter_mut().for_each(ArtefactTemplate::skip);
                continue;
            }
            let mut value = volts * electrode.per_v;
            match (artefact, volume) {
                (Some(artefact), Some((since_s, repetition_s))) => {
                    value = artefact.update(value, since_s, repetition_s);
                }
                (Some(artefact), None) => artefact.skip(),
                (None, _) => {}
            }
            // The envelope is not needed here.
            sums[group] += conditioner.filter(value).abs();
        }
        let mut means = [0.0; BARS];
        for ((mean, sum), count) in means.iter_mut().zip(sums).zip(counts) {
            *mean = if count > 0.0 { sum / count } else { 0.0 };
        }
        means
    }
}
