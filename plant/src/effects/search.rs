//! How an effect is searched in records by the prediction-error method: its free parameters and
//! starting points, as the effect's own file declares them.
//!
//! Every effect is tried from several complete starting points, since a single sign or size misses
//! effects without a local gradient: backlash has none at zero gap, and saturation acts only at
//! peaks. An effect that declares no search is searched by its size alone, within the range of its
//! parameter.

use super::Site;
use crate::ParameterInfo;

/// Name of the phase (rad) of effects with amplitude and phase.
pub const PHASE: &str = "phase";

/// Greatest size of an effect that declares no search, in default sizes.
const MOST_SIZES: f64 = 20.0;

/// Starting points of an effect that declares no search, in default sizes.
const DEFAULT_STARTS: [f64; 3] = [0.3, 1.0, 3.0];

/// How an effect is searched, and what a search must know of it.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Its free parameters and starting points; those by its size unless declared.
    pub space: fn(&Basis<'_>) -> SearchSpace,
    /// Whether it imitates the integration error of dry friction, so that its gain must survive
    /// finer steps of the simulation.
    pub imitates_coarse_steps: bool,
    /// Whether a model with it is bistable: where friction falls with speed, a perturbation below
    /// the noise decides between stick and slip.
    pub bistable: bool,
    /// Sites at which it is equivalent on every record, apart from numerics.
    pub equivalent_sites: &'static [Site],
    /// The simpler effect that it becomes at a bound.
    pub becomes: Option<Becomes>,
    /// A parameter that chooses between two instruments.
    pub choice: Option<Choice>,
}

impl Search {
    /// By its size alone.
    pub const BY_SIZE: Self = Self {
        space: |of| of.by_size(),
        imitates_coarse_steps: false,
        bistable: false,
        equivalent_sites: &[],
        becomes: None,
        choice: None,
    };

    /// The site at which an effect of this kind would be equivalent to one at `site`.
    pub fn equivalent_site(&self, site: Site) -> Option<Site> {
        let other = || self.equivalent_sites.iter().find(|other| **other != site);
        self.equivalent_sites.contains(&site).then(other).flatten().copied()
    }
}

/// The simpler effect that an effect becomes where a parameter reaches its upper bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Becomes {
    /// Name of the parameter.
    pub parameter: &'static str,
    /// Id of the simpler effect, at the same site.
    pub id: &'static str,
}

/// A parameter that is 0 or 1 and chooses between two instruments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Name of the parameter.
    pub parameter: &'static str,
    /// Describes the effect at the other instrument.
    pub other: &'static str,
}

/// A free parameter of an effect, with its bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchRange {
    /// Its name.
    pub name: &'static str,
    /// Least value.
    pub low: f64,
    /// Greatest value.
    pub high: f64,
    /// Scale on which it is searched.
    pub scaling: Scaling,
}

/// The scale on which a parameter is searched, which also sets its finite-difference step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scaling {
    /// Linear, with steps relative to the value.
    Linear,
    /// Logarithmic.
    Logarithmic,
    /// Logarithmic, a frequency in time: the step is a small phase over all records.
    Frequency,
    /// Logarithmic, waves per turn: the step is a small phase over a movement.
    SpatialFrequency,
}

impl SearchRange {
    /// Searched linearly.
    pub const fn linear(name: &'static str, low: f64, high: f64) -> Self {
        Self { name, low, high, scaling: Scaling::Linear }
    }

    /// Searched logarithmically.
    pub const fn logarithmic(name: &'static str, low: f64, high: f64) -> Self {
        Self { name, low, high, scaling: Scaling::Logarithmic }
    }

    /// A frequency in time.
    pub const fn frequency(name: &'static str, low: f64, high: f64) -> Self {
        Self { name, low, high, scaling: Scaling::Frequency }
    }

    /// Waves per turn.
    pub const fn spatial_frequency(name: &'static str, low: f64, high: f64) -> Self {
        Self { name, low, high, scaling: Scaling::SpatialFrequency }
    }
}

