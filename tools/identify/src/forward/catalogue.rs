//! The listed effects as a search meets them: what of each is free, and from which sizes and shapes
//! the search begins.
//!
//! One direction or one size alone loses right answers: a backlash has no gradient at zero, a
//! saturation acts seldom. So each effect is tried from several starts, each a complete setting.

use std::f64::consts::FRAC_PI_2;

use plant::effects::{LIST, Place, Site};

use super::machine::Placed;
use super::record::PACE_S;

/// Least dead time of a line (s): a step of the simulation, and a little.
const LEAST_WAVE_S: f64 = 1.05 * PACE_S;

/// Least travel before sliding, in counts of the encoder beside it (1).
const COUNTS_OF_TRAVEL: f64 = 2.0;

/// A parameter of an effect that a fit moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Free {
    /// Its name.
    pub name: &'static str,
    /// Least value.
    pub low: f64,
    /// Greatest value.
    pub high: f64,
    /// How it is searched.
    pub way: Way,
}

/// How a parameter is searched, and how far aside its slope is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// As it is: the effect's range is wide beside what its size may be.
    Straight,
    /// By its logarithm.
    Logarithmic,
    /// By its logarithm, as waves in a second: a wave that is a little off is out of step at the
    /// end of all records.
    WavesInTime,
    /// By its logarithm, as waves in a turn: the same over a movement.
    WavesInAngle,
}

/// From where a search begins.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// A complete setting.
    pub placed: Placed,
    /// The same a quarter of a period on, for effects with amplitude and phase: two directions in
    /// one.
    pub quadrature: Option<Placed>,
    /// Whether the size may turn its sign.
    pub signed: bool,
}

/// When an effect is fitted from all its starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AllStarts {
    /// Wherever nothing has come down to what repeats differ by.
    Always,
    /// There, where what is missing enters at one place.
    AtOnePlace,
}

/// One effect at one site.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Its id.
    pub id: &'static str,
    /// Where.
    pub site: Site,
    /// What a fit moves.
    pub free: Vec<Free>,
    /// How many of a start's values, from the first, are sizes that grow with the effect.
    pub sizes: usize,
    /// Whether a fit reaches it from some of its starts only, whatever the slopes say: from which,
    /// only fits tell.
    pub from_all_starts: Option<AllStarts>,
    /// Amplitude of an effect that has one and a phase, and its greatest value: a fit moves its
    /// sine and cosine part.
    pub wave: Option<(&'static str, f64)>,
    /// Where the search begins.
    pub starts: Vec<Start>,
}

/// What the records look like, as far as starts depend on it.
#[derive(Clone, Debug, Default)]
pub struct Scale {
    /// Largest volts (V).
    pub volts: f64,
    /// Frequencies of disturbances that stand out, of master and slave (Hz).
    pub lines_hz: [Vec<f64>; 2],
    /// Frequencies that stand out in the torque channel (Hz).
    pub hum_hz: Vec<f64>,
    /// Orders of a ripple over the motor's angle that stand out (1).
    pub orders: Vec<f64>,
    /// Counts of master and slave (rad).
    pub count_rad: [f64; 2],
    /// Whether a hand's torque is measured.
    pub torque: bool,
    /// Whether a hand moved the handle in any record.
    pub hand: bool,
    /// Whether the torque channel shows both signs as one.
    pub folded: bool,
    /// Whether the slave's position is measured.
    pub slave: bool,
}

const fn free(name: &'static str, low: f64, high: f64) -> Free {
    Free { name, low, high, way: Way::Straight }
}

const fn by_logarithm(name: &'static str, low: f64, high: f64) -> Free {
    Free { name, low, high, way: Way::Logarithmic }
}

const fn waves_in_time(name: &'static str, low: f64, high: f64) -> Free {
    Free { name, low, high, way: Way::WavesInTime }
}

const fn waves_in_angle(name: &'static str, low: f64, high: f64) -> Free {
    Free { name, low, high, way: Way::WavesInAngle }
}

/// All effects at all their sites, as far as records of this kind can show them.
pub fn candidates(scale: &Scale) -> Vec<Candidate> {
    LIST.iter()
        .flat_map(|entry| entry.sites.iter().filter_map(|place| candidate(entry.id, place, scale)))
        .filter(|candidate| scale.slave || candidate.site != Site::Slave)
        .collect()
}

