//! Limits that the watchdog and the gate enforce.

use crate::axis_unit::{AxisUnit, KeyNames};
use crate::checked_toml::{Bounds, Keys, Section, bounds};

/// Limits of an axis, enforced by the watchdog and the gate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// Lowest position of master and slave (rad or m).
    pub position_min: f64,
    /// Highest position of master and slave (rad or m).
    pub position_max: f64,
    /// Highest speed in either direction (rad/s or m/s).
    pub speed_max: f64,
    /// Largest magnitude of the motor voltage (V).
    pub volts_max: f64,
    /// Largest magnitude of the hand's torque (N·m or N); `None` without a torque channel.
    pub torque_max: Option<f64>,
    /// Largest plausible change of an encoder's count between two scans (counts).
    pub encoder_jump_counts: i64,
}

const POSITION_DEG: Bounds =
    bounds(-120.0, 120.0, "the thesis moves within ±120° (§ 4.2); the value is in degrees");
const POSITION_M: Bounds = bounds(-5.0, 5.0, "the value is in m");
const SPEED_DEG: Bounds = bounds(
    30.0,
    2262.0,
    "3 Hz over ±120° (§ 4.2) peaks at 2262 °/s; the value is in °/s, \
     and less than 30 looks like rad/s",
);
const SPEED_M: Bounds = bounds(1e-3, 10.0, "the value is in m/s");
pub(crate) const VOLTS: Bounds = bounds(0.1, 10.0, "the card's output range is ±10 V");
const TORQUE: Bounds =
    bounds(0.1, 20.0, "the value is in N·m; a hand at the handle stays below 20 N·m");
const FORCE: Bounds = bounds(0.1, 5000.0, "the value is in N");

pub(crate) const POSITION_MIN: KeyNames = KeyNames("position_min_deg", "position_min_m");
pub(crate) const POSITION_MAX: KeyNames = KeyNames("position_max_deg", "position_max_m");
pub(crate) const TORQUE_MAX: KeyNames = KeyNames("torque_max_nm", "force_max_n");

const KEYS: Keys = &[
    ("position_min_{deg,m}", "Lowest position of master and slave."),
    ("position_max_{deg,m}", "Highest position of master and slave."),
    ("speed_max_{deg,m}_s", "Highest speed in either direction."),
    ("volts_max", "Largest magnitude of the motor voltage."),
    ("torque_max_nm", "Largest magnitude of the hand's torque; required with a torque channel."),
    ("force_max_n", "Largest magnitude of the hand's force, on an axis in m."),
    ("encoder_jump_counts", "Largest plausible change of an encoder's count between two scans."),
];

impl Limits {
    pub(crate) fn read(section: Section<'_>, unit: AxisUnit, torque: bool) -> Self {
        section.document("[axes.limits]", KEYS);
        let (position, speed, torque_bounds) =
            unit.choose((POSITION_DEG, SPEED_DEG, TORQUE), (POSITION_M, SPEED_M, FORCE));
        let scale = unit.si_per_file_unit();
        let (min, max) = (unit.key(&section, POSITION_MIN), unit.key(&section, POSITION_MAX));
        let torque_key = unit.key(&section, TORQUE_MAX);
        let speed_key = unit.key(&section, KeyNames("speed_max_deg_s", "speed_max_m_s"));
        if !torque && section.has(torque_key) {
            let advice = "add the axis's torque channel, or take the limit out";
            section.problem(torque_key, "no limit where nothing is measured", "a limit", advice);
        }
        let jumps = "several times what the speed limit allows in one scan";
        Self {
            position_min: section.number(min, position) * scale,
            position_max: section.number(max, position) * scale,
            speed_max: section.number(speed_key, speed) * scale,
            volts_max: section.number("volts_max", VOLTS),
            torque_max: if torque {
                Some(section.number(torque_key, torque_bounds))
            } else {
                section.number_or_none(torque_key, torque_bounds)
            },
            encoder_jump_counts: section.whole("encoder_jump_counts", 2, 1_000_000_000, jumps)
                as i64,
        }
    }

    /// Whether an encoder's count changed by more between two scans than the machine can move in
    /// so many ticks.
    pub fn is_jump(&self, before: i64, after: i64, ticks: u64) -> bool {
        let allowed = u128::from(self.encoder_jump_counts.unsigned_abs()) * u128::from(ticks);
        u128::from(before.abs_diff(after)) > allowed
    }
}
