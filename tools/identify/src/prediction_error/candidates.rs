//! The listed effects as candidates of the stepwise selection: their free parameters and starting
//! points.
//!
//! Every effect is tried from several complete starting points, since a single sign or size misses
//! effects without a local gradient: backlash has none at zero gap, and saturation acts only at
//! peaks. An effect without an arm of its own is searched by its size alone, within the range that
//! the plant declares for it.

use std::f64::consts::FRAC_PI_2;

use plant::ParameterInfo;
use plant::effects::{Entry, LIST, Place, Site};

use super::free_parameter::{FreeParameter, Scaling, SearchRange};
use super::record::PACE_S;
use super::record_features::RecordFeatures;
use super::transmission_model::PlacedEffect;

/// Shortest dead time of a line (s): slightly more than one simulation step.
const LEAST_WAVE_S: f64 = 1.05 * PACE_S;

/// Shortest presliding travel, in counts of that side's encoder.
const COUNTS_OF_TRAVEL: f64 = 2.0;

/// Greatest size of an effect without an arm of its own, in default sizes.
const MOST_SIZES: f64 = 20.0;

/// Starting points of an effect without an arm of its own, in default sizes.
const DEFAULT_STARTS: [f64; 3] = [0.3, 1.0, 3.0];

/// A starting point of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct StartPoint {
    /// The effect with all its parameters.
    pub placed: PlacedEffect,
    /// The same effect shifted by a quarter period, for effects with amplitude and phase.
    pub quadrature: Option<PlacedEffect>,
    /// Whether the size may change its sign.
    pub signed: bool,
}

/// When an effect is fitted from all of its starting points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MultiStart {
    /// Whenever no candidate reaches the noise floor.
    Always,
    /// Only where the unmodelled torque was localised at the effect's site.
    WhenLocalised,
}

/// A listed effect at one site.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Its id.
    pub id: &'static str,
    /// Where.
    pub site: Site,
    /// Its free parameters.
    pub free: Vec<SearchRange>,
    /// How many of a starting point's leading values scale with the effect's size.
    pub sizes: usize,
    /// Whether the fit converges from some starting points only, which no score predicts.
    pub multi_start: Option<MultiStart>,
    /// Name and bound of the amplitude of an effect with amplitude and phase; the fit varies its
    /// sine and cosine parts.
    pub phasor: Option<(&'static str, f64)>,
    /// Starting points.
    pub starts: Vec<StartPoint>,
}

const fn free(name: &'static str, low: f64, high: f64) -> SearchRange {
    SearchRange { name, low, high, scaling: Scaling::Linear }
}

const fn by_logarithm(name: &'static str, low: f64, high: f64) -> SearchRange {
    SearchRange { name, low, high, scaling: Scaling::Logarithmic }
}

const fn waves_in_time(name: &'static str, low: f64, high: f64) -> SearchRange {
    SearchRange { name, low, high, scaling: Scaling::Frequency }
}

const fn waves_in_angle(name: &'static str, low: f64, high: f64) -> SearchRange {
    SearchRange { name, low, high, scaling: Scaling::SpatialFrequency }
}

/// The free parameters of the effect at index `placed`.
pub fn free_parameters_of(candidate: &Candidate, placed: usize) -> Vec<FreeParameter> {
    let free = candidate.free.iter().map(|range| FreeParameter::Effect { placed, range: *range });
    let waves = candidate.phasor.iter().flat_map(|(name, most)| {
        [0, 1].map(|part| FreeParameter::Phasor { placed, name, most: *most, part })
    });
    free.chain(waves).collect()
}

/// Returns all listed effects at all their sites that records with these features can reveal.
pub fn candidates(features: &RecordFeatures) -> Vec<Candidate> {
    LIST.iter()
        .flat_map(|entry| entry.sites.iter().filter_map(|place| candidate(entry, place, features)))
        .filter(|candidate| features.slave || candidate.site != Site::Slave)
        .collect()
}

fn candidate(entry: &Entry, place: &Place, features: &RecordFeatures) -> Option<Candidate> {
    let id = entry.id;
    let of = Search { id, site: place.site, size: place.size, features };
    let space = of.line().or_else(|| of.friction()).or_else(|| of.load());
    let space = space.or_else(|| of.drive()).or_else(|| of.disturbance()).or_else(|| of.sensor());
    let space = space.unwrap_or_else(|| of.by_size(&entry.parameters[0]));
    let sizes = match id {
        // A saturation limit falls as the effect grows, and a fully rectified reading does not
        // scale with the rectified share.
        "amplifier_saturation" => 0,
        "rectified_sensor" if features.rectified => 0,
        // An odd and an even part.
        "nonlinear_stiffness" => 2,
        _ => 1,
    };
    // These compete with declared friction or stiffness, which absorbs them up to its tolerance and
    // then stays at its bound.
    let multi_start = match id {
        "stribeck_friction" => Some(MultiStart::Always),
        "transport_delay" if place.site == Site::Line => Some(MultiStart::Always),
        "coulomb_friction" => Some(MultiStart::WhenLocalised),
        _ => None,
    };
    (!space.starts.is_empty()).then_some(Candidate {
        id,
        site: place.site,
        free: space.free,
        sizes,
        multi_start,
        phasor: space.phasor,
        starts: space.starts,
    })
}

