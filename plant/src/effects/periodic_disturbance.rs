//! `periodic_disturbance`: a vibration of fixed frequency.
//!
//! `τ += a sin(2π f t + φ)`: the scanner's gradients shake the table.
//!
//! # In a model of one channel
//!
//! A vibration at a fixed frequency.
//!
//! `F = sine · sin(2π f t) + cosine · cos(2π f t)`: gradients of the scanner shake the table, or a
//! pump runs nearby.
//!
//! Parameters: `sine`, `cosine` (N, N·m or V); `frequency` `f` (Hz), from two periods per record to
//! 1.1 times the cut-off frequency, except within 0.15 Hz of 50 and 60 Hz, where a tone counts as
//! mains hum.
//!
//! In a residual: one spectral line, independent of the movement. Confused with: mains hum, torque
//! ripple at constant speed, a periodic movement of the same frequency.

use super::one_channel::{Quantity, Shape, Term, samples};
use super::search::{SearchRange, pairs};
use super::{Effect, Moment, SideLoad, Site, effect};

effect! {
    "periodic_disturbance": "a vibration of fixed frequency";
    at Slave = 0.2 "N m", Master = 0.2 "N m";
    /// A vibration.
    pub struct PeriodicDisturbance {
        /// Amplitude `a`.
        amplitude: "N m (N)", 0.0, 1e3, 0.2, "assumed";
        /// Frequency `f`.
        frequency_hz: "Hz", 0.01, 900.0, 11.0, "assumed: echo-planar slices per second";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.0, "assumed";
    }
    search {
        space: |of| {
            let lines = &of.features.lines_hz[usize::from(of.site == Site::Slave)];
            of.space(
                [SearchRange::frequency("frequency_hz", 0.3, 120.0)],
                pairs(("amplitude", &[0.3 * of.size]), ("frequency_hz", lines)),
            )
            .phasor("amplitude", 10.0 * of.size)
        },
    }
    one_channel {
        rank: 220,
        words: "a vibration of fixed frequency",
        experiment: "the same record with the machine at rest, and with the suspected source \
                     switched off",
        is_tone: true,
        terms: Term::sine_and_cosine,
        shapes: |axis| {
            let range = (2.0 / axis.seconds, 1.1 * axis.cut_off);
            vec![Shape::by_steps(
                "frequency",
                "Hz",
                range,
                samples::points((range.1 - range.0) * axis.seconds),
            )]
        },
        force: Some(|now, shapes, _, out| {
            let frequency = samples::beside_mains(shapes[0]);
            (out[0], out[1]) = (std::f64::consts::TAU * frequency * now.time).sin_cos();
        }),
        of_plant: |fit| {
            let frequency = Quantity { name: "frequency_hz", ..*fit.own("frequency")? };
            Some([fit.wave("amplitude", -1.0)?, vec![frequency]].concat())
        },
    }
}

impl Effect for PeriodicDisturbance {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        let angle = std::f64::consts::TAU * self.frequency_hz * moment.time_s + self.phase;
        load.load.force += self.amplitude * angle.sin();
    }
}
