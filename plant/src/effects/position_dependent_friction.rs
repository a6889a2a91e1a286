//! `position_dependent_friction`: friction that varies along the stroke.
//!
//! All dry friction of the side times `1 + a sin(n q + φ)`. Ch. 4 (introduction): "static friction
//! varies with position"; fig. 5.5 shows it.
//!
//! # In a model of one channel
//!
//! Friction that varies along the stroke.
//!
//! `F = sign(v) · (sine · sin(n x) + cosine · cos(n x))` beside Coulomb friction: a bent spindle,
//! an eccentric pulley, a bore that is not straight. Source: first harmonic of any variation;
//! thesis, ch. 4 and fig. 5.5.
//!
//! Parameters: `sine`, `cosine` (N or N·m), of an amplitude below the Coulomb friction; `order` `n`
//! (rad/m, or waves per turn), 0.4 to 12 waves over the travel.
//!
//! In a residual: plotted over the position, a wave in one direction and its mirror image in the
//! other. Confused with: torque ripple and gravity (equal in both directions), drift where the
//! stroke is made only once.

use super::one_channel::{Shape, Term};
use super::search::{SearchRange, pairs};
use super::{Effect, Moment, SideLoad, effect};
use crate::friction::PositionDependent;

effect! {
    "position_dependent_friction": "friction that varies along the stroke";
    at Master = 0.3 "1", Slave = 0.3 "1";
    /// Friction that varies along the stroke.
    pub struct PositionDependentFriction {
        /// Relative amplitude `a`.
        amplitude: "1", -1.0, 1.0, 0.3, "fig. 5.5, order of magnitude";
        /// Waves per radian of angle `n`.
        order: "1/rad (1/m)", 0.01, 1000.0, 1.0, "assumed";
        /// Phase `φ`.
        phase: "rad", -3.15, 3.15, 0.785, "assumed";
    }
    search {
        space: |of| of
            .space(
                [SearchRange::spatial_frequency("order", 0.9, 12.0)],
                pairs(("amplitude", &[0.2]), ("order", &[1.0, 2.0, 3.0, 5.0])),
            )
            .phasor("amplitude", 1.0),
    }
    one_channel {
        rank: 80,
        words: "friction that varies along the stroke",
        experiment: "the whole stroke at one slow constant speed, both ways, several times: half \
                     the difference of the two directions over the position is the friction",
        needs: &["coulomb_friction"],
        uses_sign: true,
        terms: Term::sine_and_cosine,
        shapes: |axis| {
            let wave = std::f64::consts::TAU / axis.travel();
            vec![Shape::by_steps(
                "order",
                format!("rad/{}", axis.units.position),
                (0.4 * wave, 12.0 * wave),
                59,
            )]
        },
        force: Some(|now, shapes, _, out| {
            let (sine, cosine) = (shapes[0] * now.position).sin_cos();
            (out[0], out[1]) = (now.sign * sine, now.sign * cosine);
        }),
        // The plant's is a fraction of the friction of the side.
        of_plant: |_| None,
    }
}

impl Effect for PositionDependentFriction {
    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        let law = PositionDependent {
            level: 1.0,
            amplitude: self.amplitude,
            order: self.order,
            phase: self.phase,
            overtone_amplitude: 0.0,
            overtone_phase: 0.0,
        };
        load.load.dry.scale(law.factor(load.position_rad));
    }
}
