//! What the virtual card adds to the declared model.

use plant::sensors::ScannerTrigger;

use crate::axis_unit::AxisUnit;
use crate::channel::{Channel, ChannelKind};
use crate::rates::Rates;
use crate::read::{Section, Source, bounds};

/// Defaults for the virtual card: the sensors' noise, the hand at the handle, the seed of all
/// chance.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// The scanner that pulses on the channels of kind `trigger`; `None` where none runs.
    pub scanner: Option<ScannerTrigger>,
    /// Hard stops that end the handle's travel: below and above (rad or m); `None` where it moves
    /// without end.
    pub end_stops: Option<(f64, f64)>,
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
    /// Stiffness about where the hand wants to be (N·m/rad or N/m).
    pub stiffness: f64,
    /// Amplitude of the movement that a moving hand wants (rad or m).
    pub amplitude: f64,
    /// Its frequency (Hz).
    pub frequency_hz: f64,
}

/// What the hand does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandKind {
    /// Nobody holds the handle.
    Absent,
    /// A relaxed hand: a spring and a damper (and a mass) that the handle moves.
    Passive,
    /// A hand that moves to and fro along a sine: the same spring and damper, about where it wants
    /// to be.
    Moving,
}

impl Simulation {
    pub(crate) fn read(section: Section<'_>, unit: AxisUnit) -> Self {
        let noise =
            |key, default, advice| section.number_or(key, default, bounds(0.0, 1.0, advice));
        let simulation = Self {
            seed: section.whole_or("seed", 1, 0, i64::MAX as u64, "any whole number"),
            encoder_noise_counts: noise("encoder_noise_counts", 0.3, "an encoder's noise is a fraction of a count"),
            torque_noise_v: noise("torque_noise_v", 0.002, "in V, standard deviation"),
            torque_bandwidth_hz: section.number_or(
                "torque_bandwidth_hz",
                200.0,
                bounds(0.1, 1e5, "in Hz; an optical cell follows a hand with ease"),
            ),
            torque_drift_v_per_s: section.number_or(
                "torque_drift_v_per_s",
                0.0,
                bounds(-1.0, 1.0, "in V/s; 1 mV a minute is 1.7e-5"),
            ),
            torque_walk_v_per_sqrt_s: section.number_or(
                "torque_walk_v_per_sqrt_s",
                0.0,
                bounds(0.0, 1.0, "in V/√s; a zero that is off by 60 mV (standard deviation) after an hour is 1e-3"),
            ),
            analog_noise_v: noise("analog_noise_v", 0.001, "in V, standard deviation"),
            emg_rms_v: noise("emg_rms_v", 0.2, "in V, after the EMG's amplifier"),
            scanner: read_scanner(&section),
            end_stops: read_end_stops(&section, unit),
            hand: Hand::read(section.section("hand"), unit),
        };
        section.finish();
        simulation
    }

    /// What can only be seen with the other sections at hand.
    pub(crate) fn check(&self, channels: &[Channel], rates: &Rates, source: &Source<'_>) {
        let Some(scanner) = &self.scanner else { return };
        let key = |name: &str| format!("simulation.{name}");
        let scan_s = rates.acquisition_period_ns() as f64 * 1e-9;
        if scanner.pulse_s >= scanner.repetition_s {
            let expected = format!("less than trigger_repetition_s ({} s)", scanner.repetition_s);
            source.problem(
                &key("trigger_pulse_s"),
                expected,
                scanner.pulse_s,
                "a pulse ends before the next begins",
            );
        } else if scanner.pulse_s < scan_s || scanner.repetition_s - scanner.pulse_s < scan_s {
            let expected =
                format!("at least one scan ({scan_s} s), and as much between two pulses");
            let advice = "what is shorter falls between two scans and is missed";
            source.problem(&key("trigger_pulse_s"), expected, scanner.pulse_s, advice);
        }
        let inputs: Vec<_> =
            channels.iter().filter(|channel| channel.kind == ChannelKind::Trigger).collect();
        if inputs.is_empty() {
            let (expected, found) =
                ("0, as no channel is of kind \"trigger\"", scanner.repetition_s);
            let advice = "add [[channels]] with kind = \"trigger\", or switch the scanner off";
            source.problem(&key("trigger_repetition_s"), expected, found, advice);
        }
        for channel in inputs {
            for (name, volts) in
                [("trigger_idle_v", scanner.idle_v), ("trigger_pulse_v", scanner.pulse_v)]
            {
                if volts.abs() > channel.range_v {
                    let expected = format!(
                        "within the ±{} V of the channel \"{}\"",
                        channel.range_v, channel.name
                    );
                    source.problem(
                        &key(name),
                        expected,
                        volts,
                        "widen the channel's range_v, or lower the level",
                    );
                }
            }
        }
        if scanner.idle_v == scanner.pulse_v {
            let expected = format!("another level than trigger_idle_v ({} V)", scanner.idle_v);
            let advice = "nobody sees a pulse that changes nothing";
            source.problem(&key("trigger_pulse_v"), expected, scanner.pulse_v, advice);
        }
    }
}