/// When an effect is fitted from all of its starting points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MultiStart {
    /// Whenever no candidate reaches the noise floor.
    Always,
    /// Only where the unmodelled torque was localised at the effect's site.
    WhenLocalised,
}

/// Features of the records, of all roles, from which starting points are derived.
#[derive(Clone, Debug, Default)]
pub struct RecordFeatures {
    /// Interval of the rows with which records are simulated (s).
    pub step_s: f64,
    /// Largest motor voltage (V).
    pub volts: f64,
    /// Spectral lines in the residuals of master and slave (Hz).
    pub lines_hz: [Vec<f64>; 2],
    /// Mains frequencies, and the spectral lines in the residual of the torque channel (Hz).
    pub hum_hz: Vec<f64>,
    /// Prominent orders of the master's residual over the motor angle (waves per turn of 2π rad).
    pub orders: Vec<f64>,
    /// Encoder resolution of master and slave (rad per count).
    pub count_rad: [f64; 2],
    /// Whether any record has the hand torque.
    pub torque: bool,
    /// Whether a hand drives the handle in any record.
    pub hand: bool,
    /// Whether the torque channel shows magnitudes only.
    pub rectified: bool,
    /// Whether every record has the slave's position.
    pub slave: bool,
    /// The other axes at the same handle whose motion every record has.
    pub other_axes: Vec<usize>,
}

