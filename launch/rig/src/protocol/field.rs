//! The force field of a free movement, as a protocol gives it.

use super::matrix::Matrix;
use super::table::Table;
use crate::axis_unit::AxisUnit;
use crate::read::{Bounds, Section, bounds};

/// What the hand feels of one axis while it moves freely; all zero: nothing but what the control
/// leaves of the machine.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Field {
    /// Stiffness about the centre; negative drives away from it (N·m/rad or N/m).
    pub stiffness: f64,
    /// Damping; negative feeds a movement (N·m·s/rad or N·s/m).
    pub damping: f64,
    /// Inertia; negative takes some of the machine's away (kg·m² or kg).
    pub inertia: f64,
    /// Torque over position (N·m or N over rad or m).
    pub position_table: Option<Box<Table>>,
    /// Torque over velocity (N·m or N over rad/s or m/s).
    pub velocity_table: Option<Box<Table>>,
    /// Matrices over several axes, on top.
    pub matrix: Option<Box<Matrix>>,
    /// Centre of the spring (rad or m).
    pub centre: f64,
    /// Where walls begin: below and above (rad or m).
    pub walls: Option<(f64, f64)>,
    /// Stiffness of the walls (N·m/rad or N/m).
    pub wall_stiffness: f64,
}

/// What a protocol may ask for at all; what a rig can do with its gains is checked against the rig.
const SPRING: Bounds =
    bounds(-5.0, 10.0, "N·m/rad, or N/m on an axis in m; the thesis's screen has 0.1 to 2");
const DAMPER: Bounds = bounds(-0.5, 2.0, "N·m·s/rad, or N·s/m on an axis in m");
const INERTIA: Bounds =
    bounds(-0.1, 0.1, "kg·m², or kg on an axis in m; the handle's own is 0.002");
const WALL: Bounds = bounds(0.1, 50.0, "N·m/rad, or N/m on an axis in m");

impl Field {
    /// Stiffnesses and damping; `centre` and `walls` in rad or m.
    pub(super) fn read(section: &Section<'_>, centre: f64, walls: [Option<f64>; 2]) -> Self {
        let walls = match walls {
            [Some(least), Some(most)] if least < most => Some((least, most)),
            [None, None] => None,
            [Some(_), Some(_)] => {
                section.problem(
                    "wall_max_deg",
                    "more than wall_min_deg",
                    "walls the wrong way round",
                    "swap the two",
                );
                None
            }
            _ => {
                section.problem(
                    "wall_min_deg",
                    "both walls",
                    "one",
                    "give wall_min and wall_max; one may lie at the limit",
                );
                None
            }
        };
        let wall_stiffness = match walls {
            Some(_) => section.number_or("wall_stiffness", 10.0, WALL),
            None => {
                if section.has("wall_stiffness") {
                    section.problem(
                        "wall_stiffness",
                        "walls",
                        "their stiffness alone",
                        "add wall_min_deg and wall_max_deg",
                    );
                    section.number_or_none("wall_stiffness", WALL);
                }
                0.0
            }
        };
        let matrix = Matrix::read(section).map(Box::new);
        if matrix.is_some() {
            for key in
                ["spring", "centre_deg", "centre_m"].into_iter().filter(|key| section.has(key))
            {
                section.problem(
                    key,
                    "one of spring and matrix",
                    "both",
                    "put the spring into the matrix, its centre into centres_deg",
                );
            }
        }
        Self {
            stiffness: section.number_or("spring", 0.0, SPRING),
            damping: section.number_or("damper", 0.0, DAMPER),
            inertia: section.number_or("inertia", 0.0, INERTIA),
            position_table: Table::of_positions(section).map(Box::new),
            velocity_table: Table::of_velocities(section).map(Box::new),
            matrix,
            centre,
            walls,
            wall_stiffness,
        }
    }

    /// Torque of spring, table and walls on an axis at rest there (N·m or N); matrices left out.
    pub fn torque(&self, position: f64) -> f64 {
        let spring = -self.stiffness * (position - self.centre);
        let table = self.position_table.as_ref().map_or(0.0, |table| table.at(position));
        let wall = self.walls.map_or(0.0, |(least, most)| position.max(least).min(most) - position);
        spring + table + self.wall_stiffness * wall
    }

    /// The stiffest and the most divergent that it is anywhere, and the strongest damping and
    /// driving: what a check of stability has to go by on its own axis, matrices left out.
    /// Stiffness (N·m/rad or N/m), damping (N·m·s/rad or N·s/m), each from least to most.
    pub fn extremes(&self) -> [(f64, f64); 2] {
        // The slope of a table is the negative of a stiffness; beyond its ends it has none.
        let range = |table: &Option<Box<Table>>| {
            table.as_ref().map_or((0.0, 0.0), |table| {
                let (least, most) = table.slopes();
                (f64::min(-most, 0.0), f64::max(-least, 0.0))
            })
        };
        let (position, velocity) = (range(&self.position_table), range(&self.velocity_table));
        [
            (self.stiffness + position.0, self.stiffness + position.1 + self.wall_stiffness),
            (self.damping + velocity.0, self.damping + velocity.1),
        ]
    }

    /// Its largest torque at rest within limits (N·m or N), and where (rad or m).
    pub fn largest_torque(&self, least: f64, most: f64) -> (f64, f64) {
        // Linear between the walls' edges, the table's points and the limits: the largest stands at
        // one of them.
        let edges = self.walls.map_or([least, most], |(low, high)| [low, high]);
        [least, most]
            .into_iter()
            .chain(edges)
            .chain(self.position_table.iter().flat_map(|table| table.places()))
            .filter(|at| (least..=most).contains(at))
            .map(|at| (self.torque(at), at))
            .max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
            .unwrap_or((0.0, least))
    }
}

/// The symbol of a torque on an axis of that unit.
pub(super) const fn torque_symbol(unit: AxisUnit) -> &'static str {
    match unit {
        AxisUnit::Radian => "N·m",
        AxisUnit::Metre => "N",
    }
}
