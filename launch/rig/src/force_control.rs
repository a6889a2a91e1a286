//! Gains of force control (§ 4.2).

use crate::checked_toml::{Keys, Section, bounds};
use crate::encoder::Encoder;
use crate::torque_channel::TorqueChannel;

/// Control period of the printed forgetting factor (s): 500 Hz.
const PRINTED_PERIOD_S: f64 = 2e-3;

/// Cut-off of the low pass on the handle's acceleration, from which an inertia field is computed
/// (Hz). It follows the low pass of the velocity (`velocity_filter_hz`); one count of 4,000 per
/// turn at 500 Hz is then about 20 rad/s².
pub const ACCELERATION_HZ: f64 = 10.0;

/// Gains of force control (§ 4.2, eq. 4.2.1-4.2.3), in SI and for speeds of the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceControl {
    /// Magnitude of the torque cell's sensitivity (V/(N·m) or V/N).
    pub volts_per_torque: f64,
    /// `P₁` (V/V).
    pub torque_gain: f64,
    /// `β` at 500 Hz.
    pub forgetting: f64,
    /// Offset below the threshold speed (V).
    pub offset_slow_v: f64,
    /// Offset at the threshold speed (V).
    pub offset_fast_v: f64,
    /// `C` (rad/s or m/s).
    pub threshold_speed: f64,
    /// `P₂` (V·s/rad or V·s/m).
    pub offset_slope: f64,
    /// Torque signal below which the offset grows in proportion (V).
    pub torque_threshold_v: f64,
    /// Stiffness of the soft stops before both ends (N·m/rad or N/m).
    pub end_stop_stiffness: f64,
    /// Distance from the ends at which they begin (rad or m); see [`Self::end_stop_width`].
    pub end_stop_way: f64,
}

const KEYS: Keys = &[
    ("p1", "Proportional gain P1 of eq. 4.2.2."),
    ("forgetting", "Forgetting factor beta of eq. 4.2.1, at 500 Hz."),
    ("offset_slow_v", "Friction offset of eq. 4.2.3 below the threshold speed."),
    ("offset_fast_v", "Friction offset of eq. 4.2.3 at the threshold speed."),
    ("threshold_counts_per_s", "Threshold speed C of eq. 4.2.3, in counts/s of the master."),
    ("p2_v_s_per_count", "Slope P2 of eq. 4.2.3, in V·s/count."),
    ("torque_threshold_v", "Torque signal below which the offset grows in proportion."),
    ("end_stop_stiffness", "Stiffness of the soft stops, in N·m/rad (N/m on an axis in m)."),
];

impl ForceControl {
    /// Weight of the new value in the output after `elapsed_s`, eq. 4.2.1.
    pub fn share(&self, elapsed_s: f64) -> f64 {
        1.0 - (1.0 - self.forgetting).powf(elapsed_s / PRINTED_PERIOD_S)
    }

    /// Width of the soft stops of an axis that ends at `least` and `most` (rad or m): at most a
    /// quarter of the way between the two, so that half of it is free of them.
    pub fn end_stop_width(&self, least: f64, most: f64) -> f64 {
        self.end_stop_way.min(0.25 * (most - least)).max(0.0)
    }

    /// Gain from the torque of hand and field to the output, without the offset: `P₁` times the
    /// cell's sensitivity (V/(N·m) or V/N).
    pub fn volts_per_hand_torque(&self) -> f64 {
        self.torque_gain * self.volts_per_torque
    }

    /// Reads `control.force` of an axis with a torque cell; `travel` is the width of the axis's
    /// range (rad or m), `per_file_unit` the SI value of a degree (or of a metre).
    pub(crate) fn read(
        section: &Section<'_>,
        master: &Encoder,
        torque: &TorqueChannel,
        travel: f64,
        per_file_unit: f64,
    ) -> Self {
        section.document("[axes.control.force]", KEYS);
        let volts =
            |key, printed, advice| section.number_or(key, printed, bounds(0.0, 5.0, advice));
        let slow = volts("offset_slow_v", 1.5, "eq. 4.2.3 has 1.5 V below the threshold speed");
        let fast = volts("offset_fast_v", 1.2, "eq. 4.2.3 has 1.2 V from the threshold speed on");
        let counts = master.counts_per_unit;
        let gain = bounds(0.0, 20.0, "P1 of eq. 4.2.2, in V/V");
        let factor = bounds(0.01, 1.0, "beta of eq. 4.2.1, at 500 Hz");
        let noise = bounds(1e-3, 5.0, "several times the noise of the torque channel, in V");
        let stiffness = bounds(0.0, 1e5, "N·m/rad, or N/m on an axis in m");
        let threshold = bounds(0.0, 1e9, "C of eq. 4.2.3, in counts/s");
        let slope = bounds(0.0, 1.0, "P2 of eq. 4.2.3, in V·s/count");
        // 10 degrees (0.1 m on an axis in m) before each end, at most a twentieth of the range.
        let stop = if per_file_unit < 1.0 { 10.0 * per_file_unit } else { 0.1 };
        Self {
            volts_per_torque: torque.volts_per_unit.abs(),
            torque_gain: section.number_or("p1", 0.333, gain),
            forgetting: section.number_or("forgetting", 0.4, factor),
            offset_slow_v: slow,
            offset_fast_v: fast,
            threshold_speed: section.number_or("threshold_counts_per_s", 1000.0, threshold)
                / counts,
            offset_slope: section.number_or("p2_v_s_per_count", 1.11e-4, slope) * counts,
            torque_threshold_v: section.number_or("torque_threshold_v", 0.02, noise),
            end_stop_stiffness: section.number_or("end_stop_stiffness", 10.0, stiffness),
            end_stop_way: stop.min(0.05 * travel),
        }
    }
}