/// Free parameters and starting points of an effect.
#[derive(Default)]
struct SearchSpace {
    free: Vec<SearchRange>,
    phasor: Option<(&'static str, f64)>,
    starts: Vec<StartPoint>,
}

impl SearchSpace {
    fn new(free: Vec<SearchRange>, starts: Vec<StartPoint>) -> Option<Self> {
        Some(Self { free, phasor: None, starts })
    }

    fn with_phasor(
        free: Vec<SearchRange>,
        (amplitude, most): (&'static str, f64),
        starts: impl Iterator<Item = StartPoint>,
    ) -> Option<Self> {
        Some(Self { free, phasor: Some((amplitude, most)), starts: starts.collect() })
    }
}

/// An effect at a site, whose search space is built from its typical size and the records.
struct Search<'a> {
    id: &'static str,
    site: Site,
    size: f64,
    features: &'a RecordFeatures,
}

impl Search<'_> {
    fn placed(&self, values: &[(&'static str, f64)]) -> PlacedEffect {
        PlacedEffect { id: self.id, site: self.site, values: values.to_vec() }
    }

    fn start(&self, values: &[(&'static str, f64)]) -> StartPoint {
        StartPoint { placed: self.placed(values), quadrature: None, signed: false }
    }

    fn signed(&self, values: &[(&'static str, f64)]) -> StartPoint {
        StartPoint { signed: true, ..self.start(values) }
    }

    /// Amplitude and phase: a starting point spans two directions.
    fn wave(&self, values: &[(&'static str, f64)]) -> StartPoint {
        let with = |phase: f64| self.placed(&[values, &[("phase", phase)]].concat());
        StartPoint { placed: with(0.0), quadrature: Some(with(FRAC_PI_2)), signed: true }
    }

    fn sizes(&self, name: &'static str, factors: &[f64]) -> Vec<StartPoint> {
        factors.iter().map(|factor| self.start(&[(name, factor * self.size)])).collect()
    }

    fn up_to(&self, name: &'static str, factor: f64) -> SearchRange {
        free(name, 0.0, factor * self.size)
    }

    fn either(&self, name: &'static str, factor: f64) -> SearchRange {
        free(name, -factor * self.size, factor * self.size)
    }

    fn line(&self) -> Option<SearchSpace> {
        let (free, starts) = match self.id {
            "nonlinear_stiffness" => (
                vec![free("cubic", -0.9, 10.0), free("even", -0.95, 0.95)],
                vec![
                    self.start(&[("cubic", 0.3)]),
                    self.start(&[("cubic", 1.5)]),
                    self.start(&[("cubic", -0.2)]),
                    self.start(&[("cubic", 0.01), ("even", 0.25)]),
                    self.start(&[("cubic", 0.01), ("even", -0.25)]),
                ],
            ),
            "viscoelastic_line" => {
                let of = |time: &f64| {
                    [0.2, 1.0].map(|ratio| {
                        self.start(&[("stiffness_ratio", ratio), ("relaxation_s", *time)])
                    })
                };
                (
                    vec![
                        free("stiffness_ratio", 0.0, 10.0),
                        by_logarithm("relaxation_s", 3e-3, 3.0),
                    ],
                    [0.01, 0.03, 0.1, 0.3].iter().flat_map(of).collect(),
                )
            }
            "leakage" => (
                vec![by_logarithm("conductance", 0.01 * self.size, 100.0 * self.size)],
                self.sizes("conductance", &[0.3, 1.0, 4.0]),
            ),
            "backlash" => (vec![self.up_to("gap", 20.0)], self.sizes("gap", &[0.25, 1.0, 3.0])),
            // A line's wave must take longer than a simulation step to have any effect.
            "transport_delay" if self.site == Site::Line => {
                (vec![free("delay_s", LEAST_WAVE_S, 0.05)], self.sizes("delay_s", &[0.6, 1.2, 2.0]))
            }
            "transport_delay" => {
                (vec![free("delay_s", 0.0, 0.05)], self.sizes("delay_s", &[0.2, 0.6, 2.0]))
            }
            _ => return None,
        };
        SearchSpace::new(free, starts)
    }

    fn friction(&self) -> Option<SearchSpace> {
        let (free, starts) = match self.id {
            "coulomb_friction" => {
                (vec![self.up_to("level", 10.0)], self.sizes("level", &[0.3, 1.0, 3.0]))
            }
            "viscous_friction" | "quadratic_drag" => {
                (vec![self.up_to("coefficient", 20.0)], self.sizes("coefficient", &[0.3, 1.0]))
            }
            "stribeck_friction" => {
                let of = |speed: &f64| {
                    [0.4, 1.0, 2.5]
                        .map(|level| self.start(&[("level", level * self.size), ("speed", *speed)]))
                };
                (
                    vec![self.up_to("level", 6.0), by_logarithm("speed", 0.03, 10.0)],
                    [0.1, 0.4, 1.5].iter().flat_map(of).collect(),
                )
            }
            "asymmetric_friction" => {
                let of = |time: &f64| {
                    self.signed(&[("difference", 0.5 * self.size), ("viscous_time", *time)])
                };
                (
                    vec![self.either("difference", 6.0), free("viscous_time", 0.0, 2.0)],
                    [0.0, 0.1, 0.5].iter().map(of).collect(),
                )
            }
            "position_dependent_friction" => {
                let starts = [1.0, 2.0, 3.0, 5.0]
                    .iter()
                    .map(|order| self.wave(&[("amplitude", 0.2), ("order", *order)]));
                // Below one wave per turn, the friction is no longer periodic over the stroke.
                let free = vec![waves_in_angle("order", 0.9, 12.0)];
                return SearchSpace::with_phasor(free, ("amplitude", 1.0), starts);
            }
            "load_dependent_friction" => {
                (vec![free("coefficient", 0.0, 0.9)], self.sizes("coefficient", &[0.3, 1.0, 2.0]))
            }
            "presliding_hysteresis" => {
                // A travel below the encoder's resolution is equivalent to the smoothing of dry
                // friction.
                let side = usize::from(self.site == Site::Slave);
                let least = (COUNTS_OF_TRAVEL * self.features.count_rad[side]).clamp(5e-4, 0.05);
                let of = |travel: f64| {
                    [0.4, 0.95].map(|part| self.start(&[("part", part), ("travel", travel)]))
                };
                let travels = [0.004, 0.015, 0.06].map(|travel| f64::max(travel, 1.3 * least));
                (
                    vec![free("part", 0.0, 1.0), by_logarithm("travel", least, 0.3)],
                    travels.into_iter().flat_map(of).collect(),
                )
            }
            _ => return None,
        };
        SearchSpace::new(free, starts)
    }

    fn load(&self) -> Option<SearchSpace> {
        let (free, starts) = match self.id {
            "gravity_imbalance" => {
                let start = self.wave(&[("torque", 0.5 * self.size)]);
                let phasor = ("torque", 10.0 * self.size);
                return SearchSpace::with_phasor(Vec::new(), phasor, [start].into_iter());
            }
            "extra_inertia" => {
                (vec![self.up_to("inertia", 20.0)], self.sizes("inertia", &[0.3, 1.0]))
            }
            "hand_impedance" => {
                let of = |[stiffness, damper, inertia]: [f64; 3]| {
                    self.start(&[
                        ("stiffness", stiffness),
                        ("damper_time_s", damper),
                        ("inertia_time_s", inertia),
                    ])
                };
                (
                    vec![
                        free("stiffness", 0.0, 30.0),
                        free("damper_time_s", 0.0, 0.5),
                        free("inertia_time_s", 0.0, 0.2),
                    ],
                    [[0.3, 0.02, 0.02], [1.0, 0.03, 0.05], [1.0, 0.1, 0.0]].map(of).to_vec(),
                )
            }
            "thermal_drift" => {
                let of = |time: &f64| self.signed(&[("excess", 0.3), ("time_constant_s", *time)]);
                (
                    vec![free("excess", -0.9, 6.0), by_logarithm("time_constant_s", 3.0, 1000.0)],
                    [10.0, 30.0, 100.0].iter().map(of).collect(),
                )
            }
            _ => return None,
        };
        SearchSpace::new(free, starts)
    }

    fn drive(&self) -> Option<SearchSpace> {
        let (free, starts) = match self.id {
            "torque_ripple" => {
                // Low orders show no spectral line among other functions of position.
                let orders = self.features.orders.iter().copied().chain([4.0, 5.0, 6.0, 7.0, 8.0]);
                let of = |order| self.wave(&[("amplitude", 0.5 * self.size), ("order", order)]);
                let free = vec![waves_in_angle("order", 3.5, 200.0)];
                let phasor = ("amplitude", 10.0 * self.size);
                return SearchSpace::with_phasor(free, phasor, orders.map(of));
            }
            "amplifier_saturation" => {
                let volts = self.features.volts;
                (
                    vec![free("limit", 0.2 * volts, volts)],
                    [0.45, 0.6, 0.75, 0.9]
                        .iter()
                        .map(|share| self.start(&[("limit", share * volts)]))
                        .collect(),
                )
            }
            "amplifier_deadzone" => {
                (vec![self.up_to("half_width", 10.0)], self.sizes("half_width", &[0.5, 1.5, 4.0]))
            }
            "amplifier_lag" => (
                vec![by_logarithm("time_constant", 2e-4, 0.1)],
                self.sizes("time_constant", &[0.3, 1.0, 3.0]),
            ),
            _ => return None,
        };
        SearchSpace::new(free, starts)
    }

    fn disturbance(&self) -> Option<SearchSpace> {
        match self.id {
            "periodic_disturbance" => {
                let lines = &self.features.lines_hz[usize::from(self.site == Site::Slave)];
                let of =
                    |hz: &f64| self.wave(&[("amplitude", 0.3 * self.size), ("frequency_hz", *hz)]);
                let free = vec![waves_in_time("frequency_hz", 0.3, 120.0)];
                let phasor = ("amplitude", 10.0 * self.size);
                SearchSpace::with_phasor(free, phasor, lines.iter().map(of))
            }
            "encoder_eccentricity" => {
                let starts = [0.0, 1.0].iter().flat_map(|master| {
                    [1.0, 2.0].map(|order| {
                        self.wave(&[
                            ("amplitude", 0.5 * self.size),
                            ("order", order),
                            ("on_master", *master),
                        ])
                    })
                });
                SearchSpace::with_phasor(Vec::new(), ("amplitude", 10.0 * self.size), starts)
            }
            _ => None,
        }
    }

    /// Effects on the torque channel; none can be searched in records without it.
    fn sensor(&self) -> Option<SearchSpace> {
        let (features, size) = (self.features, self.size);
        // A gain error or a lost sign shows only while a hand acts.
        let needs_hand = matches!(self.id, "sensor_gain" | "rectified_sensor");
        let revealed = features.torque && (features.hand || !needs_hand);
        let (free, starts) = match self.id {
            "sensor_offset" => {
                (vec![self.either("offset", 20.0)], vec![self.signed(&[("offset", size)])])
            }
            "sensor_gain" => {
                (vec![free("error", -0.8, 2.0)], vec![self.signed(&[("error", size)])])
            }
            "sensor_drift" => {
                (vec![self.either("rate", 20.0)], vec![self.signed(&[("rate", 0.3 * size)])])
            }
            "sensor_crosstalk" => {
                (vec![self.either("coupling", 20.0)], vec![self.signed(&[("coupling", size)])])
            }
            "mains_hum" => {
                let of = |hz: &f64| self.wave(&[("amplitude", size), ("frequency_hz", *hz)]);
                let free = vec![waves_in_time("frequency_hz", 15.0, 124.0)];
                let phasor = ("amplitude", 20.0 * size);
                let lines = features.hum_hz.iter().filter(|_| revealed);
                return SearchSpace::with_phasor(free, phasor, lines.map(of));
            }
            "rectified_sensor" => {
                let parts: &[f64] =
                    if features.rectified { &[0.58, 0.66, 0.78, 0.95] } else { &[0.1, 0.4] };
                let starts = parts.iter().map(|part| self.start(&[("part", *part)])).collect();
                (vec![free("part", 0.0, 1.0)], starts)
            }
            _ => return None,
        };
        SearchSpace::new(free, if revealed { starts } else { Vec::new() })
    }

    /// Search by the size parameter alone: up to [`MOST_SIZES`] default sizes within the
    /// parameter's range, from [`DEFAULT_STARTS`]; both signs where the range has both.
    fn by_size(&self, size: &ParameterInfo) -> SearchSpace {
        let most = MOST_SIZES * self.size.abs();
        let range = free(size.name, size.minimum.max(-most), size.maximum.min(most));
        let both = range.low < 0.0 && range.high > 0.0;
        let start = |factor: f64| StartPoint {
            signed: both,
            ..self.start(&[(size.name, (factor * self.size).clamp(range.low, range.high))])
        };
        let signs: &[f64] = if both { &[1.0, -1.0] } else { &[1.0] };
        let factors =
            DEFAULT_STARTS.iter().flat_map(|factor| signs.iter().map(move |sign| sign * factor));
        SearchSpace { free: vec![range], phasor: None, starts: factors.map(start).collect() }
    }
}

#[cfg(test)]
mod tests;
