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
    /// Both, agonists first.
    pub const ALL: [Self; 2] = [Self::Agonist, Self::Antagonist];

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
    /// What the rectified signal is divided by before the mean.
    maximum: f64,
}

/// The muscles in one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MuscleSample {
    /// Mean of the rectified signals of agonists and antagonists, each as a share of its maximum
    /// where maxima are used, and else in the electrodes' unit: 0 for a group without electrodes,
    /// NaN where an electrode's voltage is not finite.
    pub activity: [f64; BARS],
    /// The rectified signal at each input, in its electrode's unit; NaN where there is no electrode
    /// of a group.
    pub rectified: [f64; ANALOG],
}

impl MuscleSample {
    /// Without electrodes.
    pub const NONE: Self = Self { activity: [f64::NAN; BARS], rectified: [f64::NAN; ANALOG] };
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
            maximum: 1.0,
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

    /// From the next sample on activity is a share of these maxima of the rectified signals, by
    /// input, in the electrodes' units; `None`: it is in these units itself.
    pub fn set_maxima(&mut self, maxima: Option<&[f64; ANALOG]>) {
        for channel in &mut self.channels {
            let maximum = maxima.and_then(|maxima| maxima.get(channel.electrode.input)).copied();
            channel.maximum = maximum.filter(|maximum| *maximum > 0.0).unwrap_or(1.0);
        }
    }

    /// Takes a sample of all inputs (V). `volume` is the time since the scanner's volume began and
    /// its repetition time (s), while there is a scan.
    pub fn update(&mut self, analog_v: &[f64; ANALOG], volume: Option<(f64, f64)>) -> MuscleSample {
        let (mut sums, mut counts) = ([0.0; BARS], [0.0; BARS]);
        let mut all = [f64::NAN; ANALOG];
        for Channel { electrode, artefact, conditioner, maximum } in &mut self.channels {
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
            let rectified = conditioner.filter(value).abs();
            if let Some(place) = all.get_mut(electrode.input) {
                *place = rectified;
            }
            sums[group] += rectified / *maximum;
        }
        let mut means = [0.0; BARS];
        for ((mean, sum), count) in means.iter_mut().zip(sums).zip(counts) {
            *mean = if count > 0.0 { sum / count } else { 0.0 };
        }
        MuscleSample { activity: means, rectified: all }
    }
}
