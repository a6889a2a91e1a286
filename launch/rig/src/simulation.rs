//! Settings of the simulated card beside the declared model.

use plant::sensors::ScannerEmulator;

use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Keys, Section, bounds};
use crate::simulated_scanner::read_scanner;

/// Settings of the simulated card: sensor noise, scanner, hard stops, the hand, the random seed.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// Seed of the noise: the same seed gives the same noise.
    pub seed: u64,
    /// Standard deviation of an encoder's reading before it is rounded to counts (counts).
    pub encoder_noise_counts: f64,
    /// Standard deviation of the noise on the torque channel (V).
    pub torque_noise_v: f64,
    /// Cut-off of the torque cell's low pass (Hz).
    pub torque_bandwidth_hz: f64,
    /// Steady drift of the torque cell's zero (V/s).
    pub torque_drift_v_per_s: f64,
    /// Random walk of the torque cell's zero (V/√s): after `t` seconds its standard deviation is
    /// this times `√t`.
    pub torque_walk_v_per_sqrt_s: f64,
    /// Standard deviation of the noise on every other analog input (V).
    pub analog_noise_v: f64,
    /// RMS of the simulated EMG of a fully active muscle (V).
    pub emg_rms_v: f64,
    /// Excitation of the antagonist over that of the agonist.
    pub emg_cocontraction: f64,
    /// The scanner that pulses on the channels of kind `trigger`; `None`: no scanner.
    pub scanner: Option<ScannerEmulator>,
    /// Lower and upper hard stop of the handle (rad or m); `None`: no stops.
    pub end_stops: Option<(f64, f64)>,
    /// The hand at the handle.
    pub hand: Hand,
}

/// The hand at the slave's handle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hand {
    /// What it does.
    pub kind: HandKind,
    /// Inertia (kg·m² or kg).
    pub inertia: f64,
    /// Damping (N·m·s/rad or N·s/m).
    pub damping: f64,
    /// Stiffness about the hand's target position (N·m/rad or N/m).
    pub stiffness: f64,
    /// Amplitude of a moving hand's target (rad or m).
    pub amplitude: f64,
    /// Its frequency (Hz).
    pub frequency_hz: f64,
    /// Time after which a subject reacts to what it sees (s).
    pub reaction_s: f64,
    /// Change of a subject's effort with each update of the bar, in relation to the bar's distance
    /// from its middle.
    pub correction: f64,
    /// Standard deviation of that change.
    pub variability: f64,
}

/// What the hand does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandKind {
    /// Nobody holds the handle.
    Absent,
    /// A relaxed hand: a mass, a spring and a damper that the handle moves.
    Passive,
    /// A hand whose target follows a sine, with the same spring and damper about it.
    Moving,
    /// A moving hand that takes part in an experiment with sessions: it moves under a green light,
    /// with an effort that follows the bar. Elsewhere a passive one.
    Subject,
}

const KEYS: Keys = &[
    ("seed", "Seed of the noise: the same seed gives the same noise."),
    ("encoder_noise_counts", "Standard deviation of an encoder's reading before it is rounded."),
    ("torque_noise_v", "Standard deviation of the noise on the torque channel."),
    ("torque_bandwidth_hz", "Cut-off of the torque cell's low pass."),
    ("torque_drift_v_per_s", "Steady drift of the torque cell's zero."),
    ("torque_walk_v_per_sqrt_s", "Random walk of the torque cell's zero."),
    ("analog_noise_v", "Standard deviation of the noise on every other analog input."),
    ("emg_rms_v", "RMS of the simulated EMG of a fully active muscle."),
    ("emg_cocontraction", "Excitation of the antagonist over that of the agonist."),
    ("trigger_repetition_s", "Repetition time of the MRI scanner; 0: no scanner."),
    ("trigger_pulse_s", "Length of a scanner pulse."),
    ("trigger_idle_v", "Level between pulses."),
    ("trigger_pulse_v", "Level during a pulse."),
    ("trigger_start_s", "Start of the first volume, from the card's first scan."),
    ("trigger_volumes", "Number of volumes; 0: without end."),
    ("trigger_jitter_s", "Standard deviation of the start of a pulse."),
    ("trigger_missing", "Volumes, from 0, whose pulse is missing."),
    ("trigger_spurious_s", "Times of pulses that belong to no volume, from the first scan."),
    ("end_stop_min_{deg,m}", "Position of the lower hard stop; both stops or none."),
    ("end_stop_max_{deg,m}", "Position of the upper hard stop."),
    ("hand", "The simulated hand at the handle."),
];

impl Simulation {
    pub(crate) fn read(section: Section<'_>, unit: AxisUnit) -> Self {
        section.document("[simulation]", KEYS);
        let noise =
            |key, default, advice| section.number_or(key, default, bounds(0.0, 1.0, advice));
        let bandwidth = bounds(0.1, 1e5, "in Hz; an optical cell is far faster than a hand");
        let drift = bounds(-1.0, 1.0, "in V/s; 1 mV a minute is 1.7e-5");
        let walk = bounds(0.0, 1.0, "in V/√s; 1e-3 is a standard deviation of 60 mV after an hour");
        let seed = section.whole_or("seed", 1, 0, i64::MAX as u64, "any whole number");
        Self {
            seed,
            encoder_noise_counts: noise("encoder_noise_counts", 0.3, "a fraction of a count"),
            torque_noise_v: noise("torque_noise_v", 0.002, "in V, standard deviation"),
            torque_bandwidth_hz: section.number_or("torque_bandwidth_hz", 200.0, bandwidth),
            torque_drift_v_per_s: section.number_or("torque_drift_v_per_s", 0.0, drift),
            torque_walk_v_per_sqrt_s: section.number_or("torque_walk_v_per_sqrt_s", 0.0, walk),
            analog_noise_v: noise("analog_noise_v", 0.001, "in V, standard deviation"),
            emg_rms_v: noise("emg_rms_v", 0.2, "in V, after the EMG's amplifier"),
            emg_cocontraction: noise("emg_cocontraction", 0.15, "0: none, 1: as much"),
            scanner: read_scanner(&section, seed),
            end_stops: read_end_stops(&section, unit),
            hand: Hand::read(section.section("hand"), unit),
        }
    }
}

