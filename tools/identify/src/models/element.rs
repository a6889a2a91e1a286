//! A part tested by itself under imposed motion, motion in and force out: `k x + d v + offset =
//! force`.
//!
//! The cable in a testing machine, a seal, a damper, a piece of hose. The equation error is
//! minimised as for a drive ([`super::drive`]), except for the low-pass: its cut-off is 100 Hz, or
//! 0.15 of the sampling frequency if that is lower, since only one derivative is taken and mains
//! hum should remain visible. The residual is the measured force minus the model's, in percent of
//! the force's rms.
//!
//! Signs: the force that must be put on the part to move it; a positive stiffness needs a positive
//! force at a positive position. The offset is the force at position 0 and at rest. A mass that
//! moves with the part is declared as `mass_kg`; where it is not, the part has none, and one that
//! shows is `extra_inertia`.

use super::force_balance::ForceBalanceModel;
use super::single_channel_study::Need::{Declared, Optional, Positive};
use crate::equation_error::model::Column;
use crate::equation_error::signals::CutOff;

/// The model kind `element`. Its sites are the part, its moved end, and the instruments.
pub(super) static ELEMENT: ForceBalanceModel = ForceBalanceModel {
    columns: &["t_s", "position_m", "position_rad", "force_n", "torque_nm"],
    sites: &["line", "slave", "sensor"],
    cut_off: CutOff { highest: 100.0, share: 0.15 },
    terms: &[
        (Column::Position, &["stiffness_n_per_m", "stiffness_nm_per_rad"], Positive),
        (
            Column::Velocity,
            &["viscous_damping_n_s_per_m", "viscous_damping_nm_s_per_rad"],
            Declared,
        ),
        (Column::Acceleration, &["mass_kg", "inertia_kg_m2"], Optional),
        (Column::Sign, &["coulomb_friction_n", "coulomb_nm"], Optional),
        (Column::One, &["force_offset_n", "offset_nm"], Optional),
    ],
    scale: (Column::Position, "force and position give a stiffness"),
    spring: true,
    commanded: false,
};