/// Parameters of an effect by name, its size first; others have their defaults.
pub type Values = Vec<(&'static str, f64)>;

/// One starting point for each value of a parameter.
pub fn each(name: &'static str, values: &[f64]) -> Vec<Values> {
    values.iter().map(|value| vec![(name, *value)]).collect()
}

/// One starting point for each pair of values of two parameters; the first varies fastest.
pub fn pairs(
    (first, values): (&'static str, &[f64]),
    (second, others): (&'static str, &[f64]),
) -> Vec<Values> {
    let with = |other: &f64| {
        let other = *other;
        values.iter().map(move |value| vec![(first, *value), (second, other)])
    };
    others.iter().flat_map(with).collect()
}

/// The free parameters of an effect and its starting points; without any, records with these
/// features cannot reveal it.
#[derive(Clone, Debug, PartialEq)]
pub struct SearchSpace {
    /// Its free parameters.
    pub free: Vec<SearchRange>,
    /// How many of a starting point's leading values scale with the effect's size.
    pub sizes: usize,
    /// Whether the fit converges from some starting points only, which no score predicts.
    pub multi_start: Option<MultiStart>,
    /// Name and bound of the amplitude of an effect with amplitude and phase; the fit varies its
    /// sine and cosine parts.
    pub phasor: Option<(&'static str, f64)>,
    /// Whether the size may change its sign.
    pub signed: bool,
    /// Starting points.
    pub starts: Vec<Values>,
}

impl SearchSpace {
    /// With a size of either sign.
    #[must_use]
    pub fn signed(self) -> Self {
        Self { signed: true, ..self }
    }

    /// With so many of the leading values as the size.
    #[must_use]
    pub fn with_sizes(self, sizes: usize) -> Self {
        Self { sizes, ..self }
    }

    /// With the name and bound of an amplitude that has a phase.
    #[must_use]
    pub fn phasor(mut self, amplitude: &'static str, most: f64) -> Self {
        self.starts.iter_mut().for_each(|start| start.push((PHASE, 0.0)));
        Self { phasor: Some((amplitude, most)), signed: true, ..self }
    }

    /// For effects that compete with declared friction or stiffness, which absorbs them up to its
    /// tolerance and then stays at its bound.
    #[must_use]
    pub fn multi_start(self, when: MultiStart) -> Self {
        Self { multi_start: Some(when), ..self }
    }

    /// Without starting points unless the records can reveal the effect.
    #[must_use]
    pub fn only_if(self, revealed: bool) -> Self {
        Self { starts: if revealed { self.starts } else { Vec::new() }, ..self }
    }
}

/// What a search space is built from: an effect's site, its typical size there, and the records.
#[derive(Clone, Copy, Debug)]
pub struct Basis<'a> {
    /// The site.
    pub site: Site,
    /// Default size there.
    pub size: f64,
    /// The parameter that is the size.
    pub parameter: &'a ParameterInfo,
    /// Features of the records.
    pub features: &'a RecordFeatures,
}

impl Basis<'_> {
    /// Free parameters and starting points, of one size.
    pub fn space(&self, free: impl Into<Vec<SearchRange>>, starts: Vec<Values>) -> SearchSpace {
        let (multi_start, phasor) = (None, None);
        SearchSpace { free: free.into(), sizes: 1, multi_start, phasor, signed: false, starts }
    }

    /// A parameter from 0 up to so many default sizes.
    pub fn up_to(&self, name: &'static str, factor: f64) -> SearchRange {
        SearchRange::linear(name, 0.0, factor * self.size)
    }

    /// A parameter of up to so many default sizes either way.
    pub fn either(&self, name: &'static str, factor: f64) -> SearchRange {
        SearchRange::linear(name, -factor * self.size, factor * self.size)
    }

    /// One free parameter, started from some factors of the default size.
    pub fn sizes(&self, range: SearchRange, factors: &[f64]) -> SearchSpace {
        let values: Vec<f64> = factors.iter().map(|factor| factor * self.size).collect();
        self.space([range], each(range.name, &values))
    }

    /// The size alone, within the range of its parameter.
    pub fn by_size(&self) -> SearchSpace {
        let (most, size) = (MOST_SIZES * self.size.abs(), self.parameter);
        let range = SearchRange::linear(size.name, size.minimum.max(-most), size.maximum.min(most));
        let signed = range.low < 0.0 && range.high > 0.0;
        let signs: &[f64] = if signed { &[1.0, -1.0] } else { &[1.0] };
        let factors =
            DEFAULT_STARTS.iter().flat_map(|factor| signs.iter().map(move |sign| sign * factor));
        let values: Vec<f64> =
            factors.map(|factor| (factor * self.size).clamp(range.low, range.high)).collect();
        SearchSpace { signed, ..self.space([range], each(size.name, &values)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The default search of an effect whose size has this range.
    fn by_size(size: f64, minimum: f64, maximum: f64) -> (SearchRange, Vec<(f64, bool)>) {
        let (unit, source) = ("1", "assumed");
        let parameter =
            &ParameterInfo { name: "size", unit, minimum, maximum, printed: size, source };
        let features = &RecordFeatures::default();
        let space = Basis { site: Site::Slave, size, parameter, features }.by_size();
        let starts = space.starts.iter().map(|start| (start[0].1, space.signed));
        (space.free[0], starts.collect())
    }

    #[test]
    fn undeclared_an_effect_is_searched_by_its_size_within_its_range() {
        let (range, starts) = by_size(0.5, 0.0, 100.0);
        assert_eq!((range.low, range.high), (0.0, 10.0));
        assert_eq!(starts, [(0.15, false), (0.5, false), (1.5, false)]);

        let (range, starts) = by_size(0.5, -1.0, 1.0);
        assert_eq!((range.low, range.high), (-1.0, 1.0));
        let [small, large] = [0.15, 1.0];
        assert_eq!(
            starts,
            [small, -small, 0.5, -0.5, large, -large].map(|start| (start, true)),
            "both signs, the largest held within the range"
        );

        let (range, starts) = by_size(-0.5, -100.0, 0.0);
        assert_eq!((range.low, range.high), (-10.0, 0.0));
        assert_eq!(starts, [(-0.15, false), (-0.5, false), (-1.5, false)]);
    }

    #[test]
    fn equivalence_holds_between_the_sites_named_alone() {
        let search = Search { equivalent_sites: &[Site::Drive, Site::Sensor], ..Search::BY_SIZE };
        assert_eq!(search.equivalent_site(Site::Drive), Some(Site::Sensor));
        assert_eq!(search.equivalent_site(Site::Sensor), Some(Site::Drive));
        assert_eq!(search.equivalent_site(Site::Line), None);
        assert_eq!(Search::BY_SIZE.equivalent_site(Site::Line), None);
    }
}
