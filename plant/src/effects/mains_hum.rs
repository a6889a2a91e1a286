//! `mains_hum`: hum at mains frequency in the torque channel.
//!
//! `τ → τ + a sin(2π f t + φ)`.
//!
//! # In a model of one channel
//!
//! Mains hum in the force channel.
//!
//! `F = sine · sin(2π f t) + cosine · cos(2π f t)` with `f` within 0.1 Hz of 50 or 60 Hz, the
//! tolerance of mains and sampling clock.
//!
//! Parameters: `sine`, `cosine` (N, N·m or V), a few tenths of a per cent to a few per cent of the
//! range; `frequency` `f` (Hz).
//!
//! In a residual: a spectral line at 50 or 60 Hz. A mechanical vibration at mains frequency cannot
//! be distinguished from it in one channel and is reported as hum. Confused with: periodic
//! disturbance.

use super::one_channel::{Shape, Spacing, Term, samples};
use super::search::{SearchRange, pairs};
use super::{Effect, Moment, Reading, effect};

effect! {
    "mains_hum": "mains frequency in the torque channel";
    at Sensor = 0.05 "N m";
    /// Mains frequency in the torque channel.
    pub struct MainsHum {
        /// Amplitude `a`.
        amplitude: "N m", 0.0, 100.0, 0.05, "assumed";
        /// Frequency `f`.
        frequency_hz: "Hz", 1.0, 1000.0, 50.0, "Europe";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.0, "assumed";
    }
    search {
        space: |of| of
            .space(
                [SearchRange::frequency("frequency_hz", 15.0, 124.0)],
                pairs(("amplitude", &[of.size]), ("frequency_hz", &of.features.hum_hz)),
            )
            .phasor("amplitude", 20.0 * of.size)
            .only_if(of.features.torque),
    }
    one_channel {
        rank: 240,
        words: "mains frequency in the measured force (hum)",
        experiment: "the same record at rest with the motor's supply off: hum stays, a vibration \
                     of the machine does not",
        applies: |axis| axis.cut_off > 35.0,
        is_tone: true,
        terms: Term::sine_and_cosine,
        shapes: |axis| {
            let points = 2 * samples::points(0.2 * axis.seconds);
            vec![Shape {
                spacing: Spacing::Mains,
                ..Shape::by_steps("frequency", "Hz", (49.9, 60.1), points)
            }]
        },
        force: Some(|now, shapes, _, out| {
            (out[0], out[1]) = (std::f64::consts::TAU * shapes[0] * now.time).sin_cos()
        }),
        // The plant's acts on the torque cell of a transmission.
        of_plant: |_| None,
    }
}

impl Effect for MainsHum {
    fn sense(&mut self, reading: &mut Reading, moment: &Moment) {
        let angle = std::f64::consts::TAU * self.frequency_hz * moment.time_s + self.phase;
        reading.slave_torque_nm += self.amplitude * angle.sin();
    }
}
