//! An amplifier that puts out nothing for small commands.
//!
//! `f = F - clamp(F, ±half_width)`, so that a wanted force `f` costs the command `F = f +
//! half_width · sign(f)`. `f` comes from the motion, not from the command, whose noise would
//! explain itself; its sign is smoothed over a twentieth of the force's rms.
//!
//! Parameter: `half_width` (N, N·m or V), at least 0; crossover of a stage without bias, 0.5 to 5 %
//! of the range.
//!
//! In a residual: over the command a step at zero. Confused with: Coulomb friction where inertia
//! hardly matters (command and velocity then change sign together).

use super::{Axis, Effect, InverseEffect, Term, View};

pub(super) struct AmplifierDeadzone;

impl Effect for AmplifierDeadzone {
    fn id(&self) -> &'static str {
        "amplifier_deadzone"
    }
    fn sites(&self) -> &'static [&'static str] {
        &["drive"]
    }
    fn words(&self) -> &'static str {
        "an amplifier that puts out nothing for small commands (dead zone)"
    }
    fn experiment(&self) -> &'static str {
        "slow triangles of the command through zero with the current measured: the flat part is \
         the dead zone"
    }
    fn inverse(&self) -> Option<&dyn InverseEffect> {
        Some(self)
    }
}

impl InverseEffect for AmplifierDeadzone {
    fn applies(&self, axis: &Axis) -> bool {
        axis.commanded
    }
    fn uses_model(&self) -> bool {
        true
    }
    fn terms(&self, axis: &Axis) -> Vec<Term> {
        vec![Term::positive("half_width", axis.units.force)]
    }
    fn columns(&self, view: &View<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        let smooth = 0.05 * view.axis.force_rms;
        vec![view.model.iter().map(|f| (f / smooth).tanh()).collect()]
    }
    fn deliver(&self, command: &[f64], _: f64, amplitudes: &[f64], _: &[f64]) -> Option<Vec<f64>> {
        let half = amplitudes[0].max(0.0);
        Some(command.iter().map(|f| f - f.clamp(-half, half)).collect())
    }
}
