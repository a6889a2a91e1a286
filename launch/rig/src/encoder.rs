//! Incremental encoders.

use crate::axis_unit::{AxisUnit, KeyNames};
use crate::checked_toml::{Bounds, Keys, Section, bounds};

/// An incremental encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoder {
    /// Counts per rad or per m of the axis, positive (1/rad or 1/m).
    pub counts_per_unit: f64,
    /// Turns of the encoder's shaft per turn of the handle, positive; 1 without a gear.
    pub turns_per_handle_turn: f64,
    /// Whether the count falls when the axis moves in its positive direction.
    pub inverted: bool,
}

impl Encoder {
    fn sign(&self) -> f64 {
        if self.inverted { -1.0 } else { 1.0 }
    }

    /// Position for a count (rad or m).
    pub fn position(&self, counts: i64) -> f64 {
        self.sign() * counts as f64 / self.counts_per_unit
    }

    /// Count at a position, not rounded (counts).
    pub fn counts(&self, position: f64) -> f64 {
        self.sign() * position * self.counts_per_unit
    }
}

const COUNTS_PER_TURN: Bounds =
    bounds(100.0, 1e7, "counts of one whole turn, all four edges of each line");
const GEAR: Bounds = bounds(0.05, 50.0, "turns of the motor per turn of the handle");
const COUNTS_PER_METRE: Bounds = bounds(1e3, 1e10, "counts of one metre; 5e-8 m per count are 2e7");

const KEYS: Keys = &[
    ("counts_per_turn", "Counts per turn of the encoder, all four edges of each line."),
    ("counts_per_metre", "Counts per metre, on an axis in m."),
    ("inverted", "Whether the count falls when the axis moves in its positive direction."),
    ("turns_per_handle_turn", "Turns of the motor per turn of the handle; rotary master only."),
];

impl Encoder {
    /// Reads `master` or `slave`; only a `geared` encoder accepts `turns_per_handle_turn`.
    pub(crate) fn read(section: Section<'_>, unit: AxisUnit, geared: bool) -> Self {
        section.document("[axes.master] and [axes.slave]", KEYS);
        let key = unit.key(&section, KeyNames("counts_per_turn", "counts_per_metre"));
        let counts = section.number(key, unit.choose(COUNTS_PER_TURN, COUNTS_PER_METRE));
        let inverted = section.flag_or("inverted", false);
        let turns = match unit {
            AxisUnit::Radian if geared => section.number_or("turns_per_handle_turn", 1.0, GEAR),
            _ => 1.0,
        };
        let turn = unit.choose(std::f64::consts::TAU, 1.0);
        Self { counts_per_unit: turns * counts / turn, turns_per_handle_turn: turns, inverted }
    }
}
