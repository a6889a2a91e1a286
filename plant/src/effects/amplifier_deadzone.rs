//! `amplifier_deadzone`: an amplifier with a dead zone about 0 V.
//!
//! `v → v - clamp(v, -w, w)`.
//!
//! # In a model of one channel
//!
//! Dead zone of the amplifier: small commands have no effect.
//!
//! `f = F - clamp(F, ±half_width)`, so that a force `f` requires the command
//! `F = f + half_width · sign(f)`. `f` is computed from the motion, not taken from the command,
//! since noise of the command would explain itself; its sign is smoothed over a twentieth of the
//! rms force.
//!
//! Parameter: `half_width` (N, N·m or V), at least 0; 0.5 to 5 % of the range in an output stage
//! without bias.
//!
//! In a residual: plotted over the command, a step at zero. Confused with: Coulomb friction where
//! inertia is small, since command and velocity then change sign together.

use super::one_channel::Term;
use super::{Effect, Moment, effect};

effect! {
    "amplifier_deadzone": "an amplifier that does nothing for small volts";
    at Drive = 0.1 "V";
    /// An amplifier with a dead zone.
    pub struct AmplifierDeadzone {
        /// Half width `w`.
        half_width: "V (N)", 0.0, 1e4, 0.1, "assumed";
    }
    search {
        space: |of| of.sizes(of.up_to("half_width", 10.0), &[0.5, 1.5, 4.0]),
    }
    monitoring {
        proportional: false,
    }
    one_channel {
        rank: 180,
        words: "an amplifier that puts out nothing for small commands (dead zone)",
        experiment: "slow triangles of the command through zero with the current measured: the \
                     flat part is the dead zone",
        applies: |axis| axis.commanded,
        uses_model: true,
        terms: |axis| vec![Term::positive("half_width", axis.units.force)],
        columns: Some(|view, _| {
            let smooth = 0.05 * view.axis.force_rms;
            vec![view.model.iter().map(|f| (f / smooth).tanh()).collect()]
        }),
        deliver: Some(|command, _, amplitudes, _| {
            let half = amplitudes[0].max(0.0);
            command.iter().map(|f| f - f.clamp(-half, half)).collect()
        }),
        of_plant: |fit| fit.renamed(&[("half_width", "half_width")]),
    }
}

impl Effect for AmplifierDeadzone {
    fn amplifier(&mut self, volts: f64, _moment: &Moment) -> f64 {
        volts - volts.clamp(-self.half_width, self.half_width)
    }
}
