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

use super::{Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "amplifier_deadzone",
    sites: &["drive"],
    words: "an amplifier that puts out nothing for small commands (dead zone)",
    experiment: "slow triangles of the command through zero with the current measured: the flat \
                 part is the dead zone",
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
    ..Effect::NONE
};
