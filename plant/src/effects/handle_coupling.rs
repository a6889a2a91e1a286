//! `handle_coupling`: products of inertia of a shared handle beyond the declared ones.
//!
//! `I_i q̈_i = τ_i - Σ_j C_ij q̈_j`, with the accelerations `q̈_j` of the other axes' slaves: the
//! law of [`crate::coupled_axes`], whose plant adds these products to its inertia matrix. A plant
//! of one axis refuses them; a transmission by itself knows of no other axes and ignores them.
//!
//! In a rig file it is no effect but a constant of the handle (`model.handle_coupling_kg_m2`).
//!
//! In a residual: where only another axis accelerates, this one is pushed. Confused with: a hand
//! that moves with the other axis.

use super::{Effect, effect};
use crate::handle_inertia::AXES;

effect! {
    "handle_coupling": "coupling of the axes by the inertia of their handle";
    at Slave = 2e-4 "kg m^2";
    /// Products of inertia with the other axes; that with the axis itself has no meaning.
    pub struct HandleCouplingBeyond {
        /// Product of inertia with the first axis `C_i0`.
        with_axis_0: "kg m^2", -1.0, 1.0, 2e-4, "assumed: 0.02 kg at 0.1 m along both axes";
        /// Product of inertia with the second axis `C_i1`.
        with_axis_1: "kg m^2", -1.0, 1.0, 0.0, "assumed";
        /// Product of inertia with the third axis `C_i2`.
        with_axis_2: "kg m^2", -1.0, 1.0, 0.0, "assumed";
    }
    search {
        space: |of| {
            let others = || of.features.other_axes.iter().filter_map(|axis| with_axis(*axis));
            let free: Vec<_> = others().map(|name| of.either(name, 20.0)).collect();
            let starts = others().flat_map(|name| {
                [1.0, 4.0].map(|factor| {
                    let rest = others().filter(|other| *other != name).map(|other| (other, 0.0));
                    std::iter::once((name, factor * of.size)).chain(rest).collect()
                })
            });
            of.space(free, starts.collect()).signed()
        },
    }
}

/// Name of the product of inertia with an axis.
pub fn with_axis(axis: usize) -> Option<&'static str> {
    HandleCouplingBeyond::NAMES.get(axis).map(|info| info.name)
}

impl Effect for HandleCouplingBeyond {
    fn handle_coupling_kg_m2(&self) -> [f64; AXES] {
        [self.with_axis_0, self.with_axis_1, self.with_axis_2]
    }
}
