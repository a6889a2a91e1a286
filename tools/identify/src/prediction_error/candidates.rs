//! The listed effects as candidates of the stepwise selection: their free parameters and starting
//! points.
//!
//! Every effect is tried from several complete starting points, since a single sign or size misses
//! effects without a local gradient: backlash has none at zero gap, and saturation acts only at
//! peaks.

use std::f64::consts::FRAC_PI_2;

use plant::effects::{LIST, Place, Site};

use super::record::PACE_S;
use super::transmission_model::PlacedEffect;

/// Shortest dead time of a line (s): slightly more than one simulation step.
const LEAST_WAVE_S: f64 = 1.05 * PACE_S;

/// Shortest presliding travel, in counts of that side's encoder.
const COUNTS_OF_TRAVEL: f64 = 2.0;

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

/// Features of the records from which starting points are derived.
#[derive(Clone, Debug, Default)]
pub struct RecordFeatures {
    /// Largest motor voltage (V).
    pub volts: f64,
    /// Spectral lines in the residuals of master and slave (Hz).
    pub lines_hz: [Vec<f64>; 2],
    /// Spectral lines in the torque channel (Hz).
    pub hum_hz: Vec<f64>,
    /// Prominent orders of the master's residual over the motor angle (waves per turn of 2π rad).
    pub orders: Vec<f64>,
    /// Encoder resolution of master and slave (rad).
    pub count_rad: [f64; 2],
    /// Whether the hand torque is measured.
    pub torque: bool,
    /// Whether a hand drives the handle in any record.
    pub hand: bool,
    /// Whether the torque channel shows magnitudes only.
    pub rectified: bool,
    /// Whether the slave's position is measured.
    pub slave: bool,
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

/// Returns all listed effects at all their sites that records with these features can reveal.
pub fn candidates(features: &RecordFeatures) -> Vec<Candidate> {
    LIST.iter()
        .flat_map(|entry| {
            entry.sites.iter().filter_map(|place| candidate(entry.id, place, features))
        })
        .filter(|candidate| features.slave || candidate.site != Site::Slave)
        .collect()
}

fn candidate(id: &'static str, place: &Place, features: &RecordFeatures) -> Option<Candidate> {
    let (site, size) = (place.site, place.size);
    let placed =
        |values: &[(&'static str, f64)]| PlacedEffect { id, site, values: values.to_vec() };
    let start = |values: &[(&'static str, f64)]| StartPoint {
        placed: placed(values),
        quadrature: None,
        signed: false,
    };
    let signed = |values: &[(&'static str, f64)]| StartPoint { signed: true, ..start(values) };
    // Amplitude and phase: a starting point spans two directions.
    let wave = |values: &[(&'static str, f64)]| {
        let with = |phase: f64| {
            let mut values = values.to_vec();
            values.push(("phase", phase));
            placed(&values)
        };
        StartPoint { placed: with(0.0), quadrature: Some(with(FRAC_PI_2)), signed: true }
    };
    let sizes = |name: &'static str, factors: &[f64]| -> Vec<StartPoint> {
        factors.iter().map(|factor| start(&[(name, factor * size)])).collect()
    };
    let up_to = |name: &'static str, factor: f64| free(name, 0.0, factor * size);
    let either = |name: &'static str, factor: f64| free(name, -factor * size, factor * size);
    let mut amplitude = None;
    let mut waves = |name: &'static str, most: f64| amplitude = Some((name, most));
    let (free, starts): (Vec<SearchRange>, Vec<StartPoint>) = match id {
        "line_compliance" => {
            (vec![free("compliance_ratio", 0.0, 20.0)], sizes("compliance_ratio", &[0.3, 1.0, 3.0]))
        }
        "nonlinear_stiffness" => (
            vec![free("cubic", -0.9, 10.0), free("even", -0.95, 0.95)],
            vec![
                start(&[("cubic", 0.3)]),
                start(&[("cubic", 1.5)]),
                start(&[("cubic", -0.2)]),
                start(&[("cubic", 0.01), ("even", 0.25)]),
                start(&[("cubic", 0.01), ("even", -0.25)]),
            ],
        ),
        "viscoelastic_line" => (
            vec![free("stiffness_ratio", 0.0, 10.0), by_logarithm("relaxation_s", 3e-3, 3.0)],
            [0.01, 0.03, 0.1, 0.3]
                .iter()
                .flat_map(|time| {
                    [0.2, 1.0]
                        .map(|ratio| start(&[("stiffness_ratio", ratio), ("relaxation_s", *time)]))
                })
                .collect(),
        ),
        "leakage" => (
            vec![by_logarithm("conductance", 0.01 * size, 100.0 * size)],
            sizes("conductance", &[0.3, 1.0, 4.0]),
        ),
        "backlash" => (vec![up_to("gap", 20.0)], sizes("gap", &[0.25, 1.0, 3.0])),
        // A line's wave must take longer than a simulation step to have any effect.
        "transport_delay" if site == Site::Line => {
            (vec![free("delay_s", LEAST_WAVE_S, 0.05)], sizes("delay_s", &[0.6, 1.2, 2.0]))
        }
        "transport_delay" => (vec![free("delay_s", 0.0, 0.05)], sizes("delay_s", &[0.2, 0.6, 2.0])),
        "line_damping" => (vec![up_to("damping", 20.0)], sizes("damping", &[0.3, 1.0, 3.0])),
        "coulomb_friction" => (vec![up_to("level", 10.0)], sizes("level", &[0.3, 1.0, 3.0])),
        "viscous_friction" => (vec![up_to("coefficient", 20.0)], sizes("coefficient", &[0.3, 1.0])),
        "quadratic_drag" => (vec![up_to("coefficient", 20.0)], sizes("coefficient", &[0.3, 1.0])),
        "stribeck_friction" => (
            vec![up_to("level", 6.0), by_logarithm("speed", 0.03, 10.0)],
            [0.1, 0.4, 1.5]
                .iter()
                .flat_map(|speed| {
                    [0.4, 1.0, 2.5]
                        .map(|level| start(&[("level", level * size), ("speed", *speed)]))
                })
                .collect(),
        ),
        "asymmetric_friction" => (
            vec![either("difference", 6.0), free("viscous_time", 0.0, 2.0)],
            [0.0, 0.1, 0.5]
                .iter()
                .map(|time| signed(&[("difference", 0.5 * size), ("viscous_time", *time)]))
                .collect(),
        ),
        "position_dependent_friction" => {
            waves("amplitude", 1.0);
            let starts = [1.0, 2.0, 3.0, 5.0]
                .iter()
                .map(|order| wave(&[("amplitude", 0.2), ("order", *order)]));
            // Below one wave per turn, the friction is no longer periodic over the stroke.
            (vec![waves_in_angle("order", 0.9, 12.0)], starts.collect())
        }
        "load_dependent_friction" => {
            (vec![free("coefficient", 0.0, 0.9)], sizes("coefficient", &[0.3, 1.0, 2.0]))
        }
        "presliding_hysteresis" => {
            // A travel below the encoder's resolution is equivalent to the smoothing of dry
            // friction.
            let least = (COUNTS_OF_TRAVEL * features.count_rad[usize::from(site == Site::Slave)])
                .clamp(5e-4, 0.05);
            let starts = [0.004, 0.015, 0.06]
                .map(|travel| f64::max(travel, 1.3 * least))
                .into_iter()
                .flat_map(|travel| {
                    [0.4, 0.95].map(|part| start(&[("part", part), ("travel", travel)]))
                });
            (vec![free("part", 0.0, 1.0), by_logarithm("travel", least, 0.3)], starts.collect())
        }
        "gravity_imbalance" => {
            waves("torque", 10.0 * size);
            (Vec::new(), vec![wave(&[("torque", 0.5 * size)])])
        }
        "extra_inertia" => (vec![up_to("inertia", 20.0)], sizes("inertia", &[0.3, 1.0])),
        "hand_impedance" => (
            vec![
                free("stiffness", 0.0, 30.0),
                free("damper_time_s", 0.0, 0.5),
                free("inertia_time_s", 0.0, 0.2),
            ],
            vec![
                start(&[("stiffness", 0.3), ("damper_time_s", 0.02), ("inertia_time_s", 0.02)]),
                start(&[("stiffness", 1.0), ("damper_time_s", 0.03), ("inertia_time_s", 0.05)]),
                start(&[("stiffness", 1.0), ("damper_time_s", 0.1), ("inertia_time_s", 0.0)]),
            ],
        ),
        "torque_ripple" => {
            waves("amplitude", 10.0 * size);
            // Low orders show no spectral line among other functions of position.
            let orders = features.orders.iter().copied().chain([4.0, 5.0, 6.0, 7.0, 8.0]);
            let starts = orders.map(|order| wave(&[("amplitude", 0.5 * size), ("order", order)]));
            (vec![waves_in_angle("order", 3.5, 200.0)], starts.collect())
        }
        "amplifier_saturation" => (
            vec![free("limit", 0.2 * features.volts, features.volts)],
            [0.45, 0.6, 0.75, 0.9]
                .iter()
                .map(|share| start(&[("limit", share * features.volts)]))
                .collect(),
        ),
        "amplifier_deadzone" => {
            (vec![up_to("half_width", 10.0)], sizes("half_width", &[0.5, 1.5, 4.0]))
        }
        "amplifier_lag" => (
            vec![by_logarithm("time_constant", 2e-4, 0.1)],
            sizes("time_constant", &[0.3, 1.0, 3.0]),
        ),
        "thermal_drift" => (
            vec![free("excess", -0.9, 6.0), by_logarithm("time_constant_s", 3.0, 1000.0)],
            [10.0, 30.0, 100.0]
                .iter()
                .map(|time| signed(&[("excess", 0.3), ("time_constant_s", *time)]))
                .collect(),
        ),
        "periodic_disturbance" => {
            let lines = &features.lines_hz[usize::from(site == Site::Slave)];
            waves("amplitude", 10.0 * size);
            let starts =
                lines.iter().map(|hz| wave(&[("amplitude", 0.3 * size), ("frequency_hz", *hz)]));
            (vec![waves_in_time("frequency_hz", 0.3, 120.0)], starts.collect())
        }
        "encoder_eccentricity" => {
            let starts = [0.0, 1.0].iter().flat_map(|master| {
                [1.0, 2.0].map(|order| {
                    wave(&[("amplitude", 0.5 * size), ("order", order), ("on_master", *master)])
                })
            });
            waves("amplitude", 10.0 * size);
            (Vec::new(), starts.collect())
        }
        _ if !features.torque => return None,
        "sensor_offset" => (vec![either("offset", 20.0)], vec![signed(&[("offset", size)])]),
        "sensor_gain" if features.hand => {
            (vec![free("error", -0.8, 2.0)], vec![signed(&[("error", size)])])
        }
        "sensor_drift" => (vec![either("rate", 20.0)], vec![signed(&[("rate", 0.3 * size)])]),
        "sensor_crosstalk" => (vec![either("coupling", 20.0)], vec![signed(&[("coupling", size)])]),
        "mains_hum" => {
            waves("amplitude", 20.0 * size);
            let starts = features
                .hum_hz
                .iter()
                .map(|hz| wave(&[("amplitude", size), ("frequency_hz", *hz)]));
            (vec![waves_in_time("frequency_hz", 15.0, 124.0)], starts.collect())
        }
        "rectified_sensor" if features.hand => {
            let parts: &[f64] =
                if features.rectified { &[0.58, 0.66, 0.78, 0.95] } else { &[0.1, 0.4] };
            (
                vec![free("part", 0.0, 1.0)],
                parts.iter().map(|part| start(&[("part", *part)])).collect(),
            )
        }
        _ => return None,
    };
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
        "transport_delay" if site == Site::Line => Some(MultiStart::Always),
        "coulomb_friction" => Some(MultiStart::WhenLocalised),
        _ => None,
    };
    (!starts.is_empty()).then_some(Candidate {
        id,
        site,
        free,
        sizes,
        multi_start,
        phasor: amplitude,
        starts,
    })
}
