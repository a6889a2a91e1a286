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

/// Parameter of effects with amplitude and phase.
const PHASE: &str = "phase";

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
    /// Whether the size may change its sign.
    pub signed: bool,
    /// Starting points: the effect with all its parameters.
    pub starts: Vec<PlacedEffect>,
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
    let of = Search { id: entry.id, site: place.site, size: place.size, features };
    let found = of.line().or_else(|| of.friction()).or_else(|| of.load_or_drive());
    let found = found.or_else(|| of.wave()).or_else(|| of.sensor());
    let found = found.unwrap_or_else(|| of.by_size(&entry.parameters[0]));
    (!found.starts.is_empty()).then_some(found)
}

/// Parameters of an effect by name.
type Values = Vec<(&'static str, f64)>;

/// One starting point for each value of a parameter.
fn each(name: &'static str, values: &[f64]) -> Vec<Values> {
    values.iter().map(|value| vec![(name, *value)]).collect()
}

/// One starting point for each pair of values of two parameters; the first varies fastest.
fn pairs(
    (first, values): (&'static str, &[f64]),
    (second, others): (&'static str, &[f64]),
) -> Vec<Values> {
    let with = |other: &f64| {
        let other = *other;
        values.iter().map(move |value| vec![(first, *value), (second, other)])
    };
    others.iter().flat_map(with).collect()
}

impl Candidate {
    /// A starting point shifted by a quarter period, for effects with amplitude and phase.
    pub fn quadrature(&self, start: &PlacedEffect) -> Option<PlacedEffect> {
        self.phasor?;
        let mut shifted = start.clone();
        shifted.values.iter_mut().filter(|(name, _)| *name == PHASE).for_each(|value| {
            value.1 = FRAC_PI_2;
        });
        Some(shifted)
    }

    fn signed(self) -> Self {
        Self { signed: true, ..self }
    }

    /// With the name and bound of an amplitude that has a phase.
    fn phasor(mut self, amplitude: &'static str, most: f64) -> Self {
        self.starts.iter_mut().for_each(|start| start.values.push((PHASE, 0.0)));
        Self { phasor: Some((amplitude, most)), signed: true, ..self }
    }

    /// For effects that compete with declared friction or stiffness, which absorbs them up to its
    /// tolerance and then stays at its bound.
    fn multi_start(self, when: MultiStart) -> Self {
        Self { multi_start: Some(when), ..self }
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
    fn space(&self, free: impl Into<Vec<SearchRange>>, starts: Vec<Values>) -> Candidate {
        let (id, site) = (self.id, self.site);
        Candidate {
            id,
            site,
            free: free.into(),
            sizes: 1,
            multi_start: None,
            phasor: None,
            signed: false,
            starts: starts.into_iter().map(|values| PlacedEffect { id, site, values }).collect(),
        }
    }

    fn up_to(&self, name: &'static str, factor: f64) -> SearchRange {
        free(name, 0.0, factor * self.size)
    }

    fn either(&self, name: &'static str, factor: f64) -> SearchRange {
        free(name, -factor * self.size, factor * self.size)
    }

    /// One free parameter, started from some factors of the default size.
    fn sizes(&self, range: SearchRange, factors: &[f64]) -> Candidate {
        let values: Vec<f64> = factors.iter().map(|factor| factor * self.size).collect();
        self.space([range], each(range.name, &values))
    }

    fn line(&self) -> Option<Candidate> {
        Some(match self.id {
            "nonlinear_stiffness" => Candidate {
                // An odd and an even part.
                sizes: 2,
                ..self.space(
                    [free("cubic", -0.9, 10.0), free("even", -0.95, 0.95)],
                    [
                        each("cubic", &[0.3, 1.5, -0.2]),
                        pairs(("cubic", &[0.01]), ("even", &[0.25, -0.25])),
                    ]
                    .concat(),
                )
            },
            "viscoelastic_line" => self.space(
                [free("stiffness_ratio", 0.0, 10.0), by_logarithm("relaxation_s", 3e-3, 3.0)],
                pairs(("stiffness_ratio", &[0.2, 1.0]), ("relaxation_s", &[0.01, 0.03, 0.1, 0.3])),
            ),
            "leakage" => self.sizes(
                by_logarithm("conductance", 0.01 * self.size, 100.0 * self.size),
                &[0.3, 1.0, 4.0],
            ),
            "backlash" => self.sizes(self.up_to("gap", 20.0), &[0.25, 1.0, 3.0]),
            "transport_delay" if self.site == Site::Line => self
                .sizes(free("delay_s", LEAST_WAVE_S, 0.05), &[0.6, 1.2, 2.0])
                .multi_start(MultiStart::Always),
            "transport_delay" => self.sizes(free("delay_s", 0.0, 0.05), &[0.2, 0.6, 2.0]),
            _ => return None,
        })
    }

    fn friction(&self) -> Option<Candidate> {
        let size = self.size;
        Some(match self.id {
            "coulomb_friction" => self
                .sizes(self.up_to("level", 10.0), &[0.3, 1.0, 3.0])
                .multi_start(MultiStart::WhenLocalised),
            "viscous_friction" | "quadratic_drag" => {
                self.sizes(self.up_to("coefficient", 20.0), &[0.3, 1.0])
            }
            "stribeck_friction" => self
                .space(
                    [self.up_to("level", 6.0), by_logarithm("speed", 0.03, 10.0)],
                    pairs(
                        ("level", &[0.4, 1.0, 2.5].map(|l| l * size)),
                        ("speed", &[0.1, 0.4, 1.5]),
                    ),
                )
                .multi_start(MultiStart::Always),
            "asymmetric_friction" => self
                .space(
                    [self.either("difference", 6.0), free("viscous_time", 0.0, 2.0)],
                    pairs(("difference", &[0.5 * size]), ("viscous_time", &[0.0, 0.1, 0.5])),
                )
                .signed(),
            "position_dependent_friction" => self
                .space(
                    [waves_in_angle("order", 0.9, 12.0)],
                    pairs(("amplitude", &[0.2]), ("order", &[1.0, 2.0, 3.0, 5.0])),
                )
                .phasor("amplitude", 1.0),
            "load_dependent_friction" => {
                self.sizes(free("coefficient", 0.0, 0.9), &[0.3, 1.0, 2.0])
            }
            "presliding_hysteresis" => {
                let side = usize::from(self.site == Site::Slave);
                let least = (COUNTS_OF_TRAVEL * self.features.count_rad[side]).clamp(5e-4, 0.05);
                let travels = [0.004, 0.015, 0.06].map(|travel| f64::max(travel, 1.3 * least));
                self.space(
                    [free("part", 0.0, 1.0), by_logarithm("travel", least, 0.3)],
                    pairs(("part", &[0.4, 0.95]), ("travel", &travels)),
                )
            }
            _ => return None,
        })
    }

    fn load_or_drive(&self) -> Option<Candidate> {
        Some(match self.id {
            "extra_inertia" => self.sizes(self.up_to("inertia", 20.0), &[0.3, 1.0]),
            "hand_impedance" => {
                let names = ["stiffness", "damper_time_s", "inertia_time_s"];
                let starts = [[0.3, 0.02, 0.02], [1.0, 0.03, 0.05], [1.0, 0.1, 0.0]];
                self.space(
                    [free(names[0], 0.0, 30.0), free(names[1], 0.0, 0.5), free(names[2], 0.0, 0.2)],
                    starts.map(|values| names.into_iter().zip(values).collect()).to_vec(),
                )
            }
            "thermal_drift" => self
                .space(
                    [free("excess", -0.9, 6.0), by_logarithm("time_constant_s", 3.0, 1000.0)],
                    pairs(("excess", &[0.3]), ("time_constant_s", &[10.0, 30.0, 100.0])),
                )
                .signed(),
            "amplifier_saturation" => {
                let volts = self.features.volts;
                let starts = each("limit", &[0.45, 0.6, 0.75, 0.9].map(|share| share * volts));
                // The limit falls as the effect grows.
                let limit = free("limit", 0.2 * volts, volts);
                Candidate { sizes: 0, ..self.space([limit], starts) }
            }
            "amplifier_deadzone" => self.sizes(self.up_to("half_width", 10.0), &[0.5, 1.5, 4.0]),
            "amplifier_lag" => {
                self.sizes(by_logarithm("time_constant", 2e-4, 0.1), &[0.3, 1.0, 3.0])
            }
            _ => return None,
        })
    }

    /// Effects with amplitude and phase, but friction and hum.
    fn wave(&self) -> Option<Candidate> {
        let (features, size) = (self.features, self.size);
        Some(match self.id {
            "gravity_imbalance" => {
                self.space([], each("torque", &[0.5 * size])).phasor("torque", 10.0 * size)
            }
            "torque_ripple" => {
                let orders = [&features.orders[..], &[4.0, 5.0, 6.0, 7.0, 8.0]].concat();
                self.space(
                    [waves_in_angle("order", 3.5, 200.0)],
                    pairs(("amplitude", &[0.5 * size]), ("order", &orders)),
                )
                .phasor("amplitude", 10.0 * size)
            }
            "periodic_disturbance" => {
                let lines = &features.lines_hz[usize::from(self.site == Site::Slave)];
                self.space(
                    [waves_in_time("frequency_hz", 0.3, 120.0)],
                    pairs(("amplitude", &[0.3 * size]), ("frequency_hz", lines)),
                )
                .phasor("amplitude", 10.0 * size)
            }
            "encoder_eccentricity" => {
                let of = |on_master: f64| {
                    let mut starts = pairs(("amplitude", &[0.5 * size]), ("order", &[1.0, 2.0]));
                    starts.iter_mut().for_each(|values| values.push(("on_master", on_master)));
                    starts
                };
                self.space([], [0.0, 1.0].map(of).concat()).phasor("amplitude", 10.0 * size)
            }
            _ => return None,
        })
    }

    /// Effects of the torque cell: only a hand reveals a factor, or a sign.
    fn sensor(&self) -> Option<Candidate> {
        let (features, size) = (self.features, self.size);
        let space = match self.id {
            "sensor_offset" => self.sizes(self.either("offset", 20.0), &[1.0]).signed(),
            "sensor_gain" => self.sizes(free("error", -0.8, 2.0), &[1.0]).signed(),
            "sensor_drift" => self.sizes(self.either("rate", 20.0), &[0.3]).signed(),
            "sensor_crosstalk" => self.sizes(self.either("coupling", 20.0), &[1.0]).signed(),
            "mains_hum" => self
                .space(
                    [waves_in_time("frequency_hz", 15.0, 124.0)],
                    pairs(("amplitude", &[size]), ("frequency_hz", &features.hum_hz)),
                )
                .phasor("amplitude", 20.0 * size),
            "rectified_sensor" => {
                let (parts, sizes): (&[f64], usize) = match features.rectified {
                    // A fully rectified reading does not scale with the rectified share.
                    true => (&[0.58, 0.66, 0.78, 0.95], 0),
                    false => (&[0.1, 0.4], 1),
                };
                let space = self.space([free("part", 0.0, 1.0)], each("part", parts));
                Candidate { sizes, ..space }
            }
            _ => return None,
        };
        let needs_hand = matches!(self.id, "sensor_gain" | "rectified_sensor");
        let revealed = features.torque && (features.hand || !needs_hand);
        Some(Candidate { starts: if revealed { space.starts } else { Vec::new() }, ..space })
    }

    fn by_size(&self, size: &ParameterInfo) -> Candidate {
        let most = MOST_SIZES * self.size.abs();
        let range = free(size.name, size.minimum.max(-most), size.maximum.min(most));
        let signed = range.low < 0.0 && range.high > 0.0;
        let signs: &[f64] = if signed { &[1.0, -1.0] } else { &[1.0] };
        let factors =
            DEFAULT_STARTS.iter().flat_map(|factor| signs.iter().map(move |sign| sign * factor));
        let values: Vec<f64> =
            factors.map(|factor| (factor * self.size).clamp(range.low, range.high)).collect();
        Candidate { signed, ..self.space([range], each(size.name, &values)) }
    }
}

#[cfg(test)]
mod tests;
