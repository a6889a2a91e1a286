//! What the thesis publishes, read from its text, each value with the place where it stands.
//!
//! Cut-off means a gain of 0.707, absolute, above the peak. Values of kind [`Kind::Formula`] are
//! not printed: they follow from a printed equation, and a test works them out again.

use anyhow::{Context as _, Result};
use serde::Serialize;

/// Where a published value comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Measured on the rig.
    Measured,
    /// Simulated by the author.
    Simulated,
    /// Said in words of a plot.
    Stated,
    /// Follows from a printed equation.
    Formula,
}

impl Kind {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Simulated => "simulated",
            Self::Stated => "stated",
            Self::Formula => "formula",
        }
    }
}

/// One published value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published {
    /// Its name, stable.
    pub id: &'static str,
    /// Figure (or equation) that it belongs to.
    pub figure: &'static str,
    /// Section in which it stands.
    pub section: &'static str,
    /// Where it comes from.
    pub kind: Kind,
    /// Unit.
    pub unit: &'static str,
    /// The value in that unit.
    pub value: f64,
}

macro_rules! published {
    ($(
        $id:literal $figure:literal $section:literal $kind:ident $value:literal $unit:literal;
    )+) => {
        /// All published values on response, friction, delay, fits and learning.
        pub const PUBLISHED: &[Published] = &[$(Published {
            id: $id,
            figure: $figure,
            section: $section,
            kind: Kind::$kind,
            unit: $unit,
            value: $value,
        }),+];
    };
}

published! {
    "hydrostatic.frequency_response_measured.resonance_hz" "5.7" "§ 5.2.3" Measured 8.0 "Hz";
    "hydrostatic.frequency_response_measured.cutoff_hz" "5.7" "§ 5.2.3" Measured 12.0 "Hz";
    "hydrostatic.delay_measured.delay_s" "3.3" "§ 4.3" Measured 0.030 "s";
    "hydrostatic.static_friction_measured.positive_nm" "5.5" "§ 5.2.2" Measured 0.9 "N·m";
    "hydrostatic.static_friction_measured.negative_nm" "5.5" "§ 5.2.2" Measured 1.0 "N·m";
    "hydrostatic.static_friction_voltage_measured.value_v" "3.2" "ch. 4" Measured 1.5 "V";
    "hydrostatic.linear_fit_10m.low_frequency_gain" "3.4" "eq. 3.3.1" Simulated 0.769 "1";
    "hydrostatic.linear_fit_10m.stated_resonance_hz" "3.4" "§ 3.3.1" Stated 7.0 "Hz";
    "hydrostatic.linear_fit_10m.stated_cutoff_hz" "3.4" "§ 3.3.1" Stated 20.0 "Hz";
    "hydrostatic.linear_fit_10m.formula_peak_hz" "3.4" "eq. 3.3.1" Formula 5.69 "Hz";
    "hydrostatic.linear_fit_10m.formula_cutoff_hz" "3.4" "eq. 3.3.1" Formula 8.4 "Hz";
    "hydrostatic.linear_fit_10m.formula_lag_1hz_s" "3.4" "eq. 3.3.1" Formula 0.0106 "s";
    "hydrostatic.linear_fit_1m.stated_natural_frequency_hz" "3.7" "§ 3.3.4" Stated 49.5 "Hz";
    "hydrostatic.linear_fit_1m.stated_cutoff_hz" "3.7" "§ 3.3.4" Stated 100.0 "Hz";
    "hydrostatic.linear_fit_1m.formula_natural_hz" "3.7" "eq. 3.3.2" Formula 49.18 "Hz";
    "hydrostatic.linear_fit_1m.formula_cutoff_hz" "3.7" "eq. 3.3.2" Formula 72.7 "Hz";
    "hydrostatic.gain_bounds.min_db" "3.4" "eq. 4.3.6" Stated -3.0 "dB";
    "hydrostatic.gain_bounds.max_db" "3.4" "eq. 4.3.6" Stated 12.0 "dB";
    "hydrostatic.vanishing.frequency_hz" "3.4" "§ 3.3.1" Stated 20.0 "Hz";
    "hydrostatic.force_control.beta" "4.2" "§ 4.2" Stated 0.4 "1";
    "hydrostatic.force_control.p1" "4.2" "§ 4.2" Stated 0.333 "V/V";
    "hydrostatic.force_control.p2_v_s_per_count" "4.2" "eq. 4.2.3" Stated 1.11e-4 "V·s/count";
    "hydrostatic.force_control.c_counts_per_s" "4.2" "eq. 4.2.3" Stated 1000.0 "counts/s";
    "hydrostatic.force_control.offset_low_v" "4.2" "eq. 4.2.3" Stated 1.5 "V";
    "hydrostatic.force_control.offset_high_v" "4.2" "eq. 4.2.3" Stated 1.2 "V";
    "hydrostatic.force_control.free_movement_deg" "4.2" "§ 4.2" Stated 120.0 "°";
    "hydrostatic.force_control.free_movement_hz" "4.2" "§ 4.2" Stated 3.0 "Hz";
    "hydrostatic.ilc.initial_error_deg" "4.6" "§ 4.3" Simulated 11.0 "°";
    "hydrostatic.ilc.final_error_deg" "4.6" "§ 4.3" Simulated 1.0 "°";
    "hydrostatic.ilc.blocks" "4.6" "§ 4.3" Simulated 83.0 "1";
    "hydrostatic.ilc.block_s" "4.6" "§ 4.3" Simulated 3.0 "s";
    "hydrostatic.ilc.delay_samples_2khz" "4.6" "§ 4.3" Simulated 60.0 "1";
    "cable.length_m" "5.7" "§ 5.1" Measured 9.0 "m";
    "cable.cable_length_m" "5.7" "§ 5.1" Measured 18.0 "m";
    "cable.diameter_mm" "5.7" "§ 5.1" Measured 1.0 "mm";
    "cable.stiffness_n_per_m" "5.3" "§ 5.2.1" Measured 3.725e4 "N/m";
    "cable.encoder_lines_per_rev" "5.7" "§ 5.1" Measured 5000.0 "1";
    "cable.static_friction_positive_nm" "5.5" "§ 5.2.2" Measured 0.5 "N·m";
    "cable.static_friction_negative_nm" "5.5" "§ 5.2.2" Measured 0.45 "N·m";
    "cable.resonance_hz" "5.7" "§ 5.2.3" Measured 8.0 "Hz";
    "cable.cutoff_hz" "5.7" "§ 5.2.3" Measured 12.0 "Hz";
    "cable.mechanical_ratio" "5.7" "§ 5.2.3" Measured 6.0 "1";
    "cable.support_spacing_m" "5.7" "§ 5.1" Measured 3.0 "m";
}

/// The published value of that name.
///
/// # Errors
/// Where there is no value of that name.
pub fn published(id: &'static str) -> Result<&'static Published> {
    PUBLISHED.iter().find(|published| published.id == id).with_context(|| {
        format!("no published value `{id}`; its id must stand in the table of published values")
    })
}