/// The ends of the handle's travel, both or none.
fn read_end_stops(section: &Section<'_>, unit: AxisUnit) -> Option<(f64, f64)> {
    let (low, high, most) = match unit {
        AxisUnit::Radian => ("end_stop_min_deg", "end_stop_max_deg", 360.0),
        AxisUnit::Metre => ("end_stop_min_m", "end_stop_max_m", 5.0),
    };
    let lower =
        section.number_or_none(low, bounds(-most, 0.0, "the card begins at 0, between the stops"));
    let upper =
        section.number_or_none(high, bounds(0.0, most, "the card begins at 0, between the stops"));
    match (lower, upper) {
        (Some(lower), Some(upper)) if lower < upper => {
            Some((lower * unit.si_per_file_unit(), upper * unit.si_per_file_unit()))
        }
        (None, None) => None,
        (Some(_), Some(_)) => {
            section.problem(
                high,
                format!("more than {low}"),
                "stops at the same place",
                "leave some way between them",
            );
            None
        }
        (lower, _) => {
            let (given, missing) = if lower.is_some() { (low, high) } else { (high, low) };
            section.problem(
                given,
                "both stops",
                "one",
                format!("add {missing}, or take this one out"),
            );
            None
        }
    }
}

/// The scanner's keys; its first volume begins with the card.
fn read_scanner(section: &Section<'_>) -> Option<ScannerTrigger> {
    let number = |key, default, least, most, advice| {
        section.number_or(key, default, bounds(least, most, advice))
    };
    let usual = ScannerTrigger::default();
    let repetition_s =
        number("trigger_repetition_s", 0.0, 0.0, 60.0, "TR in s; 0 where no scanner runs");
    let scanner = ScannerTrigger {
        repetition_s,
        pulse_s: number("trigger_pulse_s", usual.pulse_s, 1e-6, 60.0, "length of a pulse, in s"),
        idle_v: number("trigger_idle_v", usual.idle_v, -10.0, 10.0, "level between pulses, in V"),
        pulse_v: number(
            "trigger_pulse_v",
            usual.pulse_v,
            -10.0,
            10.0,
            "level during a pulse, in V",
        ),
        ..usual
    };
    if repetition_s > 0.0 && repetition_s < SHORTEST_REPETITION_S {
        let expected = format!("0 or at least {SHORTEST_REPETITION_S} s");
        section.problem(
            "trigger_repetition_s",
            expected,
            repetition_s,
            "TR in s; 0 where no scanner runs",
        );
    }
    (repetition_s > 0.0).then_some(scanner)
}

/// Shortest time between two volumes that the model of the trigger stands for (s).
const SHORTEST_REPETITION_S: f64 = 1e-3;

/// Time in which a moving hand comes to its full amplitude (s).
const SETTING_OFF_S: f64 = 1.0;

impl Hand {
    /// Torque on the handle (N·m or N) at its position and velocity, `time_s` after it set off. A
    /// moving hand does so gently: its amplitude grows to the full in the first second.
    pub fn torque(&self, position: f64, velocity: f64, time_s: f64) -> f64 {
        let (wanted, wanted_velocity) = match self.kind {
            HandKind::Absent => return 0.0,
            HandKind::Passive => (0.0, 0.0),
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
        let words = &[
            ("absent", HandKind::Absent),
            ("passive", HandKind::Passive),
            ("moving", HandKind::Moving),
        ];
        let positive =
            |key, default, most, advice| section.number_or(key, default, bounds(0.0, most, advice));
        let amplitude = match unit {
            AxisUnit::Radian => {
                positive("amplitude_deg", 60.0, 120.0, "either way, in degrees; of a moving hand")
            }
            AxisUnit::Metre => {
                positive("amplitude_m", 0.05, 5.0, "either way, in m; of a moving hand")
            }
        };
        let hand = Self {
            kind: section.word_or_none("kind", words).unwrap_or(HandKind::Passive),
            inertia: positive("inertia", 0.0, 5.0, "kg·m², or kg on an axis in m"),
            damping: positive("damping", 0.05, 100.0, "N·m·s/rad, or N·s/m on an axis in m"),
            stiffness: positive("stiffness", 0.3, 1e4, "N·m/rad, or N/m on an axis in m"),
            amplitude: unit.si_per_file_unit() * amplitude,
            frequency_hz: positive(
                "frequency_hz",
                1.0,
                10.0,
                "in Hz; § 4.2 has 3; for kind = \"moving\"",
            ),
        };
        section.finish();
        hand
    }
}