/// Reads the hard stops, both or none.
fn read_end_stops(section: &Section<'_>, unit: AxisUnit) -> Option<(f64, f64)> {
    let (low, high, most) = unit.choose(
        ("end_stop_min_deg", "end_stop_max_deg", 360.0),
        ("end_stop_min_m", "end_stop_max_m", 5.0),
    );
    let advice = "the simulation starts at 0, between the stops";
    let lower = section.number_or_none(low, bounds(-most, 0.0, advice));
    let upper = section.number_or_none(high, bounds(0.0, most, advice));
    match (lower, upper) {
        (Some(lower), Some(upper)) if lower < upper => {
            Some((lower * unit.si_per_file_unit(), upper * unit.si_per_file_unit()))
        }
        (None, None) => None,
        (Some(_), Some(_)) => {
            let advice = "leave some distance between them";
            section.refuse(high, format!("more than {low}"), "stops at the same place", advice)
        }
        (lower, _) => {
            let (given, missing) = if lower.is_some() { (low, high) } else { (high, low) };
            let advice = format!("add {missing}, or take this one out");
            section.refuse(given, "both stops", "one", advice)
        }
    }
}

/// Time in which a moving hand reaches its full amplitude (s).
const SETTING_OFF_S: f64 = 1.0;

const HAND_KEYS: Keys = &[
    ("kind", "What the hand does."),
    ("inertia", "Inertia, in kg·m² (kg on an axis in m)."),
    ("damping", "Damping, in N·m·s/rad (N·s/m)."),
    ("stiffness", "Stiffness about the hand's target position, in N·m/rad (N/m)."),
    ("amplitude_{deg,m}", "Amplitude of a moving hand's target."),
    ("frequency_hz", "Frequency of a moving hand's target."),
    ("reaction_s", "Time after which a subject reacts to light and bar."),
    ("correction", "Change of a subject's effort with each update, over the bar's relative error."),
    ("variability", "Standard deviation of that change."),
];

impl Hand {
    /// Torque on the handle (N·m or N) at its position and velocity, `time_s` after the start. The
    /// amplitude of a moving hand rises within the first second.
    pub fn torque(&self, position: f64, velocity: f64, time_s: f64) -> f64 {
        let (wanted, wanted_velocity) = match self.kind {
            HandKind::Absent => return 0.0,
            HandKind::Passive | HandKind::Subject => (0.0, 0.0),
            HandKind::Moving => {
                let omega = std::f64::consts::TAU * self.frequency_hz;
                let (sine, cosine) = (omega * time_s).sin_cos();
                let (share, rate) = if time_s < SETTING_OFF_S {
                    (time_s / SETTING_OFF_S, 1.0 / SETTING_OFF_S)
                } else {
                    (1.0, 0.0)
                };
                (
                    self.amplitude * share * sine,
                    self.amplitude * (share * omega * cosine + rate * sine),
                )
            }
        };
        self.stiffness * (wanted - position) + self.damping * (wanted_velocity - velocity)
    }

    fn read(section: Section<'_>, unit: AxisUnit) -> Self {
        section.document("[simulation.hand]", HAND_KEYS);
        let words = &[
            ("absent", HandKind::Absent),
            ("passive", HandKind::Passive),
            ("moving", HandKind::Moving),
            ("subject", HandKind::Subject),
        ];
        let positive =
            |key, default, most, advice| section.number_or(key, default, bounds(0.0, most, advice));
        let (key, default, most, advice) = unit.choose(
            ("amplitude_deg", 60.0, 120.0, "either way, in degrees; of a moving hand"),
            ("amplitude_m", 0.05, 5.0, "either way, in m; of a moving hand"),
        );
        let amplitude = positive(key, default, most, advice);
        Self {
            kind: section.word_or("kind", words, HandKind::Passive),
            inertia: positive("inertia", 0.0, 5.0, "kg·m², or kg on an axis in m"),
            damping: positive("damping", 0.05, 100.0, "N·m·s/rad, or N·s/m on an axis in m"),
            stiffness: positive("stiffness", 0.3, 1e4, "N·m/rad, or N/m on an axis in m"),
            amplitude: unit.si_per_file_unit() * amplitude,
            frequency_hz: positive("frequency_hz", 1.0, 10.0, "in Hz, of a moving hand"),
            reaction_s: positive("reaction_s", 0.25, 2.0, "in s; people need 0.2 to 0.3 s"),
            correction: positive("correction", 0.3, 2.0, "1 takes all of the error at once"),
            variability: positive("variability", 0.05, 1.0, "a share of the effort"),
        }
    }
}
