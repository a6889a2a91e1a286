//! `gravity_imbalance`: a centre of mass off the axis.
//!
//! `τ = -m g l sin(q + φ)`; at `φ = 0` it pulls towards zero.
//!
//! # In a model of one channel
//!
//! A centre of mass off the axis of rotation.
//!
//! `τ = sine · sin q + cosine · cos q`; `√(sine² + cosine²) = m g l`. Source: pendulum.
//!
//! Parameters: `sine`, `cosine` (N·m); 0.2 kg at 0.1 m makes 0.2 N·m. Rotary axes that turn by 0.3
//! rad or more.
//!
//! In a residual: plotted over the position, one wave per turn, equal in both directions. Confused
//! with: a spring (over a small angle), an offset, torque ripple of low order.

use super::one_channel::Term;
use super::search::each;
use super::{Effect, Moment, SideLoad, effect};

effect! {
    "gravity_imbalance": "a centre of mass off the axis";
    at Master = 0.2 "N m", Slave = 0.2 "N m";
    /// A centre of mass off the axis.
    pub struct GravityImbalance {
        /// Largest torque `m g l`.
        torque: "N m (N)", -1e3, 1e3, 0.2, "assumed: 0.2 kg at 0.1 m";
        /// Angle `φ` from hanging, at zero position.
        phase: "rad", -3.15, 3.15, 0.0, "assumed";
    }
    search {
        space: |of| of
            .space([], each("torque", &[0.5 * of.size]))
            .phasor("torque", 10.0 * of.size),
    }
    one_channel {
        rank: 110,
        words: "a centre of mass off the axis (gravity)",
        experiment: "the same slow stroke with the axis turned by 90°, or upright: gravity \
                     follows, a spring does not",
        applies: |axis| axis.rotary && axis.travel() > 0.3,
        terms: Term::sine_and_cosine,
        force: Some(|now, _, _, out| (out[0], out[1]) = now.position.sin_cos()),
        beside_functions: true,
        of_plant: |fit| fit.wave("torque", 1.0),
    }
}

impl Effect for GravityImbalance {
    fn side(&mut self, load: &mut SideLoad, _moment: &Moment) {
        load.load.force -= self.torque * (load.position_rad + self.phase).sin();
    }
}
