//! A model against the noise floor: in the sum over all frequencies, octave by octave, and record
//! by record.

use super::dataset::Dataset;
use super::excess_over_floor::{RecordError, largest_error};
use super::noise_floor::{AboveFloor, INADEQUATE, above_floor_of, colour, repeated};
use super::transmission_model::{Setting, TransmissionModel};

/// Repeated records beyond this factor of the floor refute effects that leave noise octave by
/// octave (others: [`INADEQUATE`]): in stick-slip one of two repeated records may take the other
/// branch for a while, which dominates the sum.
const INADEQUATE_THOUGH_NOISE: f64 = 2.0;
/// Multiple of the limit of noise beyond which a model is refuted whatever it gained.
const REFUTED_COLOUR: f64 = 2.0;
/// Colour below which an error is as white as those of right models mostly are.
const WHITE: f64 = 0.7;
/// Error of a single record over the floor beyond which it is no noise. Of 40 simulated machines
/// without a missing effect none had a record above 2.0; right models in stick-slip may leave 10.
const OUTLYING: f64 = 5.0;

/// How far the error of a model lies above the noise floor.
#[derive(Clone, Copy, Debug, Default)]
pub struct FloorComparison {
    /// In the sum over all frequencies; `None` if nothing is repeated.
    pub in_sum: Option<AboveFloor>,
    /// Over the octaves, relative to the limit of noise
    /// ([`super::noise_floor::OctaveRatios::colour`]), in the worst channel; `None` if not known.
    pub colour: Option<f64>,
    /// The largest error of a single record that does not report; `None` if not known.
    pub largest: Option<RecordError>,
}

impl FloorComparison {
    /// Of a setting, along some records; nothing is known where one cannot be simulated.
    pub fn of(model: &TransmissionModel, records: &[usize], setting: &Setting) -> Self {
        let Some(residuals) = Dataset::whole(model).residuals(setting) else {
            return Self::default();
        };
        Self {
            in_sum: above_floor_of(model, records, &repeated(model), (setting, &residuals)),
            colour: colour(model, records, &residuals),
            largest: largest_error(model, &residuals),
        }
    }

    /// Whether nothing is left to explain in the sum over all frequencies.
    pub fn at_floor_in_sum(&self) -> bool {
        self.in_sum.is_some_and(|above| above.at_floor())
    }

    /// The same, as far as it is known: true where nothing is repeated.
    pub fn may_be_at_floor_in_sum(&self) -> bool {
        self.in_sum.is_none_or(|above| above.at_floor())
    }

    /// Whether what is left is no noise, over the octaves or in a single record.
    pub fn is_coloured(&self) -> bool {
        self.is_coloured_over_octaves() || self.outlying_record().is_some()
    }

    /// Whether what is left is no noise over the octaves.
    pub fn is_coloured_over_octaves(&self) -> bool {
        self.colour.is_some_and(|colour| colour > 1.0)
    }

    /// A record whose error is no noise, whatever the others leave: an effect may act in it alone.
    pub fn outlying_record(&self) -> Option<RecordError> {
        self.largest.filter(|largest| largest.over_floor > OUTLYING)
    }

    /// Whether what is left is as white as right models mostly leave it, as far as that is known.
    pub fn is_white(&self) -> bool {
        self.colour.is_none_or(|colour| colour < WHITE)
    }

    /// Whether only noise is left, as far as that is known.
    pub fn leaves_noise(&self) -> bool {
        self.may_be_at_floor_in_sum() && !self.is_coloured()
    }

    /// Whether no listed effect is adequate, in the sum or over the octaves; without an effect
    /// that was `named`, any colour tells that one is missing, and so does an outlying record.
    pub fn refutes(&self, named: bool) -> bool {
        let most = if named { REFUTED_COLOUR } else { 1.0 };
        let leaves_noise = named && self.colour.is_some_and(|colour| colour <= 1.0);
        let most_in_sum = if leaves_noise { INADEQUATE_THOUGH_NOISE } else { INADEQUATE };
        self.in_sum.is_some_and(|above| above.exceeds(most_in_sum))
            || self.colour.is_some_and(|colour| colour > most)
            || (!named && self.outlying_record().is_some())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prediction_error::transmission_model::Channel;

    #[test]
    fn effects_that_leave_noise_octave_by_octave_may_leave_more_in_sum() {
        let above = |repeated: f64| AboveFloor {
            repeated,
            others: repeated,
            beside_friction: [repeated; 2],
        };
        let refuted = |repeated: f64, colour: Option<f64>, named: bool| {
            FloorComparison { in_sum: Some(above(repeated)), colour, largest: None }.refutes(named)
        };
        assert!(!refuted(1.7, Some(0.8), true) && refuted(1.7, Some(0.8), false));
        assert!(refuted(1.7, Some(1.2), true) && refuted(1.7, None, true));
        assert!(refuted(2.1, Some(0.8), true) && !refuted(1.5, Some(1.2), true));
    }

    #[test]
    fn a_single_record_far_above_the_floor_refutes_that_nothing_is_missing() {
        let with = |over_floor: f64| {
            let largest = Some(RecordError { record: 3, channel: Channel::Slave, over_floor });
            FloorComparison { in_sum: None, colour: Some(0.5), largest }
        };
        assert!(with(60.0).is_coloured() && with(60.0).refutes(false) && !with(60.0).refutes(true));
        assert!(!with(2.0).is_coloured() && !with(2.0).refutes(false));
    }
}