fn candidate(id: &'static str, place: &Place, scale: &Scale) -> Option<Candidate> {
    let (site, size) = (place.site, place.size);
    let placed = |values: &[(&'static str, f64)]| Placed { id, site, values: values.to_vec() };
    let start = |values: &[(&'static str, f64)]| Start {
        placed: placed(values),
        quadrature: None,
        signed: false,
    };
    let signed = |values: &[(&'static str, f64)]| Start { signed: true, ..start(values) };
    // Amplitude and phase: one start is two directions.
    let wave = |values: &[(&'static str, f64)]| {
        let with = |phase: f64| {
            let mut values = values.to_vec();
            values.push(("phase", phase));
            placed(&values)
        };
        Start { placed: with(0.0), quadrature: Some(with(FRAC_PI_2)), signed: true }
    };
    let sizes = |name: &'static str, factors: &[f64]| -> Vec<Start> {
        factors.iter().map(|factor| start(&[(name, factor * size)])).collect()
    };
    let up_to = |name: &'static str, factor: f64| free(name, 0.0, factor * size);
    let either = |name: &'static str, factor: f64| free(name, -factor * size, factor * size);
    let mut amplitude = None;
    let mut waves = |name: &'static str, most: f64| amplitude = Some((name, most));
    let (free, starts): (Vec<Free>, Vec<Start>) = match id {
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
        // A wave along the line takes longer than a step of the simulation, or the model does not
        // see it.
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
            // A wave longer than a turn is no wave.
            (vec![waves_in_angle("order", 0.9, 12.0)], starts.collect())
        }
        "load_dependent_friction" => {
            (vec![free("coefficient", 0.0, 0.9)], sizes("coefficient", &[0.3, 1.0, 2.0]))
        }
        "presliding_hysteresis" => {
            // What an encoder does not resolve is the rounding of friction at rest by another name.
            let least = (COUNTS_OF_TRAVEL * scale.count_rad[usize::from(site == Site::Slave)])
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
            // A low order is a hill beside what position does otherwise, and stands out of nothing.
            let orders = scale.orders.iter().copied().chain([4.0, 5.0, 6.0, 7.0, 8.0]);
            let starts = orders.map(|order| wave(&[("amplitude", 0.5 * size), ("order", order)]));
            (vec![waves_in_angle("order", 3.5, 200.0)], starts.collect())
        }
        "amplifier_saturation" => (
            vec![free("limit", 0.2 * scale.volts, scale.volts)],
            [0.45, 0.6, 0.75, 0.9]
                .iter()
                .map(|share| start(&[("limit", share * scale.volts)]))
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
            let lines = &scale.lines_hz[usize::from(site == Site::Slave)];
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
        _ if !scale.torque => return None,
        "sensor_offset" => (vec![either("offset", 20.0)], vec![signed(&[("offset", size)])]),
        "sensor_gain" if scale.hand => {
            (vec![free("error", -0.8, 2.0)], vec![signed(&[("error", size)])])
        }
        "sensor_drift" => (vec![either("rate", 20.0)], vec![signed(&[("rate", 0.3 * size)])]),
        "sensor_crosstalk" => (vec![either("coupling", 20.0)], vec![signed(&[("coupling", size)])]),
        "mains_hum" => {
            waves("amplitude", 20.0 * size);
            let starts =
                scale.hum_hz.iter().map(|hz| wave(&[("amplitude", size), ("frequency_hz", *hz)]));
            (vec![waves_in_time("frequency_hz", 15.0, 124.0)], starts.collect())
        }
        "rectified_sensor" if scale.hand => {
            let parts: &[f64] = if scale.folded { &[0.58, 0.66, 0.78, 0.95] } else { &[0.1, 0.4] };
            (
                vec![free("part", 0.0, 1.0)],
                parts.iter().map(|part| start(&[("part", *part)])).collect(),
            )
        }
        _ => return None,
    };
    let sizes = match id {
        // A limit does not grow with the effect, and a reading that has lost its sign does not
        // shrink with the part that is folded.
        "amplifier_saturation" => 0,
        "rectified_sensor" if scale.folded => 0,
        // An odd and an even part.
        "nonlinear_stiffness" => 2,
        _ => 1,
    };
    // Friction beside declared friction, which takes its part as far as its tolerance goes and then
    // stands at the end of it; waves in a line, beside its declared stiffness.
    let from_all_starts = match id {
        "stribeck_friction" => Some(AllStarts::Always),
        "transport_delay" if site == Site::Line => Some(AllStarts::Always),
        "coulomb_friction" => Some(AllStarts::AtOnePlace),
        _ => None,
    };
    (!starts.is_empty()).then_some(Candidate {
        id,
        site,
        free,
        sizes,
        from_all_starts,
        wave: amplitude,
        starts,
    })
}
