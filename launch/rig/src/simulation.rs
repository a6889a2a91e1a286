//! What the virtual card adds to the declared model.

use crate::read::{Section, bounds};

/// Defaults for the virtual card: the sensors' noise, the hand at the handle, the seed of all chance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Simulation {
    /// Seed of the noise: the same seed gives the same noise.
    pub seed: u64,
    /// Standard deviation of an encoder's reading before it is rounded to counts (counts).
    pub encoder_noise_counts: f64,
    /// Standard deviation of the noise on the torque channel (V).
    pub torque_noise_v: f64,
    /// Standard deviation of the noise on every other analog input (V).
    pub analog_noise_v: f64,
    /// RMS of the simulated EMG of a fully active muscle (V).
    pub emg_rms_v: f64,
    /// Who holds the handle.
    pub hand: Hand,
}

/// The hand at the slave's handle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hand {
    /// Whether there is one.
    pub kind: HandKind,
    /// Inertia (kg·m² or kg).
    pub inertia: f64,
    /// Damping (N·m·s/rad or N·s/m).
    pub damping: f64,
    /// Stiffness about the position at rest, 0 (N·m/rad or N/m).
    pub stiffness: f64,
}

/// What the hand does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandKind {
    /// Nobody holds the handle.
    Absent,
    /// A relaxed hand: a spring and a damper (and a mass) that the handle moves.
    Passive,
}

impl Simulation {
    pub(crate) fn read(section: Section<'_>) -> Self {
        let noise = |key, default, advice| section.number_or(key, default, bounds(0.0, 1.0, advice));
        let simulation = Self {
            seed: section.whole_or("seed", 1, 0, i64::MAX as u64, "any whole number"),
            encoder_noise_counts: noise("encoder_noise_counts", 0.3, "an encoder's noise is a fraction of a count"),
            torque_noise_v: noise("torque_noise_v", 0.002, "in V, standard deviation"),
            analog_noise_v: noise("analog_noise_v", 0.001, "in V, standard deviation"),
            emg_rms_v: noise("emg_rms_v", 0.2, "in V, after the EMG's amplifier"),
            hand: Hand::read(section.section("hand")),
        };
        section.finish();
        simulation
    }
}

impl Hand {
    fn read(section: Section<'_>) -> Self {
        let words = &[("absent", HandKind::Absent), ("passive", HandKind::Passive)];
        let positive = |key, default, most, advice| section.number_or(key, default, bounds(0.0, most, advice));
        let hand = Self {
            kind: section.word_or_none("kind", words).unwrap_or(HandKind::Passive),
            inertia: positive("inertia", 0.0, 5.0, "kg·m², or kg on an axis in m"),
            damping: positive("damping", 0.05, 100.0, "N·m·s/rad, or N·s/m on an axis in m"),
            stiffness: positive("stiffness", 0.3, 1e4, "N·m/rad, or N/m on an axis in m"),
        };
        section.finish();
        hand
    }
}
