//! `line_compliance`: more compliance in series than the fluid's.
//!
//! `1/K' = (1 + r)/K`: hose bulging, belts, entrained gas, which § 3.2.2 neglects. The traced rig
//! is the printed one with `r = 13`. Acts like a changed `line_stiffness_factor`.
//!
//! # In a model of one channel
//!
//! Compliance in series beyond the declared tolerance.
//!
//! `F = k x` with `k` outside the declared range: bulging of the hose, belts, a compliant clamp (or
//! one that stiffens). A spring in series with the declared one acts as a smaller stiffness:
//! `1/k = 1/k_declared + compliance`.
//!
//! Parameter: `stiffness_beyond_declared` (N/m or N·m/rad), fitted less declared; negative where
//! compliance is added.
//!
//! In a residual: plotted over the position, a straight line. Confused with: a wrong scale of force
//! or position, a relaxing branch in records much slower or much faster than its relaxation.

use super::one_channel::{Declared, Quantity, Term};
use super::{Effect, LineConstants, effect};

effect! {
    "line_compliance": "more compliance in series than the fluid's (hose bulging, belts)";
    at Line = 1.0 "1";
    /// More compliance in series.
    pub struct LineCompliance {
        /// Added compliance over the line's own.
        compliance_ratio: "1", 0.0, 200.0, 1.0, "§ 3.2.2; 13 traces the rig";
    }
    one_channel {
        rank: 150,
        words: "compliance in series (a stiffness outside of its declared tolerance)",
        experiment: "slow load and unload in steps, with the position measured on both sides of \
                     each clamp: what gives way is the compliance",
        lifts: Some(Declared::Stiffness),
        applies: |axis| axis.spring,
        linear: true,
        terms: |axis| vec![Term::free("stiffness_beyond_declared", axis.units.stiffness)],
        columns: Some(|view, _| vec![view.signals.position.clone()]),
        // Springs in series: 1/k = (1 + r)/k_declared.
        of_plant: |fit| {
            let stiffness = fit.declared_in(fit.parameters.first()?.unit)?;
            let value = stiffness.declared / stiffness.fitted - 1.0;
            Some(vec![Quantity { name: "compliance_ratio", value, unit: "1" }])
        },
    }
}

impl Effect for LineCompliance {
    fn modify(&self, constants: &mut dyn LineConstants) {
        constants.scale_line_stiffness(1.0 / (1.0 + self.compliance_ratio));
    }
}
