//! One mass with friction, force in and position out: `m ẍ + c ẋ + offset = force`.
//!
//! The equation error of the force balance is minimised. Position and force pass the same
//! zero-phase low-pass ([`crate::filter`]: order 4 a pass, 40 Hz), velocity and acceleration are
//! five-point differences of the filtered position, nonlinear columns pass the low-pass once more,
//! as the friction in the force did, and every fifth sample (at 1 kHz) becomes a row. The first and
//! last 0.1 s are left out. The residual is the measured force minus the model's, in percent of the
//! force's rms. The method is that of Janot, Gautier, Brunot (2019), who publish 4.08 % with
//! Coulomb friction and 3.11 % with direction-dependent friction for the EMPS record.
//!
//! An open-loop simulation would be a poor criterion: a mass without a spring is a double
//! integrator.
//!
//! The offset is positive where the machine needs a positive force to stand still.

use super::force_balance::ForceBalanceModel;
use super::single_channel_study::Need::{Declared, Optional, Positive};
use crate::equation_error::model::Column;
use crate::equation_error::signals::CutOff;

/// The model kind `drive`. Its sites are the mass, the amplifier and motor, and the instruments.
pub(super) static DRIVE: ForceBalanceModel = ForceBalanceModel {
    columns: &["t_s", "force_n", "torque_nm", "motor_v", "position_m", "position_rad"],
    sites: &["master", "drive", "sensor"],
    // As published for EMPS.
    cut_off: CutOff { highest: 40.0, share: 0.1 },
    terms: &[
        (Column::Acceleration, &["mass_kg", "inertia_kg_m2"], Positive),
        (
            Column::Velocity,
            &[
                "viscous_friction_n_s_per_m",
                "viscous_friction_nm_s_per_rad",
                "viscous_n_s_per_m",
                "viscous_nm_s_per_rad",
            ],
            Declared,
        ),
        (Column::Sign, &["coulomb_friction_n", "coulomb_n", "coulomb_nm"], Optional),
        (Column::One, &["force_offset_n", "torque_offset_nm", "offset_n", "offset_nm"], Optional),
    ],
    scale: (Column::Acceleration, "force and acceleration give a mass"),
    spring: false,
    commanded: true,
};
